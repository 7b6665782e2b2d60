// Status helpers. Errors from outside (files, network, operators) travel as absl::Status; no
// exception leaves a module.
#ifndef PORTOLAN_COMMON_BASE_STATUS_H_
#define PORTOLAN_COMMON_BASE_STATUS_H_

#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace portolan {

using absl::Status;
using absl::StatusOr;

}  // namespace portolan

#define PORTOLAN_RETURN_IF_ERROR(expression)                            \
  do {                                                                  \
    ::absl::Status portolan_status_ = (expression);                     \
    if (!portolan_status_.ok()) return portolan_status_;                \
  } while (false)

#define PORTOLAN_CONCAT_INNER_(a, b) a##b
#define PORTOLAN_CONCAT_(a, b) PORTOLAN_CONCAT_INNER_(a, b)

// PORTOLAN_ASSIGN_OR_RETURN(auto value, FunctionThatReturnsStatusOr());
#define PORTOLAN_ASSIGN_OR_RETURN(lhs, expression) \
  PORTOLAN_ASSIGN_OR_RETURN_IMPL_(PORTOLAN_CONCAT_(portolan_status_or_, __LINE__), lhs, expression)
#define PORTOLAN_ASSIGN_OR_RETURN_IMPL_(status_or, lhs, expression) \
  auto status_or = (expression);                                    \
  if (!status_or.ok()) return status_or.status();                   \
  lhs = std::move(status_or).value()

#endif  // PORTOLAN_COMMON_BASE_STATUS_H_
