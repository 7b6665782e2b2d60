#include "server/place_recognition/posting_pool.h"

#include <algorithm>
#include <bit>

namespace portolan {
namespace {

// Of the place of a list of two or more.
uint32_t LogSize(uint32_t length) { return static_cast<uint32_t>(std::bit_width(length - 1)); }

}  // namespace

uint32_t PostingPool::Take(uint32_t log_size) {
  if (!free_[log_size].empty()) {
    const uint32_t place = free_[log_size].back();
    free_[log_size].pop_back();
    return place;
  }
  const uint32_t size = 1u << log_size;
  if (used_of_last_ + size > kSegment) {
    // What is left of the last segment serves as the largest places that it has room for.
    while (used_of_last_ < kSegment) {
      const auto log_rest = static_cast<uint32_t>(std::bit_width(kSegment - used_of_last_)) - 1;
      free_[log_rest].push_back((static_cast<uint32_t>(segments_.size() - 1) << kLogOfSegment) +
                                used_of_last_);
      used_of_last_ += 1u << log_rest;
    }
    const uint32_t block = std::max(size, kSegment);
    const auto place = static_cast<uint32_t>(segments_.size()) << kLogOfSegment;
    blocks_.push_back(std::make_unique<uint32_t[]>(block));
    for (uint32_t begin = 0; begin < block; begin += kSegment) {
      segments_.push_back(blocks_.back().get() + begin);
    }
    used_of_last_ = std::min(size, kSegment);
    return place;
  }
  const uint32_t place =
      (static_cast<uint32_t>(segments_.size() - 1) << kLogOfSegment) + used_of_last_;
  used_of_last_ += size;
  return place;
}

void PostingPool::Move(uint32_t log_size_before, uint32_t log_size, PostingList* list) {
  const uint32_t place = Take(log_size);
  std::copy_n(At(list->first), list->length, At(place));
  free_[log_size_before].push_back(list->first);
  list->first = place;
}

void PostingPool::Append(uint32_t number, PostingList* list) {
  if (list->length == 0) {
    *list = {number, 1};
    return;
  }
  if (list->length == 1) {
    const uint32_t place = Take(LogSize(2));
    *At(place) = list->first;
    list->first = place;
  } else if (LogSize(list->length + 1) != LogSize(list->length)) {
    Move(LogSize(list->length), LogSize(list->length + 1), list);
  }
  At(list->first)[list->length++] = number;
}

void PostingPool::Remove(uint32_t number, PostingList* list) {
  if (list->length < 2) {
    if (list->length == 1 && list->first == number) *list = {};
    return;
  }
  uint32_t* const begin = At(list->first);
  // From the end: the newest is the likeliest to go.
  uint32_t at = list->length;
  while (at > 0 && begin[at - 1] != number) --at;
  if (at == 0) return;
  begin[at - 1] = begin[list->length - 1];
  const uint32_t before = LogSize(list->length);
  --list->length;
  if (list->length == 1) {
    free_[before].push_back(list->first);
    list->first = *begin;
  } else if (LogSize(list->length) != before) {
    Move(before, LogSize(list->length), list);
  }
}

}  // namespace portolan
