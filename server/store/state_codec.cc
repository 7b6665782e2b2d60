#include "server/store/state_codec.h"

#include <cmath>
#include <utility>

#include "server/store/blob.h"

namespace portolan {
namespace {

constexpr size_t kRigidSize = 7 * sizeof(double);
constexpr size_t kRefinedLandmarkSize = 3 * sizeof(uint32_t) + 9 * sizeof(double);
constexpr size_t kFusedLandmarkSize = sizeof(int64_t) + 2 * sizeof(uint32_t) + 9 * sizeof(double);
constexpr size_t kSightSize = sizeof(int64_t) + sizeof(uint32_t);

Status Damaged(const char* what) {
  return absl::DataLossError(std::string("damaged blob of ") + what);
}

bool IsSound(const Rigid3& rigid) {
  return rigid.translation.allFinite() && std::abs(rigid.rotation.norm() - 1) < 1e-3;
}

Status SetCamera(const Eigen::Vector2d& radial, SubmapState* state) {
  state->camera = state->refined == nullptr ? nullptr : state->refined->camera;
  if (!radial.allFinite()) return Damaged("a submap's lens");
  if (radial.isZero(0) || state->camera == nullptr) return absl::OkStatus();
  auto camera = state->refined->camera->WithRadial(radial);
  if (!camera.ok()) return Damaged("a submap's lens");
  state->camera = std::make_shared<const CameraModel>(*std::move(camera));
  return absl::OkStatus();
}

}  // namespace

std::string EncodeRefined(const RefinedSubmap& refined) {
  BlobWriter writer;
  writer.Write(static_cast<uint32_t>(refined.submap_from_camera.size()));
  for (const Rigid3& pose : refined.submap_from_camera) writer.WriteRigid(pose);
  writer.Write(static_cast<uint32_t>(refined.landmarks.size()));
  for (const RefinedLandmark& landmark : refined.landmarks) {
    writer.Write(landmark.track.value());
    writer.Write(static_cast<uint32_t>(landmark.observation_count));
    writer.Write(static_cast<uint32_t>(landmark.redundant_count));
    writer.WriteVector(landmark.point_in_submap);
    writer.WriteSymmetric<3>(landmark.covariance.Matrix());
  }
  writer.Write(static_cast<uint32_t>(refined.redundant_keyframes.size()));
  for (const int keyframe : refined.redundant_keyframes) {
    writer.Write(static_cast<uint32_t>(keyframe));
  }
  return writer.Take();
}

Status DecodeRefined(std::string_view bytes, RefinedSubmap* refined) {
  BlobReader reader(bytes);
  refined->submap_from_camera.resize(reader.ReadCount(kRigidSize));
  for (Rigid3& pose : refined->submap_from_camera) {
    pose = reader.ReadRigid();
    if (!IsSound(pose)) return Damaged("a refined submap's poses");
  }
  refined->landmarks.resize(reader.ReadCount(kRefinedLandmarkSize));
  for (RefinedLandmark& landmark : refined->landmarks) {
    landmark.track = TrackId(reader.Read<uint32_t>());
    landmark.observation_count = static_cast<int>(reader.Read<uint32_t>());
    landmark.redundant_count = static_cast<int>(reader.Read<uint32_t>());
    landmark.point_in_submap = reader.ReadVector();
    landmark.covariance = reader.ReadSymmetric<3>();
    if (!landmark.point_in_submap.allFinite()) return Damaged("a refined submap's landmarks");
  }
  refined->redundant_keyframes.resize(reader.ReadCount(sizeof(uint32_t)));
  int64_t last = 0;
  for (int& keyframe : refined->redundant_keyframes) {
    const auto number = static_cast<int64_t>(reader.Read<uint32_t>());
    if (number <= last || number + 1 >= static_cast<int64_t>(refined->submap_from_camera.size())) {
      return Damaged("a refined submap's redundant keyframes");
    }
    last = number;
    keyframe = static_cast<int>(number);
  }
  if (!reader.AtEnd()) return Damaged("a refined submap");
  if (refined->submap_from_camera.size() != refined->raw->keyframes.size()) {
    return Damaged("a refined submap (number of keyframes)");
  }
  return absl::OkStatus();
}

std::string EncodePose(const SubmapState& state) {
  BlobWriter writer;
  writer.WriteSimilarity(state.world_from_submap);
  writer.WriteSymmetric<7>(state.covariance);
  writer.Write(static_cast<uint32_t>(state.world_from_camera.size()));
  for (const Rigid3& pose : state.world_from_camera) writer.WriteRigid(pose);
  const Eigen::Vector2d radial = AddedRadial(state);
  writer.Write(radial.x());
  writer.Write(radial.y());
  return writer.Take();
}

Status DecodePose(std::string_view bytes, SubmapState* state) {
  BlobReader reader(bytes);
  state->world_from_submap = reader.ReadSimilarity();
  state->covariance = reader.ReadSymmetric<7>();
  state->world_from_camera.resize(reader.ReadCount(kRigidSize));
  for (Rigid3& pose : state->world_from_camera) {
    pose = reader.ReadRigid();
    if (!IsSound(pose)) return Damaged("a submap's keyframes");
  }
  const double scale = state->world_from_submap.scale;
  Eigen::Vector2d radial;
  radial.x() = reader.Read<double>();
  radial.y() = reader.Read<double>();
  PORTOLAN_RETURN_IF_ERROR(SetCamera(radial, state));
  if (!reader.AtEnd() || !IsSound(state->world_from_submap.Rigid()) || !(scale > 0) ||
      !std::isfinite(scale)) {
    return Damaged("a submap's pose");
  }
  return absl::OkStatus();
}

std::string EncodeLandmarks(const std::vector<FusedLandmark>& landmarks) {
  BlobWriter writer;
  writer.Write(static_cast<uint32_t>(landmarks.size()));
  for (const FusedLandmark& landmark : landmarks) {
    writer.Write(landmark.id.value());
    writer.WriteVector(landmark.point_in_world);
    writer.WriteSymmetric<3>(landmark.covariance.Matrix());
    writer.Write(static_cast<uint32_t>(landmark.observation_count));
    writer.Write(static_cast<uint32_t>(landmark.sights.size()));
    for (const LandmarkSight& sight : landmark.sights) {
      writer.Write(sight.submap.value());
      writer.Write(sight.track.value());
    }
  }
  return writer.Take();
}

StatusOr<std::vector<FusedLandmark>> DecodeLandmarks(std::string_view bytes) {
  BlobReader reader(bytes);
  std::vector<FusedLandmark> landmarks(reader.ReadCount(kFusedLandmarkSize));
  for (FusedLandmark& landmark : landmarks) {
    landmark.id = LandmarkId(reader.Read<int64_t>());
    landmark.point_in_world = reader.ReadVector();
    landmark.covariance = reader.ReadSymmetric<3>();
    landmark.observation_count = static_cast<int>(reader.Read<uint32_t>());
    landmark.sights.resize(reader.ReadCount(kSightSize));
    for (LandmarkSight& sight : landmark.sights) {
      sight.submap = SubmapId(reader.Read<int64_t>());
      sight.track = TrackId(reader.Read<uint32_t>());
    }
    if (!landmark.point_in_world.allFinite()) return Damaged("fused landmarks");
  }
  if (!reader.AtEnd()) return Damaged("fused landmarks");
  return landmarks;
}

std::string EncodeClosure(const Closure& closure) {
  BlobWriter writer;
  writer.WriteSimilarity(closure.a_from_b);
  writer.WriteSymmetric<7>(closure.information);
  writer.Write(closure.rms_px);
  writer.Write(static_cast<uint32_t>(closure.matches.size()));
  for (const LandmarkMatch& match : closure.matches) {
    writer.Write(match.in_a.value());
    writer.Write(match.in_b.value());
  }
  return writer.Take();
}

Status DecodeClosure(std::string_view bytes, Closure* closure) {
  BlobReader reader(bytes);
  closure->a_from_b = reader.ReadSimilarity();
  closure->information = reader.ReadSymmetric<7>();
  closure->rms_px = reader.Read<double>();
  closure->matches.resize(reader.ReadCount(2 * sizeof(uint32_t)));
  for (LandmarkMatch& match : closure->matches) {
    match.in_a = TrackId(reader.Read<uint32_t>());
    match.in_b = TrackId(reader.Read<uint32_t>());
  }
  if (!reader.AtEnd() || !IsSound(closure->a_from_b.Rigid()) || !(closure->a_from_b.scale > 0)) {
    return Damaged("a closure");
  }
  return absl::OkStatus();
}

std::string EncodeGeoreference(const ComponentState& component) {
  if (!component.georeference || !component.georeference->is_georeferenced) return "";
  const SiteOrigin& origin = component.georeference->origin;
  BlobWriter writer;
  writer.Write<uint32_t>(origin.geodetic.has_value() ? 1 : 0);
  const GeodeticPosition geodetic = origin.geodetic.value_or(GeodeticPosition{});
  writer.Write(geodetic.latitude_deg);
  writer.Write(geodetic.longitude_deg);
  writer.Write(geodetic.height_m);
  writer.WriteVector(origin.grid_m);
  return writer.Take();
}

Status DecodeGeoreference(std::string_view bytes, ComponentState* component) {
  if (bytes.empty()) return absl::OkStatus();
  BlobReader reader(bytes);
  auto report = std::make_shared<GeoreferenceReport>();
  report->is_georeferenced = true;
  const bool is_geodetic = reader.Read<uint32_t>() != 0;
  GeodeticPosition geodetic;
  geodetic.latitude_deg = reader.Read<double>();
  geodetic.longitude_deg = reader.Read<double>();
  geodetic.height_m = reader.Read<double>();
  if (is_geodetic) report->origin.geodetic = geodetic;
  report->origin.grid_m = reader.ReadVector();
  if (!reader.AtEnd() || !ValidateSiteOrigin(report->origin).ok()) {
    return absl::DataLossError("component.georeference is damaged");
  }
  component->georeference = std::move(report);
  return absl::OkStatus();
}

}  // namespace portolan
