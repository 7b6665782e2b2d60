#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "agent/odometry/odometry_motion_model.h"
#include "tests/support/numeric_derivative.h"
#include "tests/synthetic/random.h"

namespace portolan {
namespace {

using MotionMatrix = MotionModel::MotionMatrix;

// Ahead at 2 m/s in a bend, every 20 ms.
Rigid3 TruePose(double time_s) {
  return Rigid3::Exp(time_s * (Vector6d() << 2, 0, 0, 0.02, 0, 0.4).finished());
}

std::vector<OdometrySample> SamplesUpTo(double end_s) {
  std::vector<OdometrySample> samples;
  for (int i = 0; 0.02 * i <= end_s + 1e-9; ++i) {
    samples.push_back({FromSeconds(0.02 * i), TruePose(0.02 * i)});
  }
  return samples;
}

Rigid3 BodyFromCamera() { return {RotationExp({-1.2, 1.2, -1.2}), {0.5, 0.1, 0.8}}; }

TEST(OdometryBuffer, IncrementsBetweenSamples) {
  OdometryBuffer buffer({});
  buffer.Add(SamplesUpTo(2));
  const auto step = buffer.Increment(FromSeconds(0.505), FromSeconds(0.732));
  ASSERT_TRUE(step);
  EXPECT_LT((TruePose(0.227).Inverse() * *step).Log().norm(), 1e-9);
  EXPECT_FALSE(buffer.Increment(FromSeconds(1.9), FromSeconds(2.5)));
  EXPECT_FALSE(buffer.Increment(FromSeconds(-1), FromSeconds(1)));
}

TEST(OdometryBuffer, DamagedSamplesAreLeftOut) {
  OdometryBuffer buffer({});
  std::vector<OdometrySample> samples = SamplesUpTo(2);
  samples[10].odometry_from_body.translation.x() = std::numeric_limits<double>::quiet_NaN();
  samples[12].odometry_from_body.rotation.coeffs().setZero();
  samples[20].time = samples[3].time;
  buffer.Add(samples);
  EXPECT_EQ(buffer.counts().not_finite, 2);
  EXPECT_EQ(buffer.counts().out_of_order, 1);
  const auto step = buffer.Increment(FromSeconds(0.1), FromSeconds(0.5));
  ASSERT_TRUE(step);
  EXPECT_LT((TruePose(0.4).Inverse() * *step).Log().norm(), 1e-9);
}

TEST(OdometryBuffer, AJumpOfTheCounterIsNoMotion) {
  OdometryBuffer buffer({});
  std::vector<OdometrySample> samples = SamplesUpTo(2);
  for (size_t i = 50; i < samples.size(); ++i) {
    samples[i].odometry_from_body.translation.x() += 100;
  }
  buffer.Add(samples);
  EXPECT_EQ(buffer.counts().jumps, 1);
  EXPECT_FALSE(buffer.Increment(FromSeconds(0.9), FromSeconds(1.1)));
  EXPECT_TRUE(buffer.Increment(FromSeconds(1.1), FromSeconds(1.3)));
}

class OdometryModel : public testing::Test {
 protected:
  OdometryModel() : buffer_({}) { buffer_.Add(SamplesUpTo(3)); }

  OdometryMotionModel Started(double time_s) const {
    OdometryMotionModel model({}, BodyFromCamera(), &buffer_);
    MotionMatrix covariance;
    model.Start(FromSeconds(time_s), 1, &covariance);
    return model;
  }
  static Eigen::VectorXd Error(const OdometryMotionModel& a, const OdometryMotionModel& b) {
    Eigen::VectorXd error(7);
    error << a.submap_from_body().translation - b.submap_from_body().translation,
        RotationLog(b.submap_from_body().rotation.conjugate() * a.submap_from_body().rotation),
        std::log(a.scale() / b.scale());
    return error;
  }

  OdometryBuffer buffer_;
};

TEST_F(OdometryModel, FollowsTheIncrements) {
  OdometryMotionModel model = Started(0.5);
  MotionMatrix f, q;
  for (int i = 1; i <= 20; ++i) ASSERT_TRUE(model.Predict(FromSeconds(0.5 + 0.05 * i), 1, &f, &q));
  const Rigid3 truth = BodyFromCamera().Inverse() * TruePose(1.0) * BodyFromCamera();
  EXPECT_LT((truth.Inverse() * model.submap_from_camera()).Log().norm(), 1e-9);
  EXPECT_TRUE(model.metric());
  EXPECT_NEAR(model.linear_velocity().norm(), 2, 1e-6);
  EXPECT_FALSE(model.Predict(FromSeconds(1.5), 1, &f, &q));
}

TEST_F(OdometryModel, TransitionAndRebaseAreDerivatives) {
  OdometryMotionModel before = Started(0.5);
  MotionMatrix f, q, j;
  before.Predict(FromSeconds(0.9), 1, &f, &q);
  OdometryMotionModel after = before;
  after.Predict(FromSeconds(1.1), 1, &f, &q);
  const Eigen::MatrixXd numeric = NumericJacobianAtZero(7, [&](const Eigen::VectorXd& error) {
    OdometryMotionModel model = before;
    MotionMatrix unused_f, unused_q;
    model.Correct(error);
    model.Predict(FromSeconds(1.1), 1, &unused_f, &unused_q);
    return Error(model, after);
  });
  EXPECT_LT((numeric - Eigen::MatrixXd(f)).cwiseAbs().maxCoeff(), 1e-8);
  OdometryMotionModel rebased = after;
  rebased.Rebase(&j);
  const Eigen::MatrixXd numeric_rebase =
      NumericJacobianAtZero(7, [&](const Eigen::VectorXd& error) {
        OdometryMotionModel model = after;
        MotionMatrix unused;
        model.Correct(error);
        model.Rebase(&unused);
        return Error(model, rebased);
      });
  EXPECT_LT((numeric_rebase - Eigen::MatrixXd(j)).cwiseAbs().maxCoeff(), 1e-8);
}

TEST_F(OdometryModel, AGapIsBridgedAtConstantVelocityWithItsUncertainty) {
  OdometryMotionModel model = Started(2.5);
  MotionMatrix f, q, q_gap;
  model.Predict(FromSeconds(3.0), 1, &f, &q);
  ASSERT_TRUE(model.Predict(FromSeconds(3.5), 1, &f, &q_gap));
  EXPECT_NEAR(model.bridged_s(), 0.5, 1e-9);
  const Rigid3 truth = BodyFromCamera().Inverse() * TruePose(1.0);
  EXPECT_LT((truth.Inverse() * model.submap_from_body()).Log().norm(), 1e-6);
  EXPECT_GT(q_gap(0, 0), 10 * q(0, 0));
}

}  // namespace
}  // namespace portolan
