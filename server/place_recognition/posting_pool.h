// Very many short lists of numbers in one pool.
#ifndef PORTOLAN_SERVER_PLACE_RECOGNITION_POSTING_POOL_H_
#define PORTOLAN_SERVER_PLACE_RECOGNITION_POSTING_POOL_H_

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace portolan {

struct PostingList {
  uint32_t first = 0;  // the number itself if it is the only one (most are), else the place of all
  uint32_t length = 0;
};

// Each list lies in one piece, so that it is read at the speed of memory, in a place for the next
// power of two of numbers. Places that are left serve lists of the same size again. Holds at most
// 2^32 numbers.
// Thread rule: thread-compatible.
class PostingPool {
 public:
  // Valid until the list changes or goes to another address.
  std::span<const uint32_t> Numbers(const PostingList& list) const {
    if (list.length == 1) return {&list.first, 1};
    if (list.length == 0) return {};
    return {At(list.first), list.length};
  }

  void Append(uint32_t number, PostingList* list);
  // Takes the number out, if it is there; the last one takes its place.
  void Remove(uint32_t number, PostingList* list);

 private:
  // Of 2^16 numbers; what is longer takes several that follow each other in memory.
  static constexpr uint32_t kLogOfSegment = 16;
  static constexpr uint32_t kSegment = 1u << kLogOfSegment;

  uint32_t* At(uint32_t place) {
    return segments_[place >> kLogOfSegment] + (place & (kSegment - 1));
  }
  const uint32_t* At(uint32_t place) const {
    return segments_[place >> kLogOfSegment] + (place & (kSegment - 1));
  }

  // A place for 2^log_size numbers.
  uint32_t Take(uint32_t log_size);
  void Move(uint32_t log_size_before, uint32_t log_size, PostingList* list);

  std::vector<std::unique_ptr<uint32_t[]>> blocks_;
  std::vector<uint32_t*> segments_;
  uint32_t used_of_last_ = kSegment;  // numbers of the last segment
  // By log_size.
  std::array<std::vector<uint32_t>, 32> free_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_PLACE_RECOGNITION_POSTING_POOL_H_
