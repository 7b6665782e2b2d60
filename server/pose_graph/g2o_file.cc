#include "server/pose_graph/g2o_file.h"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <iomanip>
#include <sstream>
#include <unordered_map>

namespace portolan {
namespace {

// Turns the fields of one line into numbers; remembers the first thing that was wrong.
class LineReader {
 public:
  explicit LineReader(const std::string& line) : stream_(line) { stream_ >> tag_; }

  const std::string& tag() const { return tag_; }
  const std::string& problem() const { return problem_; }

  int64_t Id() {
    int64_t id = 0;
    if (!(stream_ >> id)) Fail("a node id is missing or not a whole number");
    return id;
  }

  double Number() {
    std::string word;
    if (!(stream_ >> word)) {
      Fail("numbers are missing");
      return 0;
    }
    char* end = nullptr;
    const double value = std::strtod(word.c_str(), &end);
    if (*end != '\0' || !std::isfinite(value)) Fail("'" + word + "' is not a finite number");
    return value;
  }

  bool AtEnd() {
    stream_ >> std::ws;
    return stream_.eof();
  }

  void Fail(const std::string& problem) {
    if (problem_.empty()) problem_ = problem;
  }

 private:
  std::istringstream stream_;
  std::string tag_;
  std::string problem_;
};

Eigen::Vector3d ReadVector3(LineReader& line) {
  Eigen::Vector3d v;
  for (int i = 0; i < 3; ++i) v[i] = line.Number();
  return v;
}

Rigid3 ReadRigid3(LineReader& line) {
  Rigid3 pose;
  pose.translation = ReadVector3(line);
  for (int i = 0; i < 4; ++i) pose.rotation.coeffs()[i] = line.Number();
  const double norm = pose.rotation.norm();
  if (!(norm > 1e-6)) line.Fail("the quaternion is zero");
  if (norm > 1e-6) pose.rotation.coeffs() /= norm;
  return pose;
}

template <int N>
Eigen::Matrix<double, N, N> ReadUpperTriangle(LineReader& line) {
  Eigen::Matrix<double, N, N> m;
  for (int i = 0; i < N; ++i) {
    for (int j = i; j < N; ++j) m(i, j) = m(j, i) = line.Number();
  }
  return m;
}

// Edges by node id until all nodes are known.
template <typename Edge>
struct NamedEdge {
  int64_t a, b;
  Edge edge;
  int line;
};

template <typename Graph, typename Edge>
struct GraphReader {
  Graph graph;
  std::unordered_map<int64_t, int> index;
  std::vector<NamedEdge<Edge>> edges;

  void AddNode(int64_t id, const auto& pose, LineReader& line) {
    if (!index.emplace(id, static_cast<int>(graph.ids.size())).second) {
      line.Fail("node " + std::to_string(id) + " is defined twice");
      return;
    }
    graph.ids.push_back(id);
    graph.world_from_node.push_back(pose);
  }

  bool empty() const { return graph.ids.empty() && edges.empty(); }

  Status Resolve(const std::string& path, const std::vector<int64_t>& fixed) {
    for (auto& named : edges) {
      const auto a = index.find(named.a), b = index.find(named.b);
      if (a == index.end() || b == index.end()) {
        return absl::InvalidArgumentError(path + ":" + std::to_string(named.line) +
                                          ": an end of the edge is not a node of the file");
      }
      named.edge.a = a->second;
      named.edge.b = b->second;
      graph.edges.push_back(named.edge);
    }
    for (int64_t id : fixed) {
      const auto node = index.find(id);
      if (node == index.end()) {
        return absl::InvalidArgumentError(path + ": FIX names node " + std::to_string(id) +
                                          ", which the file does not define");
      }
      graph.fixed.push_back(node->second);
    }
    return absl::OkStatus();
  }
};

using Reader3 = GraphReader<PoseGraph3, PoseEdge3>;
using Reader2 = GraphReader<PoseGraph2, PoseEdge2>;

void ReadLine(LineReader& line, int number, Reader3& reader3, Reader2& reader2,
              std::vector<int64_t>& fixed) {
  if (line.tag() == "VERTEX_SE3:QUAT") {
    const int64_t id = line.Id();
    reader3.AddNode(id, ReadRigid3(line), line);
  } else if (line.tag() == "VERTEX_SE2") {
    const int64_t id = line.Id();
    reader2.AddNode(id, ReadVector3(line), line);
  } else if (line.tag() == "EDGE_SE3:QUAT") {
    NamedEdge<PoseEdge3> named{line.Id(), 0, {}, number};
    named.b = line.Id();
    named.edge.a_from_b = ReadRigid3(line);
    named.edge.information = ReadUpperTriangle<6>(line);
    reader3.edges.push_back(named);
  } else if (line.tag() == "EDGE_SE2") {
    NamedEdge<PoseEdge2> named{line.Id(), 0, {}, number};
    named.b = line.Id();
    named.edge.a_from_b = ReadVector3(line);
    named.edge.information = ReadUpperTriangle<3>(line);
    reader2.edges.push_back(named);
  } else if (line.tag() == "FIX") {
    fixed.push_back(line.Id());
    return;
  } else {
    line.Fail("unknown tag '" + line.tag() + "'");
  }
  if (line.problem().empty() && !line.AtEnd()) line.Fail("more fields than the tag has");
}

Status WriteAtomically(const std::string& path, const std::function<void(std::ostream&)>& write) {
  const std::string temporary = path + ".tmp";
  std::ofstream file(temporary);
  file << std::setprecision(17);
  write(file);
  file.close();
  if (!file) return absl::UnavailableError("cannot write " + temporary);
  if (std::rename(temporary.c_str(), path.c_str()) != 0) {
    return absl::UnavailableError("cannot rename " + temporary + " to " + path);
  }
  return absl::OkStatus();
}

void Write(std::ostream& out, const Rigid3& pose) {
  out << pose.translation.transpose() << ' ' << pose.rotation.coeffs().transpose();
}

void WriteInformation(std::ostream& out, const auto& information) {
  for (int i = 0; i < information.rows(); ++i) {
    for (int j = i; j < information.cols(); ++j) out << ' ' << information(i, j);
  }
  out << '\n';
}

void WriteGraph(std::ostream& out, const auto& graph, const std::string& suffix,
                const auto& write_pose) {
  for (size_t i = 0; i < graph.ids.size(); ++i) {
    out << "VERTEX_" << suffix << ' ' << graph.ids[i] << ' ';
    write_pose(out, graph.world_from_node[i]);
    out << '\n';
  }
  for (int node : graph.fixed) out << "FIX " << graph.ids[static_cast<size_t>(node)] << '\n';
  for (const auto& edge : graph.edges) {
    out << "EDGE_" << suffix << ' ' << graph.ids[static_cast<size_t>(edge.a)] << ' '
        << graph.ids[static_cast<size_t>(edge.b)] << ' ';
    write_pose(out, edge.a_from_b);
    WriteInformation(out, edge.information);
  }
}

void WritePlane(std::ostream& out, const Eigen::Vector3d& pose) { out << pose.transpose(); }

}  // namespace

StatusOr<std::variant<PoseGraph3, PoseGraph2>> ReadG2o(const std::string& path) {
  std::ifstream file(path);
  if (!file) return absl::NotFoundError("cannot open " + path);
  Reader3 reader3;
  Reader2 reader2;
  std::vector<int64_t> fixed;
  std::string text;
  for (int number = 1; std::getline(file, text); ++number) {
    LineReader line(text);
    if (line.tag().empty() || line.tag().front() == '#') continue;
    ReadLine(line, number, reader3, reader2, fixed);
    if (!reader3.empty() && !reader2.empty()) line.Fail("the file mixes 2-D and 3-D");
    if (!line.problem().empty()) {
      return absl::InvalidArgumentError(path + ":" + std::to_string(number) + ": " +
                                        line.problem());
    }
  }
  if (reader3.empty() && reader2.empty()) {
    return absl::InvalidArgumentError(path + ": holds no pose graph");
  }
  if (!reader2.empty()) {
    PORTOLAN_RETURN_IF_ERROR(reader2.Resolve(path, fixed));
    return reader2.graph;
  }
  PORTOLAN_RETURN_IF_ERROR(reader3.Resolve(path, fixed));
  return reader3.graph;
}

Status WriteG2o(const std::string& path, const PoseGraph3& graph) {
  return WriteAtomically(
      path, [&graph](std::ostream& out) { WriteGraph(out, graph, "SE3:QUAT", Write); });
}

Status WriteG2o(const std::string& path, const PoseGraph2& graph) {
  return WriteAtomically(
      path, [&graph](std::ostream& out) { WriteGraph(out, graph, "SE2", WritePlane); });
}

Status WriteTumOfGraph(const std::string& path, const PoseGraph3& graph) {
  return WriteAtomically(path, [&graph](std::ostream& out) {
    for (size_t i = 0; i < graph.ids.size(); ++i) {
      out << graph.ids[i] << ' ';
      Write(out, graph.world_from_node[i]);
      out << '\n';
    }
  });
}

Status WriteTumOfGraph(const std::string& path, const PoseGraph2& graph) {
  PoseGraph3 lifted;
  lifted.ids = graph.ids;
  for (const Eigen::Vector3d& pose : graph.world_from_node) {
    lifted.world_from_node.push_back(
        {RotationExp({0, 0, pose[2]}), Eigen::Vector3d(pose[0], pose[1], 0)});
  }
  return WriteTumOfGraph(path, lifted);
}

}  // namespace portolan
