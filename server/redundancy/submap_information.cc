#include "server/redundancy/submap_information.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/bundle/bundle_terms.h"
#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

// Standard deviation of the scale that counts as held, relative; no pixel comes near it.
constexpr double kHeldScaleSigma = 1e-4;
constexpr int kPoseSize = 6;

using Matrix36d = Eigen::Matrix<double, 3, 6>;

// log det by Cholesky; no value unless positive definite.
std::optional<double> LogDeterminant(Eigen::MatrixXd matrix) {
  if (!FactorCholesky(matrix)) return std::nullopt;
  const double half = matrix.diagonal().array().log().sum();
  if (!std::isfinite(half)) return std::nullopt;
  return 2 * half;
}

}  // namespace

SubmapInformation::SubmapInformation(const RefinedSubmap& submap, const std::vector<int>& ends,
                                     double agreeing_chi2)
    : median_depth_(MedianDepth(submap)) {
  AddViews(submap, agreeing_chi2);
  HoldScale(submap, ends);
  all_log_determinants_ = LogDeterminants(SubmapChoice::Everything(submap));
}

void SubmapInformation::AddViews(const RefinedSubmap& submap, double agreeing_chi2) {
  tracks_.resize(submap.landmarks.size());
  std::vector<PointReference> references(tracks_.size());
  std::vector<Eigen::Vector3d> parameters(tracks_.size());
  const auto agreeing = AgreeingObservations(submap, agreeing_chi2);
  for (size_t k = 0; k < submap.raw->keyframes.size(); ++k) {
    const CameraReference camera{submap.submap_from_camera[k], submap.camera.get()};
    const CameraState state(camera);
    const std::vector<Observation>& observations = submap.raw->keyframes[k].observations;
    for (size_t i = 0; i < observations.size(); ++i) {
      if (!agreeing[k][i]) continue;
      const RefinedLandmark* landmark = FindLandmark(submap, observations[i].track);
      const size_t index = landmark - submap.landmarks.data();
      Track& track = tracks_[index];
      if (track.views.empty()) {
        const Eigen::Vector3d& anchor = camera.world_from_camera.translation;
        references[index] = PointReference::At(anchor, landmark->point_in_submap);
        const double depth = std::max((landmark->point_in_submap - anchor).norm(), 1e-9);
        parameters[index] = {0, 0, 1 / depth};
        const double sigma = std::max(1 / depth, 1 / median_depth_);
        track.depth_information = 1 / (sigma * sigma);
      }
      const ReprojectionError error(&references[index], observations[i].pixel.cast<double>(),
                                    observations[i].sigma_px);
      Eigen::Vector2d residual;
      Eigen::Matrix<double, 2, 6, Eigen::RowMajor> d_camera;
      Eigen::Matrix<double, 2, 3, Eigen::RowMajor> d_point;
      error.Evaluate(state, parameters[index].data(), residual.data(), d_camera.data(),
                     d_point.data());
      track.views.push_back({static_cast<int>(k), observations[i].pixel, d_camera, d_point});
    }
  }
}

void SubmapInformation::HoldScale(const RefinedSubmap& submap, const std::vector<int>& ends) {
  const size_t count = submap.submap_from_camera.size();
  scale_direction_ = Eigen::VectorXd::Zero(count == 0 ? 0 : kPoseSize * (count - 1));
  for (const int k : ends) {
    if (k == 0) continue;
    const Rigid3& pose = submap.submap_from_camera[k];
    scale_direction_.segment<3>(kPoseSize * (k - 1)) =
        pose.rotation.conjugate() * (pose.translation - submap.submap_from_camera[0].translation);
  }
  // The relative change of the scale is direction' d / norm^2. Where the camera hardly moved, it is
  // held by what is seen of the depth's prior only.
  const double norm2 = scale_direction_.squaredNorm() + 1e-6 * median_depth_ * median_depth_;
  scale_direction_ /= norm2 * kHeldScaleSigma;
}

std::vector<int> SubmapInformation::RowsOf(const std::vector<bool>& keyframes) {
  std::vector<int> rows(keyframes.size(), kNoRow);
  int row = 0;
  for (size_t k = 1; k < keyframes.size(); ++k) {
    if (!keyframes[k]) continue;
    rows[k] = row;
    row += kPoseSize;
  }
  return rows;
}

int SubmapInformation::ViewCount(const Track& track, const std::vector<bool>& keyframes) {
  return static_cast<int>(
      std::count_if(track.views.begin(), track.views.end(),
                    [&](const View& view) { return keyframes[view.keyframe]; }));
}

Eigen::Matrix3d SubmapInformation::PointInformation(const Track& track,
                                                    const std::vector<bool>& keyframes) const {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  information(2, 2) = track.depth_information;
  for (const View& view : track.views) {
    if (keyframes[view.keyframe]) information += view.d_point.transpose() * view.d_point;
  }
  return information;
}

Eigen::MatrixXd SubmapInformation::PoseInformation(const SubmapChoice& choice) const {
  const std::vector<int> rows = RowsOf(choice.keyframes);
  const int last = rows.empty() ? kNoRow : *std::max_element(rows.begin(), rows.end());
  const int size = last == kNoRow ? 0 : last + kPoseSize;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(size, size);
  std::vector<std::pair<int, Matrix36d>> couplings;
  for (size_t i = 0; i < tracks_.size(); ++i) {
    if (!choice.landmarks[i]) continue;
    couplings.clear();
    if (ViewCount(tracks_[i], choice.keyframes) < kMinViews) continue;
    for (const View& view : tracks_[i].views) {
      const int row = rows[view.keyframe];
      if (row == kNoRow) continue;
      information.block<6, 6>(row, row) += view.d_camera.transpose() * view.d_camera;
      couplings.emplace_back(row, view.d_point.transpose() * view.d_camera);
    }
    const Eigen::Matrix3d conditional = PointInformation(tracks_[i], choice.keyframes).inverse();
    for (size_t a = 0; a < couplings.size(); ++a) {
      const Matrix36d weights = conditional * couplings[a].second;
      for (size_t b = 0; b <= a; ++b) {
        information.block<6, 6>(couplings[a].first, couplings[b].first).noalias() -=
            weights.transpose() * couplings[b].second;
      }
    }
  }
  Eigen::VectorXd scale = Eigen::VectorXd::Zero(size);
  for (size_t k = 1; k < rows.size(); ++k) {
    if (rows[k] == kNoRow) continue;
    scale.segment<6>(rows[k]) = scale_direction_.segment<6>(kPoseSize * (static_cast<int>(k) - 1));
  }
  information += scale * scale.transpose();
  information.triangularView<Eigen::StrictlyUpper>() = information.transpose();
  return information;
}

std::vector<double> SubmapInformation::LogDeterminants(const SubmapChoice& choice) const {
  const std::vector<int> rows = RowsOf(choice.keyframes);
  const Eigen::MatrixXd information = PoseInformation(choice);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Identity(information.rows(), information.cols());
  if (information.size() == 0 || !SolvePositiveDefinite(information, covariance)) return {};
  std::vector<double> log_determinants(rows.size(), 0);
  for (size_t k = 1; k < rows.size(); ++k) {
    if (rows[k] == kNoRow) continue;
    const std::optional<double> one = LogDeterminant(covariance.block<6, 6>(rows[k], rows[k]));
    if (!one) return {};
    log_determinants[k] = *one;
  }
  return log_determinants;
}

std::optional<double> SubmapInformation::Share(const SubmapChoice& choice) const {
  const std::vector<double> kept = LogDeterminants(choice);
  if (!is_determined() || kept.empty()) return std::nullopt;
  double least = 1;
  for (size_t k = 1; k < kept.size(); ++k) {
    if (!choice.keyframes[k]) continue;
    least = std::min(least, std::exp((all_log_determinants_[k] - kept[k]) / kPoseSize));
  }
  return least;
}

double SubmapInformation::Leverage(size_t track, const SubmapChoice& choice,
                                   const Eigen::MatrixXd& covariance) const {
  if (ViewCount(tracks_[track], choice.keyframes) < kMinViews) return 0;
  const std::vector<int> rows = RowsOf(choice.keyframes);
  double leverage = 0;
  std::vector<std::pair<int, Matrix36d>> couplings;
  for (const View& view : tracks_[track].views) {
    const int row = rows[view.keyframe];
    if (row == kNoRow) continue;
    leverage +=
        (view.d_camera * covariance.block<6, 6>(row, row)).cwiseProduct(view.d_camera).sum();
    couplings.emplace_back(row, view.d_point.transpose() * view.d_camera);
  }
  Eigen::Matrix3d point = Eigen::Matrix3d::Zero();
  for (size_t a = 0; a < couplings.size(); ++a) {
    for (size_t b = 0; b <= a; ++b) {
      const Eigen::Matrix3d part = couplings[a].second *
                                   covariance.block<6, 6>(couplings[a].first, couplings[b].first) *
                                   couplings[b].second.transpose();
      point += a == b ? part : Eigen::Matrix3d(part + part.transpose());
    }
  }
  const Eigen::Matrix3d conditional = PointInformation(tracks_[track], choice.keyframes).inverse();
  return leverage - conditional.cwiseProduct(point).sum();
}

}  // namespace portolan
