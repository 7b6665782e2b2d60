#include "agent/imu/inertial_alignment.h"

#include <gtest/gtest.h>

#include <cmath>

#include "agent/imu/inertial_initializer.h"
#include "tests/agent/filter/point_world.h"
#include "tests/agent/imu/imu_scene.h"
#include "tests/support/numeric_derivative.h"
#include "tests/synthetic/random.h"

namespace portolan {
namespace {

constexpr double kUnit_m = 0.6;  // a submap unit

// Camera poses in the frame of the first, in units, with noise.
std::vector<ScaleFreePose> PosesOf(const ImuScene& scene, double from_s, double to_s,
                                   double position_sigma, double rotation_sigma) {
  synthetic::Random random(5);
  const Rigid3 first_from_world = scene.WorldFromCamera(from_s).Inverse();
  std::vector<ScaleFreePose> poses;
  for (double t = from_s; t < to_s + 1e-9; t += 0.05) {
    ScaleFreePose pose{FromSeconds(t), first_from_world * scene.WorldFromCamera(t)};
    pose.submap_from_camera.translation /= kUnit_m;
    pose.submap_from_camera.translation += position_sigma * random.Normal3();
    pose.submap_from_camera.rotation =
        pose.submap_from_camera.rotation * RotationExp(rotation_sigma * random.Normal3());
    poses.push_back(pose);
  }
  return poses;
}

std::optional<InertialAlignment> Align(const ImuScene& scene,
                                       const std::vector<ScaleFreePose>& poses,
                                       std::string* reason) {
  ImuBuffer buffer({});
  buffer.Add(scene.samples);
  return AlignInertially({}, {}, scene.calibration, scene.imu_from_camera, buffer, poses, 3.0,
                         reason);
}

TEST(InertialAlignment, FindsScaleGravityVelocityAndGyroBiasInMotion) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    ImuSceneOptions options;
    options.seed = seed;
    const ImuScene scene = MakeImuScene(options);
    std::string reason;
    const auto found = Align(scene, PosesOf(scene, 1, 3.5, 0.004, 0.001), &reason);
    ASSERT_TRUE(found) << seed << ": " << reason;
    EXPECT_NEAR(found->scale, kUnit_m, 0.05 * kUnit_m) << seed;
    const InertialState truth = scene.StateAt(3.5, scene.WorldFromCamera(1));
    EXPECT_LT((found->state.velocity - truth.velocity).norm(), 0.05) << seed;
    EXPECT_LT((found->state.gyro_bias - truth.gyro_bias).norm(), 0.004) << seed;
    EXPECT_GT(found->state.gravity_direction().dot(truth.gravity_direction()), std::cos(0.05));
  }
}

// Error of the result against its covariance: 12 degrees of freedom.
TEST(InertialAlignment, CovarianceCoversTheError) {
  double sum = 0;
  int count = 0;
  for (uint64_t seed = 1; seed <= 50; ++seed) {
    ImuSceneOptions options;
    options.seed = seed;
    const ImuScene scene = MakeImuScene(options);
    std::string reason;
    const auto found = Align(scene, PosesOf(scene, 1, 3.5, 0.009, 0.003), &reason);
    if (!found) continue;
    const InertialState truth = scene.StateAt(3.5, scene.WorldFromCamera(1));
    Eigen::VectorXd error(InertialAlignment::kDim);
    error << std::log(found->scale / kUnit_m),
        -InertialError({}, truth, {}, found->state).tail<11>();
    sum += error.dot(found->covariance.ldlt().solve(error));
    ++count;
  }
  EXPECT_GT(count, 25);
  EXPECT_LT(sum / (12 * count), 1.3);
  EXPECT_GT(sum / (12 * count), 0.2);
}

TEST(InertialAlignment, RefusesMotionThatDoesNotTellTheScale) {
  for (const double speed : {0.0, 0.5}) {
    ImuSceneOptions options;
    options.sway_m = 0;
    options.turn_rad = 0;
    options.speed_m_s = speed;
    const ImuScene scene = MakeImuScene(options);
    std::string reason;
    EXPECT_FALSE(Align(scene, PosesOf(scene, 1, 3.5, 0.002, 0.001), &reason)) << speed;
    EXPECT_FALSE(reason.empty());
  }
}

TEST(InertialAlignment, RefusesMissingSamples) {
  ImuScene scene = MakeImuScene({});
  std::erase_if(scene.samples, [](const ImuSample& sample) {
    return sample.time > FromSeconds(2) && sample.time < FromSeconds(2.2);
  });
  std::string reason;
  EXPECT_FALSE(Align(scene, PosesOf(scene, 1, 3.5, 0.002, 0.001), &reason));
  EXPECT_EQ(reason, "samples are missing");
  EXPECT_FALSE(Align(scene, {}, &reason));
}

TEST(ImuIncrement, BiasDerivatives) {
  const ImuScene scene = MakeImuScene({});
  ImuBuffer buffer({});
  buffer.Add(scene.samples);
  const auto steps = buffer.Steps(FromSeconds(0.5), FromSeconds(1.0));
  const auto integrate = [&](const Eigen::VectorXd& bias) {
    ImuIncrement increment;
    for (const ImuStep& step : steps) increment.Add(step, bias.head<3>(), bias.tail<3>());
    return increment;
  };
  const ImuIncrement nominal = integrate(Eigen::VectorXd::Zero(6));
  const Eigen::MatrixXd numeric = NumericJacobianAtZero(6, [&](const Eigen::VectorXd& bias) {
    const ImuIncrement increment = integrate(bias);
    Eigen::VectorXd value(9);
    value << increment.position, increment.velocity,
        RotationLog(nominal.rotation.conjugate() * increment.rotation);
    return value;
  });
  Eigen::MatrixXd analytic = Eigen::MatrixXd::Zero(9, 6);
  analytic << nominal.d_position_d_gyro, nominal.d_position_d_accel, nominal.d_velocity_d_gyro,
      nominal.d_velocity_d_accel, nominal.d_rotation_d_gyro, Eigen::Matrix3d::Zero();
  EXPECT_LT((numeric - analytic).cwiseAbs().maxCoeff(), 1e-7);
  EXPECT_NEAR(nominal.time_s, 0.5, 1e-9);
}

TEST(RefineCameraPose, FindsThePoseInSpiteOfAWrongMatch) {
  const CameraModel camera = MakeTestCamera();
  const Rigid3 truth = {RotationExp({0.1, -0.05, 0.2}), {0.3, 0.1, -0.2}};
  synthetic::Random random(3);
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
  for (int i = 0; i < 30; ++i) {
    const Eigen::Vector3d in_camera(0.8 * random.Normal3().x(), 0.6 * random.Normal3().y(), 4);
    const auto pixel = camera.Project(in_camera);
    if (!pixel) continue;
    points.push_back(truth * in_camera);
    pixels.push_back(*pixel);
  }
  pixels[4] += Eigen::Vector2d(60, -40);
  const Rigid3 start = {truth.rotation * RotationExp({0.02, 0.02, -0.02}),
                        truth.translation + Eigen::Vector3d(0.05, -0.05, 0.05)};
  const auto found = RefineCameraPose(camera, start, points, pixels, 8);
  ASSERT_TRUE(found);
  EXPECT_LT((found->translation - truth.translation).norm(), 0.01);
  EXPECT_LT(found->rotation.angularDistance(truth.rotation), 0.003);
  EXPECT_FALSE(RefineCameraPose(camera, start, {}, {}, 8));
}

// The change of the motion model is the derivative of what it does to the state.
TEST(ChangeToInertial, Derivatives) {
  const ImuScene scene = MakeImuScene({});
  const ImuBuffer buffer({});
  const Rigid3 camera = {RotationExp({0.3, -0.2, 0.1}), {0.4, -0.3, 0.2}};
  InertialAlignment alignment;
  alignment.scale = 0.7;
  alignment.covariance.setIdentity();
  const MotionChange change = ChangeToInertial(alignment, camera, scene.imu_from_camera, 12);
  const auto pose_of = [&](const Eigen::VectorXd& e) {
    const Rigid3 moved = {camera.rotation * RotationExp(e.segment<3>(3)),
                          std::exp(e[6]) * 0.7 * (camera.translation + e.head<3>())};
    return moved * scene.imu_from_camera.Inverse();
  };
  const Rigid3 nominal = pose_of(Eigen::VectorXd::Zero(7));
  const Eigen::MatrixXd numeric = NumericJacobianAtZero(7, [&](const Eigen::VectorXd& e) {
    return InertialError(pose_of(e), {}, nominal, {}).head<6>().eval();
  });
  EXPECT_LT((numeric.leftCols<6>() - change.d_new_d_old.topLeftCorner<6, 6>()).norm(), 1e-8);
  EXPECT_LT((numeric.col(6) - change.d_new_d_added.col(0).head<6>()).norm(), 1e-8);
}

}  // namespace
}  // namespace portolan
