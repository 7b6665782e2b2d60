#include "tests/synthetic/texture.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>

#include "tests/synthetic/random.h"

namespace portolan::synthetic {
namespace {

constexpr int kLevels = 7;
constexpr int kPadding = 1 << (kLevels - 1);  // so that every level halves exactly
constexpr int kFractionBits = 4;              // of the coordinates of painted shapes

// log2 to 0.09, enough to choose mip levels: exponent plus mantissa.
float ApproximateLog2(float x) {
  const auto bits = std::bit_cast<uint32_t>(x);
  return static_cast<float>(bits) * (1.0f / (1 << 23)) - 127.0f;
}

// Sum of octaves of random lattices, each interpolated smoothly to the full size; amplitudes fall
// with the wave length to the power 0.4, between white and 1/f, as photographs of rough surfaces.
cv::Mat1f OctaveNoise(cv::Size size, Random* random) {
  cv::Mat1f sum(size, 0.0f);
  double variance = 0;
  for (int spacing = 256; spacing >= 4; spacing /= 2) {
    cv::Mat1f lattice(size.height / spacing + 3, size.width / spacing + 3);
    for (float& value : lattice) value = static_cast<float>(random->Uniform(-1, 1));
    cv::Mat1f octave;
    cv::resize(lattice, octave, lattice.size() * spacing, 0, 0, cv::INTER_CUBIC);
    const double amplitude = std::pow(spacing, 0.4);
    const cv::Rect inside(spacing, spacing, size.width, size.height);
    cv::scaleAdd(octave(inside), amplitude, sum, sum);
    variance += amplitude * amplitude / 6.0;
  }
  return sum / std::sqrt(variance);
}

class Painter {
 public:
  Painter(cv::Mat1b* canvas, const TextureOptions& options, Random* random)
      : canvas_(*canvas), options_(options), random_(*random) {}

  void PaintShape() {
    // Sizes from 3 to 45 cm, the small ones more often.
    const double size = 0.03 * std::pow(15.0, std::pow(random_.Uniform(), 1.5)) / options_.texel_m;
    const cv::Point2d centre(random_.Uniform(0, canvas_.cols), random_.Uniform(0, canvas_.rows));
    const double angle = random_.Uniform(0, 2 * M_PI);
    const cv::Scalar grey(128 + random_.Uniform(-1, 1) * options_.shape_contrast);
    switch (random_.Index(6)) {
      case 0:
        return Fill(Polygon(centre, size, angle, 3, 1.0), grey);
      case 1:
        return Fill(Polygon(centre, size, angle, 4, 1.0), grey);
      case 2:
        return Fill(Polygon(centre, size, angle, 4, 0.3), grey);
      case 3:
        return Disc(centre, 0.4 * size, grey);
      default:
        return Write(centre, size, grey);
    }
  }

 private:
  static cv::Point Fixed(const cv::Point2d& point) {
    return {static_cast<int>(std::lround(point.x * (1 << kFractionBits))),
            static_cast<int>(std::lround(point.y * (1 << kFractionBits)))};
  }

  static std::vector<cv::Point> Polygon(const cv::Point2d& centre, double size, double angle,
                                        int corners, double flatness) {
    std::vector<cv::Point> polygon;
    for (int i = 0; i < corners; ++i) {
      const double corner = 2 * M_PI * (i + 0.5) / corners;
      const cv::Point2d offset(0.6 * size * std::cos(corner),
                               0.6 * size * flatness * std::sin(corner));
      polygon.push_back(
          Fixed(centre + cv::Point2d(std::cos(angle) * offset.x - std::sin(angle) * offset.y,
                                     std::sin(angle) * offset.x + std::cos(angle) * offset.y)));
    }
    return polygon;
  }

  void Fill(const std::vector<cv::Point>& polygon, const cv::Scalar& grey) {
    cv::fillConvexPoly(canvas_, polygon, grey, cv::LINE_AA, kFractionBits);
  }

  void Disc(const cv::Point2d& centre, double radius, const cv::Scalar& grey) {
    cv::circle(canvas_, Fixed(centre), static_cast<int>(radius * (1 << kFractionBits)), grey,
               cv::FILLED, cv::LINE_AA, kFractionBits);
    if (random_.Uniform() < 0.5) {
      cv::circle(canvas_, Fixed(centre), static_cast<int>(0.5 * radius * (1 << kFractionBits)),
                 cv::Scalar(255 - grey[0]), cv::FILLED, cv::LINE_AA, kFractionBits);
    }
  }

  void Write(const cv::Point2d& centre, double size, const cv::Scalar& grey) {
    std::string text;
    const int letters = 1 + random_.Index(5);
    for (int i = 0; i < letters; ++i) text += "ABCEFGHKLMNPRSTUXYZ23456789"[random_.Index(27)];
    const double scale = std::max(0.4, size / 40.0);
    cv::putText(canvas_, text, centre, cv::FONT_HERSHEY_SIMPLEX, scale, grey,
                std::max(1, static_cast<int>(3 * scale)), cv::LINE_AA);
  }

  cv::Mat1b& canvas_;
  const TextureOptions& options_;
  Random& random_;
};

}  // namespace

Texture::Texture(const cv::Mat1b& texels, double texel_m, bool repeated)
    : texel_m_(static_cast<float>(texel_m)), repeated_(repeated) {
  const auto padded = [](int size) { return (size + kPadding - 1) / kPadding * kPadding; };
  cv::Mat1b level;
  cv::copyMakeBorder(texels, level, 0, padded(texels.rows) - texels.rows, 0,
                     padded(texels.cols) - texels.cols, cv::BORDER_REPLICATE);
  for (int i = 0; i < kLevels; ++i) {
    levels_.push_back(level);
    texels_per_m_.push_back(static_cast<float>(1.0 / (texel_m * (1 << i))));
    if (i + 1 == kLevels) break;
    cv::Mat1b half;
    cv::resize(level, half, level.size() / 2, 0, 0, cv::INTER_AREA);
    level = half;
  }
}

float Texture::SampleLevel(int level, float u_m, float v_m) const {
  const cv::Mat1b& image = levels_[level];
  const float x = u_m * texels_per_m_[level] - 0.5f;
  const float y = v_m * texels_per_m_[level] - 0.5f;
  const float x_floor = std::floor(x), y_floor = std::floor(y);
  const float dx = x - x_floor, dy = y - y_floor;
  int x0 = static_cast<int>(x_floor), y0 = static_cast<int>(y_floor);
  int x1 = x0 + 1, y1 = y0 + 1;
  if (repeated_) {
    x0 &= image.cols - 1, x1 &= image.cols - 1;
    y0 &= image.rows - 1, y1 &= image.rows - 1;
  } else {
    x0 = std::clamp(x0, 0, image.cols - 1), x1 = std::clamp(x1, 0, image.cols - 1);
    y0 = std::clamp(y0, 0, image.rows - 1), y1 = std::clamp(y1, 0, image.rows - 1);
  }
  const uint8_t* top = image.ptr(y0);
  const uint8_t* bottom = image.ptr(y1);
  const float upper = top[x0] + dx * (top[x1] - top[x0]);
  const float lower = bottom[x0] + dx * (bottom[x1] - bottom[x0]);
  return upper + dy * (lower - upper);
}

float Texture::Sample(float u_m, float v_m, float footprint_m) const {
  const float level = ApproximateLog2(footprint_m * texels_per_m_[0]);
  if (!(level > 0)) return SampleLevel(0, u_m, v_m);
  if (level >= kLevels - 1) return SampleLevel(kLevels - 1, u_m, v_m);
  const int fine = static_cast<int>(level);
  const float share = level - static_cast<float>(fine);
  const float value = SampleLevel(fine, u_m, v_m);
  return value + share * (SampleLevel(fine + 1, u_m, v_m) - value);
}

Texture MakeTexture(const TextureOptions& options) {
  Random random(options.seed);
  cv::Size size(static_cast<int>(std::ceil(options.width_m / options.texel_m)),
                static_cast<int>(std::ceil(options.height_m / options.texel_m)));
  if (options.repeated) {
    size.width = static_cast<int>(std::bit_ceil(static_cast<unsigned>(size.width)));
    size.height = static_cast<int>(std::bit_ceil(static_cast<unsigned>(size.height)));
  }
  const cv::Mat1f noise = OctaveNoise(size, &random);
  cv::Mat1b texels;
  noise.convertTo(texels, CV_8U, options.noise_contrast, 128);
  Painter painter(&texels, options, &random);
  const double area_m2 = size.area() * options.texel_m * options.texel_m;
  const int shapes = static_cast<int>(area_m2 * options.shapes_per_m2);
  for (int i = 0; i < shapes; ++i) painter.PaintShape();
  // The shapes are as rough as their surroundings, at a lower contrast.
  cv::Mat1f rough;
  texels.convertTo(rough, CV_32F);
  cv::scaleAdd(noise, 0.35 * options.noise_contrast, rough, rough);
  rough.convertTo(texels, CV_8U);
  return Texture(texels, options.texel_m, options.repeated);
}

Texture MakeCheckerboard(int columns, int rows, double square_m, double texel_m) {
  const int square = static_cast<int>(std::lround(square_m / texel_m));
  cv::Mat1b texels(rows * square, columns * square);
  for (int y = 0; y < texels.rows; ++y) {
    for (int x = 0; x < texels.cols; ++x) {
      texels(y, x) = (x / square + y / square) % 2 == 0 ? 40 : 215;
    }
  }
  return Texture(texels, texel_m, /*repeated=*/false);
}

}  // namespace portolan::synthetic
