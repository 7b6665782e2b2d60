// The compact form of submaps that agents upload and the server keeps (proto/submap.proto).
#ifndef PORTOLAN_COMMON_WIRE_SUBMAP_WIRE_H_
#define PORTOLAN_COMMON_WIRE_SUBMAP_WIRE_H_

#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/submap/submap.h"
#include "proto/submap.pb.h"

namespace portolan {

// Where the bytes of an encoded submap go; tags and lengths of fields count as `other`.
struct WireSizes {
  size_t keyframe_poses = 0;  // with times
  size_t keyframe_covariances = 0;
  size_t observation_tracks = 0;  // with counts
  size_t observation_pixels = 0;
  size_t observation_sigmas = 0;
  size_t feature_pixels = 0;
  size_t feature_attributes = 0;  // counts, half octaves, tracks
  size_t feature_descriptors = 0;
  size_t landmarks = 0;
  size_t frame_times = 0;
  size_t frame_poses = 0;
  size_t other = 0;

  size_t Total() const;
};

// The submap as bytes. Rounds as proto/README.md says and sorts the features of each keyframe by
// y, then x. InvalidArgument, saying what and where, if the submap breaks a rule or limit of
// proto/submap.proto. The same submap always gives the same bytes.
StatusOr<std::string> EncodeSubmap(const Submap& submap);

// Any bytes are safe; InvalidArgument says what and where. What it returns fulfils
// ValidateSubmapStructure; covariances are positive (semi-)definite.
StatusOr<Submap> DecodeSubmap(std::string_view bytes);

Status ToProto(const Submap& submap, v1::Submap* message);
StatusOr<Submap> FromProto(const v1::Submap& message);

WireSizes SizesOf(const v1::Submap& message);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_SUBMAP_WIRE_H_
