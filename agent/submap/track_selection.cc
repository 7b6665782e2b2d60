#include "agent/submap/track_selection.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

namespace portolan {
namespace {

constexpr int kPreferenceSights = 4;

std::map<TrackId, std::vector<size_t>> KeyframesOfTracks(const Submap& submap) {
  std::map<TrackId, std::vector<size_t>> keyframes;
  for (size_t k = 0; k < submap.keyframes.size(); ++k) {
    for (const Observation& observation : submap.keyframes[k].observations) {
      keyframes[observation.track].push_back(k);
    }
  }
  return keyframes;
}

}  // namespace

void KeepLongestTracks(int max_observations, const std::unordered_set<TrackId>& preferred,
                       Submap* submap) {
  const auto keyframes_of = KeyframesOfTracks(*submap);
  std::vector<std::pair<int, TrackId>> ranked;
  for (const auto& [track, keyframes] : keyframes_of) {
    const int bonus = preferred.contains(track) ? kPreferenceSights : 0;
    ranked.emplace_back(-static_cast<int>(keyframes.size()) - bonus, track);
  }
  std::sort(ranked.begin(), ranked.end());
  std::vector<int> room(submap->keyframes.size(), max_observations);
  std::unordered_set<TrackId> kept;
  for (const auto& [rank, track] : ranked) {
    const std::vector<size_t>& keyframes = keyframes_of.at(track);
    const auto has_room = [&room](size_t k) { return room[k] > 0; };
    if (!std::all_of(keyframes.begin(), keyframes.end(), has_room)) continue;
    for (const size_t k : keyframes) --room[k];
    kept.insert(track);
  }
  std::erase_if(submap->landmarks,
                [&kept](const SubmapLandmark& landmark) { return !kept.contains(landmark.track); });
  for (Keyframe& keyframe : submap->keyframes) {
    std::erase_if(keyframe.observations, [&kept](const Observation& observation) {
      return !kept.contains(observation.track);
    });
    std::erase_if(keyframe.features, [&kept](const Feature& feature) {
      return feature.track && !kept.contains(*feature.track);
    });
  }
}

}  // namespace portolan
