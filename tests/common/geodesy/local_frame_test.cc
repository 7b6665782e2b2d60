#include "common/geodesy/local_frame.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <limits>

namespace portolan {
namespace {

TEST(LocalFrame, OneDegreeOfLatitudeAndLongitude) {
  // Meridian and parallel arcs of WGS84 at 45 degrees: 111.132 km and 78.847 km a degree.
  const LocalFrame frame({45, 9, 100});
  const double step_deg = 1e-3;
  const Eigen::Vector3d north = frame.FromGeodetic({45 + step_deg, 9, 100});
  EXPECT_NEAR(north.y(), 111.132, 0.003);
  EXPECT_NEAR(north.x(), 0, 1e-9);
  const Eigen::Vector3d east = frame.FromGeodetic({45, 9 + step_deg, 100});
  EXPECT_NEAR(east.x(), 78.848, 0.003);
  EXPECT_NEAR(frame.FromGeodetic({45, 9, 103}).z(), 3, 1e-9);
}

TEST(LocalFrame, EarthsCurvatureShowsInTheHeight) {
  const LocalFrame frame({0, 0, 0});
  const Eigen::Vector3d far = frame.FromGeodetic({0, 0.1, 0});
  EXPECT_NEAR(far.z(), -far.x() * far.x() / (2 * 6378137.0), 0.01);
}

TEST(LocalFrame, GoesThereAndBack) {
  for (const GeodeticPosition& origin :
       {GeodeticPosition{0, 0, 0}, {47.3, 8.5, 410}, {-33.9, 151.2, -20}, {89.9999, -170, 2000}}) {
    const LocalFrame frame(origin);
    EXPECT_LT(frame.FromGeodetic(origin).norm(), 1e-8);
    for (const Eigen::Vector3d& position :
         {Eigen::Vector3d(3, -4, 5), Eigen::Vector3d(-20e3, 15e3, 3e3)}) {
      const Eigen::Vector3d back = frame.FromGeodetic(frame.ToGeodetic(position));
      EXPECT_LT((back - position).norm(), 1e-6) << origin.latitude_deg;
    }
  }
}

TEST(LocalFrame, RefusesWhatIsNotOnEarth) {
  EXPECT_TRUE(ValidateGeodetic({90, -180, 8848}).ok());
  EXPECT_FALSE(ValidateGeodetic({90.1, 0, 0}).ok());
  EXPECT_FALSE(ValidateGeodetic({0, 181, 0}).ok());
  EXPECT_FALSE(ValidateGeodetic({0, 0, 2e5}).ok());
  EXPECT_FALSE(ValidateGeodetic({std::numeric_limits<double>::quiet_NaN(), 0, 0}).ok());
}

}  // namespace
}  // namespace portolan
