#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>

#include "absl/strings/str_cat.h"
#include "common/wire/column_codec.h"
#include "common/wire/feature_codec.h"
#include "common/wire/submap_columns.h"
#include "common/wire/submap_validation.h"

namespace portolan {
namespace {

// As observations are rounded.
constexpr int kObservationStepsPerPixel = 32;
constexpr size_t kDescriptorBytes = 32;
constexpr int64_t kAllHalfOctaves = (int64_t{2} << kMaxHalfOctave) - 1;

Eigen::Vector2f RoundedAsObservation(const Eigen::Vector2f& pixel) {
  const auto rounded = [](float value) {
    return static_cast<float>(
               std::llround(static_cast<double>(value) * kObservationStepsPerPixel)) /
           kObservationStepsPerPixel;
  };
  return {rounded(pixel.x()), rounded(pixel.y())};
}

std::optional<size_t> ObservationOf(const Keyframe& keyframe, const Feature& feature) {
  if (!feature.track.has_value()) return std::nullopt;
  const auto& observations = keyframe.observations;
  const auto it = std::lower_bound(observations.begin(), observations.end(), *feature.track,
                                   [](const Observation& o, TrackId id) { return o.track < id; });
  if (it == observations.end() || it->track != *feature.track) return std::nullopt;
  if (RoundedAsObservation(it->pixel) != RoundedAsObservation(feature.pixel)) return std::nullopt;
  return static_cast<size_t>(it - observations.begin());
}

// The features on the observations, as `masks` (one an observation) tell.
void AppendObserved(const Keyframe& keyframe, const std::vector<int64_t>& masks,
                    std::vector<Feature>* features) {
  for (size_t i = 0; i < masks.size(); ++i) {
    for (auto rest = static_cast<uint64_t>(masks[i]); rest != 0; rest &= rest - 1) {
      Feature feature;
      feature.pixel = RoundedAsObservation(keyframe.observations[i].pixel);
      feature.track = keyframe.observations[i].track;
      feature.half_octave = static_cast<uint8_t>(std::countr_zero(rest));
      features->push_back(feature);
    }
  }
}

std::vector<Feature> InOrder(const std::vector<Feature>& features,
                             const std::vector<size_t>& order) {
  std::vector<Feature> ordered;
  ordered.reserve(order.size());
  for (const size_t i : order) ordered.push_back(features[i]);
  return ordered;
}

class CompactEncoder {
 public:
  void Add(const Keyframe& keyframe) {
    Keyframe coded;
    if (!keyframe.features.empty()) {
      std::vector<Descriptor> descriptors;
      std::vector<Feature> features = Split(keyframe, &descriptors);
      for (size_t i = 0; i < features.size(); ++i) features[i].descriptor = descriptors[i];
      coded.features = InOrder(features, CompactOrder(features));
    }
    keyframes_.push_back(std::move(coded));
  }

  void Write(v1::FeatureColumns* columns) const {
    std::vector<Descriptor> descriptors;
    for (const Keyframe& keyframe : keyframes_) {
      columns->add_count(static_cast<uint32_t>(keyframe.features.size()));
      for (const Feature& feature : keyframe.features) descriptors.push_back(feature.descriptor);
    }
    placed_.Write(columns);
    columns->set_compact(true);
    columns->set_observed(EncodeColumn(observed_));
    columns->set_coded_descriptors(EncodeDescriptors(descriptors, ReferencesOf(keyframes_)));
  }

 private:
  // Rounded, those on observations first.
  std::vector<Feature> Split(const Keyframe& keyframe, std::vector<Descriptor>* descriptors) {
    std::vector<int64_t> masks(keyframe.observations.size(), 0);
    std::vector<std::vector<Descriptor>> on_observation(masks.size());
    std::vector<Feature> others;
    const std::vector<Feature> sorted = InOrder(keyframe.features, CompactOrder(keyframe.features));
    for (const Feature& feature : sorted) {
      const auto at = ObservationOf(keyframe, feature);
      const int64_t bit = int64_t{1} << feature.half_octave;
      // Ascending, so that they stand in the order of the mask's bits.
      if (at.has_value() && masks[*at] < bit) {
        masks[*at] |= bit;
        on_observation[*at].push_back(feature.descriptor);
      } else {
        others.push_back(feature);
      }
    }
    for (const auto& of : on_observation) {
      descriptors->insert(descriptors->end(), of.begin(), of.end());
    }
    for (const Feature& feature : others) descriptors->push_back(feature.descriptor);
    placed_.AddKeyframe(&others);
    std::vector<Feature> features;
    AppendObserved(keyframe, masks, &features);
    features.insert(features.end(), others.begin(), others.end());
    for (const int64_t mask : masks) {
      observed_.push_back(mask ^ last_mask_);
      last_mask_ = mask;
    }
    return features;
  }

  PlacedFeatureEncoder placed_;
  std::vector<int64_t> observed_;
  int64_t last_mask_ = 0;
  // With nothing but the rounded features in their order.
  std::vector<Keyframe> keyframes_;
};

// The masks of each keyframe's observations.
StatusOr<std::vector<std::vector<int64_t>>> DecodeMasks(const v1::FeatureColumns& columns,
                                                        const std::vector<Keyframe>& keyframes) {
  size_t total = 0;
  for (size_t k = 0; k < keyframes.size(); ++k) {
    if (columns.count(static_cast<int>(k)) > 0) total += keyframes[k].observations.size();
  }
  PORTOLAN_ASSIGN_OR_RETURN(const auto observed,
                            NamedColumn(columns.observed(), total, "submap.features.observed"));
  std::vector<std::vector<int64_t>> masks(keyframes.size());
  int64_t mask = 0;
  size_t at = 0;
  for (size_t k = 0; k < keyframes.size(); ++k) {
    if (columns.count(static_cast<int>(k)) == 0) continue;
    size_t described = 0;
    for (size_t i = 0; i < keyframes[k].observations.size(); ++i) {
      mask ^= observed[at++];
      if (mask < 0 || mask > kAllHalfOctaves) {
        return absl::InvalidArgumentError("submap.features.observed: half octave out of range");
      }
      described += static_cast<size_t>(std::popcount(static_cast<uint64_t>(mask)));
      masks[k].push_back(mask);
    }
    if (described > columns.count(static_cast<int>(k))) {
      return absl::InvalidArgumentError(
          absl::StrCat("submap.features.observed: more than the count of keyframe ", k));
    }
  }
  return masks;
}

Status DecodeCompact(const v1::FeatureColumns& columns, size_t total,
                     std::vector<Keyframe>* keyframes) {
  PORTOLAN_ASSIGN_OR_RETURN(const auto masks, DecodeMasks(columns, *keyframes));
  for (size_t k = 0; k < keyframes->size(); ++k) {
    AppendObserved((*keyframes)[k], masks[k], &(*keyframes)[k].features);
  }
  size_t others = total;
  for (const Keyframe& keyframe : *keyframes) others -= keyframe.features.size();
  PORTOLAN_ASSIGN_OR_RETURN(auto placed, PlacedFeatureDecoder::Create(columns, others));
  for (size_t k = 0; k < keyframes->size(); ++k) {
    auto& features = (*keyframes)[k].features;
    PORTOLAN_RETURN_IF_ERROR(
        placed.TakeKeyframe(columns.count(static_cast<int>(k)) - features.size(), &features));
    features = InOrder(features, CompactOrder(features));
  }
  auto descriptors = DecodeDescriptors(columns.coded_descriptors(), ReferencesOf(*keyframes));
  if (!descriptors.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat("submap.features.coded_descriptors: ", descriptors.status().message()));
  }
  size_t next = 0;
  for (Keyframe& keyframe : *keyframes) {
    for (Feature& feature : keyframe.features) feature.descriptor = (*descriptors)[next++];
  }
  return absl::OkStatus();
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

Status DecodePlain(const v1::FeatureColumns& columns, size_t total,
                   std::vector<Keyframe>* keyframes) {
  if (columns.descriptors().size() != kDescriptorBytes * total) {
    return absl::InvalidArgumentError(
        absl::StrCat("submap.features.descriptors: ", columns.descriptors().size(),
                     " bytes instead of ", kDescriptorBytes * total));
  }
  PORTOLAN_ASSIGN_OR_RETURN(auto placed, PlacedFeatureDecoder::Create(columns, total));
  size_t next = 0;
  for (size_t k = 0; k < keyframes->size(); ++k) {
    auto& features = (*keyframes)[k].features;
    PORTOLAN_RETURN_IF_ERROR(placed.TakeKeyframe(columns.count(static_cast<int>(k)), &features));
    for (Feature& feature : features) {
      feature.descriptor = DescriptorAt(columns.descriptors(), next++);
    }
  }
  return absl::OkStatus();
}

}  // namespace

void EncodeFeatures(const std::vector<Keyframe>& keyframes, v1::FeatureColumns* columns) {
  CompactEncoder encoder;
  for (const Keyframe& keyframe : keyframes) encoder.Add(keyframe);
  encoder.Write(columns);
}

Status DecodeFeatures(const v1::FeatureColumns& columns, std::vector<Keyframe>* keyframes) {
  PORTOLAN_RETURN_IF_ERROR(CheckCounts(columns.count(), keyframes->size(), kMaxFeaturesPerKeyframe,
                                       kMaxFeatures, "submap.features.count"));
  size_t total = 0;
  for (const uint32_t count : columns.count()) total += count;
  if (columns.compact() ? !columns.descriptors().empty()
                        : !columns.observed().empty() || !columns.coded_descriptors().empty()) {
    return absl::InvalidArgumentError("submap.features: fields of both forms");
  }
  return columns.compact() ? DecodeCompact(columns, total, keyframes)
                           : DecodePlain(columns, total, keyframes);
}

}  // namespace portolan
