// Rotated-BRIEF description of given image points at several scales, and of further corners found
// for place recognition. Used by the agents for keyframes and by the server for query images, so
// that all descriptors of a map compare.
#ifndef PORTOLAN_COMMON_FEATURES_FEATURE_EXTRACTOR_H_
#define PORTOLAN_COMMON_FEATURES_FEATURE_EXTRACTOR_H_

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "common/features/descriptor.h"

namespace portolan {

struct FeatureExtractorOptions {
  // Given points are described at half octaves 0 .. count-1 (scales 1, 1/sqrt(2), 1/2, ...).
  int half_octaves = 2;
  // Corners described besides the given points, at most.
  int max_extra_corners = 100;
  // Half octaves that are searched for further corners.
  int corner_half_octaves = 3;
  // FAST threshold of these, grey levels.
  int fast_threshold = 12;
  // Least distance between such corners and to the given points, pixels of their scale.
  double min_distance_px = 8.0;

  Status Validate() const;
};

struct DescribedPoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // of the full image
  uint8_t half_octave = 0;
  // Index of the given point, or -1 for a corner found here.
  int point_index = -1;
  Descriptor descriptor;
};

// Describes `points` (pixels; those too near to the image's edge at a scale are left out there)
// and then finds and describes further corners. gray: CV_8UC1, else InvalidArgument.
// Deterministic. Thread-safe.
StatusOr<std::vector<DescribedPoint>> ExtractFeatures(const cv::Mat& gray,
                                                      std::span<const Eigen::Vector2d> points,
                                                      const FeatureExtractorOptions& options);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_FEATURES_FEATURE_EXTRACTOR_H_
