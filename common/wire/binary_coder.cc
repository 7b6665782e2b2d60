#include "common/wire/binary_coder.h"

#include <utility>

namespace portolan {
namespace {

// What Take writes: the first byte of the only multiple of 2^24 that surely lies in low..high.
uint8_t LastByte(uint32_t low) { return static_cast<uint8_t>((low >> 24) + 1); }

}  // namespace

void BinaryEncoder::Encode(bool bit, uint32_t one_q16) {
  range_.Take(bit, one_q16);
  while (range_.FirstByteIsDecided()) {
    bytes_.push_back(static_cast<char>(range_.low >> 24));
    range_.Shift();
  }
}

std::string BinaryEncoder::Take() {
  if (range_.low != 0) bytes_.push_back(static_cast<char>(LastByte(range_.low)));
  range_ = CodeRange();
  return std::exchange(bytes_, {});
}

BinaryDecoder::BinaryDecoder(std::string_view bytes) : bytes_(bytes) {
  for (int i = 0; i < 4; ++i) ReadByte();
}

bool BinaryDecoder::AtEnd() const {
  if (range_.low == 0) return bytes_.size() == shifted_;
  return bytes_.size() == shifted_ + 1 &&
         static_cast<unsigned char>(bytes_.back()) == LastByte(range_.low);
}

}  // namespace portolan
