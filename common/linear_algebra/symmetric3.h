// A symmetric matrix in the room of one triangle, for what a map holds millions of.
#ifndef PORTOLAN_COMMON_LINEAR_ALGEBRA_SYMMETRIC3_H_
#define PORTOLAN_COMMON_LINEAR_ALGEBRA_SYMMETRIC3_H_

#include <Eigen/Core>
#include <array>

namespace portolan {

// Value; the identity at first.
class Symmetric3 {
 public:
  Symmetric3() = default;
  // Of the upper triangle; a matrix is as good.
  Symmetric3(const Eigen::Matrix3d& full)  // NOLINT
      : upper_{full(0, 0), full(0, 1), full(0, 2), full(1, 1), full(1, 2), full(2, 2)} {}

  Eigen::Matrix3d Matrix() const {
    Eigen::Matrix3d full;
    full << upper_[0], upper_[1], upper_[2],  //
        upper_[1], upper_[3], upper_[4],      //
        upper_[2], upper_[4], upper_[5];
    return full;
  }

  // x' A x.
  double SquareOf(const Eigen::Vector3d& x) const { return x.dot(Matrix() * x); }

  friend bool operator==(const Symmetric3&, const Symmetric3&) = default;

 private:
  std::array<double, 6> upper_ = {1, 0, 0, 1, 0, 1};
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_LINEAR_ALGEBRA_SYMMETRIC3_H_
