// Blobs of the derived tables. Layouts: README.md. Decoding checks sizes and finiteness: a damaged
// blob is DataLoss, never a crash.
#ifndef PORTOLAN_SERVER_STORE_STATE_CODEC_H_
#define PORTOLAN_SERVER_STORE_STATE_CODEC_H_

#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "server/fusion/map_state.h"

namespace portolan {

// refined_submap.estimate: poses and landmarks.
std::string EncodeRefined(const RefinedSubmap& refined);
// Fills the same fields; the number of poses must be that of refined->raw->keyframes.
Status DecodeRefined(std::string_view bytes, RefinedSubmap* refined);

// submap_state.pose: world_from_submap, covariance, world_from_camera, camera. The camera is
// told against state->refined->camera.
std::string EncodePose(const SubmapState& state);
Status DecodePose(std::string_view bytes, SubmapState* state);

// submap_state.landmarks.
std::string EncodeLandmarks(const std::vector<FusedLandmark>& landmarks);
StatusOr<std::vector<FusedLandmark>> DecodeLandmarks(std::string_view bytes);

// component.georeference: empty unless the component is georeferenced, else the site's origin.
std::string EncodeGeoreference(const ComponentState& component);
Status DecodeGeoreference(std::string_view bytes, ComponentState* component);

// closure.estimate: everything except a and b.
std::string EncodeClosure(const Closure& closure);
Status DecodeClosure(std::string_view bytes, Closure* closure);

}  // namespace portolan

#endif  // PORTOLAN_SERVER_STORE_STATE_CODEC_H_
