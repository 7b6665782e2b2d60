// LocalAdjustment's part that looks for the lens.
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <memory>

#include "agent/local_adjustment/local_adjustment.h"
#include "common/bundle/bundle_parameters.h"
#include "common/bundle/bundle_solver.h"

namespace portolan {
namespace {

// Holds a lens that is known.
constexpr double kHeldCornerSigmaPx = 1e-3;

// What is not known of k1 and k2 moves a pixel at the image's corner so far.
double LensSigmaPx(const CameraModel& camera, const Eigen::Matrix2d& covariance) {
  const auto corner = camera.Unproject({camera.width_px() - 1.0, camera.height_px() - 1.0});
  if (!corner) return std::numeric_limits<double>::infinity();
  const Eigen::Matrix2d d_radial = camera.DPixelDRadial(*corner);
  return std::sqrt((d_radial * covariance * d_radial.transpose()).trace());
}

}  // namespace

void LocalAdjustment::SetLens(const Eigen::Vector2d& added_radial) {
  if (added_radial.isZero(0)) return;
  const auto camera = calibration_.WithRadial(added_radial);
  if (!camera.ok()) return;
  camera_ = *camera;
  lens_is_known_ = true;
}

// What is known is held.
BundleLens LocalAdjustment::LensPrior() const {
  BundleLens lens = lens_;
  lens.model = std::make_shared<const CameraModel>(camera_);
  const LensMatrix covariance =
      (lens_.sqrt_information.transpose() * lens_.sqrt_information).inverse();
  if (lens_is_known_) {
    lens.sqrt_information =
        MakeLens(lens.model, camera_, kHeldCornerSigmaPx, std::sqrt(covariance(2, 2)))
            .sqrt_information;
  }
  if (readout_is_known_ || in_world_) {
    lens.sqrt_information.row(2) = LensVector(0, 0, 1 / kHeldReadoutSigma_s);
    lens.sqrt_information.col(2).head<2>().setZero();
  }
  return lens;
}

// Of successive windows, each with keyframes of its own, what they say is independent.
void LocalAdjustment::AdjustLens() {
  keyframes_since_lens_ = 0;
  const int first = static_cast<int>(keyframes_.size()) - options_.max_keyframes;
  BundleProblem problem;
  const std::vector<TrackId> tracks = MakeProblem(first, first + 1, &problem);
  if (tracks.empty()) return;
  const BundleLens prior = LensPrior();
  problem.lenses.push_back(prior);
  for (BundleCamera& camera : problem.cameras) {
    camera.lens = 0;
    camera.model = prior.model.get();
  }
  BundleOptions bundle = options_.bundle;
  bundle.max_iterations = options_.max_start_iterations;
  BundleParameters parameters(problem);
  if (!SolveBundle(bundle, problem, nullptr, &parameters).usable) return;
  parameters.WriteTo(bundle, &problem);
  const auto covariance = LensCovariance(bundle, problem, 0);
  if (!covariance || !(covariance->determinant() > 0)) return;
  const bool is_first = lens_windows_++ == 0;
  const LensMatrix known = prior.sqrt_information.transpose() * prior.sqrt_information;
  const double share = 1 / (options_.lens_noise_factor * options_.lens_noise_factor);
  LensMatrix information = (1 - share) * known + share * covariance->inverse();
  if (in_world_) {
    // Of the readout it says nothing.
    const LensMatrix before = lens_.sqrt_information.transpose() * lens_.sqrt_information;
    const LensMatrix spread = before.inverse();
    information.row(2) = LensVector(0, 0, 1 / spread(2, 2));
    information.col(2).head<2>().setZero();
  }
  lens_.sqrt_information = information.llt().matrixU();
  if (!lens_is_known_) camera_ = *problem.lenses[0].model;
  if (!readout_is_known_ && !in_world_) readout_s_ += problem.lenses[0].deviation[2];
  const LensMatrix left = information.inverse();
  lens_is_known_ =
      lens_is_known_ || LensSigmaPx(camera_, left.topLeftCorner<2, 2>()) < options_.lens_known_px;
  readout_is_known_ =
      readout_is_known_ || (!in_world_ && std::sqrt(left(2, 2)) < options_.readout_known_s);
  // The first one corrects the most. Later ones would only let the scale drift: the keyframes that
  // carry it over are free here.
  if (is_first && !in_world_) TakeResult(problem, tracks, first);
}

}  // namespace portolan
