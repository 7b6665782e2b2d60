#include "agent/range/scale_finder.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace portolan {

Status ScaleFinderOptions::Validate() const {
  if (min_ranges < 3) return absl::InvalidArgumentError("range.min_ranges must be >= 3");
  if (!(min_agreeing_share > 0.5 && min_agreeing_share <= 1)) {
    return absl::InvalidArgumentError("range.min_agreeing_share must be above 0.5, at most 1");
  }
  if (!(max_sigmas > 0 && window_s > 0)) {
    return absl::InvalidArgumentError("range: max_sigmas and window_s must be > 0");
  }
  if (!(max_log_scale_sigma > 0 && max_log_scale_sigma < 1)) {
    return absl::InvalidArgumentError("range.max_log_scale_sigma must be within 0 and 1");
  }
  return absl::OkStatus();
}

void ScaleFinder::Add(const Ratio& ratio) {
  ratios_.push_back(ratio);
  while (ToSeconds(ratio.time - ratios_.front().time) > options_.window_s) ratios_.pop_front();
}

std::optional<ScaleFinder::Scale> ScaleFinder::Find() const {
  if (static_cast<int>(ratios_.size()) < options_.min_ranges) return std::nullopt;
  std::vector<double> logs;
  for (const Ratio& ratio : ratios_) logs.push_back(ratio.log_scale);
  const auto middle = logs.begin() + static_cast<std::ptrdiff_t>(logs.size() / 2);
  std::nth_element(logs.begin(), middle, logs.end());
  double weights = 0, sum = 0, own = 0, shared = 0;
  int agreeing = 0;
  for (const Ratio& ratio : ratios_) {
    const double variance = ratio.own_variance + ratio.shared_variance;
    if (std::abs(ratio.log_scale - *middle) > options_.max_sigmas * std::sqrt(variance)) continue;
    const double weight = 1 / variance;
    weights += weight;
    sum += weight * ratio.log_scale;
    own += weight * weight * ratio.own_variance;
    shared += weight * std::sqrt(ratio.shared_variance);
    ++agreeing;
  }
  if (agreeing < options_.min_ranges ||
      agreeing < options_.min_agreeing_share * static_cast<double>(ratios_.size())) {
    return std::nullopt;
  }
  // The map's errors are taken to be the same in all.
  const Scale scale{sum / weights, std::sqrt(own + shared * shared) / weights};
  if (!(scale.sigma <= options_.max_log_scale_sigma)) return std::nullopt;
  return scale;
}

}  // namespace portolan
