// Binary arithmetic coding: bits of known probability in little more than their entropy.
//
// A carryless range coder on 32-bit integers (as in Mahoney, "Adaptive weighing of context models
// for lossless data compression", TR CS-2005-16, Sec. 2); proto/README.md gives the steps.
// Thread-compatible.
#ifndef PORTOLAN_COMMON_WIRE_BINARY_CODER_H_
#define PORTOLAN_COMMON_WIRE_BINARY_CODER_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace portolan {

// The numbers that the stream may still stand for.
struct CodeRange {
  uint32_t low = 0;
  uint32_t high = UINT32_MAX;

  // Last number of the part that stands for a 1.
  uint32_t Middle(uint32_t one_q16) const {
    return low + static_cast<uint32_t>((static_cast<uint64_t>(high - low) * one_q16) >> 16);
  }
  void Take(bool bit, uint32_t one_q16) {
    const uint32_t middle = Middle(one_q16);
    (bit ? high : low) = bit ? middle : middle + 1;
  }
  bool FirstByteIsDecided() const { return ((low ^ high) >> 24) == 0; }
  void Shift() {
    low <<= 8;
    high = (high << 8) | 255u;
  }
};

class BinaryEncoder {
 public:
  // one_q16: probability of a 1 in 2^-16, 1..65535.
  void Encode(bool bit, uint32_t one_q16);
  // Ends the stream. Of no bits: no bytes.
  std::string Take();

 private:
  std::string bytes_;
  CodeRange range_;
};

// Any bytes are safe; what lies beyond their end reads as 0.
class BinaryDecoder {
 public:
  explicit BinaryDecoder(std::string_view bytes);

  bool Decode(uint32_t one_q16) {
    const bool bit = value_ <= range_.Middle(one_q16);
    range_.Take(bit, one_q16);
    while (range_.FirstByteIsDecided()) {
      range_.Shift();
      ReadByte();
      ++shifted_;
    }
    return bit;
  }
  // The bytes cannot hold the bits that were decoded.
  bool PastEnd() const { return shifted_ > bytes_.size(); }
  // The stream ends exactly here, as Take ended it.
  bool AtEnd() const;

 private:
  void ReadByte() {
    const uint32_t byte = next_ < bytes_.size() ? static_cast<unsigned char>(bytes_[next_]) : 0u;
    ++next_;
    value_ = (value_ << 8) | byte;
  }

  const std::string_view bytes_;
  size_t next_ = 0;     // byte to read
  size_t shifted_ = 0;  // bytes that are decided
  CodeRange range_;
  uint32_t value_ = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_WIRE_BINARY_CODER_H_
