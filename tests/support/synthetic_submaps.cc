#include "tests/support/synthetic_submaps.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "common/base/check.h"
#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

struct WorldPoint {
  Eigen::Vector3d position;
  Descriptor descriptor;
};

class Mission {
 public:
  explicit Mission(const SyntheticSubmapsOptions& options)
      : options_(options), random_(options.seed) {
    StatusOr<CameraModel> camera = CameraModel::Create(SubmapTestCamera());
    PORTOLAN_CHECK(camera.ok());
    mission_.camera = std::make_shared<const CameraModel>(*std::move(camera));
    MakeWorld();
  }

  SyntheticMission Run() {
    std::vector<std::vector<SyntheticSubmap>> by_agent;
    for (size_t i = 0; i < options_.agents.size(); ++i) by_agent.push_back(MakeAgent(i));
    for (size_t round = 0; true; ++round) {
      bool any = false;
      for (size_t i = 0; i < by_agent.size(); ++i) {
        if (round >= by_agent[i].size()) continue;
        any = true;
        by_agent[i][round].id = SubmapId(static_cast<int64_t>(mission_.submaps.size()) + 1);
        mission_.submaps.push_back(by_agent[i][round]);
        mission_.agent_of_submap.push_back(static_cast<int>(i));
      }
      if (!any) return std::move(mission_);
    }
  }

 private:
  // The state of one agent's tracker and filter.
  struct Agent {
    int index = 0;
    SyntheticAgent plan;
    uint32_t next_track = 1;
    std::map<int, TrackId> live;  // point -> track
    double unit = 1;
  };

  double Normal(double sigma) { return std::normal_distribution<double>(0, 1)(random_) * sigma; }
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Eigen::Vector3d NormalVector(double sigma) {
    const double x = Normal(sigma), y = Normal(sigma), z = Normal(sigma);
    return {x, y, z};
  }

  void MakeWorld() {
    for (int i = 0; i < options_.points; ++i) {
      const double angle = Uniform(-M_PI, M_PI);
      const double radius = Uniform(options_.wall_min_m, options_.wall_max_m);
      const double height = Uniform(-2.5, 2.5);
      WorldPoint point;
      point.position = {radius * std::cos(angle), radius * std::sin(angle), height};
      for (uint64_t& word : point.descriptor.words) word = random_();
      if (options_.identical_descriptors && i % 10 != 0) {
        point.descriptor = world_[i - i % 10].descriptor;
      }
      world_.push_back(point);
    }
  }

  static Rigid3 TruePose(const SyntheticAgent& plan, double angle) {
    Rigid3 pose;
    const double heading = angle + 0.15 * std::sin(5 * angle);
    pose.translation = {plan.circle_m * std::cos(angle), plan.circle_m * std::sin(angle),
                        0.15 * plan.circle_m * std::sin(4 * angle + plan.start_rad)};
    Eigen::Matrix3d axes;  // columns: camera x, y, z in the world
    axes.col(2) = Eigen::Vector3d(std::cos(heading), std::sin(heading), 0.1 * std::sin(3 * angle))
                      .normalized();
    axes.col(0) = axes.col(2).cross(Eigen::Vector3d::UnitZ()).normalized();
    axes.col(1) = axes.col(2).cross(axes.col(0));
    pose.rotation = Eigen::Quaterniond(axes);
    return pose;
  }

  std::vector<SyntheticSubmap> MakeAgent(size_t index) {
    Agent agent;
    agent.index = static_cast<int>(index);
    agent.plan = options_.agents[index];
    agent.unit = options_.metric ? 1.0 : options_.unit * (1 + 0.3 * static_cast<double>(index));
    mission_.points_of_tracks.emplace_back();
    mission_.point_ids_of_tracks.emplace_back();
    std::vector<SyntheticSubmap> submaps;
    Keyframe shared;
    for (int i = 0; i < agent.plan.submaps; ++i) submaps.push_back(MakeSubmap(i, &agent, &shared));
    return submaps;
  }

  double AngleAt(const Agent& agent, int keyframe) const {
    const int steps = agent.plan.submaps * (options_.keyframes_per_submap - 1);
    return agent.plan.start_rad +
           (agent.plan.end_rad - agent.plan.start_rad) * keyframe / std::max(steps, 1);
  }

  SyntheticSubmap MakeSubmap(int number, Agent* agent, Keyframe* shared) {
    SyntheticSubmap result;
    Submap submap;
    submap.key = {AgentId("agent" + std::to_string(agent->index)),
                  SessionId(static_cast<uint64_t>(agent->index) + 100),
                  static_cast<uint32_t>(number)};
    submap.link = number == 0 ? LinkType::kNone : LinkType::kConnected;
    submap.metric = options_.metric;
    if (number > 0 && !options_.metric) agent->unit *= std::exp(Normal(options_.scale_drift));
    Rigid3 drift;
    for (int k = 0; k < options_.keyframes_per_submap; ++k) {
      const int step = number * (options_.keyframes_per_submap - 1) + k;
      const Rigid3 truth = TruePose(agent->plan, AngleAt(*agent, step));
      result.world_from_camera.push_back(truth);
      if (k == 0) result.world_from_submap = Similarity3::FromRigid(truth, 1.0 / agent->unit);
      Keyframe keyframe = number > 0 && k == 0 ? *shared : Observe(truth, step, agent);
      keyframe.submap_from_camera = FilterPose(result, k, agent->unit, &drift);
      keyframe.covariance = 1e-4 * Matrix6d::Identity();
      submap.keyframes.push_back(keyframe);
      submap.frames.push_back({keyframe.time, keyframe.submap_from_camera});
    }
    *shared = submap.keyframes.back();
    submap.keyframes.back().features.clear();
    for (const int k : {0, options_.keyframes_per_submap / 2}) {
      submap.keyframes[k].features = Describe(submap.keyframes[k], *agent);
    }
    AddLandmarks(result, *agent, &submap);
    result.submap = std::make_shared<const Submap>(std::move(submap));
    return result;
  }

  Rigid3 FilterPose(const SyntheticSubmap& submap, int k, double unit, Rigid3* drift) {
    if (k == 0) return Rigid3::Identity();
    const Rigid3& truth = submap.world_from_camera[k];
    const double step =
        (truth.translation - submap.world_from_camera[k - 1].translation).norm() * unit;
    const Eigen::Vector3d translation = NormalVector(options_.drift_translation_share * step);
    const Eigen::Vector3d rotation = NormalVector(options_.drift_rotation_rad);
    drift->translation += translation;
    drift->rotation = drift->rotation * RotationExp(rotation);
    Rigid3 relative = submap.world_from_camera[0].Inverse() * truth;
    relative.translation *= unit;
    return relative * *drift;
  }

  Keyframe Observe(const Rigid3& world_from_camera, int step, Agent* agent) {
    Keyframe keyframe;
    keyframe.time = FromSeconds(100 + 0.3 * step);
    const Rigid3 camera_from_world = world_from_camera.Inverse();
    std::map<int, Eigen::Vector2d> visible;
    for (size_t i = 0; i < world_.size(); ++i) {
      const auto pixel = mission_.camera->Project(camera_from_world * world_[i].position);
      if (pixel && mission_.camera->IsInImage(*pixel, 2)) visible[static_cast<int>(i)] = *pixel;
    }
    UpdateTracks(visible, agent);
    for (const auto& [point, track] : agent->live) {
      Observation observation;
      observation.track = track;
      Eigen::Vector2d pixel = visible[point];
      pixel.x() += Normal(options_.pixel_sigma);
      pixel.y() += Normal(options_.pixel_sigma);
      if (Uniform(0, 1) < options_.outlier_share) {
        pixel = {Uniform(0, 639), Uniform(0, 479)};
      }
      observation.pixel = pixel.cast<float>();
      observation.sigma_px = static_cast<float>(std::max(options_.pixel_sigma, 0.1));
      keyframe.observations.push_back(observation);
    }
    std::sort(keyframe.observations.begin(), keyframe.observations.end(),
              [](const Observation& a, const Observation& b) { return a.track < b.track; });
    return keyframe;
  }

  // Tracks die with visibility; new ones fill the free places.
  void UpdateTracks(const std::map<int, Eigen::Vector2d>& visible, Agent* agent) {
    std::erase_if(agent->live, [&](const auto& live) { return !visible.contains(live.first); });
    std::vector<int> fresh;
    for (const auto& [point, pixel] : visible) {
      if (!agent->live.contains(point)) fresh.push_back(point);
    }
    std::shuffle(fresh.begin(), fresh.end(), random_);
    for (const int point : fresh) {
      if (static_cast<int>(agent->live.size()) >= options_.max_observations) break;
      const TrackId track(agent->next_track++);
      agent->live[point] = track;
      mission_.points_of_tracks[agent->index][track] = world_[point].position;
      mission_.point_ids_of_tracks[agent->index][track] = point;
    }
  }

  std::vector<Feature> Describe(const Keyframe& keyframe, const Agent& agent) {
    std::vector<Feature> features;
    for (const Observation& observation : keyframe.observations) {
      Feature feature;
      feature.pixel = observation.pixel;
      feature.track = observation.track;
      const int point = mission_.point_ids_of_tracks[agent.index].at(observation.track);
      feature.descriptor = world_[point].descriptor;
      for (int i = 0; i < options_.flipped_bits; ++i) {
        const uint64_t bit = random_() % 256;
        feature.descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
      }
      features.push_back(feature);
    }
    return features;
  }

  // A third of the tracks that live long enough, as a filter would know them.
  void AddLandmarks(const SyntheticSubmap& truth, const Agent& agent, Submap* submap) {
    std::map<TrackId, int> counts;
    for (const Keyframe& keyframe : submap->keyframes) {
      for (const Observation& observation : keyframe.observations) ++counts[observation.track];
    }
    const Similarity3 submap_from_world = truth.world_from_submap.Inverse();
    for (const auto& [track, count] : counts) {
      if (count < 4 || track.value() % 3 != 0) continue;
      SubmapLandmark landmark;
      landmark.track = track;
      const double sigma = 0.02 * agent.unit;
      landmark.point_in_submap =
          submap_from_world * mission_.points_of_tracks[agent.index].at(track) +
          NormalVector(sigma);
      landmark.covariance = sigma * sigma * Eigen::Matrix3d::Identity();
      submap->landmarks.push_back(landmark);
    }
  }

  const SyntheticSubmapsOptions& options_;
  std::mt19937_64 random_;
  std::vector<WorldPoint> world_;
  SyntheticMission mission_;
};

}  // namespace

SyntheticMission MakeSyntheticMission(const SyntheticSubmapsOptions& options) {
  return Mission(options).Run();
}

double AlignedRms(const std::vector<Eigen::Vector3d>& estimate,
                  const std::vector<Eigen::Vector3d>& truth, bool with_scale) {
  PORTOLAN_CHECK(estimate.size() == truth.size() && !truth.empty());
  Eigen::Matrix3Xd a(3, estimate.size()), b(3, truth.size());
  for (size_t i = 0; i < truth.size(); ++i) {
    a.col(i) = estimate[i];
    b.col(i) = truth[i];
  }
  const Eigen::Matrix4d b_from_a = Eigen::umeyama(a, b, with_scale);
  const Eigen::Matrix3Xd aligned =
      (b_from_a.topLeftCorner<3, 3>() * a).colwise() + b_from_a.topRightCorner<3, 1>();
  return std::sqrt((aligned - b).squaredNorm() / static_cast<double>(truth.size()));
}

}  // namespace portolan
