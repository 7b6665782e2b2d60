#include "server/georeference/georeference_fit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace portolan {
namespace {

using ::testing::HasSubstr;

const Similarity3 kSiteFromWorld{
    3.7, Eigen::Quaterniond(0.8, 0.2, -0.4, 0.4).normalized(), {120, -40, 15}};

// Points of an area 200 m wide, with noise in the site.
std::vector<SitePoint> MakePoints(int count, double sigma_m, const Similarity3& site_from_world,
                                  const Eigen::Vector3d& extent = {100, 100, 20}) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::normal_distribution<double> normal(0, sigma_m);
  std::vector<SitePoint> points(count);
  for (SitePoint& point : points) {
    const Eigen::Vector3d in_site =
        Eigen::Vector3d(uniform(random), uniform(random), uniform(random)).cwiseProduct(extent);
    point.in_world = site_from_world.Inverse() * in_site;
    point.in_site = in_site + Eigen::Vector3d(normal(random), normal(random), normal(random));
    point.site_covariance = sigma_m * sigma_m * Eigen::Matrix3d::Identity();
  }
  return points;
}

double Difference(const Similarity3& a, const Similarity3& b) {
  double largest = 0;
  for (const Eigen::Vector3d& corner : {Eigen::Vector3d(20, 0, 0), {0, 20, 0}, {0, 0, 20}}) {
    largest = std::max(largest, (a * corner - b * corner).norm());
  }
  return largest;
}

TEST(GeoreferenceFit, FindsTheSimilarity) {
  const auto points = MakePoints(40, 0.1, kSiteFromWorld);
  const GeoreferenceFit fit = FitGeoreference({}, points, false, false);
  EXPECT_EQ(fit.problem, "");
  EXPECT_EQ(fit.mode, AlignmentMode::kSim3);
  EXPECT_LT(Difference(fit.site_from_world, kSiteFromWorld), 0.1);
}

TEST(GeoreferenceFit, WithstandsAThirdOfWrongPositions) {
  auto points = MakePoints(30, 0.1, kSiteFromWorld);
  for (size_t i = 0; i < points.size(); i += 3) points[i].in_site += Eigen::Vector3d(50, -70, 20);
  const GeoreferenceFit fit = FitGeoreference({}, points, false, false);
  EXPECT_EQ(fit.problem, "");
  EXPECT_LT(Difference(fit.site_from_world, kSiteFromWorld), 0.15);
}

TEST(GeoreferenceFit, OneWrongOfFivePrecisePoints) {
  auto points = MakePoints(5, 0.02, kSiteFromWorld);
  points[2].in_site.x() += 8;
  const GeoreferenceFit fit = FitGeoreference({}, points, false, false);
  EXPECT_EQ(fit.problem, "");
  EXPECT_LT(Difference(fit.site_from_world, kSiteFromWorld), 0.1);
}

TEST(GeoreferenceFit, TwoPointsAreTooFew) {
  EXPECT_THAT(FitGeoreference({}, MakePoints(2, 0.1, kSiteFromWorld), true, true).problem,
              HasSubstr("at least 3"));
}

TEST(GeoreferenceFit, PointsOnALineAreRefusedUnlessGravityIsKnown) {
  Similarity3 upright;
  upright.rotation = Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ());
  upright.translation = {5, 6, 7};
  const auto points = MakePoints(30, 0.1, upright, {100, 0.5, 0.5});
  EXPECT_THAT(FitGeoreference({}, points, false, false).problem, HasSubstr("on a line"));
  EXPECT_THAT(FitGeoreference({}, points, true, false).problem, HasSubstr("on a line"));
  const GeoreferenceFit fit = FitGeoreference({}, points, true, true);
  EXPECT_EQ(fit.problem, "");
  EXPECT_EQ(fit.mode, AlignmentMode::kYaw);
  EXPECT_LT(Difference(fit.site_from_world, upright), 0.1);
}

TEST(GeoreferenceFit, PointsTooCloseForTheirAccuracyAreRefused) {
  const auto points = MakePoints(10, 5, kSiteFromWorld, {4, 4, 4});
  EXPECT_THAT(FitGeoreference({}, points, true, true).problem, HasSubstr("too close"));
}

TEST(GeoreferenceFit, RefusesNonsense) {
  GeoreferenceFitOptions options;
  EXPECT_TRUE(options.Validate().ok());
  options.outlier_sigmas = 0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace portolan
