#include "tests/synthetic/ranges.h"

#include <cmath>

#include "tests/synthetic/random.h"

namespace portolan::synthetic {

std::optional<double> CastRay(const World& world, const Eigen::Vector3d& origin,
                              const Eigen::Vector3d& direction) {
  std::optional<double> nearest;
  for (const Surface& surface : world.surfaces) {
    const Eigen::Vector3d normal = surface.u.cross(surface.v);
    const double along = normal.dot(direction);
    if (std::abs(along) < 1e-9) continue;
    const double range = normal.dot(surface.corner - origin) / along;
    if (range <= 0 || (nearest && range >= *nearest)) continue;
    const Eigen::Vector3d on_surface = origin + range * direction - surface.corner;
    const double u = surface.u.dot(on_surface), v = surface.v.dot(on_surface);
    if (u >= 0 && u <= surface.width_m && v >= 0 && v <= surface.height_m) nearest = range;
  }
  return nearest;
}

std::vector<RangeSample> SimulateRanges(const Mission& mission, int agent,
                                        const RangeMount& mount) {
  std::vector<RangeSample> samples;
  if (!(mission.options.range_rate_hz > 0)) return samples;
  Random random(mission.options.seed * 41 + static_cast<uint64_t>(agent));
  const AgentPlan& plan = mission.agents[static_cast<size_t>(agent)];
  const double end_s = mission.FrameTimeSinceStart_s(mission.options.frames - 1);
  const double period_s = 1 / mission.options.range_rate_hz;
  for (double time_s = 0.37 * period_s; time_s <= end_s; time_s += period_s) {
    const Rigid3 camera = mission.WorldFromCamera(plan, time_s);
    const auto range = CastRay(mission.world, camera * mount.position_in_camera_m,
                               camera.rotation * mount.direction_in_camera);
    samples.push_back({FromSeconds(time_s), range ? *range + mount.sigma_m * random.Normal() : 0});
  }
  return samples;
}

}  // namespace portolan::synthetic
