#include "agent/tracker/corner_detector.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/features2d.hpp>

#include "agent/tracker/response_map.h"

namespace portolan {
namespace {

void SortByResponse(std::vector<Corner>* corners) {
  std::sort(corners->begin(), corners->end(), [](const Corner& a, const Corner& b) {
    if (a.response != b.response) return a.response > b.response;
    if (a.pixel.y() != b.pixel.y()) return a.pixel.y() < b.pixel.y();
    return a.pixel.x() < b.pixel.x();
  });
}

// Offset in [-0.5, 0.5] of the maximum of the parabola through three equidistant values.
double ParabolaPeak(double left, double centre, double right) {
  const double curvature = left - 2.0 * centre + right;
  if (curvature >= 0.0) return 0.0;
  return std::clamp(0.5 * (left - right) / curvature, -0.5, 0.5);
}

// Local maxima above a threshold of a response map over `area`; its outermost pixels only compete.
std::vector<Corner> LocalMaxima(const std::vector<float>& response, const cv::Rect& area,
                                double min_response) {
  // The least response that is not below the threshold, to compare it as it is stored.
  float least = static_cast<float>(min_response);
  if (least < min_response) least = std::nextafter(least, std::numeric_limits<float>::infinity());
  std::vector<Corner> corners;
  for (int y = 1; y + 1 < area.height; ++y) {
    const float* row = response.data() + static_cast<size_t>(y) * area.width;
    const float* above = row - area.width;
    const float* below = row + area.width;
    for (int x = 1; x + 1 < area.width; ++x) {
      const float r = row[x];
      if (r < least || r < row[x - 1] || r <= row[x + 1]) continue;
      if (r < above[x] || r < above[x - 1] || r < above[x + 1]) continue;
      if (r <= below[x] || r <= below[x - 1] || r <= below[x + 1]) continue;
      const Eigen::Vector2d offset(ParabolaPeak(row[x - 1], r, row[x + 1]),
                                   ParabolaPeak(above[x], r, below[x]));
      corners.push_back({Eigen::Vector2d(area.x + x, area.y + y) + offset, r});
    }
  }
  SortByResponse(&corners);
  return corners;
}

cv::Rect Grow(const cv::Rect& cell, int margin, const cv::Mat& gray) {
  return cv::Rect(cell.x - margin, cell.y - margin, cell.width + 2 * margin,
                  cell.height + 2 * margin) &
         cv::Rect(0, 0, gray.cols, gray.rows);
}

bool IsInCell(const cv::Rect& cell, const Eigen::Vector2d& pixel) {
  return pixel.x() >= cell.x - 0.5 && pixel.x() < cell.x + cell.width - 0.5 &&
         pixel.y() >= cell.y - 0.5 && pixel.y() < cell.y + cell.height - 0.5;
}

class GradientCornerDetector : public CornerDetector {
 public:
  GradientCornerDetector(CornerMeasure measure, double threshold)
      : measure_(measure), threshold_(threshold) {}

  std::vector<Corner> Detect(const cv::Mat& gray, const cv::Rect& cell) const override {
    const cv::Rect grown = Grow(cell, 1, gray);
    if (grown.width < 3 || grown.height < 3) return {};
    std::vector<Corner> corners =
        LocalMaxima(ComputeResponse(gray, grown, measure_), grown, threshold_);
    std::erase_if(corners, [&](const Corner& c) { return !IsInCell(cell, c.pixel); });
    return corners;
  }

 private:
  const CornerMeasure measure_;
  const double threshold_;
};

// Any keypoint detector of OpenCV, run on the cell with a margin for its support.
class KeypointCornerDetector : public CornerDetector {
 public:
  KeypointCornerDetector(cv::Ptr<cv::Feature2D> detector, int margin_px)
      : detector_(std::move(detector)), margin_px_(margin_px) {}

  std::vector<Corner> Detect(const cv::Mat& gray, const cv::Rect& cell) const override {
    const cv::Rect grown = Grow(cell, margin_px_, gray);
    if (grown.width <= 2 * margin_px_ || grown.height <= 2 * margin_px_) return {};
    std::vector<cv::KeyPoint> keypoints;
    detector_->detect(gray(grown), keypoints);
    std::vector<Corner> corners;
    for (const cv::KeyPoint& keypoint : keypoints) {
      const Eigen::Vector2d pixel(keypoint.pt.x + grown.x, keypoint.pt.y + grown.y);
      if (IsInCell(cell, pixel)) corners.push_back({pixel, keypoint.response});
    }
    SortByResponse(&corners);
    return corners;
  }

 private:
  cv::Ptr<cv::Feature2D> detector_;
  const int margin_px_;
};

}  // namespace

Status DetectorOptions::Validate() const {
  if (!(min_eigenvalue > 0.0)) return absl::InvalidArgumentError("min_eigenvalue must be > 0");
  if (!(min_harris_response > 0.0)) {
    return absl::InvalidArgumentError("min_harris_response must be > 0");
  }
  if (fast_threshold < 1 || fast_threshold > 255) {
    return absl::InvalidArgumentError("fast_threshold must be in [1, 255]");
  }
  if (!(sift_contrast_threshold > 0.0)) {
    return absl::InvalidArgumentError("sift_contrast_threshold must be > 0");
  }
  return absl::OkStatus();
}

std::unique_ptr<CornerDetector> CornerDetector::Create(const DetectorOptions& options) {
  switch (options.type) {
    case DetectorType::kHarris:
      return std::make_unique<GradientCornerDetector>(CornerMeasure::kHarris,
                                                      options.min_harris_response);
    case DetectorType::kFast:
      return std::make_unique<KeypointCornerDetector>(
          cv::FastFeatureDetector::create(options.fast_threshold, true), 4);
    case DetectorType::kOrb:
      return std::make_unique<KeypointCornerDetector>(
          cv::ORB::create(50, 1.2f, 1, 16, 0, 2, cv::ORB::HARRIS_SCORE, 31, options.fast_threshold),
          16);
    case DetectorType::kSift:
      return std::make_unique<KeypointCornerDetector>(
          cv::SIFT::create(0, 3, options.sift_contrast_threshold), 8);
    case DetectorType::kShiTomasi:
      break;
  }
  return std::make_unique<GradientCornerDetector>(CornerMeasure::kSmallEigenvalue,
                                                  options.min_eigenvalue);
}

}  // namespace portolan
