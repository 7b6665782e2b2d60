// A list of poses in some 12 bytes each, for corrections (proto/correction.proto).
#ifndef PORTOLAN_COMMON_WIRE_POSE_COLUMNS_H_
#define PORTOLAN_COMMON_WIRE_POSE_COLUMNS_H_

#include <vector>

#include "absl/strings/string_view.h"
#include "common/base/status.h"
#include "common/geometry/rigid3.h"
#include "proto/correction.pb.h"

namespace portolan {

// Translations are rounded to 2^-14 of the largest coordinate or less, rotations to 2^-15 rad.
void EncodePoses(const std::vector<Rigid3>& poses, v1::PoseColumns* columns);

// InvalidArgument, beginning with `what`, if the columns are malformed or hold more than
// `max_poses`.
StatusOr<std::vector<Rigid3>> DecodePoses(const v1::PoseColumns& columns, size_t max_poses,
                                          absl::string_view what);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_POSE_COLUMNS_H_
