// Many descriptors against one: the inner loop of exact matching.
#ifndef PORTOLAN_COMMON_FEATURES_DESCRIPTOR_TABLE_H_
#define PORTOLAN_COMMON_FEATURES_DESCRIPTOR_TABLE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/features/descriptor.h"

namespace portolan {

// A list of descriptors, stored word by word so that a vector unit compares several at once. The
// instruction set is chosen at run time; the results do not depend on it.
// Thread rule: thread-compatible.
class DescriptorTable {
 public:
  void Reserve(size_t count);
  void Append(const Descriptor& descriptor);
  size_t size() const { return words_[0].size(); }
  Descriptor operator[](size_t index) const;

  // Writes size() distances, 0..256 bits, in order.
  void Distances(const Descriptor& query, std::vector<uint32_t>* distances_bits) const;

  struct Neighbour {
    uint32_t distance_bits = 257;  // further than any
    uint32_t index = 0;
  };
  // The nearest one, of equals the first; distance 257 if the table is empty. At most 2^22
  // descriptors.
  Neighbour Nearest(const Descriptor& query) const;

 private:
  std::array<std::vector<uint64_t>, 4> words_;
};

}  // namespace portolan

#endif  // PORTOLAN_COMMON_FEATURES_DESCRIPTOR_TABLE_H_
