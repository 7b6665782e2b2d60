// Landmark offers on the wire (proto/correction.proto), in some 30 bytes a landmark.
#ifndef PORTOLAN_COMMON_WIRE_OFFER_WIRE_H_
#define PORTOLAN_COMMON_WIRE_OFFER_WIRE_H_

#include "absl/strings/string_view.h"
#include "common/base/status.h"
#include "common/submap/landmark_offer.h"
#include "proto/correction.pb.h"

namespace portolan {

inline constexpr size_t kMaxLandmarksPerOffer = 256;
inline constexpr uint32_t kMaxOfferFirstIndex = 65535;

// True if the wire can hold it: in front of the camera, no number out of range.
bool IsSendable(const OfferedLandmark& landmark);

// Expects at most kMaxLandmarksPerOffer landmarks, all of them sendable. Rounds them.
void ToProto(const LandmarkOffer& offer, v1::LandmarkOffer* message);
// InvalidArgument, beginning with `what`, if the message is malformed.
StatusOr<LandmarkOffer> FromProto(const v1::LandmarkOffer& message, absl::string_view what);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_OFFER_WIRE_H_
