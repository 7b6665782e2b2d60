#include "server/evaluation/map_plot.h"

#include <algorithm>
#include <array>
#include <opencv2/imgcodecs.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/evaluation/plot_canvas.h"

namespace portolan {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kHeader_px = 58;
constexpr int kLegendLine_px = 20;
const PlotColour kInk(70, 60, 50);
const PlotColour kReference(165, 160, 155);
const PlotColour kLandmark(205, 190, 170);
constexpr const char* kAxisNames[] = {"x", "y", "z"};

// Which coordinates are drawn to the right and upwards.
struct ViewAxes {
  int right, up;
};

struct Views {
  ViewAxes above, side;
};

std::array<PlotRange, 3> PathRanges(const MapPlot& plot) {
  std::array<PlotRange, 3> ranges = {EmptyRange(), EmptyRange(), EmptyRange()};
  const auto include = [&](const std::vector<Vector3d>& path) {
    for (const Vector3d& p : path) {
      for (int i = 0; i < 3; ++i) ranges[i].Include(p[i]);
    }
  };
  for (const PlotTrajectory& trajectory : plot.trajectories) include(trajectory.positions);
  for (const auto& reference : plot.references) include(reference);
  return ranges;
}

// The paths' ranges and the middle 96 % of the landmarks: a few far ones must not shrink the rest.
std::array<PlotRange, 3> DrawnRanges(const MapPlot& plot) {
  std::array<PlotRange, 3> ranges = PathRanges(plot);
  for (int i = 0; i < 3 && !plot.landmarks.empty(); ++i) {
    std::vector<double> values;
    for (const Vector3d& landmark : plot.landmarks) values.push_back(landmark[i]);
    std::sort(values.begin(), values.end());
    const size_t skipped = values.size() / 50;
    ranges[i].Include(values[skipped]);
    ranges[i].Include(values[values.size() - 1 - skipped]);
  }
  for (PlotRange& range : ranges) range = range.Padded(0.05);
  return ranges;
}

Views ChooseViews(const MapPlot& plot) {
  int vertical = 2;
  if (plot.up_axis) {
    vertical = std::clamp(*plot.up_axis, 0, 2);
  } else {
    const std::array<PlotRange, 3> ranges = PathRanges(plot);
    for (const int i : {1, 0}) {
      // Clearly flatter than z, else z: most worlds have z up.
      if (ranges[i].size() < 0.8 * ranges[vertical].size()) vertical = i;
    }
  }
  const int right = vertical == 0 ? 1 : 0;
  const int other = 3 - vertical - right;
  return {{right, other}, {right, vertical}};
}

std::vector<Vector2d> Projected(const std::vector<Vector3d>& points, const ViewAxes& axes) {
  std::vector<Vector2d> projected;
  projected.reserve(points.size());
  for (const Vector3d& p : points) projected.emplace_back(p[axes.right], p[axes.up]);
  return projected;
}

std::string AxisLabel(const MapPlot& plot, int axis) {
  return absl::StrCat(kAxisNames[axis], " [", plot.length_unit, "]");
}

double LargestError(const MapPlot& plot) {
  double largest = 0;
  for (const PlotTrajectory& trajectory : plot.trajectories) {
    for (const double error : trajectory.errors) largest = std::max(largest, error);
  }
  return largest;
}

std::vector<PlotColour> ErrorColours(const PlotTrajectory& trajectory, double largest) {
  std::vector<PlotColour> colours;
  for (const double error : trajectory.errors) colours.push_back(ErrorColour(error / largest));
  return colours;
}

PlotPanel DrawView(const MapPlot& plot, const std::string& title, const cv::Rect& place,
                   const ViewAxes& axes, bool colour_errors, PlotCanvas* canvas) {
  const std::array<PlotRange, 3> ranges = DrawnRanges(plot);
  PlotPanel panel({place, title, AxisLabel(plot, axes.right), AxisLabel(plot, axes.up),
                   ranges[axes.right], ranges[axes.up], /*equal_scale=*/true},
                  canvas);
  panel.DrawPoints(Projected(plot.landmarks, axes), kLandmark, 1.0);
  for (const auto& reference : plot.references) {
    panel.DrawLine(Projected(reference, axes), kReference, 2.0);
  }
  const double largest = LargestError(plot);
  for (size_t i = 0; i < plot.trajectories.size(); ++i) {
    const PlotTrajectory& trajectory = plot.trajectories[i];
    const std::vector<Vector2d> points = Projected(trajectory.positions, axes);
    if (colour_errors && largest > 0 && !trajectory.errors.empty()) {
      panel.DrawLine(points, ErrorColours(trajectory, largest), 2.5);
    } else {
      panel.DrawLine(points, AgentColour(i), 2.0);
    }
  }
  for (size_t i = 0; i < plot.trajectories.size(); ++i) {
    const PlotTrajectory& trajectory = plot.trajectories[i];
    if (trajectory.positions.empty()) continue;
    panel.DrawMarker(Projected({trajectory.positions.front()}, axes)[0], AgentColour(i));
  }
  return panel;
}

// A column of colours beside a panel's frame, with the largest error on top.
void DrawColourBar(const MapPlot& plot, const PlotPanel& panel, PlotCanvas* canvas) {
  const double largest = LargestError(plot);
  if (!(largest > 0)) return;
  const int height = 150, width = 12;
  const cv::Rect bar(panel.frame().br().x - 70, panel.frame().y + 34, width, height);
  canvas->FillRectangle({bar.x - 10, bar.y - 26, 74, height + 38}, {255, 255, 255});
  for (int i = 0; i < height; ++i) {
    canvas->FillRectangle({bar.x, bar.y + i, width, 1}, ErrorColour(1.0 - (i + 0.5) / height));
  }
  canvas->Text(absl::StrCat("error [", plot.length_unit, "]"), {bar.x - 8.0, bar.y - 10.0}, 9,
               kInk);
  const std::vector<double> ticks = RoundTicks({0, largest}, 4);
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : 1.0;
  for (const double tick : ticks) {
    const double y = bar.y + height * (1.0 - tick / largest);
    canvas->Text(FormatTick(tick, step), {bar.x + width + 6.0, y}, 9, kInk, 0, 0.5);
  }
}

void DrawErrorsOverTime(const MapPlot& plot, const cv::Rect& place, PlotCanvas* canvas) {
  PlotRange time = EmptyRange(), error = {0, 0};
  for (const PlotTrajectory& trajectory : plot.trajectories) {
    for (const double t : trajectory.times_s) time.Include(t);
    for (const double e : trajectory.errors) error.Include(e);
  }
  error = {0, error.high > 0 ? 1.08 * error.high : 1.0};
  PlotPanel panel({place, "Distance to the truth", "time [s]",
                   absl::StrCat("error [", plot.length_unit, "]"), time.Padded(0.02), error, false},
                  canvas);
  for (size_t i = 0; i < plot.trajectories.size(); ++i) {
    const PlotTrajectory& trajectory = plot.trajectories[i];
    std::vector<Vector2d> points;
    for (size_t k = 0; k < trajectory.errors.size(); ++k) {
      points.emplace_back(trajectory.times_s[k], trajectory.errors[k]);
    }
    panel.DrawLine(points, AgentColour(i), 1.5);
  }
}

void DrawLegend(const MapPlot& plot, const Vector2d& corner, PlotCanvas* canvas) {
  Vector2d place = corner;
  const auto entry = [&](const std::string& name, const PlotColour& colour, bool is_points) {
    if (is_points) {
      for (const double x : {4.0, 12.0, 20.0}) canvas->Disc(place + Vector2d(x, 0), 2, colour);
    } else {
      canvas->Line(place, place + Vector2d(24, 0), colour, 3);
    }
    canvas->Text(name, place + Vector2d(32, 0), 11, kInk, 0, 0.5);
    place.y() += kLegendLine_px;
  };
  for (size_t i = 0; i < plot.trajectories.size(); ++i) {
    entry(plot.trajectories[i].name, AgentColour(i), false);
  }
  if (!plot.references.empty()) entry("ground truth", kReference, false);
  if (!plot.landmarks.empty()) {
    entry(absl::StrCat("landmarks (", plot.landmarks.size(), ")"), kLandmark, true);
  }
  if (!plot.trajectories.empty()) {
    canvas->Ring(place + Vector2d(12, 0), 5, kInk, 2.5);
    canvas->Text("start", place + Vector2d(32, 0), 11, kInk, 0, 0.5);
  }
}

size_t LegendLines(const MapPlot& plot) {
  return plot.trajectories.size() + (plot.trajectories.empty() ? 0 : 1) +
         (plot.references.empty() ? 0 : 1) + (plot.landmarks.empty() ? 0 : 1);
}

Status CheckPlot(const MapPlot& plot) {
  if (plot.width_px < 640 || plot.height_px < 360 || plot.width_px > 8192 ||
      plot.height_px > 8192) {
    return absl::InvalidArgumentError("a plot must be 640x360 to 8192x8192 pixels");
  }
  for (const PlotTrajectory& trajectory : plot.trajectories) {
    const bool has_errors = !trajectory.errors.empty() || !trajectory.times_s.empty();
    if (has_errors && (trajectory.errors.size() != trajectory.positions.size() ||
                       trajectory.times_s.size() != trajectory.positions.size())) {
      return absl::InvalidArgumentError(absl::StrCat(
          "plot of ", trajectory.name, ": positions, times and errors differ in number"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

cv::Mat3b DrawMapPlot(const MapPlot& plot) {
  PlotCanvas canvas(plot.width_px, plot.height_px);
  canvas.Text(plot.title, {24, 30}, 17, kInk);
  canvas.Text(plot.subtitle, {24, 52}, 11, kInk);
  const Views views = ChooseViews(plot);
  const int left = plot.width_px * 6 / 10, body = plot.height_px - kHeader_px - 8;
  const bool has_errors = LargestError(plot) > 0;
  const PlotPanel above = DrawView(plot, "From above", {8, kHeader_px, left - 8, body}, views.above,
                                   /*colour_errors=*/true, &canvas);
  if (has_errors) DrawColourBar(plot, above, &canvas);
  const int legend = static_cast<int>(LegendLines(plot)) * kLegendLine_px + 24;
  const int column = plot.width_px - left - 8;
  const int panels = body - legend;
  const int side_height = has_errors ? panels / 2 : panels;
  DrawView(plot, "From the side", {left, kHeader_px, column, side_height}, views.side,
           /*colour_errors=*/false, &canvas);
  if (has_errors) {
    DrawErrorsOverTime(plot, {left, kHeader_px + side_height, column, panels - side_height},
                       &canvas);
  }
  DrawLegend(plot, {left + 68.0, kHeader_px + panels + 16.0}, &canvas);
  return canvas.Finish();
}

Status WriteMapPlot(const MapPlot& plot, const std::string& path) {
  PORTOLAN_RETURN_IF_ERROR(CheckPlot(plot));
  try {
    if (cv::imwrite(path, DrawMapPlot(plot))) return absl::OkStatus();
  } catch (const cv::Exception& exception) {
    return absl::UnavailableError(absl::StrCat(path, ": ", exception.what()));
  }
  return absl::UnavailableError(absl::StrCat(path, ": cannot be written"));
}

}  // namespace portolan
