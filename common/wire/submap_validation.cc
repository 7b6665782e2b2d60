#include "common/wire/submap_validation.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "common/wire/covariance_factor.h"
#include "common/wire/geometry_wire.h"

namespace portolan {
namespace {

template <typename... Parts>
Status Malformed(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat("submap.", parts...));
}

std::string At(absl::string_view list, size_t index) { return absl::StrCat(list, "[", index, "]"); }

bool IsTime(Timestamp time) { return time >= Timestamp::zero() && time <= kMaxTime; }
// All false for NaN.
bool IsPixel(const Eigen::Vector2f& pixel) {
  return std::abs(pixel.x()) <= kMaxPixel_px && std::abs(pixel.y()) <= kMaxPixel_px;
}
bool IsSigma(double sigma_px) { return sigma_px >= kMinSigma_px && sigma_px <= kMaxSigma_px; }

Status ValidateKey(const Submap& submap) {
  PORTOLAN_RETURN_IF_ERROR(ValidateSession(submap.key.agent, submap.key.session));
  if ((submap.key.sequence_number == 0) != (submap.link == LinkType::kNone)) {
    return Malformed("link: must be NONE for the session's first submap and only for it");
  }
  if (submap.gravity_in_submap.has_value() &&
      !(std::abs(submap.gravity_in_submap->norm() - 1.0) <= 1e-3)) {
    return Malformed("gravity_in_submap: is not a unit vector");
  }
  return absl::OkStatus();
}

Status ValidateObservations(const Keyframe& keyframe, const std::string& where) {
  const auto& observations = keyframe.observations;
  if (observations.size() > kMaxObservationsPerKeyframe) {
    return Malformed(where, ".observations: more than ", kMaxObservationsPerKeyframe);
  }
  for (size_t i = 0; i < observations.size(); ++i) {
    if (i > 0 && !(observations[i - 1].track < observations[i].track)) {
      return Malformed(where, At(".observations", i), ".track: ids do not ascend");
    }
    if (!IsPixel(observations[i].pixel)) {
      return Malformed(where, At(".observations", i), ".pixel: not finite or out of range");
    }
    if (!IsSigma(observations[i].sigma_px)) {
      return Malformed(where, At(".observations", i), ".sigma_px: out of range");
    }
  }
  return absl::OkStatus();
}

Status ValidateFeatures(const Keyframe& keyframe, const std::string& where) {
  if (keyframe.features.size() > kMaxFeaturesPerKeyframe) {
    return Malformed(where, ".features: more than ", kMaxFeaturesPerKeyframe);
  }
  for (size_t i = 0; i < keyframe.features.size(); ++i) {
    if (!IsPixel(keyframe.features[i].pixel)) {
      return Malformed(where, At(".features", i), ".pixel: not finite or out of range");
    }
    if (keyframe.features[i].half_octave > kMaxHalfOctave) {
      return Malformed(where, At(".features", i), ".half_octave: above ", kMaxHalfOctave);
    }
  }
  return absl::OkStatus();
}

Status ValidateFirstKeyframe(const Keyframe& keyframe) {
  const Rigid3& pose = keyframe.submap_from_camera;
  if (pose.translation.norm() <= 1e-6 && pose.rotation.vec().norm() <= 1e-6) {
    return absl::OkStatus();
  }
  return Malformed("keyframes[0].submap_from_camera: is not the identity");
}

Status ValidateKeyframes(const Submap& submap) {
  const auto& keyframes = submap.keyframes;
  if (keyframes.empty() || keyframes.size() > kMaxKeyframes) {
    return Malformed("keyframes: ", keyframes.size(), " of them, not 1..", kMaxKeyframes);
  }
  size_t observation_count = 0;
  size_t feature_count = 0;
  for (size_t i = 0; i < keyframes.size(); ++i) {
    const std::string where = At("keyframes", i);
    if (!IsTime(keyframes[i].time) || (i > 0 && keyframes[i].time <= keyframes[i - 1].time)) {
      return Malformed(where, ".time: out of range or not ascending");
    }
    PORTOLAN_RETURN_IF_ERROR(CheckPose(keyframes[i].submap_from_camera,
                                       absl::StrCat("submap.", where, ".submap_from_camera")));
    PORTOLAN_RETURN_IF_ERROR(ValidateObservations(keyframes[i], where));
    PORTOLAN_RETURN_IF_ERROR(ValidateFeatures(keyframes[i], where));
    observation_count += keyframes[i].observations.size();
    feature_count += keyframes[i].features.size();
  }
  if (observation_count > kMaxObservations) {
    return Malformed("keyframes: more than ", kMaxObservations, " observations");
  }
  if (feature_count > kMaxFeatures) {
    return Malformed("keyframes: more than ", kMaxFeatures, " features");
  }
  return ValidateFirstKeyframe(keyframes.front());
}

Status ValidateLandmarks(const Submap& submap) {
  const auto& landmarks = submap.landmarks;
  if (landmarks.size() > kMaxLandmarks) return Malformed("landmarks: more than ", kMaxLandmarks);
  for (size_t i = 0; i < landmarks.size(); ++i) {
    if (i > 0 && !(landmarks[i - 1].track < landmarks[i].track)) {
      return Malformed(At("landmarks", i), ".track: ids do not ascend");
    }
    if (!(landmarks[i].point_in_submap.cwiseAbs().maxCoeff() <= kMaxCoordinate) ||
        !landmarks[i].point_in_submap.allFinite()) {
      return Malformed(At("landmarks", i), ".point_in_submap: not finite or too large");
    }
  }
  return absl::OkStatus();
}

Status ValidateFrames(const Submap& submap) {
  const auto& frames = submap.frames;
  if (frames.size() > kMaxFrames) return Malformed("frames: more than ", kMaxFrames);
  for (size_t i = 0; i < frames.size(); ++i) {
    if (!IsTime(frames[i].time) || (i > 0 && frames[i].time <= frames[i - 1].time)) {
      return Malformed(At("frames", i), ".time: out of range or not ascending");
    }
    PORTOLAN_RETURN_IF_ERROR(
        CheckPose(frames[i].submap_from_camera,
                  absl::StrCat("submap.", At("frames", i), ".submap_from_camera")));
  }
  return absl::OkStatus();
}

// All false for NaN.
bool IsGnssSigma(double sigma_m) {
  return sigma_m >= kMinGnssSigma_m && sigma_m <= kMaxGnssSigma_m;
}

Status ValidateGnss(const Submap& submap) {
  const auto& fixes = submap.gnss;
  if (fixes.size() > kMaxGnssFixes) return Malformed("gnss: more than ", kMaxGnssFixes);
  for (size_t i = 0; i < fixes.size(); ++i) {
    const std::string where = At("gnss", i);
    if (fixes[i].time < submap.keyframes.front().time ||
        fixes[i].time > submap.keyframes.back().time ||
        (i > 0 && fixes[i].time <= fixes[i - 1].time)) {
      return Malformed(where, ".time: outside of the keyframes or not ascending");
    }
    const Status status = ValidateGeodetic(fixes[i].position);
    if (!status.ok()) return Malformed(where, ".position: ", status.message());
    if (!IsGnssSigma(fixes[i].sigma_horizontal_m) || !IsGnssSigma(fixes[i].sigma_vertical_m)) {
      return Malformed(where, ".sigma: out of range");
    }
  }
  if (!submap.antenna_in_camera_m.allFinite() ||
      submap.antenna_in_camera_m.cwiseAbs().maxCoeff() > kMaxAntennaCoordinate_m) {
    return Malformed("antenna_in_camera: not finite or too large");
  }
  return absl::OkStatus();
}

}  // namespace

bool IsValidAgentId(std::string_view id) {
  const auto is_allowed = [](char c) {
    return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '_' || c == '-';
  };
  return !id.empty() && id.size() <= kMaxAgentIdLength &&
         std::all_of(id.begin(), id.end(), is_allowed);
}

Status ValidateSession(const AgentId& agent, SessionId session) {
  if (!IsValidAgentId(agent.value())) {
    return absl::InvalidArgumentError("agent_id: not 1 to 64 characters of A-Z a-z 0-9 . _ -");
  }
  if (session.value() == 0) return absl::InvalidArgumentError("session_id: is 0");
  return absl::OkStatus();
}

Status ValidateSubmapStructure(const Submap& submap) {
  PORTOLAN_RETURN_IF_ERROR(ValidateKey(submap));
  PORTOLAN_RETURN_IF_ERROR(ValidateKeyframes(submap));
  PORTOLAN_RETURN_IF_ERROR(ValidateLandmarks(submap));
  PORTOLAN_RETURN_IF_ERROR(ValidateFrames(submap));
  return ValidateGnss(submap);
}

Status ValidateSubmapCovariances(const Submap& submap) {
  for (size_t i = 0; i < submap.keyframes.size(); ++i) {
    const auto factor = CovarianceFactor<6>(submap.keyframes[i].covariance);
    if (!factor.has_value() || factor->cwiseAbs().maxCoeff() > kMaxFactor) {
      return Malformed(At("keyframes", i), ".covariance: not positive semi-definite");
    }
  }
  for (size_t i = 0; i < submap.landmarks.size(); ++i) {
    const auto factor = CovarianceFactor<3>(submap.landmarks[i].covariance);
    if (!factor.has_value() || factor->diagonal().minCoeff() < kMinLandmarkFactor ||
        factor->cwiseAbs().maxCoeff() > kMaxFactor) {
      return Malformed(At("landmarks", i), ".covariance: not positive definite");
    }
  }
  return absl::OkStatus();
}

}  // namespace portolan
