#include "server/alignment/relation_graph.h"

#include <algorithm>
#include <cmath>

#include "server/alignment/block_system.h"

namespace portolan {
namespace {

// The adjoint representation of sim(3): ad(x) y = [x, y].
Matrix7d SmallAdjoint(const Vector7d& x) {
  Matrix7d ad = Matrix7d::Zero();
  ad.block<3, 3>(0, 0) = Skew(x.segment<3>(3)) + x[6] * Eigen::Matrix3d::Identity();
  ad.block<3, 3>(0, 3) = Skew(x.head<3>());
  ad.block<3, 1>(0, 6) = -x.head<3>();
  ad.block<3, 3>(3, 3) = Skew(x.segment<3>(3));
  return ad;
}

// Inverse right Jacobian of Sim(3): the series of Bernoulli numbers in ad, which converges for
// rotations under 2 pi; these terms leave 1e-6 at one radian.
Matrix7d RightJacobianInverse(const Vector7d& x) {
  const Matrix7d ad = SmallAdjoint(x);
  const Matrix7d ad2 = ad * ad;
  if (x.squaredNorm() < 1e-4) return Matrix7d::Identity() + 0.5 * ad + ad2 / 12.0;
  const Matrix7d ad4 = ad2 * ad2;
  return Matrix7d::Identity() + 0.5 * ad + ad2 / 12.0 - ad4 / 720.0 + ad4 * ad2 / 30240.0 -
         ad4 * ad4 / 1209600.0;
}

class Solver {
 public:
  Solver(const RelationGraphOptions& options, RelationGraph* graph)
      : options_(options), graph_(*graph), weights_(graph->relations.size(), 1.0) {
    for (const bool fixed : graph_.fixed) {
      block_of_.push_back(fixed ? -1 : free_count_);
      if (!fixed) ++free_count_;
    }
  }

  std::vector<double> Run() {
    if (free_count_ == 0) return JudgeFixed();
    const bool doubt = std::any_of(graph_.relations.begin(), graph_.relations.end(),
                                   [](const Relation& relation) { return relation.doubtful; });
    if (doubt) Graduate();
    Minimize();
    return weights_;
  }

 private:
  double Chi2(const Relation& relation) const {
    const Vector7d error = RelationError(relation.a_from_b, graph_.world_from_node[relation.a],
                                         graph_.world_from_node[relation.b]);
    return error.dot(relation.information * error);
  }

  std::vector<double> JudgeFixed() {
    for (size_t i = 0; i < weights_.size(); ++i) {
      const Relation& relation = graph_.relations[i];
      if (relation.doubtful && Chi2(relation) > options_.max_chi2) weights_[i] = 0;
    }
    return weights_;
  }

  double Cost() const {
    double cost = 0;
    for (size_t i = 0; i < weights_.size(); ++i) {
      if (weights_[i] > 0) cost += weights_[i] * Chi2(graph_.relations[i]);
    }
    return cost;
  }

  // GNC-TLS: Eq. 14 (start) and Eq. 12 (weights) of the paper.
  void Graduate() {
    Minimize();
    double worst = 0;
    for (const Relation& relation : graph_.relations) {
      if (relation.doubtful) worst = std::max(worst, Chi2(relation));
    }
    const double limit = options_.max_chi2;
    if (worst <= limit) return;
    double mu = limit / std::max(2 * worst - limit, 1e-9);
    for (int i = 0; i < options_.max_graduations; ++i, mu *= options_.graduation) {
      if (UpdateWeights(mu, limit)) break;
      Minimize();
    }
  }

  // True if every weight is 0 or 1 and none changed.
  bool UpdateWeights(double mu, double limit) {
    bool settled = true;
    for (size_t i = 0; i < weights_.size(); ++i) {
      if (!graph_.relations[i].doubtful) continue;
      const double chi2 = Chi2(graph_.relations[i]);
      double weight = 0;
      if (chi2 <= mu / (mu + 1) * limit) {
        weight = 1;
      } else if (chi2 < (mu + 1) / mu * limit) {
        weight = std::clamp(std::sqrt(limit / chi2 * mu * (mu + 1)) - mu, 0.0, 1.0);
      }
      settled = settled && weight == weights_[i] && (weight == 0 || weight == 1);
      weights_[i] = weight;
    }
    return settled;
  }

  void Minimize() {
    double lambda = 1e-6;
    double cost = Cost();
    for (int i = 0; i < options_.max_iterations; ++i) {
      Linearize();
      bool improved = false;
      for (int attempt = 0; attempt < 8 && !improved; ++attempt) {
        const std::vector<Similarity3> before = graph_.world_from_node;
        double predicted = cost;
        const bool stepped = Step(lambda, &predicted);
        const double next = stepped ? Cost() : cost;
        improved = stepped && next <= cost;
        if (improved) {
          lambda = std::max(lambda * 0.1, 1e-12);
          // A step to the minimum of a model that was right leads to the minimum.
          const double left = std::min(cost - next, std::abs(next - predicted));
          const bool converged = left <= options_.min_decrease * next + 1e-12;
          cost = next;
          if (converged) return;
        } else {
          graph_.world_from_node = before;
          lambda = std::max(lambda * 10, 1e-6);
        }
      }
      if (!improved) return;
    }
  }

  void Linearize() {
    system_.Reset(free_count_);
    for (size_t i = 0; i < weights_.size(); ++i) {
      if (weights_[i] <= 0) continue;
      const Relation& relation = graph_.relations[i];
      Matrix7d d_a, d_b;
      const Vector7d error = RelationError(relation.a_from_b, graph_.world_from_node[relation.a],
                                           graph_.world_from_node[relation.b], &d_a, &d_b);
      const Matrix7d information = weights_[i] * relation.information;
      const int a = block_of_[relation.a];
      const int b = block_of_[relation.b];
      const Matrix7d from_a = d_a.transpose() * information;
      const Matrix7d from_b = d_b.transpose() * information;
      if (a >= 0) AddTo(a, from_a * d_a, from_a * error);
      if (b >= 0) AddTo(b, from_b * d_b, from_b * error);
      if (a > b && b >= 0) system_.Block(a, b) += from_a * d_b;
      if (b > a && a >= 0) system_.Block(b, a) += from_b * d_a;
    }
  }

  void AddTo(int block, const Matrix7d& information, const Vector7d& gradient) {
    system_.Block(block, block) += information;
    system_.gradient().segment<7>(7 * block) += gradient;
  }

  // False: no step. *predicted is the cost before it, and becomes what the linear model, but for
  // the damping, has for its end.
  bool Step(double lambda, double* predicted) {
    Eigen::VectorXd step;
    if (!system_.Solve(lambda, &step)) return false;
    *predicted += system_.gradient().dot(step);
    for (size_t i = 0; i < block_of_.size(); ++i) {
      if (block_of_[i] < 0) continue;
      Similarity3& node = graph_.world_from_node[i];
      node = node * Similarity3::Exp(step.segment<7>(7 * block_of_[i]));
    }
    return true;
  }

  const RelationGraphOptions& options_;
  RelationGraph& graph_;
  std::vector<double> weights_;
  std::vector<int> block_of_;  // by node; -1 if it is held
  int free_count_ = 0;
  BlockSystem system_;
};

}  // namespace

Status RelationGraphOptions::Validate() const {
  if (max_iterations < 1 || !(min_decrease >= 0) || max_graduations < 1 || !(graduation > 1) ||
      !(max_chi2 > 0)) {
    return absl::InvalidArgumentError("relation graph: limits out of range");
  }
  return absl::OkStatus();
}

Vector7d RelationError(const Similarity3& a_from_b, const Similarity3& world_from_a,
                       const Similarity3& world_from_b, Matrix7d* d_error_d_a,
                       Matrix7d* d_error_d_b) {
  const Similarity3 estimated = world_from_a.Inverse() * world_from_b;
  const Vector7d error = (a_from_b.Inverse() * estimated).Log();
  if (d_error_d_a == nullptr && d_error_d_b == nullptr) return error;
  const Matrix7d jacobian = RightJacobianInverse(error);
  if (d_error_d_b != nullptr) *d_error_d_b = jacobian;
  if (d_error_d_a != nullptr) *d_error_d_a = -jacobian * estimated.Inverse().Adjoint();
  return error;
}

std::vector<double> SolveRelationGraph(const RelationGraphOptions& options, RelationGraph* graph) {
  return Solver(options, graph).Run();
}

}  // namespace portolan
