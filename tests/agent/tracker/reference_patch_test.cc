#include "agent/tracker/reference_patch.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "tests/agent/tracker/test_images.h"

namespace portolan {
namespace {

constexpr int kWidth = 160, kHeight = 140;
const Eigen::Vector2d kPoint(80.3, 69.6);

ImagePyramid Seen(const View& view, uint32_t seed = 5) {
  ImagePyramid pyramid;
  pyramid.Build(Render(WaveTexture(seed), view, kWidth, kHeight), 2);
  return pyramid;
}

// Error of the alignment with a view, from a start that is off by `error`.
double AlignmentError(const View& view, const Eigen::Vector2d& error, uint32_t seed = 5) {
  const auto patch = ReferencePatch::Create(Seen({}, seed), kPoint);
  const PatchPose start{view.Map(kPoint) + error, view.affine};
  const auto aligned = patch->Align(Seen(view, seed), start);
  return aligned ? (aligned->pose.pixel - view.Map(kPoint)).norm() : 1e9;
}

TEST(ReferencePatch, AlignsToAFewHundredthsOfAPixel) {
  for (uint32_t seed = 1; seed <= 12; ++seed) {
    const View view{.shift = {0.1 * seed, -0.37 * seed}};
    EXPECT_LT(AlignmentError(view, {0.9, -0.7}, seed), 0.05) << seed;
  }
}

TEST(ReferencePatch, AlignsUnderRotationScaleAndShear) {
  View view{.affine = RotationScale(0.3, 1.2), .shift = {20.0, -30.0}};
  view.affine(0, 1) += 0.1;
  EXPECT_LT(AlignmentError(view, {0.6, 0.6}), 0.06);
}

TEST(ReferencePatch, AlignsMagnifiedPatchesOnACoarserLevel) {
  const View view{.affine = RotationScale(0.1, 2.0), .shift = {-80.0, -75.0}};
  EXPECT_LT(AlignmentError(view, {0.8, -0.5}), 0.12);
}

TEST(ReferencePatch, RecoversTheWarpOverSeveralFrames) {
  const auto patch = ReferencePatch::Create(Seen({}), kPoint);
  PatchPose pose{kPoint, Eigen::Matrix2d::Identity()};
  View view;
  for (int i = 1; i <= 20; ++i) {
    view.affine = RotationScale(0.02 * i, 1.0 + 0.01 * i);
    view.shift = kPoint - view.affine * kPoint;
    const auto aligned = patch->Align(Seen(view), pose);
    ASSERT_TRUE(aligned.has_value());
    pose = aligned->pose;
  }
  EXPECT_LT((pose.affine - view.affine).norm(), 0.08);
  EXPECT_LT((pose.pixel - kPoint).norm(), 0.06);
}

TEST(ReferencePatch, IsBlindToGainAndOffset) {
  for (const double gain : {0.5, 0.8, 1.25}) {
    const View view{.shift = {0.4, 0.8}, .gain = gain, .offset = 60.0 - 55.0 * gain};
    EXPECT_LT(AlignmentError(view, {0.7, 0.7}), 0.08) << gain;
    const auto patch = ReferencePatch::Create(Seen({}), kPoint);
    const auto aligned = patch->Align(Seen(view), {view.Map(kPoint), view.affine});
    EXPECT_NEAR(aligned->gain, 1.0 / gain, 0.06 / gain);
    EXPECT_GT(aligned->correlation, 0.99);
  }
}

TEST(ReferencePatch, StatesLargerSigmaForPoorerMatches) {
  const auto patch = ReferencePatch::Create(Seen({}), kPoint);
  const View same;
  const cv::Mat clean = Render(WaveTexture(5), same, kWidth, kHeight);
  double last = 0.0;
  for (const double noise : {2.0, 8.0, 20.0}) {
    cv::Mat random(clean.size(), CV_16SC1), noisy;
    cv::RNG rng(1);
    rng.fill(random, cv::RNG::NORMAL, 0.0, noise);
    cv::add(clean, random, noisy, cv::noArray(), CV_8U);
    ImagePyramid pyramid;
    pyramid.Build(noisy, 2);
    const auto aligned = patch->Align(pyramid, {kPoint, Eigen::Matrix2d::Identity()});
    ASSERT_TRUE(aligned.has_value());
    EXPECT_GT(aligned->sigma_px, 1.5 * last);
    EXPECT_LT((aligned->pose.pixel - kPoint).norm(), 5.0 * aligned->sigma_px);
    last = aligned->sigma_px;
  }
}

TEST(ReferencePatch, CannotBeMadeOfFlatOrOneDimensionalTexture) {
  ImagePyramid flat, edge;
  flat.Build(cv::Mat(60, 60, CV_8UC1, cv::Scalar(100)), 1);
  EXPECT_FALSE(ReferencePatch::Create(flat, {30, 30}).has_value());
  cv::Mat step(60, 60, CV_8UC1, cv::Scalar(20));
  step.colRange(30, 60).setTo(220);
  edge.Build(step, 1);
  EXPECT_FALSE(ReferencePatch::Create(edge, {30, 30}).has_value());
}

TEST(ReferencePatch, RefusesPointsAndPosesOutsideOfTheImage) {
  const ImagePyramid image = Seen({});
  EXPECT_FALSE(ReferencePatch::Create(image, {3, 70}).has_value());
  EXPECT_FALSE(ReferencePatch::Create(image, {std::nan(""), 70}).has_value());
  const auto patch = ReferencePatch::Create(image, kPoint);
  EXPECT_FALSE(patch->Align(image, {{-400, 70}, Eigen::Matrix2d::Identity()}).has_value());
  EXPECT_FALSE(patch->Align(image, {{1e300, 70}, Eigen::Matrix2d::Identity()}).has_value());
  EXPECT_FALSE(patch->Align(image, {kPoint, Eigen::Matrix2d::Zero()}).has_value());
  EXPECT_FALSE(patch->Align(image, {kPoint, -RotationScale(0, 1) * 9}).has_value());
}

// The steepest-descent images are an analytic Jacobian: one step from a tiny known displacement
// must undo it, for each warp parameter, as a numeric derivative of the image would.
TEST(ReferencePatch, OneStepUndoesATinyWarp) {
  const auto patch = ReferencePatch::Create(Seen({}), kPoint);
  for (int parameter = 0; parameter < 4; ++parameter) {
    PatchPose start{kPoint, Eigen::Matrix2d::Identity()};
    start.affine(parameter / 2, parameter % 2) += 0.004;
    const auto aligned = patch->Align(Seen({}), start);
    ASSERT_TRUE(aligned.has_value());
    const double left = aligned->pose.affine(parameter / 2, parameter % 2) -
                        (parameter == 0 || parameter == 3 ? 1.0 : 0.0);
    EXPECT_LT(std::abs(left), 0.003) << parameter;
    EXPECT_LT((aligned->pose.pixel - kPoint).norm(), 0.02);
  }
}

}  // namespace
}  // namespace portolan
