#include "common/trajectory/alignment.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "common/base/check.h"

namespace portolan {
namespace {

Eigen::Matrix3Xd Columns(std::span<const Eigen::Vector3d> points) {
  Eigen::Matrix3Xd columns(3, points.size());
  for (size_t i = 0; i < points.size(); ++i) columns.col(static_cast<int>(i)) = points[i];
  return columns;
}

// The rotation about z that maximises sum q_i . (R p_i) over centred p, q: the angle of
// sum (p x q)_z against sum (p . q)_xy.
Similarity3 AlignYaw(const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to) {
  const Eigen::Vector3d from_mean = from.rowwise().mean();
  const Eigen::Vector3d to_mean = to.rowwise().mean();
  const Eigen::Matrix3Xd p = from.colwise() - from_mean;
  const Eigen::Matrix3Xd q = to.colwise() - to_mean;
  const double sine = p.row(0).dot(q.row(1)) - p.row(1).dot(q.row(0));
  const double cosine = p.row(0).dot(q.row(0)) + p.row(1).dot(q.row(1));
  Similarity3 transform;
  transform.rotation =
      Eigen::Quaterniond(Eigen::AngleAxisd(std::atan2(sine, cosine), Eigen::Vector3d::UnitZ()));
  transform.translation = to_mean - transform.rotation * from_mean;
  return transform;
}

}  // namespace

StatusOr<AlignmentMode> ParseAlignmentMode(const std::string& text) {
  for (const AlignmentMode mode :
       {AlignmentMode::kNone, AlignmentMode::kYaw, AlignmentMode::kSe3, AlignmentMode::kSim3}) {
    if (text == AlignmentModeName(mode)) return mode;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("unknown alignment '", text, "'; one of none, yaw, se3, sim3"));
}

const char* AlignmentModeName(AlignmentMode mode) {
  switch (mode) {
    case AlignmentMode::kNone:
      return "none";
    case AlignmentMode::kYaw:
      return "yaw";
    case AlignmentMode::kSe3:
      return "se3";
    case AlignmentMode::kSim3:
      return "sim3";
  }
  return "none";
}

template <int dimension>
SimilarityTransform<dimension> Umeyama(const Eigen::Matrix<double, dimension, Eigen::Dynamic>& from,
                                       const Eigen::Matrix<double, dimension, Eigen::Dynamic>& to,
                                       bool with_scale) {
  using Vector = Eigen::Matrix<double, dimension, 1>;
  using Matrix = Eigen::Matrix<double, dimension, dimension>;
  PORTOLAN_CHECK(from.cols() == to.cols() && from.cols() > 0);
  const double count = static_cast<double>(from.cols());
  const Vector from_mean = from.rowwise().mean();
  const Vector to_mean = to.rowwise().mean();
  const Eigen::Matrix<double, dimension, Eigen::Dynamic> p = from.colwise() - from_mean;
  const Eigen::Matrix<double, dimension, Eigen::Dynamic> q = to.colwise() - to_mean;
  const double from_variance = p.squaredNorm() / count;
  const Matrix covariance = q * p.transpose() / count;  // Eq. 38
  SimilarityTransform<dimension> result;
  result.rotation = NearestRotation(covariance);  // Eq. 40
  if (with_scale && from_variance > 0) {
    result.scale = result.rotation.cwiseProduct(covariance).sum() / from_variance;  // Eq. 42
  }
  result.translation = to_mean - result.scale * result.rotation * from_mean;  // Eq. 41
  result.mean_squared_error = (q - result.scale * result.rotation * p).squaredNorm() / count;
  return result;
}

template SimilarityTransform<2> Umeyama<2>(const Eigen::Matrix2Xd&, const Eigen::Matrix2Xd&, bool);
template SimilarityTransform<3> Umeyama<3>(const Eigen::Matrix3Xd&, const Eigen::Matrix3Xd&, bool);

std::optional<Similarity3> AlignPoints(std::span<const Eigen::Vector3d> estimate,
                                       std::span<const Eigen::Vector3d> reference,
                                       AlignmentMode mode) {
  if (estimate.size() != reference.size()) return std::nullopt;
  if (mode == AlignmentMode::kNone) return Similarity3::Identity();
  if (estimate.size() < (mode == AlignmentMode::kYaw ? 2u : 3u)) return std::nullopt;
  const Eigen::Matrix3Xd from = Columns(estimate);
  const Eigen::Matrix3Xd to = Columns(reference);
  if (mode == AlignmentMode::kYaw) return AlignYaw(from, to);
  const bool with_scale = mode == AlignmentMode::kSim3;
  const double spread = (from.colwise() - from.rowwise().mean().eval()).norm();
  if (with_scale && !(spread > 1e-12 * (1.0 + from.norm()))) return std::nullopt;
  const SimilarityTransform<3> transform = Umeyama<3>(from, to, with_scale);
  return Similarity3{transform.scale, Eigen::Quaterniond(transform.rotation).normalized(),
                     transform.translation};
}

}  // namespace portolan
