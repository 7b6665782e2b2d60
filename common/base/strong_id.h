// Distinct id types over one representation: StrongId<struct TrackTag, uint32_t>.
#ifndef PORTOLAN_COMMON_BASE_STRONG_ID_H_
#define PORTOLAN_COMMON_BASE_STRONG_ID_H_

#include <compare>
#include <cstdint>
#include <functional>
#include <ostream>
#include <string>
#include <utility>

namespace portolan {

template <typename Tag, typename Value>
class StrongId {
 public:
  using value_type = Value;

  StrongId() = default;
  explicit StrongId(Value value) : value_(std::move(value)) {}

  const Value& value() const { return value_; }

  friend bool operator==(const StrongId&, const StrongId&) = default;
  friend auto operator<=>(const StrongId& a, const StrongId& b) { return a.value_ <=> b.value_; }
  template <typename H>
  friend H AbslHashValue(H h, const StrongId& id) {
    return H::combine(std::move(h), id.value_);
  }
  friend std::ostream& operator<<(std::ostream& out, const StrongId& id) {
    return out << id.value_;
  }

 private:
  Value value_{};
};

// The operator's name of a vehicle, unique in the fleet.
using AgentId = StrongId<struct AgentIdTag, std::string>;
// One run of an agent; random, drawn when its outbox is created.
using SessionId = StrongId<struct SessionIdTag, uint64_t>;
// The server's row id of a committed submap, dense from 1 in order of commit.
using SubmapId = StrongId<struct SubmapIdTag, int64_t>;
// A tracked image point; unique in a session, kept across submap boundaries, never reused.
using TrackId = StrongId<struct TrackIdTag, uint32_t>;
// A connected component of the map (the younger joins the older, so the oldest id survives).
using ComponentId = StrongId<struct ComponentIdTag, int64_t>;
// A fused landmark of the global map; stable across solves.
using LandmarkId = StrongId<struct LandmarkIdTag, int64_t>;

}  // namespace portolan

template <typename Tag, typename Value>
struct std::hash<portolan::StrongId<Tag, Value>> {
  size_t operator()(const portolan::StrongId<Tag, Value>& id) const {
    return std::hash<Value>()(id.value());
  }
};

#endif  // PORTOLAN_COMMON_BASE_STRONG_ID_H_
