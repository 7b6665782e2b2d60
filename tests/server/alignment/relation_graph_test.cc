#include "server/alignment/relation_graph.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/numeric_derivative.h"

namespace portolan {
namespace {

class RelationGraphTest : public ::testing::Test {
 protected:
  Vector7d RandomTangent(double size) {
    std::uniform_real_distribution<double> uniform(-size, size);
    Vector7d tangent;
    for (int i = 0; i < 7; ++i) tangent[i] = uniform(random_);
    return tangent;
  }

  // A closed ring whose links carry noise, started from the chain of links.
  RelationGraph Ring(int count, double noise, std::vector<Similarity3>* truth) {
    RelationGraph graph;
    for (int i = 0; i < count; ++i) {
      const double angle = 2 * M_PI * i / count;
      truth->push_back({1 + 0.05 * std::sin(angle),
                        RotationExp({0, 0, angle}),
                        {5 * std::cos(angle), 5 * std::sin(angle), 0}});
      graph.fixed.push_back(i == 0);
    }
    graph.world_from_node.push_back(truth->front());
    const Matrix7d information = Matrix7d::Identity() / (noise * noise + 1e-8);
    for (int i = 0; i + 1 < count; ++i) {
      const Similarity3 measured =
          (*truth)[i].Inverse() * (*truth)[i + 1] * Similarity3::Exp(RandomTangent(1.7 * noise));
      graph.relations.push_back({i, i + 1, measured, information, false});
      graph.world_from_node.push_back(graph.world_from_node.back() * measured);
    }
    return graph;
  }

  double Error(const RelationGraph& graph, const std::vector<Similarity3>& truth) {
    double worst = 0;
    for (size_t i = 0; i < truth.size(); ++i) {
      worst = std::max(worst, (graph.world_from_node[i].translation - truth[i].translation).norm());
    }
    return worst;
  }

  std::mt19937 random_{11};
};

TEST_F(RelationGraphTest, JacobiansEqualTheNumericOnes) {
  for (int i = 0; i < 20; ++i) {
    const Similarity3 a = Similarity3::Exp(RandomTangent(1.0));
    const Similarity3 b = Similarity3::Exp(RandomTangent(1.0));
    const Similarity3 measured = a.Inverse() * b * Similarity3::Exp(RandomTangent(0.3));
    Matrix7d d_a, d_b;
    RelationError(measured, a, b, &d_a, &d_b);
    const Eigen::MatrixXd numeric_a = NumericJacobianAtZero(7, [&](const Eigen::VectorXd& d) {
      return RelationError(measured, a * Similarity3::Exp(d), b);
    });
    const Eigen::MatrixXd numeric_b = NumericJacobianAtZero(7, [&](const Eigen::VectorXd& d) {
      return RelationError(measured, a, b * Similarity3::Exp(d));
    });
    EXPECT_LT((d_a - numeric_a).norm(), 1e-6 * numeric_a.norm());
    EXPECT_LT((d_b - numeric_b).norm(), 1e-6 * numeric_b.norm());
  }
}

TEST_F(RelationGraphTest, ExactRelationsGiveTheExactGraphFromAPoorStart) {
  std::vector<Similarity3> truth;
  RelationGraph graph = Ring(12, 0, &truth);
  graph.relations.push_back({11, 0, truth[11].Inverse() * truth[0], Matrix7d::Identity(), false});
  for (size_t i = 1; i < graph.world_from_node.size(); ++i) {
    graph.world_from_node[i] = graph.world_from_node[i] * Similarity3::Exp(RandomTangent(0.2));
  }
  SolveRelationGraph({}, &graph);
  EXPECT_LT(Error(graph, truth), 1e-6);
}

TEST_F(RelationGraphTest, LoopClosureSpreadsTheDrift) {
  std::vector<Similarity3> truth;
  RelationGraph graph = Ring(30, 0.01, &truth);
  const double before = Error(graph, truth);
  graph.relations.push_back(
      {29, 0, truth[29].Inverse() * truth[0], 1e6 * Matrix7d::Identity(), true});
  const std::vector<double> weights = SolveRelationGraph({}, &graph);
  EXPECT_EQ(weights.back(), 1);
  EXPECT_LT(Error(graph, truth), 0.7 * before);
}

// The table of false closures: up to a half of them wrong, and still the clean solution.
TEST_F(RelationGraphTest, FalseClosuresAreLeftOut) {
  for (const double wrong_share : {0.1, 0.3, 0.5}) {
    std::vector<Similarity3> truth;
    RelationGraph graph = Ring(40, 0.002, &truth);
    std::vector<bool> wrong;
    for (int i = 0; i < 20; ++i) {
      const int a = i;
      const int b = 39 - i / 2;
      wrong.push_back(i < 20 * wrong_share);
      Similarity3 measured = truth[a].Inverse() * truth[b];
      measured = wrong.back() ? measured * Similarity3::Exp(RandomTangent(1.0))
                              : measured * Similarity3::Exp(RandomTangent(0.01));
      graph.relations.push_back({a, b, measured, 1e4 * Matrix7d::Identity(), true});
    }
    const std::vector<double> weights = SolveRelationGraph({}, &graph);
    for (int i = 0; i < 20; ++i) {
      EXPECT_EQ(weights[39 + i] > 0.5, !wrong[i]) << wrong_share << " closure " << i;
    }
    EXPECT_LT(Error(graph, truth), 0.1) << wrong_share;
  }
}

TEST_F(RelationGraphTest, NothingFreeIsJudgedOnly) {
  RelationGraph graph;
  graph.world_from_node = {Similarity3::Identity()};
  graph.fixed = {true};
  graph.relations.push_back(
      {0, 0, Similarity3::Exp(Vector7d::Constant(1)), 1e4 * Matrix7d::Identity(), true});
  EXPECT_EQ(SolveRelationGraph({}, &graph), std::vector<double>{0});
}

}  // namespace
}  // namespace portolan
