#include "server/alignment/block_system.h"

#include <Eigen/SparseCore>
#include <vector>

namespace portolan {

void BlockSystem::Reset(int blocks) {
  const Eigen::Index rows = 7 * static_cast<Eigen::Index>(blocks);
  if (rows == gradient_.size()) {
    for (auto& [key, block] : information_) block.setZero();
  } else {
    information_.clear();
    is_analyzed_ = false;
  }
  gradient_ = Eigen::VectorXd::Zero(rows);
}

Matrix7d& BlockSystem::Block(int row, int column) {
  const auto key = (static_cast<uint64_t>(row) << 32) | static_cast<uint64_t>(column);
  const auto [place, is_new] = information_.try_emplace(key, Matrix7d::Zero());
  if (is_new) is_analyzed_ = false;
  return place->second;
}

bool BlockSystem::Solve(double damping, Eigen::VectorXd* step) {
  std::vector<Eigen::Triplet<double>> triplets;
  triplets.reserve(49 * information_.size());
  for (const auto& [key, block] : information_) {
    const int row = 7 * static_cast<int>(key >> 32);
    const int column = 7 * static_cast<int>(key & 0xffffffffu);
    for (int c = 0; c < 7; ++c) {
      for (int r = 0; r < 7; ++r) {
        // The last summand: a block that nothing informs stays where it is.
        const bool is_diagonal = row == column && r == c;
        triplets.emplace_back(row + r, column + c,
                              is_diagonal ? block(r, c) * (1 + damping) + 1e-12 : block(r, c));
      }
    }
  }
  Eigen::SparseMatrix<double> system(gradient_.size(), gradient_.size());
  system.setFromTriplets(triplets.begin(), triplets.end());
  if (!is_analyzed_) cholesky_.Analyze(system);
  is_analyzed_ = true;
  if (!cholesky_.Factorize(system)) return false;
  *step = cholesky_.Solve(-gradient_);
  return step->allFinite();
}

}  // namespace portolan
