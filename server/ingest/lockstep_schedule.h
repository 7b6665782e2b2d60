// The order in which a lockstep server takes submaps: by sequence number, then by the agents'
// order in the declared list, whatever the timing of the network.
#ifndef PORTOLAN_SERVER_INGEST_LOCKSTEP_SCHEDULE_H_
#define PORTOLAN_SERVER_INGEST_LOCKSTEP_SCHEDULE_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "common/base/strong_id.h"

namespace portolan {

// Every declared agent has the sequence number that it will send next. It is the turn of the
// unfinished agent with the lowest number, the first of them in the list. An agent that lost a
// submap takes its turn with the next one it has. Thread-compatible.
class LockstepSchedule {
 public:
  // No agents: not in lockstep.
  explicit LockstepSchedule(std::vector<AgentId> agents);

  bool enabled() const { return !agents_.empty(); }
  bool IsDeclared(const AgentId& agent) const;
  // A session of the agent begins or goes on at this number.
  void Resume(const AgentId& agent, uint32_t next_sequence_number);
  void Finish(const AgentId& agent);
  // The agent whose submap must be taken now; none when all have finished.
  std::optional<AgentId> Turn() const;
  bool AllFinished() const { return !Turn().has_value(); }

 private:
  struct Entry {
    AgentId agent;
    uint32_t next_sequence_number = 0;
    bool finished = false;
  };

  Entry* Find(const AgentId& agent);

  std::vector<Entry> agents_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_INGEST_LOCKSTEP_SCHEDULE_H_
