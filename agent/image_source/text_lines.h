// Lines and times of the text files of data sets.
#ifndef PORTOLAN_AGENT_IMAGE_SOURCE_TEXT_LINES_H_
#define PORTOLAN_AGENT_IMAGE_SOURCE_TEXT_LINES_H_

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/status.h"
#include "common/base/time.h"

namespace portolan {

// Calls `use` with the fields of each line that is neither empty nor a comment (#). Fields are
// parted by commas if the line has one, otherwise by blanks. An error of `use` is returned with
// "file:line: " in front. NotFound if the file cannot be read.
Status ForEachLine(const std::filesystem::path& path,
                   const std::function<Status(const std::vector<std::string>& fields)>& use);

// "1305031102.175304" to the nanosecond, which a double would not keep; also "1.0378e-01".
StatusOr<Timestamp> ParseSeconds(std::string_view text);
StatusOr<Timestamp> ParseNanoseconds(std::string_view text);

// A finite number.
StatusOr<double> ParseNumber(std::string_view text);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_IMAGE_SOURCE_TEXT_LINES_H_
