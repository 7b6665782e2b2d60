#include <map>
#include <set>
#include <utility>

#include "common/wire/geometry_wire.h"
#include "server/rpc/map_handlers.h"

namespace portolan {
namespace {

constexpr int kMaxLandmarksOfPage = 1024;
constexpr uint32_t kMaxNearest = 100000;
constexpr int kMaxAgents = 1024;

using Landmarks = std::vector<const FusedLandmark*>;

StatusOr<Landmarks> FindInBox(const LandmarkIndex& index, ComponentId component, const v1::Box& box,
                              const LandmarkFilter& filter) {
  PORTOLAN_ASSIGN_OR_RETURN(const Eigen::Vector3d min, FromProto(box.min(), "box.min"));
  PORTOLAN_ASSIGN_OR_RETURN(const Eigen::Vector3d max, FromProto(box.max(), "box.max"));
  if ((min.array() > max.array()).any()) {
    return absl::InvalidArgumentError("a coordinate of box.min exceeds that of box.max");
  }
  return index.InBox(component, min, max, filter);
}

StatusOr<Landmarks> Find(const LandmarkIndex& index, ComponentId component,
                         const v1::QueryLandmarksRequest& request) {
  if (request.min_observation_count() > 1000000000) return Landmarks();
  const LandmarkFilter filter{static_cast<int>(request.min_observation_count())};
  switch (request.region_case()) {
    case v1::QueryLandmarksRequest::kBox:
      return FindInBox(index, component, request.box(), filter);
    case v1::QueryLandmarksRequest::kSphere: {
      PORTOLAN_ASSIGN_OR_RETURN(const Eigen::Vector3d center,
                                FromProto(request.sphere().center(), "sphere.center"));
      const double radius = request.sphere().radius();
      if (!(radius >= 0 && radius <= 4 * kMaxCoordinate)) {
        return absl::InvalidArgumentError("sphere.radius is negative, too large or not a number");
      }
      return index.InSphere(component, center, radius, filter);
    }
    case v1::QueryLandmarksRequest::kNearest: {
      PORTOLAN_ASSIGN_OR_RETURN(const Eigen::Vector3d point,
                                FromProto(request.nearest().point(), "nearest.point"));
      const uint32_t count = request.nearest().count();
      if (count < 1 || count > kMaxNearest) {
        return absl::InvalidArgumentError("nearest.count must be 1 to 100000");
      }
      return index.Nearest(component, point, count, filter);
    }
    case v1::QueryLandmarksRequest::REGION_NOT_SET:
      break;
  }
  return absl::InvalidArgumentError("one of box, sphere and nearest must be set");
}

// Numbers the agents of a page.
class AgentNumbers {
 public:
  AgentNumbers(const MapSnapshot& snapshot, v1::LandmarkPage* page)
      : snapshot_(snapshot), page_(page) {}

  std::set<uint32_t> Of(const FusedLandmark& landmark) {
    std::set<uint32_t> numbers;
    for (const LandmarkSight& sight : landmark.sights) {
      const AgentId* agent = AgentOf(sight.submap);
      if (!agent) continue;
      const auto [number, is_new] = numbers_.try_emplace(*agent, page_->agent_ids_size());
      if (is_new && page_->agent_ids_size() == kMaxAgents) {
        numbers_.erase(number);
        continue;
      }
      if (is_new) page_->add_agent_ids(agent->value());
      numbers.insert(static_cast<uint32_t>(number->second));
    }
    return numbers;
  }

 private:
  const AgentId* AgentOf(SubmapId submap) const {
    const auto state =
        std::lower_bound(snapshot_.submaps.begin(), snapshot_.submaps.end(), submap,
                         [](const auto& state, SubmapId id) { return state->refined->id < id; });
    if (state == snapshot_.submaps.end() || (*state)->refined->id != submap) return nullptr;
    return &(*state)->refined->raw->key.agent;
  }

  const MapSnapshot& snapshot_;
  v1::LandmarkPage* const page_;
  std::map<AgentId, int> numbers_;
};

void FillLandmark(const FusedLandmark& landmark, AgentNumbers* agents, v1::Landmark* message) {
  message->set_landmark_id(landmark.id.value());
  ToProto(landmark.point_in_world, message->mutable_point_in_world());
  const Eigen::Matrix3d covariance = landmark.covariance.Matrix();
  for (int row = 0; row < 3; ++row) {
    for (int column = row; column < 3; ++column) {
      message->add_covariance(static_cast<float>(covariance(row, column)));
    }
  }
  message->set_observation_count(static_cast<uint32_t>(landmark.observation_count));
  for (const uint32_t number : agents->Of(landmark)) message->add_agents(number);
}

}  // namespace

StatusOr<PageMaker<v1::LandmarkPage>> QueryLandmarks(const ServerContext& server,
                                                     const v1::QueryLandmarksRequest& request) {
  std::shared_ptr<const LandmarkIndex> index = server.landmarks->Get(server.hub->Get());
  const ComponentId component =
      request.component_id() == 0 ? index->LargestComponent() : ComponentId(request.component_id());
  PORTOLAN_ASSIGN_OR_RETURN(Landmarks found, Find(*index, component, request));
  if (request.limit() > 0 && found.size() > request.limit()) found.resize(request.limit());
  return [index = std::move(index), found = std::move(found), component, next = size_t{0},
          is_first = true](v1::LandmarkPage* page) mutable {
    page->set_map_version(index->snapshot().version);
    page->set_component_id(component.value());
    page->set_metric(IsMetric(index->snapshot(), component));
    AgentNumbers agents(index->snapshot(), page);
    for (; next < found.size() && page->landmarks_size() < kMaxLandmarksOfPage; ++next) {
      FillLandmark(*found[next], &agents, page->add_landmarks());
    }
    const bool is_needed = is_first || page->landmarks_size() > 0;
    is_first = false;
    return is_needed;
  };
}

}  // namespace portolan
