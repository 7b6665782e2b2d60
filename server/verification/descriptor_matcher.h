// Putative correspondences between the points of two submaps from their descriptors alone.
#ifndef PORTOLAN_SERVER_VERIFICATION_DESCRIPTOR_MATCHER_H_
#define PORTOLAN_SERVER_VERIFICATION_DESCRIPTOR_MATCHER_H_

#include <vector>

#include "server/verification/submap_points.h"

namespace portolan {

struct DescriptorMatcherOptions {
  // Descriptors that differ in more of the 256 bits are never taken for the same point.
  int max_distance_bits = 60;
  // The second nearest point in the same keyframe must be further by this factor.
  double max_ratio = 0.8;
  // ... where features nearer than this in the image (times their scale) are the same point.
  double same_point_px = 5.0;
  // Look-alikes kept a feature for the test for rivals.
  int max_alternatives = 3;
};

// Points a (of the first submap) and b (of the second), with the two keyframes in which their
// descriptors were nearest.
struct PointMatch {
  int a = 0;
  int b = 0;
  int distance_bits = 0;
  int keyframe_a = 0;
  int keyframe_b = 0;
};

struct DescriptorMatches {
  // Mutual nearest neighbours that pass the ratio test; one-to-one; ascending distance.
  std::vector<PointMatch> putative;
  // Everything that looks alike, without both tests; ascending (a, b), each pair once.
  std::vector<PointMatch> alternatives;
};

// Takes the nearest pairs first and leaves out those whose a or b is taken; ascending distance.
std::vector<PointMatch> KeepOneToOne(std::vector<PointMatch> matches, size_t count_a,
                                     size_t count_b);

DescriptorMatches MatchDescriptors(const SubmapPoints& a, const SubmapPoints& b,
                                   const DescriptorMatcherOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_VERIFICATION_DESCRIPTOR_MATCHER_H_
