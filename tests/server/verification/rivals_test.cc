#include "server/verification/rivals.h"

#include <gtest/gtest.h>

#include "tests/server/verification/synthetic_pair.h"

namespace portolan {
namespace {

int PointOfTrack(const SubmapPoints& submap, uint32_t track) {
  for (size_t i = 0; i < submap.points.size(); ++i) {
    if (submap.points[i].track == TrackId(track)) return static_cast<int>(i);
  }
  return -1;
}

// Matches of lattice point i of a with lattice point i + shift of b.
std::vector<PointMatch> LatticeMatches(const SubmapPoints& a, const SubmapPoints& b,
                                       uint32_t shift) {
  std::vector<PointMatch> matches;
  for (uint32_t i = 0; i + shift < 250; ++i) {
    const int in_a = PointOfTrack(a, i), in_b = PointOfTrack(b, 1000 + i + shift);
    if (in_a < 0 || in_b < 0) continue;
    matches.push_back({in_a, in_b, 10, 0, 0});
  }
  return matches;
}

class Rivals : public ::testing::Test {
 protected:
  Rivals() : pair_(MakeSyntheticPair(Options())) {
    a_ = *MakeSubmapPoints(pair_.a, 1000);
    b_ = *MakeSubmapPoints(pair_.b, 1000);
  }

  static SyntheticPairOptions Options() {
    SyntheticPairOptions options;
    options.shape = SceneShape::kLattice;
    return options;
  }

  double Share(const DescriptorMatches& matches) const {
    return BestRivalShare(a_, b_, matches, pair_.a_from_b, {}, {}, {});
  }

  SyntheticPair pair_;
  SubmapPoints a_, b_;
};

TEST_F(Rivals, UniquePointsHaveNone) {
  DescriptorMatches matches;
  matches.putative = matches.alternatives = LatticeMatches(a_, b_, 0);
  ASSERT_GT(matches.putative.size(), 60u);
  EXPECT_LT(Share(matches), 0.1);
}

TEST_F(Rivals, LatticeThatLooksTheSameOneCellFurther) {
  DescriptorMatches matches;
  matches.putative = matches.alternatives = LatticeMatches(a_, b_, 0);
  for (const PointMatch& match : LatticeMatches(a_, b_, 1)) matches.alternatives.push_back(match);
  EXPECT_GT(Share(matches), 0.7);
}

TEST_F(Rivals, WinnerWithoutSupportIsNoWinner) {
  DescriptorMatches matches;
  matches.putative = matches.alternatives = LatticeMatches(a_, b_, 1);
  EXPECT_GE(Share(matches), 1.0);
  EXPECT_GE(Share({}), 1.0);
}

}  // namespace
}  // namespace portolan
