// Columns of signed integers as adaptive Golomb-Rice bit streams; grammar in proto/README.md
// (Weinberger, Seroussi & Sapiro, IEEE TIP 2000, Sec. III-B).
#ifndef PORTOLAN_COMMON_WIRE_COLUMN_CODEC_H_
#define PORTOLAN_COMMON_WIRE_COLUMN_CODEC_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"

namespace portolan {

// Any integers; small and similar magnitudes make it short.
std::string EncodeColumn(const std::vector<int64_t>& values);

// Exactly `count` integers. InvalidArgument if the bytes end early or more than padding is left.
// Each integer takes at least one bit, so `count` is checked before anything is allocated.
StatusOr<std::vector<int64_t>> DecodeColumn(std::string_view bytes, size_t count);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_COLUMN_CODEC_H_
