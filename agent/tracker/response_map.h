// Corner measures of the gradient matrix over a part of an image.
#ifndef PORTOLAN_AGENT_TRACKER_RESPONSE_MAP_H_
#define PORTOLAN_AGENT_TRACKER_RESPONSE_MAP_H_

#include <opencv2/core/mat.hpp>
#include <vector>

namespace portolan {

enum class CornerMeasure {
  // Shi & Tomasi (CVPR 1994) ask for the smaller eigenvalue. This is det / trace, between half of
  // it
  // and the whole: it has no crease where the eigenvalues are equal, so that sub-pixel peaks repeat
  // (median 0.20 px against 0.37 px under shifts of a rendered texture).
  kSmallEigenvalue,
  kHarris,  // det - 0.04 trace^2, Harris & Stephens 1988
};

// Row-major values for the pixels of `area`, from the weighted mean of the gradient products
// over 7 x 7 px; the gradients are per pixel, so the units are (grey levels/px)^2 or its square.
// The image is continued by its edge pixels. gray: CV_8UC1; area lies inside it.
std::vector<float> ComputeResponse(const cv::Mat& gray, const cv::Rect& area,
                                   CornerMeasure measure);

}  // namespace portolan

#endif  // PORTOLAN_AGENT_TRACKER_RESPONSE_MAP_H_
