// A list of closures that shares its elements with its copies: a new version of the map costs
// pointers, not matches.
#ifndef PORTOLAN_SERVER_ALIGNMENT_CLOSURE_LIST_H_
#define PORTOLAN_SERVER_ALIGNMENT_CLOSURE_LIST_H_

#include <cstddef>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

#include "server/verification/closure.h"

namespace portolan {

// Value; elements are immutable.
class ClosureList {
 public:
  class Iterator {
   public:
    using iterator_category = std::forward_iterator_tag;
    using value_type = Closure;
    using difference_type = std::ptrdiff_t;
    using pointer = const Closure*;
    using reference = const Closure&;

    Iterator() = default;
    explicit Iterator(const std::shared_ptr<const Closure>* place) : place_(place) {}
    reference operator*() const { return **place_; }
    pointer operator->() const { return place_->get(); }
    Iterator& operator++() {
      ++place_;
      return *this;
    }
    Iterator operator++(int) { return Iterator(place_++); }
    friend bool operator==(const Iterator&, const Iterator&) = default;

   private:
    const std::shared_ptr<const Closure>* place_ = nullptr;
  };
  using value_type = Closure;
  using const_iterator = Iterator;
  using iterator = Iterator;
  using size_type = size_t;

  ClosureList() = default;
  ClosureList(const std::vector<Closure>& closures) {  // NOLINT: a list of the same
    for (const Closure& closure : closures) push_back(closure);
  }

  void push_back(Closure closure) {
    closures_.push_back(std::make_shared<const Closure>(std::move(closure)));
  }
  void push_back(std::shared_ptr<const Closure> closure) {
    closures_.push_back(std::move(closure));
  }
  template <typename Predicate>
  void EraseIf(const Predicate& predicate) {
    std::erase_if(closures_, [&](const auto& closure) { return predicate(*closure); });
  }

  size_t size() const { return closures_.size(); }
  bool empty() const { return closures_.empty(); }
  const Closure& operator[](size_t i) const { return *closures_[i]; }
  // The same closure in two lists has one address.
  const std::shared_ptr<const Closure>& shared(size_t i) const { return closures_[i]; }
  // By address of the elements.
  friend bool operator==(const ClosureList&, const ClosureList&) = default;

  Iterator begin() const { return Iterator(closures_.data()); }
  Iterator end() const { return Iterator(closures_.data() + closures_.size()); }

 private:
  std::vector<std::shared_ptr<const Closure>> closures_;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_ALIGNMENT_CLOSURE_LIST_H_
