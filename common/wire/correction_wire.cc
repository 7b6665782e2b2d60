#include "common/wire/correction_wire.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "common/wire/geometry_wire.h"
#include "common/wire/offer_wire.h"
#include "common/wire/pose_columns.h"
#include "common/wire/submap_validation.h"

namespace portolan {
namespace {

constexpr int kTangentSize = 7;
constexpr double kMaxVariance = 1e24;
// What is sent for larger ones: below the limit as a float, too.
constexpr double kLargestSentVariance = 9e23;
constexpr double kMaxAddedRadial = 1000;
// The first that knows PoseColumns.
constexpr uint32_t kPoseColumnsVersion = 2;

StatusOr<std::vector<Rigid3>> AdjustedPoses(const v1::SubmapCorrection& message,
                                            const std::string& where) {
  const auto& numbers = message.adjusted_submap_from_camera();
  if (message.has_adjusted_poses()) {
    if (!numbers.empty()) {
      return absl::InvalidArgumentError(absl::StrCat(where, ": adjusted poses in both forms"));
    }
    return DecodePoses(message.adjusted_poses(), kMaxKeyframes,
                       absl::StrCat(where, ".adjusted_poses"));
  }
  if (numbers.size() % kPoseNumbers != 0 ||
      numbers.size() > kPoseNumbers * static_cast<int>(kMaxKeyframes)) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ".adjusted_submap_from_camera: ", numbers.size(), " numbers"));
  }
  std::vector<Rigid3> poses;
  for (int i = 0; i < numbers.size() / kPoseNumbers; ++i) {
    PORTOLAN_ASSIGN_OR_RETURN(
        Rigid3 pose,
        PoseAt(numbers, i, absl::StrCat(where, ".adjusted_submap_from_camera[", i, "]")));
    poses.push_back(pose);
  }
  return poses;
}

StatusOr<Eigen::Vector2d> AddedRadial(const v1::SubmapCorrection& message,
                                      const std::string& where) {
  Eigen::Vector2d added = Eigen::Vector2d::Zero();
  if (message.added_radial().empty()) return added;
  if (message.added_radial_size() != 2) {
    return absl::InvalidArgumentError(absl::StrCat(where, ".added_radial: not 2 numbers"));
  }
  for (int i = 0; i < 2; ++i) {
    added[i] = message.added_radial(i);
    // Written so that NaN fails.
    if (!(std::abs(added[i]) <= kMaxAddedRadial)) {
      return absl::InvalidArgumentError(
          absl::StrCat(where, ".added_radial: too large or not finite"));
    }
  }
  return added;
}

StatusOr<SubmapPlacement> PlacementFromProto(const v1::SubmapCorrection& message,
                                             const std::string& where) {
  SubmapPlacement placement;
  placement.sequence_number = message.sequence_number();
  if (message.component_id() <= 0) {
    return absl::InvalidArgumentError(absl::StrCat(where, ".component_id: not positive"));
  }
  placement.component = ComponentId(message.component_id());
  placement.metric = message.metric();
  PORTOLAN_ASSIGN_OR_RETURN(
      placement.world_from_submap,
      FromProto(message.world_from_submap(), absl::StrCat(where, ".world_from_submap")));
  if (message.covariance_diagonal_size() != kTangentSize) {
    return absl::InvalidArgumentError(absl::StrCat(where, ".covariance_diagonal: not 7 numbers"));
  }
  for (int i = 0; i < kTangentSize; ++i) {
    placement.covariance_diagonal[i] = message.covariance_diagonal(i);
    // Written so that NaN fails.
    if (!(message.covariance_diagonal(i) >= 0 && message.covariance_diagonal(i) <= kMaxVariance)) {
      return absl::InvalidArgumentError(
          absl::StrCat(where, ".covariance_diagonal: negative or not finite"));
    }
  }
  PORTOLAN_ASSIGN_OR_RETURN(placement.adjusted_submap_from_camera, AdjustedPoses(message, where));
  PORTOLAN_ASSIGN_OR_RETURN(placement.added_radial, AddedRadial(message, where));
  return placement;
}

}  // namespace

void ToProto(const MapCorrection& correction, uint32_t protocol_version, v1::Correction* message) {
  message->set_map_version(correction.map_version);
  message->set_more(correction.more);
  for (const SubmapPlacement& placement : correction.submaps) {
    v1::SubmapCorrection* m = message->add_submaps();
    m->set_sequence_number(placement.sequence_number);
    m->set_component_id(placement.component.value());
    m->set_metric(placement.metric);
    ToProto(placement.world_from_submap, m->mutable_world_from_submap());
    for (int i = 0; i < kTangentSize; ++i) {
      const double variance = placement.covariance_diagonal[i];
      const bool is_sound = variance >= 0 && variance < kLargestSentVariance;
      m->add_covariance_diagonal(static_cast<float>(is_sound ? variance : kLargestSentVariance));
    }
    if (!placement.added_radial.isZero(0)) {
      for (const double added : placement.added_radial) m->add_added_radial(added);
    }
    if (protocol_version < kPoseColumnsVersion) {
      for (const Rigid3& pose : placement.adjusted_submap_from_camera) {
        AppendPose(pose, m->mutable_adjusted_submap_from_camera());
      }
    } else if (!placement.adjusted_submap_from_camera.empty()) {
      EncodePoses(placement.adjusted_submap_from_camera, m->mutable_adjusted_poses());
    }
  }
  for (const LandmarkOffer& offer : correction.offers) ToProto(offer, message->add_offers());
}

StatusOr<MapCorrection> FromProto(const v1::Correction& message) {
  MapCorrection correction;
  correction.map_version = message.map_version();
  correction.more = message.more();
  if (message.submaps_size() > static_cast<int>(kMaxSubmapsPerCorrection)) {
    return absl::InvalidArgumentError(
        absl::StrCat("correction.submaps: more than ", kMaxSubmapsPerCorrection));
  }
  for (int i = 0; i < message.submaps_size(); ++i) {
    const std::string where = absl::StrCat("correction.submaps[", i, "]");
    PORTOLAN_ASSIGN_OR_RETURN(SubmapPlacement placement,
                              PlacementFromProto(message.submaps(i), where));
    if (i > 0 && placement.sequence_number <= correction.submaps.back().sequence_number) {
      return absl::InvalidArgumentError(absl::StrCat(where, ".sequence_number: does not ascend"));
    }
    correction.submaps.push_back(std::move(placement));
  }
  if (message.offers_size() > static_cast<int>(kMaxOffersPerCorrection)) {
    return absl::InvalidArgumentError(
        absl::StrCat("correction.offers: more than ", kMaxOffersPerCorrection));
  }
  for (int i = 0; i < message.offers_size(); ++i) {
    PORTOLAN_ASSIGN_OR_RETURN(
        LandmarkOffer offer,
        FromProto(message.offers(i), absl::StrCat("correction.offers[", i, "]")));
    correction.offers.push_back(std::move(offer));
  }
  return correction;
}

std::vector<MapCorrection> SplitCorrection(const MapCorrection& correction, size_t max_submaps) {
  std::vector<MapCorrection> parts;
  size_t begin = 0;
  do {
    const size_t end = std::min(begin + max_submaps, correction.submaps.size());
    MapCorrection part;
    part.map_version = correction.map_version;
    part.submaps.assign(correction.submaps.begin() + static_cast<std::ptrdiff_t>(begin),
                        correction.submaps.begin() + static_cast<std::ptrdiff_t>(end));
    part.more = end < correction.submaps.size() || correction.more;
    parts.push_back(std::move(part));
    begin = end;
  } while (begin < correction.submaps.size());
  parts.front().offers = correction.offers;
  return parts;
}

}  // namespace portolan
