// What bundle_solver.cc keeps of a problem: its terms by point, and blocks of the normal equations.
#ifndef PORTOLAN_COMMON_BUNDLE_BUNDLE_SOLVER_TERMS_H_
#define PORTOLAN_COMMON_BUNDLE_BUNDLE_SOLVER_TERMS_H_

#include <Eigen/Core>
#include <array>
#include <vector>

#include "common/bundle/bundle_parameters.h"
#include "common/bundle/bundle_terms.h"

namespace portolan::bundle_solver {

using Matrix26d = Eigen::Matrix<double, 2, 6, Eigen::RowMajor>;
using Matrix23r = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;
using Matrix63d = Eigen::Matrix<double, 6, 3>;

// One observation that has a say.
struct Term {
  int camera = 0;
  int place = -1;  // of the camera among the free ones; -1 if it is held
  ReprojectionError error;
  // Weighted by the root of the loss's slope.
  Eigen::Vector2d residual = Eigen::Vector2d::Zero();
  Matrix26d d_camera = Matrix26d::Zero();
  Matrix23r d_point = Matrix23r::Zero();
  int lens = -1;  // of the camera
  // Residual by the lens's coefficients, which it is linear in: fixed for a solve, and weighted.
  Matrix23r lens_slope = Matrix23r::Zero();
  Matrix23r d_lens = Matrix23r::Zero();
};

// The terms of one point, one after another.
struct PointTerms {
  int point = 0;
  size_t begin = 0;
  size_t end = 0;
  bool is_free = true;
  double rho = 0;  // prior
  double inverse_sigma = 0;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  // Damped, of the last step that was tried.
  Eigen::Matrix3d inverse = Eigen::Matrix3d::Zero();
};

// The observations that have a say, point by point. place_of: of a camera among the free ones, or
// -1.
void CollectTerms(const BundleOptions& options, const BundleProblem& problem,
                  const BundleParameters& parameters, const std::vector<int>& place_of,
                  std::vector<Term>* terms, std::vector<PointTerms>* points);

// What a step changes.
struct Unknowns {
  std::vector<std::array<double, 6>> cameras;
  std::vector<std::array<double, 3>> points;
  std::vector<LensVector> lenses;
};

// Of a camera, or a lens, with a point.
struct Coupling {
  int place;
  Matrix63d plain;
  Matrix63d weighted;  // times the point's inverse information
};

// A block under the diagonal, from a prior.
struct Below {
  int row;
  int column;
  Eigen::Matrix<double, 6, 6> block;
};

}  // namespace portolan::bundle_solver

#endif  // PORTOLAN_COMMON_BUNDLE_BUNDLE_SOLVER_TERMS_H_
