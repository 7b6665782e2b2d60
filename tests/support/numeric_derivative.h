// Numeric Jacobians by central differences, to hold the analytic ones to.
#ifndef PORTOLAN_TESTS_SUPPORT_NUMERIC_DERIVATIVE_H_
#define PORTOLAN_TESTS_SUPPORT_NUMERIC_DERIVATIVE_H_

#include <Eigen/Core>

namespace portolan {

// Jacobian of function(delta) at delta = 0, with delta a vector of `dimension` entries: for
// functions on a manifold the caller applies delta, e.g.
//   NumericJacobianAtZero(6, [&](const Eigen::VectorXd& d) { return (T * Exp(d)) * p; }).
// Fourth order: the error is about step^4, so tolerances of 1e-8 relative hold at the default.
template <typename Function>
Eigen::MatrixXd NumericJacobianAtZero(int dimension, const Function& function, double step = 1e-3) {
  Eigen::MatrixXd jacobian;
  for (int column = 0; column < dimension; ++column) {
    const auto at = [&](double amount) -> Eigen::VectorXd {
      Eigen::VectorXd delta = Eigen::VectorXd::Zero(dimension);
      delta[column] = amount;
      return Eigen::VectorXd(function(delta));
    };
    const Eigen::VectorXd derivative =
        (8 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12 * step);
    if (column == 0) jacobian.resize(derivative.size(), dimension);
    jacobian.col(column) = derivative;
  }
  return jacobian;
}

// Jacobian of function(x) at x, an ordinary vector.
template <typename Function>
Eigen::MatrixXd NumericJacobian(const Eigen::VectorXd& x, const Function& function,
                                double step = 1e-3) {
  return NumericJacobianAtZero(
      static_cast<int>(x.size()),
      [&](const Eigen::VectorXd& delta) { return function(Eigen::VectorXd(x + delta)); }, step);
}

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SUPPORT_NUMERIC_DERIVATIVE_H_
