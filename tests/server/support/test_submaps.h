// Small valid submaps for the tests of the server's plumbing.
#ifndef PORTOLAN_TESTS_SERVER_SUPPORT_TEST_SUBMAPS_H_
#define PORTOLAN_TESTS_SERVER_SUPPORT_TEST_SUBMAPS_H_

#include <cstdint>
#include <string>

#include "common/wire/agent_wire.h"
#include "server/ingest/session_table.h"

namespace portolan::testing {

CameraIntrinsics TestCamera();
SessionName TestSession(const std::string& agent, uint64_t session = 1);
SessionHello TestHello(const std::string& agent, uint64_t session = 1);

// Two keyframes and three frames, one second a submap; the last keyframe is the next one's first.
Submap MakeTestSubmap(const SubmapKey& key);
v1::SubmapUpload MakeTestUpload(const std::string& agent, uint32_t sequence_number,
                                uint64_t session = 1);

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_SERVER_SUPPORT_TEST_SUBMAPS_H_
