#include "server/query/landmark_index.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace portolan {
namespace {

using ::testing::ElementsAreArray;
using ::testing::IsEmpty;
using ::testing::SizeIs;

using Ids = std::vector<int64_t>;

Ids IdsOf(const std::vector<const FusedLandmark*>& landmarks) {
  Ids ids;
  for (const FusedLandmark* landmark : landmarks) ids.push_back(landmark->id.value());
  return ids;
}

std::shared_ptr<const SubmapState> MakeState(int64_t id, int64_t component, int landmarks,
                                             const Eigen::Vector3d& center, double size,
                                             std::mt19937* random) {
  auto refined = std::make_shared<RefinedSubmap>();
  refined->id = SubmapId(id);
  auto state = std::make_shared<SubmapState>();
  state->refined = refined;
  state->component = ComponentId(component);
  std::normal_distribution<double> normal(0, size);
  for (int i = 0; i < landmarks; ++i) {
    FusedLandmark& landmark = state->landmarks.emplace_back();
    landmark.id = LandmarkIdOf({SubmapId(id), TrackId(i)});
    landmark.point_in_world =
        center + Eigen::Vector3d(normal(*random), normal(*random), normal(*random));
    landmark.observation_count = 2 + static_cast<int>((*random)() % 10);
  }
  return state;
}

// 60 submaps of component 1 and 20 of component 2, overlapping, far from the origin so that float
// rounding matters.
std::shared_ptr<const MapSnapshot> MakeSnapshot(unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-30, 30);
  auto snapshot = std::make_shared<MapSnapshot>();
  for (int64_t id = 1; id <= 80; ++id) {
    const Eigen::Vector3d center(5000 + uniform(random), uniform(random), uniform(random));
    snapshot->submaps.push_back(MakeState(id, id % 4 == 0 ? 2 : 1, 50, center, 8, &random));
  }
  return snapshot;
}

// All landmarks of the component that pass, by distance from `point` then id.
template <typename Passes>
Ids BruteForce(const MapSnapshot& snapshot, int64_t component, const Eigen::Vector3d* point,
               Passes passes) {
  std::vector<std::pair<double, int64_t>> found;
  for (const auto& state : snapshot.submaps) {
    if (state->component.value() != component) continue;
    for (const FusedLandmark& landmark : state->landmarks) {
      if (!passes(landmark)) continue;
      const double distance = point ? (landmark.point_in_world - *point).squaredNorm() : 0;
      found.emplace_back(distance, landmark.id.value());
    }
  }
  std::sort(found.begin(), found.end());
  Ids ids;
  for (const auto& [distance, id] : found) ids.push_back(id);
  return ids;
}

TEST(LandmarkIndex, BoxEqualsBruteForce) {
  const auto snapshot = MakeSnapshot(1);
  const auto index = LandmarkIndex::Build(snapshot, nullptr);
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-30, 30);
  size_t total = 0;
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d corner(5000 + uniform(random), uniform(random), uniform(random));
    const Eigen::AlignedBox3d box(corner, corner + Eigen::Vector3d(10, 10, 10));
    const LandmarkFilter filter{static_cast<int>(random() % 8)};
    const Ids ids = IdsOf(index->InBox(ComponentId(1), box.min(), box.max(), filter));
    total += ids.size();
    EXPECT_THAT(ids, ElementsAreArray(BruteForce(*snapshot, 1, nullptr, [&](const auto& l) {
                  return box.contains(l.point_in_world) &&
                         l.observation_count >= filter.min_observation_count;
                })));
  }
  EXPECT_GT(total, 1000u);
}

TEST(LandmarkIndex, BoxIncludesItsFaces) {
  const auto snapshot = MakeSnapshot(1);
  const auto index = LandmarkIndex::Build(snapshot, nullptr);
  for (const FusedLandmark& landmark : snapshot->submaps[0]->landmarks) {
    const Eigen::Vector3d& point = landmark.point_in_world;
    EXPECT_THAT(index->InBox(ComponentId(1), point, point), SizeIs(1));
    EXPECT_THAT(IdsOf(index->InSphere(ComponentId(1), point, 0)),
                ElementsAreArray({landmark.id.value()}));
  }
}

TEST(LandmarkIndex, SphereEqualsBruteForce) {
  const auto snapshot = MakeSnapshot(3);
  const auto index = LandmarkIndex::Build(snapshot, nullptr);
  std::mt19937 random(4);
  std::uniform_real_distribution<double> uniform(-30, 30);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d center(5000 + uniform(random), uniform(random), uniform(random));
    const double radius = std::abs(uniform(random)) / 2;
    EXPECT_THAT(IdsOf(index->InSphere(ComponentId(2), center, radius)),
                ElementsAreArray(BruteForce(*snapshot, 2, &center, [&](const auto& l) {
                  return (l.point_in_world - center).squaredNorm() <= radius * radius;
                })));
  }
}

TEST(LandmarkIndex, NearestEqualsBruteForce) {
  const auto snapshot = MakeSnapshot(5);
  const auto index = LandmarkIndex::Build(snapshot, nullptr);
  std::mt19937 random(6);
  std::uniform_real_distribution<double> uniform(-80, 80);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d point(5000 + uniform(random), uniform(random), uniform(random));
    const size_t count = 1 + random() % 40;
    const LandmarkFilter filter{static_cast<int>(random() % 8)};
    Ids expected = BruteForce(*snapshot, 1, &point, [&](const auto& l) {
      return l.observation_count >= filter.min_observation_count;
    });
    expected.resize(std::min(expected.size(), count));
    EXPECT_THAT(IdsOf(index->Nearest(ComponentId(1), point, count, filter)),
                ElementsAreArray(expected));
  }
}

TEST(LandmarkIndex, MoreNeighboursThanLandmarksGivesAll) {
  const auto snapshot = MakeSnapshot(1);
  const auto index = LandmarkIndex::Build(snapshot, nullptr);
  EXPECT_THAT(index->Nearest(ComponentId(2), {0, 0, 0}, 100000), SizeIs(20 * 50));
  EXPECT_THAT(index->Nearest(ComponentId(2), {0, 0, 0}, 0), IsEmpty());
  EXPECT_THAT(index->Nearest(ComponentId(9), {0, 0, 0}, 5), IsEmpty());
}

TEST(LandmarkIndex, LargestComponentHasTheMostLandmarks) {
  EXPECT_EQ(LandmarkIndex::Build(MakeSnapshot(1), nullptr)->LargestComponent(), ComponentId(1));
  EXPECT_EQ(LandmarkIndex::Build(std::make_shared<MapSnapshot>(), nullptr)->LargestComponent(),
            ComponentId(0));
}

TEST(LandmarkIndexCache, FollowsChangesOfTheMap) {
  LandmarkIndexCache cache;
  const auto snapshot = MakeSnapshot(1);
  const auto before = cache.Get(snapshot);
  EXPECT_EQ(cache.Get(snapshot), before);
  auto changed = std::make_shared<MapSnapshot>(*snapshot);
  std::mt19937 random(9);
  changed->submaps[0] = MakeState(1, 1, 3, {0, 0, 0}, 0.1, &random);
  const auto after = cache.Get(changed);
  EXPECT_THAT(after->InSphere(ComponentId(1), {0, 0, 0}, 10), SizeIs(3));
  EXPECT_THAT(before->InSphere(ComponentId(1), {0, 0, 0}, 10), IsEmpty());
  EXPECT_THAT(after->Nearest(ComponentId(1), {0, 0, 0}, 100000), SizeIs(59 * 50 + 3));
}

}  // namespace
}  // namespace portolan
