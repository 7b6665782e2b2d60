// Grey textures with mip levels, painted by a program: noise of several octaves and shapes.
#ifndef PORTOLAN_TESTS_SYNTHETIC_TEXTURE_H_
#define PORTOLAN_TESTS_SYNTHETIC_TEXTURE_H_

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace portolan::synthetic {

// Immutable once made, thread-safe. Coordinates are metres from the texture's corner: texel (0, 0)
// covers [0, texel_m) in both.
class Texture {
 public:
  // `texels` becomes level 0; its sizes are padded (repeated: must be powers of two).
  Texture(const cv::Mat1b& texels, double texel_m, bool repeated);

  // Grey value 0 ... 255 at (u, v), averaged over about footprint_m (trilinear). Outside, the
  // border's value, or, if repeated, the texture again.
  float Sample(float u_m, float v_m, float footprint_m) const;

  float texel_m() const { return texel_m_; }
  const cv::Mat1b& level(int i) const { return levels_[i]; }

 private:
  float SampleLevel(int level, float u_m, float v_m) const;

  std::vector<cv::Mat1b> levels_;
  std::vector<float> texels_per_m_;  // of each level
  float texel_m_ = 0;
  bool repeated_ = false;
};

struct TextureOptions {
  uint64_t seed = 1;
  double width_m = 1, height_m = 1;
  // 4 mm is about a pixel at 2 m from a camera with a focal length of 458 px.
  double texel_m = 0.004;
  // Standard deviation of the noise in grey levels.
  double noise_contrast = 24;
  // Painted shapes (rectangles, discs, triangles, bars, writing) a square metre.
  double shapes_per_m2 = 14;
  // Largest difference of a shape's grey from mid grey.
  double shape_contrast = 110;
  bool repeated = false;
};

Texture MakeTexture(const TextureOptions& options);

// A checkerboard of columns x rows squares, dark first; corners lie exactly at multiples of
// square_m, which must be a multiple of texel_m.
Texture MakeCheckerboard(int columns, int rows, double square_m, double texel_m);

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_TEXTURE_H_
