#include "server/cli/exports.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "common/geometry/similarity3.h"

namespace portolan {
namespace {

// "%.9f" of nanoseconds without the rounding of a double.
std::string Seconds(int64_t time_ns) {
  char text[40];
  std::snprintf(text, sizeof(text), "%lld.%09lld", static_cast<long long>(time_ns / 1000000000),
                static_cast<long long>(time_ns % 1000000000));
  return text;
}

std::string Numbers(std::initializer_list<double> values) {
  std::string line;
  for (const double value : values) {
    char text[40];
    std::snprintf(text, sizeof(text), "%s%.12g", line.empty() ? "" : " ", value);
    line += text;
  }
  return line;
}

Similarity3 ToSimilarity(const v1::Similarity3& message) {
  const v1::Quaternion& q = message.rotation();
  const v1::Vector3& t = message.translation();
  return {message.scale(), Eigen::Quaterniond(q.w(), q.x(), q.y(), q.z()), {t.x(), t.y(), t.z()}};
}

std::string PoseText(const Rigid3& pose) {
  const Eigen::Vector3d& t = pose.translation;
  const Eigen::Quaterniond& q = pose.rotation;
  return Numbers({t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()});
}

// Information of [translation in world units; quaternion vector part], the scale marginalised out.
Matrix6d PoseInformation(const v1::PoseGraphEdge& edge, double world_scale_of_b) {
  Matrix7d information;
  for (int row = 0, i = 0; row < 7; ++row) {
    for (int column = row; column < 7; ++column, ++i) {
      information(row, column) = information(column, row) = edge.information(i);
    }
  }
  Matrix6d marginal = information.topLeftCorner<6, 6>();
  if (information(6, 6) > 0) {
    const Vector6d coupling = information.topRightCorner<6, 1>();
    marginal -= coupling * coupling.transpose() / information(6, 6);
  }
  // translation_b = translation_world / scale; rotation vector = 2 * quaternion vector part.
  Vector6d factor;
  factor << Eigen::Vector3d::Constant(1 / world_scale_of_b), Eigen::Vector3d::Constant(2);
  return factor.asDiagonal() * marginal * factor.asDiagonal();
}

}  // namespace

void WriteTum(const std::vector<v1::TrajectorySegment>& segments, std::ostream& out) {
  out << "# timestamp tx ty tz qx qy qz qw\n";
  for (const v1::TrajectorySegment& segment : segments) {
    const auto& numbers = segment.world_from_camera();
    const int count = std::min(segment.time_ns_size(), numbers.size() / 7);
    for (int i = 0; i < count; ++i) {
      const double* pose = numbers.data() + 7 * i;
      out << Seconds(segment.time_ns(i)) << " "
          << Numbers({pose[4], pose[5], pose[6], pose[1], pose[2], pose[3], pose[0]}) << "\n";
    }
  }
}

void WritePly(const v1::LandmarkPage& page, std::ostream& out) {
  out << "ply\nformat ascii 1.0\ncomment Portolan map version " << page.map_version()
      << ", component " << page.component_id()
      << (page.metric() ? ", metres\n" : ", no metric scale\n") << "element vertex "
      << page.landmarks_size()
      << "\nproperty double x\nproperty double y\nproperty double z\nproperty float sigma\n"
         "property int observations\nproperty int agents\nend_header\n";
  for (const v1::Landmark& landmark : page.landmarks()) {
    const v1::Vector3& point = landmark.point_in_world();
    double variance = 0;
    if (landmark.covariance_size() == 6) {
      variance = std::max({landmark.covariance(0), landmark.covariance(3), landmark.covariance(5)});
    }
    out << Numbers({point.x(), point.y(), point.z(), std::sqrt(std::max(variance, 0.0))}) << " "
        << landmark.observation_count() << " " << landmark.agents_size() << "\n";
  }
}

void WriteG2o(const v1::PoseGraphPage& graph, std::ostream& out) {
  std::map<int64_t, double> scales;
  out << "# Portolan map version " << graph.map_version()
      << "; the comment before a vertex: time[s] agent session number component\n";
  for (const v1::PoseGraphNode& node : graph.nodes()) {
    const Similarity3 world_from_submap = ToSimilarity(node.world_from_submap());
    scales[node.submap_id()] = world_from_submap.scale;
    out << "# " << Seconds(node.time_ns()) << " " << node.agent_id() << " " << node.session_id()
        << " " << node.sequence_number() << " " << node.component_id() << "\nVERTEX_SE3:QUAT "
        << node.submap_id() << " " << PoseText(world_from_submap.Rigid()) << "\n";
  }
  for (const v1::PoseGraphEdge& edge : graph.edges()) {
    const auto scale_a = scales.find(edge.submap_a());
    const auto scale_b = scales.find(edge.submap_b());
    if (scale_a == scales.end() || scale_b == scales.end() || edge.information_size() != 28) {
      continue;
    }
    Rigid3 a_from_b = ToSimilarity(edge.a_from_b()).Rigid();
    a_from_b.translation *= scale_a->second;
    out << "EDGE_SE3:QUAT " << edge.submap_a() << " " << edge.submap_b() << " "
        << PoseText(a_from_b);
    const Matrix6d information = PoseInformation(edge, scale_b->second);
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column) {
        out << " " << Numbers({information(row, column)});
      }
    }
    out << "\n";
  }
}

}  // namespace portolan
