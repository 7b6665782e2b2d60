// What both forms of FeatureColumns share: places and order of the features, and which descriptors
// resemble which. Used by feature_columns only.
#ifndef PORTOLAN_COMMON_WIRE_FEATURE_CODEC_H_
#define PORTOLAN_COMMON_WIRE_FEATURE_CODEC_H_

#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "common/submap/submap.h"
#include "common/wire/descriptor_codec.h"
#include "proto/submap.pb.h"

namespace portolan {

// Fields 2 to 6 of FeatureColumns: features with a place of their own, keyframe by keyframe.
class PlacedFeatureEncoder {
 public:
  // Writes the features in the order given, which is ascending y, and rounds their pixels.
  void AddKeyframe(std::vector<Feature>* features);
  void Write(v1::FeatureColumns* columns) const;

 private:
  std::vector<int64_t> y_, x_, half_octave_, on_track_, track_;
  int64_t last_track_ = 0;
};

class PlacedFeatureDecoder {
 public:
  // `total`: the number of features in all keyframes; limited by the caller.
  static StatusOr<PlacedFeatureDecoder> Create(const v1::FeatureColumns& columns, size_t total);
  // Appends the next `count` features, those of one keyframe, without descriptors.
  Status TakeKeyframe(size_t count, std::vector<Feature>* features);

 private:
  std::vector<int64_t> y_, x_, half_octave_, on_track_, track_;
  size_t next_ = 0;
  size_t next_track_ = 0;
};

// The features' indices in the order of the compact form.
std::vector<size_t> CompactOrder(const std::vector<Feature>& features);

// Over the features of all keyframes in the order of the message.
std::vector<DescriptorReferences> ReferencesOf(const std::vector<Keyframe>& keyframes);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_FEATURE_CODEC_H_
