#include "common/bundle/bundle_solver.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "common/bundle/bundle_solver_terms.h"
#include "common/bundle/camera_system.h"
#include "common/linear_algebra/packed_rows.h"

namespace portolan {
namespace {

using bundle_solver::Below;
using bundle_solver::Coupling;
using bundle_solver::Matrix63d;
using bundle_solver::PointTerms;
using bundle_solver::Term;
using bundle_solver::Unknowns;

// Damping relative to the diagonal, the least and the most.
constexpr double kMinDamping = 1e-12;
constexpr double kMaxDamping = 1e12;
// Of the diagonal that is damped, as the unknowns' scales are not known.
constexpr double kMinDiagonal = 1e-6;
constexpr double kMaxDiagonal = 1e32;

class Solver {
 public:
  Solver(const BundleOptions& options, const BundleProblem& problem,
         const std::atomic<bool>* interrupt, BundleParameters* parameters)
      : options_(options), problem_(problem), interrupt_(interrupt), parameters_(*parameters) {
    for (size_t i = 0; i < problem.cameras.size(); ++i) {
      const bool is_free = parameters_.cameras_used[i] && !problem.cameras[i].fixed;
      place_of_.push_back(is_free ? free_count_++ : -1);
    }
    // A lens has a block like a camera's, of which it uses three rows.
    block_count_ = free_count_ + static_cast<int>(problem.lenses.size());
    system_ = std::make_unique<CameraSystem>(block_count_, options.max_dense_cameras);
    diagonal_.resize(block_count_);
    lens_by_camera_.resize(free_count_);
    if (!system_->is_sparse()) {
      plain_.resize(6 * block_count_, 3);
      weighted_.resize(6 * block_count_, 3);
    }
    states_.resize(problem.cameras.size());
    CollectTerms(options, problem, parameters_, place_of_, &terms_, &points_);
  }

  BundleSolve Run() {
    BundleSolve result;
    if (terms_.empty()) return result;
    MoveStates();
    double cost = Linearize();
    result.initial_cost = result.final_cost = cost;
    if (!std::isfinite(cost)) return result;
    result.usable = true;
    double damping = options_.initial_damping;
    double growth = 2;
    bool is_linear = true;
    for (; result.iterations < options_.max_iterations; ++result.iterations) {
      if (interrupt_ != nullptr && *interrupt_) break;
      if (!is_linear) Linearize();
      is_linear = true;
      const Unknowns before = {parameters_.cameras, parameters_.points, parameters_.lenses};
      double expected = 0;
      const bool is_solved = Step(damping, &expected);
      const double next = is_solved ? Cost() : std::numeric_limits<double>::infinity();
      if (!(next <= cost)) {
        parameters_.cameras = before.cameras;
        parameters_.points = before.points;
        parameters_.lenses = before.lenses;
        damping *= growth;
        growth *= 2;
        if (damping > kMaxDamping) break;
        continue;
      }
      // Nielsen's rule: the better the linear model told the gain, the less damping.
      const double gain = expected > 0 ? (cost - next) / expected : 1;
      damping = std::max(kMinDamping, damping * std::max(1.0 / 3, 1 - std::pow(2 * gain - 1, 3)));
      growth = 2;
      const bool is_done = cost - next <= options_.function_tolerance * cost;
      cost = next;
      is_linear = false;
      if (is_done) {
        ++result.iterations;
        break;
      }
    }
    result.final_cost = cost;
    return result;
  }

  std::optional<LensMatrix> LensCovariance(int lens) {
    if (terms_.empty() || !std::isfinite(Cost())) return std::nullopt;
    Linearize();
    LensMatrix covariance;
    for (int i = 0; i < 3; ++i) {
      BuildSystem(kMinDamping);
      right_.setZero();
      right_[6 * PlaceOfLens(lens) + i] = 1;
      if (!system_->SolveInPlace(&right_)) return std::nullopt;
      covariance.col(i) = right_.segment<3>(6 * PlaceOfLens(lens));
    }
    return covariance;
  }

 private:
  int PlaceOfLens(int lens) const { return free_count_ + lens; }

  double RobustCost(double chi2) const {
    const double square = options_.loss_scale_sigmas * options_.loss_scale_sigmas;
    if (options_.loss == RobustLoss::kGemanMcClure) return 0.5 * square * chi2 / (square + chi2);
    return 0.5 * square * std::log1p(chi2 / square);
  }

  // Calls function(residual, place of camera a, its derivative, place of camera b, its derivative)
  // for every scalar prior; a place is -1 where there is no such camera or it is held.
  template <typename Function>
  void ForEachPrior(const Function& function) const {
    for (size_t i = 0; i < problem_.cameras.size(); ++i) {
      const BundleCamera& camera = problem_.cameras[i];
      if (place_of_[i] < 0 || !camera.prior) continue;
      Eigen::Vector3d residual;
      Eigen::Matrix<double, 3, 6, Eigen::RowMajor> jacobian;
      EvaluatePositionPrior(parameters_.camera_references[i], *camera.prior,
                            parameters_.cameras[i].data(), residual.data(), jacobian.data());
      for (int row = 0; row < 3; ++row) {
        function(residual[row], place_of_[i], jacobian.row(row), -1, jacobian.row(row));
      }
    }
    for (const DistancePrior& prior : problem_.distances) {
      if (!parameters_.cameras_used[prior.camera_a] || !parameters_.cameras_used[prior.camera_b]) {
        continue;
      }
      double residual = 0;
      Eigen::Matrix<double, 1, 6> d_a, d_b;
      EvaluateDistancePrior(parameters_.camera_references[prior.camera_a],
                            parameters_.camera_references[prior.camera_b], prior.distance,
                            1.0 / prior.sigma_log, parameters_.cameras[prior.camera_a].data(),
                            parameters_.cameras[prior.camera_b].data(), &residual, d_a.data(),
                            d_b.data());
      function(residual, place_of_[prior.camera_a], d_a, place_of_[prior.camera_b], d_b);
    }
  }

  void MoveStates() {
    for (size_t i = 0; i < states_.size(); ++i) {
      states_[i] = {parameters_.camera_references[i], parameters_.cameras[i].data()};
    }
  }

  double Cost() {
    MoveStates();
    double cost = 0;
    for (const PointTerms& point : points_) {
      const double* unknowns = parameters_.points[point.point].data();
      for (size_t i = point.begin; i < point.end; ++i) {
        Eigen::Vector2d residual;
        terms_[i].error.Evaluate(states_[terms_[i].camera], unknowns, residual.data(), nullptr,
                                 nullptr);
        if (terms_[i].lens >= 0)
          residual += terms_[i].lens_slope * parameters_.lenses[terms_[i].lens];
        cost += RobustCost(residual.squaredNorm());
      }
      if (point.is_free) {
        cost += 0.5 * std::pow((unknowns[2] - point.rho) * point.inverse_sigma, 2);
      }
    }
    for (size_t i = 0; i < parameters_.lenses.size(); ++i) {
      cost += 0.5 * LensPrior(i).squaredNorm();
    }
    ForEachPrior([&cost](double residual, int, const auto&, int, const auto&) {
      cost += 0.5 * residual * residual;
    });
    return cost;
  }

  LensVector LensPrior(size_t lens) const {
    const BundleLens& prior = problem_.lenses[lens];
    return prior.sqrt_information * (prior.deviation + parameters_.lenses[lens]);
  }

  // Where MoveStates was called last; returns the cost.
  double Linearize() {
    double cost = 0;
    const double square = options_.loss_scale_sigmas * options_.loss_scale_sigmas;
    for (auto& block : diagonal_) block.setZero();
    for (auto& block : lens_by_camera_) block.setZero();
    below_.clear();
    gradient_.setZero(6 * block_count_);
    cost += LinearizeLensPriors();
    for (PointTerms& point : points_) {
      point.information.setZero();
      point.gradient.setZero();
      const double* unknowns = parameters_.points[point.point].data();
      for (size_t i = point.begin; i < point.end; ++i) {
        Term& term = terms_[i];
        term.error.Evaluate(states_[term.camera], unknowns, term.residual.data(),
                            term.place < 0 ? nullptr : term.d_camera.data(), term.d_point.data());
        if (term.lens >= 0) term.residual += term.lens_slope * parameters_.lenses[term.lens];
        cost += RobustCost(term.residual.squaredNorm());
        const double share = 1 / (1 + term.residual.squaredNorm() / square);
        const double weight = options_.loss == RobustLoss::kGemanMcClure ? share : std::sqrt(share);
        term.residual *= weight;
        if (term.lens >= 0) {
          const int place = PlaceOfLens(term.lens);
          term.d_lens = weight * term.lens_slope;
          diagonal_[place].topLeftCorner<3, 3>().noalias() += term.d_lens.transpose() * term.d_lens;
          gradient_.segment<3>(6 * place).noalias() += term.d_lens.transpose() * term.residual;
        }
        term.d_point *= weight;
        point.information.noalias() += term.d_point.transpose() * term.d_point;
        point.gradient.noalias() += term.d_point.transpose() * term.residual;
        if (term.place < 0) continue;
        term.d_camera *= weight;
        diagonal_[term.place].noalias() += term.d_camera.transpose() * term.d_camera;
        gradient_.segment<6>(6 * term.place).noalias() += term.d_camera.transpose() * term.residual;
        if (term.lens < 0) continue;
        lens_by_camera_[term.place].noalias() += term.d_lens.transpose() * term.d_camera;
      }
      if (point.is_free) {
        cost += 0.5 * std::pow((unknowns[2] - point.rho) * point.inverse_sigma, 2);
      }
      const double inverse_sigma2 = point.inverse_sigma * point.inverse_sigma;
      point.information(2, 2) += inverse_sigma2;
      point.gradient[2] += inverse_sigma2 * (unknowns[2] - point.rho);
    }
    ForEachPrior([&, this](double residual, int a, const auto& d_a, int b, const auto& d_b) {
      cost += 0.5 * residual * residual;
      if (a >= 0) {
        diagonal_[a] += d_a.transpose() * d_a;
        gradient_.segment<6>(6 * a) += d_a.transpose() * residual;
      }
      if (b >= 0) {
        diagonal_[b] += d_b.transpose() * d_b;
        gradient_.segment<6>(6 * b) += d_b.transpose() * residual;
      }
      if (a > b && b >= 0) below_.push_back({a, b, d_a.transpose() * d_b});
      if (b > a && a >= 0) below_.push_back({b, a, d_b.transpose() * d_a});
    });
    return cost;
  }

  double LinearizeLensPriors() {
    double cost = 0;
    for (size_t i = 0; i < parameters_.lenses.size(); ++i) {
      const int place = PlaceOfLens(static_cast<int>(i));
      const LensMatrix& root = problem_.lenses[i].sqrt_information;
      diagonal_[place].topLeftCorner<3, 3>() = root.transpose() * root;
      gradient_.segment<3>(6 * place) = root.transpose() * LensPrior(i);
      cost += 0.5 * LensPrior(i).squaredNorm();
      // The rows that are not used.
      diagonal_[place].diagonal().tail<3>().setOnes();
    }
    return cost;
  }

  static double Damped(double diagonal, double damping) {
    return diagonal + damping * std::clamp(diagonal, kMinDiagonal, kMaxDiagonal);
  }

  // The cameras' and the lenses' system and its right side, points eliminated.
  void BuildSystem(double damping) {
    system_->SetZero();
    right_ = -gradient_;
    for (int i = 0; i < block_count_; ++i) {
      CameraBlock block = system_->Block(i, i);
      block = diagonal_[i];
      for (int k = 0; k < 6; ++k) block(k, k) = Damped(block(k, k), damping);
    }
    for (const Below& below : below_) system_->Block(below.row, below.column) += below.block;
    for (size_t i = 0; i < problem_.cameras.size(); ++i) {
      const int lens = problem_.cameras[i].lens;
      if (lens < 0 || place_of_[i] < 0) continue;
      system_->Block(PlaceOfLens(lens), place_of_[i]).topRows<3>() += lens_by_camera_[place_of_[i]];
    }
    for (PointTerms& point : points_) {
      if (!point.is_free) continue;
      Eigen::Matrix3d information = point.information;
      for (int i = 0; i < 3; ++i) information(i, i) = Damped(information(i, i), damping);
      point.inverse = information.inverse();
      Eliminate(point);
    }
  }

  // Takes a step; `expected` is by how much the linear model lets the cost decrease.
  bool Step(double damping, double* expected) {
    BuildSystem(damping);
    if (!system_->SolveInPlace(&right_)) return false;
    double linear = -gradient_.dot(right_);  // - g' d
    double damped = 0;                       // d' D d
    for (int i = 0; i < right_.size(); ++i) {
      const double diagonal = diagonal_[i / 6](i % 6, i % 6);
      damped += (Damped(diagonal, damping) - diagonal) * right_[i] * right_[i];
    }
    for (const PointTerms& point : points_) {
      if (!point.is_free) continue;
      const Eigen::Vector3d step = StepOf(point);
      if (!step.allFinite()) return false;
      linear -= point.gradient.dot(step);
      for (int i = 0; i < 3; ++i) {
        const double diagonal = point.information(i, i);
        damped += (Damped(diagonal, damping) - diagonal) * step[i] * step[i];
        parameters_.points[point.point][i] += step[i];
      }
    }
    // (H + D) d = -g, so the model's gain -g'd - d'H d / 2 is (-g'd + d'D d) / 2.
    *expected = 0.5 * (linear + damped);
    for (size_t i = 0; i < place_of_.size(); ++i) {
      if (place_of_[i] < 0) continue;
      for (int k = 0; k < 6; ++k) parameters_.cameras[i][k] += right_[6 * place_of_[i] + k];
    }
    for (size_t i = 0; i < parameters_.lenses.size(); ++i) {
      parameters_.lenses[i] += right_.segment<3>(6 * PlaceOfLens(static_cast<int>(i)));
    }
    return true;
  }

  // The cameras of a point mostly follow each other: then all its blocks are computed as one.
  bool EliminateAsOne(const PointTerms& point) {
    int first = free_count_, last = -1, terms = 0;
    for (size_t i = point.begin; i < point.end; ++i) {
      const int place = terms_[i].place;
      if (place < 0) continue;
      first = std::min(first, place);
      last = std::max(last, place);
      ++terms;
    }
    const int count = last - first + 1;
    if (system_->is_sparse() || count > 2 * terms) return false;
    if (terms == 0) return true;
    auto plain = plain_.topRows(6 * count), weighted = weighted_.topRows(6 * count);
    plain.setZero();
    for (size_t i = point.begin; i < point.end; ++i) {
      const Term& term = terms_[i];
      if (term.place < 0) continue;
      plain.middleRows<6>(6 * (term.place - first)) +=
          term.d_camera.transpose().lazyProduct(term.d_point);
    }
    weighted = plain.lazyProduct(point.inverse);
    right_.segment(6 * first, 6 * count) += weighted.lazyProduct(point.gradient);
    SubtractProductOfThree(weighted.data(), plain.data(), plain_.rows(),
                           system_->Square(first, count));
    return true;
  }

  void Eliminate(const PointTerms& point) {
    if (parameters_.lenses.empty() && EliminateAsOne(point)) return;
    couplings_.clear();
    for (size_t i = point.begin; i < point.end; ++i) {
      const Term& term = terms_[i];
      if (term.place < 0) continue;
      const Matrix63d coupling = term.d_camera.transpose() * term.d_point;
      couplings_.push_back({term.place, coupling, coupling * point.inverse});
    }
    if (!parameters_.lenses.empty()) CoupleLenses(point);
    for (const Coupling& a : couplings_) {
      right_.segment<6>(6 * a.place).noalias() += a.weighted * point.gradient;
      for (const Coupling& b : couplings_) {
        if (b.place > a.place) continue;
        system_->Block(a.place, b.place).noalias() -= a.weighted * b.plain.transpose();
      }
    }
  }

  // One coupling a lens, of all of the point's terms.
  void CoupleLenses(const PointTerms& point) {
    const auto first = static_cast<std::ptrdiff_t>(couplings_.size());
    for (size_t i = point.begin; i < point.end; ++i) {
      const Term& term = terms_[i];
      if (term.lens < 0) continue;
      const int place = PlaceOfLens(term.lens);
      auto coupling = std::find_if(couplings_.begin() + first, couplings_.end(),
                                   [place](const Coupling& c) { return c.place == place; });
      if (coupling == couplings_.end()) {
        couplings_.push_back({place, Matrix63d::Zero(), Matrix63d::Zero()});
        coupling = couplings_.end() - 1;
      }
      coupling->plain.topRows<3>().noalias() += term.d_lens.transpose() * term.d_point;
    }
    for (auto coupling = couplings_.begin() + first; coupling != couplings_.end(); ++coupling) {
      coupling->weighted = coupling->plain * point.inverse;
    }
  }

  Eigen::Vector3d StepOf(const PointTerms& point) const {
    Eigen::Vector3d right = -point.gradient;
    for (size_t i = point.begin; i < point.end; ++i) {
      const Term& term = terms_[i];
      if (term.lens >= 0) {
        right.noalias() -= term.d_point.transpose() *
                           (term.d_lens * right_.segment<3>(6 * PlaceOfLens(term.lens))).eval();
      }
      if (term.place < 0) continue;
      right.noalias() -=
          term.d_point.transpose() * (term.d_camera * right_.segment<6>(6 * term.place)).eval();
    }
    return point.inverse * right;
  }

  const BundleOptions& options_;
  const BundleProblem& problem_;
  const std::atomic<bool>* interrupt_;
  BundleParameters& parameters_;
  std::vector<CameraState> states_;  // by camera, where MoveStates was called last
  std::vector<int> place_of_;        // of a camera
  int free_count_ = 0;
  int block_count_ = 0;  // free cameras, then lenses
  std::vector<Term> terms_;
  std::vector<PointTerms> points_;
  // Of the cameras, points not eliminated.
  std::vector<Eigen::Matrix<double, 6, 6>> diagonal_;
  std::vector<Below> below_;
  // By free camera: of its lens.
  std::vector<Eigen::Matrix<double, 3, 6>> lens_by_camera_;
  Eigen::VectorXd gradient_;
  std::unique_ptr<CameraSystem> system_;  // reduced
  Eigen::VectorXd right_;                 // then the cameras' step
  std::vector<Coupling> couplings_;
  // Of one point, the couplings of successive cameras; times the point's inverse information.
  Eigen::Matrix<double, Eigen::Dynamic, 3> plain_, weighted_;
};

}  // namespace

BundleSolve SolveBundle(const BundleOptions& options, const BundleProblem& problem,
                        const std::atomic<bool>* interrupt, BundleParameters* parameters) {
  return Solver(options, problem, interrupt, parameters).Run();
}

std::optional<LensMatrix> LensCovariance(const BundleOptions& options, const BundleProblem& problem,
                                         int lens) {
  BundleParameters parameters(problem);
  return Solver(options, problem, nullptr, &parameters).LensCovariance(lens);
}

}  // namespace portolan
