// Lets a replayed fleet fly against a running server over gRPC, in real time, and prints how long a
// correction takes, what the server's process costs, and how fast it answers queries meanwhile.
//
//   server_replay --address HOST:PORT --pid PID [--submaps 1000] [--agents 100] [--interval 5]
//                 [--visits 3] [--seed 1]
//
// --interval: seconds between two submaps of one agent. --pid: of the server.
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "common/client/map_client.h"
#include "common/wire/agent_wire.h"
#include "common/wire/submap_wire.h"
#include "proto/agent_service.grpc.pb.h"
#include "tests/benchmark/replay/process_memory.h"
#include "tests/support/replay_fleet.h"

namespace portolan {
namespace {

using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

double Quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(share * static_cast<double>(values.size() - 1))];
}

// User and system time of a process in seconds.
double ProcessSeconds(const std::string& pid) {
  std::ifstream file("/proc/" + pid + "/stat");
  const std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  std::istringstream fields(text.substr(std::min(text.size(), text.rfind(')') + 2)));
  std::vector<std::string> words((std::istream_iterator<std::string>(fields)),
                                 std::istream_iterator<std::string>());
  if (words.size() < 13) return 0;
  return (std::stod(words[11]) + std::stod(words[12])) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

// One agent: a stream, its submaps at their times, and when their first corrections came.
class Flight {
 public:
  Flight(const std::string& address, int index, const CameraModel& camera,
         std::vector<std::string> submaps)
      : submaps_(std::move(submaps)), sent_(submaps_.size()), seconds_(submaps_.size(), -1) {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    stub_ = v1::AgentService::NewStub(
        grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments));
    stream_ = stub_->Connect(&context_);
    SessionHello hello;
    hello.agent = AgentId("agent" + std::to_string(index));
    hello.session = SessionId(static_cast<uint64_t>(index) + 1);
    hello.camera = camera.intrinsics();
    v1::AgentMessage message;
    ToProto(hello, message.mutable_hello());
    stream_->Write(message);
    reader_ = std::thread([this] { Read(); });
  }

  ~Flight() {
    if (writer_.joinable()) writer_.join();
    context_.TryCancel();
    reader_.join();
  }

  void Start(Clock::time_point first, Clock::duration interval) {
    writer_ = std::thread([this, first, interval] {
      for (size_t i = 0; i < submaps_.size(); ++i) {
        std::this_thread::sleep_until(first + static_cast<int>(i) * interval);
        v1::AgentMessage message;
        *message.mutable_submap() = MakeUpload(static_cast<uint32_t>(i), std::move(submaps_[i]));
        {
          const std::lock_guard lock(mutex_);
          sent_[i] = Clock::now();
          ++sent_count_;
        }
        if (!stream_->Write(message)) return;
      }
    });
  }

  // From the upload to the first correction; negative while there is none.
  std::vector<double> seconds() const {
    const std::lock_guard lock(mutex_);
    return seconds_;
  }
  size_t sent_count() const {
    const std::lock_guard lock(mutex_);
    return sent_count_;
  }

 private:
  void Read() {
    v1::ServerMessage message;
    while (stream_->Read(&message)) {
      if (!message.has_correction()) continue;
      const std::lock_guard lock(mutex_);
      for (const auto& submap : message.correction().submaps()) {
        const size_t i = submap.sequence_number();
        if (i < seconds_.size() && seconds_[i] < 0) seconds_[i] = SecondsSince(sent_[i]);
      }
    }
  }

  grpc::ClientContext context_;
  std::unique_ptr<v1::AgentService::Stub> stub_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::AgentMessage, v1::ServerMessage>> stream_;
  std::vector<std::string> submaps_;
  mutable std::mutex mutex_;
  // Guarded by mutex_.
  std::vector<Clock::time_point> sent_;
  std::vector<double> seconds_;
  size_t sent_count_ = 0;
  std::thread writer_;
  std::thread reader_;
};

// Asks for the landmarks in a box and nearest to a point, five times a second.
class Questions {
 public:
  explicit Questions(const std::string& address) : client_(address) {
    thread_ = std::thread([this] { Run(); });
  }
  ~Questions() { Stop(); }

  void Stop() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    wake_.notify_one();
    if (thread_.joinable()) thread_.join();
  }

  const std::vector<double>& box_ms() const { return box_ms_; }
  const std::vector<double>& nearest_ms() const { return nearest_ms_; }
  double mean_box_results() const {
    return box_ms_.empty() ? 0 : box_results_ / static_cast<double>(box_ms_.size());
  }

 private:
  void Run() {
    std::unique_lock lock(mutex_);
    while (!wake_.wait_for(lock, std::chrono::milliseconds(200), [this] { return stop_; })) Ask();
  }

  void Ask() {
    v1::QueryLandmarksRequest request;
    request.mutable_nearest()->mutable_point()->set_x(0);
    request.mutable_nearest()->mutable_point()->set_y(0);
    request.mutable_nearest()->mutable_point()->set_z(0);
    request.mutable_nearest()->set_count(1000);
    const auto near = client_.QueryLandmarks(request);
    if (!near.ok() || near->landmarks().empty()) return;
    Eigen::AlignedBox3d box;
    for (const v1::Landmark& landmark : near->landmarks()) {
      const auto& point = landmark.point_in_world();
      box.extend(Eigen::Vector3d(point.x(), point.y(), point.z()));
    }
    request.mutable_nearest()->set_count(10);
    Time(request, &nearest_ms_);
    const Eigen::Vector3d half = 0.4 * box.sizes();
    auto* min = request.mutable_box()->mutable_min();
    auto* max = request.mutable_box()->mutable_max();
    const Eigen::Vector3d low = box.center() - half, high = box.center() + half;
    min->set_x(low.x()), min->set_y(low.y()), min->set_z(low.z());
    max->set_x(high.x()), max->set_y(high.y()), max->set_z(high.z());
    box_results_ += Time(request, &box_ms_);
  }

  int Time(const v1::QueryLandmarksRequest& request, std::vector<double>* times_ms) {
    const Clock::time_point start = Clock::now();
    const auto page = client_.QueryLandmarks(request);
    times_ms->push_back(1000 * SecondsSince(start));
    return page.ok() ? page->landmarks_size() : 0;
  }

  MapClient client_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stop_ = false;
  std::vector<double> box_ms_;
  std::vector<double> nearest_ms_;
  double box_results_ = 0;
  std::thread thread_;
};

struct Arguments {
  std::string address;
  std::string pid;
  std::map<std::string, double> numbers = {
      {"submaps", 1000}, {"agents", 100}, {"interval", 5}, {"visits", 3}, {"seed", 1}};
};

std::vector<std::unique_ptr<Flight>> MakeFlights(const Arguments& arguments) {
  const int submaps = static_cast<int>(arguments.numbers.at("submaps"));
  const int agents = static_cast<int>(arguments.numbers.at("agents"));
  ReplayFleet fleet(ReplayFleetOptions::For(submaps, agents, arguments.numbers.at("visits"),
                                            static_cast<uint64_t>(arguments.numbers.at("seed"))));
  std::vector<std::vector<std::string>> bytes(static_cast<size_t>(agents));
  for (int i = 0; i < submaps; ++i) {
    const ReplaySubmap submap = fleet.Next();
    StatusOr<std::string> encoded = EncodeSubmap(*submap.submap);
    if (!encoded.ok()) std::fprintf(stderr, "%s\n", encoded.status().ToString().c_str());
    bytes[static_cast<size_t>(submap.agent)].push_back(*std::move(encoded));
  }
  std::vector<std::unique_ptr<Flight>> flights;
  for (int i = 0; i < agents; ++i) {
    flights.push_back(std::make_unique<Flight>(arguments.address, i, *fleet.camera(),
                                               std::move(bytes[static_cast<size_t>(i)])));
  }
  return flights;
}

void Report(const Arguments& arguments, const std::vector<std::unique_ptr<Flight>>& flights,
            const std::vector<size_t>& first, double cpu_seconds, double seconds) {
  std::vector<double> times;
  size_t sent = 0, waiting = 0;
  for (size_t a = 0; a < flights.size(); ++a) {
    const std::vector<double> of_agent = flights[a]->seconds();
    sent += flights[a]->sent_count() - first[a];
    for (size_t i = first[a]; i < flights[a]->sent_count(); ++i) {
      if (of_agent[i] < 0) {
        ++waiting;
      } else {
        times.push_back(of_agent[i]);
      }
    }
  }
  std::printf(
      "%6.0f s | %5zu sent %5.1f /s %4zu without correction | upload to correction s: median "
      "%5.2f p95 %5.2f max %5.2f | server %5.1f CPU ms a submap, %4.0f %% CPU, %5.0f MB\n",
      seconds, sent, static_cast<double>(sent) / seconds, waiting, Quantile(times, 0.5),
      Quantile(times, 0.95), Quantile(times, 1),
      1000 * cpu_seconds / std::max<double>(1, static_cast<double>(sent)),
      100 * cpu_seconds / seconds, ProcessMemoryMb(arguments.pid, "VmRSS"));
  std::fflush(stdout);
}

void Run(const Arguments& arguments) {
  std::vector<std::unique_ptr<Flight>> flights = MakeFlights(arguments);
  const double interval = arguments.numbers.at("interval");
  const int agents = static_cast<int>(flights.size());
  const double duration =
      interval * std::ceil(arguments.numbers.at("submaps") / static_cast<double>(agents));
  Questions questions(arguments.address);
  const auto as_duration = [](double seconds) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  };
  const Clock::time_point start = Clock::now();
  for (int i = 0; i < agents; ++i) {
    flights[static_cast<size_t>(i)]->Start(start + as_duration(interval * i / agents),
                                           as_duration(interval));
  }
  // Four reports on the way, and one of the corrections that came within ten seconds of the end.
  std::vector<size_t> first(flights.size(), 0);
  const double cpu_start = ProcessSeconds(arguments.pid);
  double cpu = cpu_start;
  for (int part = 1; part <= 4; ++part) {
    std::this_thread::sleep_until(start + as_duration(duration * part / 4));
    const double cpu_now = ProcessSeconds(arguments.pid);
    Report(arguments, flights, first, cpu_now - cpu, duration / 4);
    for (size_t a = 0; a < flights.size(); ++a) first[a] = flights[a]->sent_count();
    cpu = cpu_now;
  }
  std::this_thread::sleep_until(start + as_duration(duration + 10));
  questions.Stop();
  std::printf("all: ");
  Report(arguments, flights, std::vector<size_t>(flights.size(), 0), cpu - cpu_start, duration);
  std::printf("queries meanwhile, median ms: box %.2f (%.0f results), nearest ten %.2f, of %zu\n",
              Quantile(questions.box_ms(), 0.5), questions.mean_box_results(),
              Quantile(questions.nearest_ms(), 0.5), questions.box_ms().size());
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  portolan::Arguments arguments;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = std::string(argv[i]).substr(2);
    if (name == "address") {
      arguments.address = argv[i + 1];
    } else if (name == "pid") {
      arguments.pid = argv[i + 1];
    } else if (arguments.numbers.contains(name)) {
      arguments.numbers[name] = std::stod(argv[i + 1]);
    } else {
      std::fprintf(stderr, "unknown argument %s\n", argv[i]);
      return 2;
    }
  }
  portolan::Run(arguments);
  return 0;
}
