// What a refined submap's observations tell of the poses of its keyframes, as Fisher information
// with the landmarks eliminated.
#ifndef PORTOLAN_SERVER_REDUNDANCY_SUBMAP_INFORMATION_H_
#define PORTOLAN_SERVER_REDUNDANCY_SUBMAP_INFORMATION_H_

#include <Eigen/Core>
#include <algorithm>
#include <optional>
#include <vector>

#include "server/refinement/refined_submap.h"

namespace portolan {

// What a submap's joint adjustments go on with.
struct SubmapChoice {
  std::vector<bool> keyframes;  // parallel to raw->keyframes
  std::vector<bool> landmarks;  // parallel to landmarks

  static SubmapChoice Everything(const RefinedSubmap& submap) {
    return {std::vector<bool>(submap.raw->keyframes.size(), true),
            std::vector<bool>(submap.landmarks.size(), true)};
  }
  bool IsEverything() const {
    const auto all = [](const std::vector<bool>& chosen) {
      return std::find(chosen.begin(), chosen.end(), false) == chosen.end();
    };
    return all(keyframes) && all(landmarks);
  }
};

// Immutable. Keyframe 0 is the gauge, and the scale is held: the distances of the keyframes in
// `ends` from it (any others would do: no observation tells the scale). Points without parallax
// have a depth prior as wide as the scene is deep.
class SubmapInformation {
 public:
  struct View {
    int keyframe = 0;
    Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
    Eigen::Matrix<double, 2, 6> d_camera = Eigen::Matrix<double, 2, 6>::Zero();  // in sigmas
    Eigen::Matrix<double, 2, 3> d_point = Eigen::Matrix<double, 2, 3>::Zero();
  };
  struct Track {
    double depth_information = 0;  // of the prior on the inverse depth, the last coordinate
    std::vector<View> views;       // ascending keyframe; agreeing ones only
  };

  // Observations whose squared error in sigmas is under agreeing_chi2 count.
  SubmapInformation(const RefinedSubmap& submap, const std::vector<int>& ends,
                    double agreeing_chi2);

  const std::vector<Track>& tracks() const { return tracks_; }  // parallel to the landmarks
  // The poses are, from everything.
  bool is_determined() const { return !all_log_determinants_.empty(); }

  // A track tells of the poses only if so many chosen keyframes see it.
  static constexpr int kMinViews = 2;
  static int ViewCount(const Track& track, const std::vector<bool>& keyframes);

  // Information of a track's point, its views in chosen keyframes from known poses.
  Eigen::Matrix3d PointInformation(const Track& track, const std::vector<bool>& keyframes) const;

  // On the poses of the chosen keyframes but the first, six rows each, from the chosen landmarks'
  // views in them.
  Eigen::MatrixXd PoseInformation(const SubmapChoice& choice) const;

  // The share of the information on its poses that a choice keeps, that of the pose that loses
  // most: of a pose, the others unknown, it is the geometric mean over its six directions of the
  // variance from everything over that from the choice. No value if the poses are not determined.
  std::optional<double> Share(const SubmapChoice& choice) const;

  // How much of the pose information a track is: trace(covariance * its information), of the sum of
  // all, which is six a pose; zero with fewer than kMinViews. `covariance` is the inverse of
  // PoseInformation(choice).
  double Leverage(size_t track, const SubmapChoice& choice,
                  const Eigen::MatrixXd& covariance) const;

 private:
  static constexpr int kNoRow = -1;

  void AddViews(const RefinedSubmap& submap, double agreeing_chi2);
  void HoldScale(const RefinedSubmap& submap, const std::vector<int>& ends);
  // First row of each keyframe's pose; kNoRow for the first and for those not chosen.
  static std::vector<int> RowsOf(const std::vector<bool>& keyframes);
  // Of the covariance of each chosen pose but the first, by keyframe; empty if not determined.
  std::vector<double> LogDeterminants(const SubmapChoice& choice) const;

  std::vector<Track> tracks_;
  Eigen::VectorXd scale_direction_;  // over all poses but the first
  double median_depth_ = 1;
  // From everything, to compare with.
  std::vector<double> all_log_determinants_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_REDUNDANCY_SUBMAP_INFORMATION_H_
