#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>
#include <unordered_set>

#include "absl/strings/str_cat.h"
#include "common/wire/column_codec.h"
#include "common/wire/submap_columns.h"
#include "common/wire/submap_validation.h"

namespace portolan {
namespace {

constexpr int kStepsPerPixel = 32;
constexpr int64_t kMaxSteps = static_cast<int64_t>(kMaxPixel_px) * kStepsPerPixel;
constexpr int kSigmaCodeOfOne = 64;
constexpr int kSigmaCodesPerOctave = 16;
constexpr int kMaxSigmaCode = 255;

using Steps = std::array<int64_t, 2>;
// Where a track was last seen.
using LastSeen = std::unordered_map<uint32_t, Steps>;

Steps ToSteps(const Eigen::Vector2f& pixel) {
  return {std::llround(static_cast<double>(pixel.x()) * kStepsPerPixel),
          std::llround(static_cast<double>(pixel.y()) * kStepsPerPixel)};
}
Eigen::Vector2f FromSteps(const Steps& steps) {
  return Eigen::Vector2f(static_cast<float>(steps[0]), static_cast<float>(steps[1])) /
         kStepsPerPixel;
}

int64_t SigmaCode(float sigma_px) {
  const int64_t code = kSigmaCodeOfOne + std::llround(kSigmaCodesPerOctave * std::log2(sigma_px));
  return std::clamp<int64_t>(code, 0, kMaxSigmaCode);
}
float SigmaOf(int64_t code) {
  return static_cast<float>(
      std::exp2(static_cast<double>(code - kSigmaCodeOfOne) / kSigmaCodesPerOctave));
}

int64_t Median(std::vector<int64_t>* values) {
  if (values->empty()) return 0;
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

// Median motion of the tracks of this keyframe that were seen before.
Steps MedianShift(const Keyframe& keyframe, const LastSeen& last_seen) {
  std::array<std::vector<int64_t>, 2> motion;
  for (const Observation& observation : keyframe.observations) {
    const auto seen = last_seen.find(observation.track.value());
    if (seen == last_seen.end()) continue;
    const Steps steps = ToSteps(observation.pixel);
    for (size_t axis = 0; axis < 2; ++axis) {
      motion[axis].push_back(steps[axis] - seen->second[axis]);
    }
  }
  return {Median(&motion[0]), Median(&motion[1])};
}

struct Columns {
  std::vector<int64_t> track, shift, sigma;
  std::array<std::vector<int64_t>, 2> first, delta;
};

class ObservationEncoder {
 public:
  void Add(const Keyframe& keyframe) {
    const Steps shift = MedianShift(keyframe, last_seen_);
    columns_.shift.insert(columns_.shift.end(), shift.begin(), shift.end());
    for (const Observation& observation : keyframe.observations) {
      const bool is_first = &observation == &keyframe.observations.front();
      AddTrack(observation.track.value(), is_first);
      AddPixel(observation, shift);
      const int64_t code = SigmaCode(observation.sigma_px);
      columns_.sigma.push_back(code - sigma_code_);
      sigma_code_ = code;
    }
  }
  const Columns& columns() const { return columns_; }

 private:
  void AddTrack(int64_t track, bool is_first_of_keyframe) {
    if (is_first_of_keyframe) {
      columns_.track.push_back(track - keyframe_first_track_);
      keyframe_first_track_ = track;
    } else {
      columns_.track.push_back(track - 1 - previous_track_);
    }
    previous_track_ = track;
  }
  void AddPixel(const Observation& observation, const Steps& shift) {
    const Steps steps = ToSteps(observation.pixel);
    const auto [seen, is_new] = last_seen_.try_emplace(observation.track.value(), steps);
    for (size_t axis = 0; axis < 2; ++axis) {
      if (is_new) {
        columns_.first[axis].push_back(steps[axis] - previous_first_[axis]);
      } else {
        columns_.delta[axis].push_back(steps[axis] - seen->second[axis] - shift[axis]);
      }
    }
    if (is_new) previous_first_ = steps;
    seen->second = steps;
  }

  Columns columns_;
  LastSeen last_seen_;
  Steps previous_first_{};
  int64_t keyframe_first_track_ = 0;
  int64_t previous_track_ = 0;
  int64_t sigma_code_ = kSigmaCodeOfOne;
};

Status OutOfRange(size_t keyframe, size_t observation, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat("submap.observations.", what, ": keyframe ",
                                                 keyframe, ", observation ", observation,
                                                 ": out of range"));
}

StatusOr<std::vector<int64_t>> DecodeTracks(const v1::ObservationColumns& message, size_t total) {
  PORTOLAN_ASSIGN_OR_RETURN(auto tracks,
                            NamedColumn(message.track(), total, "submap.observations.track"));
  int64_t keyframe_first_track = 0;
  size_t at = 0;
  for (int k = 0; k < message.count_size(); ++k) {
    for (uint32_t i = 0; i < message.count(k); ++i, ++at) {
      const int64_t base = i == 0 ? keyframe_first_track : tracks[at - 1] + 1;
      const auto track = AddWithin(base, tracks[at], UINT32_MAX);
      if (!track.has_value() || *track < 0) return OutOfRange(static_cast<size_t>(k), i, "track");
      tracks[at] = *track;
      if (i == 0) keyframe_first_track = *track;
    }
  }
  return tracks;
}

// Replays the pixels of all observations in order.
class PixelDecoder {
 public:
  static StatusOr<PixelDecoder> Create(const v1::ObservationColumns& message,
                                       const std::vector<int64_t>& tracks) {
    PixelDecoder decoder;
    const size_t firsts = std::unordered_set<int64_t>(tracks.begin(), tracks.end()).size();
    const size_t deltas = tracks.size() - firsts;
    const size_t shifts = 2 * static_cast<size_t>(message.count_size());
    auto& c = decoder.columns_;
    PORTOLAN_ASSIGN_OR_RETURN(
        c.first[0], NamedColumn(message.first_x(), firsts, "submap.observations.first_x"));
    PORTOLAN_ASSIGN_OR_RETURN(
        c.first[1], NamedColumn(message.first_y(), firsts, "submap.observations.first_y"));
    PORTOLAN_ASSIGN_OR_RETURN(
        c.delta[0], NamedColumn(message.delta_x(), deltas, "submap.observations.delta_x"));
    PORTOLAN_ASSIGN_OR_RETURN(
        c.delta[1], NamedColumn(message.delta_y(), deltas, "submap.observations.delta_y"));
    PORTOLAN_ASSIGN_OR_RETURN(c.shift,
                              NamedColumn(message.shift(), shifts, "submap.observations.shift"));
    return decoder;
  }

  // No value if the pixel leaves the range.
  std::optional<Eigen::Vector2f> Next(size_t keyframe, uint32_t track) {
    const auto [seen, is_new] = last_seen_.try_emplace(track, Steps{});
    Steps steps;
    for (size_t axis = 0; axis < 2; ++axis) {
      std::optional<int64_t> value;
      if (is_new) {
        value = AddWithin(previous_first_[axis], columns_.first[axis][next_first_], kMaxSteps);
      } else {
        const auto moved =
            AddWithin(seen->second[axis], columns_.shift[2 * keyframe + axis], 4 * kMaxSteps);
        if (!moved.has_value()) return std::nullopt;
        value = AddWithin(*moved, columns_.delta[axis][next_delta_], kMaxSteps);
      }
      if (!value.has_value()) return std::nullopt;
      steps[axis] = *value;
    }
    if (is_new) previous_first_ = steps;
    (is_new ? next_first_ : next_delta_) += 1;
    seen->second = steps;
    return FromSteps(steps);
  }

 private:
  Columns columns_;
  LastSeen last_seen_;
  Steps previous_first_{};
  size_t next_first_ = 0;
  size_t next_delta_ = 0;
};

}  // namespace

void EncodeObservations(const std::vector<Keyframe>& keyframes, v1::ObservationColumns* columns) {
  ObservationEncoder encoder;
  for (const Keyframe& keyframe : keyframes) {
    columns->add_count(static_cast<uint32_t>(keyframe.observations.size()));
    encoder.Add(keyframe);
  }
  const Columns& c = encoder.columns();
  columns->set_track(EncodeColumn(c.track));
  columns->set_first_x(EncodeColumn(c.first[0]));
  columns->set_first_y(EncodeColumn(c.first[1]));
  columns->set_delta_x(EncodeColumn(c.delta[0]));
  columns->set_delta_y(EncodeColumn(c.delta[1]));
  columns->set_shift(EncodeColumn(c.shift));
  columns->set_sigma(EncodeColumn(c.sigma));
}

Status DecodeObservations(const v1::ObservationColumns& columns, std::vector<Keyframe>* keyframes) {
  PORTOLAN_RETURN_IF_ERROR(CheckCounts(columns.count(), keyframes->size(),
                                       kMaxObservationsPerKeyframe, kMaxObservations,
                                       "submap.observations.count"));
  size_t total = 0;
  for (const uint32_t count : columns.count()) total += count;
  PORTOLAN_ASSIGN_OR_RETURN(const auto tracks, DecodeTracks(columns, total));
  PORTOLAN_ASSIGN_OR_RETURN(const auto sigmas,
                            NamedColumn(columns.sigma(), total, "submap.observations.sigma"));
  PORTOLAN_ASSIGN_OR_RETURN(PixelDecoder pixels, PixelDecoder::Create(columns, tracks));
  int64_t sigma_code = kSigmaCodeOfOne;
  size_t at = 0;
  for (size_t k = 0; k < keyframes->size(); ++k) {
    auto& observations = (*keyframes)[k].observations;
    observations.resize(columns.count(static_cast<int>(k)));
    for (size_t i = 0; i < observations.size(); ++i, ++at) {
      observations[i].track = TrackId(static_cast<uint32_t>(tracks[at]));
      const auto pixel = pixels.Next(k, observations[i].track.value());
      if (!pixel.has_value()) return OutOfRange(k, i, "pixel");
      observations[i].pixel = *pixel;
      const auto code = AddWithin(sigma_code, sigmas[at], kMaxSigmaCode);
      if (!code.has_value() || *code < 0) return OutOfRange(k, i, "sigma");
      sigma_code = *code;
      observations[i].sigma_px = SigmaOf(sigma_code);
    }
  }
  return absl::OkStatus();
}

}  // namespace portolan
