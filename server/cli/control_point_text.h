// Control points as the operator writes them: on the command line and in CSV files.
#ifndef PORTOLAN_SERVER_CLI_CONTROL_POINT_TEXT_H_
#define PORTOLAN_SERVER_CLI_CONTROL_POINT_TEXT_H_

#include <cstdint>
#include <istream>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "proto/map_service.pb.h"

namespace portolan {

// Seconds with up to nine decimals ("1403636579.763555584"), exactly, or whole nanoseconds with the
// unit ("1403636579763555584ns"). InvalidArgument for anything else.
StatusOr<int64_t> ParseTimeNs(const std::string& text);

// AGENT[/SESSION]:TIME:U:V[:SIGMA]; the session as 16 hexadecimal digits, pixels and their sigma.
StatusOr<v1::ControlObservation> ParseObservation(const std::string& text);

// One point a line; `#` begins a comment, empty lines are skipped:
//
//   id,wgs84|grid,latitude or easting,longitude or northing,height,sigma_m,observation
//   observation...
//
// Errors name the line.
StatusOr<std::vector<v1::ControlPoint>> ParseControlPoints(std::istream& file);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_CLI_CONTROL_POINT_TEXT_H_
