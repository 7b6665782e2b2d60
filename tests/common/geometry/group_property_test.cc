// One suite of group laws, run over rotations, rigid motions and similarities.
#include <random>

#include "common/geometry/similarity3.h"
#include "tests/support/matchers.h"
#include "tests/support/numeric_derivative.h"

namespace portolan {
namespace {

using Eigen::Vector3d;

// What the suite needs to know of each group.
struct RotationGroup {
  static constexpr int kDimension = 3, kAngleOffset = 0;
  using Element = Eigen::Quaterniond;
  using Tangent = Vector3d;
  static Element Identity() { return Element::Identity(); }
  static Element Exp(const Tangent& v) { return RotationExp(v); }
  static Tangent Log(const Element& g) { return RotationLog(g); }
  static Element Inverse(const Element& g) { return g.conjugate(); }
  static Eigen::MatrixXd Adjoint(const Element& g) { return g.toRotationMatrix(); }
};

struct RigidGroup {
  static constexpr int kDimension = 6, kAngleOffset = 3;
  using Element = Rigid3;
  using Tangent = Vector6d;
  static Element Identity() { return Rigid3::Identity(); }
  static Element Exp(const Tangent& v) { return Rigid3::Exp(v); }
  static Tangent Log(const Element& g) { return g.Log(); }
  static Element Inverse(const Element& g) { return g.Inverse(); }
  static Eigen::MatrixXd Adjoint(const Element& g) { return g.Adjoint(); }
};

struct SimilarityGroup {
  static constexpr int kDimension = 7, kAngleOffset = 3;
  using Element = Similarity3;
  using Tangent = Vector7d;
  static Element Identity() { return Similarity3::Identity(); }
  static Element Exp(const Tangent& v) { return Similarity3::Exp(v); }
  static Tangent Log(const Element& g) { return g.Log(); }
  static Element Inverse(const Element& g) { return g.Inverse(); }
  static Eigen::MatrixXd Adjoint(const Element& g) { return g.Adjoint(); }
};

template <typename Group>
class GroupPropertyTest : public testing::Test {
 protected:
  using Tangent = typename Group::Tangent;
  using Element = typename Group::Element;

  // Entries uniform in [-1, 1], the rotation part scaled to `angle` radians.
  Tangent RandomTangent(double angle) {
    std::uniform_real_distribution<double> uniform(-1, 1);
    Tangent v;
    for (int i = 0; i < Group::kDimension; ++i) v[i] = uniform(generator_);
    auto rotation = v.template segment<3>(Group::kAngleOffset);
    rotation *= angle / rotation.norm();
    return v;
  }
  Element Random() { return Group::Exp(RandomTangent(angle_(generator_))); }

  static double Distance(const Element& a, const Element& b) {
    return Group::Log(Group::Inverse(a) * b).norm();
  }

  std::mt19937 generator_{7};
  std::uniform_real_distribution<double> angle_{0, 3.1};
};

using Groups = testing::Types<RotationGroup, RigidGroup, SimilarityGroup>;
TYPED_TEST_SUITE(GroupPropertyTest, Groups);

TYPED_TEST(GroupPropertyTest, LogInvertsExpFromTinyToNearlyPi) {
  for (double angle : {1e-15, 1e-9, 1e-5, 9.99e-3, 1.01e-2, 0.5, 2.0, 3.0, 3.14159}) {
    for (int i = 0; i < 20; ++i) {
      const auto v = this->RandomTangent(angle);
      EXPECT_THAT(TypeParam::Log(TypeParam::Exp(v)), NearMatrix(v, 2e-10)) << "angle " << angle;
    }
  }
}

TYPED_TEST(GroupPropertyTest, ExpOfZeroIsIdentityAndLogOfIdentityIsZero) {
  const typename TypeParam::Tangent zero = TypeParam::Tangent::Zero();
  EXPECT_EQ(TypeParam::Log(TypeParam::Identity()), zero);
  EXPECT_LT(this->Distance(TypeParam::Exp(zero), TypeParam::Identity()), 1e-15);
}

TYPED_TEST(GroupPropertyTest, InverseCancelsOnBothSides) {
  for (int i = 0; i < 100; ++i) {
    const auto g = this->Random();
    EXPECT_LT(this->Distance(g * TypeParam::Inverse(g), TypeParam::Identity()), 1e-13);
    EXPECT_LT(this->Distance(TypeParam::Inverse(g) * g, TypeParam::Identity()), 1e-13);
  }
}

TYPED_TEST(GroupPropertyTest, CompositionIsAssociative) {
  for (int i = 0; i < 100; ++i) {
    const auto a = this->Random(), b = this->Random(), c = this->Random();
    EXPECT_LT(this->Distance((a * b) * c, a * (b * c)), 1e-12);
  }
}

TYPED_TEST(GroupPropertyTest, CompositionActsOnPointsInOrder) {
  for (int i = 0; i < 100; ++i) {
    const auto a = this->Random(), b = this->Random();
    const Vector3d point = Vector3d(1, -2, 3) * (i + 1);
    EXPECT_THAT((a * b) * point, NearMatrix(a * (b * point), 1e-11 * (i + 1)));
  }
}

TYPED_TEST(GroupPropertyTest, AdjointMovesAPerturbationToTheOtherSide) {
  for (int i = 0; i < 100; ++i) {
    const auto g = this->Random();
    const typename TypeParam::Tangent d = this->RandomTangent(0.3) * 0.5;
    const typename TypeParam::Tangent moved = TypeParam::Adjoint(g) * d;
    EXPECT_LT(this->Distance(g * TypeParam::Exp(d), TypeParam::Exp(moved) * g), 1e-12);
  }
}

TYPED_TEST(GroupPropertyTest, ExpIsTangentToItsArgumentAtZero) {
  constexpr int kDimension = TypeParam::kDimension;
  const Eigen::MatrixXd jacobian = NumericJacobianAtZero(kDimension, [](const auto& d) {
    return TypeParam::Log(TypeParam::Exp(typename TypeParam::Tangent(d)));
  });
  EXPECT_THAT(jacobian, NearMatrix(Eigen::MatrixXd::Identity(kDimension, kDimension), 1e-10));
}

TYPED_TEST(GroupPropertyTest, TenThousandCompositionsKeepTheRotationNormalised) {
  const auto step = TypeParam::Exp(this->RandomTangent(0.7) * 0.0005);
  auto g = TypeParam::Identity();
  for (int i = 0; i < 10000; ++i) g = g * step;
  const Vector3d rotated = (g * Vector3d::UnitX()) - (g * Vector3d::Zero());
  const Vector3d other = (g * Vector3d::UnitY()) - (g * Vector3d::Zero());
  EXPECT_NEAR(rotated.dot(other) / rotated.norm() / other.norm(), 0, 1e-9);
}

}  // namespace
}  // namespace portolan
