#include "server/alignment/map_relaxation.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <unordered_map>
#include <utility>

#include "server/alignment/block_system.h"
#include "server/alignment/relaxation_elements.h"
#include "server/alignment/relaxation_positions.h"

namespace portolan {
namespace {

// Squared error, in sigmas, of an observation whose point no longer projects.
constexpr double kUnprojectableChi2 = 800.0;
constexpr int kMaxAttempts = 5;           // to find a step that lowers the cost
constexpr int kInterruptInterval = 1024;  // landmarks
constexpr size_t kLossSamples = 10000;    // landmarks whose errors are looked at beforehand

class Relaxation {
 public:
  Relaxation(const MapRelaxationOptions& options, const MetricFrameOptions& metric,
             const std::vector<SubmapId>& submaps, const std::atomic<bool>* interrupt,
             MapModel* model, const std::vector<PositionTerm>* positions)
      : options_(options), interrupt_(interrupt), model_(*model) {
    AddBodies(submaps);
    if (positions != nullptr) {
      for (const PositionTerm& term : *positions) {
        positions_.Add(body_of_.at(term.submap), bodies_[body_of_.at(term.submap)], term);
      }
    }
    for (const auto& [id, measurement] : MeasureScales(metric, model_, submaps)) {
      scales_.emplace(body_of_.at(id), measurement);
    }
    std::vector<char> known(model_.landmarks().size(), 0);
    for (const SubmapId id : submaps) {
      for (const int landmark : model_.submap(id).landmarks) {
        if (std::exchange(known[landmark], 1) == 0) landmarks_.push_back(landmark);
      }
    }
  }

  RelaxationSummary Run() {
    double damping = 1e-6;
    for (int i = 0; i < options_.max_iterations && bodies_.size() > 1; ++i) {
      const std::optional<double> cost = Linearize();
      if (!cost) break;
      if (i == 0) summary_.initial_cost = *cost;
      summary_.final_cost = *cost;
      const std::optional<double> next = Improve(*cost, &damping);
      if (!next) break;
      WriteBack();
      summary_.final_cost = *next;
      ++summary_.iterations;
      const bool is_final_loss =
          loss_square_ <= options_.loss_scale_sigmas * options_.loss_scale_sigmas;
      if (is_final_loss && *cost - *next < options_.min_decrease * *cost) break;
    }
    return summary_;
  }

 private:
  void AddBodies(const std::vector<SubmapId>& submaps) {
    for (const SubmapId id : submaps) body_of_.emplace(id, static_cast<int>(body_of_.size()));
    node_count_ = static_cast<int>(submaps.size());
    for (const SubmapId id : submaps) {
      const ModelSubmap& submap = model_.submap(id);
      const auto successor = submap.successor ? body_of_.find(*submap.successor) : body_of_.end();
      const int start = static_cast<int>(bodies_.size());
      RelaxationBody body;
      body.id = id;
      body.nodes = {start, successor == body_of_.end() ? node_count_++ : successor->second};
      body.last_keyframe = static_cast<int>(submap.world_from_camera.size()) - 1;
      bodies_.push_back(body);
    }
    changes_.resize(bodies_.size());
    UpdateFrames();
  }

  void UpdateFrames() {
    for (RelaxationBody& body : bodies_) {
      body.world_from_submap = model_.submap(body.id).world_from_submap;
      body.submap_from_world = body.world_from_submap.Inverse();
    }
    for (RelaxationBody& body : bodies_) {
      if (body.nodes[1] >= static_cast<int>(bodies_.size())) continue;
      body.from_end = (body.submap_from_world * bodies_[body.nodes[1]].world_from_submap).Adjoint();
    }
  }

  bool Interrupted() {
    if (interrupt_ != nullptr && *interrupt_) summary_.interrupted = true;
    return summary_.interrupted;
  }

  // Calls function(body, keyframe, sight, observation), always in the same order.
  template <typename Function>
  void ForEachSight(const ModelLandmark& landmark, const Function& function) const {
    for (const LandmarkSight& sight : landmark.sights) {
      const auto body = body_of_.find(sight.submap);
      if (body == body_of_.end()) continue;
      const ModelSubmap& submap = model_.submap(sight.submap);
      const int in_submap = MapModel::LandmarkIndex(*submap.refined, sight.track);
      for (const ModelSight& one : submap.sights[in_submap]) {
        function(body->second, submap, one,
                 submap.refined->raw->keyframes[one.keyframe].observations[one.observation]);
      }
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
    const size_t stride = landmarks_.size() / kLossSamples + 1;
    loss_square_ = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < landmarks_.size(); i += stride) {
      LinearizeLandmark(model_.landmarks()[landmarks_[i]], &linear);
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

  // Fills normal equations in which the landmarks are eliminated; returns the cost.
  std::optional<double> Linearize() {
    ChooseLoss();
    positions_.ChooseLoss(options_.positions);
    system_.Reset(node_count_);
    double cost = ScaleCost(Eigen::VectorXd()) + positions_.Cost();
    LinearLandmark linear;
    int count = 0;
    for (const int landmark : landmarks_) {
      if (++count % kInterruptInterval == 0 && Interrupted()) return std::nullopt;
      LinearizeLandmark(model_.landmarks()[landmark], &linear);
      cost += linear.cost;
      if (!linear.views.empty()) Eliminate(model_.landmarks()[landmark], linear);
    }
    AddScales();
    if (!positions_.empty()) {
      positions_.AddTo(bodies_, &system_);
      return cost;
    }
    Matrix7d& first = system_.Block(0, 0);
    for (int i = 0; i < (scales_.empty() ? 7 : 6); ++i) first(i, i) = 2 * first(i, i) + 1;
    return cost;
  }

  void LinearizeLandmark(const ModelLandmark& landmark, LinearLandmark* linear) const {
    const Eigen::Vector3d& point = landmark.point_in_world;
    double nearest = std::numeric_limits<double>::infinity();
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    linear->views.clear();
    linear->used.clear();
    linear->chi2.clear();
    linear->gradient.setZero();
    linear->cost = 0;
    ForEachSight(landmark, [&](int body, const ModelSubmap& submap, const ModelSight& sight,
                               const Observation& observation) {
      linear->used.push_back(false);
      const Rigid3& world_from_camera = submap.world_from_camera[sight.keyframe];
      const Eigen::Vector3d from_camera = point - world_from_camera.translation;
      const Eigen::Matrix3d camera_from_world =
          world_from_camera.rotation.conjugate().toRotationMatrix();
      Matrix23d jacobian;
      const auto pixel = submap.camera->Project(camera_from_world * from_camera, &jacobian);
      if (!pixel) return;
      const double inverse_sigma = 1.0 / observation.sigma_px;
      const Eigen::Vector2d error = (*pixel - observation.pixel.cast<double>()) * inverse_sigma;
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
      if (linear->views.empty() || linear->views.back().body != body) {
        linear->views.emplace_back(body);
      }
      RelaxationView& view = linear->views.back();
      const double end = bodies_[body].PartOf(sight.keyframe);
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
  void Eliminate(const ModelLandmark& landmark, const LinearLandmark& linear) {
    struct Part {
      int node;
      Matrix37d cross;
    };
    std::vector<Part> parts;
    const Eigen::Vector3d step = linear.inverse_information * linear.gradient;
    for (const RelaxationView& view : linear.views) {
      const RelaxationBody& body = bodies_[view.body];
      const auto jacobians = PointJacobians(body, landmark.point_in_world);
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

  std::optional<double> Improve(double cost, double* damping) {
    for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
      if (Interrupted() || !system_.Solve(*damping, &step_)) return std::nullopt;
      const std::optional<double> next = CostAfterStep();
      if (!next) return std::nullopt;
      if (*next < cost) {
        *damping = std::max(0.1 * *damping, 1e-9);
        return next;
      }
      *damping = std::max(30 * *damping, 1e-5);
    }
    return std::nullopt;
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
  void UpdateChanges() {
    for (size_t i = 0; i < bodies_.size(); ++i) {
      const RelaxationBody& body = bodies_[i];
      changes_[i].clear();
      for (int k = 0; k <= body.last_keyframe; ++k) {
        changes_[i].push_back(ChangeOf(body, body.PartOf(k)));
      }
    }
    positions_.Try([this](int body, double part) { return ChangeOf(bodies_[body], part); });
  }

  Eigen::Vector3d PointAfterStep(const ModelLandmark& landmark,
                                 const LinearLandmark& linear) const {
    Eigen::Vector3d gradient = linear.gradient;
    for (const RelaxationView& view : linear.views) {
      const RelaxationBody& body = bodies_[view.body];
      const auto jacobians = PointJacobians(body, landmark.point_in_world);
      for (int end = 0; end < 2; ++end) {
        gradient -= view.cross[end] * (jacobians[end] * step_.segment<7>(7 * body.nodes[end]));
      }
    }
    return landmark.point_in_world - linear.inverse_information * gradient;
  }

  std::optional<double> CostAfterStep() {
    UpdateChanges();
    points_.clear();
    double cost = ScaleCost(step_) + positions_.CostOfTrial();
    LinearLandmark linear;
    for (const int index : landmarks_) {
      if (points_.size() % kInterruptInterval == 0 && Interrupted()) return std::nullopt;
      const ModelLandmark& landmark = model_.landmarks()[index];
      LinearizeLandmark(landmark, &linear);
      if (linear.views.empty()) {
        const auto owner = body_of_.find(landmark.sights.front().submap);
        points_.push_back(owner == body_of_.end()
                              ? landmark.point_in_world
                              : changes_[owner->second].front() * landmark.point_in_world);
        continue;
      }
      points_.push_back(PointAfterStep(landmark, linear));
      const Eigen::Vector3d& point = points_.back();
      size_t i = 0;
      ForEachSight(landmark, [&](int body, const ModelSubmap& submap, const ModelSight& sight,
                                 const Observation& observation) {
        if (!linear.used[i++]) return;
        const Rigid3 moved =
            changes_[body][sight.keyframe] * submap.world_from_camera[sight.keyframe];
        const auto pixel =
            submap.camera->Project(moved.rotation.conjugate() * (point - moved.translation));
        cost += RobustCost(
            pixel
                ? ((*pixel - observation.pixel.cast<double>()) / observation.sigma_px).squaredNorm()
                : kUnprojectableChi2);
      });
    }
    return cost;
  }

  void WriteBack() {
    positions_.AcceptTrial();
    std::vector<std::vector<Rigid3>> cameras;
    for (size_t i = 0; i < bodies_.size(); ++i) {
      cameras.push_back(model_.submap(bodies_[i].id).world_from_camera);
      for (size_t k = 0; k < cameras[i].size(); ++k) cameras[i][k] = changes_[i][k] * cameras[i][k];
    }
    for (size_t i = 0; i < bodies_.size(); ++i) {
      model_.MoveSubmap(bodies_[i].id, changes_[i].front() * bodies_[i].world_from_submap);
    }
    for (size_t i = 0; i < bodies_.size(); ++i) {
      for (size_t k = 0; k < cameras[i].size(); ++k) {
        const auto [id, keyframe] = model_.CameraOf(bodies_[i].id, static_cast<int>(k));
        if (id == bodies_[i].id) model_.SetCamera(id, keyframe, cameras[i][k]);
      }
    }
    for (size_t i = 0; i < landmarks_.size(); ++i) model_.SetLandmark(landmarks_[i], points_[i]);
    for (const auto& [body, scale] : scales_) log_scale_moved_[body] += ScaleStep(body);
    for (const RelaxationBody& body : bodies_) model_.FitSubmapToCameras(body.id);
    UpdateFrames();
  }

  const MapRelaxationOptions& options_;
  const std::atomic<bool>* interrupt_;
  MapModel& model_;
  std::unordered_map<SubmapId, int> body_of_;
  std::vector<RelaxationBody> bodies_;
  int node_count_ = 0;                      // starts by body, then the ends of sessions
  std::map<int, ScaleMeasurement> scales_;  // by body
  std::map<int, double> log_scale_moved_;
  std::vector<int> landmarks_;  // in the model
  double loss_square_ = 1;      // of the scale of the Cauchy loss
  RelaxationPositions positions_;
  BlockSystem system_;
  Eigen::VectorXd step_;
  std::vector<std::vector<Similarity3>> changes_;  // of the world, by body and keyframe
  std::vector<Eigen::Vector3d> points_;            // after the step
  RelaxationSummary summary_;
};

}  // namespace

Status MapRelaxationOptions::Validate() const {
  PORTOLAN_RETURN_IF_ERROR(positions.Validate());
  if (max_iterations < 1 || !(min_decrease >= 0) || !(loss_scale_sigmas > 0) ||
      !(readmitting_chi2 >= 0) || !(distance_prior_relative > 0)) {
    return absl::InvalidArgumentError("map relaxation: limits out of range");
  }
  return absl::OkStatus();
}

RelaxationSummary RelaxSubmaps(const MapRelaxationOptions& options,
                               const MetricFrameOptions& metric,
                               const std::vector<SubmapId>& submaps,
                               const std::atomic<bool>* interrupt, MapModel* model,
                               const std::vector<PositionTerm>* positions) {
  return Relaxation(options, metric, submaps, interrupt, model, positions).Run();
}

}  // namespace portolan
