// The joint state of camera motion and landmarks with its covariance.
#ifndef PORTOLAN_AGENT_FILTER_FILTER_STATE_H_
#define PORTOLAN_AGENT_FILTER_FILTER_STATE_H_

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "agent/filter/landmark.h"
#include "agent/filter/motion_model.h"

namespace portolan {

// A camera position from which landmarks were first seen. Landmarks of one frame share it.
struct Anchor {
  Eigen::Vector3d position_in_submap = Eigen::Vector3d::Zero();
  // Its block of the error state, or kFixed if the position is exactly known (submap origin).
  int block = -1;
  // Rays that use it; 0 means that the entry is free.
  int users = 0;
};

// Error state: the motion model's error, then blocks of three, one a landmark and one an anchor
// whose position is uncertain, in no particular order: a removed block is replaced by the last
// one. The covariance is stored whole and symmetric in a matrix of the largest size, allocated
// once. Thread-compatible.
//
// Landmarks may be made passive: updates then leave their rows of the covariance as they are and
// remember what they would have done, until Expand (Guivant & Nebot, "Optimization of the
// Simultaneous Localization and Map-Building Algorithm for Real-Time Implementation", T-RA 2001;
// README.md). All methods that need the passive rows expand by themselves. What reads covariance()
// directly sees passive rows as they were.
class FilterState {
 public:
  static constexpr int kFixed = -1;

  FilterState(std::unique_ptr<MotionModel> motion, int max_landmarks);

  // Drops all landmarks; pose identity and exactly known.
  void Start(Timestamp time, double scene_depth);
  // Propagates the motion; false if time does not advance.
  bool Predict(Timestamp time, double scene_depth);
  // Adds extra process noise: (factor - 1) times that of the last Predict.
  void InflateLastNoise(double factor);
  // Adds an error to every part of the state.
  void Correct(const Eigen::Ref<const Eigen::VectorXd>& error);

  // Opens an anchor at the camera's position; rays are added to it by AddRay. An anchor that no
  // ray uses is dropped by the caller with ReleaseUnusedAnchor.
  int AddAnchor();
  // The inverse depth's error is d_depth_d_state (of a leading part of the state; may be empty)
  // times the state's, plus an own one of the given variance.
  void AddRay(const NewRay& ray, int anchor, double pixel_variance, double inverse_depth_variance,
              const Eigen::RowVectorXd& d_depth_d_state = Eigen::RowVectorXd());
  void ReleaseUnusedAnchor(int anchor);
  void RemoveLandmark(int index);
  // Turns a ray into a point.
  void ConvertToEuclidean(int index);
  // The camera becomes the submap frame; no anchors remain. Returns old_from_new.
  Rigid3 Rebase();
  // Chooses the unit of length such that the quantity whose derivative is given is exactly known:
  // errors become those left after scaling the whole state (an S-transformation). The estimate
  // does not change; nothing happens where the motion model measures lengths. d_log: 1 for a common
  // growth of all inverse lengths.
  void FixScale(const Eigen::RowVectorXd& d_log);
  // Another estimate: the motion corrected by an error, and these rays for all landmarks. An
  // anchor's block is kFixed or its own, after those of the landmarks in their order; the
  // covariance has the same layout.
  struct RayEstimates {
    std::vector<Landmark> landmarks;
    std::vector<Anchor> anchors;
    Eigen::MatrixXd covariance;
  };
  void Restate(const Eigen::VectorXd& motion_error, const RayEstimates& rays);
  // Another motion model; landmarks and covariance are carried over in the new units.
  void ChangeMotion(std::unique_ptr<MotionModel> motion, const MotionChange& change);
  // Another motion model with nothing carried over; to be followed by Start.
  void ResetMotion(std::unique_ptr<MotionModel> motion);

  // Makes these landmarks (by index, Euclidean ones only) passive and all others active.
  void SetPassive(const std::vector<bool>& passive);
  // Makes one passive landmark active, by index; much cheaper than Expand.
  void Activate(int index);
  // Brings the passive rows up to date and makes all landmarks active.
  void Expand();
  bool IsPassive(const Landmark& landmark) const { return landmark.block >= active_blocks(); }
  int passive_count() const { return passive_blocks_; }
  // An update of the active part by rows H, with W = L^-1 H P (active columns) and w = L^-1 v:
  // moves the passive landmarks and books the rest. `whitened_rows` is L^-1 H F with F the factor
  // below.
  void UpdatePassive(const Eigen::Ref<const Eigen::MatrixXd>& half_gain,
                     const Eigen::Ref<const Eigen::MatrixXd>& whitened_rows,
                     const Eigen::Ref<const Eigen::VectorXd>& whitened_innovation);
  // F: the covariance of active with passive is F times what is stored.
  auto passive_factor() const { return factor_.topLeftCorner(active_dim(), active_dim()); }
  // The whole covariance, up to date. Slow; for checks.
  Eigen::MatrixXd ExpandedCovariance() const;

  const MotionModel& motion() const { return *motion_; }
  MotionModel& motion() { return *motion_; }
  const std::vector<Landmark>& landmarks() const { return landmarks_; }
  bool full() const { return static_cast<int>(landmarks_.size()) >= max_landmarks_; }
  // Index of the track in landmarks(), or -1.
  int Find(TrackId track) const;
  // Position of the landmark's anchor; zero for a Euclidean one.
  Eigen::Vector3d AnchorPosition(const Landmark& landmark) const;
  // First row of the landmark's error, and of its anchor's (kFixed if it has no block).
  int Offset(const Landmark& landmark) const { return BlockOffset(landmark.block); }
  int AnchorOffset(const Landmark& landmark) const;
  // Joint covariance of a landmark and its anchor as a point.
  Eigen::Matrix3d PointCovariance(const Landmark& landmark) const;

  int dim() const { return motion_dim_ + 3 * static_cast<int>(owners_.size()); }
  int motion_dim() const { return motion_dim_; }
  int max_dim() const { return static_cast<int>(covariance_.rows()); }
  // Rows of the motion and of all that is not passive: they come first.
  int active_dim() const { return dim() - 3 * passive_blocks_; }
  auto active_covariance() const { return covariance_.topLeftCorner(active_dim(), active_dim()); }
  auto active_covariance() { return covariance_.topLeftCorner(active_dim(), active_dim()); }
  auto covariance() const { return covariance_.topLeftCorner(dim(), dim()); }
  auto covariance() { return covariance_.topLeftCorner(dim(), dim()); }
  // Symmetric and without a negative variance or eigenvalue beyond rounding. Slow; for checks.
  bool IsCovarianceValid() const;

 private:
  struct Owner {
    bool is_anchor = false;
    int index = 0;
  };

  int BlockOffset(int block) const { return motion_dim_ + 3 * block; }
  int active_blocks() const { return static_cast<int>(owners_.size()) - passive_blocks_; }
  void SwapBlocks(int a, int b);
  void ExpandInto(Eigen::MatrixXd* covariance) const;
  int AppendBlock(Owner owner);
  void RemoveBlock(int block);
  void MirrorRows(int offset);
  bool PoseIsExact() const;

  std::unique_ptr<MotionModel> motion_;
  const int max_landmarks_;
  int motion_dim_;
  std::vector<Landmark> landmarks_;
  std::vector<Anchor> anchors_;
  std::vector<Owner> owners_;
  // The last blocks are passive. Their columns and rows of the true covariance are, of what is
  // stored: P_ap = F P_ap0, P_pp = P_pp0 - P_ap0' G P_ap0.
  int passive_blocks_ = 0;
  Eigen::MatrixXd factor_;     // F
  Eigen::MatrixXd reduction_;  // G
  Eigen::MatrixXd covariance_;
  Eigen::MatrixXd scratch_;
  MotionModel::MotionMatrix transition_;
  MotionModel::MotionMatrix noise_;
};

}  // namespace portolan

#endif  // PORTOLAN_AGENT_FILTER_FILTER_STATE_H_
