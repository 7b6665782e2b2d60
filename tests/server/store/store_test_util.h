// Small submaps and map states for the tests of the store.
#ifndef PORTOLAN_TESTS_SERVER_STORE_STORE_TEST_UTIL_H_
#define PORTOLAN_TESTS_SERVER_STORE_STORE_TEST_UTIL_H_

#include <memory>
#include <string>
#include <string_view>

#include "server/store/map_store.h"

namespace portolan::testing {

SessionRecord MakeSession(const std::string& agent, uint64_t session);

// A submap with `keyframes` keyframes as bytes that DecodeTestSubmap understands.
NewSubmap MakeSubmap(const std::string& agent, uint64_t session, uint32_t sequence_number,
                     int keyframes = 2);
StatusOr<Submap> DecodeTestSubmap(std::string_view bytes);

// A state of the stored submap with `landmarks` landmarks around `position`, all of it drawn from
// the seed.
std::shared_ptr<const SubmapState> MakeState(const StoredSubmap& stored, ComponentId component,
                                             const Eigen::Vector3d& position, int landmarks,
                                             unsigned seed);

Closure MakeClosure(SubmapId a, SubmapId b, int matches);

// Everything about two snapshots is equal, to the last bit.
void ExpectSameSnapshot(const MapSnapshot& actual, const MapSnapshot& expected);

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_SERVER_STORE_STORE_TEST_UTIL_H_
