#include "server/alignment/metric_frame.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace portolan {
namespace {

constexpr size_t kMinLandmarks = 6;
constexpr int kRobustIterations = 10;

double Square(double x) { return x * x; }

double Quantile(std::vector<double> values, double share) {
  const auto at = values.begin() + static_cast<long>(share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double WeightedMedian(std::vector<ScaleMeasurement> measurements) {
  std::sort(measurements.begin(), measurements.end(),
            [](const auto& a, const auto& b) { return a.log_scale < b.log_scale; });
  double half = 0;
  for (const ScaleMeasurement& m : measurements) half += 0.5 / Square(m.sigma);
  for (const ScaleMeasurement& m : measurements) {
    half -= 1 / Square(m.sigma);
    if (half <= 0) return m.log_scale;
  }
  return measurements.back().log_scale;
}

std::optional<double> MeanLogScale(const MetricFrameOptions& options, const MapModel& model,
                                   const std::vector<SubmapId>& submaps) {
  std::vector<ScaleMeasurement> measurements;
  for (const auto& [id, measurement] : MeasureScales(options, model, submaps)) {
    measurements.push_back(measurement);
  }
  if (measurements.empty()) return std::nullopt;
  double mean = WeightedMedian(measurements);
  for (int i = 0; i < kRobustIterations; ++i) {
    double sum = 0, information = 0;
    for (const ScaleMeasurement& m : measurements) {
      const double error = (m.log_scale - mean) / (options.outlier_sigmas * m.sigma);
      const double weight = 1 / (Square(m.sigma) * (1 + error * error));
      sum += weight * m.log_scale;
      information += weight;
    }
    mean = sum / information;
  }
  return mean;
}

// Downwards in the world, as the submaps that know it say on average.
std::optional<Eigen::Vector3d> MeanGravity(const MapModel& model,
                                           const std::vector<SubmapId>& submaps) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const SubmapId id : submaps) {
    const ModelSubmap& submap = model.submap(id);
    const auto& gravity = submap.refined->raw->gravity_in_submap;
    if (gravity && !submap.quarantined()) sum += submap.world_from_submap.rotation * *gravity;
  }
  if (!(sum.norm() > 0.1)) return std::nullopt;
  return sum.normalized();
}

}  // namespace

Status MetricFrameOptions::Validate() const {
  if (!(min_log_scale_sigma > 0) || correlated_submaps < 1 || !(outlier_sigmas > 0) ||
      !(min_log_scale_step >= 0) || !(min_rotation_step_rad >= 0)) {
    return absl::InvalidArgumentError("metric frame: limits out of range");
  }
  return absl::OkStatus();
}

std::optional<ScaleMeasurement> MeasureScale(const MetricFrameOptions& options,
                                             const MapModel& model, SubmapId id) {
  const ModelSubmap& submap = model.submap(id);
  if (!submap.refined->raw->metric || submap.quarantined()) return std::nullopt;
  const Eigen::Vector3d origin = submap.world_from_camera.front().translation;
  std::vector<double> ratios, sigmas;
  for (const SubmapLandmark& filter : submap.refined->raw->landmarks) {
    const int index = MapModel::LandmarkIndex(*submap.refined, filter.track);
    if (index < 0) continue;
    const Eigen::Vector3d& point = filter.point_in_submap;
    const ModelLandmark& landmark = model.landmarks()[submap.landmarks[index]];
    const double ratio = std::log(point.norm() / (landmark.point_in_world - origin).norm());
    const double sigma = std::sqrt(point.dot(filter.covariance * point)) / point.squaredNorm();
    if (!std::isfinite(ratio) || !std::isfinite(sigma)) continue;
    ratios.push_back(ratio);
    sigmas.push_back(sigma);
  }
  if (ratios.size() < kMinLandmarks) return std::nullopt;
  // A common scale error is part of every range's; the best known ranges bound it.
  return ScaleMeasurement{Quantile(ratios, 0.5),
                          std::max(Quantile(sigmas, 0.1), options.min_log_scale_sigma)};
}

std::map<SubmapId, ScaleMeasurement> MeasureScales(const MetricFrameOptions& options,
                                                   const MapModel& model,
                                                   const std::vector<SubmapId>& submaps) {
  std::map<SubmapId, ScaleMeasurement> measurements;
  std::map<std::pair<AgentId, SessionId>, int> counts;
  const auto session_of = [&](SubmapId id) {
    const SubmapKey& key = model.submap(id).refined->raw->key;
    return std::pair(key.agent, key.session);
  };
  for (const SubmapId id : submaps) {
    const auto measurement = MeasureScale(options, model, id);
    if (!measurement) continue;
    measurements[id] = *measurement;
    ++counts[session_of(id)];
  }
  for (auto& [id, measurement] : measurements) {
    const int together = std::min(counts[session_of(id)], options.correlated_submaps);
    measurement.sigma *= std::sqrt(static_cast<double>(together));
  }
  return measurements;
}

Similarity3 MetricFromWorld(const MetricFrameOptions& options, const MapModel& model,
                            const std::vector<SubmapId>& submaps) {
  Similarity3 result;
  const auto log_scale = MeanLogScale(options, model, submaps);
  if (log_scale && std::abs(*log_scale) > options.min_log_scale_step) {
    result.scale = std::exp(*log_scale);
  }
  if (const auto gravity = MeanGravity(model, submaps)) {
    const Eigen::Quaterniond turn = RotationBetween(*gravity, -Eigen::Vector3d::UnitZ());
    if (RotationLog(turn).norm() > options.min_rotation_step_rad) result.rotation = turn;
  }
  return result;
}

}  // namespace portolan
