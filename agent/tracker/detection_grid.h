// Spreads new corners over the image: the best one in each empty cell of a grid.
#ifndef PORTOLAN_AGENT_TRACKER_DETECTION_GRID_H_
#define PORTOLAN_AGENT_TRACKER_DETECTION_GRID_H_

#include <Eigen/Core>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <span>
#include <vector>

#include "agent/tracker/corner_detector.h"

namespace portolan {

struct DetectionGridOptions {
  int width_px = 0;
  int height_px = 0;
  // About this many corners are wanted in the whole image. There are twice as many cells, as many
  // of them show nothing; a corner whose neighbourhood of that size is still empty goes first.
  int target_corners = 200;
  // Least distance between corners, as a share of the side of such a neighbourhood.
  double min_distance_share = 0.3;
  // No corner nearer to the edge.
  double border_px = 10.0;
  // A cell in which nothing was found is left alone for this many calls: the picture changes
  // slowly, and blank walls would cost as much as rich texture.
  int barren_pause = 4;
};

// Thread-compatible.
class DetectionGrid {
 public:
  DetectionGrid(const DetectionGridOptions& options, std::unique_ptr<CornerDetector> detector);

  // At most max_count new corners, those in empty neighbourhoods first, the stronger first among
  // equals, none near the `taken` pixels. gray: CV_8UC1 of
  // the options' size.
  std::vector<Corner> FindCorners(const cv::Mat& gray, std::span<const Eigen::Vector2d> taken,
                                  int max_count);

 private:
  int CellOf(const Eigen::Vector2d& pixel) const;
  cv::Rect CellArea(int cell) const;
  bool IsFree(const Eigen::Vector2d& pixel) const;
  std::vector<Corner> SpreadFirst(std::span<const Eigen::Vector2d> taken,
                                  std::vector<Corner> corners) const;
  void Occupy(const Eigen::Vector2d& pixel) { occupants_[CellOf(pixel)].push_back(pixel); }

  const DetectionGridOptions options_;
  const std::unique_ptr<CornerDetector> detector_;
  double neighbourhood_px_ = 0;
  double cell_px_ = 0;
  int columns_ = 0, rows_ = 0;
  int calls_ = 0;
  std::vector<int> barren_until_;                        // call number, per cell
  std::vector<std::vector<Eigen::Vector2d>> occupants_;  // per cell
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_DETECTION_GRID_H_
