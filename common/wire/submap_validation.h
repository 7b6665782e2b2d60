// What a submap must fulfil to travel and to be kept; the limits that proto/submap.proto states.
#ifndef PORTOLAN_COMMON_WIRE_SUBMAP_VALIDATION_H_
#define PORTOLAN_COMMON_WIRE_SUBMAP_VALIDATION_H_

#include <cstddef>
#include <string_view>

#include "common/base/status.h"
#include "common/submap/submap.h"

namespace portolan {

inline constexpr size_t kMaxSubmapBytes = size_t{2} << 20;
inline constexpr size_t kMaxAgentIdLength = 64;
inline constexpr size_t kMaxKeyframes = 256;
inline constexpr size_t kMaxObservationsPerKeyframe = 4096;
inline constexpr size_t kMaxObservations = 262144;
inline constexpr size_t kMaxFeaturesPerKeyframe = 4096;
inline constexpr size_t kMaxFeatures = 16384;
inline constexpr size_t kMaxLandmarks = 4096;
inline constexpr size_t kMaxFrames = 20000;
inline constexpr size_t kMaxGnssFixes = 1024;
inline constexpr double kMinGnssSigma_m = 0.001;
inline constexpr double kMaxGnssSigma_m = 1e4;
inline constexpr double kMaxAntennaCoordinate_m = 1000;
// Times end in the year 2043 if they count from 1970.
inline constexpr Timestamp kMaxTime{INT64_MAX / 4};
inline constexpr double kMaxPixel_px = 32768;
inline constexpr double kMinSigma_px = 0.0625;
inline constexpr double kMaxSigma_px = 4000;
inline constexpr int kMaxHalfOctave = 32;
// Entries of covariance factors (units or rad), and the smallest diagonal entry of a landmark's.
inline constexpr double kMaxFactor = 1e12;
inline constexpr double kMinLandmarkFactor = 1e-30;

// 1 to 64 characters of A-Z a-z 0-9 . _ -
bool IsValidAgentId(std::string_view id);

// Agent id valid, session not 0.
Status ValidateSession(const AgentId& agent, SessionId session);

// Everything but the covariances: key, link, limits, finiteness, unit vectors, ascending ids and
// times, ranges. InvalidArgument says what and where.
Status ValidateSubmapStructure(const Submap& submap);

// Keyframes' covariances positive semi-definite, landmarks' positive definite.
Status ValidateSubmapCovariances(const Submap& submap);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_SUBMAP_VALIDATION_H_
