#include "common/wire/offer_wire.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "common/wire/column_codec.h"
#include "common/wire/descriptor_codec.h"
#include "common/wire/geometry_wire.h"

namespace portolan {
namespace {

constexpr double kDirectionSteps = 2048;
constexpr int64_t kMaxDirection = int64_t{1} << 15;
constexpr double kDepthSteps = 512;
constexpr int64_t kMaxDepth = 60 * 512;
constexpr double kSigmaSteps = 4;
constexpr int64_t kMinSigma = -80, kMaxSigma = 40;

// Of the landmark before, from which the next one's differ.
struct Before {
  int64_t depth = 0;
  int64_t lateral_sigma = 0;
  int64_t depth_sigma = 0;
};

int64_t Rounded(double value) { return std::llround(value); }

int64_t SigmaSteps(double sigma) {
  // Smaller than the least is the least.
  return std::max(kMinSigma, Rounded(kSigmaSteps * std::log2(std::max(sigma, 1e-12))));
}

bool AreWithin(std::span<const int64_t> values, int64_t least, int64_t most) {
  for (const int64_t value : values) {
    if (value < least || value > most) return false;
  }
  return true;
}

StatusOr<std::vector<int64_t>> Column(const std::string& bytes, size_t count,
                                      absl::string_view what) {
  auto values = DecodeColumn(bytes, count);
  if (values.ok()) return values;
  return absl::InvalidArgumentError(absl::StrCat(what, ": ", values.status().message()));
}

}  // namespace

bool IsSendable(const OfferedLandmark& landmark) {
  const Eigen::Vector3d& point = landmark.point_in_camera;
  if (!point.allFinite() || !(point.z() > 0)) return false;
  const double depth = std::abs(std::log2(point.z()) * kDepthSteps);
  const double direction = kDirectionSteps * point.head<2>().cwiseAbs().maxCoeff() / point.z();
  const double limit = std::exp2(kMaxSigma / kSigmaSteps);
  return depth < kMaxDepth && direction < static_cast<double>(kMaxDirection) &&
         landmark.lateral_sigma > 0 && landmark.lateral_sigma < limit && landmark.depth_sigma > 0 &&
         landmark.depth_sigma < limit;
}

void ToProto(const LandmarkOffer& offer, v1::LandmarkOffer* message) {
  message->set_view_id(offer.view);
  message->set_component_id(offer.component.value());
  ToProto(offer.world_from_camera, message->mutable_world_from_camera());
  message->set_first_index(offer.first_index);
  message->set_count(static_cast<uint32_t>(offer.landmarks.size()));
  std::vector<int64_t> directions, depths, sigmas;
  std::vector<Descriptor> descriptors;
  Before before;
  for (const OfferedLandmark& landmark : offer.landmarks) {
    const Eigen::Vector3d& point = landmark.point_in_camera;
    directions.push_back(Rounded(kDirectionSteps * point.x() / point.z()));
    directions.push_back(Rounded(kDirectionSteps * point.y() / point.z()));
    const int64_t depth = Rounded(kDepthSteps * std::log2(point.z()));
    const int64_t lateral_sigma = SigmaSteps(landmark.lateral_sigma);
    const int64_t depth_sigma = SigmaSteps(landmark.depth_sigma);
    depths.push_back(depth - std::exchange(before.depth, depth));
    sigmas.push_back(lateral_sigma - std::exchange(before.lateral_sigma, lateral_sigma));
    sigmas.push_back(depth_sigma - std::exchange(before.depth_sigma, depth_sigma));
    descriptors.push_back(landmark.descriptor);
  }
  message->set_direction(EncodeColumn(directions));
  message->set_depth(EncodeColumn(depths));
  message->set_sigma(EncodeColumn(sigmas));
  message->set_coded_descriptors(EncodeDescriptors(
      descriptors, std::vector<DescriptorReferences>(descriptors.size(), {-1, -1})));
}

StatusOr<LandmarkOffer> FromProto(const v1::LandmarkOffer& message, absl::string_view what) {
  const auto malformed = [what](absl::string_view problem) {
    return absl::InvalidArgumentError(absl::StrCat(what, ".", problem));
  };
  LandmarkOffer offer;
  offer.view = message.view_id();
  offer.component = ComponentId(message.component_id());
  offer.first_index = message.first_index();
  if (message.view_id() == 0) return malformed("view_id: zero");
  if (message.component_id() <= 0) return malformed("component_id: not positive");
  if (message.first_index() > kMaxOfferFirstIndex) return malformed("first_index: too large");
  const size_t count = message.count();
  if (count > kMaxLandmarksPerOffer) return malformed("count: too many landmarks");
  PORTOLAN_ASSIGN_OR_RETURN(
      offer.world_from_camera,
      FromProto(message.world_from_camera(), absl::StrCat(what, ".world_from_camera")));
  PORTOLAN_ASSIGN_OR_RETURN(const auto directions, Column(message.direction(), 2 * count,
                                                          absl::StrCat(what, ".direction")));
  PORTOLAN_ASSIGN_OR_RETURN(const auto depths,
                            Column(message.depth(), count, absl::StrCat(what, ".depth")));
  PORTOLAN_ASSIGN_OR_RETURN(const auto sigmas,
                            Column(message.sigma(), 2 * count, absl::StrCat(what, ".sigma")));
  if (!AreWithin(directions, -kMaxDirection, kMaxDirection)) {
    return malformed("direction: out of range");
  }
  if (!AreWithin(depths, -2 * kMaxDepth, 2 * kMaxDepth)) return malformed("depth: out of range");
  if (!AreWithin(sigmas, kMinSigma - kMaxSigma, kMaxSigma - kMinSigma)) {
    return malformed("sigma: out of range");
  }
  auto descriptors =
      DecodeDescriptors(message.coded_descriptors(),
                        std::vector<DescriptorReferences>(count, DescriptorReferences{-1, -1}));
  if (!descriptors.ok()) {
    return malformed(absl::StrCat("coded_descriptors: ", descriptors.status().message()));
  }
  Before last;
  for (size_t i = 0; i < count; ++i) {
    last.depth += depths[i];
    last.lateral_sigma += sigmas[2 * i];
    last.depth_sigma += sigmas[2 * i + 1];
    if (std::abs(last.depth) > kMaxDepth) return malformed("depth: out of range");
    if (!AreWithin(std::array{last.lateral_sigma, last.depth_sigma}, kMinSigma, kMaxSigma)) {
      return malformed("sigma: out of range");
    }
    const double z = std::exp2(static_cast<double>(last.depth) / kDepthSteps);
    OfferedLandmark landmark;
    landmark.point_in_camera = {z * static_cast<double>(directions[2 * i]) / kDirectionSteps,
                                z * static_cast<double>(directions[2 * i + 1]) / kDirectionSteps,
                                z};
    landmark.lateral_sigma = std::exp2(static_cast<double>(last.lateral_sigma) / kSigmaSteps);
    landmark.depth_sigma = std::exp2(static_cast<double>(last.depth_sigma) / kSigmaSteps);
    landmark.descriptor = (*descriptors)[i];
    offer.landmarks.push_back(landmark);
  }
  return offer;
}

}  // namespace portolan
