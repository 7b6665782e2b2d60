#include <algorithm>
#include <cmath>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "common/wire/column_codec.h"
#include "common/wire/submap_columns.h"
#include "common/wire/submap_validation.h"

namespace portolan {
namespace {

constexpr int kStepsPerPixel = 16;
constexpr int64_t kMaxSteps = static_cast<int64_t>(kMaxPixel_px) * kStepsPerPixel;
constexpr size_t kDescriptorBytes = 32;

struct FeatureSteps {
  int64_t y, x;
  size_t index;  // in the keyframe

  friend auto operator<=>(const FeatureSteps&, const FeatureSteps&) = default;
};

// Sorted by y, then x, then the order in the keyframe.
std::vector<FeatureSteps> SortedSteps(const std::vector<Feature>& features) {
  std::vector<FeatureSteps> steps;
  steps.reserve(features.size());
  for (size_t i = 0; i < features.size(); ++i) {
    const Eigen::Vector2d pixel = features[i].pixel.cast<double>() * kStepsPerPixel;
    steps.push_back({std::llround(pixel.y()), std::llround(pixel.x()), i});
  }
  std::sort(steps.begin(), steps.end());
  return steps;
}

void AppendDescriptor(const Descriptor& descriptor, std::string* bytes) {
  for (const uint64_t word : descriptor.words) {
    for (int shift = 0; shift < 64; shift += 8) {
      bytes->push_back(static_cast<char>((word >> shift) & 0xff));
    }
  }
}

Descriptor DescriptorAt(const std::string& bytes, size_t index) {
  Descriptor descriptor;
  size_t at = kDescriptorBytes * index;
  for (uint64_t& word : descriptor.words) {
    for (int shift = 0; shift < 64; shift += 8) {
      word |= static_cast<uint64_t>(static_cast<unsigned char>(bytes[at++])) << shift;
    }
  }
  return descriptor;
}

struct Columns {
  std::vector<int64_t> y, x, half_octave, on_track, track;
};

StatusOr<Columns> DecodeColumns(const v1::FeatureColumns& message, size_t total) {
  Columns c;
  PORTOLAN_ASSIGN_OR_RETURN(c.y, NamedColumn(message.y(), total, "submap.features.y"));
  PORTOLAN_ASSIGN_OR_RETURN(c.x, NamedColumn(message.x(), total, "submap.features.x"));
  PORTOLAN_ASSIGN_OR_RETURN(
      c.half_octave, NamedColumn(message.half_octave(), total, "submap.features.half_octave"));
  PORTOLAN_ASSIGN_OR_RETURN(c.on_track,
                            NamedColumn(message.on_track(), total, "submap.features.on_track"));
  size_t tracked = 0;
  for (const int64_t on_track : c.on_track) {
    if (on_track != 0 && on_track != 1) {
      return absl::InvalidArgumentError("submap.features.on_track: not 0 or 1");
    }
    tracked += static_cast<size_t>(on_track);
  }
  PORTOLAN_ASSIGN_OR_RETURN(c.track,
                            NamedColumn(message.track(), tracked, "submap.features.track"));
  int64_t track = 0;
  for (int64_t& value : c.track) {
    const auto next = AddWithin(track, value, UINT32_MAX);
    if (!next.has_value() || *next < 0) {
      return absl::InvalidArgumentError("submap.features.track: id out of range");
    }
    value = track = *next;
  }
  if (message.descriptors().size() != kDescriptorBytes * total) {
    return absl::InvalidArgumentError(
        absl::StrCat("submap.features.descriptors: ", message.descriptors().size(),
                     " bytes instead of ", kDescriptorBytes * total));
  }
  return c;
}

}  // namespace

void EncodeFeatures(const std::vector<Keyframe>& keyframes, v1::FeatureColumns* columns) {
  Columns c;
  int64_t track = 0;
  for (const Keyframe& keyframe : keyframes) {
    columns->add_count(static_cast<uint32_t>(keyframe.features.size()));
    int64_t y = 0;
    for (const FeatureSteps& steps : SortedSteps(keyframe.features)) {
      const Feature& feature = keyframe.features[steps.index];
      c.y.push_back(steps.y - y);
      y = steps.y;
      c.x.push_back(steps.x);
      c.half_octave.push_back(feature.half_octave);
      c.on_track.push_back(feature.track.has_value() ? 1 : 0);
      if (feature.track.has_value()) {
        c.track.push_back(static_cast<int64_t>(feature.track->value()) - track);
        track = feature.track->value();
      }
      AppendDescriptor(feature.descriptor, columns->mutable_descriptors());
    }
  }
  columns->set_y(EncodeColumn(c.y));
  columns->set_x(EncodeColumn(c.x));
  columns->set_half_octave(EncodeColumn(c.half_octave));
  columns->set_on_track(EncodeColumn(c.on_track));
  columns->set_track(EncodeColumn(c.track));
}

Status DecodeFeatures(const v1::FeatureColumns& columns, std::vector<Keyframe>* keyframes) {
  PORTOLAN_RETURN_IF_ERROR(CheckCounts(columns.count(), keyframes->size(), kMaxFeaturesPerKeyframe,
                                       kMaxFeatures, "submap.features.count"));
  size_t total = 0;
  for (const uint32_t count : columns.count()) total += count;
  PORTOLAN_ASSIGN_OR_RETURN(const Columns c, DecodeColumns(columns, total));
  size_t at = 0;
  size_t next_track = 0;
  for (size_t k = 0; k < keyframes->size(); ++k) {
    auto& features = (*keyframes)[k].features;
    features.resize(columns.count(static_cast<int>(k)));
    int64_t y = 0;
    for (size_t i = 0; i < features.size(); ++i, ++at) {
      const auto next_y = AddWithin(y, c.y[at], kMaxSteps);
      const auto x = AddWithin(0, c.x[at], kMaxSteps);
      if (!next_y.has_value() || !x.has_value() || c.half_octave[at] < 0 ||
          c.half_octave[at] > kMaxHalfOctave) {
        return absl::InvalidArgumentError(
            absl::StrCat("submap.features: keyframe ", k, ", feature ", i, ": out of range"));
      }
      y = *next_y;
      features[i].pixel =
          Eigen::Vector2f(static_cast<float>(*x), static_cast<float>(y)) / kStepsPerPixel;
      features[i].half_octave = static_cast<uint8_t>(c.half_octave[at]);
      if (c.on_track[at] == 1) {
        features[i].track = TrackId(static_cast<uint32_t>(c.track[next_track++]));
      }
      features[i].descriptor = DescriptorAt(columns.descriptors(), at);
    }
  }
  return absl::OkStatus();
}

}  // namespace portolan
