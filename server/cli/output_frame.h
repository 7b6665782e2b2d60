// Positions of georeferenced components in the frame that the operator asks for.
#ifndef PORTOLAN_SERVER_CLI_OUTPUT_FRAME_H_
#define PORTOLAN_SERVER_CLI_OUTPUT_FRAME_H_

#include <vector>

#include "common/base/status.h"
#include "common/client/map_client.h"
#include "common/config/option_table.h"

namespace portolan {

enum class OutputFrame {
  kWorld,  // of the component; east, north, up if it is georeferenced
  kWgs84,  // latitude and longitude in degrees, height above the ellipsoid in metres
  kGrid,   // easting, northing, height of the local grid in metres
};

// Adds --frame.
void AddOutputFrame(OptionTable* table, OutputFrame* frame);

// Replace positions; rotations stay those in the world. FailedPrecondition if a component is not
// georeferenced, or its origin's WGS84 coordinates are not known.
Status ConvertTrajectory(const MapClient& client, OutputFrame frame,
                         std::vector<v1::TrajectorySegment>* segments);
Status ConvertLandmarks(const MapClient& client, OutputFrame frame, v1::LandmarkPage* page);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_CLI_OUTPUT_FRAME_H_
