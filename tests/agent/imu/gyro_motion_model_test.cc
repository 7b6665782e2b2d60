#include "agent/imu/gyro_motion_model.h"

#include <gtest/gtest.h>

#include "tests/agent/imu/imu_scene.h"
#include "tests/support/numeric_derivative.h"

namespace portolan {
namespace {

using MotionMatrix = MotionModel::MotionMatrix;

class GyroModel : public testing::Test {
 protected:
  GyroModel() : scene_(MakeImuScene({})), buffer_({}) { buffer_.Add(scene_.samples); }

  GyroMotionModel Started(double time_s) const {
    GyroMotionModel model({}, {}, 0.1, scene_.calibration,
                          scene_.imu_from_camera.rotation.conjugate(), &buffer_);
    MotionMatrix covariance;
    model.Start(FromSeconds(time_s), 1, &covariance);
    Eigen::VectorXd motion = Eigen::VectorXd::Zero(GyroMotionModel::kDim);
    motion.segment<3>(GyroMotionModel::kVelocity) << 0.3, -0.2, 0.5;
    motion.segment<3>(GyroMotionModel::kBias) =
        scene_.imu_from_camera.rotation.conjugate() * scene_.truth[0].gyroscope_bias;
    model.Correct(motion);
    return model;
  }
  static Eigen::VectorXd Error(const GyroMotionModel& a, const GyroMotionModel& b) {
    Eigen::VectorXd error(GyroMotionModel::kDim);
    error << a.submap_from_body().translation - b.submap_from_body().translation,
        RotationLog(b.submap_from_body().rotation.conjugate() * a.submap_from_body().rotation),
        a.linear_velocity() - b.linear_velocity(), a.gyro_bias() - b.gyro_bias();
    return error;
  }

  const ImuScene scene_;
  ImuBuffer buffer_;
};

TEST_F(GyroModel, TurnsAsTheCameraDoes) {
  GyroMotionModel model = Started(1);
  MotionMatrix f, q;
  for (int i = 1; i <= 10; ++i) ASSERT_TRUE(model.Predict(FromSeconds(1 + 0.05 * i), 1, &f, &q));
  const Rigid3 truth = scene_.WorldFromCamera(1).Inverse() * scene_.WorldFromCamera(1.5);
  EXPECT_LT(model.submap_from_camera().rotation.angularDistance(truth.rotation), 0.002);
  EXPECT_FALSE(model.metric());
  EXPECT_FALSE(model.Predict(FromSeconds(1.5), 1, &f, &q));
}

TEST_F(GyroModel, TransitionAndRebaseAreDerivatives) {
  GyroMotionModel before = Started(1);
  MotionMatrix f, q, j;
  before.Predict(FromSeconds(1.2), 1, &f, &q);
  GyroMotionModel after = before;
  after.Predict(FromSeconds(1.25), 1, &f, &q);
  GyroMotionModel rebased = after;
  rebased.Rebase(&j);
  const Eigen::MatrixXd numeric =
      NumericJacobianAtZero(GyroMotionModel::kDim, [&](const Eigen::VectorXd& error) {
        GyroMotionModel model = before;
        MotionMatrix unused_f, unused_q;
        model.Correct(error);
        model.Predict(FromSeconds(1.25), 1, &unused_f, &unused_q);
        return Error(model, after);
      });
  EXPECT_LT((numeric - Eigen::MatrixXd(f)).cwiseAbs().maxCoeff(), 1e-7);
  const Eigen::MatrixXd numeric_rebase =
      NumericJacobianAtZero(GyroMotionModel::kDim, [&](const Eigen::VectorXd& error) {
        GyroMotionModel model = after;
        MotionMatrix unused;
        model.Correct(error);
        model.Rebase(&unused);
        return Error(model, rebased);
      });
  EXPECT_LT((numeric_rebase - Eigen::MatrixXd(j)).cwiseAbs().maxCoeff(), 1e-7);
}

}  // namespace
}  // namespace portolan
