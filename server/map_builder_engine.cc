#include "server/map_builder_engine.h"

#include <utility>

namespace portolan {
namespace {

class MapBuilderEngine : public MapEngine {
 public:
  explicit MapBuilderEngine(std::unique_ptr<MapBuilder> builder) : builder_(std::move(builder)) {}

  void Restore(std::shared_ptr<const MapSnapshot> snapshot) override {
    builder_->Restore(std::move(snapshot));
  }
  void SetSurvey(std::shared_ptr<const Survey> survey) override {
    builder_->SetSurvey(std::move(survey));
  }
  std::shared_ptr<const RefinedSubmap> Refine(const SubmapInput& input) override {
    return builder_->Refine(input);
  }
  std::shared_ptr<const PreparedSubmap> Prepare(const SubmapInput& input) override {
    return builder_->Prepare(input);
  }
  void IntegrateSubmap(const SubmapInput& input) override { builder_->IntegrateSubmap(input); }
  bool HasBackgroundWork() const override { return builder_->HasBackgroundWork(); }
  void RunBackgroundWork(const std::atomic<bool>& interrupt) override {
    builder_->RunBackgroundWork(interrupt);
  }
  bool HasUnsettled() const override { return builder_->HasUnsettled(); }
  void Settle(const std::atomic<bool>& interrupt) override { builder_->Settle(interrupt); }
  std::shared_ptr<const MapSnapshot> snapshot() const override { return builder_->snapshot(); }
  StageTimes stage_times() const override { return builder_->stage_times(); }

 private:
  const std::unique_ptr<MapBuilder> builder_;
};

}  // namespace

StatusOr<std::unique_ptr<MapEngine>> MakeMapBuilderEngine(const MapBuilderOptions& options) {
  PORTOLAN_ASSIGN_OR_RETURN(std::unique_ptr<MapBuilder> builder, MapBuilder::Create(options));
  return std::make_unique<MapBuilderEngine>(std::move(builder));
}

}  // namespace portolan
