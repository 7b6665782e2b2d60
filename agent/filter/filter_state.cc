#include "agent/filter/filter_state.h"

#include <utility>

#include "common/base/check.h"
#include "common/linear_algebra/dense.h"

namespace portolan {

FilterState::FilterState(std::unique_ptr<MotionModel> motion, int max_landmarks)
    : motion_(std::move(motion)),
      max_landmarks_(max_landmarks),
      motion_dim_(motion_->error_dim()),
      // Every landmark may have an anchor of its own, plus one that is being opened. Whatever the
      // motion model, another one may follow.
      covariance_(Eigen::MatrixXd::Zero(MotionModel::kMaxDim + 6 * max_landmarks + 3,
                                        MotionModel::kMaxDim + 6 * max_landmarks + 3)),
      scratch_(covariance_) {
  landmarks_.reserve(max_landmarks);
  anchors_.reserve(max_landmarks + 1);
  owners_.reserve(2 * max_landmarks + 1);
}

void FilterState::Start(Timestamp time, double scene_depth) {
  landmarks_.clear();
  anchors_.clear();
  owners_.clear();
  passive_blocks_ = 0;
  motion_->Start(time, scene_depth, &transition_);
  noise_.setZero(motion_dim_, motion_dim_);
  covariance() = transition_;
}

bool FilterState::Predict(Timestamp time, double scene_depth) {
  if (!motion_->Predict(time, scene_depth, &transition_, &noise_)) return false;
  const int rest = active_dim() - motion_dim_;
  auto motion_block = covariance_.topLeftCorner(motion_dim_, motion_dim_);
  MotionModel::MotionMatrix half(motion_dim_, motion_dim_);
  SetToProduct(transition_, motion_block, half);
  motion_block = noise_;
  AddProductTransposed(1, half, transition_, motion_block);
  Symmetrise(motion_block);
  auto cross = covariance_.block(motion_dim_, 0, rest, motion_dim_);
  auto scratch = scratch_.topLeftCorner(rest, motion_dim_);
  SetToProductTransposed(cross, transition_, scratch);
  cross = scratch;
  covariance_.block(0, motion_dim_, motion_dim_, rest) = scratch.transpose();
  if (passive_blocks_ > 0) {
    auto rows = factor_.topLeftCorner(motion_dim_, active_dim());
    rows = Product(transition_, rows);
  }
  return true;
}

void FilterState::InflateLastNoise(double factor) {
  covariance_.topLeftCorner(motion_dim_, motion_dim_) += (factor - 1) * noise_;
}

void FilterState::Correct(const Eigen::Ref<const Eigen::VectorXd>& error) {
  motion_->Correct(error.head(motion_dim_));
  for (Landmark& landmark : landmarks_) {
    if (!IsPassive(landmark)) landmark.Correct(error.segment<3>(Offset(landmark)));
  }
  for (Anchor& anchor : anchors_) {
    if (anchor.users > 0 && anchor.block != kFixed) {
      anchor.position_in_submap += error.segment<3>(BlockOffset(anchor.block));
    }
  }
}

int FilterState::Find(TrackId track) const {
  for (size_t i = 0; i < landmarks_.size(); ++i) {
    if (landmarks_[i].track == track) return static_cast<int>(i);
  }
  return -1;
}

Eigen::Vector3d FilterState::AnchorPosition(const Landmark& landmark) const {
  return landmark.anchor < 0 ? Eigen::Vector3d(Eigen::Vector3d::Zero())
                             : anchors_[landmark.anchor].position_in_submap;
}

int FilterState::AnchorOffset(const Landmark& landmark) const {
  if (landmark.anchor < 0 || anchors_[landmark.anchor].block == kFixed) return kFixed;
  return BlockOffset(anchors_[landmark.anchor].block);
}

Eigen::Matrix3d FilterState::PointCovariance(const Landmark& landmark) const {
  const int offset = Offset(landmark);
  Eigen::Matrix3d own = covariance_.block<3, 3>(offset, offset);
  if (IsPassive(landmark)) {
    const int n = active_dim();
    const auto cross = covariance_.block(0, offset, n, 3);
    AddTransposedProduct(-1, cross, Product(reduction_.topLeftCorner(n, n), cross), own);
  }
  if (landmark.euclidean) return own;
  Eigen::Matrix3d d_point_d_ray;
  PointOfRay(landmark, AnchorPosition(landmark), &d_point_d_ray);
  Eigen::Matrix3d result = d_point_d_ray * own * d_point_d_ray.transpose();
  const int anchor = AnchorOffset(landmark);
  if (anchor != kFixed) {
    const Eigen::Matrix3d cross = d_point_d_ray * covariance_.block<3, 3>(offset, anchor);
    result += cross + cross.transpose() + covariance_.block<3, 3>(anchor, anchor);
  }
  return result;
}

int FilterState::AppendBlock(Owner owner) {
  PORTOLAN_CHECK(dim() + 3 <= max_dim());
  owners_.push_back(owner);
  return static_cast<int>(owners_.size()) - 1;
}

void FilterState::RemoveBlock(int block) {
  const int last = static_cast<int>(owners_.size()) - 1;
  if (block != last) {
    const int to = BlockOffset(block), from = BlockOffset(last), n = dim();
    covariance_.block(0, to, n, 3) = covariance_.block(0, from, n, 3);
    covariance_.block(to, 0, 3, n) = covariance_.block(from, 0, 3, n);
    covariance_.block<3, 3>(to, to) = covariance_.block<3, 3>(from, from);
    owners_[block] = owners_[last];
    const Owner& moved = owners_[block];
    (moved.is_anchor ? anchors_[moved.index].block : landmarks_[moved.index].block) = block;
  }
  owners_.pop_back();
}

void FilterState::MirrorRows(int offset) {
  covariance_.block(0, offset, offset, 3) = covariance_.block(offset, 0, 3, offset).transpose();
}

bool FilterState::PoseIsExact() const {
  return covariance_.diagonal().head<MotionModel::kPoseDim>().maxCoeff() <= 0;
}

int FilterState::AddAnchor() {
  Expand();
  int index = 0;
  while (index < static_cast<int>(anchors_.size()) && anchors_[index].users > 0) ++index;
  if (index == static_cast<int>(anchors_.size())) anchors_.emplace_back();
  Anchor& anchor = anchors_[index];
  anchor = Anchor{motion_->submap_from_camera().translation, kFixed, 0};
  if (PoseIsExact()) return index;

  const int n = dim();
  anchor.block = AppendBlock({true, index});
  const Eigen::Matrix<double, 3, 6> d_anchor_d_pose = motion_->DCameraDPose().topRows<3>();
  auto rows = covariance_.block(n, 0, 3, n);
  SetToProduct(d_anchor_d_pose, covariance_.topLeftCorner(6, n), rows);
  SetToProductTransposed(rows.leftCols(6), d_anchor_d_pose, covariance_.block(n, n, 3, 3));
  MirrorRows(n);
  return index;
}

void FilterState::AddRay(const NewRay& ray, int anchor, double pixel_variance,
                         double inverse_depth_variance, const Eigen::RowVectorXd& d_depth_d_state) {
  Expand();
  const int n = dim();
  Landmark landmark = ray.landmark;
  landmark.anchor = anchor;
  landmark.block = AppendBlock({false, static_cast<int>(landmarks_.size())});
  landmarks_.push_back(landmark);
  ++anchors_[anchor].users;

  const Eigen::Matrix<double, 2, 6> d_ray_d_pose =
      ray.d_ray_d_orientation * motion_->DCameraDPose().bottomRows<3>();
  auto rows = covariance_.block(n, 0, 3, n + 3);
  rows.setZero();
  AddProduct(1, d_ray_d_pose, covariance_.topLeftCorner(6, n), rows.topLeftCorner(2, n));
  AddProductTransposed(1, rows.topLeftCorner(2, 6), d_ray_d_pose, rows.block(0, n, 2, 2));
  AddProductTransposed(pixel_variance, ray.d_ray_d_pixel, ray.d_ray_d_pixel,
                       rows.block(0, n, 2, 2));
  const auto m = d_depth_d_state.size();
  if (m > 0) {
    const Eigen::VectorXd depth = d_depth_d_state.transpose();
    rows.row(2).head(n) = TransposedProduct(covariance_.topLeftCorner(m, n), depth).transpose();
    AddProduct(1, rows.topLeftCorner(3, m), depth, rows.col(n + 2));
    rows.block<1, 2>(2, n) = rows.block<2, 1>(0, n + 2).transpose();
  }
  rows(2, n + 2) += inverse_depth_variance;
  MirrorRows(n);
}

void FilterState::ReleaseUnusedAnchor(int anchor) {
  if (anchors_[anchor].users > 0) return;
  Expand();
  if (anchors_[anchor].block != kFixed) RemoveBlock(anchors_[anchor].block);
  anchors_[anchor].block = kFixed;
}

void FilterState::RemoveLandmark(int index) {
  Expand();
  const int anchor = landmarks_[index].anchor;
  RemoveBlock(landmarks_[index].block);
  const int last = static_cast<int>(landmarks_.size()) - 1;
  if (index != last) {
    landmarks_[index] = landmarks_[last];
    owners_[landmarks_[index].block].index = index;
  }
  landmarks_.pop_back();
  if (anchor >= 0) {
    --anchors_[anchor].users;
    ReleaseUnusedAnchor(anchor);
  }
}

void FilterState::ConvertToEuclidean(int index) {
  Expand();
  Landmark& landmark = landmarks_[index];
  const int offset = Offset(landmark), n = dim();
  const int anchor_offset = AnchorOffset(landmark);
  Eigen::Matrix3d d_point_d_ray;
  landmark.point_in_submap = PointOfRay(landmark, AnchorPosition(landmark), &d_point_d_ray);

  auto rows = scratch_.topLeftCorner(3, n);
  SetToProduct(d_point_d_ray, covariance_.block(offset, 0, 3, n), rows);
  if (anchor_offset != kFixed) rows += covariance_.block(anchor_offset, 0, 3, n);
  Eigen::Matrix3d own = ProductTransposed(rows.middleCols(offset, 3), d_point_d_ray);
  if (anchor_offset != kFixed) own += rows.block<3, 3>(0, anchor_offset);
  covariance_.block(offset, 0, 3, n) = rows;
  covariance_.block(0, offset, n, 3) = rows.transpose();
  Symmetrise(own);
  covariance_.block<3, 3>(offset, offset) = own;

  landmark.euclidean = true;
  const int anchor = std::exchange(landmark.anchor, -1);
  if (anchor >= 0) {
    --anchors_[anchor].users;
    ReleaseUnusedAnchor(anchor);
  }
}

Rigid3 FilterState::Rebase() {
  Expand();
  // New error = J * old error with three column groups a landmark; first T = J P by rows, then
  // P' = T J' by columns, in the scratch matrix.
  const Rigid3 submap_from_camera = motion_->submap_from_camera();
  const Matrix6d d_camera_d_pose = motion_->DCameraDPose();
  const int n = dim(), count = static_cast<int>(landmarks_.size());
  const int new_dim = motion_dim_ + 3 * count;
  struct Part {
    int offset, anchor_offset;
    Eigen::Matrix<double, 3, 6> d_pose;
    Eigen::Matrix3d d_landmark, d_anchor;
  };
  std::vector<Part> parts;
  parts.reserve(count);
  for (Landmark& landmark : landmarks_) {
    const int block = static_cast<int>(parts.size());
    RebasedLandmark rebased =
        RebaseLandmark(landmark, AnchorPosition(landmark), submap_from_camera);
    parts.push_back({Offset(landmark), AnchorOffset(landmark),
                     rebased.d_landmark_d_camera * d_camera_d_pose, rebased.d_landmark_d_landmark,
                     rebased.d_landmark_d_anchor});
    landmark = rebased.landmark;
    landmark.block = block;
  }
  MotionModel::MotionMatrix d_motion;
  const Rigid3 old_from_new = motion_->Rebase(&d_motion);

  auto half = scratch_.topLeftCorner(new_dim, n);
  SetToProduct(d_motion, covariance_.topLeftCorner(motion_dim_, n), half.topRows(motion_dim_));
  for (int i = 0; i < count; ++i) {
    const Part& part = parts[i];
    MatrixView rows = half.middleRows(motion_dim_ + 3 * i, 3);
    SetToProduct(part.d_pose, covariance_.topLeftCorner(6, n), rows);
    AddProduct(1, part.d_landmark, covariance_.block(part.offset, 0, 3, n), rows);
    if (part.anchor_offset != kFixed) {
      AddProduct(1, part.d_anchor, covariance_.block(part.anchor_offset, 0, 3, n), rows);
    }
  }
  auto result = covariance_.topLeftCorner(new_dim, new_dim);
  SetToProductTransposed(half.leftCols(motion_dim_), d_motion, result.leftCols(motion_dim_));
  for (int i = 0; i < count; ++i) {
    const Part& part = parts[i];
    MatrixView columns = result.middleCols(motion_dim_ + 3 * i, 3);
    SetToProductTransposed(half.leftCols(6), part.d_pose, columns);
    AddProductTransposed(1, half.middleCols(part.offset, 3), part.d_landmark, columns);
    if (part.anchor_offset != kFixed) {
      AddProductTransposed(1, half.middleCols(part.anchor_offset, 3), part.d_anchor, columns);
    }
  }
  Symmetrise(result);

  owners_.clear();
  for (int i = 0; i < count; ++i) owners_.push_back({false, i});
  // Every ray now starts in the origin, which anchor 0 stands for.
  anchors_.assign(1, Anchor{Eigen::Vector3d::Zero(), kFixed, 0});
  for (Landmark& landmark : landmarks_) {
    if (landmark.euclidean) continue;
    landmark.anchor = 0;
    ++anchors_[0].users;
  }
  return old_from_new;
}

void FilterState::FixScale(const Eigen::RowVectorXd& d_log) {
  Expand();
  // By the logarithm of all inverse lengths.
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(dim());
  if (!motion_->FillScaleDirection(direction.head(motion_dim_))) return;
  for (const Landmark& landmark : landmarks_) {
    if (landmark.euclidean) {
      direction.segment<3>(Offset(landmark)) = -landmark.point_in_submap;
    } else {
      direction[Offset(landmark) + 2] = landmark.inverse_depth;
    }
  }
  for (const Anchor& anchor : anchors_) {
    if (anchor.users == 0 || anchor.block == kFixed) continue;
    direction.segment<3>(BlockOffset(anchor.block)) = -anchor.position_in_submap;
  }
  direction /= d_log.dot(direction);
  // P' = T P T' with T = I - direction d_log.
  const Eigen::VectorXd column = Product(covariance(), d_log.transpose());
  const double variance = d_log.dot(column);
  auto p = covariance();
  AddProductTransposed(-1, direction, column, p);
  AddProductTransposed(-1, column, direction, p);
  AddProductTransposed(variance, direction, direction, p);
  Symmetrise(p);
}

void FilterState::Restate(const Eigen::VectorXd& motion_error, const RayEstimates& rays) {
  passive_blocks_ = 0;
  motion_->Correct(motion_error);
  landmarks_ = rays.landmarks;
  anchors_ = rays.anchors;
  owners_.assign((rays.covariance.rows() - motion_dim_) / 3, {true, 0});
  for (size_t i = 0; i < landmarks_.size(); ++i) {
    landmarks_[i].block = static_cast<int>(i);
    owners_[i] = {false, static_cast<int>(i)};
    ++anchors_[landmarks_[i].anchor].users;
  }
  for (size_t i = 0; i < anchors_.size(); ++i) {
    if (anchors_[i].block != kFixed) owners_[anchors_[i].block].index = static_cast<int>(i);
  }
  covariance() = rays.covariance;
  Symmetrise(covariance());
}

void FilterState::ChangeMotion(std::unique_ptr<MotionModel> motion, const MotionChange& change) {
  Expand();
  const int old_dim = motion_dim_, new_dim = motion->error_dim(), rest = dim() - old_dim;
  // Of the landmarks' and anchors' errors: factor, and derivative by the log scale.
  Eigen::VectorXd factor = Eigen::VectorXd::Constant(rest, change.scale);
  Eigen::VectorXd d_scale = Eigen::VectorXd::Zero(rest);
  for (Landmark& landmark : landmarks_) {
    const int row = Offset(landmark) - old_dim;
    landmark.point_in_submap *= change.scale;
    landmark.inverse_depth /= change.scale;
    if (landmark.euclidean) {
      d_scale.segment<3>(row) = landmark.point_in_submap;
    } else {
      factor.segment<3>(row) << 1, 1, 1 / change.scale;
      d_scale[row + 2] = -landmark.inverse_depth;
    }
  }
  for (Anchor& anchor : anchors_) {
    if (anchor.users == 0) continue;
    anchor.position_in_submap *= change.scale;
    if (anchor.block != kFixed) {
      d_scale.segment<3>(BlockOffset(anchor.block) - old_dim) = anchor.position_in_submap;
    }
  }
  Eigen::MatrixXd by_old = Eigen::MatrixXd::Zero(new_dim + rest, old_dim + rest);
  by_old.topLeftCorner(new_dim, old_dim) = change.d_new_d_old;
  by_old.bottomRightCorner(rest, rest).diagonal() = factor;
  Eigen::MatrixXd by_added = Eigen::MatrixXd::Zero(new_dim + rest, change.added_covariance.cols());
  by_added.topRows(new_dim) = change.d_new_d_added;
  by_added.col(0).tail(rest) = d_scale;
  Eigen::MatrixXd result =
      Congruence(by_old, covariance()) + Congruence(by_added, change.added_covariance);
  Symmetrise(result);
  motion_ = std::move(motion);
  motion_dim_ = new_dim;
  covariance() = result;
}

void FilterState::ResetMotion(std::unique_ptr<MotionModel> motion) {
  landmarks_.clear();
  anchors_.clear();
  owners_.clear();
  passive_blocks_ = 0;
  motion_ = std::move(motion);
  motion_dim_ = motion_->error_dim();
}

bool FilterState::IsCovarianceValid() const {
  const Eigen::MatrixXd p = ExpandedCovariance();
  if (!p.allFinite()) return false;
  const double scale = p.cwiseAbs().maxCoeff();
  if ((p - p.transpose()).cwiseAbs().maxCoeff() > 1e-12 * scale) return false;
  return DecomposeSymmetric(p).values.minCoeff() > -1e-9 * scale;
}

}  // namespace portolan
