// gmock matchers for Status, Eigen and the group types:
//   EXPECT_THAT(status, IsOk());  EXPECT_THAT(status, StatusIs(code, HasSubstr("width")));
//   EXPECT_THAT(rigid, NearRigid(expected, 1e-9));  EXPECT_THAT(matrix, NearMatrix(expected, tol));
#ifndef PORTOLAN_TESTS_SUPPORT_MATCHERS_H_
#define PORTOLAN_TESTS_SUPPORT_MATCHERS_H_

#include <Eigen/Core>
#include <ostream>
#include <string>

#include "common/base/status.h"
#include "common/geometry/similarity3.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace portolan {

// gtest finds these when it prints a failure.
void PrintTo(const Rigid3& rigid, std::ostream* out);
void PrintTo(const Similarity3& similarity, std::ostream* out);

inline const Status& GetStatus(const Status& status) { return status; }
template <typename T>
const Status& GetStatus(const StatusOr<T>& status_or) {
  return status_or.status();
}

MATCHER(IsOk, "is OK") {
  *result_listener << GetStatus(arg).ToString();
  return GetStatus(arg).ok();
}

// `message` is a string or a matcher of std::string.
MATCHER_P2(StatusIs, code, message, "has the given code and message") {
  *result_listener << GetStatus(arg).ToString();
  return GetStatus(arg).code() == code &&
         ::testing::ExplainMatchResult(::testing::Matcher<std::string>(message),
                                       std::string(GetStatus(arg).message()), result_listener);
}
MATCHER_P(StatusIs, code, "has the given code") {
  *result_listener << GetStatus(arg).ToString();
  return GetStatus(arg).code() == code;
}

bool IsNearMatrix(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected, double tolerance,
                  ::testing::MatchResultListener* listener);

// Largest absolute difference of an entry at most `tolerance`; NaN never matches.
MATCHER_P2(NearMatrix, expected, tolerance, "is near the matrix") {
  return IsNearMatrix(arg, expected, tolerance, result_listener);
}

// Angle in radians and distance in length units both at most `tolerance`.
MATCHER_P2(NearRigid, expected, tolerance, "is near the rigid motion") {
  const double angle = RotationLog(expected.rotation.conjugate() * arg.rotation).norm();
  const double distance = (arg.translation - expected.translation).norm();
  *result_listener << "angle " << angle << " rad, distance " << distance;
  return angle <= tolerance && distance <= tolerance;
}

// As NearRigid, and the scales' logarithms differ by at most `tolerance`.
MATCHER_P2(NearSimilarity, expected, tolerance, "is near the similarity") {
  const double angle = RotationLog(expected.rotation.conjugate() * arg.rotation).norm();
  const double distance = (arg.translation - expected.translation).norm();
  const double log_scale = std::abs(std::log(arg.scale / expected.scale));
  *result_listener << "angle " << angle << " rad, distance " << distance << ", log scale "
                   << log_scale;
  return angle <= tolerance && distance <= tolerance && log_scale <= tolerance;
}

}  // namespace portolan

#endif  // PORTOLAN_TESTS_SUPPORT_MATCHERS_H_
