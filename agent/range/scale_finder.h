// The metres of a unit of length, from ranges that were measured in both.
#ifndef PORTOLAN_AGENT_RANGE_SCALE_FINDER_H_
#define PORTOLAN_AGENT_RANGE_SCALE_FINDER_H_

#include <deque>
#include <optional>

#include "common/base/status.h"
#include "common/base/time.h"

namespace portolan {

struct ScaleFinderOptions {
  // Ratios that have to agree, and the share of those of the window that have to.
  int min_ranges = 5;
  double min_agreeing_share = 0.7;
  // Those farther from the median than this many of their sigmas disagree.
  double max_sigmas = 3.0;
  // Relative error of the scale that is good enough to go on with.
  double max_log_scale_sigma = 0.03;
  // Older ones are forgotten [s]: the scale of a map without metres drifts.
  double window_s = 10.0;

  Status Validate() const;
};

// Thread-compatible.
class ScaleFinder {
 public:
  explicit ScaleFinder(const ScaleFinderOptions& options) : options_(options) {}

  // Logarithm of metres over units, and the variance of what is its own and of what it may share
  // with all others (errors of the map).
  struct Ratio {
    Timestamp time{};
    double log_scale = 0;
    double own_variance = 0;
    double shared_variance = 0;
  };
  void Add(const Ratio& ratio);
  void Reset() { ratios_.clear(); }

  // No value while the ratios are too few, disagree, or do not tell the scale well enough.
  struct Scale {
    double log_scale = 0;
    double sigma = 0;
  };
  std::optional<Scale> Find() const;

 private:
  const ScaleFinderOptions options_;
  std::deque<Ratio> ratios_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_RANGE_SCALE_FINDER_H_
