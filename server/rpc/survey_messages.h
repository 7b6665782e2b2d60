// Control points and georeference as messages (proto/map_service.proto).
#ifndef PORTOLAN_SERVER_RPC_SURVEY_MESSAGES_H_
#define PORTOLAN_SERVER_RPC_SURVEY_MESSAGES_H_

#include "common/base/status.h"
#include "proto/map_service.pb.h"
#include "server/fusion/map_state.h"
#include "server/georeference/survey.h"

namespace portolan {

// InvalidArgument for what is malformed; the result passes ValidateControlPoint().
StatusOr<ControlPoint> FromProto(const v1::ControlPoint& message);
StatusOr<SiteOrigin> FromProto(const v1::SiteOrigin& message);

void ToProto(const SiteOrigin& origin, v1::SiteOrigin* message);
v1::ControlPoints ToProto(const Survey& survey);
// Of a component whose georeference is not null.
void ToProto(const ComponentState& component, bool with_residuals, v1::Georeference* message);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_RPC_SURVEY_MESSAGES_H_
