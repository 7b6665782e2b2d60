#include "tests/accuracy/robustness/recorded_mission.h"

#include <algorithm>
#include <map>
#include <random>
#include <set>
#include <string>
#include <utility>

#include "agent/uplink/outbox.h"
#include "common/trajectory/evaluation.h"
#include "common/trajectory/trajectory_io.h"
#include "common/wire/submap_wire.h"
#include "server/query/trajectory_query.h"

namespace portolan {
namespace {

std::set<std::filesystem::path> FoldersIn(const std::filesystem::path& folder) {
  std::set<std::filesystem::path> folders;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (entry.is_directory()) folders.insert(entry.path());
  }
  return folders;
}

StatusOr<std::vector<SubmapInput>> ReadSession(const std::filesystem::path& folder) {
  PORTOLAN_ASSIGN_OR_RETURN(const std::unique_ptr<Outbox> outbox, Outbox::Open(folder, {}));
  PORTOLAN_ASSIGN_OR_RETURN(CameraModel model, CameraModel::Create(outbox->hello().camera));
  const auto camera = std::make_shared<const CameraModel>(std::move(model));
  std::vector<SubmapInput> submaps;
  for (auto next = outbox->NextPending(0); next; next = outbox->NextPending(*next + 1)) {
    PORTOLAN_ASSIGN_OR_RETURN(const std::string bytes, outbox->Read(*next));
    PORTOLAN_ASSIGN_OR_RETURN(Submap submap, DecodeSubmap(bytes));
    submaps.push_back({SubmapId(), std::make_shared<const Submap>(std::move(submap)), camera});
  }
  return submaps;
}

// Frames of each agent in each component.
using Parts = std::map<std::pair<ComponentId, std::string>, Trajectory>;

Parts PartsOf(const MapSnapshot& snapshot, bool apart) {
  Parts parts;
  std::map<std::string, std::optional<Timestamp>> last;
  for (const auto& state : snapshot.submaps) {
    if (!state->refined->quarantine_reason.empty()) continue;
    const std::string& agent = state->refined->raw->key.agent.value();
    Trajectory& part = parts[{apart ? state->component : ComponentId(), agent}];
    for (const TimedPose& pose : PosesOf(*state, true, last[agent])) {
      part.push_back({pose.time, pose.world_from_camera});
      last[agent] = pose.time;
    }
  }
  return parts;
}

}  // namespace

StatusOr<RecordedMission> ReadRecordedMission(const std::filesystem::path& folder) {
  RecordedMission mission;
  for (const std::filesystem::path& agent : FoldersIn(folder)) {
    std::vector<SubmapInput> submaps;
    for (const std::filesystem::path& session : FoldersIn(agent)) {
      PORTOLAN_ASSIGN_OR_RETURN(const std::vector<SubmapInput> read, ReadSession(session));
      submaps.insert(submaps.end(), read.begin(), read.end());
    }
    if (!submaps.empty()) mission.agents.push_back(std::move(submaps));
  }
  if (mission.agents.empty()) {
    return absl::NotFoundError(folder.string() + ": no outbox with submaps");
  }
  return mission;
}

std::vector<SubmapInput> Interleave(const RecordedMission& mission, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<size_t> next(mission.agents.size(), 0);
  std::vector<SubmapInput> order;
  while (true) {
    std::vector<size_t> ready;
    for (size_t i = 0; i < next.size(); ++i) {
      if (next[i] < mission.agents[i].size()) ready.push_back(i);
    }
    if (ready.empty()) return order;
    size_t agent = ready[random() % ready.size()];
    if (seed == 0) {
      agent = *std::min_element(ready.begin(), ready.end(), [&](size_t a, size_t b) {
        return std::pair(next[a], a) < std::pair(next[b], b);
      });
    }
    SubmapInput input = mission.agents[agent][next[agent]++];
    input.id = SubmapId(static_cast<int64_t>(order.size()) + 1);
    order.push_back(std::move(input));
  }
}

StatusOr<GroundTruths> ReadGroundTruths(const std::filesystem::path& path) {
  GroundTruths truths;
  if (!std::filesystem::is_directory(path)) {
    PORTOLAN_ASSIGN_OR_RETURN(truths[""], ReadTrajectory(path));
    return truths;
  }
  for (const std::filesystem::path& agent : FoldersIn(path)) {
    PORTOLAN_ASSIGN_OR_RETURN(truths[agent.filename()], ReadTrajectory(agent / "groundtruth.txt"));
  }
  return truths;
}

const Trajectory& TruthOf(const GroundTruths& groundtruths, const std::string& agent) {
  static const Trajectory kNone;
  auto it = groundtruths.find(agent);
  if (it == groundtruths.end()) it = groundtruths.find("");
  return it == groundtruths.end() ? kNone : it->second;
}

StatusOr<MapAccuracy> EvaluateMap(const MapSnapshot& snapshot, const GroundTruths& groundtruths) {
  MapAccuracy accuracy;
  const Parts joint = PartsOf(snapshot, false);
  std::vector<TrajectoryPair> pairs;
  for (const auto& [name, part] : joint)
    pairs.push_back({name.second, &part, &TruthOf(groundtruths, name.second)});
  PORTOLAN_ASSIGN_OR_RETURN(const TrajectoryEvaluation all, EvaluateTrajectories(pairs, {}));
  accuracy.ate_m = all.joint.ate_m.rmse;
  accuracy.coverage = all.joint.coverage;
  accuracy.path_m = all.joint.reference_path_m;
  const Parts apart = PartsOf(snapshot, true);
  std::map<ComponentId, std::vector<TrajectoryPair>> components;
  for (const auto& [name, part] : apart) {
    components[name.first].push_back({name.second, &part, &TruthOf(groundtruths, name.second)});
  }
  accuracy.components = static_cast<int>(components.size());
  for (const auto& [id, members] : components) {
    const auto alone = EvaluateTrajectories(members, {});
    if (alone.ok()) {
      accuracy.worst_part_m = std::max(accuracy.worst_part_m, alone->joint.ate_m.rmse);
    }
  }
  return accuracy;
}

}  // namespace portolan
