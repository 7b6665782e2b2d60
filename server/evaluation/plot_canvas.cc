#include "server/evaluation/plot_canvas.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "absl/strings/str_format.h"

namespace portolan {
namespace {

constexpr int kOversampling = 2;
constexpr int kFractionBits = 4;
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kFontCapHeight_px = 21;  // of the font at scale 1
const PlotColour kInk(70, 60, 50);
const PlotColour kGrid(238, 234, 230);
const PlotColour kPaper(255, 255, 255);

cv::Point Fixed(const Eigen::Vector2d& point) {
  const double factor = kOversampling * (1 << kFractionBits);
  return {static_cast<int>(std::lround(point.x() * factor)),
          static_cast<int>(std::lround(point.y() * factor))};
}

double FontScale(double height_px) { return kOversampling * height_px / kFontCapHeight_px; }

int FontThickness(double height_px) {
  return std::max(1, static_cast<int>(std::lround(kOversampling * height_px / 11.0)));
}

PlotRange WidenTo(const PlotRange& range, double size) {
  const double middle = 0.5 * (range.low + range.high);
  return {middle - 0.5 * size, middle + 0.5 * size};
}

}  // namespace

PlotColour AgentColour(size_t index) {
  static const std::array<PlotColour, 8> kColours = {
      PlotColour(180, 105, 20), PlotColour(30, 120, 240), PlotColour(70, 150, 40),
      PlotColour(160, 60, 150), PlotColour(60, 50, 210),  PlotColour(150, 150, 20),
      PlotColour(60, 90, 130),  PlotColour(180, 110, 220)};
  return kColours[index % kColours.size()];
}

PlotColour ErrorColour(double share) {
  // Knots of a map of even lightness steps, dark blue to yellow.
  static const std::array<cv::Vec3d, 5> kKnots = {cv::Vec3d(120, 30, 60), cv::Vec3d(150, 90, 40),
                                                  cv::Vec3d(140, 150, 30), cv::Vec3d(80, 190, 110),
                                                  cv::Vec3d(30, 200, 245)};
  const double position = std::clamp(share, 0.0, 1.0) * (kKnots.size() - 1);
  const size_t low = std::min(static_cast<size_t>(position), kKnots.size() - 2);
  const double within = position - static_cast<double>(low);
  const cv::Vec3d colour = (1 - within) * kKnots[low] + within * kKnots[low + 1];
  return {colour[0], colour[1], colour[2]};
}

PlotRange EmptyRange() {
  return {std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
}

void PlotRange::Include(double value) {
  low = std::min(low, value);
  high = std::max(high, value);
}

PlotRange PlotRange::Padded(double share) const {
  if (!(low <= high)) return {0, 1};
  const double least = 1e-6 * std::max({1.0, std::abs(low), std::abs(high)});
  if (size() < least) return {low - 0.5, high + 0.5};
  return {low - share * size(), high + share * size()};
}

std::vector<double> RoundTicks(const PlotRange& range, int count) {
  const double rough = range.size() / std::max(1, count);
  if (!(rough > 0) || !std::isfinite(rough)) return {};
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  double step = 10 * power;
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= rough * (1 - 1e-9)) {
      step = factor * power;
      break;
    }
  }
  std::vector<double> ticks;
  for (double i = std::ceil(range.low / step - 1e-9); i * step <= range.high + 1e-9 * step; ++i) {
    ticks.push_back(i * step + 0.0);  // no negative zero
  }
  return ticks;
}

std::string FormatTick(double value, double step) {
  const int decimals = std::clamp(static_cast<int>(-std::floor(std::log10(step) + 1e-9)), 0, 9);
  return absl::StrFormat("%.*f", decimals, value);
}

PlotCanvas::PlotCanvas(int width_px, int height_px)
    : image_(height_px * kOversampling, width_px * kOversampling, cv::Vec3b(255, 255, 255)) {}

void PlotCanvas::Line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const PlotColour& colour,
                      double width_px) {
  const int thickness = std::max(1, static_cast<int>(std::lround(width_px * kOversampling)));
  cv::line(image_, Fixed(a), Fixed(b), colour, thickness, cv::LINE_AA, kFractionBits);
}

void PlotCanvas::Disc(const Eigen::Vector2d& centre, double radius_px, const PlotColour& colour) {
  const double radius = radius_px * kOversampling * (1 << kFractionBits);
  cv::circle(image_, Fixed(centre), static_cast<int>(radius), colour, cv::FILLED, cv::LINE_AA,
             kFractionBits);
}

void PlotCanvas::Ring(const Eigen::Vector2d& centre, double radius_px, const PlotColour& colour,
                      double width_px) {
  const double radius = radius_px * kOversampling * (1 << kFractionBits);
  cv::circle(image_, Fixed(centre), static_cast<int>(radius), colour,
             static_cast<int>(std::lround(width_px * kOversampling)), cv::LINE_AA, kFractionBits);
}

void PlotCanvas::FillRectangle(const cv::Rect& rectangle, const PlotColour& colour) {
  cv::rectangle(image_, cv::Rect(rectangle.tl() * kOversampling, rectangle.size() * kOversampling),
                colour, cv::FILLED);
}

void PlotCanvas::Frame(const cv::Rect& rectangle, const PlotColour& colour) {
  cv::rectangle(image_, cv::Rect(rectangle.tl() * kOversampling, rectangle.size() * kOversampling),
                colour, kOversampling);
}

double PlotCanvas::TextWidth(const std::string& text, double height_px) const {
  int baseline = 0;
  const cv::Size size =
      cv::getTextSize(text, kFont, FontScale(height_px), FontThickness(height_px), &baseline);
  return static_cast<double>(size.width) / kOversampling;
}

void PlotCanvas::Text(const std::string& text, const Eigen::Vector2d& place, double height_px,
                      const PlotColour& colour, double anchor_x, double anchor_y) {
  const double x = place.x() - anchor_x * TextWidth(text, height_px);
  const double y = place.y() + anchor_y * height_px;
  cv::putText(image_, text,
              cv::Point(static_cast<int>(std::lround(x * kOversampling)),
                        static_cast<int>(std::lround(y * kOversampling))),
              kFont, FontScale(height_px), colour, FontThickness(height_px), cv::LINE_AA);
}

void PlotCanvas::VerticalText(const std::string& text, const Eigen::Vector2d& centre,
                              double height_px, const PlotColour& colour) {
  const int length = static_cast<int>(TextWidth(text, height_px)) + 4;
  PlotCanvas flat(length, static_cast<int>(2 * height_px));
  flat.Text(text, {0.5 * length, height_px}, height_px, colour, 0.5, 0.5);
  cv::Mat3b turned;
  cv::rotate(flat.image_, turned, cv::ROTATE_90_COUNTERCLOCKWISE);
  const cv::Rect target(cv::Point(static_cast<int>(centre.x() * kOversampling) - turned.cols / 2,
                                  static_cast<int>(centre.y() * kOversampling) - turned.rows / 2),
                        turned.size());
  const cv::Rect visible = target & cv::Rect(cv::Point(0, 0), image_.size());
  if (visible.empty()) return;
  turned(visible - target.tl()).copyTo(image_(visible));
}

cv::Mat3b PlotCanvas::Finish() const {
  cv::Mat3b finished;
  cv::resize(image_, finished, image_.size() / kOversampling, 0, 0, cv::INTER_AREA);
  return finished;
}

PlotPanel::PlotPanel(const PanelOptions& options, PlotCanvas* canvas)
    : canvas_(*canvas), x_(options.x), y_(options.y) {
  frame_ = cv::Rect(options.place.x + 68, options.place.y + 34, options.place.width - 84,
                    options.place.height - 84);
  if (options.equal_scale) {
    const double unit_per_px = std::max(x_.size() / frame_.width, y_.size() / frame_.height);
    x_ = WidenTo(x_, unit_per_px * frame_.width);
    y_ = WidenTo(y_, unit_per_px * frame_.height);
  }
  DrawAxes(options);
}

Eigen::Vector2d PlotPanel::ToPixel(double x, double y) const {
  return {frame_.x + (x - x_.low) / x_.size() * frame_.width,
          frame_.y + (y_.high - y) / y_.size() * frame_.height};
}

void PlotPanel::DrawAxes(const PanelOptions& options) {
  const double left = frame_.x, right = frame_.br().x, top = frame_.y, bottom = frame_.br().y;
  const std::vector<double> x_ticks = RoundTicks(x_, std::max(2, frame_.width / 90));
  const std::vector<double> y_ticks = RoundTicks(y_, std::max(2, frame_.height / 60));
  const auto step = [](const std::vector<double>& t) { return t.size() > 1 ? t[1] - t[0] : 1.0; };
  for (const double tick : x_ticks) {
    const double x = ToPixel(tick, y_.low).x();
    canvas_.Line({x, top}, {x, bottom}, kGrid, 1);
    canvas_.Text(FormatTick(tick, step(x_ticks)), {x, bottom + 8}, 10, kInk, 0.5, 1);
  }
  for (const double tick : y_ticks) {
    const double y = ToPixel(x_.low, tick).y();
    canvas_.Line({left, y}, {right, y}, kGrid, 1);
    canvas_.Text(FormatTick(tick, step(y_ticks)), {left - 7, y}, 10, kInk, 1, 0.5);
  }
  canvas_.Frame(frame_, PlotColour(190, 185, 180));
  canvas_.Text(options.title, {left, top - 12}, 13, kInk);
  canvas_.Text(options.x_label, {0.5 * (left + right), bottom + 28}, 11, kInk, 0.5, 1);
  canvas_.VerticalText(options.y_label, {options.place.x + 7.0, 0.5 * (top + bottom)}, 11, kInk);
}

bool PlotPanel::IsInside(const Eigen::Vector2d& pixel) const {
  return pixel.x() >= frame_.x && pixel.x() <= frame_.br().x && pixel.y() >= frame_.y &&
         pixel.y() <= frame_.br().y;
}

void PlotPanel::DrawSegment(const Eigen::Vector2d& a, const Eigen::Vector2d& b,
                            const PlotColour& colour, double width_px) {
  const Eigen::Vector2d from = ToPixel(a.x(), a.y()), to = ToPixel(b.x(), b.y());
  if (IsInside(from) && IsInside(to)) canvas_.Line(from, to, colour, width_px);
}

void PlotPanel::DrawLine(const std::vector<Eigen::Vector2d>& points, const PlotColour& colour,
                         double width_px) {
  for (size_t i = 0; i + 1 < points.size(); ++i) {
    DrawSegment(points[i], points[i + 1], colour, width_px);
  }
}

void PlotPanel::DrawLine(const std::vector<Eigen::Vector2d>& points,
                         const std::vector<PlotColour>& colours, double width_px) {
  for (size_t i = 0; i + 1 < points.size() && i < colours.size(); ++i) {
    DrawSegment(points[i], points[i + 1], colours[i], width_px);
  }
}

void PlotPanel::DrawPoints(const std::vector<Eigen::Vector2d>& points, const PlotColour& colour,
                           double radius_px) {
  for (const Eigen::Vector2d& point : points) {
    const Eigen::Vector2d pixel = ToPixel(point.x(), point.y());
    if (IsInside(pixel)) canvas_.Disc(pixel, radius_px, colour);
  }
}

void PlotPanel::DrawMarker(const Eigen::Vector2d& point, const PlotColour& colour) {
  const Eigen::Vector2d pixel = ToPixel(point.x(), point.y());
  if (!IsInside(pixel)) return;
  canvas_.Disc(pixel, 6, kPaper);
  canvas_.Ring(pixel, 5, colour, 2.5);
}

}  // namespace portolan
