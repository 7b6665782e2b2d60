// Options of the map builder: those of its stages.
#ifndef PORTOLAN_SERVER_MAP_BUILDER_OPTIONS_H_
#define PORTOLAN_SERVER_MAP_BUILDER_OPTIONS_H_

#include "common/base/status.h"

namespace portolan {

struct MapBuilderOptions {
  // Threads of the numerical solvers. Results depend on it in the last digits only; a fixed
  // number makes them repeatable.
  int num_threads = 2;

  Status Validate() const;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_MAP_BUILDER_OPTIONS_H_
