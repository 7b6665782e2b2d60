#include "agent/tracker/tracker.h"

namespace portolan {

Status TrackerOptions::Validate() const {
  if (max_points < 1 || max_points > 5000) {
    return absl::InvalidArgumentError("max_points must be in [1, 5000]");
  }
  if (!(min_spacing_px >= 12.0)) {
    return absl::InvalidArgumentError("min_spacing_px must be at least 12");
  }
  if (!(min_distance_share >= 0.0 && min_distance_share <= 1.0)) {
    return absl::InvalidArgumentError("min_distance_share must be in [0, 1]");
  }
  if (!(border_px >= 8.0)) return absl::InvalidArgumentError("border_px must be at least 8");
  if (!(gate_px > 0.0)) return absl::InvalidArgumentError("gate_px must be positive");
  if (!(merge_distance_px >= 0.0)) {
    return absl::InvalidArgumentError("merge_distance_px must be >= 0");
  }
  if (!(min_correlation > 0.0 && min_correlation < 1.0)) {
    return absl::InvalidArgumentError("min_correlation must be in (0, 1)");
  }
  if (!(min_reacquire_correlation > 0.0 && min_reacquire_correlation < 1.0)) {
    return absl::InvalidArgumentError("min_reacquire_correlation must be in (0, 1)");
  }
  if (!(search_sigma_px > 0.0 && search_sigma_px <= 100.0)) {
    return absl::InvalidArgumentError("search_sigma_px must be in (0, 100]");
  }
  if (pyramid_levels < 0 || pyramid_levels > 8) {
    return absl::InvalidArgumentError("pyramid_levels must be in [0, 8]");
  }
  if (!(base_sigma_px > 0.0)) return absl::InvalidArgumentError("base_sigma_px must be > 0");
  if (max_lost < 0) return absl::InvalidArgumentError("max_lost must be >= 0");
  PORTOLAN_RETURN_IF_ERROR(detector.Validate());
  return features.Validate();
}

}  // namespace portolan
