// Every analytic Jacobian of the filter against central differences.
#include <gtest/gtest.h>

#include <random>

#include "agent/filter/constant_velocity_model.h"
#include "agent/filter/landmark.h"
#include "tests/agent/filter/point_world.h"
#include "tests/support/matchers.h"
#include "tests/support/numeric_derivative.h"

namespace portolan {
namespace {

Eigen::Vector3d Random3(std::mt19937_64* random, double range) {
  std::uniform_real_distribution<double> uniform(-range, range);
  const double x = uniform(*random), y = uniform(*random);
  return {x, y, uniform(*random)};
}

Rigid3 Perturbed(const Rigid3& pose, const Eigen::VectorXd& e) {
  return {pose.rotation * RotationExp(e.tail<3>()), pose.translation + e.head<3>()};
}

// A landmark seen by the camera at `pose` at a random pixel, close to the border every other time.
struct Scene {
  Landmark landmark;
  Eigen::Vector3d anchor;
  Rigid3 pose;
};

Scene RandomScene(const CameraModel& camera, bool euclidean, std::mt19937_64* random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  while (true) {
    Scene scene;
    scene.pose = {RotationExp(Random3(random, 1)), Random3(random, 2)};
    scene.anchor = scene.pose.translation + Random3(random, 0.5);
    const double u = uniform(*random) < 0.5 ? uniform(*random) : 0.005;
    const auto bearing =
        camera.Unproject({u * camera.width_px(), uniform(*random) * camera.height_px()});
    if (!bearing) continue;
    const double distance = 1 + 3 * uniform(*random);
    const Eigen::Vector3d point = scene.pose * Eigen::Vector3d(distance * *bearing);
    scene.landmark.euclidean = euclidean;
    scene.landmark.point_in_submap = point;
    scene.landmark.inverse_depth = 1 / (point - scene.anchor).norm();
    scene.landmark.ray_frame =
        Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), point - scene.anchor)
            .toRotationMatrix();
    return scene;
  }
}

class LandmarkJacobians : public testing::TestWithParam<bool> {
 protected:
  std::mt19937_64 random_{7};
};

TEST_P(LandmarkJacobians, Projection) {
  for (const CameraModel& camera : {MakeTestCamera(), MakeTestFisheye()}) {
    for (int i = 0; i < 50; ++i) {
      const Scene s = RandomScene(camera, GetParam(), &random_);
      LandmarkProjection p;
      ASSERT_TRUE(ProjectLandmark(s.landmark, s.anchor, s.pose, camera, &p).has_value());
      const auto numeric = NumericJacobianAtZero(
          12,
          [&](const Eigen::VectorXd& e) {
            Landmark moved = s.landmark;
            moved.Correct(e.segment<3>(6));
            return *ProjectLandmark(moved, s.anchor + e.tail<3>(), Perturbed(s.pose, e.head<6>()),
                                    camera);
          },
          1e-4);
      EXPECT_THAT(p.d_pixel_d_camera, NearMatrix(numeric.leftCols(6), 1e-4));
      EXPECT_THAT(p.d_pixel_d_landmark, NearMatrix(numeric.middleCols(6, 3), 1e-4));
      EXPECT_THAT(p.d_pixel_d_anchor, NearMatrix(GetParam() ? Eigen::MatrixXd::Zero(2, 3).eval()
                                                            : numeric.rightCols(3).eval(),
                                                 1e-4));
    }
  }
}

// The new landmark as a vector of errors relative to the unperturbed one.
Eigen::Vector3d ErrorOf(const Landmark& from, const Landmark& to) {
  if (from.euclidean) return to.point_in_submap - from.point_in_submap;
  const Eigen::Vector3d turn =
      RotationLog(Eigen::Quaterniond::FromTwoVectors(from.ray(), to.ray()));
  const Eigen::Vector3d local = from.ray_frame.transpose() * turn;
  return {local.y(), -local.x(), to.inverse_depth - from.inverse_depth};
}

TEST_P(LandmarkJacobians, Rebase) {
  for (int i = 0; i < 50; ++i) {
    const Scene s = RandomScene(MakeTestCamera(), GetParam(), &random_);
    const RebasedLandmark rebased = RebaseLandmark(s.landmark, s.anchor, s.pose);
    const auto numeric = NumericJacobianAtZero(
        12,
        [&](const Eigen::VectorXd& e) {
          Landmark moved = s.landmark;
          moved.Correct(e.segment<3>(6));
          const auto again =
              RebaseLandmark(moved, s.anchor + e.tail<3>(), Perturbed(s.pose, e.head<6>()));
          return ErrorOf(rebased.landmark, again.landmark);
        },
        1e-4);
    EXPECT_THAT(rebased.d_landmark_d_camera, NearMatrix(numeric.leftCols(6), 1e-7));
    EXPECT_THAT(rebased.d_landmark_d_landmark, NearMatrix(numeric.middleCols(6, 3), 1e-7));
    if (!GetParam()) {
      EXPECT_THAT(rebased.d_landmark_d_anchor, NearMatrix(numeric.rightCols(3), 1e-7));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(RayAndPoint, LandmarkJacobians, testing::Bool());

TEST(RayJacobians, PointOfRay) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 20; ++i) {
    const Scene s = RandomScene(MakeTestCamera(), false, &random);
    Eigen::Matrix3d d_point_d_ray;
    EXPECT_THAT(PointOfRay(s.landmark, s.anchor, &d_point_d_ray),
                NearMatrix(s.landmark.point_in_submap, 1e-9));
    const auto numeric = NumericJacobianAtZero(
        3,
        [&](const Eigen::VectorXd& e) {
          Landmark moved = s.landmark;
          moved.Correct(e);
          return PointOfRay(moved, s.anchor);
        },
        1e-4);
    EXPECT_THAT(d_point_d_ray, NearMatrix(numeric, 1e-6));
  }
}

TEST(RayJacobians, NewRay) {
  std::mt19937_64 random(4);
  for (const CameraModel& camera : {MakeTestCamera(), MakeTestFisheye()}) {
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(2, 3), Eigen::Vector2d(160, 120)}) {
      const Eigen::Quaterniond rotation = RotationExp(Random3(&random, 1));
      const auto ray = MakeRay(TrackId(1), pixel, 1, rotation, camera);
      ASSERT_TRUE(ray.has_value());
      const auto numeric = NumericJacobianAtZero(
          5,
          [&](const Eigen::VectorXd& e) {
            const auto again = MakeRay(TrackId(1), pixel + e.tail<2>(), 1,
                                       rotation * RotationExp(e.head<3>()), camera);
            return Eigen::VectorXd(ErrorOf(ray->landmark, again->landmark).head<2>());
          },
          1e-2);
      EXPECT_THAT(ray->d_ray_d_orientation, NearMatrix(numeric.leftCols(3), 1e-6));
      EXPECT_THAT(ray->d_ray_d_pixel, NearMatrix(numeric.rightCols(2), 1e-6));
    }
  }
}

// State of a constant-velocity model as an error against another.
Eigen::VectorXd ErrorOf(const ConstantVelocityModel& from, const ConstantVelocityModel& to) {
  Eigen::VectorXd error(12);
  error << to.submap_from_body().translation - from.submap_from_body().translation,
      RotationLog(from.submap_from_body().rotation.conjugate() * to.submap_from_body().rotation),
      to.linear_velocity() - from.linear_velocity(),
      to.angular_velocity_rad_s() - from.angular_velocity_rad_s();
  return error;
}

ConstantVelocityModel MovingModel(const Eigen::VectorXd& error) {
  ConstantVelocityModel model{ConstantVelocityOptions{}};
  MotionModel::MotionMatrix unused;
  model.Start(Timestamp{}, 1.0, &unused);
  Eigen::VectorXd state(12);
  state << 0.3, -0.2, 0.5, 0.4, -0.7, 0.2, 0.5, -0.3, 0.8, 0.9, -0.6, 1.2;
  model.Correct(state);
  model.Correct(error);
  return model;
}

TEST(ConstantVelocityJacobians, Transition) {
  const Timestamp later = FromSeconds(0.1);
  MotionModel::MotionMatrix transition, noise, unused;
  ConstantVelocityModel nominal = MovingModel(Eigen::VectorXd::Zero(12));
  ASSERT_TRUE(nominal.Predict(later, 1.0, &transition, &noise));
  const auto numeric = NumericJacobianAtZero(12, [&](const Eigen::VectorXd& e) {
    ConstantVelocityModel moved = MovingModel(e);
    moved.Predict(later, 1.0, &unused, &unused);
    return ErrorOf(nominal, moved);
  });
  EXPECT_THAT(transition, NearMatrix(numeric, 1e-8));
}

TEST(ConstantVelocityJacobians, Rebase) {
  MotionModel::MotionMatrix jacobian, unused;
  ConstantVelocityModel nominal = MovingModel(Eigen::VectorXd::Zero(12));
  nominal.Rebase(&jacobian);
  const auto numeric = NumericJacobianAtZero(12, [&](const Eigen::VectorXd& e) {
    ConstantVelocityModel moved = MovingModel(e);
    moved.Rebase(&unused);
    return ErrorOf(nominal, moved);
  });
  EXPECT_THAT(jacobian, NearMatrix(numeric, 1e-8));
}

TEST(ConstantVelocityJacobians, Rescaled) {
  Eigen::VectorXd factors, unused;
  const auto scaled = MovingModel(Eigen::VectorXd::Zero(12)).Rescaled(2.5, &factors);
  const auto numeric = NumericJacobianAtZero(12, [&](const Eigen::VectorXd& e) {
    return scaled->ErrorOf(*MovingModel(e).Rescaled(2.5, &unused));
  });
  EXPECT_THAT(Eigen::MatrixXd(factors.asDiagonal()), NearMatrix(numeric, 1e-8));
}

// A body with a camera on a lever arm and nothing else.
class BareBody : public MotionModel {
 public:
  explicit BareBody(const Rigid3& body_from_camera) : MotionModel(body_from_camera) {}
  int error_dim() const override { return 6; }
  void Start(Timestamp, double, MotionMatrix*) override {}
  bool Predict(Timestamp, double, MotionMatrix*, MotionMatrix*) override { return false; }
  void CorrectRest(const Eigen::Ref<const Eigen::VectorXd>&) override {}
  void RebaseRest(MotionMatrix*) override {}
  Eigen::Vector3d linear_velocity() const override { return Eigen::Vector3d::Zero(); }
  Eigen::Vector3d angular_velocity_rad_s() const override { return Eigen::Vector3d::Zero(); }
};

TEST(MotionModelJacobians, CameraByBodyPose) {
  BareBody body({RotationExp({0.3, -1.2, 0.4}), Eigen::Vector3d(0.1, -0.2, 0.3)});
  body.Correct((Eigen::VectorXd(6) << 1, 2, 3, 0.4, -0.5, 0.6).finished());
  const Rigid3 camera = body.submap_from_camera();
  const auto numeric = NumericJacobianAtZero(6, [&](const Eigen::VectorXd& e) {
    const Rigid3 moved = body.CorrectedCamera(e);
    Eigen::VectorXd error(6);
    error << moved.translation - camera.translation,
        RotationLog(camera.rotation.conjugate() * moved.rotation);
    return error;
  });
  EXPECT_THAT(body.DCameraDPose(), NearMatrix(numeric, 1e-8));
}

}  // namespace
}  // namespace portolan
