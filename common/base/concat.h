// Concat("frame ", 3, " of ", path): absl::StrCat that also takes std::string_view (which the
// distribution's Abseil, built for C++14, does not know) and file system paths.
#ifndef PORTOLAN_COMMON_BASE_CONCAT_H_
#define PORTOLAN_COMMON_BASE_CONCAT_H_

#include <filesystem>
#include <string>
#include <string_view>
#include <type_traits>

#include "absl/strings/str_cat.h"

namespace portolan {
namespace internal {

template <typename T>
decltype(auto) ToPiece(const T& value) {
  if constexpr (std::is_same_v<T, std::filesystem::path>) {
    return value.string();
  } else if constexpr (std::is_same_v<T, std::string_view>) {
    return absl::string_view(value.data(), value.size());
  } else {
    return (value);
  }
}

}  // namespace internal

template <typename... Args>
std::string Concat(const Args&... args) {
  return absl::StrCat(internal::ToPiece(args)...);
}

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BASE_CONCAT_H_
