// The start of a map as one least-squares problem over all of its frames, instead of frame by
// frame.
#ifndef PORTOLAN_AGENT_FILTER_START_SMOOTHER_H_
#define PORTOLAN_AGENT_FILTER_START_SMOOTHER_H_

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "agent/filter/filter_state.h"

namespace portolan {

struct StartSmootherOptions {
  bool enabled = true;
  // The start is over when half of the landmarks have at most this relative error of the inverse
  // depth, before and after it is smoothed.
  double known_depth_sigma_ratio = 0.1;
  // Frames before the first look at that, and to the next one if smoothing takes the depths back.
  // With 5 instead of 16 the NEES of the ordinary case is 1.15 instead of 1.07.
  int min_frames = 16;
  // Frames of one solve, even.
  int max_frames = 16;
  // When these do not tell the depths every second frame is left out, so often.
  int max_thinnings = 3;
  // Gauss-Newton steps (damped) from a first guess with the Cauchy cost, and then with the inliers
  // alone.
  int search_iterations = 10;
  int final_iterations = 10;
  double cost_sigmas = 2.4;
  // Relative decrease of the cost under which the steps end.
  double cost_tolerance = 1e-5;
  // Chi-square(2) of an inlier's residual.
  double max_residual_chi2 = 13.8;

  Status Validate() const;
};

// While neither depths nor motion are known, the pixels show their product, and a posterior that is
// made Gaussian in every frame says more than it knows. The smoother keeps all measurements from
// the start on and finds the most likely motion states of all frames and landmarks together; the
// covariance at that point is the inverse of the joint information, linearised once, where the
// parallax of all frames has told both. README.md, "Smoothed start".
//
// Protocol: Begin() with the motion at the start, then AddPoints() after new landmarks and
// AddFrame() after every update, at last Solve() and End(). Thread-compatible.
class StartSmoother {
 public:
  struct Observation {
    TrackId track;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    double variance = 1;  // px^2
  };

  // How a frame was predicted from the one before.
  struct Prediction {
    double scene_depth = 1;   // map units
    double noise_factor = 1;  // on the motion model's noise
  };

  explicit StartSmoother(const StartSmootherOptions& options) : options_(options) {}

  // The motion model's covariance at the start, its pose exactly known. Nothing is recorded if the
  // model cannot be smoothed.
  void Begin(const MotionModel& motion, const Eigen::MatrixXd& covariance);
  // A landmark that was added to the state at its present pose, with its first observation.
  void AddPoint(const Observation& first, double inverse_depth, double depth_sigma);
  // The motion after an update, how it was predicted, and what was seen. True if it is time to
  // Solve.
  bool AddFrame(const MotionModel& motion, const Prediction& prediction,
                std::span<const Observation> observations);
  void End();
  bool active() const { return !frames_.empty(); }
  int frames() const { return static_cast<int>(frames_.size()) - 1; }
  // The last frame has been kept, so that Solve is possible.
  bool at_frame() const { return skipped_ == 0; }

  // Replaces the state's estimate and covariance by the smoothed ones; landmarks without an
  // observation in the frames that were kept are left out. False, and nothing done, if no solution
  // was found.
  bool Solve(const CameraModel& camera, FilterState* state);
  // Leaves out every second frame, to go on when they do not tell the depths. False if that was
  // done often enough.
  bool ThinOut();
  // Poses of the frames that were kept, as last solved.
  std::vector<std::pair<Timestamp, Rigid3>> Poses() const;

 private:
  struct Sight {
    int frame = 0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    double variance = 1;
    bool inlier = true;
  };
  struct Point {
    TrackId track;
    double prior_inverse_depth = 0;
    double prior_sigma = 1;
    std::vector<Sight> sights;  // the first one is the anchor
  };
  struct Frame {
    Timestamp time;
    std::unique_ptr<MotionModel> motion;
    // Of the steps to this frame.
    double scene_depth = 1;
    double noise_factor = 1;  // the largest
  };
  // What a solve moves.
  struct Estimate {
    std::vector<std::unique_ptr<MotionModel>> motions;
    std::vector<Landmark> landmarks;
  };
  struct System {
    Eigen::MatrixXd motion;    // information of the motion states
    Eigen::VectorXd gradient;  // minus half the cost's gradient by them
    Eigen::MatrixXd cross;     // motion by points
    std::vector<Eigen::Matrix3d> points;
    Eigen::VectorXd point_gradient;
    double cost = 0;
    // The points eliminated: cross times their inverses, and what is left of `motion`.
    Eigen::MatrixXd by_points;
    Eigen::MatrixXd reduced;
  };

  int Offset(int frame) const { return frame == 0 ? -6 : motion_dim_ * frame - 6; }
  int motion_unknowns() const { return motion_dim_ * static_cast<int>(frames_.size()) - 6; }
  Estimate Guess(const CameraModel& camera, const FilterState& state) const;
  // The depth-reversed one: near and far exchanged, motion reversed.
  Estimate Reversed(const Estimate& estimate) const;
  Estimate AtRest(const Estimate& estimate) const;
  static Estimate Copy(const Estimate& estimate);
  // Damped Gauss-Newton; returns the cost.
  std::optional<double> Minimise(const CameraModel& camera, int iterations, bool robust,
                                 Estimate* estimate) const;
  void Build(const CameraModel& camera, const Estimate& estimate, bool robust,
             System* system) const;
  void AddMotionTerms(const Estimate& estimate, System* system) const;
  void AddSights(const CameraModel& camera, const Estimate& estimate, int point, bool robust,
                 System* system) const;
  bool Step(double damping, System* system, Estimate* estimate) const;
  // Fills by_points and reduced; returns the inverses of the points' own information.
  static std::vector<Eigen::Matrix3d> Eliminate(double damping, System* system);
  void MarkInliers(const CameraModel& camera, const Estimate& estimate);
  bool WriteTo(const CameraModel& camera, const Estimate& estimate, FilterState* state) const;
  // The state's landmarks that are points here, with their anchors; returns the points.
  std::vector<int> CollectRays(const Estimate& estimate, const FilterState& state,
                               FilterState::RayEstimates* rays) const;
  int NewestPoint(TrackId track) const;

  const StartSmootherOptions options_;
  int motion_dim_ = 0;
  Eigen::MatrixXd start_information_;  // of the motion rest at the start
  std::vector<Frame> frames_;
  std::vector<Point> points_;
  // Every so many frames one is kept; how many were skipped since; times that was doubled.
  int stride_ = 1;
  int skipped_ = 0;
  int thinnings_ = 0;
  double noise_factor_ = 1;  // the largest since the last frame that was kept
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_START_SMOOTHER_H_
