#include "server/verification/pairwise_consistency.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <random>

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// Two sessions of ten submaps each (ids 1-10 and 101-110) whose relations are known exactly, with
// the frames of the second in a world of another scale.
class PairwiseConsistency : public ::testing::Test {
 protected:
  PairwiseConsistency() : random_(7) {
    for (int i = 0; i < 10; ++i) {
      world_from_[i + 1] = RandomSimilarity(3.0, 1.0);
      world_from_[i + 101] = RandomSimilarity(3.0, 2.5);
    }
  }

  double Uniform() { return std::uniform_real_distribution<double>(-1, 1)(random_); }
  Eigen::Vector3d Vector(double range) {
    return range * Eigen::Vector3d(Uniform(), Uniform(), Uniform());
  }
  Similarity3 RandomSimilarity(double range, double scale) {
    return {scale * std::exp(0.2 * Uniform()), RotationExp(Vector(1.5)), Vector(range)};
  }

  RelativeSimilarity Relative() const {
    return [this](SubmapId a, SubmapId b) -> std::optional<UncertainSimilarity> {
      if ((a.value() > 100) != (b.value() > 100)) return std::nullopt;
      return UncertainSimilarity{world_from_.at(a.value()).Inverse() * world_from_.at(b.value()),
                                 Matrix7d::Identity() * (a == b ? 0.0 : 1e-6)};
    };
  }

  Closure TrueClosure(int a, int b) {
    Closure closure;
    closure.a = SubmapId(a);
    closure.b = SubmapId(b);
    Vector7d noise;
    noise << Vector(0.005), Vector(0.002), 0.003 * Uniform();
    closure.a_from_b = world_from_.at(a).Inverse() * world_from_.at(b) * Similarity3::Exp(noise);
    closure.information = Matrix7d::Identity() * 1e5;
    closure.matches.resize(30);
    return closure;
  }

  Closure FalseClosure(int a, int b) {
    Closure closure = TrueClosure(a, b);
    closure.a_from_b = RandomSimilarity(3.0, 1.5);
    return closure;
  }

  std::mt19937 random_;
  std::map<int64_t, Similarity3> world_from_;
  PairwiseConsistencyOptions options_;
};

TEST_F(PairwiseConsistency, FindsTheTrueOnesAmongFalseOnes) {
  std::vector<Closure> closures;
  std::vector<size_t> expected;
  for (int i = 0; i < 10; ++i) {
    if (i % 2 == 0) expected.push_back(closures.size());
    closures.push_back(i % 2 == 0 ? TrueClosure(i + 1, 101 + (i * 7) % 10)
                                  : FalseClosure(i + 1, 101 + (i * 3) % 10));
  }
  EXPECT_EQ(LargestConsistentSet(closures, Relative(), options_), expected);
}

TEST_F(PairwiseConsistency, EndsMayBeExchanged) {
  const Closure first = TrueClosure(2, 105);
  const Closure second = TrueClosure(107, 3);
  const auto distance = LoopMahalanobisSquared(first, second, Relative(), options_);
  ASSERT_TRUE(distance);
  EXPECT_LT(*distance, options_.max_mahalanobis_squared);
  EXPECT_THAT(LargestConsistentSet({first, FalseClosure(4, 104), second}, Relative(), options_),
              ElementsAre(0, 2));
}

// The loop's covariance against the spread of its error: the distance has mean 7.
TEST_F(PairwiseConsistency, DistanceIsChiSquared) {
  options_.translation_floor = options_.rotation_floor_rad = options_.log_scale_floor = 0;
  std::normal_distribution<double> normal(0, 1);
  const double sigma = 0.003;
  double sum = 0;
  const int count = 2000;
  const auto noisy = [&](Closure closure) {
    Vector7d noise;
    for (int i = 0; i < 7; ++i) noise[i] = sigma * normal(random_);
    closure.a_from_b = world_from_.at(closure.a.value()).Inverse() *
                       world_from_.at(closure.b.value()) * Similarity3::Exp(noise);
    closure.information = Matrix7d::Identity() / (sigma * sigma);
    return closure;
  };
  const auto exact = [this](SubmapId a, SubmapId b) -> std::optional<UncertainSimilarity> {
    if ((a.value() > 100) != (b.value() > 100)) return std::nullopt;
    return UncertainSimilarity{world_from_.at(a.value()).Inverse() * world_from_.at(b.value()),
                               Matrix7d::Zero()};
  };
  for (int i = 0; i < count; ++i) {
    const auto distance = LoopMahalanobisSquared(noisy(TrueClosure(1, 102)),
                                                 noisy(TrueClosure(4, 106)), exact, options_);
    ASSERT_TRUE(distance);
    sum += *distance;
  }
  EXPECT_NEAR(sum / count, 7.0, 0.5);
}

TEST_F(PairwiseConsistency, UnrelatedOrBrokenClosuresDoNotAgree) {
  const auto unknown = [](SubmapId, SubmapId) { return std::optional<UncertainSimilarity>(); };
  const std::vector<Closure> two = {TrueClosure(1, 101), TrueClosure(2, 102)};
  EXPECT_EQ(LargestConsistentSet(two, unknown, options_).size(), 1u);
  Closure broken = TrueClosure(1, 101);
  broken.information.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_FALSE(LoopMahalanobisSquared(broken, two[1], Relative(), options_));
  EXPECT_THAT(LargestConsistentSet({}, unknown, options_), IsEmpty());
}

TEST_F(PairwiseConsistency, MoreLandmarkMatchesBreakATie) {
  Closure weak = FalseClosure(1, 101), strong = FalseClosure(5, 107);
  strong.matches.resize(50);
  EXPECT_THAT(LargestConsistentSet({weak, strong}, Relative(), options_), ElementsAre(1));
}

TEST_F(PairwiseConsistency, SearchIsBoundedAndThenGreedy) {
  options_.max_branches = 0;
  std::vector<Closure> closures;
  for (int i = 0; i < 100; ++i) {
    closures.push_back(i % 3 == 0 ? TrueClosure(1 + i % 10, 101 + (i / 10) % 10)
                                  : FalseClosure(1 + i % 10, 101 + (i / 10) % 10));
  }
  EXPECT_EQ(LargestConsistentSet(closures, Relative(), options_).size(), 34u);
}

}  // namespace
}  // namespace portolan
