#include "agent/image_source/image_decoder.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "absl/strings/ascii.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

using Bytes = std::vector<unsigned char>;

// No camera makes larger files; protects from a wrong path.
constexpr std::streamoff kMaxFileBytes = 256 << 20;
// Some writers pad the file behind its end marker.
constexpr size_t kMaxPadding = 256;

template <size_t kSize>
bool StartsWith(const Bytes& bytes, const std::array<unsigned char, kSize>& magic) {
  return bytes.size() >= kSize && std::equal(magic.begin(), magic.end(), bytes.begin());
}

template <size_t kSize>
bool EndsWithNear(const Bytes& bytes, const std::array<unsigned char, kSize>& marker) {
  const auto begin = bytes.end() - std::min(bytes.size(), kMaxPadding + kSize);
  return std::search(begin, bytes.end(), marker.begin(), marker.end()) != bytes.end();
}

// Whether a JPEG or PNG lacks its end marker; other formats are left to the decoder.
bool IsTruncated(const Bytes& bytes) {
  if (StartsWith<3>(bytes, {0xff, 0xd8, 0xff})) return !EndsWithNear<2>(bytes, {0xff, 0xd9});
  if (StartsWith<4>(bytes, {0x89, 'P', 'N', 'G'})) {
    return !EndsWithNear<4>(bytes, {'I', 'E', 'N', 'D'});
  }
  return false;
}

Status ReadBytes(const std::filesystem::path& path, Bytes* bytes) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  std::error_code error;
  if (!file || std::filesystem::is_directory(path, error)) {
    return absl::NotFoundError(Concat(path, ": image is missing or cannot be opened"));
  }
  const std::streamoff size = file.tellg();
  if (size <= 0 || size > kMaxFileBytes) {
    return absl::DataLossError(Concat(path, ": image file of ", int64_t{size}, " bytes"));
  }
  bytes->resize(size);
  file.seekg(0);
  if (!file.read(reinterpret_cast<char*>(bytes->data()), size)) {
    return absl::DataLossError(Concat(path, ": image cannot be read"));
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<cv::Mat> ImageDecoder::DecodeGray(const std::filesystem::path& path) {
  PORTOLAN_RETURN_IF_ERROR(ReadBytes(path, &bytes_));
  if (IsTruncated(bytes_)) return absl::DataLossError(Concat(path, ": image is truncated"));
  cv::Mat gray;
  try {
    gray = cv::imdecode(bytes_, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& exception) {
    return absl::DataLossError(Concat(path, ": image cannot be decoded: ", exception.msg));
  }
  if (gray.empty() || gray.type() != CV_8UC1) {
    return absl::DataLossError(Concat(path, ": is damaged or no image"));
  }
  return gray;
}

bool HasImageExtension(const std::filesystem::path& path) {
  const std::string extension = absl::AsciiStrToLower(path.extension().string());
  for (const char* known :
       {".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp", ".tif", ".tiff", ".webp"}) {
    if (extension == known) return true;
  }
  return false;
}

}  // namespace portolan
