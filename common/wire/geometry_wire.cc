#include "common/wire/geometry_wire.h"

#include <cmath>

#include "absl/strings/str_cat.h"

namespace portolan {
namespace {

constexpr double kQuaternionTolerance = 1e-3;
constexpr uint32_t kMaxImageSize_px = 32768;

Status Malformed(absl::string_view what, absl::string_view why) {
  return absl::InvalidArgumentError(absl::StrCat(what, ": ", why));
}

// False for NaN, too.
bool IsCoordinate(double x) { return std::abs(x) <= kMaxCoordinate; }

Status CheckTranslation(const Eigen::Vector3d& t, absl::string_view what) {
  if (IsCoordinate(t.x()) && IsCoordinate(t.y()) && IsCoordinate(t.z())) return absl::OkStatus();
  return Malformed(what, "coordinate is not finite or too large");
}

Status CheckRotation(const Eigen::Quaterniond& q, absl::string_view what) {
  // Written so that NaN fails.
  if (std::abs(q.norm() - 1.0) <= kQuaternionTolerance) return absl::OkStatus();
  return Malformed(what, "quaternion is not of unit length");
}

void ToProto(const Eigen::Quaterniond& value, v1::Quaternion* message) {
  message->set_w(value.w());
  message->set_x(value.x());
  message->set_y(value.y());
  message->set_z(value.z());
}

Eigen::Quaterniond ToQuaternion(const v1::Quaternion& m) { return {m.w(), m.x(), m.y(), m.z()}; }
Eigen::Vector3d ToVector(const v1::Vector3& m) { return {m.x(), m.y(), m.z()}; }

template <typename Number>
void AppendPoseNumbers(const Rigid3& pose, google::protobuf::RepeatedField<Number>* numbers) {
  const auto& q = pose.rotation;
  const auto& t = pose.translation;
  for (const double x : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
    numbers->Add(static_cast<Number>(x));
  }
}

template <typename Number>
StatusOr<Rigid3> PoseFromNumbers(const google::protobuf::RepeatedField<Number>& numbers, int index,
                                 absl::string_view what) {
  const Number* n = numbers.data() + kPoseNumbers * index;
  Rigid3 pose{Eigen::Quaterniond(n[0], n[1], n[2], n[3]), Eigen::Vector3d(n[4], n[5], n[6])};
  PORTOLAN_RETURN_IF_ERROR(CheckPose(pose, what));
  pose.rotation.normalize();
  return pose;
}

v1::DistortionModel ToProto(DistortionModel model) {
  switch (model) {
    case DistortionModel::kNone:
      return v1::DISTORTION_MODEL_NONE;
    case DistortionModel::kRadTan:
      return v1::DISTORTION_MODEL_RADTAN;
    case DistortionModel::kEquidistant:
      return v1::DISTORTION_MODEL_EQUIDISTANT;
  }
  return v1::DISTORTION_MODEL_UNSPECIFIED;
}

std::optional<DistortionModel> FromProto(v1::DistortionModel model) {
  switch (model) {
    case v1::DISTORTION_MODEL_NONE:
      return DistortionModel::kNone;
    case v1::DISTORTION_MODEL_RADTAN:
      return DistortionModel::kRadTan;
    case v1::DISTORTION_MODEL_EQUIDISTANT:
      return DistortionModel::kEquidistant;
    default:
      return std::nullopt;
  }
}

bool IsImageSize(uint32_t size_px) { return size_px >= 1 && size_px <= kMaxImageSize_px; }
bool IsFocalLength(double f_px) { return f_px > 0 && f_px <= kMaxCoordinate; }

}  // namespace

Status CheckPose(const Rigid3& pose, absl::string_view what) {
  PORTOLAN_RETURN_IF_ERROR(CheckRotation(pose.rotation, what));
  return CheckTranslation(pose.translation, what);
}

Status CheckSimilarity(const Similarity3& similarity, absl::string_view what) {
  PORTOLAN_RETURN_IF_ERROR(CheckPose(similarity.Rigid(), what));
  if (similarity.scale >= 1.0 / kMaxScale && similarity.scale <= kMaxScale) {
    return absl::OkStatus();
  }
  return Malformed(what, "scale is not positive and finite");
}

void ToProto(const Eigen::Vector3d& value, v1::Vector3* message) {
  message->set_x(value.x());
  message->set_y(value.y());
  message->set_z(value.z());
}

StatusOr<Eigen::Vector3d> FromProto(const v1::Vector3& message, absl::string_view what) {
  const Eigen::Vector3d value = ToVector(message);
  PORTOLAN_RETURN_IF_ERROR(CheckTranslation(value, what));
  return value;
}

void ToProto(const Rigid3& value, v1::Rigid3* message) {
  ToProto(value.rotation, message->mutable_rotation());
  ToProto(value.translation, message->mutable_translation());
}

StatusOr<Rigid3> FromProto(const v1::Rigid3& message, absl::string_view what) {
  Rigid3 value{ToQuaternion(message.rotation()), ToVector(message.translation())};
  PORTOLAN_RETURN_IF_ERROR(CheckPose(value, what));
  value.rotation.normalize();
  return value;
}

void ToProto(const Similarity3& value, v1::Similarity3* message) {
  message->set_scale(value.scale);
  ToProto(value.rotation, message->mutable_rotation());
  ToProto(value.translation, message->mutable_translation());
}

StatusOr<Similarity3> FromProto(const v1::Similarity3& message, absl::string_view what) {
  Similarity3 value;
  value.scale = message.scale();
  value.rotation = ToQuaternion(message.rotation());
  value.translation = ToVector(message.translation());
  PORTOLAN_RETURN_IF_ERROR(CheckSimilarity(value, what));
  value.rotation.normalize();
  return value;
}

void ToProto(const CameraIntrinsics& value, v1::CameraCalibration* message) {
  message->set_width_px(static_cast<uint32_t>(value.width_px));
  message->set_height_px(static_cast<uint32_t>(value.height_px));
  message->set_fx_px(value.fx_px);
  message->set_fy_px(value.fy_px);
  message->set_cx_px(value.cx_px);
  message->set_cy_px(value.cy_px);
  message->set_distortion(ToProto(value.distortion));
  message->mutable_coefficients()->Assign(value.coefficients.begin(), value.coefficients.end());
}

StatusOr<CameraIntrinsics> FromProto(const v1::CameraCalibration& message, absl::string_view what) {
  if (!IsImageSize(message.width_px()) || !IsImageSize(message.height_px())) {
    return Malformed(what, "image size is not in 1..32768");
  }
  if (!IsFocalLength(message.fx_px()) || !IsFocalLength(message.fy_px())) {
    return Malformed(what, "focal length is not positive and finite");
  }
  if (!IsCoordinate(message.cx_px()) || !IsCoordinate(message.cy_px())) {
    return Malformed(what, "principal point is not finite");
  }
  const auto distortion = FromProto(message.distortion());
  if (!distortion.has_value()) return Malformed(what, "unknown distortion model");
  CameraIntrinsics value;
  if (message.coefficients_size() != static_cast<int>(value.coefficients.size())) {
    return Malformed(what, "not exactly 5 distortion coefficients");
  }
  for (int i = 0; i < message.coefficients_size(); ++i) {
    if (!IsCoordinate(message.coefficients(i))) {
      return Malformed(what, "distortion coefficient is not finite");
    }
    value.coefficients[static_cast<size_t>(i)] = message.coefficients(i);
  }
  value.width_px = static_cast<int>(message.width_px());
  value.height_px = static_cast<int>(message.height_px());
  value.fx_px = message.fx_px();
  value.fy_px = message.fy_px();
  value.cx_px = message.cx_px();
  value.cy_px = message.cy_px();
  value.distortion = *distortion;
  return value;
}

void AppendPose(const Rigid3& pose, google::protobuf::RepeatedField<float>* numbers) {
  AppendPoseNumbers(pose, numbers);
}
void AppendPose(const Rigid3& pose, google::protobuf::RepeatedField<double>* numbers) {
  AppendPoseNumbers(pose, numbers);
}

StatusOr<Rigid3> PoseAt(const google::protobuf::RepeatedField<float>& numbers, int index,
                        absl::string_view what) {
  return PoseFromNumbers(numbers, index, what);
}
StatusOr<Rigid3> PoseAt(const google::protobuf::RepeatedField<double>& numbers, int index,
                        absl::string_view what) {
  return PoseFromNumbers(numbers, index, what);
}

}  // namespace portolan
