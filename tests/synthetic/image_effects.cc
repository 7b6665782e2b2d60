#include "tests/synthetic/image_effects.h"

#include <algorithm>
#include <cmath>

#include "tests/synthetic/random.h"

namespace portolan::synthetic {
namespace {

constexpr size_t kNoiseTableSize = 1 << 18;

cv::Mat1f MakeVignette(cv::Size size, double loss) {
  cv::Mat1f vignette(size);
  const cv::Point2d centre(0.5 * size.width, 0.5 * size.height);
  const double corner_squared = centre.dot(centre);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const cv::Point2d offset = cv::Point2d(x, y) - centre;
      vignette(y, x) = static_cast<float>(1.0 - loss * offset.dot(offset) / corner_squared);
    }
  }
  return vignette;
}

}  // namespace

ImageEffects::ImageEffects(const ImageEffectsOptions& options) : options_(options) {
  Random random(options.seed);
  noise_.resize(kNoiseTableSize);
  for (float& value : noise_) value = static_cast<float>(options.noise_sigma * random.Normal());
}

void ImageEffects::Apply(const cv::Mat1f& light, int frame, double time_s, cv::Mat1b* image) {
  if (vignette_.size() != light.size()) vignette_ = MakeVignette(light.size(), options_.vignetting);
  Random random(options_.seed * 1000003 + static_cast<uint64_t>(frame));
  const double phase = 2 * M_PI * (time_s / options_.exposure_period_s + 0.1 * options_.seed);
  const float gain = static_cast<float>(1.0 + options_.exposure_swing * std::sin(phase));
  image->create(light.size());
  const int last_start = static_cast<int>(noise_.size()) - light.cols;
  for (int y = 0; y < light.rows; ++y) {
    const float* noise = &noise_[static_cast<size_t>(random.Index(last_start))];
    const float* from = light[y];
    const float* vignette = vignette_[y];
    uint8_t* to = (*image)[y];
    for (int x = 0; x < light.cols; ++x) {
      const float grey = gain * vignette[x] * from[x] + noise[x] + 0.5f;
      to[x] = static_cast<uint8_t>(std::clamp(grey, 0.0f, 255.0f));
    }
  }
}

}  // namespace portolan::synthetic
