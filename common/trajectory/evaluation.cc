#include "common/trajectory/evaluation.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "common/trajectory/relative_error.h"

namespace portolan {
namespace {

constexpr double kDegreesPerRadian = 180.0 / M_PI;

// What is compared of one agent.
struct AgentMatches {
  const TrajectoryPair* agent = nullptr;
  std::vector<IndexPair> pairs;
  std::vector<bool> covered;             // a reference stamp
  std::vector<double> reference_path_m;  // to each reference pose

  const Rigid3& Estimate(size_t i) const {
    return (*agent->estimate)[pairs[i].estimate].world_from_body;
  }
  const Rigid3& Reference(size_t i) const {
    return (*agent->reference)[pairs[i].reference].world_from_body;
  }
};

AgentMatches Match(const TrajectoryPair& agent, Duration max_difference) {
  AgentMatches matches;
  matches.agent = &agent;
  matches.pairs = AssociateByTime(*agent.estimate, *agent.reference, max_difference);
  matches.reference_path_m = CumulativePathLength(*agent.reference);
  matches.covered.reserve(agent.reference->size());
  size_t next = 0;  // the first estimate not earlier than the stamp's tolerance
  for (const StampedPose& reference : *agent.reference) {
    const Trajectory& estimate = *agent.estimate;
    while (next < estimate.size() && estimate[next].time < reference.time - max_difference) ++next;
    matches.covered.push_back(next < estimate.size() &&
                              estimate[next].time <= reference.time + max_difference);
  }
  return matches;
}

struct PointPairs {
  std::vector<Eigen::Vector3d> estimate;
  std::vector<Eigen::Vector3d> reference;
};

PointPairs CollectPoints(std::span<const AgentMatches> agents) {
  PointPairs points;
  for (const AgentMatches& matches : agents) {
    for (size_t i = 0; i < matches.pairs.size(); ++i) {
      points.estimate.push_back(matches.Estimate(i).translation);
      points.reference.push_back(matches.Reference(i).translation);
    }
  }
  return points;
}

// Agents that share a reference count each of its stamps once.
double Coverage(std::span<const AgentMatches> agents) {
  std::map<const Trajectory*, std::vector<bool>> covered;
  for (const AgentMatches& matches : agents) {
    std::vector<bool>& stamps = covered[matches.agent->reference];
    stamps.resize(matches.covered.size(), false);
    for (size_t i = 0; i < stamps.size(); ++i) stamps[i] = stamps[i] || matches.covered[i];
  }
  double stamp_count = 0;
  double covered_count = 0;
  for (const auto& [reference, stamps] : covered) {
    stamp_count += static_cast<double>(stamps.size());
    covered_count += static_cast<double>(std::count(stamps.begin(), stamps.end(), true));
  }
  return stamp_count > 0 ? covered_count / stamp_count : 0.0;
}

std::vector<MatchedPose> AlignedPoses(const AgentMatches& matches,
                                      const Similarity3& reference_from_estimate) {
  std::vector<MatchedPose> poses;
  poses.reserve(matches.pairs.size());
  for (size_t i = 0; i < matches.pairs.size(); ++i) {
    const size_t reference = matches.pairs[i].reference;
    poses.push_back({(*matches.agent->reference)[reference].time,
                     reference_from_estimate * matches.Estimate(i), matches.Reference(i),
                     matches.reference_path_m[reference]});
  }
  return poses;
}

void Append(const RelativeRates& from, RelativeRates* to) {
  to->translation.insert(to->translation.end(), from.translation.begin(), from.translation.end());
  to->rotation_rad.insert(to->rotation_rad.end(), from.rotation_rad.begin(),
                          from.rotation_rad.end());
}

RelativeError Summarise(RelativeRates rates) {
  return {ComputeStatistics(std::move(rates.translation)),
          ComputeStatistics(std::move(rates.rotation_rad))};
}

SegmentError SummariseSegments(RelativeRates rates) {
  const RelativeError error = Summarise(std::move(rates));
  return {error.translation.count, 100.0 * error.translation.mean,
          kDegreesPerRadian * error.rotation_rad.mean};
}

std::optional<double> ScaleError(const PointPairs& points) {
  const std::optional<Similarity3> alignment =
      AlignPoints(points.estimate, points.reference, AlignmentMode::kSim3);
  if (!alignment || !(alignment->scale > 0)) return std::nullopt;
  return 1.0 / alignment->scale - 1.0;
}

void AppendPoseErrors(std::span<const MatchedPose> poses, std::vector<PoseError>* errors) {
  for (const MatchedPose& pose : poses) {
    const Eigen::Vector3d& estimate = pose.estimate.translation;
    const Eigen::Vector3d& reference = pose.reference.translation;
    const Eigen::Quaterniond turn = pose.reference.rotation.conjugate() * pose.estimate.rotation;
    errors->push_back(
        {pose.time, estimate, reference, (estimate - reference).norm(), RotationLog(turn).norm()});
  }
}

AlignedErrors ErrorsUnder(const std::string& name, std::span<const AgentMatches> agents,
                          const Similarity3& reference_from_estimate,
                          const EvaluationOptions& options) {
  AlignedErrors errors;
  errors.name = name;
  errors.reference_from_estimate = reference_from_estimate;
  errors.coverage = Coverage(agents);
  errors.scale_error = ScaleError(CollectPoints(agents));
  RelativeRates per_m, per_s, kitti;
  for (const AgentMatches& matches : agents) {
    const std::vector<MatchedPose> poses = AlignedPoses(matches, reference_from_estimate);
    errors.estimate_poses += matches.agent->estimate->size();
    if (!poses.empty()) errors.reference_path_m += poses.back().path_m - poses.front().path_m;
    AppendPoseErrors(poses, &errors.poses);
    Append(RatesPerMetre(poses, options.rpe_distance_m), &per_m);
    Append(RatesPerSecond(poses, options.rpe_time_s), &per_s);
    Append(KittiSegments(poses), &kitti);
  }
  std::vector<double> distances, angles;
  for (const PoseError& pose : errors.poses) {
    distances.push_back(pose.error_m);
    angles.push_back(pose.rotation_error_rad);
  }
  errors.ate_m = ComputeStatistics(std::move(distances));
  errors.rotation_rad = ComputeStatistics(std::move(angles));
  errors.rpe_per_m = Summarise(std::move(per_m));
  errors.rpe_per_s = Summarise(std::move(per_s));
  errors.kitti = SummariseSegments(std::move(kitti));
  return errors;
}

}  // namespace

ErrorStatistics ComputeStatistics(std::vector<double> errors) {
  ErrorStatistics statistics;
  if (errors.empty()) return statistics;
  std::sort(errors.begin(), errors.end());
  const size_t size = errors.size();
  const double count = static_cast<double>(size);
  statistics.count = size;
  statistics.min = errors.front();
  statistics.max = errors.back();
  statistics.median = 0.5 * (errors[(size - 1) / 2] + errors[size / 2]);
  statistics.mean = std::accumulate(errors.begin(), errors.end(), 0.0) / count;
  const double square_sum = std::inner_product(errors.begin(), errors.end(), errors.begin(), 0.0);
  statistics.rmse = std::sqrt(square_sum / count);
  double deviation_sum = 0;
  for (const double error : errors) deviation_sum += std::pow(error - statistics.mean, 2);
  statistics.standard_deviation = std::sqrt(deviation_sum / count);
  return statistics;
}

Status EvaluationOptions::Validate() const {
  if (max_time_difference <= Duration::zero()) {
    return absl::InvalidArgumentError("max_time_difference must be positive");
  }
  if (!(rpe_distance_m > 0) || !(rpe_time_s > 0)) {
    return absl::InvalidArgumentError("rpe_distance_m and rpe_time_s must be positive");
  }
  return absl::OkStatus();
}

StatusOr<TrajectoryEvaluation> EvaluateTrajectories(std::span<const TrajectoryPair> agents,
                                                    const EvaluationOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  if (agents.empty()) return absl::InvalidArgumentError("no trajectory to evaluate");
  std::vector<AgentMatches> matches;
  for (const TrajectoryPair& agent : agents) {
    matches.push_back(Match(agent, options.max_time_difference));
  }
  const PointPairs points = CollectPoints(matches);
  const std::optional<Similarity3> joint =
      AlignPoints(points.estimate, points.reference, options.alignment);
  if (!joint || points.estimate.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("only ", points.estimate.size(), " poses match in time within ",
                     ToSeconds(options.max_time_difference), " s (or all at one place): no ",
                     AlignmentModeName(options.alignment), " alignment"));
  }
  TrajectoryEvaluation evaluation;
  evaluation.options = options;
  evaluation.joint = ErrorsUnder("all agents", matches, *joint, options);
  for (const AgentMatches& agent : matches) {
    const std::span<const AgentMatches> one(&agent, 1);
    evaluation.agents_in_joint.push_back(ErrorsUnder(agent.agent->name, one, *joint, options));
    const PointPairs own = CollectPoints(one);
    const std::optional<Similarity3> alone =
        AlignPoints(own.estimate, own.reference, options.alignment);
    evaluation.agents_alone.push_back(
        alone && !own.estimate.empty()
            ? std::make_optional(ErrorsUnder(agent.agent->name, one, *alone, options))
            : std::nullopt);
  }
  return evaluation;
}

}  // namespace portolan
