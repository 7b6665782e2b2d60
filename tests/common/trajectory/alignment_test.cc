#include "common/trajectory/alignment.h"

#include <Eigen/Geometry>
#include <random>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

std::vector<Eigen::Vector3d> RandomPoints(int count, int seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) {
    points.emplace_back(3 * normal(random), normal(random), 0.5 * normal(random) + 7);
  }
  return points;
}

std::vector<Eigen::Vector3d> Transformed(const Similarity3& transform,
                                         const std::vector<Eigen::Vector3d>& points, double noise,
                                         int seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, 1);
  std::vector<Eigen::Vector3d> result;
  for (const Eigen::Vector3d& point : points) {
    const Eigen::Vector3d offset(normal(random), normal(random), normal(random));
    result.push_back(transform * point + noise * offset);
  }
  return result;
}

double SquaredError(const Similarity3& transform, const std::vector<Eigen::Vector3d>& from,
                    const std::vector<Eigen::Vector3d>& to) {
  double sum = 0;
  for (size_t i = 0; i < from.size(); ++i) sum += (to[i] - transform * from[i]).squaredNorm();
  return sum;
}

const Similarity3 kTransform{1.7, RotationExp({0.4, -1.1, 0.8}), {5, -3, 2}};

// The worked example of Umeyama 1991, Sec. III: patterns that are mirror images of each other.
TEST(Umeyama, ReproducesThePublishedExample) {
  Eigen::Matrix2Xd from(2, 3), to(2, 3);
  from << 0, 1, 0, 0, 0, 2;
  to << 0, -1, 0, 0, 0, 2;
  const SimilarityTransform<2> transform = Umeyama<2>(from, to, /*with_scale=*/true);
  Eigen::Matrix2d rotation;
  rotation << 0.832, 0.555, -0.555, 0.832;
  EXPECT_THAT(transform.rotation, NearMatrix(rotation, 5e-4));
  EXPECT_THAT(transform.translation, NearMatrix(Eigen::Vector2d(-0.800, 0.400), 5e-4));
  EXPECT_NEAR(transform.scale, 0.721, 5e-4);
  EXPECT_NEAR(transform.mean_squared_error, 8.0 / 15.0, 1e-12);  // by hand, Eq. 33
}

TEST(Umeyama, AgreesWithEigen) {
  const auto from = RandomPoints(40, 1);
  const auto to = Transformed(kTransform, from, 0.3, 2);
  Eigen::Matrix3Xd from_columns(3, 40), to_columns(3, 40);
  for (int i = 0; i < 40; ++i) {
    from_columns.col(i) = from[i];
    to_columns.col(i) = to[i];
  }
  for (const bool with_scale : {false, true}) {
    const Eigen::Matrix4d expected = Eigen::umeyama(from_columns, to_columns, with_scale);
    const auto actual = Umeyama<3>(from_columns, to_columns, with_scale);
    EXPECT_THAT(Eigen::Matrix3d(actual.scale * actual.rotation),
                NearMatrix(Eigen::Matrix3d(expected.topLeftCorner<3, 3>()), 1e-10));
    EXPECT_THAT(actual.translation,
                NearMatrix(Eigen::Vector3d(expected.topRightCorner<3, 1>()), 1e-10));
  }
}

TEST(AlignPoints, RecoversATransformOfItsMode) {
  const auto points = RandomPoints(30, 3);
  Similarity3 rigid = kTransform;
  rigid.scale = 1;
  const Similarity3 yaw{1, RotationExp({0, 0, 2.5}), {1, 2, 3}};
  EXPECT_THAT(*AlignPoints(points, Transformed(kTransform, points, 0, 0), AlignmentMode::kSim3),
              NearSimilarity(kTransform, 1e-9));
  EXPECT_THAT(*AlignPoints(points, Transformed(rigid, points, 0, 0), AlignmentMode::kSe3),
              NearSimilarity(rigid, 1e-9));
  EXPECT_THAT(*AlignPoints(points, Transformed(yaw, points, 0, 0), AlignmentMode::kYaw),
              NearSimilarity(yaw, 1e-9));
  EXPECT_THAT(*AlignPoints(points, Transformed(yaw, points, 0, 0), AlignmentMode::kNone),
              NearSimilarity(Similarity3::Identity(), 0.0));
}

// No small change within the mode's own freedom lowers the error of noisy points.
TEST(AlignPoints, IsAMinimum) {
  const auto from = RandomPoints(25, 4);
  const auto to = Transformed(kTransform, from, 0.5, 5);
  const std::pair<AlignmentMode, std::vector<int>> modes[] = {
      {AlignmentMode::kSim3, {0, 1, 2, 3, 4, 5, 6}},
      {AlignmentMode::kSe3, {0, 1, 2, 3, 4, 5}},
      {AlignmentMode::kYaw, {0, 1, 2, 5}}};
  for (const auto& [mode, freedoms] : modes) {
    const Similarity3 best = *AlignPoints(from, to, mode);
    for (const int freedom : freedoms) {
      for (const double step : {-1e-3, 1e-3}) {
        Vector7d tangent = Vector7d::Zero();
        tangent[freedom] = step;
        EXPECT_GT(SquaredError(best * Similarity3::Exp(tangent), from, to),
                  SquaredError(best, from, to))
            << AlignmentModeName(mode) << " " << freedom;
      }
    }
  }
}

TEST(AlignPoints, NeverMirrors) {
  const auto points = RandomPoints(30, 6);
  auto mirrored = points;
  for (Eigen::Vector3d& point : mirrored) point.x() = -point.x();
  const auto transform = AlignPoints(points, mirrored, AlignmentMode::kSim3);
  ASSERT_TRUE(transform);
  EXPECT_NEAR(transform->rotation.toRotationMatrix().determinant(), 1, 1e-9);
}

TEST(AlignPoints, HandlesPointsOnALine) {
  std::vector<Eigen::Vector3d> line, other;
  for (int i = 0; i < 10; ++i) {
    line.emplace_back(i, 0, 0);
    other.emplace_back(1, 2 * i, 5);
  }
  const auto transform = AlignPoints(line, other, AlignmentMode::kSim3);
  ASSERT_TRUE(transform);
  EXPECT_NEAR(transform->scale, 2, 1e-9);
  EXPECT_NEAR(SquaredError(*transform, line, other), 0, 1e-9);
}

TEST(AlignPoints, HasNoValueWhereNothingIsDetermined) {
  const auto points = RandomPoints(2, 7);
  EXPECT_FALSE(AlignPoints(points, points, AlignmentMode::kSe3));
  EXPECT_FALSE(AlignPoints({}, {}, AlignmentMode::kYaw));
  EXPECT_FALSE(AlignPoints(RandomPoints(3, 7), RandomPoints(4, 7), AlignmentMode::kSe3));
  const std::vector<Eigen::Vector3d> same(5, Eigen::Vector3d(1, 2, 3));
  EXPECT_FALSE(AlignPoints(same, RandomPoints(5, 8), AlignmentMode::kSim3));
}

TEST(AlignmentMode, NamesRoundTrip) {
  for (const auto mode :
       {AlignmentMode::kNone, AlignmentMode::kYaw, AlignmentMode::kSe3, AlignmentMode::kSim3}) {
    EXPECT_EQ(*ParseAlignmentMode(AlignmentModeName(mode)), mode);
  }
  EXPECT_THAT(ParseAlignmentMode("SE3"), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace portolan
