// Options of the map builder: those of its stages.
#ifndef PORTOLAN_SERVER_MAP_BUILDER_OPTIONS_H_
#define PORTOLAN_SERVER_MAP_BUILDER_OPTIONS_H_

#include "common/base/status.h"

namespace portolan {

struct MapBuilderOptions {
  // Threads of the numerical solvers. With one, results repeat to the last bit; with more, the
  // order of Ceres' sums, and so the last digits, depend on the scheduler.
  int num_threads = 1;

  Status Validate() const;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_MAP_BUILDER_OPTIONS_H_
