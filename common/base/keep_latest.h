// Bounds what is remembered.
#ifndef PORTOLAN_COMMON_BASE_KEEP_LATEST_H_
#define PORTOLAN_COMMON_BASE_KEEP_LATEST_H_

#include <algorithm>
#include <cstddef>
#include <functional>
#include <type_traits>
#include <utility>
#include <vector>

namespace portolan {

// Erases all but max_count entries of a map: those with the least time_of(value) go, of equal ones
// those with the least key.
template <typename Map, typename TimeOf>
void KeepLatest(int max_count, const TimeOf& time_of, Map* map) {
  const auto surplus = static_cast<std::ptrdiff_t>(map->size()) - max_count;
  if (surplus <= 0) return;
  using Time = std::decay_t<std::invoke_result_t<TimeOf, const typename Map::mapped_type&>>;
  std::vector<std::pair<Time, typename Map::key_type>> by_age;
  by_age.reserve(map->size());
  for (const auto& [key, value] : *map) by_age.emplace_back(std::invoke(time_of, value), key);
  std::nth_element(by_age.begin(), by_age.begin() + surplus, by_age.end());
  for (std::ptrdiff_t i = 0; i < surplus; ++i) map->erase(by_age[i].second);
}

}  // namespace portolan

#endif  // PORTOLAN_COMMON_BASE_KEEP_LATEST_H_
