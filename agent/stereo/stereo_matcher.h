// Depths from a second camera.
#ifndef PORTOLAN_AGENT_STEREO_STEREO_MATCHER_H_
#define PORTOLAN_AGENT_STEREO_STEREO_MATCHER_H_

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <vector>

#include "agent/filter/measurement.h"
#include "agent/tracker/image_pyramid.h"
#include "common/base/status.h"
#include "common/camera/camera_model.h"
#include "common/geometry/rigid3.h"

namespace portolan {

// The second camera and where it sits, metres. The images of both are taken at the same instant.
struct StereoMount {
  CameraModel camera;
  Rigid3 camera_from_first;
};

struct StereoOptions {
  // Nothing nearer is looked for, m: twice as near is twice as far to search.
  double nearest_m = 0.3;
  // Least zero-mean normalised cross-correlation of the two cameras' views of a patch.
  double min_correlation = 0.85;
  // A match farther than this from its epipolar curve, px, is none.
  double max_epipolar_px = 2.0;
  // Error of the cameras' calibration towards each other, px, on top of the match's own.
  double calibration_sigma_px = 0.3;
  // Pyramid levels above the images for the search along the epipolar curve.
  int pyramid_levels = 3;

  Status Validate() const;
};

// Finds the first camera's points in the second camera's image: starts along the epipolar curve
// (points of equal steps of inverse distance, so of about equal steps of the image), the best one
// refined by pyramidal flow and by alignment of the patch; the inverse distance is what puts the
// projection nearest to the match (Gauss-Newton in one unknown). Thread-compatible.
class StereoMatcher {
 public:
  StereoMatcher(const StereoOptions& options, const CameraModel& first, const StereoMount& mount);

  // CV_8UC1 of the cameras' sizes. The pixels are shared, and read when depths are asked for first.
  void SetImages(const cv::Mat& first, const cv::Mat& second);

  // 1 / distance from the first camera along the pixel's ray, 1/m, and its sigma; no value if the
  // pixel is not found or found where no depth would put it. Not below a thousandth of 1/m.
  struct Depth {
    double inverse_depth = 0;
    double sigma = 0;
  };
  std::optional<Depth> Measure(const Eigen::Vector2d& pixel);

  // Those of the points that are found, as lengths that owe nothing to the filter.
  std::vector<MeasuredDepth> Measure(std::span<const Measurement> points);

 private:
  // Where a point of the first camera's ray is seen.
  std::optional<Eigen::Vector2d> Predict(const Eigen::Vector3d& ray, double inverse_depth,
                                         Eigen::Vector2d* d_pixel_d_inverse_depth) const;
  // The start that is nearest to the match, brought to the least distance from it.
  std::optional<Depth> FitDepth(const Eigen::Vector3d& ray, double start,
                                const Eigen::Vector2d& match, double sigma_px) const;

  const StereoOptions options_;
  const CameraModel first_;
  const StereoMount mount_;
  cv::Mat first_image_;
  cv::Mat second_image_;
  bool has_pyramids_ = false;  // of these images
  ImagePyramid first_pyramid_;
  ImagePyramid second_pyramid_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_STEREO_STEREO_MATCHER_H_
