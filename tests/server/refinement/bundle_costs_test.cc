#include "server/refinement/bundle_costs.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/numeric_derivative.h"

namespace portolan {
namespace {

CameraModel MakeCamera(DistortionModel distortion) {
  CameraIntrinsics intrinsics;
  intrinsics.width_px = 640;
  intrinsics.height_px = 480;
  intrinsics.fx_px = 450;
  intrinsics.fy_px = 460;
  intrinsics.cx_px = 310;
  intrinsics.cy_px = 250;
  intrinsics.distortion = distortion;
  intrinsics.coefficients = {-0.05, 0.01, 0.001, -0.002, 0};
  return CameraModel::Create(intrinsics).value();
}

class BundleCosts : public ::testing::TestWithParam<DistortionModel> {
 protected:
  Eigen::Vector3d RandomVector(double size) {
    std::uniform_real_distribution<double> uniform(-size, size);
    const double x = uniform(random_), y = uniform(random_), z = uniform(random_);
    return {x, y, z};
  }
  Rigid3 RandomPose() { return {RotationExp(RandomVector(2)), RandomVector(3)}; }
  Vector6d RandomTangent() {
    Vector6d tangent;
    tangent << RandomVector(0.3), RandomVector(0.3);
    return tangent;
  }

  std::mt19937 random_{7};
};

template <typename Cost, int kSize>
void ExpectJacobian(const Cost& cost, const Eigen::VectorXd& x, const std::vector<int>& sizes) {
  const auto pointers = [&](const Eigen::VectorXd& at) {
    std::vector<const double*> blocks;
    int offset = 0;
    for (const int size : sizes) {
      blocks.push_back(at.data() + offset);
      offset += size;
    }
    return blocks;
  };
  const Eigen::MatrixXd numeric = NumericJacobian(
      x,
      [&](const Eigen::VectorXd& at) {
        Eigen::VectorXd residual(kSize);
        cost.Evaluate(pointers(at).data(), residual.data(), nullptr);
        return residual;
      },
      1e-4);
  std::vector<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> blocks;
  std::vector<double*> jacobians;
  for (const int size : sizes) blocks.emplace_back(kSize, size);
  for (auto& block : blocks) jacobians.push_back(block.data());
  Eigen::VectorXd residual(kSize);
  ASSERT_TRUE(cost.Evaluate(pointers(x).data(), residual.data(), jacobians.data()));
  int offset = 0;
  for (const auto& block : blocks) {
    const Eigen::MatrixXd expected = numeric.middleCols(offset, block.cols());
    EXPECT_LT((block - expected).norm(), 1e-6 * (1 + expected.norm())) << block << "\n\n"
                                                                       << expected;
    offset += static_cast<int>(block.cols());
  }
}

TEST_P(BundleCosts, ReprojectionJacobianEqualsTheNumericOne) {
  const CameraModel model = MakeCamera(GetParam());
  for (int i = 0; i < 50; ++i) {
    const CameraReference camera{RandomPose(), &model};
    // Up to the border of the image, near and far, seen from another anchor.
    const Eigen::Vector3d in_camera =
        Eigen::Vector3d(0.65, 0.5, 1.0)
            .cwiseProduct(RandomVector(1) - Eigen::Vector3d(0, 0, -1.3)) *
        (i % 2 == 0 ? 3.0 : 300.0);
    const PointReference point =
        PointReference::At(camera.world_from_camera.translation + RandomVector(0.5),
                           camera.world_from_camera * in_camera);
    const double distance = (camera.world_from_camera * in_camera - point.anchor_in_world).norm();
    Eigen::VectorXd x(9);
    x << 0.05 * RandomTangent(), 0.02, -0.01, 1.0 / distance;
    const ReprojectionCost cost(&camera, &point, {300, 200}, 0.5);
    ExpectJacobian<ReprojectionCost, 2>(cost, x, {6, 3});
  }
}

INSTANTIATE_TEST_SUITE_P(Models, BundleCosts,
                         ::testing::Values(DistortionModel::kNone, DistortionModel::kRadTan,
                                           DistortionModel::kEquidistant));

using PriorCosts = BundleCosts;

TEST_P(PriorCosts, JacobiansEqualTheNumericOnes) {
  const CameraModel model = MakeCamera(GetParam());
  const CameraReference a{RandomPose(), &model};
  const CameraReference b{RandomPose(), &model};
  const Vector6d x = RandomTangent();
  ExpectJacobian<PositionCost, 3>(PositionCost(&a, {{1, 2, 3}, 0.2}), x, {6});
  Eigen::VectorXd xx(12);
  xx << x, RandomTangent();
  ExpectJacobian<DistanceCost, 1>(DistanceCost(&a, &b, 2.0, 0.1), xx, {6, 6});
  ExpectJacobian<InverseDepthCost, 2>(InverseDepthCost(0.4, 0.1), RandomVector(1), {3});
}

INSTANTIATE_TEST_SUITE_P(Models, PriorCosts, ::testing::Values(DistortionModel::kNone));

TEST(PointReference, ReturnsThePointAndItsJacobian) {
  const Eigen::Vector3d point(3, -2, 5);
  const PointReference reference = PointReference::At({1, 1, 1}, point);
  const Eigen::Vector3d parameters(0, 0, 1.0 / (point - Eigen::Vector3d(1, 1, 1)).norm());
  EXPECT_LT((reference.Apply(parameters.data(), 1e-6) - point).norm(), 1e-12);
  const Eigen::MatrixXd numeric = NumericJacobian(
      parameters, [&](const Eigen::VectorXd& x) { return reference.Apply(x.data(), 1e-6); }, 1e-4);
  EXPECT_LT((reference.PointJacobian(parameters.data(), 1e-6) - numeric).norm(), 1e-6);
}

TEST(ReprojectionCost, PointBehindTheCameraNeitherFailsNorSteers) {
  const CameraModel model = MakeCamera(DistortionModel::kRadTan);
  const CameraReference camera{Rigid3::Identity(), &model};
  const PointReference point = PointReference::At({0, 0, 0}, {0, 0, -2});
  const ReprojectionCost cost(&camera, &point, {300, 200}, 1.0);
  const Vector6d pose = Vector6d::Zero();
  const Eigen::Vector3d parameters(0, 0, 0.5);
  const double* blocks[] = {pose.data(), parameters.data()};
  Eigen::Vector2d residual;
  Eigen::Matrix<double, 2, 6, Eigen::RowMajor> d_camera;
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> d_point;
  double* jacobians[] = {d_camera.data(), d_point.data()};
  EXPECT_TRUE(cost.Evaluate(blocks, residual.data(), jacobians));
  EXPECT_TRUE(residual.allFinite());
  EXPECT_EQ(d_camera.norm(), 0);
  EXPECT_EQ(d_point.norm(), 0);
}

}  // namespace
}  // namespace portolan
