#include "agent/image_source/image_codecs.h"

// jpeglib.h does not include it.
#include <cstdio>
// clang-format off
#include <jpeglib.h>
// clang-format on
#include <png.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdint>
#include <cstring>

namespace portolan {
namespace {

using Bytes = std::vector<unsigned char>;

constexpr uint64_t kMaxPixels = uint64_t{1} << 28;

bool IsTooLarge(uint64_t width, uint64_t height) {
  return width == 0 || height == 0 || width * height > kMaxPixels;
}

// Both libraries report an error by a function that must not return. Between each setjmp below and
// the calls it guards there is nothing with a destructor.

class JpegReader {
 public:
  explicit JpegReader(const Bytes& bytes) {
    cinfo_.err = jpeg_std_error(&errors_.manager);
    errors_.manager.error_exit = [](j_common_ptr cinfo) {
      std::longjmp(reinterpret_cast<Errors*>(cinfo->err)->jump, 1);
    };
    errors_.manager.output_message = [](j_common_ptr) {};
    if (setjmp(errors_.jump) != 0) return;
    jpeg_create_decompress(&cinfo_);
    jpeg_mem_src(&cinfo_, bytes.data(), bytes.size());
    if (jpeg_read_header(&cinfo_, TRUE) != JPEG_HEADER_OK) return;
    is_usable_ = cinfo_.num_components != 4 && !IsTooLarge(cinfo_.image_width, cinfo_.image_height);
  }
  ~JpegReader() { jpeg_destroy_decompress(&cinfo_); }
  JpegReader(const JpegReader&) = delete;
  JpegReader& operator=(const JpegReader&) = delete;

  bool is_usable() const { return is_usable_; }
  int width() const { return static_cast<int>(cinfo_.image_width); }
  int height() const { return static_cast<int>(cinfo_.image_height); }

  bool Read(unsigned char* pixels, size_t stride) {
    if (setjmp(errors_.jump) != 0) return false;
    cinfo_.out_color_space = JCS_GRAYSCALE;
    jpeg_start_decompress(&cinfo_);
    while (cinfo_.output_scanline < cinfo_.output_height) {
      JSAMPROW row = pixels + stride * cinfo_.output_scanline;
      jpeg_read_scanlines(&cinfo_, &row, 1);
    }
    jpeg_finish_decompress(&cinfo_);
    return true;
  }

 private:
  struct Errors {
    jpeg_error_mgr manager;  // first: the library knows its address only
    std::jmp_buf jump;
  };
  jpeg_decompress_struct cinfo_ = {};
  Errors errors_;
  bool is_usable_ = false;
};

class PngReader {
 public:
  explicit PngReader(const Bytes& bytes) : next_(bytes.data()), end_(next_ + bytes.size()) {
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, &OnError, &OnWarning);
    if (png_ == nullptr) return;
    info_ = png_create_info_struct(png_);
    if (info_ == nullptr) return;
    if (setjmp(jump_) != 0) return;
    png_set_read_fn(png_, this, &OnRead);
    png_read_info(png_, info_);
    width_ = png_get_image_width(png_, info_);
    height_ = png_get_image_height(png_, info_);
    is_usable_ = !IsTooLarge(width_, height_);
  }
  ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  bool is_usable() const { return is_usable_; }
  int width() const { return static_cast<int>(width_); }
  int height() const { return static_cast<int>(height_); }

  bool Read(unsigned char** rows) {
    if (setjmp(jump_) != 0) return false;
    const int type = png_get_color_type(png_, info_);
    if (png_get_bit_depth(png_, info_) == 16) png_set_strip_16(png_);
    png_set_strip_alpha(png_);
    if (type == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png_);
    if ((type & PNG_COLOR_MASK_COLOR) == 0) {
      png_set_expand_gray_1_2_4_to_8(png_);
    } else {
      png_set_rgb_to_gray(png_, PNG_ERROR_ACTION_NONE, 0.299, 0.587);
    }
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    if (png_get_rowbytes(png_, info_) != width_) return false;
    png_read_image(png_, rows);
    png_read_end(png_, nullptr);
    return true;
  }

 private:
  [[noreturn]] static void OnError(png_structp png, png_const_charp) {
    std::longjmp(static_cast<PngReader*>(png_get_error_ptr(png))->jump_, 1);
  }
  static void OnWarning(png_structp, png_const_charp) {}
  static void OnRead(png_structp png, png_bytep to, size_t size) {
    PngReader* reader = static_cast<PngReader*>(png_get_io_ptr(png));
    if (size > static_cast<size_t>(reader->end_ - reader->next_)) png_error(png, "truncated");
    std::memcpy(to, reader->next_, size);
    reader->next_ += size;
  }

  const unsigned char* next_;
  const unsigned char* end_;
  std::jmp_buf jump_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
  uint32_t width_ = 0, height_ = 0;
  bool is_usable_ = false;
};

template <size_t kSize>
bool StartsWith(const Bytes& bytes, const std::array<unsigned char, kSize>& magic) {
  return bytes.size() >= kSize && std::equal(magic.begin(), magic.end(), bytes.begin());
}

}  // namespace

bool IsJpeg(const Bytes& bytes) { return StartsWith<3>(bytes, {0xff, 0xd8, 0xff}); }
bool IsPng(const Bytes& bytes) { return StartsWith<4>(bytes, {0x89, 'P', 'N', 'G'}); }

cv::Mat DecodeJpegGray(const Bytes& bytes) {
  JpegReader reader(bytes);
  if (!reader.is_usable()) return cv::Mat();
  cv::Mat gray(reader.height(), reader.width(), CV_8UC1);
  return reader.Read(gray.data, gray.step) ? gray : cv::Mat();
}

cv::Mat DecodePngGray(const Bytes& bytes) {
  PngReader reader(bytes);
  if (!reader.is_usable()) return cv::Mat();
  cv::Mat gray(reader.height(), reader.width(), CV_8UC1);
  std::vector<unsigned char*> rows(gray.rows);
  for (int y = 0; y < gray.rows; ++y) rows[y] = gray.ptr(y);
  return reader.Read(rows.data()) ? gray : cv::Mat();
}

}  // namespace portolan
