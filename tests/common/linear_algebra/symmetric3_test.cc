#include "common/linear_algebra/symmetric3.h"

#include <gtest/gtest.h>

namespace portolan {
namespace {

TEST(Symmetric3, KeepsEveryBit) {
  Eigen::Matrix3d full;
  full << 4, 0.1, -0.2,  //
      0.1, 5, 0.3,       //
      -0.2, 0.3, 6;
  const Symmetric3 packed = full;
  EXPECT_EQ(packed.Matrix(), full);
  const Eigen::Vector3d x(1, -2, 3);
  EXPECT_EQ(packed.SquareOf(x), x.dot(full * x));
  EXPECT_TRUE(packed == Symmetric3(full));
  full(0, 2) = full(2, 0) = 0;
  EXPECT_FALSE(packed == Symmetric3(full));
  EXPECT_EQ(Symmetric3().Matrix(), Eigen::Matrix3d(Eigen::Matrix3d::Identity()));
  EXPECT_EQ(sizeof(Symmetric3), 6 * sizeof(double));
}

}  // namespace
}  // namespace portolan
