// Which tracks of a submap are worth their bytes.
#ifndef PORTOLAN_AGENT_SUBMAP_TRACK_SELECTION_H_
#define PORTOLAN_AGENT_SUBMAP_TRACK_SELECTION_H_

#include <unordered_set>

#include "common/submap/submap.h"

namespace portolan {

// Leaves so many observations in a keyframe, of those tracks that most keyframes see: a sight of a
// long track costs as much as one of a short track and tells more. preferred: tracks that go before
// others with up to four sights more. Described points and landmarks of
// the other tracks go as well.
void KeepLongestTracks(int max_observations, const std::unordered_set<TrackId>& preferred,
                       Submap* submap);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_SUBMAP_TRACK_SELECTION_H_
