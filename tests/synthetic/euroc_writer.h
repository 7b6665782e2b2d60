// Writes a mission to disk in the EuRoC/ASL layout, one folder an agent:
//   FOLDER/agent0/mav0/cam0/{data.csv,sensor.yaml,data/<ns>.<ext>}
//                mav0/cam1/                 the same of a second camera, if there is one
//                mav0/imu0/{data.csv,sensor.yaml}
//                mav0/range0/{data.csv,sensor.yaml}   of a range finder, if there is one
//                mav0/state_groundtruth_estimate0/data.csv   of the body
//                groundtruth.txt   TUM format, the camera's optical frame at the image times
#ifndef PORTOLAN_TESTS_SYNTHETIC_EUROC_WRITER_H_
#define PORTOLAN_TESTS_SYNTHETIC_EUROC_WRITER_H_

#include <functional>
#include <string>

#include "common/base/status.h"
#include "common/trajectory/trajectory.h"
#include "tests/synthetic/mission.h"

namespace portolan::synthetic {

struct EurocWriterOptions {
  // "png", "jpg" (quality 95; a quarter of the size) or "pgm".
  std::string image_format = "jpg";
  // Called after every image, from the caller's thread.
  std::function<void(int frame)> on_frame = [](int) {};

  Status Validate() const;
};

// Renders and writes one agent; thread-compatible, so agents can be written at the same time.
Status WriteEurocAgent(const Mission& mission, int agent, const std::string& folder,
                       const EurocWriterOptions& options);

// Exact pose of the camera at every image time.
Trajectory CameraGroundTruth(const Mission& mission, int agent);

}  // namespace portolan::synthetic

#endif  // PORTOLAN_TESTS_SYNTHETIC_EUROC_WRITER_H_
