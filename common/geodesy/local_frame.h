// Positions on the earth (WGS84 ellipsoid) and in a local frame: x east, y north, z up, metres.
#ifndef PORTOLAN_COMMON_GEODESY_LOCAL_FRAME_H_
#define PORTOLAN_COMMON_GEODESY_LOCAL_FRAME_H_

#include <Eigen/Core>

#include "common/base/status.h"

namespace portolan {

// WGS84; the height is above the ellipsoid, not above the sea.
struct GeodeticPosition {
  double latitude_deg = 0;   // -90..90, north is positive
  double longitude_deg = 0;  // -180..180, east is positive
  double height_m = 0;       // -20 km..100 km

  friend bool operator==(const GeodeticPosition&, const GeodeticPosition&) = default;
};

// InvalidArgument if a number is not finite or out of its range.
Status ValidateGeodetic(const GeodeticPosition& position);

// The plane that touches the ellipsoid's parallel surface at an origin. Immutable, thread-safe.
class LocalFrame {
 public:
  // The origin is valid.
  explicit LocalFrame(const GeodeticPosition& origin);

  Eigen::Vector3d FromGeodetic(const GeodeticPosition& position) const;
  GeodeticPosition ToGeodetic(const Eigen::Vector3d& position_m) const;
  const GeodeticPosition& origin() const { return origin_; }

 private:
  GeodeticPosition origin_;
  Eigen::Vector3d origin_in_earth_;
  Eigen::Matrix3d local_from_earth_;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_GEODESY_LOCAL_FRAME_H_
