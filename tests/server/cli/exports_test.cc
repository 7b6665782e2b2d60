#include "server/cli/exports.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "common/trajectory/trajectory_io.h"
#include "common/wire/geometry_wire.h"
#include "server/pose_graph/g2o_file.h"
#include "tests/support/temp_dir.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

Similarity3 MakeSimilarity(double scale, const Eigen::Vector3d& rotation,
                           const Eigen::Vector3d& translation) {
  return {scale, RotationExp(rotation), translation};
}

TEST(WriteTum, ReadsBackToTheNanosecond) {
  v1::TrajectorySegment segment;
  segment.add_time_ns(1305031102175304321);
  segment.add_time_ns(1305031102275304321);
  const Rigid3 pose = MakeSimilarity(1, {0.1, -0.2, 0.3}, {1, 2, 3}).Rigid();
  AppendPose(pose, segment.mutable_world_from_camera());
  AppendPose(pose, segment.mutable_world_from_camera());
  std::stringstream text;
  WriteTum({segment}, text);
  const auto trajectory = ParseTumTrajectory(text, "text");
  ASSERT_TRUE(trajectory.ok()) << trajectory.status();
  ASSERT_EQ(trajectory->size(), 2u);
  EXPECT_EQ((*trajectory)[0].time.count(), 1305031102175304321);
  EXPECT_TRUE((*trajectory)[1].world_from_body.Matrix().isApprox(pose.Matrix(), 1e-10));
}

TEST(WritePly, HasOneLineALandmark) {
  v1::LandmarkPage page;
  v1::Landmark* landmark = page.add_landmarks();
  landmark->mutable_point_in_world()->set_x(1.5);
  for (const float value : {4.f, 0.f, 0.f, 9.f, 0.f, 1.f}) landmark->add_covariance(value);
  landmark->set_observation_count(7);
  landmark->add_agents(0);
  std::stringstream text;
  WritePly(page, text);
  EXPECT_THAT(text.str(), HasSubstr("element vertex 1\n"));
  EXPECT_THAT(text.str(), HasSubstr("end_header\n1.5 0 0 3 7 1\n"));
}

class WriteG2oTest : public ::testing::Test {
 protected:
  // Two submaps of different scale and the edge that fits them exactly but for `error`.
  static v1::PoseGraphPage MakeGraph(const Similarity3& error) {
    const Similarity3 world_from_a = MakeSimilarity(2, {0.3, 0.1, -0.5}, {1, 2, 3});
    const Similarity3 world_from_b = MakeSimilarity(4, {-0.2, 0.6, 0.1}, {5, -1, 2});
    v1::PoseGraphPage graph;
    for (const auto& [id, pose] : {std::pair(1, world_from_a), std::pair(2, world_from_b)}) {
      v1::PoseGraphNode* node = graph.add_nodes();
      node->set_submap_id(id);
      node->set_agent_id("a");
      node->set_time_ns(5250000000);
      ToProto(pose, node->mutable_world_from_submap());
    }
    v1::PoseGraphEdge* edge = graph.add_edges();
    edge->set_submap_a(1);
    edge->set_submap_b(2);
    ToProto(world_from_a.Inverse() * world_from_b * error, edge->mutable_a_from_b());
    for (int row = 0; row < 7; ++row) {
      for (int column = row; column < 7; ++column) edge->add_information(row == column ? 100 : 0);
    }
    return graph;
  }
  PoseGraph3 WriteAndRead(const v1::PoseGraphPage& graph) {
    const std::string path = (directory_ / "graph.g2o").string();
    {
      std::ofstream file(path);
      WriteG2o(graph, file);
    }
    auto read = ReadG2o(path);
    EXPECT_TRUE(read.ok()) << read.status();
    return std::get<PoseGraph3>(*read);
  }

  TempDir directory_;
};

TEST_F(WriteG2oTest, ConsistentSimilaritiesGiveConsistentPoses) {
  const PoseGraph3 graph = WriteAndRead(MakeGraph(Similarity3::Identity()));
  ASSERT_EQ(graph.ids.size(), 2u);
  ASSERT_EQ(graph.edges.size(), 1u);
  EXPECT_LT(Chi2(graph), 1e-12);
}

TEST_F(WriteG2oTest, CostIsThatOfTheSimilarityInItsOwnUnits) {
  // An error of 0.01 b units and 0.02 rad: 100 * (0.01^2 + 0.02^2).
  const PoseGraph3 graph = WriteAndRead(MakeGraph(MakeSimilarity(1, {0, 0.02, 0}, {0.01, 0, 0})));
  EXPECT_NEAR(Chi2(graph), 0.05, 1e-4);
}

TEST_F(WriteG2oTest, TimesAreInComments) {
  std::stringstream text;
  WriteG2o(MakeGraph(Similarity3::Identity()), text);
  EXPECT_THAT(text.str(), HasSubstr("# 5.250000000 a "));
}

}  // namespace
}  // namespace portolan
