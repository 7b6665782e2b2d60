// Pixels that are searched four at once.
#ifndef PORTOLAN_AGENT_TRACKER_PIXEL_LIST_H_
#define PORTOLAN_AGENT_TRACKER_PIXEL_LIST_H_

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "common/base/vector_clones.h"

namespace portolan {

class PixelList {
 public:
  void clear() { count_ = 0; }
  void Add(const Eigen::Vector2d& pixel) {
    if (count_ % 4 == 0) {
      if (count_ / 4 == fours_.size()) fours_.emplace_back();
      // Those that fill up the last four are far from everything.
      fours_[count_ / 4].x = Double4{} + std::numeric_limits<double>::infinity();
    }
    fours_[count_ / 4].x[count_ % 4] = pixel.x();
    fours_[count_ / 4].y[count_ % 4] = pixel.y();
    ++count_;
  }
  bool HasNear(const Eigen::Vector2d& pixel, double distance2) const {
    const double x = pixel.x(), y = pixel.y();
    Long4 near = {};
    for (size_t i = 0; 4 * i < count_; ++i) {
      const Double4 dx = fours_[i].x - x, dy = fours_[i].y - y;
      near |= dx * dx + dy * dy < distance2;
    }
    return (near[0] | near[1] | near[2] | near[3]) != 0;
  }

 private:
  struct Four {
    Double4 x = {}, y = {};
  };
  std::vector<Four> fours_;
  size_t count_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_PIXEL_LIST_H_
