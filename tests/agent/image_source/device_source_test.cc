#include "agent/image_source/device_source.h"

#include <deque>

#include "tests/agent/image_source/test_images.h"
#include "tests/support/matchers.h"

namespace portolan {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

// A camera that delivers what the test puts in, and waits for it.
class ScriptedGrabber : public FrameGrabber {
 public:
  StatusOr<std::pair<Timestamp, cv::Mat>> Grab() override {
    std::unique_lock lock(mutex_);
    ++grabs_;
    changed_.notify_all();
    changed_.wait(lock, [this] { return !script_.empty(); });
    auto result = std::move(script_.front());
    script_.pop_front();
    return result;
  }
  void Put(StatusOr<std::pair<Timestamp, cv::Mat>> result) {
    std::lock_guard lock(mutex_);
    script_.push_back(std::move(result));
    ++put_;
    changed_.notify_all();
  }
  void PutFrame(double seconds, int value) {
    Put(std::pair(FromSeconds(seconds), FlatImage(value)));
  }
  // Until the source has handled all that was put and asks for more.
  void WaitUntilTaken() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return grabs_ > put_; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<StatusOr<std::pair<Timestamp, cv::Mat>>> script_;
  int grabs_ = 0, put_ = 0;
};

class DeviceSourceTest : public testing::Test {
 protected:
  void Start(const ImageSourceOptions& options = {}) {
    ImageSourceInfo info;
    info.calibration.intrinsics = {kTestWidth, kTestHeight, 30, 30, 16, 12};
    auto grabber = std::make_unique<ScriptedGrabber>();
    grabber_ = grabber.get();
    source_ = std::make_unique<DeviceSource>(options, info, std::move(grabber));
  }
  void TearDown() override {
    if (source_) grabber_->Put(absl::UnavailableError("end of the test"));
  }

  std::unique_ptr<DeviceSource> source_;
  ScriptedGrabber* grabber_ = nullptr;
};

TEST_F(DeviceSourceTest, DeliversFramesAsTheyCome) {
  Start();
  for (int i = 1; i <= 3; ++i) {
    grabber_->PutFrame(i, i);
    const auto frame = source_->Next();
    ASSERT_THAT(frame, IsOk());
    EXPECT_EQ((*frame)->time, FromSeconds(i));
    EXPECT_EQ((*frame)->gray.at<uchar>(0, 0), i);
  }
  EXPECT_EQ(source_->counts().dropped, 0);
}

TEST_F(DeviceSourceTest, SlowConsumerGetsTheNewestAndTheRestIsCounted) {
  Start();
  for (int i = 1; i <= 5; ++i) grabber_->PutFrame(i, i);
  grabber_->WaitUntilTaken();
  const auto frame = source_->Next();
  ASSERT_THAT(frame, IsOk());
  EXPECT_EQ((*frame)->index, 4);
  EXPECT_EQ((*frame)->gray.at<uchar>(0, 0), 5);
  EXPECT_EQ(source_->counts().dropped, 4);
}

TEST_F(DeviceSourceTest, LostDeviceIsAnErrorAfterItsLastFrame) {
  Start();
  grabber_->PutFrame(1, 1);
  grabber_->WaitUntilTaken();
  grabber_->Put(absl::UnavailableError("camera device 0: unplugged?"));
  EXPECT_EQ((*source_->Next())->index, 0);
  EXPECT_THAT(source_->Next(), StatusIs(StatusCode::kUnavailable, HasSubstr("unplugged")));
  EXPECT_THAT(source_->Next(), StatusIs(StatusCode::kUnavailable));
}

TEST_F(DeviceSourceTest, RangeEndsTheStream) {
  ImageSourceOptions options;
  options.end = FrameLimit::Index(0);
  Start(options);
  grabber_->PutFrame(1, 1);
  EXPECT_EQ((*source_->Next())->index, 0);
  grabber_->PutFrame(2, 2);
  const auto end = source_->Next();
  ASSERT_THAT(end, IsOk());
  EXPECT_FALSE(end->has_value());
}

TEST_F(DeviceSourceTest, ClockSetBackSkipsTheFrame) {
  Start();
  grabber_->PutFrame(10, 1);
  EXPECT_EQ((*source_->Next())->index, 0);
  grabber_->PutFrame(9, 2);
  grabber_->WaitUntilTaken();
  std::thread later([this] { grabber_->PutFrame(11, 3); });
  const auto frame = source_->Next();
  later.join();
  ASSERT_THAT(frame, IsOk());
  EXPECT_EQ((*frame)->time, FromSeconds(11));
}

TEST_F(DeviceSourceTest, WrongSizeIsAClearError) {
  Start();
  grabber_->Put(std::pair(FromSeconds(1), FlatImage(0, 64, 48)));
  EXPECT_THAT(source_->Next(), StatusIs(StatusCode::kInvalidArgument, HasSubstr("64 x 48")));
}

TEST(ParseDevice, TakesNumbersAndDevicePaths) {
  EXPECT_EQ(ParseDevice("0"), 0);
  EXPECT_EQ(ParseDevice("/dev/video12"), 12);
  for (const char* text : {"", "/dev/video", "/dev/video1a", "camera", "-1", "12345"}) {
    EXPECT_FALSE(ParseDevice(text)) << text;
  }
}

TEST(OpenDevice, AbsentCameraIsNotFound) {
  ImageSourceOptions options;
  const TempDir dir;
  options.path = "/dev/video987";
  options.calibration = dir.Write("c.yaml", TestCalibrationText()).string();
  EXPECT_THAT(OpenImageSource(options), StatusIs(StatusCode::kNotFound, HasSubstr("987")));
}

}  // namespace
}  // namespace portolan
