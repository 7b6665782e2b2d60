// The first half of a submap's way, ahead of the second or in turn with it.
#include "server/submap_preparer.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <thread>
#include <vector>

#include "tests/support/synthetic_map.h"

namespace portolan {
namespace {

std::unique_ptr<MapBuilder> MakePreparingBuilder(const MapBuilderOptions& options) {
  return std::move(MapBuilder::Create(options)).value();
}

// Three agents that meet; one submap in the middle cannot be refined.
std::vector<SubmapInput> Inputs() {
  SyntheticSubmapsOptions options;
  options.agents = {{0, 2.6, 5, 1.5}, {2.0, 4.6, 5, 1.4}, {4.0, 6.9, 5, 1.6}};
  const SyntheticMission mission = MakeSyntheticMission(options);
  std::vector<SubmapInput> inputs;
  for (const SyntheticSubmap& submap : mission.submaps) {
    inputs.push_back({submap.id, submap.submap, mission.camera});
  }
  auto broken = std::make_shared<Submap>(*inputs[7].submap);
  for (Keyframe& keyframe : broken->keyframes) keyframe.observations.resize(3);
  inputs[7].submap = broken;
  return inputs;
}

void ExpectEqual(const MapSnapshot& a, const MapSnapshot& b) {
  EXPECT_EQ(a.version, b.version);
  ASSERT_EQ(a.submaps.size(), b.submaps.size());
  for (size_t i = 0; i < a.submaps.size(); ++i) {
    const SubmapState& in_a = *a.submaps[i];
    const SubmapState& in_b = *b.submaps[i];
    EXPECT_EQ(in_a.component, in_b.component);
    EXPECT_EQ(in_a.refined->quarantine_reason, in_b.refined->quarantine_reason);
    EXPECT_EQ(in_a.world_from_submap.scale, in_b.world_from_submap.scale);
    ASSERT_EQ(in_a.world_from_camera.size(), in_b.world_from_camera.size());
    for (size_t k = 0; k < in_a.world_from_camera.size(); ++k) {
      EXPECT_EQ(in_a.world_from_camera[k].translation, in_b.world_from_camera[k].translation);
      EXPECT_EQ(in_a.world_from_camera[k].rotation.coeffs(),
                in_b.world_from_camera[k].rotation.coeffs());
    }
    ASSERT_EQ(in_a.landmarks.size(), in_b.landmarks.size());
    for (size_t k = 0; k < in_a.landmarks.size(); ++k) {
      EXPECT_EQ(in_a.landmarks[k].id, in_b.landmarks[k].id);
      EXPECT_EQ(in_a.landmarks[k].point_in_world, in_b.landmarks[k].point_in_world);
      EXPECT_EQ(in_a.landmarks[k].sights, in_b.landmarks[k].sights);
    }
  }
  ASSERT_EQ(a.closures->size(), b.closures->size());
  EXPECT_GE(a.closures->size(), 2u);
  for (size_t i = 0; i < a.closures->size(); ++i) {
    EXPECT_EQ((*a.closures)[i].a, (*b.closures)[i].a);
    EXPECT_EQ((*a.closures)[i].b, (*b.closures)[i].b);
    EXPECT_EQ((*a.closures)[i].matches.size(), (*b.closures)[i].matches.size());
  }
}

std::shared_ptr<const MapSnapshot> IntegratedInline(const std::vector<SubmapInput>& inputs,
                                                    const MapBuilderOptions& options) {
  const auto builder = MakePreparingBuilder(options);
  for (const SubmapInput& input : inputs) {
    builder->IntegrateSubmap(input);
    FinishBackgroundWork(builder.get());
  }
  return builder->snapshot();
}

// With and without redundancy.
class PreparedAhead : public ::testing::TestWithParam<int> {
 protected:
  PreparedAhead() { options_.redundancy.whole_submaps = GetParam(); }

  MapBuilderOptions options_;
};

INSTANTIATE_TEST_SUITE_P(WholeSubmaps, PreparedAhead, ::testing::Values(80, 0));

TEST_P(PreparedAhead, FarAheadIsTheSameAsInline) {
  std::vector<SubmapInput> inputs = Inputs();
  const auto inline_map = IntegratedInline(inputs, options_);
  const auto builder = MakePreparingBuilder(options_);
  for (SubmapInput& input : inputs) input.prepared = builder->Prepare(input);
  EXPECT_EQ(builder->snapshot()->submaps.size(), 0u);
  for (const SubmapInput& input : inputs) {
    builder->IntegrateSubmap(input);
    FinishBackgroundWork(builder.get());
  }
  ExpectEqual(*inline_map, *builder->snapshot());
  const RefinedSubmap& last = *builder->snapshot()->submaps.back()->refined;
  EXPECT_EQ(last.redundant_keyframes.empty(), GetParam() > 0);
}

// As the map thread does it; and above full_component_submaps, where the number of closures depends
// on the submaps that there are.
TEST_P(PreparedAhead, OnAnotherThreadIsTheSameAsInline) {
  options_.aligner.full_component_submaps = 4;
  options_.enough_closures = 1;
  std::vector<SubmapInput> inputs = Inputs();
  const auto inline_map = IntegratedInline(inputs, options_);
  const auto builder = MakePreparingBuilder(options_);
  std::atomic<size_t> prepared = 0;
  std::thread preparing([&] {
    for (SubmapInput& input : inputs) {
      input.prepared = builder->Prepare(input);
      ++prepared;
    }
  });
  for (size_t i = 0; i < inputs.size(); ++i) {
    while (prepared <= i) std::this_thread::yield();
    builder->IntegrateSubmap(inputs[i]);
    FinishBackgroundWork(builder.get());
  }
  preparing.join();
  ExpectEqual(*inline_map, *builder->snapshot());
}

// A server that was killed between the two halves prepares the submap again.
TEST_P(PreparedAhead, ButNotIntegratedItIsPreparedAgainAfterARestart) {
  std::vector<SubmapInput> inputs = Inputs();
  const auto killed = MakePreparingBuilder(options_);
  for (size_t i = 0; i < inputs.size(); ++i) {
    const auto prepared = killed->Prepare(inputs[i]);
    if (i >= 9) continue;
    SubmapInput input = inputs[i];
    input.prepared = prepared;
    killed->IntegrateSubmap(input);
    FinishBackgroundWork(killed.get());
  }
  const auto inline_builder = MakePreparingBuilder(options_);
  inline_builder->Restore(killed->snapshot());
  const auto ahead = MakePreparingBuilder(options_);
  ahead->Restore(killed->snapshot());
  for (size_t i = 0; i < inputs.size(); ++i) inputs[i].prepared = ahead->Prepare(inputs[i]);
  EXPECT_TRUE(inputs[3].prepared->closures.empty());
  EXPECT_EQ(inputs[3].prepared->refined, killed->snapshot()->submaps[3]->refined);
  for (SubmapInput& input : inputs) {
    ahead->IntegrateSubmap(input);
    input.prepared = nullptr;
    inline_builder->IntegrateSubmap(input);
    FinishBackgroundWork(ahead.get());
    FinishBackgroundWork(inline_builder.get());
  }
  ExpectEqual(*inline_builder->snapshot(), *ahead->snapshot());
  EXPECT_EQ(ahead->stage_times().refine.count, 6);
}

}  // namespace
}  // namespace portolan
