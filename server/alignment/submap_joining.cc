#include "server/alignment/submap_joining.h"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <cmath>
#include <map>
#include <utility>

#include "common/linear_algebra/dense.h"

namespace portolan {
namespace {

class Joiner {
 public:
  Joiner(const SubmapJoiningOptions& options, const std::vector<SubmapGaussian>& submaps)
      : options_(options), submaps_(submaps) {}

  StatusOr<JoinedSubmaps> Run() {
    PORTOLAN_RETURN_IF_ERROR(Prepare());
    double chi2 = Chi2();
    for (; result_.iterations < options_.max_iterations; ++result_.iterations) {
      Linearize();
      const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(system_);
      if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 0)) {
        return absl::FailedPreconditionError("submap joining: the system is singular");
      }
      Apply(factor.solve(-gradient_));
      const double next = Chi2();
      const bool settled = std::abs(chi2 - next) <= options_.tolerance * (1 + chi2);
      chi2 = next;
      if (settled) break;
    }
    return Finish(chi2);
  }

 private:
  struct SharedPoint {
    int submap = 0;  // index among submaps_
    int place = 0;   // in its Gaussian
    int column = 0;  // of the landmark's unknowns
    int shared = 0;  // index among the shared landmarks
  };

  Status Prepare() {
    std::map<int, int> counts;
    for (const SubmapGaussian& submap : submaps_) {
      const Eigen::Index size = 3 * static_cast<Eigen::Index>(submap.landmarks.size());
      if (submap.points_in_submap.size() != submap.landmarks.size() ||
          submap.covariance.rows() != size || submap.covariance.cols() != size) {
        return absl::InvalidArgumentError("submap joining: sizes do not match");
      }
      for (const int landmark : submap.landmarks) ++counts[landmark];
      result_.world_from_submap.push_back(submap.world_from_submap);
      frame_columns_.push_back(columns_);
      if (frame_columns_.size() > 1) columns_ += submap.rigid ? 6 : 7;
    }
    if (submaps_.empty()) return absl::InvalidArgumentError("submap joining: no submap");
    for (const auto& [landmark, count] : counts) {
      if (count > 1) result_.landmarks.push_back(landmark);
    }
    first_landmark_column_ = columns_;
    columns_ += 3 * static_cast<int>(result_.landmarks.size());
    return CollectShared();
  }

  // The marginal of each submap on its shared landmarks; start values of the landmarks.
  Status CollectShared() {
    std::map<int, int> index;
    for (const int landmark : result_.landmarks) index.emplace(landmark, index.size());
    result_.points_in_world.assign(index.size(), Eigen::Vector3d::Zero());
    std::vector<int> counts(index.size(), 0);
    for (size_t i = 0; i < submaps_.size(); ++i) {
      std::vector<SharedPoint>& shared = shared_.emplace_back();
      for (size_t k = 0; k < submaps_[i].landmarks.size(); ++k) {
        const auto it = index.find(submaps_[i].landmarks[k]);
        if (it == index.end()) continue;
        shared.push_back({static_cast<int>(i), static_cast<int>(k),
                          first_landmark_column_ + 3 * it->second, it->second});
        result_.points_in_world[it->second] +=
            result_.world_from_submap[i] * submaps_[i].points_in_submap[k];
        ++counts[it->second];
      }
      PORTOLAN_RETURN_IF_ERROR(AddInformation(shared));
    }
    for (size_t i = 0; i < counts.size(); ++i) result_.points_in_world[i] /= counts[i];
    return absl::OkStatus();
  }

  Status AddInformation(const std::vector<SharedPoint>& shared) {
    const Eigen::Index size = 3 * static_cast<Eigen::Index>(shared.size());
    Eigen::MatrixXd marginal(size, size);
    for (size_t a = 0; a < shared.size(); ++a) {
      for (size_t b = 0; b < shared.size(); ++b) {
        marginal.block<3, 3>(3 * a, 3 * b) = submaps_[shared[a].submap].covariance.block<3, 3>(
            3 * shared[a].place, 3 * shared[b].place);
      }
    }
    Eigen::MatrixXd information = Eigen::MatrixXd::Identity(size, size);
    if (size > 0 && !SolvePositiveDefinite(marginal, information)) {
      return absl::InvalidArgumentError("submap joining: a covariance is not positive definite");
    }
    information_.push_back(std::move(information));
    return absl::OkStatus();
  }

  // submap_from_world * x - mean, for all shared points of submap i.
  Eigen::VectorXd Error(size_t i) const {
    const Similarity3 submap_from_world = result_.world_from_submap[i].Inverse();
    Eigen::VectorXd error(3 * shared_[i].size());
    for (size_t k = 0; k < shared_[i].size(); ++k) {
      const SharedPoint& point = shared_[i][k];
      error.segment<3>(3 * k) = submap_from_world * result_.points_in_world[point.shared] -
                                submaps_[i].points_in_submap[point.place];
    }
    return error;
  }

  double Chi2() const {
    double chi2 = 0;
    for (size_t i = 0; i < submaps_.size(); ++i) {
      const Eigen::VectorXd error = Error(i);
      chi2 += error.dot(information_[i] * error);
    }
    return chi2;
  }

  // Derivatives of the error of submap i with respect to its frame (right perturbation, S Exp(d):
  // the point in the submap, y, becomes Exp(-d) y) and to the landmarks.
  Eigen::MatrixXd Jacobian(size_t i, std::vector<int>* columns) const {
    const int frame_size = i == 0 ? 0 : (submaps_[i].rigid ? 6 : 7);
    const Similarity3 submap_from_world = result_.world_from_submap[i].Inverse();
    const Eigen::Matrix3d d_landmark =
        submap_from_world.scale * submap_from_world.rotation.toRotationMatrix();
    const Eigen::Index rows = 3 * static_cast<Eigen::Index>(shared_[i].size());
    Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(rows, frame_size + rows);
    for (int c = 0; c < frame_size; ++c) columns->push_back(frame_columns_[i] + c);
    for (size_t k = 0; k < shared_[i].size(); ++k) {
      const Eigen::Vector3d point =
          submap_from_world * result_.points_in_world[shared_[i][k].shared];
      Eigen::Matrix<double, 3, 7> d_frame;
      d_frame << -Eigen::Matrix3d::Identity(), Skew(point), -point;
      jacobian.block(3 * k, 0, 3, frame_size) = d_frame.leftCols(frame_size);
      jacobian.block<3, 3>(3 * k, frame_size + 3 * k) = d_landmark;
      for (int c = 0; c < 3; ++c) columns->push_back(shared_[i][k].column + c);
    }
    return jacobian;
  }

  void Linearize() {
    std::vector<Eigen::Triplet<double>> triplets;
    gradient_ = Eigen::VectorXd::Zero(columns_);
    for (size_t i = 0; i < submaps_.size(); ++i) {
      std::vector<int> columns;
      const Eigen::MatrixXd jacobian = Jacobian(i, &columns);
      const Eigen::MatrixXd weighted = TransposedProduct(jacobian, information_[i]);
      const Eigen::MatrixXd block = Product(weighted, jacobian);
      const Eigen::VectorXd part = Product(weighted, Error(i));
      for (size_t r = 0; r < columns.size(); ++r) {
        gradient_[columns[r]] += part[static_cast<Eigen::Index>(r)];
        for (size_t c = 0; c < columns.size(); ++c) {
          triplets.emplace_back(columns[r], columns[c], block(r, c));
        }
      }
    }
    system_.resize(columns_, columns_);
    system_.setFromTriplets(triplets.begin(), triplets.end());
  }

  void Apply(const Eigen::VectorXd& step) {
    for (size_t i = 1; i < submaps_.size(); ++i) {
      Vector7d tangent = Vector7d::Zero();
      const int size = submaps_[i].rigid ? 6 : 7;
      tangent.head(size) = step.segment(frame_columns_[i], size);
      result_.world_from_submap[i] = result_.world_from_submap[i] * Similarity3::Exp(tangent);
    }
    for (size_t i = 0; i < result_.points_in_world.size(); ++i) {
      result_.points_in_world[i] += step.segment<3>(first_landmark_column_ + 3 * i);
    }
  }

  StatusOr<JoinedSubmaps> Finish(double chi2) {
    Linearize();
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(system_);
    if (factor.info() != Eigen::Success) {
      return absl::FailedPreconditionError("submap joining: the system is singular");
    }
    const Eigen::Index landmark_columns = columns_ - first_landmark_column_;
    Eigen::MatrixXd units = Eigen::MatrixXd::Zero(columns_, landmark_columns);
    units.bottomRows(landmark_columns).setIdentity();
    result_.covariance = factor.solve(units).bottomRows(landmark_columns);
    result_.chi2 = chi2;
    int equations = 0;
    for (const auto& shared : shared_) equations += 3 * static_cast<int>(shared.size());
    result_.degrees_of_freedom = equations - columns_;
    return std::move(result_);
  }

  const SubmapJoiningOptions& options_;
  const std::vector<SubmapGaussian>& submaps_;
  JoinedSubmaps result_;
  std::vector<int> frame_columns_;
  int first_landmark_column_ = 0;
  int columns_ = 0;
  std::vector<std::vector<SharedPoint>> shared_;  // by submap
  std::vector<Eigen::MatrixXd> information_;      // by submap
  Eigen::SparseMatrix<double> system_;
  Eigen::VectorXd gradient_;
};

}  // namespace

StatusOr<JoinedSubmaps> JoinSubmaps(const SubmapJoiningOptions& options,
                                    const std::vector<SubmapGaussian>& submaps) {
  return Joiner(options, submaps).Run();
}

}  // namespace portolan
