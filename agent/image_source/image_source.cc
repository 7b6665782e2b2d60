#include "agent/image_source/image_source.h"

namespace portolan {
namespace {

template <typename Sample>
std::vector<Sample> TakeUpTo(const std::vector<Sample>& samples, Timestamp up_to, size_t* taken) {
  const size_t begin = *taken;
  while (*taken < samples.size() && samples[*taken].time <= up_to) ++*taken;
  return std::vector<Sample>(samples.begin() + begin, samples.begin() + *taken);
}

}  // namespace

std::vector<ImuSample> ImageSource::TakeImu(Timestamp up_to) {
  return TakeUpTo(imu_, up_to, &imu_taken_);
}

std::vector<OdometrySample> ImageSource::TakeOdometry(Timestamp up_to) {
  return TakeUpTo(odometry_, up_to, &odometry_taken_);
}

std::vector<GnssFix> ImageSource::TakeGnss(Timestamp up_to) {
  return TakeUpTo(gnss_, up_to, &gnss_taken_);
}

std::vector<RangeSample> ImageSource::TakeRanges(Timestamp up_to) {
  return TakeUpTo(ranges_, up_to, &ranges_taken_);
}

}  // namespace portolan
