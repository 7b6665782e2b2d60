#include "common/features/feature_extractor.h"

#include <algorithm>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "common/features/rotated_brief.h"

namespace portolan {
namespace {

struct ScaleImage {
  cv::Mat gray;
  cv::Mat smoothed;
  double scale_x = 1.0, scale_y = 1.0;  // level pixels per image pixel

  Eigen::Vector2d FromImage(const Eigen::Vector2d& pixel) const {
    return {(pixel.x() + 0.5) * scale_x - 0.5, (pixel.y() + 0.5) * scale_y - 0.5};
  }
  Eigen::Vector2d ToImage(const Eigen::Vector2d& pixel) const {
    return {(pixel.x() + 0.5) / scale_x - 0.5, (pixel.y() + 0.5) / scale_y - 0.5};
  }
  bool Holds(const Eigen::Vector2d& pixel) const {
    return pixel.x() >= kBriefBorderPx && pixel.y() >= kBriefBorderPx &&
           pixel.x() <= gray.cols - 1 - kBriefBorderPx &&
           pixel.y() <= gray.rows - 1 - kBriefBorderPx;
  }
};

// Scales whose image is too small to describe a point are left out.
std::vector<ScaleImage> MakeScales(const cv::Mat& gray, int count) {
  std::vector<ScaleImage> scales;
  for (int half_octave = 0; half_octave < count; ++half_octave) {
    const double scale = std::pow(2.0, -0.5 * half_octave);
    const cv::Size size(cvRound(gray.cols * scale), cvRound(gray.rows * scale));
    if (std::min(size.width, size.height) <= 2 * kBriefBorderPx) break;
    ScaleImage level;
    if (half_octave == 0) {
      level.gray = gray;
    } else {
      cv::resize(gray, level.gray, size, 0, 0, cv::INTER_AREA);
    }
    cv::GaussianBlur(level.gray, level.smoothed, cv::Size(7, 7), 2.0);
    level.scale_x = static_cast<double>(size.width) / gray.cols;
    level.scale_y = static_cast<double>(size.height) / gray.rows;
    scales.push_back(std::move(level));
  }
  return scales;
}

DescribedPoint DescribeAt(const ScaleImage& level, int half_octave,
                          const Eigen::Vector2d& level_pixel) {
  DescribedPoint described;
  described.half_octave = static_cast<uint8_t>(half_octave);
  described.pixel = level.ToImage(level_pixel);
  described.descriptor = DescribeRotatedBrief(level.smoothed, level_pixel,
                                              IntensityCentroidAngle(level.smoothed, level_pixel));
  return described;
}

// Marks discs that are taken; one mask a scale.
class Occupancy {
 public:
  Occupancy(const cv::Size& size, double radius)
      : taken_(cv::Mat::zeros(size, CV_8UC1)), radius_(cvRound(radius)) {}
  bool IsTaken(const cv::Point2f& p) const {
    return taken_.at<uint8_t>(cvRound(p.y), cvRound(p.x)) != 0;
  }
  void Take(const cv::Point2f& p) {
    cv::circle(taken_, cv::Point(cvRound(p.x), cvRound(p.y)), radius_, cv::Scalar(255), -1);
  }

 private:
  cv::Mat taken_;
  const int radius_;
};

// The strongest FAST corners of one scale, spread by a least distance.
void AppendCorners(const ScaleImage& level, int half_octave, int max_count,
                   std::span<const Eigen::Vector2d> points, const FeatureExtractorOptions& options,
                   std::vector<DescribedPoint>* described) {
  std::vector<cv::KeyPoint> corners;
  cv::FAST(level.gray, corners, options.fast_threshold, true);
  std::stable_sort(
      corners.begin(), corners.end(),
      [](const cv::KeyPoint& a, const cv::KeyPoint& b) { return a.response > b.response; });
  Occupancy occupancy(level.gray.size(), options.min_distance_px);
  for (const Eigen::Vector2d& point : points) {
    const Eigen::Vector2d p = level.FromImage(point);
    if (level.Holds(p)) occupancy.Take(cv::Point2f(p.x(), p.y()));
  }
  int count = 0;
  for (const cv::KeyPoint& corner : corners) {
    if (count == max_count) break;
    const Eigen::Vector2d pixel(corner.pt.x, corner.pt.y);
    if (!level.Holds(pixel) || occupancy.IsTaken(corner.pt)) continue;
    occupancy.Take(corner.pt);
    described->push_back(DescribeAt(level, half_octave, pixel));
    ++count;
  }
}

std::vector<DescribedPoint> ExtractChecked(const cv::Mat& gray,
                                           std::span<const Eigen::Vector2d> points,
                                           const FeatureExtractorOptions& options) {
  const int corner_scales = options.max_extra_corners > 0 ? options.corner_half_octaves : 0;
  const std::vector<ScaleImage> scales =
      MakeScales(gray, std::max(options.half_octaves, corner_scales));
  std::vector<DescribedPoint> described;
  for (int i = 0; i < static_cast<int>(points.size()); ++i) {
    if (!points[i].allFinite()) continue;
    for (int s = 0; s < std::min<int>(options.half_octaves, scales.size()); ++s) {
      const Eigen::Vector2d pixel = scales[s].FromImage(points[i]);
      if (!scales[s].Holds(pixel)) continue;
      described.push_back(DescribeAt(scales[s], s, pixel));
      described.back().point_index = i;
    }
  }
  // Corners in proportion to the scale's area.
  const int used = std::min<int>(corner_scales, scales.size());
  double total = 0.0;
  for (int s = 0; s < used; ++s) total += std::pow(0.5, s);
  for (int s = 0; s < used; ++s) {
    const int count = static_cast<int>(options.max_extra_corners * std::pow(0.5, s) / total);
    AppendCorners(scales[s], s, count, points, options, &described);
  }
  return described;
}

}  // namespace

Status FeatureExtractorOptions::Validate() const {
  if (half_octaves < 0 || half_octaves > 8) {
    return absl::InvalidArgumentError("half_octaves must be in [0, 8]");
  }
  if (max_extra_corners < 0) return absl::InvalidArgumentError("max_extra_corners must be >= 0");
  if (corner_half_octaves < 1 || corner_half_octaves > 8) {
    return absl::InvalidArgumentError("corner_half_octaves must be in [1, 8]");
  }
  if (fast_threshold < 1 || fast_threshold > 255) {
    return absl::InvalidArgumentError("fast_threshold must be in [1, 255]");
  }
  if (!(min_distance_px >= 0.0)) {
    return absl::InvalidArgumentError("min_distance_px must be >= 0");
  }
  return absl::OkStatus();
}

StatusOr<std::vector<DescribedPoint>> ExtractFeatures(const cv::Mat& gray,
                                                      std::span<const Eigen::Vector2d> points,
                                                      const FeatureExtractorOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  if (gray.empty() || gray.type() != CV_8UC1) {
    return absl::InvalidArgumentError("features need a non-empty 8-bit grey image");
  }
  return ExtractChecked(gray, points, options);
}

}  // namespace portolan
