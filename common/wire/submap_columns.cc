#include "common/wire/submap_columns.h"

#include "absl/strings/str_cat.h"
#include "common/wire/column_codec.h"
#include "common/wire/covariance_factor.h"
#include "common/wire/geometry_wire.h"
#include "common/wire/submap_validation.h"

namespace portolan {
namespace {

constexpr int TriangleSize(int n) { return n * (n + 1) / 2; }

template <int N>
void AppendFactor(const Eigen::Matrix<double, N, N>& covariance,
                  google::protobuf::RepeatedField<float>* numbers) {
  // A valid submap's covariances have a factor.
  const auto factor = CovarianceFactor<N>(covariance);
  for (int i = 0; i < N; ++i) {
    for (int j = 0; j <= i; ++j) {
      numbers->Add(factor.has_value() ? static_cast<float>((*factor)(i, j)) : 0.0f);
    }
  }
}

// min_diagonal: every diagonal entry must be at least that.
template <int N>
StatusOr<Eigen::Matrix<double, N, N>> CovarianceAt(
    const google::protobuf::RepeatedField<float>& numbers, int index, double min_diagonal,
    absl::string_view what) {
  Eigen::Matrix<double, N, N> factor = Eigen::Matrix<double, N, N>::Zero();
  const float* number = numbers.data() + TriangleSize(N) * index;
  for (int i = 0; i < N; ++i) {
    for (int j = 0; j <= i; ++j) {
      factor(i, j) = *number++;
      // Written so that NaN fails.
      if (!(std::abs(factor(i, j)) <= kMaxFactor) || (i == j && !(factor(i, j) >= min_diagonal))) {
        return absl::InvalidArgumentError(
            absl::StrCat(what, "[", index, "]: not a covariance factor"));
      }
    }
  }
  return Eigen::Matrix<double, N, N>(factor * factor.transpose());
}

Status SizeMismatch(absl::string_view what, int size, int64_t expected) {
  return absl::InvalidArgumentError(
      absl::StrCat(what, ": ", size, " entries instead of ", expected));
}

}  // namespace

Status CheckCounts(const google::protobuf::RepeatedField<uint32_t>& counts, size_t keyframe_count,
                   size_t max_each, size_t max_sum, absl::string_view what) {
  if (static_cast<size_t>(counts.size()) != keyframe_count) {
    return SizeMismatch(what, counts.size(), static_cast<int64_t>(keyframe_count));
  }
  size_t sum = 0;
  for (const uint32_t count : counts) {
    sum += count;
    if (count > max_each || sum > max_sum) {
      return absl::InvalidArgumentError(
          absl::StrCat(what, ": above ", max_each, " in a keyframe or ", max_sum, " in all"));
    }
  }
  return absl::OkStatus();
}

StatusOr<std::vector<int64_t>> NamedColumn(std::string_view bytes, size_t count,
                                           absl::string_view what) {
  auto values = DecodeColumn(bytes, count);
  if (values.ok()) return values;
  return absl::InvalidArgumentError(absl::StrCat(what, ": ", values.status().message()));
}

std::optional<int64_t> AddWithin(int64_t a, int64_t b, int64_t limit) {
  int64_t sum = 0;
  if (__builtin_add_overflow(a, b, &sum) || sum > limit || sum < -limit) return std::nullopt;
  return sum;
}

void EncodeKeyframes(const std::vector<Keyframe>& keyframes, v1::KeyframeColumns* columns) {
  for (const Keyframe& keyframe : keyframes) {
    columns->add_time_ns(keyframe.time.count());
    AppendPose(keyframe.submap_from_camera, columns->mutable_submap_from_camera());
    AppendFactor<6>(keyframe.covariance, columns->mutable_covariance_factor());
  }
}

StatusOr<std::vector<Keyframe>> DecodeKeyframes(const v1::KeyframeColumns& columns) {
  const int n = columns.time_ns_size();
  if (n > static_cast<int>(kMaxKeyframes)) {
    return absl::InvalidArgumentError(
        absl::StrCat("submap.keyframes: ", n, " of them, not 1..", kMaxKeyframes));
  }
  if (columns.submap_from_camera_size() != kPoseNumbers * n) {
    return SizeMismatch("submap.keyframes.submap_from_camera", columns.submap_from_camera_size(),
                        kPoseNumbers * n);
  }
  if (columns.covariance_factor_size() != TriangleSize(6) * n) {
    return SizeMismatch("submap.keyframes.covariance_factor", columns.covariance_factor_size(),
                        TriangleSize(6) * n);
  }
  std::vector<Keyframe> keyframes(static_cast<size_t>(n));
  for (int i = 0; i < n; ++i) {
    Keyframe& keyframe = keyframes[static_cast<size_t>(i)];
    keyframe.time = Timestamp(columns.time_ns(i));
    PORTOLAN_ASSIGN_OR_RETURN(keyframe.submap_from_camera,
                              PoseAt(columns.submap_from_camera(), i,
                                     absl::StrCat("submap.keyframes[", i, "].submap_from_camera")));
    PORTOLAN_ASSIGN_OR_RETURN(
        keyframe.covariance,
        CovarianceAt<6>(columns.covariance_factor(), i, 0.0, "submap.keyframes.covariance_factor"));
  }
  return keyframes;
}

void EncodeLandmarks(const std::vector<SubmapLandmark>& landmarks, v1::LandmarkColumns* columns) {
  uint32_t previous = 0;
  for (const SubmapLandmark& landmark : landmarks) {
    columns->add_track_delta(landmark.track.value() - previous);
    previous = landmark.track.value();
    for (int i = 0; i < 3; ++i) {
      columns->add_point_in_submap(static_cast<float>(landmark.point_in_submap[i]));
    }
    AppendFactor<3>(landmark.covariance, columns->mutable_covariance_factor());
  }
}

StatusOr<std::vector<SubmapLandmark>> DecodeLandmarks(const v1::LandmarkColumns& columns) {
  const int m = columns.track_delta_size();
  if (m > static_cast<int>(kMaxLandmarks)) {
    return absl::InvalidArgumentError(absl::StrCat("submap.landmarks: more than ", kMaxLandmarks));
  }
  if (columns.point_in_submap_size() != 3 * m) {
    return SizeMismatch("submap.landmarks.point_in_submap", columns.point_in_submap_size(), 3 * m);
  }
  if (columns.covariance_factor_size() != TriangleSize(3) * m) {
    return SizeMismatch("submap.landmarks.covariance_factor", columns.covariance_factor_size(),
                        TriangleSize(3) * m);
  }
  std::vector<SubmapLandmark> landmarks(static_cast<size_t>(m));
  uint64_t track = 0;
  for (int i = 0; i < m; ++i) {
    SubmapLandmark& landmark = landmarks[static_cast<size_t>(i)];
    track += columns.track_delta(i);
    if (track > UINT32_MAX) {
      return absl::InvalidArgumentError("submap.landmarks.track_delta: id above 2^32 - 1");
    }
    landmark.track = TrackId(static_cast<uint32_t>(track));
    for (int k = 0; k < 3; ++k) landmark.point_in_submap[k] = columns.point_in_submap(3 * i + k);
    PORTOLAN_ASSIGN_OR_RETURN(landmark.covariance,
                              CovarianceAt<3>(columns.covariance_factor(), i, kMinLandmarkFactor,
                                              "submap.landmarks.covariance_factor"));
  }
  return landmarks;
}

}  // namespace portolan
