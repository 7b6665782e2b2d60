// Errors of estimated trajectories against reference ones: ATE after one least-squares alignment,
// RPE (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, Sec. IV),
// segment errors as in the KITTI odometry benchmark (Geiger et al., CVPR 2012), coverage, scale.
// Several agents are evaluated under ONE joint alignment, and each alone.
#ifndef PORTOLAN_COMMON_TRAJECTORY_EVALUATION_H_
#define PORTOLAN_COMMON_TRAJECTORY_EVALUATION_H_

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/trajectory/alignment.h"
#include "common/trajectory/trajectory.h"

namespace portolan {

// Of `count` numbers; all zero when there are none.
struct ErrorStatistics {
  size_t count = 0;
  double rmse = 0, mean = 0, median = 0, min = 0, max = 0;
  double standard_deviation = 0;
};
ErrorStatistics ComputeStatistics(std::vector<double> errors);

// One agent's estimate and the reference it is held against. Both are borrowed and must outlive
// the call. Agents that point to the same reference share its stamps in the joint coverage.
struct TrajectoryPair {
  std::string name;
  const Trajectory* estimate = nullptr;
  const Trajectory* reference = nullptr;
};

struct EvaluationOptions {
  AlignmentMode alignment = AlignmentMode::kSim3;
  // Largest difference of the times of an estimated and a reference pose that are compared, and
  // the tolerance of the coverage: under half a frame at 20 Hz.
  Duration max_time_difference = std::chrono::milliseconds(20);
  // Relative errors are taken over this path length and this time.
  double rpe_distance_m = 1.0;
  double rpe_time_s = 1.0;

  Status Validate() const;
};

// Relative errors per unit of the interval: m/m and rad/m, or m/s and rad/s.
struct RelativeError {
  ErrorStatistics translation;
  ErrorStatistics rotation_rad;
};

// Means over all segments of 100, 200, ..., 800 m of the reference path.
struct SegmentError {
  size_t segments = 0;
  double translation_percent = 0;
  double rotation_deg_per_m = 0;
};

struct PoseError {
  Timestamp time{};
  Eigen::Vector3d estimate_in_reference = Eigen::Vector3d::Zero();
  Eigen::Vector3d reference = Eigen::Vector3d::Zero();
  double error_m = 0;
  double rotation_error_rad = 0;
};

// Errors of one agent, or of all together, under one alignment.
struct AlignedErrors {
  std::string name;
  Similarity3 reference_from_estimate;
  size_t estimate_poses = 0;
  // Share of reference stamps with an estimate within max_time_difference.
  double coverage = 0;
  // Path of the reference over the matched poses' time span, summed over the agents.
  double reference_path_m = 0;
  ErrorStatistics ate_m;
  ErrorStatistics rotation_rad;
  // Length of the estimate over the truth minus 1, from a Sim(3) alignment whatever the mode: the
  // scale error of a metric map. No value when fewer than 3 poses matched.
  std::optional<double> scale_error;
  RelativeError rpe_per_m;
  RelativeError rpe_per_s;
  SegmentError kitti;
  std::vector<PoseError> poses;  // matched ones, ascending in time within an agent
};

struct TrajectoryEvaluation {
  EvaluationOptions options;
  AlignedErrors joint;                         // all agents, one alignment
  std::vector<AlignedErrors> agents_in_joint;  // each agent under that alignment
  // Each agent under its own alignment; no value where it has too few matched poses.
  std::vector<std::optional<AlignedErrors>> agents_alone;
};

// InvalidArgument if there is no agent or an option is invalid; FailedPrecondition if too few
// poses match in time for the alignment. An agent without a match counts with coverage 0.
StatusOr<TrajectoryEvaluation> EvaluateTrajectories(std::span<const TrajectoryPair> agents,
                                                    const EvaluationOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_TRAJECTORY_EVALUATION_H_
