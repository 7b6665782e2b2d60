#include "tests/support/matchers.h"

namespace portolan {

void PrintTo(const Rigid3& rigid, std::ostream* out) {
  *out << "translation [" << rigid.translation.transpose() << "] rotation xyzw ["
       << rigid.rotation.coeffs().transpose() << "]";
}

void PrintTo(const Similarity3& similarity, std::ostream* out) {
  *out << "scale " << similarity.scale << " ";
  PrintTo(similarity.Rigid(), out);
}

bool IsNearMatrix(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected, double tolerance,
                  ::testing::MatchResultListener* listener) {
  if (actual.rows() != expected.rows() || actual.cols() != expected.cols()) {
    *listener << "size " << actual.rows() << "x" << actual.cols();
    return false;
  }
  if (actual.size() == 0) return true;
  const Eigen::MatrixXd difference = actual - expected;
  const double largest = difference.cwiseAbs().maxCoeff();
  *listener << "largest difference " << largest << ", actual\n"
            << actual << "\nexpected\n"
            << expected;
  return largest <= tolerance && difference.allFinite();
}

}  // namespace portolan
