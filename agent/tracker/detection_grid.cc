#include "agent/tracker/detection_grid.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

namespace portolan {

DetectionGrid::DetectionGrid(const DetectionGridOptions& options,
                             std::unique_ptr<CornerDetector> detector)
    : options_(options), detector_(std::move(detector)) {
  const double area = static_cast<double>(options.width_px) * options.height_px;
  neighbourhood_px_ = std::max(12.0, std::sqrt(area / std::max(1, options.target_corners)));
  cell_px_ = neighbourhood_px_ / std::sqrt(2.0);
  columns_ = std::max(1, static_cast<int>(std::ceil(options.width_px / cell_px_)));
  rows_ = std::max(1, static_cast<int>(std::ceil(options.height_px / cell_px_)));
  barren_until_.resize(columns_ * rows_, 0);
  occupants_.resize(columns_ * rows_);
}

int DetectionGrid::CellOf(const Eigen::Vector2d& pixel) const {
  const int x = std::clamp(static_cast<int>((pixel.x() + 0.5) / cell_px_), 0, columns_ - 1);
  const int y = std::clamp(static_cast<int>((pixel.y() + 0.5) / cell_px_), 0, rows_ - 1);
  return y * columns_ + x;
}

cv::Rect DetectionGrid::CellArea(int cell) const {
  const auto edge = [this](int index, int size) {
    return std::min(size, static_cast<int>(std::lround(index * cell_px_)));
  };
  const int column = cell % columns_, row = cell / columns_;
  return cv::Rect(
      cv::Point(edge(column, options_.width_px), edge(row, options_.height_px)),
      cv::Point(edge(column + 1, options_.width_px), edge(row + 1, options_.height_px)));
}

bool DetectionGrid::IsFree(const Eigen::Vector2d& pixel) const {
  const double min_distance = options_.min_distance_share * neighbourhood_px_;
  const int cell = CellOf(pixel), column = cell % columns_, row = cell / columns_;
  for (int y = std::max(0, row - 1); y <= std::min(rows_ - 1, row + 1); ++y) {
    for (int x = std::max(0, column - 1); x <= std::min(columns_ - 1, column + 1); ++x) {
      for (const Eigen::Vector2d& occupant : occupants_[y * columns_ + x]) {
        if ((occupant - pixel).squaredNorm() < min_distance * min_distance) return false;
      }
    }
  }
  return true;
}

std::vector<Corner> DetectionGrid::SpreadFirst(std::span<const Eigen::Vector2d> taken,
                                               std::vector<Corner> corners) const {
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Corner& a, const Corner& b) { return a.response > b.response; });
  std::set<std::pair<int, int>> filled;
  const auto fill = [&](const Eigen::Vector2d& pixel) {
    return filled
        .insert({static_cast<int>((pixel.x() + 0.5) / neighbourhood_px_),
                 static_cast<int>((pixel.y() + 0.5) / neighbourhood_px_)})
        .second;
  };
  for (const Eigen::Vector2d& pixel : taken) fill(pixel);
  std::stable_partition(corners.begin(), corners.end(),
                        [&](const Corner& corner) { return fill(corner.pixel); });
  return corners;
}

std::vector<Corner> DetectionGrid::FindCorners(const cv::Mat& gray,
                                               std::span<const Eigen::Vector2d> taken,
                                               int max_count) {
  if (max_count <= 0) return {};
  ++calls_;
  for (auto& cell : occupants_) cell.clear();
  for (const Eigen::Vector2d& pixel : taken) Occupy(pixel);
  const double b = options_.border_px;
  std::vector<Corner> chosen;
  for (int cell = 0; cell < columns_ * rows_; ++cell) {
    // A start looks everywhere.
    const bool is_barren = !taken.empty() && barren_until_[cell] >= calls_;
    if (!occupants_[cell].empty() || is_barren) continue;
    const auto corners = detector_->Detect(gray, CellArea(cell));
    const auto best = std::find_if(corners.begin(), corners.end(), [&](const Corner& corner) {
      return corner.pixel.x() >= b && corner.pixel.y() >= b &&
             corner.pixel.x() <= options_.width_px - 1 - b &&
             corner.pixel.y() <= options_.height_px - 1 - b && IsFree(corner.pixel);
    });
    if (best == corners.end()) {
      barren_until_[cell] = calls_ + options_.barren_pause;
    } else {
      chosen.push_back(*best);
      Occupy(best->pixel);
    }
  }
  chosen = SpreadFirst(taken, std::move(chosen));
  if (static_cast<int>(chosen.size()) > max_count) chosen.resize(max_count);
  return chosen;
}

}  // namespace portolan
