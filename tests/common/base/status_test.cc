#include "common/base/status.h"

#include <memory>

#include "tests/support/matchers.h"

namespace portolan {
namespace {

StatusOr<std::unique_ptr<int>> Half(int value) {
  if (value % 2 != 0) return absl::InvalidArgumentError("odd");
  return std::make_unique<int>(value / 2);
}

StatusOr<int> Quarter(int value) {
  PORTOLAN_ASSIGN_OR_RETURN(const std::unique_ptr<int> half, Half(value));
  PORTOLAN_ASSIGN_OR_RETURN(const std::unique_ptr<int> quarter, Half(*half));
  return *quarter;
}

Status CheckDivisible(int value) {
  PORTOLAN_RETURN_IF_ERROR(Quarter(value).status());
  return absl::OkStatus();
}

TEST(Status, AssignOrReturnMovesTheValueOut) { EXPECT_EQ(Quarter(12).value(), 3); }

TEST(Status, AssignOrReturnPassesTheErrorOn) {
  EXPECT_THAT(Quarter(6), StatusIs(absl::StatusCode::kInvalidArgument, "odd"));
}

TEST(Status, ReturnIfErrorStopsAtTheFirstError) {
  EXPECT_THAT(CheckDivisible(8), IsOk());
  EXPECT_THAT(CheckDivisible(7), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace portolan
