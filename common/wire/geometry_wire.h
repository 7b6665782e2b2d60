// ToProto/FromProto of geometry and cameras. FromProto answers InvalidArgument, naming `what`,
// for anything that proto/geometry.proto calls malformed; quaternions come back normalised.
#ifndef PORTOLAN_COMMON_WIRE_GEOMETRY_WIRE_H_
#define PORTOLAN_COMMON_WIRE_GEOMETRY_WIRE_H_

#include "absl/strings/string_view.h"
#include "common/base/status.h"
#include "common/camera/camera_model.h"
#include "common/geometry/similarity3.h"
#include "proto/geometry.pb.h"

namespace portolan {

// A coordinate may be at most so large (any unit).
inline constexpr double kMaxCoordinate = 1e9;
// Scales lie between 1 / kMaxScale and kMaxScale.
inline constexpr double kMaxScale = 1e9;

void ToProto(const Eigen::Vector3d& value, v1::Vector3* message);
StatusOr<Eigen::Vector3d> FromProto(const v1::Vector3& message, absl::string_view what);

void ToProto(const Rigid3& value, v1::Rigid3* message);
StatusOr<Rigid3> FromProto(const v1::Rigid3& message, absl::string_view what);

void ToProto(const Similarity3& value, v1::Similarity3* message);
StatusOr<Similarity3> FromProto(const v1::Similarity3& message, absl::string_view what);

// Checks sizes and ranges; CameraModel::Create then judges the distortion.
void ToProto(const CameraIntrinsics& value, v1::CameraCalibration* message);
StatusOr<CameraIntrinsics> FromProto(const v1::CameraCalibration& message, absl::string_view what);

// Poses in packed columns: quaternion w x y z, translation x y z.
inline constexpr int kPoseNumbers = 7;
void AppendPose(const Rigid3& pose, google::protobuf::RepeatedField<float>* numbers);
void AppendPose(const Rigid3& pose, google::protobuf::RepeatedField<double>* numbers);
// The pose at numbers[7 * index]; the caller has checked the size.
StatusOr<Rigid3> PoseAt(const google::protobuf::RepeatedField<float>& numbers, int index,
                        absl::string_view what);
StatusOr<Rigid3> PoseAt(const google::protobuf::RepeatedField<double>& numbers, int index,
                        absl::string_view what);

// OK if finite, of unit length to within 1e-3, and no coordinate above kMaxCoordinate.
Status CheckPose(const Rigid3& pose, absl::string_view what);
Status CheckSimilarity(const Similarity3& similarity, absl::string_view what);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_GEOMETRY_WIRE_H_
