#include "server/rpc/survey_messages.h"

#include "common/wire/geometry_wire.h"
#include "common/wire/submap_validation.h"

namespace portolan {
namespace {

constexpr size_t kMaxProblemLength = 512;

GeodeticPosition Geodetic(const v1::GeodeticPosition& message) {
  return {message.latitude_deg(), message.longitude_deg(), message.height_m()};
}

void Fill(const GeodeticPosition& position, v1::GeodeticPosition* message) {
  message->set_latitude_deg(position.latitude_deg);
  message->set_longitude_deg(position.longitude_deg);
  message->set_height_m(position.height_m);
}

Eigen::Vector3d Numbers(const v1::Vector3& message) {
  return {message.x(), message.y(), message.z()};
}

v1::GeoreferenceMode ModeOf(AlignmentMode mode) {
  switch (mode) {
    case AlignmentMode::kNone:
      return v1::GEOREFERENCE_MODE_UNSPECIFIED;
    case AlignmentMode::kYaw:
      return v1::GEOREFERENCE_MODE_YAW;
    case AlignmentMode::kSe3:
      return v1::GEOREFERENCE_MODE_RIGID;
    case AlignmentMode::kSim3:
      return v1::GEOREFERENCE_MODE_SIMILARITY;
  }
  return v1::GEOREFERENCE_MODE_UNSPECIFIED;
}

void Fill(const ControlPoint& point, v1::ControlPoint* message) {
  message->set_id(point.id);
  if (point.geodetic) Fill(*point.geodetic, message->mutable_geodetic());
  if (point.grid_m) ToProto(*point.grid_m, message->mutable_grid());
  message->set_sigma_m(point.sigma_m);
  for (const ControlObservation& observation : point.observations) {
    v1::ControlObservation* one = message->add_observations();
    one->set_agent_id(observation.agent.value());
    if (observation.session) one->set_session_id(observation.session->value());
    one->set_time_ns(observation.time.count());
    one->set_u_px(observation.pixel.x());
    one->set_v_px(observation.pixel.y());
    one->set_sigma_px(observation.sigma_px);
  }
}

}  // namespace

StatusOr<ControlPoint> FromProto(const v1::ControlPoint& message) {
  ControlPoint point;
  point.id = message.id();
  if (message.has_geodetic()) point.geodetic = Geodetic(message.geodetic());
  if (message.has_grid()) point.grid_m = Numbers(message.grid());
  if (message.sigma_m() != 0) point.sigma_m = message.sigma_m();
  for (const v1::ControlObservation& one : message.observations()) {
    ControlObservation observation;
    observation.agent = AgentId(one.agent_id());
    if (!IsValidAgentId(one.agent_id())) {
      return absl::InvalidArgumentError("an observation's agent_id is not a vehicle's name");
    }
    if (one.session_id() != 0) observation.session = SessionId(one.session_id());
    if (one.time_ns() < 0 || Timestamp(one.time_ns()) > kMaxTime) {
      return absl::InvalidArgumentError("an observation's time is out of range");
    }
    observation.time = Timestamp(one.time_ns());
    observation.pixel = {one.u_px(), one.v_px()};
    if (one.sigma_px() != 0) observation.sigma_px = one.sigma_px();
    point.observations.push_back(std::move(observation));
  }
  PORTOLAN_RETURN_IF_ERROR(ValidateControlPoint(point));
  return point;
}

StatusOr<SiteOrigin> FromProto(const v1::SiteOrigin& message) {
  SiteOrigin origin;
  if (message.has_geodetic()) origin.geodetic = Geodetic(message.geodetic());
  if (message.has_grid()) origin.grid_m = Numbers(message.grid());
  PORTOLAN_RETURN_IF_ERROR(ValidateSiteOrigin(origin));
  return origin;
}

void ToProto(const SiteOrigin& origin, v1::SiteOrigin* message) {
  if (origin.geodetic) Fill(*origin.geodetic, message->mutable_geodetic());
  ToProto(origin.grid_m, message->mutable_grid());
}

v1::ControlPoints ToProto(const Survey& survey) {
  v1::ControlPoints message;
  for (const ControlPoint& point : survey.points) Fill(point, message.add_points());
  if (survey.origin) ToProto(*survey.origin, message.mutable_origin());
  return message;
}

void ToProto(const ComponentState& component, bool with_residuals, v1::Georeference* message) {
  const GeoreferenceReport& report = *component.georeference;
  message->set_component_id(component.id.value());
  message->set_georeferenced(report.is_georeferenced);
  message->set_problem(report.problem.substr(0, kMaxProblemLength));
  ToProto(report.origin, message->mutable_origin());
  message->set_mode(ModeOf(report.mode));
  message->set_control_point_count(static_cast<uint32_t>(report.control_point_count));
  message->set_fix_count(static_cast<uint32_t>(report.fix_count));
  message->set_outlier_count(static_cast<uint32_t>(report.outlier_count));
  message->set_rms_control_horizontal_m(report.rms_control_horizontal_m);
  message->set_rms_control_vertical_m(report.rms_control_vertical_m);
  message->set_rms_fix_horizontal_m(report.rms_fix_horizontal_m);
  message->set_rms_fix_vertical_m(report.rms_fix_vertical_m);
  message->set_metric_submap_count(static_cast<uint32_t>(report.metric_submap_count));
  message->set_rms_log_scale(report.rms_log_scale);
  message->set_vertical_submap_count(static_cast<uint32_t>(report.vertical_submap_count));
  message->set_rms_tilt_rad(report.rms_tilt_rad);
  if (!with_residuals) return;
  for (const GeoreferenceResidual& residual : report.residuals) {
    v1::GeoreferenceResidual* one = message->add_residuals();
    one->set_control_point_id(residual.control_point);
    one->set_agent_id(residual.agent.value());
    one->set_time_ns(residual.time.count());
    ToProto(residual.error_m, one->mutable_error());
    one->set_sigma_m(residual.sigma_m);
    one->set_outlier(residual.is_outlier);
  }
}

}  // namespace portolan
