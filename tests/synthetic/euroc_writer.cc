#include "tests/synthetic/euroc_writer.h"

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "common/camera/calibration.h"
#include "common/trajectory/trajectory_io.h"
#include "tests/synthetic/frame_renderer.h"
#include "tests/synthetic/ranges.h"

namespace portolan::synthetic {
namespace {

namespace fs = std::filesystem;

Status WriteText(const fs::path& path, const std::string& text) {
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  std::ofstream output(path);
  output << text;
  output.flush();
  if (!output) return absl::UnavailableError(absl::StrCat(path.string(), ": cannot be written"));
  return absl::OkStatus();
}

CameraCalibration CameraOf(const Mission& mission) {
  CameraCalibration calibration;
  calibration.intrinsics = mission.options.camera;
  calibration.body_from_camera = mission.body_from_camera;
  calibration.rate_hz = mission.options.frame_rate_hz;
  return calibration;
}

ImuCalibration ImuOf(const ImuOptions& imu) {
  ImuCalibration calibration;
  calibration.rate_hz = imu.rate_hz;
  calibration.gyroscope_noise_density = imu.gyroscope_noise_density;
  calibration.gyroscope_random_walk = imu.gyroscope_random_walk;
  calibration.accelerometer_noise_density = imu.accelerometer_noise_density;
  calibration.accelerometer_random_walk = imu.accelerometer_random_walk;
  return calibration;
}

void AppendVector(const Eigen::Vector3d& vector, std::string* line) {
  for (int i = 0; i < 3; ++i) absl::StrAppendFormat(line, ",%.12g", vector[i]);
}

// imu0/data.csv and state_groundtruth_estimate0/data.csv have a line a sample.
Status WriteInertial(const Mission& mission, const AgentPlan& agent,
                     const std::vector<ImuSample>& samples, const fs::path& mav) {
  std::string imu =
      "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
      "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n";
  std::string truth =
      "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
      "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],b_w_RS_S_x [rad s^-1],"
      "b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1],b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],"
      "b_a_RS_S_z [m s^-2]\n";
  for (const ImuSample& sample : samples) {
    const int64_t time_ns = (mission.options.start_time + sample.time_since_start).count();
    const BodyState state = agent.path.At(ToSeconds(sample.time_since_start));
    const Eigen::Quaterniond& q = state.world_from_body.rotation;
    absl::StrAppend(&imu, time_ns);
    AppendVector(sample.angular_velocity_rad_s, &imu);
    AppendVector(sample.specific_force_m_s2, &imu);
    absl::StrAppend(&truth, time_ns);
    AppendVector(state.world_from_body.translation, &truth);
    absl::StrAppendFormat(&truth, ",%.12g,%.12g,%.12g,%.12g", q.w(), q.x(), q.y(), q.z());
    AppendVector(state.velocity_in_world, &truth);
    AppendVector(sample.gyroscope_bias, &truth);
    AppendVector(sample.accelerometer_bias, &truth);
    imu += '\n';
    truth += '\n';
  }
  PORTOLAN_RETURN_IF_ERROR(WriteText(mav / "imu0" / "data.csv", imu));
  PORTOLAN_RETURN_IF_ERROR(
      WriteEurocImuYaml(ImuOf(mission.options.imu), mav / "imu0" / "sensor.yaml"));
  return WriteText(mav / "state_groundtruth_estimate0" / "data.csv", truth);
}

Status WriteRanges(const Mission& mission, int agent, const fs::path& folder) {
  const RangeMount mount;
  std::string data = "#timestamp [ns],range [m]\n";
  for (const RangeSample& sample : SimulateRanges(mission, agent, mount)) {
    absl::StrAppendFormat(&data, "%d,%.4f\n",
                          (mission.options.start_time + sample.time_since_start).count(),
                          sample.range_m);
  }
  PORTOLAN_RETURN_IF_ERROR(WriteText(folder / "data.csv", data));
  const Eigen::Vector3d &p = mount.position_in_camera_m, &d = mount.direction_in_camera;
  return WriteText(folder / "sensor.yaml",
                   absl::StrFormat("sensor_type: range_finder\n"
                                   "position_in_camera_m: [%.12g, %.12g, %.12g]\n"
                                   "direction_in_camera: [%.12g, %.12g, %.12g]\n"
                                   "sigma_m: %.12g\nmin_range_m: 0.1\nmax_range_m: 40\n",
                                   p.x(), p.y(), p.z(), d.x(), d.y(), d.z(), mount.sigma_m));
}

Status WriteImage(const fs::path& path, const cv::Mat1b& image) {
  const std::vector<int> parameters = {cv::IMWRITE_PNG_COMPRESSION, 1, cv::IMWRITE_JPEG_QUALITY,
                                       95};
  bool is_written = false;
  try {
    is_written = cv::imwrite(path.string(), image, parameters);
  } catch (const cv::Exception& exception) {
    return absl::UnavailableError(absl::StrCat(path.string(), ": ", exception.what()));
  }
  if (!is_written) return absl::UnavailableError(absl::StrCat(path.string(), ": not written"));
  return absl::OkStatus();
}

Status WriteImages(const Mission& mission, int agent, const fs::path& cam,
                   const EurocWriterOptions& options) {
  std::error_code error;
  fs::create_directories(cam / "data", error);
  FrameRenderer renderer(mission, agent);
  std::string list = "#timestamp [ns],filename\n";
  cv::Mat1b image;
  for (int frame = 0; frame < mission.options.frames; ++frame) {
    const int64_t time_ns = mission.FrameTime(frame).count();
    const std::string name = absl::StrCat(time_ns, ".", options.image_format);
    renderer.Render(frame, &image);
    PORTOLAN_RETURN_IF_ERROR(WriteImage(cam / "data" / name, image));
    absl::StrAppend(&list, time_ns, ",", name, "\n");
    options.on_frame(frame);
  }
  PORTOLAN_RETURN_IF_ERROR(WriteEurocSensorYaml(CameraOf(mission), cam / "sensor.yaml"));
  return WriteText(cam / "data.csv", list);
}

}  // namespace

Status EurocWriterOptions::Validate() const {
  for (const char* known : {"png", "jpg", "pgm"}) {
    if (image_format == known) return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat("unknown image format '", image_format, "'; one of png, jpg, pgm"));
}

Trajectory CameraGroundTruth(const Mission& mission, int agent) {
  Trajectory trajectory;
  for (int frame = 0; frame < mission.options.frames; ++frame) {
    trajectory.push_back({mission.FrameTime(frame),
                          mission.WorldFromCamera(mission.agents[static_cast<size_t>(agent)],
                                                  mission.FrameTimeSinceStart_s(frame))});
  }
  return trajectory;
}

Status WriteEurocAgent(const Mission& mission, int agent, const std::string& folder,
                       const EurocWriterOptions& options) {
  PORTOLAN_RETURN_IF_ERROR(options.Validate());
  const AgentPlan& plan = mission.agents[static_cast<size_t>(agent)];
  const fs::path root = fs::path(folder) / plan.name;
  PORTOLAN_RETURN_IF_ERROR(WriteImages(mission, agent, root / "mav0" / "cam0", options));
  if (mission.options.stereo_baseline_m > 0) {
    EurocWriterOptions quiet = options;
    quiet.on_frame = [](int) {};
    PORTOLAN_RETURN_IF_ERROR(
        WriteImages(mission.OfSecondCamera(), agent, root / "mav0" / "cam1", quiet));
  }
  ImuOptions imu = mission.options.imu;
  imu.seed = mission.options.seed * 37 + static_cast<uint64_t>(agent);
  PORTOLAN_RETURN_IF_ERROR(
      WriteInertial(mission, plan, SimulateImu(plan.path, imu), root / "mav0"));
  if (mission.options.range_rate_hz > 0) {
    PORTOLAN_RETURN_IF_ERROR(WriteRanges(mission, agent, root / "mav0" / "range0"));
  }
  return WriteTumTrajectory(CameraGroundTruth(mission, agent), (root / "groundtruth.txt").string());
}

}  // namespace portolan::synthetic
