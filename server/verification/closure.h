// A verified relation between two submaps that are not neighbours in one session.
#ifndef PORTOLAN_SERVER_VERIFICATION_CLOSURE_H_
#define PORTOLAN_SERVER_VERIFICATION_CLOSURE_H_

#include <vector>

#include "common/base/strong_id.h"
#include "common/geometry/similarity3.h"

namespace portolan {

// Track `in_a` of submap a and track `in_b` of submap b are the same physical point: the
// constraint equation world_from_a * p_a - world_from_b * p_b = 0.
struct LandmarkMatch {
  TrackId in_a;
  TrackId in_b;

  friend bool operator==(const LandmarkMatch&, const LandmarkMatch&) = default;
};

struct Closure {
  SubmapId a;
  SubmapId b;
  Similarity3 a_from_b;
  // Of the right perturbation of a_from_b ([translation; rotation; log scale]); positive definite.
  Matrix7d information = Matrix7d::Identity();
  std::vector<LandmarkMatch> matches;
  // Root mean square reprojection error of the matches, both ways.
  double rms_px = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_CLOSURE_H_
