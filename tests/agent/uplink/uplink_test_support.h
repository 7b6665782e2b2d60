// A session's hello and small submaps for the tests of the uplink.
#ifndef PORTOLAN_TESTS_AGENT_UPLINK_UPLINK_TEST_SUPPORT_H_
#define PORTOLAN_TESTS_AGENT_UPLINK_UPLINK_TEST_SUPPORT_H_

#include <memory>

#include "agent/uplink/outbox.h"
#include "tests/common/wire/random_submap.h"
#include "tests/support/matchers.h"
#include "tests/support/temp_dir.h"

namespace portolan {

inline SessionHello TestHello() {
  const SubmapKey key = RandomSubmap({.keyframes = 1, .observations = 0, .features = 0}).key;
  SessionHello hello;
  hello.agent = key.agent;
  hello.session = key.session;
  hello.camera.width_px = 752;
  hello.camera.height_px = 480;
  hello.camera.fx_px = hello.camera.fy_px = 460;
  hello.software_version = "test";
  return hello;
}

inline Submap SmallSubmap(uint32_t sequence_number) {
  return RandomSubmap({.seed = sequence_number + 1,
                       .sequence_number = sequence_number,
                       .keyframes = 3,
                       .observations = 20,
                       .landmarks = 5,
                       .features = 10,
                       .frames = 10});
}

inline std::unique_ptr<Outbox> NewOutbox(const TempDir& dir, OutboxOptions options = {}) {
  auto outbox = Outbox::Create(dir.path(), TestHello(), options);
  EXPECT_THAT(outbox, IsOk());
  return *std::move(outbox);
}

}  // namespace portolan

#endif  // PORTOLAN_TESTS_AGENT_UPLINK_UPLINK_TEST_SUPPORT_H_
