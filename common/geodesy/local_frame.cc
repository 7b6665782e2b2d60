#include "common/geodesy/local_frame.h"

#include <cmath>
#include <numbers>

namespace portolan {
namespace {

// WGS84 (NIMA TR8350.2, 3rd edition, Table 3.1): semi-major axis and flattening.
constexpr double kSemiMajor_m = 6378137.0;
constexpr double kFlattening = 1 / 298.257223563;
constexpr double kEccentricity2 = kFlattening * (2 - kFlattening);
constexpr double kRadPerDeg = std::numbers::pi / 180;
constexpr double kMinHeight_m = -20e3;
constexpr double kMaxHeight_m = 100e3;
// Each shrinks the error by about 1/150; the first guess is right to 100 m at any height allowed.
constexpr int kLatitudeIterations = 8;

double PrimeVerticalRadius(double sine) {
  return kSemiMajor_m / std::sqrt(1 - kEccentricity2 * sine * sine);
}

// Earth-centred, earth-fixed: x to longitude 0, z to the north pole.
Eigen::Vector3d EarthFromGeodetic(const GeodeticPosition& position) {
  const double latitude = position.latitude_deg * kRadPerDeg;
  const double longitude = position.longitude_deg * kRadPerDeg;
  const double radius = PrimeVerticalRadius(std::sin(latitude));
  const double across = (radius + position.height_m) * std::cos(latitude);
  return {across * std::cos(longitude), across * std::sin(longitude),
          (radius * (1 - kEccentricity2) + position.height_m) * std::sin(latitude)};
}

GeodeticPosition GeodeticFromEarth(const Eigen::Vector3d& earth) {
  const double across = std::hypot(earth.x(), earth.y());
  double latitude = std::atan2(earth.z(), across * (1 - kEccentricity2));
  for (int i = 0; i < kLatitudeIterations; ++i) {
    const double sine = std::sin(latitude);
    latitude = std::atan2(earth.z() + kEccentricity2 * PrimeVerticalRadius(sine) * sine, across);
  }
  // The distance along the normal; good at the poles and at the equator.
  const double sine = std::sin(latitude);
  const double radius = PrimeVerticalRadius(sine);
  const double height =
      across * std::cos(latitude) + earth.z() * sine - kSemiMajor_m * kSemiMajor_m / radius;
  return {latitude / kRadPerDeg, std::atan2(earth.y(), earth.x()) / kRadPerDeg, height};
}

bool IsWithin(double value, double low, double high) { return value >= low && value <= high; }

}  // namespace

Status ValidateGeodetic(const GeodeticPosition& position) {
  if (!IsWithin(position.latitude_deg, -90, 90)) {
    return absl::InvalidArgumentError("the latitude is not within -90..90 degrees");
  }
  if (!IsWithin(position.longitude_deg, -180, 180)) {
    return absl::InvalidArgumentError("the longitude is not within -180..180 degrees");
  }
  if (!IsWithin(position.height_m, kMinHeight_m, kMaxHeight_m)) {
    return absl::InvalidArgumentError("the height is not within -20..100 km");
  }
  return absl::OkStatus();
}

LocalFrame::LocalFrame(const GeodeticPosition& origin)
    : origin_(origin), origin_in_earth_(EarthFromGeodetic(origin)) {
  const double latitude = origin.latitude_deg * kRadPerDeg;
  const double longitude = origin.longitude_deg * kRadPerDeg;
  const Eigen::Vector3d east(-std::sin(longitude), std::cos(longitude), 0);
  const Eigen::Vector3d up(std::cos(latitude) * std::cos(longitude),
                           std::cos(latitude) * std::sin(longitude), std::sin(latitude));
  local_from_earth_.row(0) = east;
  local_from_earth_.row(1) = up.cross(east);
  local_from_earth_.row(2) = up;
}

Eigen::Vector3d LocalFrame::FromGeodetic(const GeodeticPosition& position) const {
  return local_from_earth_ * (EarthFromGeodetic(position) - origin_in_earth_);
}

GeodeticPosition LocalFrame::ToGeodetic(const Eigen::Vector3d& position_m) const {
  return GeodeticFromEarth(origin_in_earth_ + local_from_earth_.transpose() * position_m);
}

}  // namespace portolan
