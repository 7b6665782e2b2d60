#include "common/wire/column_codec.h"

#include <algorithm>
#include <bit>

#include "absl/strings/str_cat.h"

namespace portolan {
namespace {

constexpr int kMaxUnary = 24;

uint64_t ZigZag(int64_t v) {
  return (static_cast<uint64_t>(v) << 1) ^ static_cast<uint64_t>(v >> 63);
}
int64_t UnZigZag(uint64_t u) { return static_cast<int64_t>(u >> 1) ^ -static_cast<int64_t>(u & 1); }

// The Rice parameter follows the mean magnitude of the recent integers.
class RiceModel {
 public:
  int Parameter() const {
    int k = 0;
    while ((count_ << k) < sum_) ++k;
    return k;
  }
  void Add(uint64_t u) {
    sum_ += std::min<uint64_t>(u, uint64_t{1} << 32);
    if (++count_ == 32) {
      sum_ /= 2;
      count_ /= 2;
    }
  }

 private:
  uint64_t count_ = 1;
  uint64_t sum_ = 16;
};

class BitWriter {
 public:
  void Write(uint64_t value, int bits) {
    for (int i = bits - 1; i >= 0; --i) WriteBit((value >> i) & 1);
  }
  void WriteOnes(int count) {
    for (int i = 0; i < count; ++i) WriteBit(1);
  }
  std::string Take() { return std::move(bytes_); }

 private:
  void WriteBit(unsigned bit) {
    if (free_bits_ == 0) {
      bytes_.push_back('\0');
      free_bits_ = 8;
    }
    --free_bits_;
    bytes_.back() =
        static_cast<char>(static_cast<unsigned char>(bytes_.back()) | (bit << free_bits_));
  }

  std::string bytes_;
  int free_bits_ = 0;
};

class BitReader {
 public:
  explicit BitReader(std::string_view bytes) : bytes_(bytes) {}

  // Bits beyond the end read as 0 and are counted in position().
  unsigned ReadBit() {
    const size_t byte = position_ / 8;
    const int shift = 7 - static_cast<int>(position_ % 8);
    ++position_;
    return byte < bytes_.size() ? (static_cast<unsigned char>(bytes_[byte]) >> shift) & 1u : 0u;
  }
  uint64_t Read(int bits) {
    uint64_t value = 0;
    for (int i = 0; i < bits; ++i) value = (value << 1) | ReadBit();
    return value;
  }
  size_t position() const { return position_; }

 private:
  std::string_view bytes_;
  size_t position_ = 0;
};

}  // namespace

std::string EncodeColumn(const std::vector<int64_t>& values) {
  BitWriter writer;
  RiceModel model;
  for (const int64_t v : values) {
    const uint64_t u = ZigZag(v);
    const int k = model.Parameter();
    if ((u >> k) < kMaxUnary) {
      writer.WriteOnes(static_cast<int>(u >> k));
      writer.Write(0, 1);
      writer.Write(u, k);
    } else {
      writer.WriteOnes(kMaxUnary);
      writer.Write(u, 64);
    }
    model.Add(u);
  }
  return writer.Take();
}

StatusOr<std::vector<int64_t>> DecodeColumn(std::string_view bytes, size_t count) {
  const size_t bit_count = bytes.size() * 8;
  if (count > bit_count) {
    return absl::InvalidArgumentError(
        absl::StrCat("column of ", bytes.size(), " bytes cannot hold ", count, " integers"));
  }
  std::vector<int64_t> values;
  values.reserve(count);
  BitReader reader(bytes);
  RiceModel model;
  for (size_t i = 0; i < count && reader.position() <= bit_count; ++i) {
    const int k = model.Parameter();
    uint64_t quotient = 0;
    while (quotient < kMaxUnary && reader.ReadBit() != 0) ++quotient;
    const uint64_t u = quotient < kMaxUnary ? (quotient << k) | reader.Read(k) : reader.Read(64);
    values.push_back(UnZigZag(u));
    model.Add(u);
  }
  if (values.size() < count || reader.position() > bit_count) {
    return absl::InvalidArgumentError(
        absl::StrCat("column ends before its ", count, " integers do"));
  }
  if (bit_count - reader.position() >= 8) {
    return absl::InvalidArgumentError(
        absl::StrCat("column has bytes after its ", count, " integers"));
  }
  return values;
}

}  // namespace portolan
