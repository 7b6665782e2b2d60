#include "tests/support/replay_fleet.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <unordered_map>
#include <utility>

#include "common/base/check.h"
#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

constexpr double kTurnRadius = 5;  // metres
// The camera looks to the left front, where the houses pass by.
constexpr double kLookLeft = 0.8;  // radians

// A random way along the streets, in pieces from the middle of one street to that of the next.
class Route {
 public:
  Route(const ReplayWorldOptions& world, std::mt19937_64* random)
      : blocks_(world.blocks), spacing_(world.street_spacing_m), random_(*random) {
    ahead_ = {Pick(blocks_ + 1), Pick(blocks_ + 1)};
    ChooseTurn();
    place_ = Unit() * PieceLength();
    side_m_ = 2 * Unit() - 1;
    height_m_ = 2.5 + 2 * Unit();
    phase_ = 6 * Unit();
  }

  void Advance(double metres) {
    travelled_ += metres;
    place_ += metres;
    while (place_ >= PieceLength()) {
      place_ -= PieceLength();
      incoming_ = Turned(incoming_, turn_);
      ahead_ = {ahead_.first + incoming_.first, ahead_.second + incoming_.second};
      ChooseTurn();
    }
  }

  Rigid3 WorldFromCamera() const {
    Eigen::Vector2d position;
    double heading = 0;
    Locate(&position, &heading);
    const Eigen::Vector2d left(-std::sin(heading), std::cos(heading));
    position += (side_m_ + 0.3 * std::sin(0.11 * travelled_ + phase_)) * left;
    const double yaw = heading + kLookLeft + 0.05 * std::sin(0.3 * travelled_ + phase_);
    Eigen::Matrix3d axes;  // columns: camera x, y, z in the world
    axes.col(2) =
        Eigen::Vector3d(std::cos(yaw), std::sin(yaw), 0.05 * std::sin(0.2 * travelled_ + phase_))
            .normalized();
    axes.col(0) = axes.col(2).cross(Eigen::Vector3d::UnitZ()).normalized();
    axes.col(1) = axes.col(2).cross(axes.col(0));
    Rigid3 pose;
    pose.translation << position, height_m_ + 0.4 * std::sin(0.17 * travelled_ + phase_);
    pose.rotation = Eigen::Quaterniond(axes);
    return pose;
  }

 private:
  using Cell = std::pair<int, int>;

  int Pick(int count) { return static_cast<int>(random_() % static_cast<uint64_t>(count)); }
  double Unit() { return std::uniform_real_distribution<double>(0, 1)(random_); }

  // Half a street, the crossing with its turn, half a street.
  double PieceLength() const {
    const double straight = spacing_ - 2 * kTurnRadius;
    return straight + (turn_ == 0 ? 2 * kTurnRadius : 0.5 * M_PI * kTurnRadius);
  }

  static Cell Turned(const Cell& direction, int turn) {
    if (turn == 0) return direction;
    return {-turn * direction.second, turn * direction.first};
  }

  // Never out of the town; a street always leads on to one side at least.
  void ChooseTurn() {
    Cell next;
    do {
      turn_ = Pick(3) - 1;
      const Cell direction = Turned(incoming_, turn_);
      next = {ahead_.first + direction.first, ahead_.second + direction.second};
    } while (next.first < 0 || next.second < 0 || next.first > blocks_ || next.second > blocks_);
  }

  void Locate(Eigen::Vector2d* position, double* heading) const {
    const Eigen::Vector2d in(incoming_.first, incoming_.second);
    const Cell turned = Turned(incoming_, turn_);
    const Eigen::Vector2d out(turned.first, turned.second);
    const Eigen::Vector2d crossing = spacing_ * Eigen::Vector2d(ahead_.first, ahead_.second);
    const double half = 0.5 * spacing_ - kTurnRadius;
    const double in_heading = std::atan2(in.y(), in.x());
    const double curve = PieceLength() - 2 * half;
    if (place_ < half) {
      *position = crossing + (place_ - half - kTurnRadius) * in;
      *heading = in_heading;
    } else if (place_ >= half + curve) {
      *position = crossing + (place_ - half - curve + kTurnRadius) * out;
      *heading = std::atan2(out.y(), out.x());
    } else if (turn_ == 0) {
      *position = crossing + (place_ - half - kTurnRadius) * in;
      *heading = in_heading;
    } else {
      const double angle = (place_ - half) / kTurnRadius;
      *position = crossing - kTurnRadius * in + kTurnRadius * std::sin(angle) * in +
                  kTurnRadius * (1 - std::cos(angle)) * out;
      *heading = in_heading + turn_ * angle;
    }
  }

  const int blocks_;
  const double spacing_;
  std::mt19937_64& random_;
  Cell ahead_;              // the crossing of this piece
  Cell incoming_ = {1, 0};  // direction in which it is reached
  int turn_ = 0;            // there: -1 right, 0 straight on, 1 left
  double place_ = 0;        // in the piece
  double travelled_ = 0;
  double side_m_ = 0;
  double height_m_ = 3;
  double phase_ = 0;
};

}  // namespace

// One agent's tracker and filter.
class ReplayFleet::Agent {
 public:
  Agent(int index, const ReplayFleetOptions& options, const ReplayWorld& world,
        const CameraModel& camera)
      : index_(index),
        options_(options),
        world_(world),
        camera_(camera),
        random_(options.world.seed * 100003 + static_cast<uint64_t>(index)),
        route_(options.world, &random_),
        unit_(std::exp(0.4 * Normal())) {}

  ReplaySubmap Next() {
    ReplaySubmap result;
    result.agent = index_;
    auto submap = std::make_shared<Submap>();
    submap->key = {AgentId("agent" + std::to_string(index_)),
                   SessionId(static_cast<uint64_t>(index_) + 1), number_};
    submap->link = number_ == 0 ? LinkType::kNone : LinkType::kConnected;
    if (number_ > 0) unit_ *= std::exp(options_.scale_drift * Normal());
    drift_ = Rigid3();
    for (int k = 0; k < options_.keyframes_per_submap; ++k) {
      const bool is_shared = number_ > 0 && k == 0;
      if (!is_shared)
        TakeKeyframe(k == options_.keyframes_per_submap / 2 || number_ + k == 0 ||
                     k + 1 == options_.keyframes_per_submap);
      result.world_from_camera.push_back(world_from_camera_);
      submap->keyframes.push_back(keyframe_);
      Keyframe& keyframe = submap->keyframes.back();
      keyframe.submap_from_camera = FilterPose(result.world_from_camera);
      keyframe.covariance = 1e-4 * Matrix6d::Identity();
      if (k + 1 == options_.keyframes_per_submap) keyframe.features.clear();
      AddFrames(submap.get());
    }
    AddLandmarks(result.world_from_camera.front(), submap.get());
    ++number_;
    result.submap = std::move(submap);
    return result;
  }

 private:
  struct Track {
    TrackId id;
    bool seen = false;
  };

  double Normal() { return std::normal_distribution<double>(0, 1)(random_); }
  double Unit() { return std::uniform_real_distribution<double>(0, 1)(random_); }
  Eigen::Vector3d NormalVector(double sigma) {
    const double x = Normal(), y = Normal(), z = Normal();
    return sigma * Eigen::Vector3d(x, y, z);
  }

  void TakeKeyframe(bool describe) {
    if (step_ > 0) route_.Advance(options_.keyframe_distance_m);
    world_from_camera_ = route_.WorldFromCamera();
    keyframe_ = Keyframe();
    keyframe_.time = FromSeconds(100 + options_.keyframe_distance_m * step_++);
    std::vector<ReplayWorld::Sight> sights = world_.Visible(camera_, world_from_camera_);
    std::shuffle(sights.begin(), sights.end(), random_);
    const size_t untracked = Observe(sights);
    std::sort(keyframe_.observations.begin(), keyframe_.observations.end(),
              [](const Observation& a, const Observation& b) { return a.track < b.track; });
    if (describe) Describe(sights, untracked);
  }

  // Continues tracks, then begins new ones; returns how many sights, at the front, have none.
  size_t Observe(std::vector<ReplayWorld::Sight>& sights) {
    for (auto& [point, track] : tracks_) track.seen = false;
    for (const ReplayWorld::Sight& sight : sights) {
      const auto it = tracks_.find(sight.point);
      if (it == tracks_.end() || Unit() < options_.lost_track_share) continue;
      it->second.seen = true;
      AddObservation(it->second.id, sight.pixel);
    }
    std::erase_if(tracks_, [](const auto& track) { return !track.second.seen; });
    const auto tracked = std::partition(sights.begin(), sights.end(), [&](const auto& sight) {
      return !tracks_.contains(sight.point);
    });
    size_t free = static_cast<size_t>(tracked - sights.begin());
    while (free > 0 && tracks_.size() < static_cast<size_t>(options_.max_tracks)) {
      const ReplayWorld::Sight& sight = sights[--free];
      tracks_[sight.point] = {TrackId(next_track_++), true};
      AddObservation(tracks_[sight.point].id, sight.pixel);
    }
    return free;
  }

  void AddObservation(TrackId track, Eigen::Vector2d pixel) {
    pixel.x() += options_.pixel_sigma * Normal();
    pixel.y() += options_.pixel_sigma * Normal();
    if (Unit() < options_.outlier_share) {
      const double x = Unit(), y = Unit();
      pixel = {639 * x, 479 * y};
    }
    Observation observation;
    observation.track = track;
    observation.pixel = pixel.cast<float>().cwiseMax(0.f).cwiseMin(Eigen::Vector2f(639, 479));
    observation.sigma_px = static_cast<float>(options_.pixel_sigma);
    keyframe_.observations.push_back(observation);
  }

  void Describe(const std::vector<ReplayWorld::Sight>& sights, size_t untracked) {
    untracked = std::min(untracked, static_cast<size_t>(options_.untracked_features));
    for (size_t i = 0; i < sights.size(); ++i) {
      const auto track = tracks_.find(sights[i].point);
      if (track == tracks_.end() && i >= untracked) continue;
      Feature feature;
      feature.pixel = sights[i].pixel.cast<float>();
      feature.descriptor =
          world_.Describe(sights[i].point, world_from_camera_.translation, &random_);
      if (track != tracks_.end()) {
        feature.track = track->second.id;
        feature.pixel = PixelOf(track->second.id);
      }
      keyframe_.features.push_back(feature);
    }
  }

  Eigen::Vector2f PixelOf(TrackId track) const {
    return std::lower_bound(
               keyframe_.observations.begin(), keyframe_.observations.end(), track,
               [](const Observation& observation, TrackId id) { return observation.track < id; })
        ->pixel;
  }

  Rigid3 FilterPose(const std::vector<Rigid3>& world_from_camera) {
    if (world_from_camera.size() == 1) return Rigid3::Identity();
    const Rigid3& truth = world_from_camera.back();
    const double step =
        (truth.translation - world_from_camera[world_from_camera.size() - 2].translation).norm();
    drift_.translation += NormalVector(options_.drift_translation_share * step * unit_);
    drift_.rotation = drift_.rotation * RotationExp(NormalVector(options_.drift_rotation_rad));
    Rigid3 relative = world_from_camera.front().Inverse() * truth;
    relative.translation *= unit_;
    return relative * drift_;
  }

  // The keyframe and, since the one before, two more.
  static void AddFrames(Submap* submap) {
    const Keyframe& newest = submap->keyframes.back();
    if (submap->keyframes.size() > 1) {
      const Keyframe& before = submap->keyframes[submap->keyframes.size() - 2];
      for (const double share : {1.0 / 3, 2.0 / 3}) {
        FramePose frame;
        frame.time =
            before.time +
            std::chrono::duration_cast<Duration>(
                share * std::chrono::duration<double, std::nano>(newest.time - before.time));
        frame.submap_from_camera.rotation =
            before.submap_from_camera.rotation.slerp(share, newest.submap_from_camera.rotation);
        frame.submap_from_camera.translation = (1 - share) * before.submap_from_camera.translation +
                                               share * newest.submap_from_camera.translation;
        submap->frames.push_back(frame);
      }
    }
    submap->frames.push_back({newest.time, newest.submap_from_camera});
  }

  // A third of the tracks that live long enough, as a filter would know them.
  void AddLandmarks(const Rigid3& world_from_submap, Submap* submap) {
    std::unordered_map<uint32_t, int> counts;
    for (const Keyframe& keyframe : submap->keyframes) {
      for (const Observation& observation : keyframe.observations) {
        ++counts[observation.track.value()];
      }
    }
    const Rigid3 submap_from_world = world_from_submap.Inverse();
    const double sigma = 0.05 * unit_;
    std::vector<std::pair<TrackId, int>> known;
    for (const auto& [point, track] : tracks_) {
      if (track.id.value() % 3 == 0 && counts[track.id.value()] >= 4) {
        known.emplace_back(track.id, point);
      }
    }
    std::sort(known.begin(), known.end());
    for (const auto& [track, point] : known) {
      SubmapLandmark landmark;
      landmark.track = track;
      landmark.point_in_submap =
          unit_ * (submap_from_world * world_.position(point)) + NormalVector(sigma);
      landmark.covariance = sigma * sigma * Eigen::Matrix3d::Identity();
      submap->landmarks.push_back(landmark);
    }
  }

  const int index_;
  const ReplayFleetOptions& options_;
  const ReplayWorld& world_;
  const CameraModel& camera_;
  std::mt19937_64 random_;
  Route route_;
  double unit_;  // submap units in a metre
  uint32_t number_ = 0;
  uint32_t next_track_ = 1;
  int step_ = 0;
  std::map<int, Track> tracks_;  // by point
  Rigid3 world_from_camera_;
  Keyframe keyframe_;
  Rigid3 drift_;
};

ReplayFleetOptions ReplayFleetOptions::For(int submaps, int agents, double visits, uint64_t seed) {
  ReplayFleetOptions options;
  options.agents = agents;
  options.world.seed = seed;
  const double way = submaps * (options.keyframes_per_submap - 1) * options.keyframe_distance_m;
  // 2 b (b + 1) streets, in two directions.
  const double streets = way / visits / (2 * options.world.street_spacing_m);
  options.world.blocks =
      std::max(1, static_cast<int>(std::lround(std::sqrt(streets / 2 + 0.25) - 0.5)));
  return options;
}

ReplayFleet::ReplayFleet(const ReplayFleetOptions& options)
    : options_(options), world_(options.world) {
  StatusOr<CameraModel> camera = CameraModel::Create(SubmapTestCamera());
  PORTOLAN_CHECK(camera.ok() && options.agents > 0);
  camera_ = std::make_shared<const CameraModel>(*std::move(camera));
  for (int i = 0; i < options.agents; ++i) {
    agents_.push_back(std::make_unique<Agent>(i, options_, world_, *camera_));
  }
}

ReplayFleet::~ReplayFleet() = default;

ReplaySubmap ReplayFleet::Next() {
  ReplaySubmap submap = agents_[next_agent_]->Next();
  next_agent_ = (next_agent_ + 1) % agents_.size();
  return submap;
}

}  // namespace portolan
