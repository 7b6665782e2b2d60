#include "server/cli/command.h"

#include <google/protobuf/util/json_util.h>

#include <cstdio>
#include <fstream>
#include <iostream>

#include "common/base/concat.h"

namespace portolan {

void ClientOptions::AddTo(OptionTable* table) {
  table->Add("server", &server, "", "host:port of the server.");
  table->Add("timeout_s", &timeout_s, "s", "The call fails if it takes longer.");
  table->Add("json", &json, "", "Prints JSON (field names of map_service.proto) instead of text.");
}

bool ParseArguments(std::span<const std::string> args, std::string_view usage,
                    size_t max_positional, OptionTable* table, CommandLine* line, int* exit_code) {
  std::vector<const char*> words = {"portolan"};
  for (const std::string& arg : args) words.push_back(arg == "-k" ? "--k" : arg.c_str());
  StatusOr<CommandLine> parsed =
      table->ParseCommandLine(static_cast<int>(words.size()), words.data());
  if (parsed.ok() && parsed->positional.size() > max_positional) {
    parsed = absl::InvalidArgumentError(
        Concat("unexpected argument '", parsed->positional[max_positional], "'"));
  }
  if (!parsed.ok()) {
    std::cerr << parsed.status().message() << "\n" << usage << "\nTry --help.\n";
    *exit_code = kExitUsage;
    return false;
  }
  if (parsed->help) {
    std::cout << table->Help(usage);
    *exit_code = kExitOk;
    return false;
  }
  *line = *std::move(parsed);
  return true;
}

int Fail(const Status& status) {
  std::cerr << "portolan: " << status.message() << "\n";
  return absl::IsInvalidArgument(status) ? kExitUsage : kExitFailed;
}

StatusOr<std::string> ToJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = true;
  options.preserve_proto_field_names = true;
  std::string json;
  const auto status = google::protobuf::util::MessageToJsonString(message, &json, options);
  if (!status.ok()) return absl::InternalError(std::string(status.message()));
  return json;
}

Status WriteOutput(const std::string& path, const std::function<void(std::ostream&)>& write) {
  if (path.empty() || path == "-") {
    write(std::cout);
    std::cout.flush();
    return std::cout ? absl::OkStatus() : absl::UnavailableError("cannot write to standard output");
  }
  const std::string temporary = path + ".tmp";
  {
    std::ofstream file(temporary, std::ios::binary);
    write(file);
    file.close();
    if (!file) return absl::UnavailableError(Concat("cannot write ", temporary));
  }
  if (std::rename(temporary.c_str(), path.c_str()) != 0) {
    return absl::UnavailableError(Concat("cannot rename ", temporary, " to ", path));
  }
  return absl::OkStatus();
}

}  // namespace portolan
