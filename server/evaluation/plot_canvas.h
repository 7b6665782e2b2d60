// A picture with panels of data: axes with round ticks, grid, labels, lines, points. Drawn at twice
// the size and reduced, so that lines and writing are smooth.
#ifndef PORTOLAN_SERVER_EVALUATION_PLOT_CANVAS_H_
#define PORTOLAN_SERVER_EVALUATION_PLOT_CANVAS_H_

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace portolan {

using PlotColour = cv::Scalar;  // blue, green, red

// Distinct colours for agents, in turn.
PlotColour AgentColour(size_t index);
// From dark blue (0) over green to yellow (1); values outside are clamped.
PlotColour ErrorColour(double share);

struct PlotRange {
  double low = 0, high = 1;

  void Include(double value);
  // Wider by a share of its size on both sides; never empty.
  PlotRange Padded(double share) const;
  double size() const { return high - low; }
};
// A range that any Include() replaces.
PlotRange EmptyRange();

// Multiples of 1, 2 or 5 times a power of ten within the range, about `count` of them.
std::vector<double> RoundTicks(const PlotRange& range, int count);
// A tick as short as its step allows: 0.25, 3, 1500.
std::string FormatTick(double value, double step);

// Thread-compatible. Sizes and places are pixels of the finished picture.
class PlotCanvas {
 public:
  PlotCanvas(int width_px, int height_px);

  void Line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const PlotColour& colour,
            double width_px);
  void Disc(const Eigen::Vector2d& centre, double radius_px, const PlotColour& colour);
  void Ring(const Eigen::Vector2d& centre, double radius_px, const PlotColour& colour,
            double width_px);
  void FillRectangle(const cv::Rect& rectangle, const PlotColour& colour);
  void Frame(const cv::Rect& rectangle, const PlotColour& colour);
  // Anchors: 0 left or bottom, 0.5 middle, 1 right or top of the text lies at the place.
  void Text(const std::string& text, const Eigen::Vector2d& place, double height_px,
            const PlotColour& colour, double anchor_x = 0, double anchor_y = 0);
  void VerticalText(const std::string& text, const Eigen::Vector2d& centre, double height_px,
                    const PlotColour& colour);
  double TextWidth(const std::string& text, double height_px) const;

  cv::Mat3b Finish() const;

 private:
  cv::Mat3b image_;
};

struct PanelOptions {
  cv::Rect place;  // of the whole panel, title and labels included
  std::string title, x_label, y_label;
  PlotRange x, y;
  bool equal_scale = false;  // widen one range so that x and y have the same scale
};

// One diagram on a canvas, which is borrowed. Data outside of the frame is not drawn.
class PlotPanel {
 public:
  PlotPanel(const PanelOptions& options, PlotCanvas* canvas);

  Eigen::Vector2d ToPixel(double x, double y) const;
  const cv::Rect& frame() const { return frame_; }

  void DrawLine(const std::vector<Eigen::Vector2d>& points, const PlotColour& colour,
                double width_px);
  // Segment i, from point i to i + 1, in colours[i].
  void DrawLine(const std::vector<Eigen::Vector2d>& points, const std::vector<PlotColour>& colours,
                double width_px);
  void DrawPoints(const std::vector<Eigen::Vector2d>& points, const PlotColour& colour,
                  double radius_px);
  void DrawMarker(const Eigen::Vector2d& point, const PlotColour& colour);

 private:
  void DrawAxes(const PanelOptions& options);
  void DrawSegment(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const PlotColour& colour,
                   double width_px);
  bool IsInside(const Eigen::Vector2d& pixel) const;

  PlotCanvas& canvas_;
  cv::Rect frame_;  // of the data
  PlotRange x_, y_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_EVALUATION_PLOT_CANVAS_H_
