// Corner detectors, exchangeable behind one interface. Each looks for corners in one cell of the
// image, so that only the empty cells of the tracker's grid cost time.
#ifndef PORTOLAN_AGENT_TRACKER_CORNER_DETECTOR_H_
#define PORTOLAN_AGENT_TRACKER_CORNER_DETECTOR_H_

#include <Eigen/Core>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "common/base/status.h"

namespace portolan {

enum class DetectorType { kShiTomasi, kHarris, kFast, kOrb, kSift };

struct DetectorOptions {
  DetectorType type = DetectorType::kShiTomasi;
  // Shi-Tomasi: least mean gradient energy in the weaker direction, (grey levels/px)^2. At 8,
  // sensor noise of 2 grey levels moves a 13 px patch by about 0.1 px.
  double min_eigenvalue = 8.0;
  // Harris: least response det - 0.04 trace^2 of the same matrix, (grey levels/px)^4.
  double min_harris_response = 100.0;
  // FAST and ORB: least contrast of the ring, grey levels.
  int fast_threshold = 10;
  // SIFT: contrast threshold in OpenCV's convention.
  double sift_contrast_threshold = 0.02;

  Status Validate() const;
};

struct Corner {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  // Comparable between corners of one detector only.
  double response = 0.0;
};

// Thread-compatible.
class CornerDetector {
 public:
  static std::unique_ptr<CornerDetector> Create(const DetectorOptions& options);
  virtual ~CornerDetector() = default;

  // Sub-pixel corners of `gray` (CV_8UC1) in `cell`, a rectangle inside the image; strongest
  // first, local maxima only. Pixels outside of the cell are read where the image has them.
  virtual std::vector<Corner> Detect(const cv::Mat& gray, const cv::Rect& cell) const = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_CORNER_DETECTOR_H_
