#include "server/alignment/map_relaxation.h"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>
#include <limits>
#include <map>

#include "common/base/thread_priority.h"
#include "server/alignment/block_system.h"
#include "server/alignment/relaxation_elements.h"
#include "server/alignment/relaxation_map.h"
#include "server/alignment/relaxation_positions.h"

namespace portolan {
namespace {

// Squared error, in sigmas, of an observation whose point no longer projects.
constexpr double kUnprojectableChi2 = 800.0;
constexpr int kMaxAttempts = 5;           // to find a step that lowers the cost
constexpr int kInterruptInterval = 1024;  // landmarks
constexpr size_t kLossSamples = 10000;    // landmarks whose errors are looked at beforehand
constexpr auto kInterruptCheckInterval = std::chrono::milliseconds(2);

}  // namespace

class MapRelaxation::Impl {
 public:
  Impl(const MapRelaxationOptions& options, const MetricFrameOptions& metric,
       const std::vector<SubmapId>& submaps, const MapModel& model,
       const std::vector<PositionTerm>* positions)
      : options_(options),
        max_landmarks_(submaps.size() > static_cast<size_t>(options.max_whole_submaps)
                           ? static_cast<size_t>(options.max_landmarks)
                           : std::numeric_limits<size_t>::max()),
        map_(model, submaps),
        bodies_(map_.bodies()) {
    if (positions != nullptr) {
      for (const PositionTerm& term : *positions) {
        positions_.Add(map_.BodyOf(term.submap), bodies_[map_.BodyOf(term.submap)], term);
      }
    }
    for (const auto& [id, measurement] : MeasureScales(metric, model, submaps)) {
      scales_.emplace(map_.BodyOf(id), measurement);
    }
    step_moved_.resize(bodies_.size());
    if (bodies_.size() < 2) phase_ = Phase::kDone;
  }

  bool Run(const MapModel& model, const std::atomic<bool>* interrupt) {
    interrupt_ = interrupt;
    summary_.interrupted = false;
    while (phase_ != Phase::kDone && !Interrupted()) {
      switch (phase_) {
        case Phase::kCollect:
          if (map_.AddSomePoints(model, max_landmarks_)) phase_ = Phase::kLinearize;
          break;
        case Phase::kLinearize:
          Linearize();
          break;
        case Phase::kSolve:
          Solve();
          break;
        case Phase::kTry:
          Try();
          break;
        case Phase::kDone:
          break;
      }
    }
    return phase_ == Phase::kDone;
  }

  const RelaxationSummary& summary() const { return summary_; }
  const RelaxationMap& map() const { return map_; }

 private:
  // After the first, of one step. They go through the landmarks, or wait for the solution, and may
  // be interrupted on the way.
  enum class Phase { kCollect, kLinearize, kSolve, kTry, kDone };

  bool Interrupted() {
    if (interrupt_ != nullptr && *interrupt_) summary_.interrupted = true;
    return summary_.interrupted;
  }

  // Calls function(body, sight), always in the same order.
  template <typename Function>
  void ForEachSight(const RelaxationPoint& point, const Function& function) const {
    for (size_t i = point.begin; i < point.end; ++i) {
      function(bodies_[map_.sights()[i].body], map_.sights()[i]);
    }
  }

  double RobustCost(double chi2) const {
    if (!std::isfinite(loss_square_)) return 0.5 * chi2;
    return 0.5 * loss_square_ * std::log1p(chi2 / loss_square_);
  }

  // A map that is far off is not one of outliers: the loss starts at the errors that there are.
  void ChooseLoss() {
    std::vector<double> errors;
    LinearLandmark linear;
    const size_t stride = map_.points().size() / kLossSamples + 1;
    loss_square_ = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < map_.points().size(); i += stride) {
      LinearizeLandmark(map_.points()[i], &linear);
      errors.insert(errors.end(), linear.chi2.begin(), linear.chi2.end());
    }
    double median = 0;
    if (!errors.empty()) {
      const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
      std::nth_element(errors.begin(), middle, errors.end());
      median = *middle;
    }
    loss_square_ = std::max(options_.loss_scale_sigmas * options_.loss_scale_sigmas, 9 * median);
  }

  // Fills normal equations in which the landmarks are eliminated, and finds the cost.
  void Linearize() {
    if (next_point_ == 0) {
      ChooseLoss();
      positions_.ChooseLoss(options_.positions);
      system_.Reset(map_.node_count());
      cost_ = ScaleCost(Eigen::VectorXd()) + positions_.Cost();
    }
    LinearLandmark linear;
    for (; next_point_ < map_.points().size(); ++next_point_) {
      if (next_point_ % kInterruptInterval == 0 && Interrupted()) return;
      LinearizeLandmark(map_.points()[next_point_], &linear);
      cost_ += linear.cost;
      if (!linear.views.empty()) Eliminate(map_.points()[next_point_], linear);
    }
    AddScales();
    if (!positions_.empty()) {
      positions_.AddTo(bodies_, &system_);
    } else {
      Matrix7d& first = system_.Block(0, 0);
      for (int i = 0; i < (scales_.empty() ? 7 : 6); ++i) first(i, i) = 2 * first(i, i) + 1;
    }
    if (summary_.iterations == 0) summary_.initial_cost = cost_;
    summary_.final_cost = cost_;
    attempt_ = 0;
    phase_ = Phase::kSolve;
  }

  void LinearizeLandmark(const RelaxationPoint& landmark, LinearLandmark* linear) const {
    const Eigen::Vector3d& point = landmark.in_world;
    double nearest = std::numeric_limits<double>::infinity();
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    linear->views.clear();
    linear->used.clear();
    linear->chi2.clear();
    linear->gradient.setZero();
    linear->cost = 0;
    ForEachSight(landmark, [&](const RelaxationBody& body, const RelaxationSight& sight) {
      linear->used.push_back(false);
      const Rigid3& world_from_camera = body.world_from_camera[sight.keyframe];
      const Eigen::Vector3d from_camera = point - world_from_camera.translation;
      const Eigen::Matrix3d camera_from_world =
          world_from_camera.rotation.conjugate().toRotationMatrix();
      Matrix23d jacobian;
      const auto pixel = body.camera->Project(camera_from_world * from_camera, &jacobian);
      if (!pixel) return;
      const double inverse_sigma = 1.0 / sight.sigma_px;
      const Eigen::Vector2d error = (*pixel - sight.pixel.cast<double>()) * inverse_sigma;
      const double chi2 = error.squaredNorm();
      if (!sight.inlier && chi2 > options_.readmitting_chi2) return;
      linear->used.back() = true;
      linear->cost += RobustCost(chi2);
      linear->chi2.push_back(chi2);
      nearest = std::min(nearest, from_camera.norm());
      jacobian = (inverse_sigma * jacobian * camera_from_world).eval();
      const double weight = 1.0 / (1.0 + chi2 / loss_square_);
      const Eigen::Matrix3d product = weight * jacobian.transpose() * jacobian;
      const Eigen::Vector3d gradient = weight * jacobian.transpose() * error;
      if (linear->views.empty() || linear->views.back().body != sight.body) {
        linear->views.emplace_back(sight.body);
      }
      RelaxationView& view = linear->views.back();
      const double end = body.PartOf(sight.keyframe);
      const double start = 1 - end;
      view.cross[0] += start * product;
      view.cross[1] += end * product;
      view.start_start += start * start * product;
      view.start_end += start * end * product;
      view.end_end += end * end * product;
      view.gradient[0] += start * gradient;
      view.gradient[1] += end * gradient;
      linear->gradient += gradient;
      information += product;
    });
    const double sigma = options_.distance_prior_relative * nearest;
    information.diagonal().array() += 1.0 / std::max(sigma * sigma, 1e-18);
    linear->inverse_information = information.inverse();
  }

  // Adds the landmark's Schur complement.
  void Eliminate(const RelaxationPoint& landmark, const LinearLandmark& linear) {
    struct Part {
      int node;
      Matrix37d cross;
    };
    std::vector<Part> parts;
    const Eigen::Vector3d step = linear.inverse_information * linear.gradient;
    for (const RelaxationView& view : linear.views) {
      const RelaxationBody& body = bodies_[view.body];
      const auto jacobians = PointJacobians(body, landmark.in_world);
      for (int end = 0; end < 2; ++end) {
        parts.push_back({body.nodes[end], view.cross[end] * jacobians[end]});
        system_.gradient().segment<7>(7 * body.nodes[end]) -=
            jacobians[end].transpose() * (view.gradient[end] - view.cross[end] * step);
      }
      system_.Block(body.nodes[0], body.nodes[0]) +=
          jacobians[0].transpose() * view.start_start * jacobians[0];
      system_.Block(body.nodes[1], body.nodes[1]) +=
          jacobians[1].transpose() * view.end_end * jacobians[1];
      const int lower = body.nodes[0] > body.nodes[1] ? 0 : 1;
      system_.Block(body.nodes[lower], body.nodes[1 - lower]) +=
          jacobians[lower].transpose() * view.start_end * jacobians[1 - lower];
    }
    for (const Part& a : parts) {
      const Eigen::Matrix<double, 7, 3> left = a.cross.transpose() * linear.inverse_information;
      for (const Part& b : parts) {
        if (a.node >= b.node) system_.Block(a.node, b.node) -= left * b.cross;
      }
    }
  }

  // A metric submap's scale, the mean of its ends', is off by log_scale.
  void AddScales() {
    for (const auto& [index, scale] : scales_) {
      const double information = 1.0 / (scale.sigma * scale.sigma);
      const double error = MovedScale(index) - scale.log_scale;
      const auto [start, end] = bodies_[index].nodes;
      system_.Block(start, start)(6, 6) += 0.25 * information;
      system_.Block(end, end)(6, 6) += 0.25 * information;
      system_.Block(std::max(start, end), std::min(start, end))(6, 6) += 0.25 * information;
      system_.gradient()[7 * start + 6] += 0.5 * information * error;
      system_.gradient()[7 * end + 6] += 0.5 * information * error;
    }
  }

  double MovedScale(int body) const {
    const auto moved = log_scale_moved_.find(body);
    return moved == log_scale_moved_.end() ? 0.0 : moved->second;
  }

  double ScaleStep(int body) const {
    const auto [start, end] = bodies_[body].nodes;
    return 0.5 * (step_[7 * start + 6] + step_[7 * end + 6]);
  }

  double ScaleCost(const Eigen::VectorXd& step) const {
    double cost = 0;
    for (const auto& [body, scale] : scales_) {
      const double move = MovedScale(body) + (step.size() == 0 ? 0.0 : ScaleStep(body));
      cost += 0.5 * std::pow((move - scale.log_scale) / scale.sigma, 2);
    }
    return cost;
  }

  void Solve() {
    if (!solution_.valid()) {
      if (attempt_++ == kMaxAttempts) {
        phase_ = Phase::kDone;
        return;
      }
      // Seconds in a map of ten thousand submaps. By this thread if the system has none to give.
      solution_ = std::async(std::launch::async | std::launch::deferred, [this] {
        YieldToOtherThreads();
        return system_.Solve(damping_, &step_);
      });
    }
    while (solution_.wait_for(kInterruptCheckInterval) == std::future_status::timeout) {
      if (Interrupted()) return;
    }
    if (!solution_.get()) {
      phase_ = Phase::kDone;
      return;
    }
    UpdateMoved();
    tried_.clear();
    tried_cost_ = ScaleCost(step_) + positions_.CostOfTrial();
    phase_ = Phase::kTry;
  }

  // Finds the cost after the step, and takes the step if it is lower.
  void Try() {
    LinearLandmark linear;
    while (tried_.size() < map_.points().size()) {
      if (tried_.size() % kInterruptInterval == 0 && Interrupted()) return;
      TryPoint(map_.points()[tried_.size()], &linear);
    }
    if (!(tried_cost_ < cost_)) {
      damping_ = std::max(30 * damping_, 1e-5);
      phase_ = Phase::kSolve;
      return;
    }
    damping_ = std::max(0.1 * damping_, 1e-9);
    TakeStep();
    summary_.final_cost = tried_cost_;
    ++summary_.iterations;
    const bool is_final_loss =
        loss_square_ <= options_.loss_scale_sigmas * options_.loss_scale_sigmas;
    const bool has_converged = is_final_loss && cost_ - tried_cost_ < options_.min_decrease * cost_;
    next_point_ = 0;
    phase_ = has_converged || summary_.iterations == options_.max_iterations ? Phase::kDone
                                                                             : Phase::kLinearize;
  }

  Vector7d StepOf(const RelaxationBody& body, double part) const {
    return (1 - part) * step_.segment<7>(7 * body.nodes[0]) +
           part * (body.from_end * step_.segment<7>(7 * body.nodes[1]));
  }

  // How the step moves the world about a part of a body.
  Similarity3 ChangeOf(const RelaxationBody& body, double part) const {
    return body.world_from_submap * Similarity3::Exp(StepOf(body, part)) * body.submap_from_world;
  }

  // ... about every camera.
  void UpdateMoved() {
    for (size_t i = 0; i < bodies_.size(); ++i) {
      const RelaxationBody& body = bodies_[i];
      step_moved_[i].clear();
      for (int k = 0; k <= body.last_keyframe; ++k) {
        step_moved_[i].push_back(ChangeOf(body, body.PartOf(k)));
      }
    }
    positions_.Try([this](int body, double part) { return ChangeOf(bodies_[body], part); });
  }

  Eigen::Vector3d PointAfterStep(const RelaxationPoint& landmark,
                                 const LinearLandmark& linear) const {
    Eigen::Vector3d gradient = linear.gradient;
    for (const RelaxationView& view : linear.views) {
      const RelaxationBody& body = bodies_[view.body];
      const auto jacobians = PointJacobians(body, landmark.in_world);
      for (int end = 0; end < 2; ++end) {
        gradient -= view.cross[end] * (jacobians[end] * step_.segment<7>(7 * body.nodes[end]));
      }
    }
    return landmark.in_world - linear.inverse_information * gradient;
  }

  void TryPoint(const RelaxationPoint& landmark, LinearLandmark* linear) {
    LinearizeLandmark(landmark, linear);
    if (linear->views.empty()) {
      tried_.push_back(landmark.owner < 0
                           ? landmark.in_world
                           : step_moved_[landmark.owner].front() * landmark.in_world);
      return;
    }
    tried_.push_back(PointAfterStep(landmark, *linear));
    const Eigen::Vector3d& point = tried_.back();
    size_t i = 0;
    ForEachSight(landmark, [&](const RelaxationBody& body, const RelaxationSight& sight) {
      if (!linear->used[i++]) return;
      const Rigid3 moved =
          step_moved_[sight.body][sight.keyframe] * body.world_from_camera[sight.keyframe];
      const auto pixel =
          body.camera->Project(moved.rotation.conjugate() * (point - moved.translation));
      tried_cost_ +=
          RobustCost(pixel ? ((*pixel - sight.pixel.cast<double>()) / sight.sigma_px).squaredNorm()
                           : kUnprojectableChi2);
    });
  }

  void TakeStep() {
    positions_.AcceptTrial();
    for (size_t i = 0; i < bodies_.size(); ++i) {
      RelaxationBody& body = bodies_[i];
      body.world_from_submap = step_moved_[i].front() * body.world_from_submap;
      for (size_t k = 0; k < body.world_from_camera.size(); ++k) {
        body.world_from_camera[k] = step_moved_[i][k] * body.world_from_camera[k];
        body.moved[k] = step_moved_[i][k] * body.moved[k];
      }
    }
    for (size_t i = 0; i < tried_.size(); ++i) map_.points()[i].in_world = tried_[i];
    for (const auto& [body, scale] : scales_) log_scale_moved_[body] += ScaleStep(body);
    map_.UpdateFrames();
  }

  const MapRelaxationOptions options_;
  const size_t max_landmarks_;  // of a submap
  RelaxationMap map_;
  std::vector<RelaxationBody>& bodies_;
  const std::atomic<bool>* interrupt_ = nullptr;
  std::map<int, ScaleMeasurement> scales_;  // by body
  std::map<int, double> log_scale_moved_;
  double loss_square_ = 1;  // of the scale of the Cauchy loss
  RelaxationPositions positions_;
  RelaxationSummary summary_;
  // How far it is.
  Phase phase_ = Phase::kCollect;
  double damping_ = 1e-6;
  size_t next_point_ = 0;
  double cost_ = 0;
  int attempt_ = 0;
  BlockSystem system_;
  Eigen::VectorXd step_;
  std::vector<std::vector<Similarity3>> step_moved_;  // the world, by body and keyframe
  std::vector<Eigen::Vector3d> tried_;                // points after the step
  double tried_cost_ = 0;
  // While it is valid its thread alone uses system_, damping_ and step_; the last member, so that
  // it ends before they do.
  std::future<bool> solution_;
};

Status MapRelaxationOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(positions.Validate());
  if (max_iterations < 1 || max_whole_submaps < 1 || max_landmarks < 8 || !(min_decrease >= 0) ||
      !(loss_scale_sigmas > 0) || !(readmitting_chi2 >= 0) || !(distance_prior_relative > 0)) {
    return absl::InvalidArgumentError("map relaxation: limits out of range");
  }
  return absl::OkStatus();
}

MapRelaxation::MapRelaxation(const MapRelaxationOptions& options, const MetricFrameOptions& metric,
                             const std::vector<SubmapId>& submaps, const MapModel& model,
                             const std::vector<PositionTerm>* positions)
    : impl_(std::make_unique<Impl>(options, metric, submaps, model, positions)) {}

MapRelaxation::~MapRelaxation() = default;

bool MapRelaxation::Run(const MapModel& model, const std::atomic<bool>* interrupt) {
  return impl_->Run(model, interrupt);
}

const RelaxationSummary& MapRelaxation::summary() const { return impl_->summary(); }

std::map<SubmapId, Similarity3> MapRelaxation::ApplyTo(MapModel* model) const {
  return impl_->map().ApplyTo(model);
}

RelaxationSummary RelaxSubmaps(const MapRelaxationOptions& options,
                               const MetricFrameOptions& metric,
                               const std::vector<SubmapId>& submaps,
                               const std::atomic<bool>* interrupt, MapModel* model,
                               const std::vector<PositionTerm>* positions) {
  MapRelaxation relaxation(options, metric, submaps, *model, positions);
  relaxation.Run(*model, interrupt);
  if (relaxation.summary().iterations > 0) relaxation.ApplyTo(model);
  return relaxation.summary();
}

}  // namespace portolan
