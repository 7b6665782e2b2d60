// Trajectory files.
//   TUM:   `timestamp[s] tx ty tz qx qy qz qw`, blank separated, '#' starts a comment line.
//   KITTI: one 3x4 matrix a line, row by row, 12 numbers; times [s] in a second file.
//   EuRoC: state_groundtruth csv `timestamp[ns],px,py,pz,qw,qx,qy,qz[,...]`, '#' comments.
// Readers are strict: a line with the wrong number of fields, a number that does not parse or is
// not finite, a rotation that is none, or a time that does not ascend is an InvalidArgument error
// whose message starts with `file:line:`. Quaternions off by rounding are normalised.
#ifndef PORTOLAN_COMMON_TRAJECTORY_TRAJECTORY_IO_H_
#define PORTOLAN_COMMON_TRAJECTORY_TRAJECTORY_IO_H_

#include <istream>
#include <ostream>
#include <string>
#include <vector>

#include "common/trajectory/trajectory.h"

namespace portolan {

StatusOr<Trajectory> ReadTumTrajectory(const std::string& path);
StatusOr<Trajectory> ReadKittiTrajectory(const std::string& poses_path,
                                         const std::string& times_path);
StatusOr<Trajectory> ReadEurocGroundTruth(const std::string& path);

// Chooses TUM or EuRoC by the first line that holds data (commas mean EuRoC).
StatusOr<Trajectory> ReadTrajectory(const std::string& path);

// First field of every data line, in seconds: times.txt of an image folder.
StatusOr<std::vector<Timestamp>> ReadTimes(const std::string& path);

// The same from streams; `name` stands for the file in errors.
StatusOr<Trajectory> ParseTumTrajectory(std::istream& input, const std::string& name);
StatusOr<Trajectory> ParseEurocGroundTruth(std::istream& input, const std::string& name);
StatusOr<Trajectory> ParseKittiTrajectory(std::istream& poses, const std::string& poses_name,
                                          const std::vector<Timestamp>& times);
StatusOr<std::vector<Timestamp>> ParseTimes(std::istream& input, const std::string& name);

// Times with all nine decimals, so that nanoseconds survive; other numbers with nine digits.
void FormatTumTrajectory(const Trajectory& trajectory, std::ostream& output);
void FormatKittiTrajectory(const Trajectory& trajectory, std::ostream& output);
Status WriteTumTrajectory(const Trajectory& trajectory, const std::string& path);
// Writes the times, one a line in seconds, to times_path.
Status WriteKittiTrajectory(const Trajectory& trajectory, const std::string& poses_path,
                            const std::string& times_path);

// `seconds.nanoseconds` without loss, and back. InvalidArgument unless the text is a plain decimal
// (sign, digits, point, exponent) within +-9e9 s; digits beyond the ninth decimal are rounded.
std::string FormatSeconds(Timestamp time);
StatusOr<Timestamp> ParseSeconds(const std::string& text);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_TRAJECTORY_TRAJECTORY_IO_H_
