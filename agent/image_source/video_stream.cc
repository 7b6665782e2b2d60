#include "agent/image_source/video_stream.h"

#include <cmath>
#include <filesystem>
#include <opencv2/imgproc.hpp>

#include "common/base/concat.h"

namespace portolan {

StatusOr<cv::Mat> ToGray(const cv::Mat& image) {
  if (image.empty() || image.depth() != CV_8U) return absl::DataLossError("no 8-bit image");
  cv::Mat gray;
  try {
    switch (image.channels()) {
      case 1:
        return image.clone();  // the capture reuses its buffer
      case 3:
        cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
        return gray;
      case 4:
        cv::cvtColor(image, gray, cv::COLOR_BGRA2GRAY);
        return gray;
    }
  } catch (const cv::Exception& exception) {
    return absl::DataLossError(exception.msg);
  }
  return absl::DataLossError(Concat("image of ", image.channels(), " channels"));
}

StatusOr<std::unique_ptr<VideoStream>> VideoStream::Open(const std::string& path,
                                                         double frame_rate_hz) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) {
    return absl::NotFoundError(Concat(path, ": does not exist"));
  }
  PORTOLAN_ASSIGN_OR_RETURN(MediaLibrary * library, LoadMediaLibrary());
  std::unique_ptr<VideoStream> stream(new VideoStream);
  stream->path_ = path;
  stream->reader_ = library->OpenVideo(path);
  if (stream->reader_ == nullptr) {
    return absl::InvalidArgumentError(Concat(path, ": is not a video that can be decoded"));
  }
  stream->frame_rate_hz_ = frame_rate_hz > 0 ? frame_rate_hz : stream->reader_->FrameRateHz();
  const double count = stream->reader_->FrameCount();
  if (count > 0 && count < 1e12) stream->frame_count_ = std::llround(count);
  if (!(stream->frame_rate_hz_ > 0 && stream->frame_rate_hz_ <= 10000)) {
    return absl::InvalidArgumentError(
        Concat(path, ": does not state its frame rate; give --source.frame_rate_hz"));
  }
  return stream;
}

std::optional<FrameHeader> VideoStream::Advance() {
  if (!reader_->Grab()) return std::nullopt;
  FrameHeader header;
  header.index = next_++;
  header.time = FromSeconds(static_cast<double>(header.index) / frame_rate_hz_);
  header.next_time = FromSeconds(static_cast<double>(header.index + 1) / frame_rate_hz_);
  header.name = Concat(path_, " frame ", header.index);
  return header;
}

StatusOr<FrameImages> VideoStream::Decode() {
  const StatusOr<cv::Mat> gray = ToGray(reader_->Retrieve());
  if (!gray.ok()) {
    return absl::DataLossError(Concat(
        path_, " frame ", next_ - 1, " cannot be decoded: ", std::string(gray.status().message())));
  }
  return FrameImages{*gray, {}};
}

}  // namespace portolan
