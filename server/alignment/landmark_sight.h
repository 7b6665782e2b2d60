// A track of one submap, as the name of what it shows.
#ifndef PORTOLAN_SERVER_ALIGNMENT_LANDMARK_SIGHT_H_
#define PORTOLAN_SERVER_ALIGNMENT_LANDMARK_SIGHT_H_

#include <compare>

#include "common/base/strong_id.h"

namespace portolan {

// A track of a submap that sees a fused landmark.
struct LandmarkSight {
  SubmapId submap;
  TrackId track;

  friend bool operator==(const LandmarkSight&, const LandmarkSight&) = default;
  friend auto operator<=>(const LandmarkSight&, const LandmarkSight&) = default;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_LANDMARK_SIGHT_H_
