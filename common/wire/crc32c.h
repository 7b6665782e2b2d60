// CRC-32C (Castagnoli), as in RFC 3720, App. B.4.
#ifndef PORTOLAN_COMMON_WIRE_CRC32C_H_
#define PORTOLAN_COMMON_WIRE_CRC32C_H_

#include <cstdint>
#include <string_view>

namespace portolan {

uint32_t Crc32c(std::string_view bytes);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_CRC32C_H_
