#include "agent/imu/imu_motion_model.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>

#include "tests/agent/imu/imu_scene.h"
#include "tests/support/numeric_derivative.h"

namespace portolan {
namespace {

using MotionMatrix = MotionModel::MotionMatrix;

class ImuModel : public testing::Test {
 protected:
  ImuModel() : scene_(MakeImuScene({})), buffer_({}) { buffer_.Add(scene_.samples); }

  ImuMotionModel MakeModel(double time_s, const Rigid3& pose, const InertialState& state) const {
    ImuMotionModel model({}, scene_.calibration, scene_.imu_from_camera, &buffer_);
    model.Set(FromSeconds(time_s), pose, state);
    return model;
  }
  ImuMotionModel TrueModel(double time_s) const {
    return MakeModel(time_s, scene_.WorldFromImu(time_s), scene_.StateAt(time_s, {}));
  }

  const ImuScene scene_;
  ImuBuffer buffer_;
};

TEST_F(ImuModel, FollowsTheTruth) {
  ImuMotionModel model = TrueModel(1);
  MotionMatrix f, q;
  ASSERT_TRUE(model.Predict(FromSeconds(1.5), 1, &f, &q));
  const Rigid3 truth = scene_.WorldFromImu(1.5);
  EXPECT_LT((model.submap_from_body().translation - truth.translation).norm(), 0.005);
  EXPECT_LT(model.submap_from_body().rotation.angularDistance(truth.rotation), 0.002);
  EXPECT_LT((model.linear_velocity() - scene_.path.At(1.5).velocity_in_world).norm(), 0.01);
  EXPECT_TRUE(model.metric());
  EXPECT_LT((*model.gravity_in_submap() - Eigen::Vector3d(0, 0, -1)).norm(), 1e-12);
  EXPECT_FALSE(model.Predict(FromSeconds(1.5), 1, &f, &q));
}

TEST_F(ImuModel, TransitionIsTheDerivative) {
  const double from_s = 0.8125, to_s = 0.8625;  // between samples
  ImuMotionModel nominal = TrueModel(0.8);
  nominal.Set(FromSeconds(from_s), nominal.submap_from_body(), nominal.state());
  const Rigid3 pose = nominal.submap_from_body();
  const InertialState state = nominal.state();
  MotionMatrix f, q;
  ASSERT_TRUE(nominal.Predict(FromSeconds(to_s), 1, &f, &q));
  const Eigen::MatrixXd numeric =
      NumericJacobianAtZero(ImuMotionModel::kDim, [&](const Eigen::VectorXd& error) {
        ImuMotionModel model = MakeModel(from_s, pose, state);
        model.Correct(error);
        MotionMatrix unused_f, unused_q;
        model.Predict(FromSeconds(to_s), 1, &unused_f, &unused_q);
        return InertialError(model.submap_from_body(), model.state(), nominal.submap_from_body(),
                             nominal.state());
      });
  EXPECT_LT((numeric - f).cwiseAbs().maxCoeff(), 1e-7);
}

TEST_F(ImuModel, RebaseIsTheDerivative) {
  const ImuMotionModel nominal = TrueModel(1);
  ImuMotionModel rebased = nominal;
  MotionMatrix jacobian;
  rebased.Rebase(&jacobian);
  const Eigen::MatrixXd numeric =
      NumericJacobianAtZero(ImuMotionModel::kDim, [&](const Eigen::VectorXd& error) {
        ImuMotionModel model = nominal;
        MotionMatrix unused;
        model.Correct(error);
        model.Rebase(&unused);
        return InertialError(model.submap_from_body(), model.state(), rebased.submap_from_body(),
                             rebased.state());
      });
  EXPECT_LT((numeric - Eigen::MatrixXd(jacobian)).cwiseAbs().maxCoeff(), 1e-7);
  EXPECT_LT((rebased.submap_from_camera().translation).norm(), 1e-12);
}

// The spread of many noisy runs from the truth against Q: chi-square with 15 degrees of freedom
// (gravity has no noise).
TEST_F(ImuModel, NoiseIsThatOfTheSamples) {
  double sum = 0;
  constexpr int kRuns = 200;
  for (int run = 0; run < kRuns; ++run) {
    ImuSceneOptions options;
    options.duration_s = 1.2;
    options.seed = 100 + run;
    const ImuScene scene = MakeImuScene(options);
    ImuBuffer buffer({});
    buffer.Add(scene.samples);
    ImuModelOptions exact;
    exact.noise_factor = 1;
    ImuMotionModel model(exact, scene.calibration, scene.imu_from_camera, &buffer);
    model.Set(FromSeconds(0.4), scene.WorldFromImu(0.4), scene.StateAt(0.4, {}));
    MotionMatrix f, q;
    ASSERT_TRUE(model.Predict(FromSeconds(0.9), 1, &f, &q));
    const Eigen::VectorXd error = InertialError(model.submap_from_body(), model.state(),
                                                scene.WorldFromImu(0.9), scene.StateAt(0.9, {}))
                                      .head(15);
    sum += error.dot(Eigen::MatrixXd(q.topLeftCorner(15, 15)).ldlt().solve(error));
  }
  EXPECT_NEAR(sum / (15 * kRuns), 1, 0.15);
}

TEST_F(ImuModel, AGapIsBridgedAtConstantVelocityWithItsUncertainty) {
  std::vector<ImuSample> samples = scene_.samples;
  std::erase_if(samples, [](const ImuSample& sample) {
    return sample.time > FromSeconds(1.0) && sample.time < FromSeconds(1.4);
  });
  ImuBuffer buffer({});
  buffer.Add(samples);
  ImuMotionModel model({}, scene_.calibration, scene_.imu_from_camera, &buffer);
  model.Set(FromSeconds(1), scene_.WorldFromImu(1), scene_.StateAt(1, {}));
  MotionMatrix f, q;
  ASSERT_TRUE(model.Predict(FromSeconds(1.4), 1, &f, &q));
  EXPECT_NEAR(model.bridged_s(), 0.4, 1e-6);
  const Eigen::VectorXd error = InertialError(model.submap_from_body(), model.state(),
                                              scene_.WorldFromImu(1.4), scene_.StateAt(1.4, {}));
  for (int i = 0; i < 9; ++i) EXPECT_LT(std::abs(error[i]), 3 * std::sqrt(q(i, i))) << i;
  EXPECT_GT(std::sqrt(q(0, 0)), 0.1);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver{Eigen::MatrixXd(q)};
  EXPECT_GT(solver.eigenvalues().minCoeff(), -1e-12);
  EXPECT_TRUE(model.metric());
}

TEST_F(ImuModel, LongWithoutSamplesItIsNoLongerMetric) {
  const double end_s = ToSeconds(scene_.samples.back().time);
  ImuMotionModel model = TrueModel(7);
  MotionMatrix f, q;
  ASSERT_TRUE(model.Predict(FromSeconds(end_s + 2), 1, &f, &q));
  EXPECT_TRUE(model.metric());
  EXPECT_TRUE(model.gravity_in_submap());
  ASSERT_TRUE(model.Predict(FromSeconds(end_s + 4), 1, &f, &q));
  EXPECT_FALSE(model.metric());
  EXPECT_FALSE(model.gravity_in_submap());
}

TEST_F(ImuModel, StartTakesThePrior) {
  ImuMotionModel model({}, scene_.calibration, scene_.imu_from_camera, &buffer_);
  const InertialState prior = scene_.StateAt(1, scene_.WorldFromCamera(1));
  model.SetPrior(prior, 0.25 * Eigen::MatrixXd::Identity(11, 11));
  MotionMatrix covariance;
  model.Start(FromSeconds(1), 1, &covariance);
  EXPECT_EQ(covariance.topRows(6).cwiseAbs().maxCoeff(), 0);
  EXPECT_EQ(covariance(8, 8), 0.25);
  EXPECT_LT(model.submap_from_camera().translation.norm(), 1e-12);
  EXPECT_EQ(model.state().velocity, prior.velocity);
}

}  // namespace
}  // namespace portolan
