#include "agent/tracker/patch_search.h"

#include <gtest/gtest.h>

#include "tests/agent/tracker/test_images.h"

namespace portolan {
namespace {

const Eigen::Vector2d kPoint(90.2, 75.7);

struct Scene {
  ImagePyramid image;
  ReferencePatch patch;
};

Scene MakeScene(const View& view) {
  const WaveTexture texture(31);
  ImagePyramid first, second;
  first.Build(Render(texture, {}, 200, 160), 2);
  second.Build(Render(texture, view, 200, 160), 2);
  return {second, *ReferencePatch::Create(first, kPoint)};
}

TEST(SearchPatch, FindsThePatchInsideTheEllipse) {
  const View view{.affine = RotationScale(0.1, 1.05), .shift = {12.0, -15.0}};
  const Scene scene = MakeScene(view);
  const PatchPose expected{view.Map(kPoint) + Eigen::Vector2d(9.0, -6.0), view.affine};
  const auto found =
      SearchPatch(scene.image, scene.patch, expected, 16.0 * Eigen::Matrix2d::Identity(), {});
  ASSERT_TRUE(found.has_value());
  EXPECT_LT((found->pose.pixel - view.Map(kPoint)).norm(), 0.06);
  EXPECT_GT(found->correlation, 0.95);
}

TEST(SearchPatch, DoesNotLookBeyondTheEllipse) {
  const Scene scene = MakeScene({});
  const PatchPose expected{kPoint + Eigen::Vector2d(14.0, 0.0), Eigen::Matrix2d::Identity()};
  Eigen::Matrix2d tall = Eigen::Matrix2d::Zero();
  tall.diagonal() << 1.0, 49.0;
  EXPECT_FALSE(SearchPatch(scene.image, scene.patch, expected, tall, {}).has_value());
}

TEST(SearchPatch, GivesNoAnswerForRepeatedTexture) {
  // A board of 16 px squares repeats every 32 px.
  cv::Mat board(200, 200, CV_8UC1);
  for (int y = 0; y < board.rows; ++y) {
    for (int x = 0; x < board.cols; ++x) {
      board.at<uint8_t>(y, x) = (x / 16 + y / 16) % 2 ? 210 : 40;
    }
  }
  ImagePyramid image;
  image.Build(board, 2);
  const Eigen::Vector2d corner(95.5, 95.5);
  const auto patch = ReferencePatch::Create(image, corner);
  ASSERT_TRUE(patch.has_value());
  const PatchPose expected{corner + Eigen::Vector2d(1, 1), Eigen::Matrix2d::Identity()};
  const Eigen::Matrix2d small = 4.0 * Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d large = 150.0 * Eigen::Matrix2d::Identity();
  EXPECT_TRUE(SearchPatch(image, *patch, expected, small, {}).has_value());
  EXPECT_FALSE(SearchPatch(image, *patch, expected, large, {}).has_value());
}

TEST(SearchPatch, RefusesBadRegions) {
  const Scene scene = MakeScene({});
  const PatchPose here{kPoint, Eigen::Matrix2d::Identity()};
  const auto search = [&](const PatchPose& pose, const Eigen::Matrix2d& covariance) {
    return SearchPatch(scene.image, scene.patch, pose, covariance, {}).has_value();
  };
  EXPECT_TRUE(search(here, Eigen::Matrix2d::Identity()));
  EXPECT_FALSE(search(here, Eigen::Matrix2d::Zero()));
  EXPECT_FALSE(search(here, -Eigen::Matrix2d::Identity()));
  EXPECT_FALSE(search(here, Eigen::Matrix2d::Constant(std::nan(""))));
  EXPECT_FALSE(search({{-5000, 75}, here.affine}, Eigen::Matrix2d::Identity()));
  EXPECT_FALSE(search({{std::nan(""), 75}, here.affine}, Eigen::Matrix2d::Identity()));
}

}  // namespace
}  // namespace portolan
