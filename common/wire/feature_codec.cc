#include "common/wire/feature_codec.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "common/wire/column_codec.h"
#include "common/wire/submap_columns.h"
#include "common/wire/submap_validation.h"

namespace portolan {
namespace {

constexpr int kStepsPerPixel = 16;
constexpr int64_t kMaxSteps = static_cast<int64_t>(kMaxPixel_px) * kStepsPerPixel;

Eigen::Vector2f PixelAt(int64_t x_steps, int64_t y_steps) {
  return Eigen::Vector2f(static_cast<float>(x_steps), static_cast<float>(y_steps)) / kStepsPerPixel;
}

// From differences to the ids themselves.
Status SumTracks(std::vector<int64_t>* tracks) {
  int64_t track = 0;
  for (int64_t& value : *tracks) {
    const auto next = AddWithin(track, value, UINT32_MAX);
    if (!next.has_value() || *next < 0) {
      return absl::InvalidArgumentError("submap.features.track: id out of range");
    }
    value = track = *next;
  }
  return absl::OkStatus();
}

}  // namespace

void PlacedFeatureEncoder::AddKeyframe(std::vector<Feature>* features) {
  int64_t last_y = 0;
  for (Feature& feature : *features) {
    const Eigen::Vector2d pixel = feature.pixel.cast<double>() * kStepsPerPixel;
    const int64_t x = std::llround(pixel.x());
    const int64_t y = std::llround(pixel.y());
    feature.pixel = PixelAt(x, y);
    y_.push_back(y - last_y);
    last_y = y;
    x_.push_back(x);
    half_octave_.push_back(feature.half_octave);
    on_track_.push_back(feature.track.has_value() ? 1 : 0);
    if (feature.track.has_value()) {
      track_.push_back(static_cast<int64_t>(feature.track->value()) - last_track_);
      last_track_ = feature.track->value();
    }
  }
}

void PlacedFeatureEncoder::Write(v1::FeatureColumns* columns) const {
  columns->set_y(EncodeColumn(y_));
  columns->set_x(EncodeColumn(x_));
  columns->set_half_octave(EncodeColumn(half_octave_));
  columns->set_on_track(EncodeColumn(on_track_));
  columns->set_track(EncodeColumn(track_));
}

StatusOr<PlacedFeatureDecoder> PlacedFeatureDecoder::Create(const v1::FeatureColumns& columns,
                                                            size_t total) {
  PlacedFeatureDecoder d;
  PORTOLAN_ASSIGN_OR_RETURN(d.y_, NamedColumn(columns.y(), total, "submap.features.y"));
  PORTOLAN_ASSIGN_OR_RETURN(d.x_, NamedColumn(columns.x(), total, "submap.features.x"));
  PORTOLAN_ASSIGN_OR_RETURN(
      d.half_octave_, NamedColumn(columns.half_octave(), total, "submap.features.half_octave"));
  PORTOLAN_ASSIGN_OR_RETURN(d.on_track_,
                            NamedColumn(columns.on_track(), total, "submap.features.on_track"));
  size_t tracked = 0;
  for (const int64_t on_track : d.on_track_) {
    if (on_track != 0 && on_track != 1) {
      return absl::InvalidArgumentError("submap.features.on_track: not 0 or 1");
    }
    tracked += static_cast<size_t>(on_track);
  }
  PORTOLAN_ASSIGN_OR_RETURN(d.track_,
                            NamedColumn(columns.track(), tracked, "submap.features.track"));
  PORTOLAN_RETURN_IF_ERROR(SumTracks(&d.track_));
  return d;
}

Status PlacedFeatureDecoder::TakeKeyframe(size_t count, std::vector<Feature>* features) {
  int64_t y = 0;
  for (size_t i = 0; i < count; ++i, ++next_) {
    const auto next_y = AddWithin(y, y_[next_], kMaxSteps);
    const auto x = AddWithin(0, x_[next_], kMaxSteps);
    if (!next_y.has_value() || !x.has_value() || half_octave_[next_] < 0 ||
        half_octave_[next_] > kMaxHalfOctave) {
      return absl::InvalidArgumentError(
          absl::StrCat("submap.features: feature ", next_, ": out of range"));
    }
    y = *next_y;
    Feature feature;
    feature.pixel = PixelAt(*x, y);
    feature.half_octave = static_cast<uint8_t>(half_octave_[next_]);
    if (on_track_[next_] == 1) {
      feature.track = TrackId(static_cast<uint32_t>(track_[next_track_++]));
    }
    features->push_back(feature);
  }
  return absl::OkStatus();
}

std::vector<size_t> CompactOrder(const std::vector<Feature>& features) {
  std::vector<size_t> order(features.size());
  std::iota(order.begin(), order.end(), size_t{0});
  const auto key = [&](size_t i) {
    return std::tuple(features[i].pixel.y(), features[i].pixel.x(), features[i].half_octave);
  };
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return key(a) < key(b); });
  return order;
}

std::vector<DescriptorReferences> ReferencesOf(const std::vector<Keyframe>& keyframes) {
  std::vector<DescriptorReferences> references;
  // By track and half octave: the last descriptor before this keyframe.
  std::map<std::pair<uint32_t, uint8_t>, int> earlier;
  for (const Keyframe& keyframe : keyframes) {
    // By track: the last descriptor in this keyframe.
    std::unordered_map<uint32_t, int> here;
    const auto begin = static_cast<int>(references.size());
    for (const Feature& feature : keyframe.features) {
      DescriptorReferences of = {-1, -1};
      if (feature.track.has_value()) {
        const auto index = static_cast<int>(references.size());
        const auto [same, is_first] = here.try_emplace(feature.track->value(), index);
        if (!is_first) of[0] = std::exchange(same->second, index);
        const auto before = earlier.find({feature.track->value(), feature.half_octave});
        if (before != earlier.end()) of[1] = before->second;
      }
      references.push_back(of);
    }
    for (size_t i = 0; i < keyframe.features.size(); ++i) {
      const Feature& feature = keyframe.features[i];
      if (!feature.track.has_value()) continue;
      earlier[{feature.track->value(), feature.half_octave}] = begin + static_cast<int>(i);
    }
  }
  return references;
}

}  // namespace portolan
