#include "agent/tracker/corner_detector.h"

#include <algorithm>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

namespace portolan {
namespace {

// Window over which gradients are gathered, and the Sobel aperture.
constexpr int kWindowPx = 7;
constexpr int kSobelPx = 3;

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

// Local maxima above a threshold of a response map. The map is that of `cell` grown by one pixel
// where the image allows; `origin` is its top left pixel.
std::vector<Corner> LocalMaxima(const cv::Mat& response, const cv::Point& origin,
                                double min_response) {
  std::vector<Corner> corners;
  for (int y = 1; y + 1 < response.rows; ++y) {
    const float* above = response.ptr<float>(y - 1);
    const float* row = response.ptr<float>(y);
    const float* below = response.ptr<float>(y + 1);
    for (int x = 1; x + 1 < response.cols; ++x) {
      const float r = row[x];
      if (r < min_response || r < row[x - 1] || r <= row[x + 1]) continue;
      if (r < above[x] || r < above[x - 1] || r < above[x + 1]) continue;
      if (r <= below[x] || r <= below[x - 1] || r <= below[x + 1]) continue;
      const Eigen::Vector2d offset(ParabolaPeak(row[x - 1], r, row[x + 1]),
                                   ParabolaPeak(above[x], r, below[x]));
      corners.push_back({Eigen::Vector2d(origin.x + x, origin.y + y) + offset, r});
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

// Shi & Tomasi (CVPR 1994) and Harris & Stephens (1988): both read the 2x2 matrix of the mean
// gradient products over a window.
class GradientCornerDetector : public CornerDetector {
 public:
  GradientCornerDetector(bool harris, double threshold) : harris_(harris), threshold_(threshold) {}

  std::vector<Corner> Detect(const cv::Mat& gray, const cv::Rect& cell) const override {
    const cv::Rect grown = Grow(cell, 1, gray);
    if (grown.width < 3 || grown.height < 3) return {};
    cv::Mat response;
    // OpenCV scales gradients so that 8-bit images map to [0, 1]; undone by the factor 255^2 (per
    // squared gradient), to which the Sobel kernel's own sum adds nothing.
    if (harris_) {
      cv::cornerHarris(gray(grown), response, kWindowPx, kSobelPx, 0.04);
    } else {
      cv::cornerMinEigenVal(gray(grown), response, kWindowPx, kSobelPx);
    }
    const double unit = 255.0 * 255.0 * kScale;
    response *= harris_ ? unit * unit : unit;
    std::vector<Corner> corners = LocalMaxima(response, grown.tl(), threshold_);
    std::erase_if(corners, [&](const Corner& c) { return !IsInCell(cell, c.pixel); });
    return corners;
  }

 private:
  // cornerMinEigenVal uses a Sobel kernel normalised by 1 / (2^(aperture-1) * window * 255), and
  // an unnormalised box sum; a unit ramp thus gives (8 / (4 * 7 * 255))^2 * 49 = 4 / 255^2.
  static constexpr double kScale = 0.25;
  const bool harris_;
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
      return std::make_unique<GradientCornerDetector>(true, options.min_harris_response);
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
  return std::make_unique<GradientCornerDetector>(false, options.min_eigenvalue);
}

}  // namespace portolan
