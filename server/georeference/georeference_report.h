// How well a component fits what is known about positions; immutable, passes between threads.
#ifndef PORTOLAN_SERVER_GEOREFERENCE_GEOREFERENCE_REPORT_H_
#define PORTOLAN_SERVER_GEOREFERENCE_GEOREFERENCE_REPORT_H_

#include <Eigen/Core>
#include <string>
#include <vector>

#include "common/base/strong_id.h"
#include "common/base/time.h"
#include "common/trajectory/alignment.h"
#include "server/georeference/survey.h"

namespace portolan {

// What is left between the map and one position. Of a control point: between the point as the
// map's cameras see it (one entry for each pass of a camera by it) and its coordinates; of a fix:
// between the antenna and the fix.
struct GeoreferenceResidual {
  std::string control_point;  // empty: a fix
  AgentId agent;
  Timestamp time{};                                   // of the fix, or of a pass' middle
  Eigen::Vector3d error_m = Eigen::Vector3d::Zero();  // map - reference; east, north, up
  // Expected of the error's length, by the reference's own accuracy and the images'.
  double sigma_m = 0;
  bool is_outlier = false;
};

struct GeoreferenceReport {
  // The component's world is the site frame.
  bool is_georeferenced = false;
  // Why it is not, or what could not be used; for the operator.
  std::string problem;
  SiteOrigin origin;
  AlignmentMode mode = AlignmentMode::kNone;  // by which the world was moved there
  // By name and time; at most kMaxReportedResiduals. The root mean squares are over all but
  // outliers, horizontal as the length of two coordinates.
  std::vector<GeoreferenceResidual> residuals;
  int control_point_count = 0;
  int fix_count = 0;
  int outlier_count = 0;
  double rms_control_horizontal_m = 0;
  double rms_control_vertical_m = 0;
  double rms_fix_horizontal_m = 0;
  double rms_fix_vertical_m = 0;
  // Submaps whose own sensors tell metres, and how far they are off the map's (log of the scale);
  // likewise the vertical. A monocular vehicle's submaps have neither.
  int metric_submap_count = 0;
  double rms_log_scale = 0;
  int vertical_submap_count = 0;
  double rms_tilt_rad = 0;
};

inline constexpr size_t kMaxReportedResiduals = 10000;

}  // namespace portolan

#endif  // PORTOLAN_SERVER_GEOREFERENCE_GEOREFERENCE_REPORT_H_
