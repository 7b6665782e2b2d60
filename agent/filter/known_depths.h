// The mean depth of a filter's well-known landmarks: the unit that new landmarks are measured in.
#ifndef PORTOLAN_AGENT_FILTER_KNOWN_DEPTHS_H_
#define PORTOLAN_AGENT_FILTER_KNOWN_DEPTHS_H_

#include <Eigen/Core>

#include "agent/filter/filter_state.h"

namespace portolan {

struct MeanDepth {
  // Mean of the natural logarithms of the inverse distances from the camera.
  double log_inverse_depth = 0;
  // Its derivative by the state's error, but for what a common change of scale leaves alone (the
  // camera's way since the anchors were set): exactly 1 for a growth of all inverse lengths.
  Eigen::RowVectorXd d_log_d_state;
  // Landmarks that were averaged; without one the rest is zero.
  int count = 0;
};

// Over the landmarks whose inverse depth has a relative sigma of at most the limit.
MeanDepth MeanOfKnownDepths(const FilterState& state, double max_sigma_ratio);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_KNOWN_DEPTHS_H_
