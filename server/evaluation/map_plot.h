// A picture of a map: trajectories over a cloud of landmarks from above and from the side, with
// errors where a ground truth is known.
#ifndef PORTOLAN_SERVER_EVALUATION_MAP_PLOT_H_
#define PORTOLAN_SERVER_EVALUATION_MAP_PLOT_H_

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"

namespace portolan {

struct PlotTrajectory {
  std::string name;
  std::vector<Eigen::Vector3d> positions;
  // Where known: seconds since any instant, and the distance to the truth, one a position. Then
  // the view from above is coloured by the error and a diagram shows it over time.
  std::vector<double> times_s;
  std::vector<double> errors;
};

struct MapPlot {
  std::string title;
  // Second line: figures.
  std::string subtitle;
  std::string length_unit = "m";
  std::vector<PlotTrajectory> trajectories;
  std::vector<std::vector<Eigen::Vector3d>> references;  // true paths, drawn grey
  std::vector<Eigen::Vector3d> landmarks;
  // The axis that points up or down; without it the one along which the paths extend least.
  std::optional<int> up_axis;
  int width_px = 1600, height_px = 900;
};

cv::Mat3b DrawMapPlot(const MapPlot& plot);

// Draws and writes a PNG. InvalidArgument for sizes under 640 x 360 or over 8192 or lists of
// unequal length; Unavailable if the file cannot be written.
Status WriteMapPlot(const MapPlot& plot, const std::string& path);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_EVALUATION_MAP_PLOT_H_
