#include "common/wire/submap_wire.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "common/wire/submap_columns.h"
#include "common/wire/submap_validation.h"
#include "google/protobuf/io/coded_stream.h"
#include "google/protobuf/io/zero_copy_stream_impl_lite.h"
#include "google/protobuf/stubs/logging.h"

namespace portolan {
namespace {

v1::LinkType ToProto(LinkType link) {
  switch (link) {
    case LinkType::kNone:
      return v1::LINK_TYPE_NONE;
    case LinkType::kConnected:
      return v1::LINK_TYPE_CONNECTED;
    case LinkType::kBroken:
      return v1::LINK_TYPE_BROKEN;
  }
  return v1::LINK_TYPE_UNSPECIFIED;
}

StatusOr<LinkType> FromProto(v1::LinkType link) {
  switch (link) {
    case v1::LINK_TYPE_NONE:
      return LinkType::kNone;
    case v1::LINK_TYPE_CONNECTED:
      return LinkType::kConnected;
    case v1::LINK_TYPE_BROKEN:
      return LinkType::kBroken;
    default:
      return absl::InvalidArgumentError("submap.link: unknown value");
  }
}

StatusOr<std::optional<Eigen::Vector3d>> GravityFromProto(const v1::Submap& message) {
  std::optional<Eigen::Vector3d> gravity;
  if (message.gravity_in_submap_size() == 0) return gravity;
  if (message.gravity_in_submap_size() != 3) {
    return absl::InvalidArgumentError("submap.gravity_in_submap: neither 0 nor 3 numbers");
  }
  gravity.emplace(message.gravity_in_submap(0), message.gravity_in_submap(1),
                  message.gravity_in_submap(2));
  if (!(std::abs(gravity->norm() - 1.0) <= 1e-3)) {
    return absl::InvalidArgumentError("submap.gravity_in_submap: not a unit vector");
  }
  gravity->normalize();
  return gravity;
}

// Nothing is written where there are no fixes.
void EncodeGnss(const Submap& submap, v1::Submap* message) {
  if (submap.gnss.empty()) return;
  v1::GnssColumns& columns = *message->mutable_gnss();
  for (const GnssFix& fix : submap.gnss) {
    columns.add_time_ns(fix.time.count());
    columns.add_position(fix.position.latitude_deg);
    columns.add_position(fix.position.longitude_deg);
    columns.add_position(fix.position.height_m);
    columns.add_sigma_m(static_cast<float>(fix.sigma_horizontal_m));
    columns.add_sigma_m(static_cast<float>(fix.sigma_vertical_m));
  }
  if (submap.antenna_in_camera_m.isZero()) return;
  for (const double x : submap.antenna_in_camera_m) {
    columns.add_antenna_in_camera_m(static_cast<float>(x));
  }
}

Status DecodeGnss(const v1::GnssColumns& columns, Submap* submap) {
  const int count = columns.time_ns_size();
  if (static_cast<size_t>(count) > kMaxGnssFixes) {
    return absl::InvalidArgumentError("submap.gnss.time_ns: too many");
  }
  if (columns.position_size() != 3 * count || columns.sigma_m_size() != 2 * count) {
    return absl::InvalidArgumentError("submap.gnss: columns of different lengths");
  }
  for (int i = 0; i < count; ++i) {
    GnssFix& fix = submap->gnss.emplace_back();
    fix.time = Timestamp(columns.time_ns(i));
    fix.position = {columns.position(3 * i), columns.position(3 * i + 1),
                    columns.position(3 * i + 2)};
    fix.sigma_horizontal_m = columns.sigma_m(2 * i);
    fix.sigma_vertical_m = columns.sigma_m(2 * i + 1);
  }
  if (columns.antenna_in_camera_m_size() == 0) return absl::OkStatus();
  if (columns.antenna_in_camera_m_size() != 3) {
    return absl::InvalidArgumentError("submap.gnss.antenna_in_camera_m: neither 0 nor 3 numbers");
  }
  for (int i = 0; i < 3; ++i) submap->antenna_in_camera_m[i] = columns.antenna_in_camera_m(i);
  return absl::OkStatus();
}

// The bytes of the numbers of a packed varint field.
size_t VarintBytes(const google::protobuf::RepeatedField<uint32_t>& numbers) {
  size_t bytes = 0;
  for (const uint32_t n : numbers)
    bytes += google::protobuf::io::CodedOutputStream::VarintSize32(n);
  return bytes;
}

size_t FloatBytes(const google::protobuf::RepeatedField<float>& numbers) {
  return sizeof(float) * static_cast<size_t>(numbers.size());
}

}  // namespace

size_t WireSizes::Total() const {
  return keyframe_poses + keyframe_covariances + observation_tracks + observation_pixels +
         observation_sigmas + feature_pixels + feature_attributes + feature_descriptors +
         landmarks + frame_times + frame_poses + other;
}

Status ToProto(const Submap& submap, v1::Submap* message) {
  PORTOLAN_RETURN_IF_ERROR(ValidateSubmapStructure(submap));
  PORTOLAN_RETURN_IF_ERROR(ValidateSubmapCovariances(submap));
  message->set_agent_id(submap.key.agent.value());
  message->set_session_id(submap.key.session.value());
  message->set_sequence_number(submap.key.sequence_number);
  message->set_link(ToProto(submap.link));
  message->set_metric(submap.metric);
  if (submap.gravity_in_submap.has_value()) {
    for (int i = 0; i < 3; ++i) {
      message->add_gravity_in_submap(static_cast<float>((*submap.gravity_in_submap)[i]));
    }
  }
  EncodeKeyframes(submap.keyframes, message->mutable_keyframes());
  EncodeObservations(submap.keyframes, message->mutable_observations());
  EncodeFeatures(submap.keyframes, message->mutable_features());
  EncodeLandmarks(submap.landmarks, message->mutable_landmarks());
  EncodeFrames(submap.frames, message->mutable_frames());
  EncodeGnss(submap, message);
  return absl::OkStatus();
}

StatusOr<Submap> FromProto(const v1::Submap& message) {
  Submap submap;
  submap.key.agent = AgentId(message.agent_id());
  submap.key.session = SessionId(message.session_id());
  submap.key.sequence_number = message.sequence_number();
  PORTOLAN_ASSIGN_OR_RETURN(submap.link, FromProto(message.link()));
  submap.metric = message.metric();
  PORTOLAN_ASSIGN_OR_RETURN(submap.gravity_in_submap, GravityFromProto(message));
  PORTOLAN_ASSIGN_OR_RETURN(submap.keyframes, DecodeKeyframes(message.keyframes()));
  PORTOLAN_RETURN_IF_ERROR(DecodeObservations(message.observations(), &submap.keyframes));
  PORTOLAN_RETURN_IF_ERROR(DecodeFeatures(message.features(), &submap.keyframes));
  PORTOLAN_ASSIGN_OR_RETURN(submap.landmarks, DecodeLandmarks(message.landmarks()));
  PORTOLAN_ASSIGN_OR_RETURN(submap.frames, DecodeFrames(message.frames()));
  PORTOLAN_RETURN_IF_ERROR(DecodeGnss(message.gnss(), &submap));
  PORTOLAN_RETURN_IF_ERROR(ValidateSubmapStructure(submap));
  return submap;
}

StatusOr<std::string> EncodeSubmap(const Submap& submap) {
  v1::Submap message;
  PORTOLAN_RETURN_IF_ERROR(ToProto(submap, &message));
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    message.SerializeToCodedStream(&coded);
  }
  if (bytes.size() > kMaxSubmapBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("submap: ", bytes.size(), " bytes, more than ", kMaxSubmapBytes));
  }
  return bytes;
}

StatusOr<Submap> DecodeSubmap(std::string_view bytes) {
  if (bytes.size() > kMaxSubmapBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("submap: ", bytes.size(), " bytes, more than ", kMaxSubmapBytes));
  }
  // Damaged bytes must not write to the log; the Status tells of them.
  const google::protobuf::LogSilencer silencer;
  v1::Submap message;
  if (!message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return absl::InvalidArgumentError("submap: not a portolan.v1.Submap");
  }
  return FromProto(message);
}

WireSizes SizesOf(const v1::Submap& m) {
  WireSizes sizes;
  const auto& k = m.keyframes();
  for (const int64_t t : k.time_ns()) {
    sizes.keyframe_poses +=
        google::protobuf::io::CodedOutputStream::VarintSize64(static_cast<uint64_t>(t));
  }
  sizes.keyframe_poses += FloatBytes(k.submap_from_camera());
  sizes.keyframe_covariances = FloatBytes(k.covariance_factor());
  const auto& o = m.observations();
  sizes.observation_tracks = VarintBytes(o.count()) + o.track().size();
  sizes.observation_pixels = o.first_x().size() + o.first_y().size() + o.delta_x().size() +
                             o.delta_y().size() + o.shift().size();
  sizes.observation_sigmas = o.sigma().size();
  const auto& f = m.features();
  sizes.feature_pixels = f.x().size() + f.y().size();
  sizes.feature_attributes = VarintBytes(f.count()) + f.half_octave().size() + f.on_track().size() +
                             f.track().size() + f.observed().size();
  sizes.feature_descriptors = f.descriptors().size() + f.coded_descriptors().size();
  const auto& l = m.landmarks();
  sizes.landmarks = VarintBytes(l.track_delta()) + FloatBytes(l.point_in_submap()) +
                    FloatBytes(l.covariance_factor());
  const auto& p = m.frames();
  sizes.frame_times = p.time_ns().size();
  sizes.frame_poses = p.translation_x().size() + p.translation_y().size() +
                      p.translation_z().size() + p.rotation_x().size() + p.rotation_y().size() +
                      p.rotation_z().size();
  sizes.other = m.ByteSizeLong() - sizes.Total();
  return sizes;
}

}  // namespace portolan
