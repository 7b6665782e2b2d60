// A patch as it was first seen, and its alignment with later images: what keeps a track of
// hundreds of frames from drifting.
#ifndef PORTOLAN_AGENT_TRACKER_REFERENCE_PATCH_H_
#define PORTOLAN_AGENT_TRACKER_REFERENCE_PATCH_H_

#include <Eigen/Core>
#include <optional>

#include "agent/tracker/image_pyramid.h"

namespace portolan {

// Where a patch lies in an image: image = pixel + affine * patch coordinates (pixels of the
// reference image, relative to the point).
struct PatchPose {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d affine = Eigen::Matrix2d::Identity();
};

// False if the warp is not finite, mirrors, shrinks, magnifies or shears beyond use.
bool IsSound(const PatchPose& pose);

// The pyramid level at which a patch at this pose has about its original size.
int PatchLevel(const PatchPose& pose, int num_levels);

struct PatchAlignment {
  PatchPose pose;
  // Zero-mean normalised cross-correlation with the reference, -1 .. 1.
  double correlation = 0.0;
  // Standard deviation of the pixel per axis that the residual and the texture imply.
  double sigma_px = 0.0;
  // Grey levels of the reference per grey level of the image.
  double gain = 1.0;
};

// Immutable after Create; thread-safe.
//
// Align is the inverse compositional Gauss-Newton method (Baker & Matthews, IJCV 2004, Sec. 3.2
// and, for the linear appearance part, "project-out", Part 3 Sec. 3) with an affine warp. Gain and
// offset of the brightness are eliminated: the steepest-descent images are made orthogonal to the
// constant and to the reference itself, so an iteration needs the products of eight fixed columns
// with the sampled window and nothing else. The affine part is held near its start by a prior.
class ReferencePatch {
 public:
  // Half width of the patch.
  static constexpr int kHalfPx = 6;

  // No value if the patch sticks out of the image or has too little texture to be located.
  static std::optional<ReferencePatch> Create(const ImagePyramid& image,
                                              const Eigen::Vector2d& pixel);

  // Aligns with an image from a start within about two pixels; the start's affine part is the mean
  // of the prior. Chooses the pyramid level by the warp's magnification. No value if the patch
  // leaves the image, the warp degenerates or the iteration diverges.
  std::optional<PatchAlignment> Align(const ImagePyramid& image, const PatchPose& start) const;

  // Grey value at patch coordinates, bilinear; beyond the edge that of the nearest pixel.
  float Interpolate(const Eigen::Vector2d& patch_point) const;

 private:
  static constexpr int kSide = 2 * kHalfPx + 1;
  static constexpr int kArea = kSide * kSide;
  // Sums of the window times the columns of table_, and of its weighted squares.
  struct Products {
    Eigen::Matrix<float, 8, 1> columns;
    float squares = 0.0f;
  };

  bool ComputeTables();
  std::optional<Products> Sample(const PyramidLevel& level, const PatchPose& pose,
                                 double scale) const;
  struct Fit {
    float gain;
    float correlation;
  };
  Fit FitBrightness(const Products& products) const;

  // Point minus the centre pixel of the lattice.
  Eigen::Vector2f fraction_ = Eigen::Vector2f::Zero();
  Eigen::Matrix<float, kArea, 1> value_;
  // A row a pixel: six projected steepest-descent images (dx, dy, D11, D12, D21, D22), the
  // mean-free reference and one, each times the pixel's weight.
  Eigen::Matrix<float, kArea, 8, Eigen::RowMajor> table_;
  Eigen::Matrix<float, kArea, 1> weight_;
  float weight_sum_ = 0.0f;
  float energy_ = 0.0f;                         // weighted squares of the mean-free reference
  Eigen::Matrix<float, 6, 6> inverse_hessian_;  // with the prior
  Eigen::Matrix2f position_covariance_;         // for unit variance of the grey values
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_REFERENCE_PATCH_H_
