// The agent's options by name: one table for YAML, flags and --help.
#ifndef PORTOLAN_AGENT_AGENT_FLAGS_H_
#define PORTOLAN_AGENT_AGENT_FLAGS_H_

#include "agent/agent.h"
#include "common/config/option_table.h"

namespace portolan {

// Adds every option of the image-to-submap path. `options` must outlive the table.
void AddAgentOptions(AgentOptions* options, OptionTable* table);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_AGENT_FLAGS_H_
