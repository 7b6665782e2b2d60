// From image files and a file of satellite positions to a map on the earth: one vehicle, the whole
// agent and server; then control points by the client. Nothing is aligned before it is compared.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <opencv2/core/utility.hpp>
#include <random>

#include "agent/agent_runner.h"
#include "common/client/map_client.h"
#include "common/geodesy/local_frame.h"
#include "server/map_builder_engine.h"
#include "server/server.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/synthetic/euroc_writer.h"

namespace portolan {
namespace {

constexpr int kFrames = 120;
constexpr double kSigma_m = 0.03;
const GeodeticPosition kHall{47.4, 8.5, 400};
const Eigen::Vector3d kAntenna_m(0.1, -0.4, -0.2);

class GeoreferencedMissionTest : public ::testing::Test {
 protected:
  GeoreferencedMissionTest() {
    cv::setNumThreads(1);
    synthetic::MissionOptions options;
    options.name = "loop";
    options.frames = kFrames;
    options.camera = synthetic::MissionOptions::SmallCamera();
    mission_ = *MakeMission(options);
    name_ = mission_.agents[0].name;
  }

  Rigid3 TrueCamera(int64_t time_ns) const {
    const double time_s = ToSeconds(Timestamp(time_ns) - mission_.options.start_time);
    return mission_.WorldFromCamera(mission_.agents[0], time_s);
  }

  // The images, and beside them a fix of the antenna every 0.1 s, between the images.
  void WriteSequence() {
    ASSERT_THAT(WriteEurocAgent(mission_, 0, folder_.path().string(), {}), IsOk());
    std::mt19937 random(5);
    std::normal_distribution<double> normal(0, kSigma_m);
    std::ofstream file(folder_ / name_ / "gnss.csv");
    file.precision(15);
    file << "#time_ns,latitude,longitude,height,sigma_horizontal,sigma_vertical\n";
    for (int frame = 0; frame + 1 < kFrames; frame += 2) {
      const int64_t time_ns = mission_.FrameTime(frame).count() + 20'000'000;
      Eigen::Vector3d position = TrueCamera(time_ns) * kAntenna_m;
      for (double& x : position) x += normal(random);
      const GeodeticPosition fix = LocalFrame(kHall).ToGeodetic(position);
      file << time_ns << "," << fix.latitude_deg << "," << fix.longitude_deg << "," << fix.height_m
           << "," << kSigma_m << "," << kSigma_m << "\n";
    }
  }

  void StartServer() {
    ServerOptions options;
    options.map_file = folder_ / "map";
    options.listen = "127.0.0.1:0";
    auto engine = MakeMapBuilderEngine(MapBuilderOptions());
    ASSERT_THAT(engine, IsOk());
    auto server = Server::Start(options, std::move(*engine));
    ASSERT_THAT(server, IsOk());
    server_ = std::move(*server);
    client_ = std::make_unique<MapClient>(server_->address());
  }

  void RunAgent() {
    ImageSourceOptions source_options;
    source_options.path = folder_ / name_;
    source_options.gnss_antenna_in_camera_m = {kAntenna_m.x(), kAntenna_m.y(), kAntenna_m.z()};
    auto source = OpenImageSource(source_options);
    ASSERT_THAT(source, IsOk());
    RunnerOptions options;
    options.agent = name_;
    options.server = server_->address();
    options.outbox = folder_ / "outbox";
    options.session = 1;
    options.progress = false;
    auto runner = AgentRunner::Create(options, AgentOptions(), UplinkOptions(), OutboxOptions(),
                                      std::move(*source));
    ASSERT_THAT(runner, IsOk());
    ASSERT_THAT((*runner)->Run(false), IsOk());
    EXPECT_EQ((*runner)->summary().pending_submaps, 0u);
  }

  std::vector<v1::TrajectorySegment> Keyframes() const {
    v1::GetTrajectoryRequest request;
    request.set_agent_id(name_);
    request.set_kind(v1::TRAJECTORY_KIND_KEYFRAMES);
    auto segments = client_->GetTrajectory(request);
    EXPECT_THAT(segments, IsOk());
    return segments.value_or(std::vector<v1::TrajectorySegment>());
  }

  v1::Georeference Georeference() const {
    const auto response = client_->GetGeoreference({});
    EXPECT_THAT(response, IsOk());
    EXPECT_EQ(response->components_size(), 1);
    return response->components_size() == 1 ? response->components(0) : v1::Georeference();
  }

  // Of the keyframes, in the hall's own frame.
  double Rms(const v1::SiteOrigin& origin) const {
    const LocalFrame hall(kHall);
    const LocalFrame site({origin.geodetic().latitude_deg(), origin.geodetic().longitude_deg(),
                           origin.geodetic().height_m()});
    double sum = 0;
    int count = 0;
    for (const v1::TrajectorySegment& segment : Keyframes()) {
      EXPECT_TRUE(segment.metric());
      for (int i = 0; i < segment.time_ns_size(); ++i, ++count) {
        const double* pose = segment.world_from_camera().data() + 7 * i;
        const Eigen::Vector3d in_hall =
            hall.FromGeodetic(site.ToGeodetic({pose[4], pose[5], pose[6]}));
        sum += (in_hall - TrueCamera(segment.time_ns(i)).translation).squaredNorm();
      }
    }
    return std::sqrt(sum / std::max(count, 1));
  }

  // Points ahead of three keyframes, in the pixels in which they and the next two see them.
  v1::AddControlPointsRequest MakeControlPoints() const {
    const CameraModel camera = *CameraModel::Create(mission_.options.camera);
    std::vector<int64_t> times;
    for (const v1::TrajectorySegment& segment : Keyframes()) {
      times.insert(times.end(), segment.time_ns().begin(), segment.time_ns().end());
    }
    v1::AddControlPointsRequest request;
    for (size_t i = 0; i + 3 < times.size(); i += times.size() / 4) {
      const Eigen::Vector3d in_hall = TrueCamera(times[i]) * Eigen::Vector3d(0.2, 0.1, 2.5);
      const GeodeticPosition position = LocalFrame(kHall).ToGeodetic(in_hall);
      v1::ControlPoint* point = request.add_points();
      point->set_id("P" + std::to_string(i));
      point->mutable_geodetic()->set_latitude_deg(position.latitude_deg);
      point->mutable_geodetic()->set_longitude_deg(position.longitude_deg);
      point->mutable_geodetic()->set_height_m(position.height_m);
      point->set_sigma_m(0.005);
      for (size_t k = i; k < i + 4; ++k) {
        const auto pixel = camera.Project(TrueCamera(times[k]).Inverse() * in_hall);
        if (!pixel || !camera.IsInImage(*pixel, 0)) continue;
        v1::ControlObservation* observation = point->add_observations();
        observation->set_agent_id(name_);
        observation->set_time_ns(times[k]);
        observation->set_u_px(pixel->x());
        observation->set_v_px(pixel->y());
      }
    }
    return request;
  }

  synthetic::Mission mission_;
  std::string name_;
  const TempDir folder_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<MapClient> client_;
};

TEST_F(GeoreferencedMissionTest, FixesAndControlPointsPutTheMapOnTheEarth) {
  WriteSequence();
  StartServer();
  RunAgent();
  ASSERT_THAT(client_->Settle(std::chrono::seconds(60)), IsOk());
  const v1::Georeference by_fixes = Georeference();
  ASSERT_TRUE(by_fixes.georeferenced()) << by_fixes.problem();
  EXPECT_GT(by_fixes.fix_count(), 40u);
  EXPECT_LT(by_fixes.rms_fix_horizontal_m(), 2 * kSigma_m);
  const double rms = Rms(by_fixes.origin());
  EXPECT_LT(rms, kSigma_m);

  ASSERT_THAT(client_->AddControlPoints(MakeControlPoints()), IsOk());
  ASSERT_THAT(client_->Settle(std::chrono::seconds(60)), IsOk());
  const v1::Georeference by_points = Georeference();
  ASSERT_TRUE(by_points.georeferenced()) << by_points.problem();
  EXPECT_GE(by_points.control_point_count(), 3u);
  EXPECT_LT(by_points.rms_control_horizontal_m(), 0.02);
  const double rms_with_points = Rms(by_points.origin());
  EXPECT_LT(rms_with_points, 0.02);
  RecordProperty("rms_by_fixes_mm", std::to_string(1e3 * rms));
  RecordProperty("rms_by_points_mm", std::to_string(1e3 * rms_with_points));

  // The points and the frame survive a restart.
  server_.reset();
  StartServer();
  ASSERT_THAT(client_->Settle(std::chrono::seconds(60)), IsOk());
  EXPECT_GE(Georeference().control_point_count(), 3u);
  EXPECT_LT(Rms(Georeference().origin()), 0.02);
}

}  // namespace
}  // namespace portolan
