// Rotated BRIEF (Calonder et al., ECCV 2010; steered as in ORB, Rublee et al., ICCV 2011).
#ifndef PORTOLAN_COMMON_FEATURES_ROTATED_BRIEF_H_
#define PORTOLAN_COMMON_FEATURES_ROTATED_BRIEF_H_

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "common/features/descriptor.h"

namespace portolan {

// Pixels round a point that a description reads, and one more for rounding.
inline constexpr int kBriefBorderPx = 17;

// Angle in radians of the intensity centroid of the disc of radius 15 px about the point (Rosin
// 1999), x towards y. The point must lie kBriefBorderPx inside the image.
float IntensityCentroidAngle(const cv::Mat& gray, const Eigen::Vector2d& pixel);

// 256 brightness comparisons of point pairs about `pixel`, turned by `angle_rad`. `smoothed` is
// the image after a Gaussian blur of about 2 px; same border rule.
Descriptor DescribeRotatedBrief(const cv::Mat& smoothed, const Eigen::Vector2d& pixel,
                                float angle_rad);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_FEATURES_ROTATED_BRIEF_H_
