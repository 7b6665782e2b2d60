#include "agent/image_source/image_decoder.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <string>

#include "absl/strings/ascii.h"
#include "agent/image_source/image_codecs.h"
#include "agent/image_source/media_library.h"
#include "common/base/concat.h"

namespace portolan {
namespace {

using Bytes = std::vector<unsigned char>;

// No camera makes larger files; protects from a wrong path.
constexpr std::streamoff kMaxFileBytes = 256 << 20;
// Some writers pad the file behind its end marker.
constexpr size_t kMaxPadding = 256;

template <size_t kSize>
bool EndsWithNear(const Bytes& bytes, const std::array<unsigned char, kSize>& marker) {
  const auto begin = bytes.end() - std::min(bytes.size(), kMaxPadding + kSize);
  return std::search(begin, bytes.end(), marker.begin(), marker.end()) != bytes.end();
}

// Whether a JPEG or PNG lacks its end marker; other formats are left to the decoder.
bool IsTruncated(const Bytes& bytes) {
  if (IsJpeg(bytes)) return !EndsWithNear<2>(bytes, {0xff, 0xd9});
  if (IsPng(bytes)) return !EndsWithNear<4>(bytes, {'I', 'E', 'N', 'D'});
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

// Empty if they are no image.
StatusOr<cv::Mat> Decode(const Bytes& bytes) {
  if (IsPng(bytes)) return DecodePngGray(bytes);
  if (IsJpeg(bytes)) {
    const cv::Mat gray = DecodeJpegGray(bytes);
    if (!gray.empty()) return gray;
  }
  const StatusOr<MediaLibrary*> library = LoadMediaLibrary();
  if (library.ok()) return (*library)->DecodeGray(bytes);
  // Damaged, or of four inks.
  if (IsJpeg(bytes)) return cv::Mat();
  return library.status();
}

}  // namespace

StatusOr<cv::Mat> ImageDecoder::DecodeGray(const std::filesystem::path& path) {
  PORTOLAN_RETURN_IF_ERROR(ReadBytes(path, &bytes_));
  if (IsTruncated(bytes_)) return absl::DataLossError(Concat(path, ": image is truncated"));
  PORTOLAN_ASSIGN_OR_RETURN(const cv::Mat gray, Decode(bytes_));
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
