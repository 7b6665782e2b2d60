// How the agent uses the map that it is told about.
#ifndef PORTOLAN_AGENT_REVISIT_REVISIT_OPTIONS_H_
#define PORTOLAN_AGENT_REVISIT_REVISIT_OPTIONS_H_

#include "agent/revisit/landmark_matcher.h"
#include "agent/revisit/landmark_memory.h"
#include "common/base/status.h"

namespace portolan {

struct RevisitOptions {
  // Whether live poses hold on to landmarks of the map that the agent sees again.
  bool enabled = true;
  // Every n-th keyframe is searched for them.
  int keyframe_interval = 2;
  // What the server may send of other agents' landmarks, bytes a second; 0 for nothing.
  int offered_bytes_per_second = 500;
  LandmarkMemoryOptions memory;
  LandmarkMatcherOptions matcher;

  Status Validate() const {
    if (keyframe_interval < 1 || offered_bytes_per_second < 0) {
      return absl::InvalidArgumentError("revisit: a limit is out of range");
    }
    PORTOLAN_RETURN_IF_ERROR(memory.Validate());
    return matcher.Validate();
  }
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_REVISIT_REVISIT_OPTIONS_H_
