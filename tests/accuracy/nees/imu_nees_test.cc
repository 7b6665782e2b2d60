// Consistency of the local filter with an IMU: normalised estimation error squared (Bar-Shalom, Li,
// Kirubarajan 2001, Sec. 5.4) over Monte Carlo runs. The scale is known here, so nothing is left
// free.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "agent/filter/local_filter.h"
#include "tests/agent/filter/point_world.h"
#include "tests/agent/imu/imu_scene.h"
#include "tests/synthetic/random.h"

namespace portolan {
namespace {

constexpr int kRuns = 50;
constexpr int kRateHz = 20;

struct ImuCase {
  const char* name;
  int frames = 60;
  int submap_frames = 1000;
  double outlier_share = 0;
};

struct Ratios {
  std::vector<double> values;
  double dof = 0;  // of all

  void Add(const Eigen::VectorXd& error, const Eigen::MatrixXd& covariance) {
    values.push_back(error.dot(covariance.ldlt().solve(error)) / error.size());
    dof += static_cast<double>(error.size());
  }
  double mean() const {
    double sum = 0;
    for (const double value : values) sum += value / static_cast<double>(values.size());
    return sum;
  }
  double band() const { return 1.96 * std::sqrt(2.0 / dof); }
};

struct ImuResult {
  Ratios pose, motion;
};

Eigen::VectorXd DrawnFrom(const Eigen::MatrixXd& covariance, synthetic::Random* random) {
  Eigen::VectorXd noise(covariance.rows());
  for (int i = 0; i < noise.size(); ++i) noise[i] = random->Normal3().x();
  return covariance.llt().matrixL() * noise;
}

// A prior such as an alignment gives, wrong by what it says.
void SetDrawnPrior(const ImuScene& scene, double time_s, uint64_t seed, ImuMotionModel* model) {
  Eigen::VectorXd sigma(11);
  sigma << 0.05, 0.05, 0.05, 0.002, 0.002, 0.002, 0.05, 0.05, 0.05, 0.01, 0.01;
  const Eigen::MatrixXd covariance = sigma.cwiseAbs2().asDiagonal();
  synthetic::Random random(77 + seed);
  ImuMotionModel drawn = *model;
  drawn.Set(FromSeconds(time_s), {}, scene.StateAt(time_s, scene.WorldFromCamera(time_s)));
  Eigen::VectorXd error = Eigen::VectorXd::Zero(ImuMotionModel::kDim);
  error.tail(11) = DrawnFrom(covariance, &random);
  drawn.Correct(error);
  model->SetPrior(drawn.state(), covariance);
}

void AddErrors(const LocalFilter& filter, const ImuScene& scene, const PointWorld& world,
               double time_s, ImuResult* result) {
  const auto& model = static_cast<const ImuMotionModel&>(filter.motion());
  const Rigid3 submap_from_camera = world.true_submap_from_camera();
  const Rigid3 world_from_submap = scene.WorldFromCamera(time_s) * submap_from_camera.Inverse();
  const Eigen::VectorXd error = InertialError(submap_from_camera * scene.imu_from_camera.Inverse(),
                                              scene.StateAt(time_s, world_from_submap),
                                              model.submap_from_body(), model.state());
  const Eigen::MatrixXd p = filter.state().covariance().topLeftCorner(17, 17);
  result->motion.Add(error, p);
  result->pose.Add(error.head<6>(), p.topLeftCorner<6, 6>());
}

ImuResult MonteCarlo(const ImuCase& c) {
  ImuResult result;
  for (uint64_t seed = 1; seed <= kRuns; ++seed) {
    ImuSceneOptions scene_options;
    scene_options.seed = seed;
    scene_options.duration_s = 2.0 + static_cast<double>(c.frames) / kRateHz;
    const ImuScene scene = MakeImuScene(scene_options);
    const double start_s = 1.0;
    // The point world counts from zero, the samples likewise.
    ImuBuffer buffer({});
    std::vector<ImuSample> samples = scene.samples;
    for (ImuSample& sample : samples) sample.time -= FromSeconds(start_s);
    buffer.Add(samples);
    ImuModelOptions exact;
    exact.noise_factor = 1;
    auto model =
        std::make_unique<ImuMotionModel>(exact, scene.calibration, scene.imu_from_camera, &buffer);
    SetDrawnPrior(scene, start_s, seed, model.get());
    FilterOptions options;
    options.model_sigma_px = 0;
    auto filter = LocalFilter::Create(options, MakeTestCamera(), std::move(model)).value();
    PointWorldOptions world_options;
    world_options.seed = seed;
    world_options.rate_hz = kRateHz;
    world_options.outlier_share = c.outlier_share;
    PointWorld world(world_options, MakeTestCamera(),
                     [&scene, start_s](double t) { return scene.WorldFromCamera(start_s + t); });
    world.Start(filter.get());
    for (int frame = 1; frame <= c.frames; ++frame) {
      world.Step(filter.get());
      if (frame % c.submap_frames == 0) world.BeginSubmap(filter.get());
    }
    AddErrors(*filter, scene, world, start_s + world.time_s(), &result);
  }
  std::printf("%-36s pose mean %.2f (95 %% band 1 +- %.2f), motion mean %.2f (1 +- %.2f)\n", c.name,
              result.pose.mean(), result.pose.band(), result.motion.mean(), result.motion.band());
  return result;
}

TEST(ImuNees, OneSubmapIsConsistent) {
  const ImuResult result = MonteCarlo({"IMU, 3 s in one submap", 60, 1000, 0});
  EXPECT_LT(result.pose.mean(), 1.5);
  EXPECT_LT(result.motion.mean(), 1.4);
  EXPECT_GT(result.motion.mean(), 0.7);
}

TEST(ImuNees, SubmapsKeepConsistency) {
  const ImuResult result = MonteCarlo({"IMU, 5 s, submap every 27 frames", 100, 27, 0});
  EXPECT_LT(result.pose.mean(), 1.5);
  EXPECT_LT(result.motion.mean(), 1.4);
  EXPECT_GT(result.motion.mean(), 0.7);
}

TEST(ImuNees, WithOutliers) {
  const ImuResult result = MonteCarlo({"IMU, 3 s, 20 % outliers", 60, 1000, 0.2});
  EXPECT_LT(result.pose.mean(), 1.8);
  EXPECT_LT(result.motion.mean(), 1.6);
}

}  // namespace
}  // namespace portolan
