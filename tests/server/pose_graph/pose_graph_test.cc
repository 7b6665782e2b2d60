#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>

#include "server/pose_graph/chordal_initialization.h"
#include "server/pose_graph/g2o_file.h"
#include "server/pose_graph/pose_graph_solver.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

// Poses on a torus of rings and slices, joined along both circles by noisy edges.
struct TorusWorld {
  PoseGraph3 graph;  // started by dead reckoning along node order
  std::vector<Rigid3> truth;
};

Rigid3 Noise(double sigma_translation, double sigma_rotation, std::mt19937& random) {
  std::normal_distribution<double> normal;
  Vector6d noise;
  for (int i = 0; i < 6; ++i) noise[i] = normal(random);
  noise.head<3>() *= sigma_translation;
  noise.tail<3>() *= sigma_rotation;
  return Rigid3::Exp(noise);
}

TorusWorld MakeTorus(int rings, int slices, double sigma_translation, double sigma_rotation,
                     unsigned seed) {
  std::mt19937 random(seed);
  TorusWorld world;
  for (int i = 0; i < rings * slices; ++i) {
    const double u = 2 * M_PI * (i / slices) / rings, v = 2 * M_PI * (i % slices) / slices;
    const Eigen::Vector3d position((4 + std::cos(v)) * std::cos(u), (4 + std::cos(v)) * std::sin(u),
                                   std::sin(v));
    world.truth.push_back({RotationExp({0, 0, u}) * RotationExp({0, -v, 0}), position});
    world.graph.ids.push_back(i + 10);
  }
  const auto add_edge = [&](int a, int b) {
    PoseEdge3 edge{a, b, {}, Matrix6d::Identity()};
    edge.a_from_b = world.truth[static_cast<size_t>(a)].Inverse() *
                    world.truth[static_cast<size_t>(b)] *
                    Noise(sigma_translation, sigma_rotation, random);
    edge.information.diagonal().head<3>().setConstant(1 / std::pow(sigma_translation, 2));
    edge.information.diagonal().tail<3>().setConstant(4 / std::pow(sigma_rotation, 2));
    world.graph.edges.push_back(edge);
  };
  for (int i = 0; i + 1 < rings * slices; ++i) add_edge(i, i + 1);
  for (int i = 0; i + slices < rings * slices; ++i) add_edge(i, i + slices);
  for (int i = 0; i < slices; ++i) add_edge((rings - 1) * slices + i, i);
  world.graph.world_from_node.push_back(world.truth[0]);
  for (int i = 0; i + 1 < rings * slices; ++i) {
    world.graph.world_from_node.push_back(world.graph.world_from_node.back() *
                                          world.graph.edges[static_cast<size_t>(i)].a_from_b);
  }
  return world;
}

TEST(PoseGraphSolver, FindsTheMinimumNearTheTruthFromAPoorStart) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    TorusWorld world = MakeTorus(20, 15, 0.05, 0.12, seed);
    PoseGraph3 from_truth = world.graph;
    from_truth.world_from_node = world.truth;
    PoseGraphSolverOptions options;
    const auto from_file = SolvePoseGraph(options, world.graph);
    options.chordal_start = false;
    const auto reference = SolvePoseGraph(options, from_truth);
    ASSERT_TRUE(from_file.ok());
    ASSERT_TRUE(reference.ok());
    EXPECT_GT(from_file->initial_chi2, 10 * reference->final_chi2);
    EXPECT_NEAR(from_file->final_chi2, reference->final_chi2, 1e-5 * reference->final_chi2);
  }
}

TEST(PoseGraphSolver, Chi2AtTheMinimumHasTheExpectedSize) {
  TorusWorld world = MakeTorus(20, 15, 0.02, 0.02, 3);
  ASSERT_TRUE(SolvePoseGraph(PoseGraphSolverOptions(), world.graph).ok());
  // 6 (edges - nodes + 1) degrees of freedom; five standard deviations.
  const double dof = 6.0 * (static_cast<double>(world.graph.edges.size()) - 300 + 1);
  EXPECT_NEAR(Chi2(world.graph), dof, 5 * std::sqrt(2 * dof));
}

TEST(PoseGraphSolver, SolvesTwoPartsAndHoldsFixedNodes) {
  TorusWorld world = MakeTorus(6, 5, 0.02, 0.02, 4);
  const size_t nodes = world.truth.size();
  PoseGraph3 twice = world.graph;
  for (size_t i = 0; i < nodes; ++i) {
    twice.ids.push_back(1000 + static_cast<int64_t>(i));
    twice.world_from_node.push_back(world.graph.world_from_node[i]);
  }
  for (PoseEdge3 edge : world.graph.edges) {
    edge.a += static_cast<int>(nodes);
    edge.b += static_cast<int>(nodes);
    twice.edges.push_back(edge);
  }
  twice.fixed = {7};
  const Rigid3 held = twice.world_from_node[7];
  const auto summary = SolvePoseGraph(PoseGraphSolverOptions(), twice);
  ASSERT_TRUE(summary.ok());
  EXPECT_EQ(summary->connected_parts, 2);
  EXPECT_LT((twice.world_from_node[7].translation - held.translation).norm(), 1e-12);
  ASSERT_TRUE(SolvePoseGraph(PoseGraphSolverOptions(), world.graph).ok());
  EXPECT_NEAR(summary->final_chi2, 2 * Chi2(world.graph), 1e-6 * summary->final_chi2);
}

TEST(PoseGraphSolver, RecoversAPlanarSquareExactly) {
  PoseGraph2 graph;
  for (int i = 0; i < 4; ++i) {
    graph.ids.push_back(i);
    graph.world_from_node.push_back({0.3 * i, -0.2 * i, 1.1 * i});
    graph.edges.push_back({i, (i + 1) % 4, {2, 0, M_PI / 2}, Eigen::Matrix3d::Identity()});
  }
  graph.world_from_node[0].setZero();
  const auto summary = SolvePoseGraph(PoseGraphSolverOptions(), graph);
  ASSERT_TRUE(summary.ok());
  EXPECT_LT(summary->final_chi2, 1e-18);
  EXPECT_LT((graph.world_from_node[2].head<2>() - Eigen::Vector2d(2, 2)).norm(), 1e-8);
}

TEST(PoseGraphSolver, RefusesAnIndefiniteInformationMatrix) {
  TorusWorld world = MakeTorus(4, 4, 0.02, 0.02, 4);
  world.graph.edges[3].information(2, 2) = -1;
  const auto summary = SolvePoseGraph(PoseGraphSolverOptions(), world.graph);
  EXPECT_EQ(summary.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(summary.status().message()), HasSubstr("from 13 to 14"));
}

class G2oFile : public ::testing::Test {
 protected:
  G2oFile() {
    std::string pattern = (std::filesystem::temp_directory_path() / "g2o_XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  ~G2oFile() override { std::filesystem::remove_all(folder_); }

  std::string Path(const std::string& name) const { return (folder_ / name).string(); }
  std::string ErrorOf(const std::string& text) const {
    std::ofstream(Path("bad.g2o")) << text;
    return std::string(ReadG2o(Path("bad.g2o")).status().message());
  }

 private:
  std::filesystem::path folder_;
};

TEST_F(G2oFile, SurvivesARoundTrip) {
  TorusWorld world = MakeTorus(4, 4, 0.02, 0.02, 4);
  world.graph.fixed = {2};
  ASSERT_TRUE(WriteG2o(Path("a.g2o"), world.graph).ok());
  const auto read = ReadG2o(Path("a.g2o"));
  ASSERT_TRUE(read.ok()) << read.status();
  const auto& graph = std::get<PoseGraph3>(*read);
  EXPECT_EQ(graph.ids, world.graph.ids);
  EXPECT_EQ(graph.fixed, world.graph.fixed);
  EXPECT_NEAR(Chi2(graph), Chi2(world.graph), 1e-9 * Chi2(graph));
}

TEST_F(G2oFile, NamesFileAndLineOfWhatIsWrong) {
  EXPECT_THAT(ErrorOf("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 0 0 0 0\n"), HasSubstr(":2: node 0 is"));
  EXPECT_THAT(ErrorOf("VERTEX_SE2 0 0 nan 0\n"), HasSubstr(":1: 'nan' is not a finite number"));
  EXPECT_THAT(ErrorOf("VERTEX_SE2 0 0 0\n"), HasSubstr(":1: numbers are missing"));
  EXPECT_THAT(ErrorOf("VERTEX_SE2 0 0 0 0 9\n"), HasSubstr(":1: more fields"));
  EXPECT_THAT(ErrorOf("VERTEX_XY 0 0 0\n"), HasSubstr(":1: unknown tag 'VERTEX_XY'"));
  EXPECT_THAT(ErrorOf("VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 1 0 0 0 1 0 0 1 0 1\n"),
              HasSubstr(":2: an end of the edge"));
  EXPECT_THAT(ErrorOf("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 0\n"), HasSubstr(":1: the quaternion"));
  EXPECT_THAT(ErrorOf("VERTEX_SE2 0 0 0 0\nVERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n"),
              HasSubstr(":2: the file mixes"));
  EXPECT_THAT(ErrorOf("VERTEX_SE2 0 0 0 0\nFIX 5\n"), HasSubstr("FIX names node 5"));
  EXPECT_THAT(ErrorOf(""), HasSubstr("holds no pose graph"));
  EXPECT_EQ(ReadG2o(Path("none.g2o")).status().code(), absl::StatusCode::kNotFound);
}

// Published optima of the public graphs.
TEST(PublicPoseGraphs, ReachTheirKnownMinima) {
  const char* data = std::getenv("PORTOLAN_DATA");
  const std::filesystem::path folder =
      std::filesystem::path(data != nullptr ? data : "../shared/data") / "posegraph";
  if (!std::filesystem::exists(folder / "sphere2500.g2o")) {
    GTEST_SKIP() << "NO DATA: set PORTOLAN_DATA to a folder with posegraph/sphere2500.g2o";
  }
  const std::pair<const char*, double> cases[] = {{"sphere2500.g2o", 727.1497},
                                                  {"parking-garage.g2o", 1.238691}};
  for (const auto& [name, minimum] : cases) {
    auto graph = ReadG2o((folder / name).string());
    ASSERT_TRUE(graph.ok()) << graph.status();
    const auto summary = SolvePoseGraph(PoseGraphSolverOptions(), std::get<PoseGraph3>(*graph));
    ASSERT_TRUE(summary.ok());
    EXPECT_NEAR(summary->final_chi2, minimum, 1e-6 * minimum) << name;
  }
}

}  // namespace
}  // namespace portolan
