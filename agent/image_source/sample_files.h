// Files of IMU, odometry and range samples and of satellite positions.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLE_FILES_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLE_FILES_H_

#include <filesystem>
#include <vector>

#include "agent/image_source/samples.h"
#include "common/base/status.h"
#include "common/submap/submap.h"

namespace portolan {

// EuRoC order: time [ns], angular rate x y z [rad/s], specific force x y z [m/s^2]. The result has
// strictly increasing times: lines out of order are sorted, repeated times kept once, with a
// warning. A line with a field too few, NaN or a wild number is an InvalidArgument that names it.
StatusOr<std::vector<ImuSample>> ReadImuCsv(const std::filesystem::path& path);

// time [ns], x, y [m], heading [rad] (planar) or time [ns], x, y, z [m], qw, qx, qy, qz. Order and
// errors as above.
StatusOr<std::vector<OdometrySample>> ReadOdometryCsv(const std::filesystem::path& path);

// time [ns], latitude, longitude [deg], height above the ellipsoid [m], standard deviation of each
// horizontal coordinate and of the height [m]. Order and errors as above.
StatusOr<std::vector<GnssFix>> ReadGnssCsv(const std::filesystem::path& path);

// time [ns], range [m] and, if it differs from sample to sample, its standard deviation [m]. Order
// and errors as above; a range of zero is a measurement without an echo, not an error.
StatusOr<std::vector<RangeSample>> ReadRangeCsv(const std::filesystem::path& path);

// The sensor.yaml of a range finder: position_in_camera_m and direction_in_camera, three numbers
// each, sigma_m, min_range_m, max_range_m. NotFound, or an InvalidArgument that names file, line
// and key.
StatusOr<RangeFinder> ReadRangeFinder(const std::filesystem::path& path);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_SAMPLE_FILES_H_
