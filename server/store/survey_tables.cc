#include "server/store/survey_tables.h"

#include <map>
#include <utility>

#include "common/base/concat.h"

namespace portolan {
namespace {

Status WriteObservations(SqliteStatement& insert, const ControlPoint& point) {
  for (size_t i = 0; i < point.observations.size(); ++i) {
    const ControlObservation& observation = point.observations[i];
    insert.BindText(1, point.id);
    insert.BindInteger(2, static_cast<int64_t>(i));
    insert.BindText(3, observation.agent.value());
    // A session is never 0, which here means any.
    insert.BindInteger(
        4, observation.session ? static_cast<int64_t>(observation.session->value()) : 0);
    insert.BindInteger(5, observation.time.count());
    insert.BindReal(6, observation.pixel.x());
    insert.BindReal(7, observation.pixel.y());
    insert.BindReal(8, observation.sigma_px);
    PORTOLAN_RETURN_IF_ERROR(insert.Run());
  }
  return absl::OkStatus();
}

Status WriteOrigin(SqliteDatabase& database, const SiteOrigin& origin) {
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement insert,
      SqliteStatement::Prepare(database, "INSERT INTO site_origin VALUES (1, ?, ?, ?, ?, ?, ?)"));
  if (origin.geodetic) {
    insert.BindReal(1, origin.geodetic->latitude_deg);
    insert.BindReal(2, origin.geodetic->longitude_deg);
    insert.BindReal(3, origin.geodetic->height_m);
  }
  for (int i = 0; i < 3; ++i) insert.BindReal(4 + i, origin.grid_m[i]);
  return insert.Run();
}

StatusOr<std::map<std::string, std::vector<ControlObservation>>> ReadObservations(
    SqliteDatabase& database) {
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement rows,
      SqliteStatement::Prepare(
          database,
          "SELECT control_point, agent, session, time_ns, u_px, v_px, sigma_px "
          "FROM control_observation ORDER BY control_point, position"));
  std::map<std::string, std::vector<ControlObservation>> observations;
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) return observations;
    ControlObservation observation;
    observation.agent = AgentId(std::string(rows.ColumnBytes(1)));
    if (const int64_t session = rows.ColumnInteger(2); session != 0) {
      observation.session = SessionId(static_cast<uint64_t>(session));
    }
    observation.time = Timestamp(rows.ColumnInteger(3));
    observation.pixel = {rows.ColumnReal(4), rows.ColumnReal(5)};
    observation.sigma_px = rows.ColumnReal(6);
    observations[std::string(rows.ColumnBytes(0))].push_back(std::move(observation));
  }
}

StatusOr<std::optional<SiteOrigin>> ReadOrigin(SqliteDatabase& database) {
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement rows,
      SqliteStatement::Prepare(database,
                               "SELECT latitude_deg IS NOT NULL, latitude_deg, longitude_deg, "
                               "height_m, grid_x, grid_y, grid_z FROM site_origin"));
  PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
  if (!has_row) return std::optional<SiteOrigin>();
  SiteOrigin origin;
  if (rows.ColumnInteger(0) != 0) {
    origin.geodetic = GeodeticPosition{rows.ColumnReal(1), rows.ColumnReal(2), rows.ColumnReal(3)};
  }
  origin.grid_m = {rows.ColumnReal(4), rows.ColumnReal(5), rows.ColumnReal(6)};
  return std::optional<SiteOrigin>(origin);
}

}  // namespace

Status WriteSurvey(SqliteDatabase& database, const Survey& survey) {
  PORTOLAN_RETURN_IF_ERROR(database.Execute(
      "DELETE FROM control_observation; DELETE FROM control_point; DELETE FROM site_origin"));
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement insert,
      SqliteStatement::Prepare(database, "INSERT INTO control_point VALUES (?, ?, ?, ?, ?, ?)"));
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement observation,
      SqliteStatement::Prepare(database,
                               "INSERT INTO control_observation VALUES (?, ?, ?, ?, ?, ?, ?, ?)"));
  for (const ControlPoint& point : survey.points) {
    Eigen::Vector3d position = point.grid_m.value_or(Eigen::Vector3d::Zero());
    if (point.geodetic) {
      position = {point.geodetic->latitude_deg, point.geodetic->longitude_deg,
                  point.geodetic->height_m};
    }
    insert.BindText(1, point.id);
    insert.BindInteger(2, point.geodetic.has_value());
    for (int i = 0; i < 3; ++i) insert.BindReal(3 + i, position[i]);
    insert.BindReal(6, point.sigma_m);
    PORTOLAN_RETURN_IF_ERROR(insert.Run());
    PORTOLAN_RETURN_IF_ERROR(WriteObservations(observation, point));
  }
  return survey.origin ? WriteOrigin(database, *survey.origin) : absl::OkStatus();
}

StatusOr<Survey> ReadSurvey(SqliteDatabase& database) {
  Survey survey;
  PORTOLAN_ASSIGN_OR_RETURN(survey.origin, ReadOrigin(database));
  PORTOLAN_ASSIGN_OR_RETURN(auto observations, ReadObservations(database));
  PORTOLAN_ASSIGN_OR_RETURN(
      SqliteStatement rows,
      SqliteStatement::Prepare(
          database, "SELECT id, is_geodetic, x, y, z, sigma_m FROM control_point ORDER BY id"));
  while (true) {
    PORTOLAN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
    if (!has_row) return survey;
    ControlPoint point;
    point.id = std::string(rows.ColumnBytes(0));
    const Eigen::Vector3d position(rows.ColumnReal(2), rows.ColumnReal(3), rows.ColumnReal(4));
    if (rows.ColumnInteger(1) != 0) {
      point.geodetic = GeodeticPosition{position.x(), position.y(), position.z()};
    } else {
      point.grid_m = position;
    }
    point.sigma_m = rows.ColumnReal(5);
    point.observations = std::move(observations[point.id]);
    const Status status = ValidateControlPoint(point);
    if (!status.ok()) {
      return absl::DataLossError(Concat("stored survey: ", status.message()));
    }
    survey.points.push_back(std::move(point));
  }
}

}  // namespace portolan
