#include "server/cli/output_frame.h"

#include <optional>

#include "common/base/concat.h"
#include "common/geodesy/local_frame.h"

namespace portolan {
namespace {

// From one component's world.
class PositionConverter {
 public:
  static StatusOr<PositionConverter> Create(const v1::MapInfo& info, int64_t component,
                                            OutputFrame frame) {
    for (const v1::ComponentInfo& one : info.components()) {
      if (one.component_id() != component || !one.has_site_origin()) continue;
      const v1::SiteOrigin& origin = one.site_origin();
      PositionConverter converter;
      converter.grid_ = {origin.grid().x(), origin.grid().y(), origin.grid().z()};
      if (frame == OutputFrame::kGrid) return converter;
      if (!origin.has_geodetic()) {
        return absl::FailedPreconditionError(
            "the site's place on the earth is unknown; set its WGS84 origin by `portolan "
            "control-points origin`");
      }
      converter.local_.emplace(GeodeticPosition{origin.geodetic().latitude_deg(),
                                                origin.geodetic().longitude_deg(),
                                                origin.geodetic().height_m()});
      return converter;
    }
    return absl::FailedPreconditionError(Concat("component ", component, " is not georeferenced"));
  }

  void Convert(double* x, double* y, double* z) const {
    const Eigen::Vector3d in_site(*x, *y, *z);
    Eigen::Vector3d result = in_site + grid_;
    if (local_) {
      const GeodeticPosition position = local_->ToGeodetic(in_site);
      result = {position.latitude_deg, position.longitude_deg, position.height_m};
    }
    *x = result.x();
    *y = result.y();
    *z = result.z();
  }

 private:
  Eigen::Vector3d grid_ = Eigen::Vector3d::Zero();
  std::optional<LocalFrame> local_;  // none: to the grid
};

}  // namespace

void AddOutputFrame(OptionTable* table, OutputFrame* frame) {
  table->AddChoice("frame", frame,
                   {{"world", OutputFrame::kWorld},
                    {"wgs84", OutputFrame::kWgs84},
                    {"grid", OutputFrame::kGrid}},
                   "Of the positions: the component's world (east, north, up if georeferenced); "
                   "latitude, longitude and height; or easting, northing and height of the grid.");
}

Status ConvertTrajectory(const MapClient& client, OutputFrame frame,
                         std::vector<v1::TrajectorySegment>* segments) {
  if (frame == OutputFrame::kWorld) return absl::OkStatus();
  PORTOLAN_ASSIGN_OR_RETURN(const v1::MapInfo info, client.GetMapInfo());
  for (v1::TrajectorySegment& segment : *segments) {
    PORTOLAN_ASSIGN_OR_RETURN(const PositionConverter converter,
                              PositionConverter::Create(info, segment.component_id(), frame));
    double* numbers = segment.mutable_world_from_camera()->mutable_data();
    for (int i = 0; i + 7 <= segment.world_from_camera_size(); i += 7) {
      converter.Convert(numbers + i + 4, numbers + i + 5, numbers + i + 6);
    }
  }
  return absl::OkStatus();
}

Status ConvertLandmarks(const MapClient& client, OutputFrame frame, v1::LandmarkPage* page) {
  if (frame == OutputFrame::kWorld || page->landmarks().empty()) return absl::OkStatus();
  PORTOLAN_ASSIGN_OR_RETURN(const v1::MapInfo info, client.GetMapInfo());
  PORTOLAN_ASSIGN_OR_RETURN(const PositionConverter converter,
                            PositionConverter::Create(info, page->component_id(), frame));
  for (v1::Landmark& landmark : *page->mutable_landmarks()) {
    v1::Vector3& point = *landmark.mutable_point_in_world();
    double x = point.x(), y = point.y(), z = point.z();
    converter.Convert(&x, &y, &z);
    point.set_x(x);
    point.set_y(y);
    point.set_z(z);
  }
  return absl::OkStatus();
}

}  // namespace portolan
