// Further matches between two submaps once their relation is known.
#ifndef PORTOLAN_SERVER_VERIFICATION_GUIDED_MATCHER_H_
#define PORTOLAN_SERVER_VERIFICATION_GUIDED_MATCHER_H_

#include <vector>

#include "common/geometry/similarity3.h"
#include "server/verification/descriptor_matcher.h"
#include "server/verification/submap_points.h"

namespace portolan {

struct GuidedMatcherOptions {
  // Looser than without guidance, since only few features lie near the prediction.
  int max_distance_bits = 60;
  // Within the search region, too, the second nearest point must be further by this factor.
  double max_ratio = 0.85;
  // Search region: this many standard deviations of the predicted pixel ...
  double sigmas = 3.0;
  // ... which include this much for the relation's own error, and at most so many pixels.
  double relation_sigma_px = 2.0;
  double max_radius_px = 12.0;
};

// Where a landmark of one side should be seen in a described keyframe of the other.
struct PredictedSight {
  bool of_a = true;  // whose landmark it is
  int point = 0;
  int keyframe = 0;  // of the other side
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

// How much of one submap should be seen in the other's described keyframes.
struct GuidedMatches {
  // One-to-one, ascending distance.
  std::vector<PointMatch> matches;
  // Landmarks of either side that should be visible in a described keyframe of the other.
  int predicted = 0;
  // All of their sights.
  std::vector<PredictedSight> sights;
};

// Projects the landmarks of each side into the described keyframes of the other and compares
// descriptors with the features near the prediction.
GuidedMatches MatchGuided(const SubmapPoints& a, const SubmapPoints& b, const Similarity3& a_from_b,
                          const GuidedMatcherOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_GUIDED_MATCHER_H_
