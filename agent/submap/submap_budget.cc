#include "agent/submap/submap_budget.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "agent/submap/track_selection.h"

namespace portolan {
namespace {

// Means over recorded sequences (portolan-wire-sizes).
constexpr double kBytesPerFeature = 14.7;
constexpr double kBytesPerObservation = 3.5;
constexpr double kBytesPerKeyframe = 118;
constexpr double kBytesPerLandmark = 37;
constexpr double kBytesPerFrame = 15;
constexpr double kOtherBytes = 170;

// A described point and what it is worth: 0 on no track, else the sights of its track.
struct RankedFeature {
  int sights;
  size_t keyframe, index;
};

std::unordered_map<TrackId, int> CountSights(const Submap& submap) {
  std::unordered_map<TrackId, int> sights;
  for (const Keyframe& keyframe : submap.keyframes) {
    for (const Observation& observation : keyframe.observations) ++sights[observation.track];
  }
  return sights;
}

// Least valuable first; of equals the later in its keyframe, which is the weaker corner.
std::vector<RankedFeature> RankFeatures(const Submap& submap) {
  const auto sights = CountSights(submap);
  std::vector<RankedFeature> ranked;
  for (size_t k = 0; k < submap.keyframes.size(); ++k) {
    const auto& features = submap.keyframes[k].features;
    for (size_t i = 0; i < features.size(); ++i) {
      const auto of_track = features[i].track ? sights.find(*features[i].track) : sights.end();
      ranked.push_back({of_track == sights.end() ? 0 : of_track->second, k, i});
    }
  }
  std::stable_sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) {
    return a.sights != b.sights ? a.sights < b.sights : a.index > b.index;
  });
  return ranked;
}

void RemoveFeatures(const std::vector<RankedFeature>& ranked, size_t count, Submap* submap) {
  std::vector<std::vector<bool>> leave_out(submap->keyframes.size());
  for (size_t k = 0; k < leave_out.size(); ++k) {
    leave_out[k].resize(submap->keyframes[k].features.size(), false);
  }
  for (size_t r = 0; r < count; ++r) leave_out[ranked[r].keyframe][ranked[r].index] = true;
  for (size_t k = 0; k < leave_out.size(); ++k) {
    std::vector<Feature> kept;
    for (size_t i = 0; i < leave_out[k].size(); ++i) {
      if (!leave_out[k][i]) kept.push_back(submap->keyframes[k].features[i]);
    }
    submap->keyframes[k].features = std::move(kept);
  }
}

size_t CountFeatures(const Submap& submap) {
  size_t count = 0;
  for (const Keyframe& keyframe : submap.keyframes) count += keyframe.features.size();
  return count;
}

}  // namespace

Status SubmapBudgetOptions::Validate() const {
  if (!(bytes_per_second >= 0)) {
    return absl::InvalidArgumentError("budget.bytes_per_second must not be negative");
  }
  if (!(burst_bytes >= 0)) {
    return absl::InvalidArgumentError("budget.burst_bytes must not be negative");
  }
  if (min_observations < 0) {
    return absl::InvalidArgumentError("budget.min_observations is negative");
  }
  if (min_features < 0) return absl::InvalidArgumentError("budget.min_features is negative");
  return absl::OkStatus();
}

double EstimateSubmapBytes(const Submap& submap) {
  size_t observations = 0, features = 0;
  for (const Keyframe& keyframe : submap.keyframes) {
    observations += keyframe.observations.size();
    features += keyframe.features.size();
  }
  return kOtherBytes + kBytesPerFeature * static_cast<double>(features) +
         kBytesPerObservation * static_cast<double>(observations) +
         kBytesPerKeyframe * static_cast<double>(submap.keyframes.size()) +
         kBytesPerLandmark * static_cast<double>(submap.landmarks.size()) +
         kBytesPerFrame * static_cast<double>(submap.frames.size());
}

int SubmapBudget::Fit(Submap* submap) {
  if (options_.bytes_per_second == 0 || submap->keyframes.empty()) return 0;
  const Timestamp begin = last_time_.value_or(submap->keyframes.front().time);
  last_time_ = submap->keyframes.back().time;
  bytes_ = std::min(bytes_ + options_.bytes_per_second * ToSeconds(*last_time_ - begin),
                    options_.burst_bytes);
  const size_t features_before = CountFeatures(*submap);
  LeaveOutTracks(EstimateSubmapBytes(*submap) - bytes_, submap);
  const double excess = EstimateSubmapBytes(*submap) - bytes_;
  if (excess > 0) {
    const std::vector<RankedFeature> ranked = RankFeatures(*submap);
    const auto spare = std::max<std::ptrdiff_t>(
        0, static_cast<std::ptrdiff_t>(ranked.size()) - options_.min_features);
    const auto count = std::min(static_cast<size_t>(std::ceil(excess / kBytesPerFeature)),
                                static_cast<size_t>(spare));
    RemoveFeatures(ranked, count, submap);
  }
  bytes_ -= EstimateSubmapBytes(*submap);
  return static_cast<int>(features_before - CountFeatures(*submap));
}

void SubmapBudget::LeaveOutTracks(double excess_bytes, Submap* submap) const {
  if (excess_bytes <= 0) return;
  size_t observations = 0;
  for (const Keyframe& keyframe : submap->keyframes) observations += keyframe.observations.size();
  const auto keyframes = static_cast<double>(submap->keyframes.size());
  const double fit =
      (static_cast<double>(observations) - excess_bytes / kBytesPerObservation) / keyframes;
  std::unordered_set<TrackId> preferred;
  for (const SubmapLandmark& landmark : submap->landmarks) preferred.insert(landmark.track);
  KeepLongestTracks(std::max(options_.min_observations, static_cast<int>(fit)), preferred, submap);
}

}  // namespace portolan
