// What the map thread drives: the map builder, or a stand-in in tests.
#ifndef PORTOLAN_SERVER_PIPELINE_MAP_ENGINE_H_
#define PORTOLAN_SERVER_PIPELINE_MAP_ENGINE_H_

#include <atomic>
#include <memory>

#include "server/map_builder.h"

namespace portolan {

// Thread-compatible: the map thread alone calls it, except for Prepare and Refine. The meaning of
// each call is MapBuilder's.
class MapEngine {
 public:
  virtual ~MapEngine() = default;

  virtual void Restore(std::shared_ptr<const MapSnapshot> snapshot) = 0;
  virtual void SetSurvey(std::shared_ptr<const Survey>) {}
  // For submaps whose turn to be prepared has not come, on any thread. Null: Prepare does it.
  virtual std::shared_ptr<const RefinedSubmap> Refine(const SubmapInput&) { return nullptr; }
  // Called for each submap in turn, on another thread. Null: IntegrateSubmap does it.
  virtual std::shared_ptr<const PreparedSubmap> Prepare(const SubmapInput&) { return nullptr; }
  virtual void IntegrateSubmap(const SubmapInput& input) = 0;
  virtual bool HasBackgroundWork() const = 0;
  virtual void RunBackgroundWork(const std::atomic<bool>& interrupt) = 0;
  virtual bool HasUnsettled() const { return false; }
  virtual void Settle(const std::atomic<bool>&) {}
  virtual std::shared_ptr<const MapSnapshot> snapshot() const = 0;
  virtual StageTimes stage_times() const = 0;
};

}  // namespace portolan

#endif  // PORTOLAN_SERVER_PIPELINE_MAP_ENGINE_H_
