#include "server/alignment/closure_judge.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace portolan {
namespace {

// Chains of nodes on a spiral, linked with small noise, and closures between the chains.
class FleetGraph {
 public:
  explicit FleetGraph(unsigned seed) : random_(seed) {
    for (int chain = 0; chain < kChains; ++chain) {
      const double scale = 1 + 0.3 * chain;
      for (int i = 0; i < kLength; ++i) {
        const double angle = 0.25 * i + 0.4 * chain;
        const Eigen::Vector3d position(3 * std::cos(angle), 3 * std::sin(angle), 0.1 * i);
        const Rigid3 pose{RotationExp({0.1 * i, 0, angle}), position};
        truth_.push_back(Similarity3::FromRigid(pose, scale));
      }
    }
    for (int node = 0; node < count(); ++node) {
      if (node % kLength != 0) Add(node - 1, node, Vector7d::Zero(), false);
    }
  }

  int count() const { return static_cast<int>(truth_.size()); }

  void AddClosure(int a, int b) { Add(a, b, Vector7d::Zero(), true); }
  void AddWrongClosure(int a, int b) {
    Vector7d error;
    for (int i = 0; i < 7; ++i) error[i] = std::uniform_real_distribution<double>(-1, 1)(random_);
    error[0] += 1;
    Add(a, b, error, true);
  }
  // `share` of all closures between random nodes of different chains are wrong.
  void AddClosures(int good, int wrong) {
    while (good + wrong > 0) {
      const int a = static_cast<int>(random_() % truth_.size());
      const int b = static_cast<int>(random_() % truth_.size());
      if (a / kLength == b / kLength) continue;
      if (good > 0) {
        --good;
        AddClosure(a, b);
      } else {
        --wrong;
        AddWrongClosure(a, b);
      }
    }
  }

  JudgedFleet Judge(ClosureSelection selection) const {
    ClosureJudgeOptions options;
    options.selection = selection;
    return JudgeClosures(options, count(), relations_, support_);
  }

  // Largest distance of a node from where the truth has it, seen from the first one.
  double Error(const std::vector<Similarity3>& world_from_node) const {
    double worst = 0;
    for (int i = 0; i < count(); ++i) {
      const Similarity3 expected = truth_[0].Inverse() * truth_[i];
      const Similarity3 estimated = world_from_node[0].Inverse() * world_from_node[i];
      worst = std::max(worst, (expected.translation - estimated.translation).norm());
    }
    return worst;
  }

  const std::vector<Relation>& relations() const { return relations_; }
  bool IsWrong(size_t relation) const { return wrong_[relation]; }

  static constexpr int kChains = 3, kLength = 8;

 private:
  void Add(int a, int b, const Vector7d& error, bool doubtful) {
    Vector7d noise;
    for (int i = 0; i < 7; ++i) noise[i] = std::normal_distribution<double>(0, kSigma)(random_);
    Relation relation;
    relation.a = a;
    relation.b = b;
    relation.a_from_b = truth_[a].Inverse() * truth_[b] * Similarity3::Exp(error + noise);
    relation.information = Matrix7d::Identity() / (kSigma * kSigma);
    relation.doubtful = doubtful;
    relations_.push_back(relation);
    support_.push_back(doubtful ? 30 : 0);
    wrong_.push_back(!error.isZero());
  }

  static constexpr double kSigma = 0.003;
  std::mt19937 random_;
  std::vector<Similarity3> truth_;
  std::vector<Relation> relations_;
  std::vector<int> support_;
  std::vector<bool> wrong_;
};

TEST(ChordalStart, IsNearTheTruthWithoutAnyInitialValue) {
  FleetGraph fleet(1);
  fleet.AddClosures(20, 0);
  EXPECT_LT(fleet.Error(ChordalStart(fleet.count(), fleet.relations())), 0.1);
}

TEST(ClosureJudge, BelievesAllTrueClosures) {
  for (const auto selection :
       {ClosureSelection::kPairwise, ClosureSelection::kGraduated,
        ClosureSelection::kPairwiseThenGraduated, ClosureSelection::kPairwiseStart}) {
    FleetGraph fleet(2);
    fleet.AddClosures(20, 0);
    const JudgedFleet judged = fleet.Judge(selection);
    EXPECT_EQ(std::count(judged.accepted.begin(), judged.accepted.end(), false), 0);
    EXPECT_EQ(judged.part_of_node, std::vector<int>(fleet.count(), 0));
    EXPECT_LT(fleet.Error(judged.world_from_node), 0.05);
  }
}

TEST(ClosureJudge, RefusesHalfOfTheClosures) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    FleetGraph fleet(seed);
    fleet.AddClosures(20, 20);
    const JudgedFleet judged = fleet.Judge(ClosureSelection::kPairwiseStart);
    for (size_t i = 0; i < fleet.relations().size(); ++i) {
      EXPECT_EQ(judged.accepted[i], !fleet.IsWrong(i)) << "seed " << seed << ", relation " << i;
    }
    EXPECT_LT(fleet.Error(judged.world_from_node), 0.05) << seed;
  }
}

TEST(ClosureJudge, ChainsThatNothingJoinsStayParts) {
  FleetGraph fleet(3);
  fleet.AddClosure(0, 9);
  fleet.AddClosure(2, 12);
  fleet.AddClosure(1, 17);  // alone, with 30 matches
  const JudgedFleet judged = fleet.Judge(ClosureSelection::kPairwiseStart);
  for (int node = 0; node < fleet.count(); ++node) {
    EXPECT_EQ(judged.part_of_node[node], node < 2 * FleetGraph::kLength ? 0 : 16) << node;
  }
  EXPECT_FALSE(judged.accepted.back());
}

}  // namespace
}  // namespace portolan
