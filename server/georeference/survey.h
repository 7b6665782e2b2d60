// What the operator knows about positions: surveyed control points and the origin of the site.
//
// The site frame is the frame of a georeferenced component: x east, y north, z up, metres, about an
// origin near the site. Grid coordinates (easting, northing, height of a local survey) differ from
// it by a translation only: a grid that is turned against true north must not be mixed with WGS84.
#ifndef PORTOLAN_SERVER_GEOREFERENCE_SURVEY_H_
#define PORTOLAN_SERVER_GEOREFERENCE_SURVEY_H_

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/strong_id.h"
#include "common/base/time.h"
#include "common/geodesy/local_frame.h"

namespace portolan {

inline constexpr size_t kMaxControlPoints = 10000;
inline constexpr size_t kMaxObservationsOfPoint = 1000;
inline constexpr size_t kMaxControlPointIdLength = 64;
// A frame this far from its origin loses the digits of float32 and is no plane any more.
inline constexpr double kMaxSiteExtent_m = 100e3;

// Where an image shows a control point.
struct ControlObservation {
  AgentId agent;
  // None: of whichever session of the agent has a keyframe at that time.
  std::optional<SessionId> session;
  // Of a keyframe, to within kKeyframeTimeTolerance.
  Timestamp time{};
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // raw (distorted) image coordinates
  double sigma_px = 1;
};

inline constexpr Duration kKeyframeTimeTolerance = std::chrono::milliseconds(1);

struct ControlPoint {
  std::string id;  // 1 to 64 characters of A-Z a-z 0-9 . _ -
  // Of one kind.
  std::optional<GeodeticPosition> geodetic;
  std::optional<Eigen::Vector3d> grid_m;  // easting, northing, height
  double sigma_m = 0.02;                  // of each coordinate
  std::vector<ControlObservation> observations;
};

// A point that is the origin of the site frame, in either system or both.
struct SiteOrigin {
  std::optional<GeodeticPosition> geodetic;
  // The grid coordinates of the origin; zero where there is no grid.
  Eigen::Vector3d grid_m = Eigen::Vector3d::Zero();

  friend bool operator==(const SiteOrigin&, const SiteOrigin&) = default;
};

struct Survey {
  std::vector<ControlPoint> points;  // ascending id
  // The operator's choice.
  std::optional<SiteOrigin> origin;

  bool empty() const { return points.empty() && !origin; }
};

// Ranges, finiteness, exactly one kind of position, two observations or more. InvalidArgument
// names the point.
Status ValidateControlPoint(const ControlPoint& point);
Status ValidateSiteOrigin(const SiteOrigin& origin);

// In the site frame; FailedPrecondition if the origin does not tell how to get there (geodetic
// coordinates of the origin are unknown), or the point lies farther away than kMaxSiteExtent_m.
StatusOr<Eigen::Vector3d> PositionInSite(const SiteOrigin& origin,
                                         const GeodeticPosition& position);
StatusOr<Eigen::Vector3d> PositionInSite(const SiteOrigin& origin, const ControlPoint& point);

// The origin that the survey implies: the operator's; else the grid's own, if a point is given in
// it; else the first geodetic point's; else none.
std::optional<SiteOrigin> ImpliedOrigin(const Survey& survey);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_GEOREFERENCE_SURVEY_H_
