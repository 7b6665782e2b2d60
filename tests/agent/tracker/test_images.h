// Images of an analytic texture under known warps, exact to the rounding of grey values.
#ifndef PORTOLAN_TESTS_AGENT_TRACKER_TEST_IMAGES_H_
#define PORTOLAN_TESTS_AGENT_TRACKER_TEST_IMAGES_H_

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <complex>
#include <opencv2/core/mat.hpp>
#include <random>
#include <vector>

#include "common/base/check.h"
#include "common/camera/camera_model.h"

namespace portolan {

// A sum of plane waves of random direction and phase: smooth, not periodic, corners everywhere.
class WaveTexture {
 public:
  explicit WaveTexture(uint32_t seed, double contrast = 45.0) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    for (int i = 0; i < kWaves; ++i) {
      const double length_px = 7.0 * std::pow(8.0, uniform(random));
      const double angle = 2.0 * M_PI * uniform(random);
      const double k = 2.0 * M_PI / length_px;
      waves_.push_back({k * std::cos(angle), k * std::sin(angle), 2.0 * M_PI * uniform(random)});
    }
    amplitude_ = contrast * std::sqrt(2.0 / kWaves);
  }
  // Values at start, start + step, start + 2 step ...
  void Sample(const Eigen::Vector2d& start, const Eigen::Vector2d& step,
              std::vector<double>* values) const {
    std::fill(values->begin(), values->end(), 127.0);
    for (const Wave& w : waves_) {
      const Eigen::Vector2d k(w.x, w.y);
      std::complex<double> phasor = std::polar(amplitude_, k.dot(start) + w.phase);
      const std::complex<double> turn = std::polar(1.0, k.dot(step));
      for (double& value : *values) {
        value += phasor.real();
        phasor *= turn;
      }
    }
  }

 private:
  static constexpr int kWaves = 24;
  struct Wave {
    double x, y, phase;
  };
  std::vector<Wave> waves_;
  double amplitude_ = 0.0;
};

// pixel = affine * texture point + shift; grey = gain * texture + offset.
struct View {
  Eigen::Matrix2d affine = Eigen::Matrix2d::Identity();
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();
  double gain = 1.0;
  double offset = 0.0;

  Eigen::Vector2d Map(const Eigen::Vector2d& texture_point) const {
    return affine * texture_point + shift;
  }
  Eigen::Vector2d Unmap(const Eigen::Vector2d& pixel) const {
    return affine.inverse() * (pixel - shift);
  }
};

inline cv::Mat Render(const WaveTexture& texture, const View& view, int width, int height) {
  cv::Mat image(height, width, CV_8UC1);
  const Eigen::Matrix2d inverse = view.affine.inverse();
  std::vector<double> row(width);
  for (int y = 0; y < height; ++y) {
    texture.Sample(inverse * (Eigen::Vector2d(0, y) - view.shift), inverse.col(0), &row);
    for (int x = 0; x < width; ++x) {
      const long value = std::lround(view.gain * row[x] + view.offset);
      image.at<uint8_t>(y, x) = static_cast<uint8_t>(std::clamp(value, 0l, 255l));
    }
  }
  return image;
}

inline Eigen::Matrix2d RotationScale(double angle_rad, double scale) {
  Eigen::Matrix2d m;
  m << std::cos(angle_rad), -std::sin(angle_rad), std::sin(angle_rad), std::cos(angle_rad);
  return scale * m;
}

inline CameraModel TestCamera(int width, int height) {
  CameraIntrinsics intrinsics;
  intrinsics.width_px = width;
  intrinsics.height_px = height;
  intrinsics.fx_px = intrinsics.fy_px = 0.8 * width;
  intrinsics.cx_px = 0.5 * (width - 1);
  intrinsics.cy_px = 0.5 * (height - 1);
  auto camera = CameraModel::Create(intrinsics);
  PORTOLAN_CHECK(camera.ok());
  return *camera;
}

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_TRACKER_TEST_IMAGES_H_
