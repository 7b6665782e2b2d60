// What a camera does to light: exposure, vignetting, noise, eight bits.
#ifndef PORTOLAN_TESTS_SYNTHETIC_IMAGE_EFFECTS_H_
#define PORTOLAN_TESTS_SYNTHETIC_IMAGE_EFFECTS_H_

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace portolan::synthetic {

struct ImageEffectsOptions {
  // Standard deviation of the noise of a pixel in grey levels, as of a machine-vision camera.
  double noise_sigma = 2.0;
  // The gain swings by this share over exposure_period_s (automatic exposure).
  double exposure_swing = 0.2;
  double exposure_period_s = 7.0;
  // Loss of light in the image's corners.
  double vignetting = 0.15;
  // Shutter time; the mean of blur_samples views over it. 0: no motion blur.
  double shutter_s = 0.0;
  int blur_samples = 5;
  uint64_t seed = 1;
};

// Thread-compatible. The result depends on the options and the frame index alone.
class ImageEffects {
 public:
  explicit ImageEffects(const ImageEffectsOptions& options);

  // `light` has grey values 0 ... 255 at unit gain.
  void Apply(const cv::Mat1f& light, int frame, double time_s, cv::Mat1b* image);

 private:
  ImageEffectsOptions options_;
  std::vector<float> noise_;  // a long table, entered at a random place in every row
  cv::Mat1f vignette_;
};

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_IMAGE_EFFECTS_H_
