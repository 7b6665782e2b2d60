// The whole product on a rendered mission: three vehicles, each from image files to submaps, one
// server in lockstep, one map, its trajectories, landmarks and file.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <iostream>
#include <opencv2/core/utility.hpp>
#include <thread>
#include <vector>

#include "agent/agent_runner.h"
#include "common/client/map_client.h"
#include "common/trajectory/evaluation.h"
#include "common/trajectory/trajectory_io.h"
#include "server/map_builder_engine.h"
#include "server/server.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/synthetic/euroc_writer.h"

namespace portolan {
namespace {

// Half a loop each: after a third of it every vehicle flies where another one has been.
constexpr int kFrames = 150;
// Limits. Measured: 0.023 % of all vehicles' path, 1.000.
constexpr double kMaxErrorShareOfPath = 0.001;
constexpr double kMinCoverage = 0.95;

synthetic::Mission MakeSmallMission() {
  synthetic::MissionOptions options;
  options.name = "three_agents";
  options.frames = kFrames;
  options.camera = synthetic::MissionOptions::SmallCamera();
  return *MakeMission(options);
}

// Camera poses of all frames as the server knows them; all must be in one component.
Trajectory ServerTrajectory(const MapClient& client, const std::string& agent,
                            int64_t component_id) {
  v1::GetTrajectoryRequest request;
  request.set_agent_id(agent);
  request.set_kind(v1::TRAJECTORY_KIND_FRAMES);
  const auto segments = client.GetTrajectory(request);
  EXPECT_THAT(segments, IsOk());
  Trajectory trajectory;
  if (!segments.ok()) return trajectory;
  for (const v1::TrajectorySegment& segment : *segments) {
    EXPECT_EQ(segment.component_id(), component_id);
    for (int i = 0; i < segment.time_ns_size(); ++i) {
      const double* pose = segment.world_from_camera().data() + 7 * i;
      trajectory.push_back(
          {Timestamp(segment.time_ns(i)),
           {Eigen::Quaterniond(pose[0], pose[1], pose[2], pose[3]), {pose[4], pose[5], pose[6]}}});
    }
  }
  EXPECT_THAT(ValidateTrajectory(trajectory), IsOk());
  return trajectory;
}

class MissionTest : public ::testing::Test {
 protected:
  MissionTest() : mission_(MakeSmallMission()) {
    cv::setNumThreads(1);
    for (size_t i = 0; i < mission_.agents.size(); ++i) {
      truth_.push_back(CameraGroundTruth(mission_, static_cast<int>(i)));
    }
  }

  std::unique_ptr<Server> StartServer() const {
    ServerOptions options;
    options.map_file = folder_ / "map";
    options.listen = "127.0.0.1:0";
    for (const auto& agent : mission_.agents) {
      options.ingest.lockstep_agents.emplace_back(agent.name);
    }
    auto engine = MakeMapBuilderEngine(MapBuilderOptions());
    EXPECT_THAT(engine, IsOk());
    auto server = Server::Start(options, std::move(*engine));
    EXPECT_THAT(server, IsOk());
    return server.ok() ? std::move(*server) : nullptr;
  }

  // Renders what one vehicle sees and runs it. Own thread.
  void RunAgent(size_t i, const std::string& server) const {
    const std::string& name = mission_.agents[i].name;
    ASSERT_THAT(WriteEurocAgent(mission_, static_cast<int>(i), folder_.path().string(), {}),
                IsOk());
    ImageSourceOptions source_options;
    source_options.path = folder_ / name;
    auto source = OpenImageSource(source_options);
    ASSERT_THAT(source, IsOk());
    RunnerOptions options;
    options.agent = name;
    options.server = server;
    options.outbox = folder_ / (name + "_outbox");
    options.output = folder_ / (name + "_output");
    options.session = i + 1;
    options.progress = false;
    auto runner = AgentRunner::Create(options, AgentOptions(), UplinkOptions(), OutboxOptions(),
                                      std::move(*source));
    ASSERT_THAT(runner, IsOk());
    EXPECT_THAT((*runner)->Run(false), IsOk());
    EXPECT_EQ((*runner)->summary().frames, kFrames);
    EXPECT_EQ((*runner)->summary().lost, 0);
    EXPECT_EQ((*runner)->summary().pending_submaps, 0u);
    EXPECT_GT((*runner)->summary().received_bytes, 0u);
  }

  void RunAgents(const std::string& server) const {
    std::vector<std::thread> threads;
    for (size_t i = 0; i < mission_.agents.size(); ++i) {
      threads.emplace_back([this, i, &server] { RunAgent(i, server); });
    }
    for (std::thread& thread : threads) thread.join();
  }

  std::vector<Trajectory> ReadOutput(const std::string& file) const {
    std::vector<Trajectory> trajectories;
    for (const auto& agent : mission_.agents) {
      auto trajectory = ReadTumTrajectory(folder_ / (agent.name + "_output") / file);
      EXPECT_THAT(trajectory, IsOk());
      trajectories.push_back(trajectory.value_or(Trajectory()));
    }
    return trajectories;
  }

  TrajectoryEvaluation Evaluate(const std::vector<Trajectory>& estimates) const {
    std::vector<TrajectoryPair> pairs;
    for (size_t i = 0; i < estimates.size(); ++i) {
      pairs.push_back({mission_.agents[i].name, &estimates[i], &truth_[i]});
    }
    auto evaluation = EvaluateTrajectories(pairs, EvaluationOptions());
    EXPECT_THAT(evaluation, IsOk());
    return evaluation.value_or(TrajectoryEvaluation());
  }

  // The accuracy of the map and of what it told the vehicles, against their odometry.
  void ExpectAccurate(const std::vector<Trajectory>& server) const {
    const TrajectoryEvaluation map = Evaluate(server);
    const TrajectoryEvaluation corrected = Evaluate(ReadOutput("corrected.tum"));
    const TrajectoryEvaluation odometry = Evaluate(ReadOutput("odometry.tum"));
    const double limit_m = kMaxErrorShareOfPath * map.joint.reference_path_m;
    std::cout << "path " << map.joint.reference_path_m << " m, joint ATE " << map.joint.ate_m.rmse
              << " m, as told to the vehicles " << corrected.joint.ate_m.rmse << " m, limit "
              << limit_m << " m, coverage " << map.joint.coverage << "\n";
    EXPECT_LT(map.joint.ate_m.rmse, limit_m);
    EXPECT_GE(map.joint.coverage, kMinCoverage);
    EXPECT_LT(corrected.joint.ate_m.rmse, limit_m);
    EXPECT_GE(corrected.joint.coverage, kMinCoverage);
    ASSERT_EQ(odometry.agents_alone.size(), mission_.agents.size());
    for (const auto& alone : odometry.agents_alone) {
      ASSERT_TRUE(alone);
      std::cout << "odometry of " << alone->name << " aligned alone: " << alone->ate_m.rmse
                << " m\n";
      EXPECT_LT(map.joint.ate_m.rmse, alone->ate_m.rmse) << alone->name;
    }
  }

  const TempDir folder_;
  const synthetic::Mission mission_;
  std::vector<Trajectory> truth_;
};

v1::QueryLandmarksRequest LandmarksNear(const Eigen::Vector3d& point) {
  v1::QueryLandmarksRequest request;
  request.mutable_nearest()->mutable_point()->set_x(point.x());
  request.mutable_nearest()->mutable_point()->set_y(point.y());
  request.mutable_nearest()->mutable_point()->set_z(point.z());
  request.mutable_nearest()->set_count(200);
  return request;
}

std::vector<int64_t> Ids(const v1::LandmarkPage& page) {
  std::vector<int64_t> ids;
  for (const v1::Landmark& landmark : page.landmarks()) ids.push_back(landmark.landmark_id());
  return ids;
}

TEST_F(MissionTest, ThreeVehiclesMakeOneAccurateMapThatLasts) {
  v1::QueryLandmarksRequest request;
  std::vector<int64_t> ids;
  {
    const auto server = StartServer();
    ASSERT_TRUE(server);
    RunAgents(server->address());
    const MapClient client(server->address());
    const auto info = client.GetMapInfo();
    ASSERT_THAT(info, IsOk());
    ASSERT_EQ(info->components_size(), 1);
    EXPECT_EQ(info->components(0).agent_ids_size(), 3);
    EXPECT_EQ(info->quarantined_submap_count(), 0u);
    std::vector<Trajectory> estimates;
    for (const auto& agent : mission_.agents) {
      estimates.push_back(ServerTrajectory(client, agent.name, info->components(0).component_id()));
      ASSERT_FALSE(estimates.back().empty());
    }
    ExpectAccurate(estimates);
    request = LandmarksNear(estimates[0].back().world_from_body.translation);
    const auto page = client.QueryLandmarks(request);
    ASSERT_THAT(page, IsOk());
    ids = Ids(*page);
    EXPECT_EQ(ids.size(), 200u);
    EXPECT_TRUE(std::any_of(page->landmarks().begin(), page->landmarks().end(),
                            [](const auto& landmark) { return landmark.agents_size() > 1; }))
        << "some landmarks are of several vehicles";
  }
  const auto second = StartServer();
  ASSERT_TRUE(second);
  const auto page = MapClient(second->address()).QueryLandmarks(request);
  ASSERT_THAT(page, IsOk());
  EXPECT_EQ(Ids(*page), ids);
}

}  // namespace
}  // namespace portolan
