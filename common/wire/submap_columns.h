// The column groups of a submap message, one Encode/Decode pair each; used by submap_wire only.
//
// Encode expects a valid submap. Decode checks everything that it needs to stay within bounds
// and memory limits; ValidateSubmapStructure then checks what the values mean.
#ifndef PORTOLAN_COMMON_WIRE_SUBMAP_COLUMNS_H_
#define PORTOLAN_COMMON_WIRE_SUBMAP_COLUMNS_H_

#include <optional>
#include <string_view>
#include <vector>

#include "absl/strings/string_view.h"
#include "common/base/status.h"
#include "common/submap/submap.h"
#include "proto/submap.pb.h"

namespace portolan {

void EncodeKeyframes(const std::vector<Keyframe>& keyframes, v1::KeyframeColumns* columns);
// Times, poses and covariances only.
StatusOr<std::vector<Keyframe>> DecodeKeyframes(const v1::KeyframeColumns& columns);

void EncodeObservations(const std::vector<Keyframe>& keyframes, v1::ObservationColumns* columns);
Status DecodeObservations(const v1::ObservationColumns& columns, std::vector<Keyframe>* keyframes);

void EncodeFeatures(const std::vector<Keyframe>& keyframes, v1::FeatureColumns* columns);
Status DecodeFeatures(const v1::FeatureColumns& columns, std::vector<Keyframe>* keyframes);

void EncodeLandmarks(const std::vector<SubmapLandmark>& landmarks, v1::LandmarkColumns* columns);
StatusOr<std::vector<SubmapLandmark>> DecodeLandmarks(const v1::LandmarkColumns& columns);

void EncodeFrames(const std::vector<FramePose>& frames, v1::FrameColumns* columns);
StatusOr<std::vector<FramePose>> DecodeFrames(const v1::FrameColumns& columns);

// The entries of `count`, one for each of `keyframe_count` keyframes, each and in sum limited.
Status CheckCounts(const google::protobuf::RepeatedField<uint32_t>& counts, size_t keyframe_count,
                   size_t max_each, size_t max_sum, absl::string_view what);
// DecodeColumn with the column's name in front of the error.
StatusOr<std::vector<int64_t>> NamedColumn(std::string_view bytes, size_t count,
                                           absl::string_view what);
// a + b, or no value if the sum's magnitude exceeds `limit`.
std::optional<int64_t> AddWithin(int64_t a, int64_t b, int64_t limit);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_SUBMAP_COLUMNS_H_
