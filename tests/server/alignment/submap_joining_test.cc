#include "server/alignment/submap_joining.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <random>

namespace portolan {
namespace {

class SubmapJoining : public ::testing::TestWithParam<bool> {
 protected:
  double Normal() { return std::normal_distribution<double>(0, 1)(random_); }
  Eigen::MatrixXd RandomCovariance(int size, double sigma) {
    Eigen::MatrixXd a(size, size);
    for (int i = 0; i < a.size(); ++i) a.data()[i] = Normal();
    return sigma * sigma * (a * a.transpose() / size + 0.3 * Eigen::MatrixXd::Identity(size, size));
  }

  // A submap of the given world points, noisy by its own covariance.
  SubmapGaussian MakeSubmap(const std::vector<int>& landmarks,
                            const std::vector<Eigen::Vector3d>& world, const Similarity3& frame,
                            double sigma, bool rigid) {
    SubmapGaussian submap;
    submap.landmarks = landmarks;
    submap.world_from_submap = frame;
    submap.rigid = rigid;
    const int size = 3 * static_cast<int>(landmarks.size());
    submap.covariance = RandomCovariance(size, sigma);
    Eigen::VectorXd noise(size);
    for (int i = 0; i < size; ++i) noise[i] = Normal();
    noise = submap.covariance.llt().matrixL() * noise;
    for (size_t i = 0; i < landmarks.size(); ++i) {
      submap.points_in_submap.push_back(frame.Inverse() * world[landmarks[i]] +
                                        noise.segment<3>(3 * i));
    }
    return submap;
  }

  std::vector<Eigen::Vector3d> MakeWorld(int count) {
    std::vector<Eigen::Vector3d> world;
    for (int i = 0; i < count; ++i) {
      const double x = Normal(), y = Normal(), z = Normal();
      world.emplace_back(x, y, z);
    }
    return world;
  }

  std::mt19937 random_{5};
};

// The dense, iterated projection of x = [points of a; points of b; frame of b] with a flat prior of
// the frame onto a_i - T b_i = 0.
void TextbookProjection(const SubmapGaussian& a, const SubmapGaussian& b, Eigen::VectorXd* x_plus,
                        Eigen::MatrixXd* p_plus) {
  const int n = static_cast<int>(a.landmarks.size());
  const int frame = b.rigid ? 6 : 7;
  const int size = 6 * n + frame;
  Eigen::MatrixXd p = Eigen::MatrixXd::Zero(size, size);
  p.topLeftCorner(3 * n, 3 * n) = a.covariance;
  p.block(3 * n, 3 * n, 3 * n, 3 * n) = b.covariance;
  p.bottomRightCorner(frame, frame) = 1e5 * Eigen::MatrixXd::Identity(frame, frame);
  Eigen::VectorXd x0 = Eigen::VectorXd::Zero(size);
  for (int i = 0; i < n; ++i) {
    x0.segment<3>(3 * i) = a.points_in_submap[i];
    x0.segment<3>(3 * n + 3 * i) = b.points_in_submap[i];
  }
  Eigen::VectorXd x = x0;
  Similarity3 world_from_b = b.world_from_submap;
  for (int iteration = 0; iteration < 20; ++iteration) {
    Eigen::MatrixXd c = Eigen::MatrixXd::Zero(3 * n, size);
    Eigen::VectorXd value(3 * n);
    const Eigen::Matrix3d sr = world_from_b.scale * world_from_b.rotation.toRotationMatrix();
    for (int i = 0; i < n; ++i) {
      const Eigen::Vector3d q = x.segment<3>(3 * n + 3 * i);
      value.segment<3>(3 * i) = x.segment<3>(3 * i) - world_from_b * q;
      c.block<3, 3>(3 * i, 3 * i).setIdentity();
      c.block<3, 3>(3 * i, 3 * n + 3 * i) = -sr;
      Eigen::Matrix<double, 3, 7> d_frame;
      d_frame << sr, -sr * Skew(q), sr * q;
      c.block(3 * i, 6 * n, 3, frame) = -d_frame.leftCols(frame);
    }
    const Eigen::MatrixXd gain = p * c.transpose() * (c * p * c.transpose()).inverse();
    // C x - b, linearised at the present x.
    Eigen::VectorXd from_x = x0 - x;
    from_x.tail(frame).setZero();
    const Eigen::VectorXd next = x + from_x - gain * (value + c * from_x);
    *p_plus = p - gain * c * p;
    Vector7d step = Vector7d::Zero();
    step.head(frame) = next.tail(frame);
    world_from_b = world_from_b * Similarity3::Exp(step);
    x = next;
    x.tail(frame).setZero();
  }
  *x_plus = x;
}

TEST_P(SubmapJoining, TwoSubmapsEqualTheTextbookProjection) {
  const std::vector<Eigen::Vector3d> world = MakeWorld(6);
  const std::vector<int> all = {0, 1, 2, 3, 4, 5};
  const Similarity3 frame{GetParam() ? 1.0 : 1.4, RotationExp({0.3, -0.5, 0.2}), {1, 2, -1}};
  const SubmapGaussian a = MakeSubmap(all, world, Similarity3::Identity(), 0.02, GetParam());
  const SubmapGaussian b = MakeSubmap(all, world, frame, 0.03, GetParam());
  const auto joined = JoinSubmaps({}, {a, b});
  ASSERT_TRUE(joined.ok()) << joined.status();
  Eigen::VectorXd x;
  Eigen::MatrixXd p;
  TextbookProjection(a, b, &x, &p);
  for (int i = 0; i < 6; ++i) {
    EXPECT_LT((joined->points_in_world[i] - x.segment<3>(3 * i)).norm(), 1e-7);
  }
  const Eigen::MatrixXd expected = p.topLeftCorner<18, 18>();
  // Gauss-Newton and the projection linearise the covariance at points that differ by the noise.
  EXPECT_LT((joined->covariance - expected).norm(), 0.02 * expected.norm());
}

TEST_P(SubmapJoining, ChainOfSubmapsFitsItsChiSquare) {
  const std::vector<Eigen::Vector3d> world = MakeWorld(20);
  double sum = 0;
  int degrees = 0;
  for (int run = 0; run < 30; ++run) {
    std::vector<SubmapGaussian> submaps;
    for (int i = 0; i < 4; ++i) {
      std::vector<int> seen;
      for (int k = 0; k < 8; ++k) seen.push_back((5 * i + k) % 20);
      const Similarity3 frame{i == 0 || GetParam() ? 1.0 : 1.0 + 0.1 * i,
                              RotationExp({0.1 * i, 0.2, -0.1 * i}),
                              {0.5 * i, 0, 0}};
      submaps.push_back(MakeSubmap(seen, world, frame, 0.01, GetParam()));
    }
    const auto joined = JoinSubmaps({}, submaps);
    ASSERT_TRUE(joined.ok()) << joined.status();
    sum += joined->chi2;
    degrees += joined->degrees_of_freedom;
  }
  const double sigma = std::sqrt(2.0 * degrees);
  EXPECT_NEAR(sum, degrees, 4 * sigma);
}

INSTANTIATE_TEST_SUITE_P(Rigid, SubmapJoining, ::testing::Bool());

TEST(JoinSubmaps, RefusesWhatDoesNotDetermineTheFrames) {
  SubmapGaussian a;
  a.landmarks = {1, 2};
  a.points_in_submap = {{0, 0, 1}, {1, 0, 2}};
  a.covariance = Eigen::MatrixXd::Identity(6, 6);
  SubmapGaussian b = a;
  EXPECT_EQ(JoinSubmaps({}, {a, b}).status().code(), absl::StatusCode::kFailedPrecondition);
  b.covariance = Eigen::MatrixXd::Identity(3, 3);
  EXPECT_EQ(JoinSubmaps({}, {a, b}).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(JoinSubmaps({}, {}).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace portolan
