// Small files that survive a kill and a power cut, and that show damage.
#ifndef PORTOLAN_AGENT_UPLINK_DURABLE_FILE_H_
#define PORTOLAN_AGENT_UPLINK_DURABLE_FILE_H_

#include <filesystem>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace portolan {

// Layout, little-endian:  file = "PTLNOUT1" length:u64 crc32c(content):u32 content

// Writes `path`.tmp, flushes it to the disk, renames it to `path`, and flushes the folder: after
// OK the content is there for good, after an error or a kill `path` is as it was before.
Status WriteDurably(const std::filesystem::path& path, std::string_view content);

// NotFound, Unavailable (cannot be read), or DataLoss if the file is not as it was written.
StatusOr<std::string> ReadDurable(const std::filesystem::path& path);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_UPLINK_DURABLE_FILE_H_
