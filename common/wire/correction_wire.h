// Corrections on the wire (proto/correction.proto).
#ifndef PORTOLAN_COMMON_WIRE_CORRECTION_WIRE_H_
#define PORTOLAN_COMMON_WIRE_CORRECTION_WIRE_H_

#include <vector>

#include "common/base/status.h"
#include "common/submap/map_correction.h"
#include "proto/correction.pb.h"

namespace portolan {

inline constexpr size_t kMaxSubmapsPerCorrection = 1024;
inline constexpr size_t kMaxOffersPerCorrection = 64;

// Expects at most kMaxSubmapsPerCorrection submaps (SplitCorrection gives such) and
// kMaxOffersPerCorrection offers.
// `protocol_version`: of the agent.
void ToProto(const MapCorrection& correction, uint32_t protocol_version, v1::Correction* message);
StatusOr<MapCorrection> FromProto(const v1::Correction& message);

// Parts of at most `max_submaps` each, all but the last with `more`; one part if it is empty.
// The offers go with the first.
std::vector<MapCorrection> SplitCorrection(const MapCorrection& correction,
                                           size_t max_submaps = kMaxSubmapsPerCorrection);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_CORRECTION_WIRE_H_
