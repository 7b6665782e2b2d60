#include "server/georeference/survey.h"

#include <algorithm>
#include <cmath>

#include "common/base/concat.h"

namespace portolan {
namespace {

bool IsName(const std::string& id) {
  return !id.empty() && id.size() <= kMaxControlPointIdLength &&
         std::all_of(id.begin(), id.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '.' || c == '_' || c == '-';
         });
}

Status Refuse(const ControlPoint& point, const std::string& reason) {
  return absl::InvalidArgumentError(Concat("control point ", point.id, ": ", reason));
}

bool IsGridPosition(const Eigen::Vector3d& grid_m) {
  return grid_m.allFinite() && grid_m.cwiseAbs().maxCoeff() <= 1e8;
}

Status CheckExtent(const Eigen::Vector3d& position) {
  if (position.cwiseAbs().maxCoeff() <= kMaxSiteExtent_m) return absl::OkStatus();
  return absl::FailedPreconditionError(Concat(
      "lies ", std::round(position.norm() / 1000), " km from the site's origin, more than the ",
      kMaxSiteExtent_m / 1000, " km allowed; set an origin near the site"));
}

}  // namespace

Status ValidateControlPoint(const ControlPoint& point) {
  if (!IsName(point.id)) {
    return absl::InvalidArgumentError(
        "a control point's id has 1 to 64 characters of A-Z a-z 0-9 . _ -");
  }
  if (point.geodetic.has_value() == point.grid_m.has_value()) {
    return Refuse(point, "give one position, either in WGS84 or in the local grid");
  }
  if (point.geodetic) {
    const Status status = ValidateGeodetic(*point.geodetic);
    if (!status.ok()) return Refuse(point, std::string(status.message()));
  }
  if (point.grid_m && !IsGridPosition(*point.grid_m)) {
    return Refuse(point, "the position is not finite or farther than 1e8 m from zero");
  }
  if (!(point.sigma_m >= 1e-4 && point.sigma_m <= 1e3)) {
    return Refuse(point, "sigma is not within 0.0001..1000 m");
  }
  if (point.observations.size() < 2) return Refuse(point, "needs at least 2 observations");
  if (point.observations.size() > kMaxObservationsOfPoint) {
    return Refuse(point, "has more than 1000 observations");
  }
  for (const ControlObservation& observation : point.observations) {
    if (observation.agent.value().empty()) return Refuse(point, "an observation names no agent");
    if (!observation.pixel.allFinite() || observation.pixel.cwiseAbs().maxCoeff() > 32768) {
      return Refuse(point, "an observation's pixel is out of range");
    }
    if (!(observation.sigma_px >= 0.01 && observation.sigma_px <= 100)) {
      return Refuse(point, "an observation's sigma is not within 0.01..100 px");
    }
    if (observation.time.count() < 0) return Refuse(point, "an observation's time is negative");
  }
  return absl::OkStatus();
}

Status ValidateSiteOrigin(const SiteOrigin& origin) {
  if (origin.geodetic) PORTOLAN_RETURN_IF_ERROR(ValidateGeodetic(*origin.geodetic));
  if (!IsGridPosition(origin.grid_m)) {
    return absl::InvalidArgumentError("the origin's grid position is out of range");
  }
  return absl::OkStatus();
}

StatusOr<Eigen::Vector3d> PositionInSite(const SiteOrigin& origin,
                                         const GeodeticPosition& position) {
  if (!origin.geodetic) {
    return absl::FailedPreconditionError(
        "is given in WGS84, but the site's frame is a local grid whose place on the earth is "
        "unknown; set the origin with its WGS84 coordinates");
  }
  const Eigen::Vector3d local = LocalFrame(*origin.geodetic).FromGeodetic(position);
  PORTOLAN_RETURN_IF_ERROR(CheckExtent(local));
  return local;
}

StatusOr<Eigen::Vector3d> PositionInSite(const SiteOrigin& origin, const ControlPoint& point) {
  if (point.geodetic) return PositionInSite(origin, *point.geodetic);
  const Eigen::Vector3d local = *point.grid_m - origin.grid_m;
  PORTOLAN_RETURN_IF_ERROR(CheckExtent(local));
  return local;
}

std::optional<SiteOrigin> ImpliedOrigin(const Survey& survey) {
  if (survey.origin) return survey.origin;
  for (const ControlPoint& point : survey.points) {
    if (point.grid_m) return SiteOrigin{};
  }
  if (survey.points.empty()) return std::nullopt;
  return SiteOrigin{survey.points.front().geodetic, Eigen::Vector3d::Zero()};
}

}  // namespace portolan
