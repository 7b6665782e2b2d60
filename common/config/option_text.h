// Conversions between an option's value and its text, as it stands in YAML and on the command line.
#ifndef PORTOLAN_COMMON_CONFIG_OPTION_TEXT_H_
#define PORTOLAN_COMMON_CONFIG_OPTION_TEXT_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/base/time.h"

namespace portolan {

// Each reads the whole text or says, without naming the option, what was expected. Numbers must be
// finite and in the type's range.
Status ParseOptionText(const std::string& text, bool* value);
Status ParseOptionText(const std::string& text, int32_t* value);
Status ParseOptionText(const std::string& text, int64_t* value);
Status ParseOptionText(const std::string& text, uint32_t* value);
Status ParseOptionText(const std::string& text, uint64_t* value);
Status ParseOptionText(const std::string& text, double* value);
Status ParseOptionText(const std::string& text, float* value);
Status ParseOptionText(const std::string& text, std::string* value);
// In seconds.
Status ParseOptionText(const std::string& text, Duration* value);

// The shortest text that reads back as the same value.
std::string OptionTextOf(bool value);
std::string OptionTextOf(int32_t value);
std::string OptionTextOf(int64_t value);
std::string OptionTextOf(uint32_t value);
std::string OptionTextOf(uint64_t value);
std::string OptionTextOf(double value);
std::string OptionTextOf(float value);
std::string OptionTextOf(const std::string& value);
std::string OptionTextOf(Duration value);

// Number of single-character insertions, removals and replacements between two words.
int EditDistance(std::string_view a, std::string_view b);

}  // namespace portolan

#endif  // PORTOLAN_COMMON_CONFIG_OPTION_TEXT_H_
