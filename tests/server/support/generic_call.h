// Calls services whose generated code is not at hand, with messages put together by hand.
#ifndef PORTOLAN_TESTS_SERVER_SUPPORT_GENERIC_CALL_H_
#define PORTOLAN_TESTS_SERVER_SUPPORT_GENERIC_CALL_H_

#include <google/protobuf/unknown_field_set.h>

#include <memory>
#include <string>

#include "common/base/status.h"

namespace portolan::testing {

// Sends one message on a bidirectional or unary `method` ("/package.Service/Method") and returns
// the first answer with its fields by number.
StatusOr<std::unique_ptr<google::protobuf::UnknownFieldSet>> GenericCall(
    const std::string& address, const std::string& method,
    const google::protobuf::UnknownFieldSet& request);

}  // namespace portolan::testing

#endif  // PORTOLAN_TESTS_SERVER_SUPPORT_GENERIC_CALL_H_
