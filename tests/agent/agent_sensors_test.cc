// The agent with an IMU or wheel odometry, on rendered images: metric submaps, and what becomes of
// damaged samples.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "agent/agent.h"
#include "common/wire/submap_wire.h"
#include "tests/agent/rendered_sequence.h"
#include "tests/support/matchers.h"
#include "tests/synthetic/imu.h"
#include "tests/synthetic/random.h"

namespace portolan {
namespace {

constexpr int kFrames = 100;

// The camera is waved about a place of the mission's path, as by hand: that tells the scale.
synthetic::Mission WavedMission() {
  synthetic::Mission mission = RenderedMission(kFrames);
  synthetic::Random random(11);
  const Rigid3 place = mission.agents[0].path.At(2).world_from_body;
  const Eigen::Matrix3d axes = place.rotation.toRotationMatrix();
  const double yaw = std::atan2(axes(1, 0), axes(0, 0));
  std::vector<synthetic::PathKnot> knots;
  for (int i = 0; i < 18; ++i) {
    synthetic::PathKnot knot;
    knot.position_m = place.translation + 0.3 * random.Normal3();
    knot.yaw_pitch_roll_rad = Eigen::Vector3d(yaw, 0, 0) + 0.12 * random.Normal3();
    knots.push_back(knot);
  }
  mission.agents[0].path = synthetic::BodyPath(knots, 0.4);
  return mission;
}

const std::vector<TimedImage>& WavedImages() {
  static const auto* const images =
      new std::vector<TimedImage>(RenderImages(WavedMission(), kFrames));
  return *images;
}

class AgentWithSensors : public testing::Test {
 protected:
  AgentWithSensors()
      : images_(WavedImages()), mission_(WavedMission()), path_(mission_.agents[0].path) {
    const synthetic::ImuOptions& imu = mission_.options.imu;
    for (const auto& sample : synthetic::SimulateImu(path_, imu)) {
      imu_.push_back({mission_.FrameTime(0) + sample.time_since_start,
                      sample.angular_velocity_rad_s, sample.specific_force_m_s2});
    }
    mount_.calibration = {imu.rate_hz,
                          imu.gyroscope_noise_density,
                          imu.gyroscope_random_walk,
                          imu.accelerometer_noise_density,
                          imu.accelerometer_random_walk,
                          {}};
    mount_.imu_from_camera = mission_.body_from_camera;
  }

  Rigid3 TrueCamera(size_t frame) const {
    return mission_.WorldFromCamera(mission_.agents[0],
                                    mission_.FrameTimeSinceStart_s(static_cast<int>(frame)));
  }

  // Runs all images; poses of the connected chain that the last frame belongs to.
  void Run(const VehicleSensors& sensors) {
    auto created = Agent::Create({}, RenderedCamera(), AgentId("tester"), SessionId(7), sensors);
    ASSERT_THAT(created, IsOk());
    agent_ = std::move(*created);
    size_t imu = 0, odometry = 0, fix = 0;
    for (size_t i = 0; i < images_.size(); ++i) {
      const Timestamp until = images_[i].time + std::chrono::milliseconds(6);
      for (; imu < imu_.size() && imu_[imu].time <= until; ++imu) agent_->AddImu({{imu_[imu]}});
      for (; odometry < odometry_.size() && odometry_[odometry].time <= until; ++odometry) {
        agent_->AddOdometry({{odometry_[odometry]}});
      }
      for (; fix < fixes_.size() && fixes_[fix].time <= images_[i].time; ++fix) {
        agent_->AddGnss({{fixes_[fix]}});
      }
      auto result = agent_->ProcessImage(images_[i].time, images_[i].gray);
      ASSERT_THAT(result, IsOk());
      if (result->closed_submap) submaps_.push_back(*std::move(result->closed_submap));
      Record(i, *result);
    }
    if (auto last = agent_->Finish()) submaps_.push_back(*std::move(last));
    for (const Submap& submap : submaps_) EXPECT_THAT(EncodeSubmap(submap), IsOk());
  }

  // Error of the last position relative to the chain's first camera, over the path between.
  double RelativeError() const {
    const Rigid3 truth =
        TrueCamera(chain_.front().first).Inverse() * TrueCamera(chain_.back().first);
    const Rigid3 estimate = chain_.front().second.Inverse() * chain_.back().second;
    double path = 0;
    for (size_t i = chain_.front().first; i < chain_.back().first; ++i) {
      path += (TrueCamera(i + 1).translation - TrueCamera(i).translation).norm();
    }
    return (truth.translation - estimate.translation).norm() / path;
  }

  double GravityError_rad(const Submap& submap) const {
    size_t frame = 0;
    while (images_[frame].time < submap.keyframes[0].time) ++frame;
    const Eigen::Vector3d truth =
        TrueCamera(frame).rotation.conjugate() * Eigen::Vector3d(0, 0, -1);
    return std::acos(std::min(1.0, truth.dot(*submap.gravity_in_submap)));
  }

  const std::vector<TimedImage>& images_;
  const synthetic::Mission mission_;
  const synthetic::BodyPath path_;
  std::vector<ImuSample> imu_;
  std::vector<OdometrySample> odometry_;
  std::vector<GnssFix> fixes_;
  ImuMount mount_;
  std::unique_ptr<Agent> agent_;
  std::vector<FrameResult> results_;
  std::vector<Submap> submaps_;
  std::vector<std::pair<size_t, Rigid3>> chain_;  // frame, pose in the chain's frame

 private:
  void Record(size_t frame, const FrameResult& result) {
    if (result.begins_submap) {
      if (result.link == LinkType::kConnected) {
        chain_from_submap_ = chain_from_submap_ * result.predecessor_from_submap;
      } else {
        chain_.clear();
        chain_from_submap_ = {};
      }
    }
    chain_.emplace_back(frame, chain_from_submap_ * result.submap_from_camera);
    results_.push_back(result);
    results_.back().closed_submap.reset();
  }

  Rigid3 chain_from_submap_;
};

TEST_F(AgentWithSensors, FixesTravelWithTheirSubmapAndChangeNothingElse) {
  Run({});
  const std::vector<Submap> without = std::move(submaps_);
  submaps_.clear();
  for (Timestamp time = images_.front().time - std::chrono::milliseconds(500);
       time < images_.back().time; time += std::chrono::milliseconds(70)) {
    fixes_.push_back({time, {47, 8 + 1e-6 * static_cast<double>(fixes_.size()), 400}, 1, 2});
  }
  VehicleSensors sensors;
  sensors.antenna_in_camera_m = {0.5, 0, -1};
  Run(sensors);
  ASSERT_EQ(submaps_.size(), without.size());
  std::vector<Timestamp> expected, taken;
  for (const GnssFix& fix : fixes_) {
    if (fix.time >= submaps_.front().keyframes.front().time &&
        fix.time < submaps_.back().keyframes.back().time) {
      expected.push_back(fix.time);
    }
  }
  for (size_t i = 0; i < submaps_.size(); ++i) {
    Submap& submap = submaps_[i];
    EXPECT_EQ(submap.antenna_in_camera_m, sensors.antenna_in_camera_m);
    for (const GnssFix& fix : submap.gnss) taken.push_back(fix.time);
    submap.gnss.clear();
    EXPECT_EQ(*EncodeSubmap(submap), *EncodeSubmap(without[i]));
  }
  EXPECT_GT(taken.size(), 50u);
  EXPECT_EQ(taken, expected);
}

TEST_F(AgentWithSensors, ImuMakesTheSubmapsMetricAndUpright) {
  Run({mount_, std::nullopt, std::nullopt});
  ASSERT_FALSE(submaps_.empty());
  EXPECT_TRUE(results_.back().metric);
  EXPECT_GT(chain_.size(), images_.size() / 3);
  EXPECT_LT(RelativeError(), 0.02);
  int metric = 0;
  for (const Submap& submap : submaps_) {
    if (!submap.metric) continue;
    ++metric;
    ASSERT_TRUE(submap.gravity_in_submap);
    EXPECT_LT(GravityError_rad(submap), 0.03);
  }
  EXPECT_GE(metric, 1);
}

TEST_F(AgentWithSensors, DamagedImuSamplesAreLeftOut) {
  for (size_t i = 10; i < imu_.size(); i += 50) {
    imu_[i].gyro_rad_s.x() = std::numeric_limits<double>::quiet_NaN();
    imu_[i + 20].time = imu_[i].time;
  }
  Run({mount_, std::nullopt, std::nullopt});
  EXPECT_GT(agent_->imu_counts().not_finite, 5);
  EXPECT_GT(agent_->imu_counts().out_of_order, 5);
  EXPECT_TRUE(results_.back().metric);
  EXPECT_LT(RelativeError(), 0.02);
}

TEST_F(AgentWithSensors, AnImuThatStopsLeavesTheCameraInCharge) {
  imu_.resize(imu_.size() * 7 / 10);
  Run({mount_, std::nullopt, std::nullopt});
  EXPECT_TRUE(results_.back().tracked);
  for (const FrameResult& result : results_) EXPECT_FALSE(result.tracking_failed);
  EXPECT_LT(RelativeError(), 0.05);
}

TEST_F(AgentWithSensors, WithoutSamplesTheScaleStaysUnknown) {
  imu_.clear();
  Run({mount_, std::nullopt, std::nullopt});
  EXPECT_TRUE(results_.back().tracked);
  for (const Submap& submap : submaps_) {
    EXPECT_FALSE(submap.metric);
    EXPECT_FALSE(submap.gravity_in_submap);
  }
}

TEST_F(AgentWithSensors, SamplesOfAnotherClockAreNotUsed) {
  for (ImuSample& sample : imu_) sample.time -= std::chrono::hours(1000);
  Run({mount_, std::nullopt, std::nullopt});
  EXPECT_TRUE(results_.back().tracked);
  for (const Submap& submap : submaps_) EXPECT_FALSE(submap.metric);
}

TEST_F(AgentWithSensors, WheelOdometryMakesTheSubmapsMetric) {
  synthetic::Random random(4);
  Rigid3 odometry = {RotationExp({0.1, 0.2, 0.3}), {5, -3, 1}};
  Rigid3 before = path_.At(0).world_from_body;
  for (int i = 0; i * 0.02 <= path_.duration_s(); ++i) {
    const Rigid3 now = path_.At(0.02 * i).world_from_body;
    Rigid3 step = before.Inverse() * now;
    // Wheels 1 % too large, and noise.
    step.translation *= 1.01;
    step.translation += 0.01 * std::sqrt(step.translation.norm()) * random.Normal3();
    odometry = odometry * step;
    before = now;
    odometry_.push_back({mission_.FrameTime(0) + FromSeconds(0.02 * i), odometry});
  }
  Run({std::nullopt, mission_.body_from_camera, std::nullopt});
  ASSERT_FALSE(submaps_.empty());
  for (const Submap& submap : submaps_) EXPECT_TRUE(submap.metric);
  EXPECT_EQ(chain_.front().first, 0u);
  EXPECT_LT(RelativeError(), 0.03);
}

TEST_F(AgentWithSensors, OneSensorAtATime) {
  EXPECT_FALSE(Agent::Create({}, RenderedCamera(), AgentId("tester"), SessionId(7),
                             {mount_, Rigid3(), std::nullopt})
                   .ok());
}

}  // namespace
}  // namespace portolan
