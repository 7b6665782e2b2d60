#include "server/ingest/lockstep_schedule.h"

#include <utility>

namespace portolan {

LockstepSchedule::LockstepSchedule(std::vector<AgentId> agents) {
  for (AgentId& agent : agents) agents_.push_back({std::move(agent), 0, false});
}

LockstepSchedule::Entry* LockstepSchedule::Find(const AgentId& agent) {
  for (Entry& entry : agents_) {
    if (entry.agent == agent) return &entry;
  }
  return nullptr;
}

bool LockstepSchedule::IsDeclared(const AgentId& agent) const {
  return const_cast<LockstepSchedule*>(this)->Find(agent) != nullptr;
}

void LockstepSchedule::Resume(const AgentId& agent, uint32_t next_sequence_number) {
  if (Entry* entry = Find(agent)) {
    entry->next_sequence_number = next_sequence_number;
    entry->finished = false;
  }
}

void LockstepSchedule::Finish(const AgentId& agent) {
  if (Entry* entry = Find(agent)) entry->finished = true;
}

std::optional<AgentId> LockstepSchedule::Turn() const {
  const Entry* next = nullptr;
  for (const Entry& entry : agents_) {
    if (entry.finished) continue;
    if (!next || entry.next_sequence_number < next->next_sequence_number) next = &entry;
  }
  if (!next) return std::nullopt;
  return next->agent;
}

}  // namespace portolan
