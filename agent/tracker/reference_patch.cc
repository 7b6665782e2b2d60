#include "agent/tracker/reference_patch.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "common/base/vector_clones.h"

namespace portolan {
namespace {

constexpr int kMaxIterations = 10;
constexpr double kConvergedPx = 0.015;
// Window weights: Gaussian.
constexpr float kWindowSigmaPx = 4.5f;
// Weight of the affine prior: (standard deviation of the grey values / change of a warp
// coefficient from frame to frame)^2.
constexpr float kAffinePrior = (3.0f / 0.02f) * (3.0f / 0.02f);
// Least mean squared gradient in the weaker direction, (grey levels/px)^2.
constexpr float kMinEigenvalue = 1.0f;
// The iteration may move the point this far in all.
constexpr double kMaxShiftPx = 4.0;
constexpr double kMinScale = 0.3, kMaxScale = 6.0, kMaxAspect = 3.0;
// Largest gain of brightness between reference and image, and its inverse.
constexpr float kMaxGain = 4.0f;

// A lattice of pixels in an image: pixel (u, v) lies at origin + u * step_u + v * step_v, in units
// of 2^-16 px.
struct Lattice {
  int x, y;
  int x_u, y_u;
  int x_v, y_v;
};

// Pixels are computed so many at once, those of a row or of the whole lattice filled up.
constexpr int kLanes = 16;

// Bilinear samples of a kSide x kSide lattice, whose pixels and their neighbours must be readable,
// with eight binary digits of the fractions. `values` has room for kLanes more.
template <int kSide>
PORTOLAN_INLINE void SampleLattice(const PyramidLevel& level, const Lattice& lattice,
                                   float* values) {
  static_assert(kSide <= kLanes);
  constexpr int kArea = kSide * kSide;
  constexpr Int8 kFirst = {0, 1, 2, 3, 4, 5, 6, 7}, kSecond = kFirst + 8;
  const Int8 x_first = kFirst * lattice.x_u, x_second = kSecond * lattice.x_u;
  const Int8 y_first = kFirst * lattice.y_u, y_second = kSecond * lattice.y_u;
  const int stride = static_cast<int>(level.stride);
  int offset[kArea + kLanes];
  uint16_t fraction_x[kArea + kLanes], fraction_y[kArea + kLanes];
  for (int v = 0; v < kSide; ++v) {
    // What a row has too much is overwritten by the next one.
    const int i = v * kSide;
    const int row_x = lattice.x + v * lattice.x_v, row_y = lattice.y + v * lattice.y_v;
    for (const int half : {0, 8}) {
      const Int8 x = row_x + (half == 0 ? x_first : x_second);
      const Int8 y = row_y + (half == 0 ? y_first : y_second);
      const Int8 at = (y >> 16) * stride + (x >> 16);
      const Short8 fx = __builtin_convertvector((x >> 8) & 255, Short8);
      const Short8 fy = __builtin_convertvector((y >> 8) & 255, Short8);
      std::memcpy(offset + i + half, &at, sizeof(at));
      std::memcpy(fraction_x + i + half, &fx, sizeof(fx));
      std::memcpy(fraction_y + i + half, &fy, sizeof(fy));
    }
  }
  // Two neighbours in the row, and those below, as they follow each other in memory.
  uint16_t top[kArea + kLanes] = {}, bottom[kArea + kLanes] = {};
  const uint8_t* const below = level.origin + level.stride;
#pragma GCC unroll 4
  for (int i = 0; i < kArea; ++i) {
    std::memcpy(top + i, level.origin + offset[i], sizeof(uint16_t));
    std::memcpy(bottom + i, below + offset[i], sizeof(uint16_t));
  }
  constexpr int kFirstShift = std::endian::native == std::endian::little ? 0 : 8;
  for (int i = 0; i < kArea; i += 8) {
    UShort8 t, b, fx, fy;
    std::memcpy(&t, top + i, sizeof(t));
    std::memcpy(&b, bottom + i, sizeof(b));
    std::memcpy(&fx, fraction_x + i, sizeof(fx));
    std::memcpy(&fy, fraction_y + i, sizeof(fy));
    // At most 255 * 256, so 16 bits hold it, and 24 bits, those of a float, the next sum.
    const UShort8 above16 =
        ((t >> kFirstShift) & 255) * (256 - fx) + ((t >> (8 - kFirstShift)) & 255) * fx;
    const UShort8 below16 =
        ((b >> kFirstShift) & 255) * (256 - fx) + ((b >> (8 - kFirstShift)) & 255) * fx;
    const Float8 above = __builtin_convertvector(__builtin_convertvector(above16, Int8), Float8);
    const Float8 under = __builtin_convertvector(__builtin_convertvector(below16, Int8), Float8);
    const Float8 fraction = __builtin_convertvector(__builtin_convertvector(fy, Int8), Float8);
    const Float8 value = (above * 256.0f + fraction * (under - above)) * (1.0f / 65536.0f);
    std::memcpy(values + i, &value, sizeof(value));
  }
}

// Products of the samples with eight columns, and the sum of their weighted squares.
PORTOLAN_INLINE void AddProducts(const float* values, const float* table, const float* weights,
                                 int count, float* columns, float* squares) {
  Float8 even = {}, odd = {}, square = {};
  int i = 0;
  for (; i + 8 <= count; i += 8) {
    for (int k = 0; k < 8; k += 2) {
      Float8 row, next_row;
      std::memcpy(&row, table + 8 * (i + k), sizeof(row));
      std::memcpy(&next_row, table + 8 * (i + k + 1), sizeof(next_row));
      even += row * values[i + k];
      odd += next_row * values[i + k + 1];
    }
    Float8 weight, value;
    std::memcpy(&weight, weights + i, sizeof(weight));
    std::memcpy(&value, values + i, sizeof(value));
    square += weight * value * value;
  }
  for (; i < count; ++i) {
    Float8 row;
    std::memcpy(&row, table + 8 * i, sizeof(row));
    even += row * values[i];
    square[0] += weights[i] * values[i] * values[i];
  }
  even += odd;
  std::memcpy(columns, &even, sizeof(even));
  *squares = 0.0f;
  for (int k = 0; k < 8; ++k) *squares += square[k];
}

template <int kSide>
PORTOLAN_VECTOR_CLONES void SampleProducts(const PyramidLevel& level, const Lattice& lattice,
                                           const float* table, const float* weights, float* columns,
                                           float* squares) {
  float values[kSide * kSide + kLanes];
  SampleLattice<kSide>(level, lattice, values);
  AddProducts(values, table, weights, kSide * kSide, columns, squares);
}

}  // namespace

bool IsSound(const PatchPose& pose) {
  if (!pose.pixel.allFinite() || !pose.affine.allFinite()) return false;
  if (pose.pixel.cwiseAbs().maxCoeff() > 1e6) return false;
  const double determinant = pose.affine.determinant();
  if (determinant < kMinScale * kMinScale || determinant > kMaxScale * kMaxScale) return false;
  // |A|_F^2 / det = aspect + 1 / aspect.
  return pose.affine.squaredNorm() / determinant < kMaxAspect + 1.0 / kMaxAspect;
}

int PatchLevel(const PatchPose& pose, int num_levels) {
  const double level = 0.5 * std::log2(pose.affine.determinant());
  return std::clamp(static_cast<int>(std::lround(level)), 0, num_levels - 1);
}

std::optional<ReferencePatch> ReferencePatch::Create(const ImagePyramid& image,
                                                     const Eigen::Vector2d& pixel) {
  if (!pixel.allFinite() || pixel.cwiseAbs().maxCoeff() > 1e6) return std::nullopt;
  const PyramidLevel level = image.Level(0);
  const int cx = static_cast<int>(std::lround(pixel.x()));
  const int cy = static_cast<int>(std::lround(pixel.y()));
  if (cx < kHalfPx + 1 || cy < kHalfPx + 1 || cx + kHalfPx + 1 >= level.width_px ||
      cy + kHalfPx + 1 >= level.height_px) {
    return std::nullopt;
  }
  std::optional<ReferencePatch> patch(std::in_place);
  patch->fraction_ = Eigen::Vector2d(pixel.x() - cx, pixel.y() - cy).cast<float>();
  for (int i = 0, y = -kHalfPx; y <= kHalfPx; ++y) {
    for (int x = -kHalfPx; x <= kHalfPx; ++x, ++i) {
      const uint8_t* p = level.At(cx + x, cy + y);
      patch->value_[i] = p[0];
      patch->table_(i, 0) = 0.5f * (p[1] - p[-1]);
      patch->table_(i, 1) = 0.5f * (p[level.stride] - p[-level.stride]);
    }
  }
  if (!patch->ComputeTables()) return std::nullopt;
  return patch;
}

// The first two columns of table_ hold the gradients on entry.
bool ReferencePatch::ComputeTables() {
  std::array<float, kSide> weight_x, weight_y;
  for (int i = 0; i < kSide; ++i) {
    const Eigen::Array2f u = static_cast<float>(i - kHalfPx) - fraction_.array();
    const Eigen::Array2f w = (-0.5f / (kWindowSigmaPx * kWindowSigmaPx) * u.square()).exp();
    weight_x[i] = w.x();
    weight_y[i] = w.y();
  }
  for (int i = 0; i < kArea; ++i) {
    const Eigen::Vector2f u(i % kSide - kHalfPx - fraction_.x(),
                            i / kSide - kHalfPx - fraction_.y());
    const Eigen::Vector2f gradient = table_.row(i).head<2>();
    table_.row(i) << gradient.x(), gradient.y(), gradient.x() * u.x(), gradient.x() * u.y(),
        gradient.y() * u.x(), gradient.y() * u.y(), value_[i], 1.0f;
    weight_[i] = weight_x[i % kSide] * weight_y[i / kSide];
  }
  weight_sum_ = weight_.sum();
  const Eigen::Matrix<float, 1, 7> mean =
      (weight_.transpose() * table_.leftCols<7>()) / weight_sum_;
  table_.leftCols<7>().rowwise() -= mean;
  const Eigen::Matrix<float, kArea, 1> reference = table_.col(6);
  energy_ = (reference.array().square() * weight_.array()).sum();
  if (energy_ < weight_sum_) return false;
  const Eigen::Matrix<float, 1, 6> along =
      reference.cwiseProduct(weight_).transpose() * table_.leftCols<6>() / energy_;
  table_.leftCols<6>() -= reference * along;
  Eigen::Matrix<float, 6, 6> hessian =
      table_.leftCols<6>().transpose() * weight_.asDiagonal() * table_.leftCols<6>();
  const float trace = hessian(0, 0) + hessian(1, 1);
  const float min_eigenvalue =
      0.5f * (trace - std::hypot(hessian(0, 0) - hessian(1, 1), 2.0f * hessian(0, 1)));
  if (min_eigenvalue < kMinEigenvalue * weight_sum_) return false;
  hessian.diagonal().tail<4>().array() += kAffinePrior;
  inverse_hessian_ = hessian.ldlt().solve(Eigen::Matrix<float, 6, 6>::Identity());
  position_covariance_ = inverse_hessian_.topLeftCorner<2, 2>();
  table_ = weight_.asDiagonal() * table_;
  return true;
}

std::optional<ReferencePatch::Products> ReferencePatch::Sample(const PyramidLevel& level,
                                                               const PatchPose& pose,
                                                               double scale) const {
  constexpr double kOne = 1 << 16;
  const Eigen::Matrix2d step = pose.affine * scale;
  const Eigen::Vector2d reach =
      step.cwiseAbs() * Eigen::Vector2d::Constant(kHalfPx + 1.0) + Eigen::Vector2d::Constant(1.5);
  const Eigen::Vector2d centre = pose.pixel * scale;
  if (!level.Holds(static_cast<int>(std::floor(centre.x() - reach.x())),
                   static_cast<int>(std::floor(centre.y() - reach.y())),
                   static_cast<int>(std::ceil(centre.x() + reach.x())),
                   static_cast<int>(std::ceil(centre.y() + reach.y())))) {
    return std::nullopt;
  }
  const Eigen::Vector2d corner =
      centre - step * (fraction_.cast<double>() + Eigen::Vector2d::Constant(kHalfPx));
  const auto fixed = [](double v) { return static_cast<int>(std::lround(v * kOne)); };
  const Lattice lattice = {fixed(corner.x()), fixed(corner.y()), fixed(step(0, 0)),
                           fixed(step(1, 0)), fixed(step(0, 1)), fixed(step(1, 1))};
  Products products;
  SampleProducts<kSide>(level, lattice, table_.data(), weight_.data(), products.columns.data(),
                        &products.squares);
  return products;
}

ReferencePatch::Fit ReferencePatch::FitBrightness(const Products& products) const {
  const float mean = products.columns[7] / weight_sum_;
  const float energy = products.squares - mean * products.columns[7];
  const float cross = products.columns[6];
  if (energy < 1e-3f * weight_sum_) return {0.0f, 0.0f};
  return {cross / energy, cross / std::sqrt(energy * energy_)};
}

std::optional<PatchAlignment> ReferencePatch::Align(const ImagePyramid& image,
                                                    const PatchPose& start) const {
  if (!IsSound(start)) return std::nullopt;
  const int level_index = PatchLevel(start, image.num_levels());
  const PyramidLevel level = image.Level(level_index);
  const double scale = 1.0 / (1 << level_index);
  const Eigen::Matrix2d start_inverse = start.affine.inverse();
  PatchPose pose = start;
  std::optional<Products> products = Sample(level, pose, scale);
  for (int iteration = 0; products && iteration < kMaxIterations; ++iteration) {
    const Fit fit = FitBrightness(*products);
    if (fit.gain < 1.0f / kMaxGain || fit.gain > kMaxGain) return std::nullopt;
    Eigen::Matrix<float, 6, 1> right = fit.gain * products->columns.head<6>();
    const Eigen::Matrix2d deviation = start_inverse * pose.affine;
    right.tail<4>() += kAffinePrior * Eigen::Vector4f(deviation(0, 0) - 1.0, deviation(0, 1),
                                                      deviation(1, 0), deviation(1, 1) - 1.0);
    const Eigen::Matrix<double, 6, 1> delta = (inverse_hessian_ * right).cast<double>();
    Eigen::Matrix2d warp;
    warp << 1.0 + delta[2], delta[3], delta[4], 1.0 + delta[5];
    pose.affine = pose.affine * warp.inverse();
    const Eigen::Vector2d step = pose.affine * delta.head<2>();
    pose.pixel -= step;
    if (!IsSound(pose) || (pose.pixel - start.pixel).norm() > kMaxShiftPx / scale) {
      return std::nullopt;
    }
    products = Sample(level, pose, scale);
    if (step.norm() < kConvergedPx) break;
  }
  if (!products) return std::nullopt;
  const Fit fit = FitBrightness(*products);
  const float variance =
      energy_ * std::max(0.0f, 1.0f - fit.correlation * fit.correlation) / weight_sum_;
  PatchAlignment alignment;
  alignment.pose = pose;
  alignment.correlation = fit.correlation;
  alignment.gain = fit.gain;
  const Eigen::Matrix2d covariance =
      pose.affine * position_covariance_.cast<double>() * pose.affine.transpose();
  alignment.sigma_px = std::sqrt(0.5 * variance * covariance.trace());
  return alignment;
}

float ReferencePatch::Interpolate(const Eigen::Vector2d& patch_point) const {
  const Eigen::Array2f at = (patch_point.cast<float>() + fraction_)
                                .array()
                                .max(-static_cast<float>(kHalfPx))
                                .min(kHalfPx - 1e-3f) +
                            static_cast<float>(kHalfPx);
  const int x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
  const float fx = at.x() - x, fy = at.y() - y;
  const float* row = value_.data() + y * kSide + x;
  return (1 - fy) * ((1 - fx) * row[0] + fx * row[1]) +
         fy * ((1 - fx) * row[kSide] + fx * row[kSide + 1]);
}

}  // namespace portolan
