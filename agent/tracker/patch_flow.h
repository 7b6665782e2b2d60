// Translation of a small window from one image to the next.
#ifndef PORTOLAN_AGENT_TRACKER_PATCH_FLOW_H_
#define PORTOLAN_AGENT_TRACKER_PATCH_FLOW_H_

#include <Eigen/Core>
#include <optional>
#include <span>

#include "agent/tracker/image_pyramid.h"

namespace portolan {

// Pyramidal Lucas-Kanade in the inverse compositional form (Baker & Matthews, IJCV 2004, Sec. 3.2)
// with an unknown brightness offset: gradients are those of the first image's window, so nothing
// but the window itself is read from the second. Levels run from the top of the pyramids to
// `last_level`; a level's result is kept only if it lowers the level's residual, so that a good
// start survives a flat or misleading coarse level. Of several starts the one with the least
// residual at a middle level is taken. No value if the window leaves both images' padded area or
// has no texture at any level.
std::optional<Eigen::Vector2d> TrackTranslation(const ImagePyramid& from, const ImagePyramid& to,
                                                const Eigen::Vector2d& pixel_in_from,
                                                std::span<const Eigen::Vector2d> starts_in_to,
                                                int last_level);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_PATCH_FLOW_H_
