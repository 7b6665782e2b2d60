#include "server/redundancy/redundancy_remover.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "server/map_builder.h"
#include "server/refinement/bundle_covariance.h"
#include "server/refinement/submap_refiner.h"
#include "tests/support/synthetic_map.h"
#include "tests/support/test_cameras.h"

namespace portolan {
namespace {

constexpr double kAgreeingChi2 = 16;

RedundancyRemover MakeRemover(RedundancyOptions options = {}) {
  options.whole_submaps = 0;
  return std::move(RedundancyRemover::Create(options)).value();
}

SyntheticSubmapsOptions DenseKeyframes() {
  SyntheticSubmapsOptions options;
  options.keyframes_per_submap = 16;
  return options;
}

std::vector<std::shared_ptr<const RefinedSubmap>> RefineAll(const SyntheticMission& mission) {
  const auto refiner = std::move(SubmapRefiner::Create({})).value();
  std::vector<std::shared_ptr<const RefinedSubmap>> refined;
  for (const SyntheticSubmap& submap : mission.submaps) {
    refined.push_back(refiner.Refine(submap.id, submap.submap, mission.camera));
  }
  return refined;
}

std::vector<int> AllKeyframes(const RefinedSubmap& submap) {
  std::vector<int> all;
  for (size_t k = 0; k < submap.raw->keyframes.size(); ++k) all.push_back(static_cast<int>(k));
  return all;
}

// Keyframes along a line, exact observations of points at given places.
class HandMade {
 public:
  HandMade() : camera_(std::make_shared<const CameraModel>(PinholeTestCamera())) {
    for (int k = 0; k < kKeyframes; ++k) {
      Keyframe keyframe;
      keyframe.time = Timestamp(k * 100'000'000);
      keyframe.submap_from_camera.translation = {0.05 * k, 0, 0};
      raw_.keyframes.push_back(keyframe);
    }
  }

  // Seen in the keyframes first..last.
  void Add(const Eigen::Vector3d& point, int first = 0, int last = kKeyframes - 1) {
    RefinedLandmark landmark;
    landmark.track = TrackId(static_cast<uint32_t>(refined_.landmarks.size()));
    landmark.point_in_submap = point;
    landmark.observation_count = last - first + 1;
    landmark.covariance = Eigen::Matrix3d(1e-4 * Eigen::Matrix3d::Identity());
    for (int k = first; k <= last; ++k) {
      const auto pixel = camera_->Project(raw_.keyframes[k].submap_from_camera.Inverse() * point);
      raw_.keyframes[k].observations.push_back({landmark.track, pixel->cast<float>(), 0.5f});
    }
    refined_.landmarks.push_back(landmark);
  }

  // `count` of them, at a depth, over the whole image.
  void AddMany(int count, double depth, int first = 0, int last = kKeyframes - 1) {
    std::uniform_real_distribution<double> place(-0.45, 0.45);
    for (int i = 0; i < count; ++i) {
      Add({depth * place(random_), 0.8 * depth * place(random_), depth}, first, last);
    }
  }

  Submap& raw() { return raw_; }

  RefinedSubmap Finish() {
    refined_.id = SubmapId(1);
    refined_.camera = camera_;
    for (const Keyframe& keyframe : raw_.keyframes) {
      refined_.submap_from_camera.push_back(keyframe.submap_from_camera);
    }
    refined_.raw = std::make_shared<const Submap>(raw_);
    return refined_;
  }

  static constexpr int kKeyframes = 8;

 private:
  std::shared_ptr<const CameraModel> camera_;
  std::mt19937 random_{7};
  Submap raw_;
  RefinedSubmap refined_;
};

// The inverse of what remains of the information is what the refinement's own code has.
TEST(SubmapInformation, IsTheInverseOfTheAdjustedCovariance) {
  const SyntheticMission mission = MakeSyntheticMission(DenseKeyframes());
  const auto refined = RefineAll(mission);
  const RefinedSubmap& submap = *refined[1];
  BundleProblem problem;
  for (const Rigid3& pose : submap.submap_from_camera) {
    BundleCamera camera;
    camera.world_from_camera = pose;
    camera.model = submap.camera.get();
    camera.fixed = problem.cameras.empty();
    problem.cameras.push_back(camera);
  }
  for (const RefinedLandmark& landmark : submap.landmarks) {
    problem.points.push_back({landmark.point_in_submap, false});
  }
  const auto agreeing = AgreeingObservations(submap, kAgreeingChi2);
  for (size_t k = 0; k < agreeing.size(); ++k) {
    for (size_t i = 0; i < agreeing[k].size(); ++i) {
      const Observation& seen = submap.raw->keyframes[k].observations[i];
      if (!agreeing[k][i]) continue;
      const auto point = FindLandmark(submap, seen.track) - submap.landmarks.data();
      BundleObservation observation;
      observation.camera = static_cast<int>(k);
      observation.point = static_cast<int>(point);
      observation.pixel = seen.pixel.cast<double>();
      observation.sigma_px = seen.sigma_px;
      problem.observations.push_back(observation);
    }
  }
  const auto covariance = BundleCovariance::Compute(problem);
  ASSERT_TRUE(covariance);
  const SubmapInformation information(submap, AllKeyframes(submap), kAgreeingChi2);
  const Eigen::MatrixXd poses =
      information.PoseInformation(SubmapChoice::Everything(submap)).inverse();
  for (size_t k = 1; k < submap.submap_from_camera.size(); ++k) {
    const Matrix6d expected = covariance->Camera(static_cast<int>(k));
    const Matrix6d found = poses.block<6, 6>(6 * (k - 1), 6 * (k - 1));
    EXPECT_LT((found - expected).norm(), 0.02 * expected.norm()) << k;
  }
  EXPECT_NEAR(*information.Share(SubmapChoice::Everything(submap)), 1, 1e-9);
}

TEST(SubmapInformation, LeveragesSumUpToTheUnknowns) {
  const SyntheticMission mission = MakeSyntheticMission(DenseKeyframes());
  const auto refined = RefineAll(mission);
  const RefinedSubmap& submap = *refined[1];
  const SubmapInformation information(submap, AllKeyframes(submap), kAgreeingChi2);
  const SubmapChoice all = SubmapChoice::Everything(submap);
  const Eigen::MatrixXd covariance = information.PoseInformation(all).inverse();
  double sum = 0;
  for (size_t i = 0; i < submap.landmarks.size(); ++i) {
    sum += information.Leverage(i, all, covariance);
  }
  // The scale is held by nobody's observations.
  EXPECT_NEAR(sum, 6.0 * (16 - 1) - 1, 0.1);
}

// Of what a single view tells, or none, nothing is left for the poses; and it is no NaN, which
// would make a sort run wild.
TEST(SubmapInformation, TracksThatFewerThanTwoKeyframesSeeHaveNoLeverage) {
  HandMade scene;
  scene.AddMany(100, 3.0);
  scene.Add({0.1, 0.2, 3.0}, 4, 4);
  scene.Add({0.2, 0.1, 3.0}, 1, 0);  // by none
  scene.Add({0.3, 0.1, 3.0}, 4, 5);
  const RefinedSubmap submap = scene.Finish();
  const SubmapInformation information(submap, AllKeyframes(submap), kAgreeingChi2);
  SubmapChoice choice = SubmapChoice::Everything(submap);
  Eigen::MatrixXd covariance = information.PoseInformation(choice).inverse();
  EXPECT_GT(information.Leverage(0, choice, covariance), 0);
  EXPECT_EQ(information.Leverage(100, choice, covariance), 0);
  EXPECT_EQ(information.Leverage(101, choice, covariance), 0);
  EXPECT_GT(information.Leverage(102, choice, covariance), 0);
  choice.keyframes[4] = false;
  covariance = information.PoseInformation(choice).inverse();
  EXPECT_EQ(information.Leverage(100, choice, covariance), 0);
  EXPECT_EQ(information.Leverage(102, choice, covariance), 0);
}

TEST(RedundancyRemover, KeepsThePromisedInformationAndRemovesTheRest) {
  const SyntheticMission mission = MakeSyntheticMission(DenseKeyframes());
  for (const double promised : {0.5, 0.8}) {
    RedundancyOptions options;
    options.min_keyframe_information = promised;
    const RedundancyRemover remover = MakeRemover(options);
    for (const auto& submap : RefineAll(mission)) {
      SCOPED_TRACE(submap->id.value());
      const SubmapChoice choice = remover.Choose(*submap);
      std::vector<int> held;
      int gap = 0, removed = 0;
      for (size_t k = 0; k < choice.keyframes.size(); ++k) {
        gap = choice.keyframes[k] ? 0 : gap + 1;
        removed += choice.keyframes[k] ? 0 : 1;
        EXPECT_LE(gap, options.max_keyframe_gap);
        const bool is_end = k == 0 || k + 1 == choice.keyframes.size();
        if (!is_end && submap->raw->keyframes[k].features.empty()) continue;
        held.push_back(static_cast<int>(k));
        EXPECT_TRUE(choice.keyframes[k]) << k;
      }
      const SubmapInformation information(*submap, held, options.agreeing_chi2);
      EXPECT_GE(*information.Share(choice), promised * options.min_landmark_information);
      SubmapChoice keyframes_only = choice;
      keyframes_only.landmarks.assign(choice.landmarks.size(), true);
      EXPECT_GE(*information.Share(keyframes_only), promised);
      if (promised < 0.6) {
        EXPECT_GE(removed, 7);
        EXPECT_GT(std::count(choice.landmarks.begin(), choice.landmarks.end(), false), 0);
      }
    }
  }
}

TEST(RedundancyRemover, RemovesMoreTheLessIsPromised) {
  const SyntheticMission mission = MakeSyntheticMission(DenseKeyframes());
  const auto refined = RefineAll(mission);
  const RefinedSubmap& submap = *refined[2];
  size_t last = 0;
  for (const double promised : {0.99, 0.9, 0.7}) {
    RedundancyOptions options;
    options.min_keyframe_information = promised;
    options.max_keyframe_gap = 10;
    const SubmapChoice choice = MakeRemover(options).Choose(submap);
    const size_t removed = std::count(choice.keyframes.begin(), choice.keyframes.end(), false);
    EXPECT_GE(removed, last) << promised;
    last = removed;
  }
  EXPECT_GT(last, 0u);
}

// Hundreds of points of a mountain far away tell how the camera turned, a dozen nearby how far it
// came; among the mountain's many a few do not matter.
TEST(RedundancyRemover, UselessTracksGoAndDecisiveOnesStay) {
  HandMade scene;
  scene.AddMany(12, 2.0);
  scene.AddMany(300, 1000.0);
  RedundancyOptions options;
  options.min_keyframe_information = 1;
  const RefinedSubmap submap = scene.Finish();
  const SubmapChoice choice = MakeRemover(options).Choose(submap);
  const auto near_end = choice.landmarks.begin() + 12;
  EXPECT_EQ(std::count(choice.landmarks.begin(), near_end, true), 12);
  EXPECT_GT(std::count(near_end, choice.landmarks.end(), false), 10);
}

TEST(RedundancyRemover, ShortTracksAmongLongOnesGoFirst) {
  HandMade scene;
  scene.AddMany(150, 3.0);
  scene.AddMany(40, 3.0, 3, 4);
  RedundancyOptions options;
  options.min_keyframe_information = 1;
  options.min_landmark_information = 0.97;
  const SubmapChoice choice = MakeRemover(options).Choose(scene.Finish());
  const auto long_end = choice.landmarks.begin() + 150;
  const auto long_gone = std::count(choice.landmarks.begin(), long_end, false);
  const auto short_gone = std::count(long_end, choice.landmarks.end(), false);
  EXPECT_GE(short_gone, 25);
  EXPECT_LT(static_cast<double>(long_gone) / 150, static_cast<double>(short_gone) / 40);
}

TEST(RedundancyRemover, DescribedTracksAndFewTracksOfAKeyframeStay) {
  HandMade scene;
  scene.AddMany(150, 3.0);
  scene.AddMany(40, 3.0, 3, 4);
  Feature feature;
  feature.track = TrackId(155);
  scene.raw().keyframes[3].features.push_back(feature);
  RedundancyOptions options;
  options.min_keyframe_information = 1;
  options.min_landmark_information = 0.01;
  SubmapChoice choice = MakeRemover(options).Choose(scene.Finish());
  EXPECT_TRUE(choice.landmarks[155]);
  EXPECT_GE(std::count(choice.landmarks.begin() + 150, choice.landmarks.end(), false), 30);
  EXPECT_GE(std::count(choice.landmarks.begin(), choice.landmarks.begin() + 150, true),
            options.min_tracks_of_keyframe);

  HandMade sparse;
  sparse.AddMany(options.min_tracks_of_keyframe - 1, 3.0);
  options.min_keyframe_information = 0.01;
  const RefinedSubmap few = sparse.Finish();
  EXPECT_EQ(MakeRemover(options).Choose(few).landmarks, SubmapChoice::Everything(few).landmarks);
  EXPECT_EQ(MakeRemover(options).Choose(few).keyframes, SubmapChoice::Everything(few).keyframes);
}

// Where a third of the observations disagrees, the estimate may be the wrong one.
TEST(RedundancyRemover, DoubtfulSubmapStaysWhole) {
  HandMade scene;
  scene.AddMany(150, 3.0);
  std::vector<Observation>& observations = scene.raw().keyframes[5].observations;
  for (size_t i = 0; i < observations.size(); i += 3) observations[i].pixel.x() += 20;
  const auto submap = std::make_shared<const RefinedSubmap>(scene.Finish());
  EXPECT_EQ(MakeRemover().Remove(submap), submap);
  RedundancyOptions careless;
  careless.min_agreeing_share = 0;
  EXPECT_FALSE(MakeRemover(careless).Remove(submap)->redundant_keyframes.empty());
}

TEST(RedundancyRemover, TheFirstSubmapsOfAMapStayWhole) {
  HandMade scene;
  scene.AddMany(150, 3.0);
  RefinedSubmap refined = scene.Finish();
  const RedundancyRemover remover = RedundancyRemover::Create({.whole_submaps = 7}).value();
  refined.id = SubmapId(7);
  const auto seventh = std::make_shared<const RefinedSubmap>(refined);
  EXPECT_EQ(remover.Remove(seventh), seventh);
  refined.id = SubmapId(8);
  const auto eighth = std::make_shared<const RefinedSubmap>(refined);
  EXPECT_FALSE(remover.Remove(eighth)->redundant_keyframes.empty());
}

TEST(RedundancyRemover, OffReturnsTheSubmapItself) {
  RedundancyOptions off;
  off.min_keyframe_information = off.min_landmark_information = 1;
  HandMade scene;
  scene.AddMany(150, 3.0);
  const auto submap = std::make_shared<const RefinedSubmap>(scene.Finish());
  EXPECT_EQ(MakeRemover(off).Remove(submap), submap);
  auto without_landmarks = std::make_shared<RefinedSubmap>(*submap);
  without_landmarks->landmarks.clear();
  const std::shared_ptr<const RefinedSubmap> quarantined = without_landmarks;
  EXPECT_EQ(MakeRemover().Remove(quarantined), quarantined);
}

TEST(RedundancyRemover, CountsWhatRedundantKeyframesSaw) {
  const SyntheticMission mission = MakeSyntheticMission(DenseKeyframes());
  const auto whole = RefineAll(mission)[1];
  const auto reduced = MakeRemover().Remove(whole);
  ASSERT_FALSE(reduced->redundant_keyframes.empty());
  ASSERT_LT(reduced->landmarks.size(), whole->landmarks.size());
  for (const RefinedLandmark& landmark : reduced->landmarks) {
    int count = 0;
    for (const int k : reduced->redundant_keyframes) {
      for (const Observation& seen : whole->raw->keyframes[k].observations) {
        count += seen.track == landmark.track ? 1 : 0;
      }
    }
    // Outliers do not count.
    EXPECT_LE(landmark.redundant_count, count);
    EXPECT_GE(landmark.redundant_count, count - 2);
  }
}

TEST(RedundancyOptions, RefusesNonsense) {
  EXPECT_TRUE(RedundancyOptions().Validate().ok());
  for (const double wrong : {0.0, -1.0, 1.1, std::nan("")}) {
    RedundancyOptions options;
    options.min_keyframe_information = wrong;
    EXPECT_FALSE(options.Validate().ok());
    options = {};
    options.min_landmark_information = wrong;
    EXPECT_FALSE(options.Validate().ok());
  }
}

struct PoseErrors {
  double redundant = 0;
  double essential = 0;
};

// Distances of keyframes from where another map has them, after the best similarity.
PoseErrors Distances(const MapSnapshot& snapshot, const MapSnapshot& other) {
  std::vector<Eigen::Vector3d> here[2], there[2];
  for (size_t i = 0; i < snapshot.submaps.size(); ++i) {
    const SubmapState& state = *snapshot.submaps[i];
    for (size_t k = 0; k < state.world_from_camera.size(); ++k) {
      const bool redundant = IsRedundant(*state.refined, static_cast<int>(k));
      here[redundant].push_back(state.world_from_camera[k].translation);
      there[redundant].push_back(other.submaps[i]->world_from_camera[k].translation);
    }
  }
  EXPECT_GT(here[1].size(), here[0].size());
  return {AlignedRms(here[1], there[1]), AlignedRms(here[0], there[0])};
}

// Two agents meet, so that the joint adjustments bend what the submaps alone had.
TEST(RedundancyInTheMap, AllKeyframesLieWhereTheFullAdjustmentHasThem) {
  SyntheticSubmapsOptions options = DenseKeyframes();
  options.agents = {{0, 3.0, 5, 1.5}, {2.0, 5.0, 5, 1.4}};
  options.outlier_share = 0.02;
  const SyntheticMission mission = MakeSyntheticMission(options);
  MapBuilderOptions off;
  off.redundancy.min_keyframe_information = off.redundancy.min_landmark_information = 1;
  const auto full = std::move(MapBuilder::Create(off)).value();
  MapBuilderOptions on;
  on.redundancy.whole_submaps = 0;
  const auto builder = std::move(MapBuilder::Create(on)).value();
  IntegrateMission(mission, 0, 99, true, full.get());
  IntegrateMission(mission, 0, 99, true, builder.get());
  ASSERT_EQ(full->snapshot()->components.size(), 1u);
  ASSERT_EQ(builder->snapshot()->components.size(), 1u);
  const double full_rms = KeyframeRms(mission, *full->snapshot(), ComponentId(1));
  const double rms = KeyframeRms(mission, *builder->snapshot(), ComponentId(1));
  // Noise is white here, so that more observations do tell more.
  EXPECT_LT(rms, 1.6 * full_rms + 1e-3);
  const PoseErrors errors = Distances(*builder->snapshot(), *full->snapshot());
  EXPECT_LT(errors.redundant, 1.2 * errors.essential);
  EXPECT_LT(errors.redundant, 0.006);  // 4 m from the wall
}

// A short session with a wrong lens: a dozen of its 31 keyframes stay, and find it.
TEST(RedundancyInTheMap, TheLensIsFoundFromWhatStays) {
  SyntheticSubmapsOptions options = DenseKeyframes();
  options.agents = {{0, 1.2, 2, 1.5}};
  SyntheticMission mission = MakeSyntheticMission(options);
  mission.camera =
      std::make_shared<const CameraModel>(mission.camera->WithRadial({0.05, -0.02}).value());
  MapBuilderOptions doubting;
  doubting.redundancy.whole_submaps = 0;
  doubting.aligner.adjuster.trust_distortion = false;
  MapBuilderOptions held = doubting;
  held.aligner.adjuster.min_lens_keyframes = 0;
  const auto rms = [&](const MapBuilderOptions& of) {
    const auto builder = std::move(MapBuilder::Create(of)).value();
    IntegrateMission(mission, 0, 99, true, builder.get());
    size_t kept = 0;
    for (const auto& state : builder->snapshot()->submaps) {
      kept += state->world_from_camera.size() - state->refined->redundant_keyframes.size();
    }
    EXPECT_LT(kept, 20u);
    return KeyframeRms(mission, *builder->snapshot(), ComponentId(1));
  };
  EXPECT_LT(rms(doubting), 0.4 * rms(held));
}

}  // namespace
}  // namespace portolan
