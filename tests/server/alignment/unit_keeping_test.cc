#include "server/alignment/unit_keeping.h"

#include <gtest/gtest.h>

namespace portolan {
namespace {

using Moves = std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>>;

const Eigen::Vector3d kOrigin(1, 2, 3);

// At a distance from the origin before and after, in whatever directions.
Moves AtDistances(const std::vector<std::pair<double, double>>& distances) {
  Moves moves;
  for (const auto& [before, after] : distances) {
    moves.emplace_back(kOrigin + before * Eigen::Vector3d::UnitX(),
                       kOrigin + after * Eigen::Vector3d::UnitY());
  }
  return moves;
}

TEST(KeepUnit, ScalesAboutTheOriginToTheMedianDistance) {
  const Similarity3 change = KeepUnit(kOrigin, AtDistances({{2, 4}, {3, 6}, {4, 1}, {10, 10}}));
  EXPECT_DOUBLE_EQ(change.scale, 1);
  const Similarity3 half = KeepUnit(kOrigin, AtDistances({{2, 4}, {3, 6}, {4, 8}, {10, 10}}));
  EXPECT_DOUBLE_EQ(half.scale, 0.5);
  EXPECT_LT((half * kOrigin - kOrigin).norm(), 1e-12);
  const Eigen::Vector3d apart(4, 0, 0);
  EXPECT_LT((half * Eigen::Vector3d(kOrigin + apart) - kOrigin - 0.5 * apart).norm(), 1e-12);
  EXPECT_TRUE(half.rotation.isApprox(Eigen::Quaterniond::Identity()));
}

TEST(KeepUnit, WhatIsNearTheOriginHasNoSay) {
  const Similarity3 change =
      KeepUnit(kOrigin, AtDistances({{0.1, 5}, {0.2, 5}, {0.3, 5}, {0, 0}, {10, 20}}));
  EXPECT_DOUBLE_EQ(change.scale, 0.5);
}

TEST(KeepUnit, WithoutAnyDistanceNothingChanges) {
  for (const Moves& moves : {Moves(), AtDistances({{0, 0}}), AtDistances({{0, 3}, {5, 0}})}) {
    const Similarity3 change = KeepUnit(kOrigin, moves);
    EXPECT_EQ(change.scale, 1);
    EXPECT_EQ(change.translation, Eigen::Vector3d::Zero());
  }
}

}  // namespace
}  // namespace portolan
