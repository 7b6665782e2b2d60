#include "agent/agent_flags.h"

namespace portolan {
namespace {

void AddTracker(TrackerOptions* options, OptionSection section) {
  section.AddChoice("detector", &options->detector.type,
                    {{"shi_tomasi", DetectorType::kShiTomasi},
                     {"harris", DetectorType::kHarris},
                     {"fast", DetectorType::kFast},
                     {"orb", DetectorType::kOrb},
                     {"sift", DetectorType::kSift}},
                    "corner detector; shi_tomasi gives the best sub-pixel tracks for its cost");
  section.AddChoice("matcher", &options->matcher,
                    {{"flow", MatcherType::kPyramidalFlow}, {"search", MatcherType::kActiveSearch}},
                    "how tracks are found again: pyramidal Lucas-Kanade from the last image, or "
                    "correlation over the predicted ellipse");
  section.Add("search_sigma_px", &options->search_sigma_px, "px",
              "search: spread of a track that the filter does not predict");
  section.Add("max_points", &options->max_points, "points",
              "live tracks; the filter uses a part, the uplink the longest, the live poses all");
  section.Add("min_spacing_px", &options->min_spacing_px, "px",
              "fewer tracks where their mean distance would be less");
  section.Add("min_distance_share", &options->min_distance_share, "",
              "least distance of a new corner from the other tracks");
  section.Add("border_px", &options->border_px, "px", "no track nearer to the image's edge");
  section.Add("min_correlation", &options->min_correlation, "",
              "least correlation with the reference patch for a track to live on");
  section.Add("min_reacquire_correlation", &options->min_reacquire_correlation, "",
              "least correlation that revives a lost track");
  section.Add("pyramid_levels", &options->pyramid_levels, "levels",
              "pyramid levels above the image; more bridge larger motion between frames");
  section.Add("gate_px", &options->gate_px, "px",
              "what is found farther from where a track must be, and than three sigmas, is another "
              "point");
  section.Add("base_sigma_px", &options->base_sigma_px, "px",
              "standard deviation of a perfect match");
}

void AddFilter(FilterOptions* options, OptionSection section) {
  section.Add("max_landmarks", &options->max_landmarks, "landmarks",
              "landmarks in the state; bounds the cost of a frame");
  section.Add("inverse_depth_sigma_ratio", &options->inverse_depth_sigma_ratio, "",
              "sigma of a new inverse depth over its mean; 0.5 puts infinity at two sigma");
  section.Add("relative_inverse_depth_sigma_ratio", &options->relative_inverse_depth_sigma_ratio,
              "", "the same relative to landmarks of known depth");
  section.Add("linearity_threshold", &options->linearity_threshold, "",
              "linearity index below which a landmark becomes Euclidean");
  section.AddChoice(
      "covariance_update", &options->covariance_update,
      {{"full", CovarianceUpdate::kFull}, {"compressed", CovarianceUpdate::kCompressed}},
      "whether the covariances of landmarks out of view are updated in every frame "
      "or when they are needed");
  section.AddChoice("inlier_selection", &options->inlier_selection,
                    {{"one_point_ransac", InlierSelection::kOnePointRansac},
                     {"joint_compatibility", InlierSelection::kJointCompatibility},
                     {"chi_square", InlierSelection::kChiSquareOnly}},
                    "how wrong matches are found");
  section.Add("ransac_seed", &options->ransac_seed, "", "equal seeds give equal runs");
  section.Add("ransac_max_hypotheses", &options->ransac_max_hypotheses, "",
              "one-point hypotheses a frame at most");
  section.Add("joint_probability", &options->joint_probability, "",
              "joint_compatibility: share of the sets of right matches that pass the joint test");
  section.Add("joint_max_nodes", &options->joint_max_nodes, "",
              "joint_compatibility: pairings tried a frame at most; bounds the branch and bound");
  section.Add("divergence_max_normalised_innovation",
              &options->divergence_max_normalised_innovation, "",
              "mean normalised innovation above which the filter counts as diverged; 1 is ideal");
  section.Add("divergence_min_inlier_ratio", &options->divergence_min_inlier_ratio, "",
              "share of inliers below which the filter counts as diverged");
}

void AddMotion(ConstantVelocityOptions* options, OptionSection section) {
  section.Add("linear_acceleration", &options->linear_acceleration, "depths/s/sqrt(s)",
              "unknown acceleration in scene depths");
  section.Add("angular_acceleration", &options->angular_acceleration, "rad/s/sqrt(s)",
              "unknown angular acceleration");
  section.Add("initial_linear_velocity_sigma", &options->initial_linear_velocity_sigma, "depths/s",
              "spread of the unknown velocity at the start");
  section.Add("initial_angular_velocity_sigma", &options->initial_angular_velocity_sigma, "rad/s",
              "spread of the unknown angular velocity at the start");
}

void AddLandmarks(LandmarkManagerOptions* options, OptionSection section) {
  section.Add("target", &options->target_landmarks, "landmarks",
              "landmarks measured in every frame");
  section.Add("max", &options->max_landmarks, "landmarks",
              "landmarks in the state, in view or not");
  section.Add("min_age_frames", &options->min_age_frames, "frames",
              "age of a track before it may become a landmark");
  section.Add("max_outlier_frames", &options->max_outlier_frames, "frames",
              "successive outlier frames that end a landmark");
  section.Add("max_missed_frames", &options->max_missed_frames, "frames",
              "successive frames in view without a match that end a landmark");
}

void AddInitialization(LandmarkInitializerOptions* options, OptionSection section) {
  section.AddChoice("method", &options->method,
                    {{"inverse_depth", InitializationMethod::kInverseDepth},
                     {"two_view", InitializationMethod::kTwoView},
                     {"multi_view", InitializationMethod::kMultiView},
                     {"two_view_update", InitializationMethod::kTwoViewUpdate}},
                    "how landmarks start: at once with an unknown inverse depth; delayed until "
                    "triangulated from two views (DLT) or from many (Levenberg-Marquardt); from "
                    "two views and corrected in the same step by two-view geometry (Chen)");
  section.Add("min_parallax_rad", &options->min_parallax_rad, "rad",
              "delayed: least angle between the first and the present ray");
  section.Add("max_sigma_ratio", &options->max_sigma_ratio, "",
              "delayed: largest sigma of the inverse depth over its value");
  section.Add("view_interval_frames", &options->view_interval_frames, "frames",
              "delayed: every n-th frame is kept as a view");
  section.Add("max_views", &options->max_views, "views", "delayed: the oldest are forgotten");
  section.Add("pixel_sigma_px", &options->pixel_sigma_px, "px",
              "delayed: error of a view, that of its camera pose included");
  section.Add("min_landmarks", &options->min_landmarks, "landmarks",
              "with fewer measured, new ones start at once even if delayed: pure rotation, starts");
}

void AddTrackPlaces(TrackPlacesOptions* options, OptionSection section) {
  section.Add(
      "enabled", &options->enabled, "",
      "tracks are looked for where they must be, by the motion that the landmarks tell; those "
      "that slip end, lost ones are looked for in keyframes");
  section.Add("max_tracks", &options->max_tracks, "tracks",
              "tracks that are remembered, live ones too");
  section.Add("max_searched", &options->max_searched, "tracks", "tracks looked for in a keyframe");
  section.Add("min_parallax_rad", &options->min_parallax_rad, "rad",
              "parallax of a track whose place is known");
  section.Add("drift_sigma_px", &options->drift_sigma_px, "px",
              "how far a track may be from where it should be");
  section.Add("max_sigma_px", &options->max_sigma_px, "px",
              "tracks whose place is known less well are neither bound to it nor looked for");
}

void AddKeyframes(KeyframeSelectorOptions* options, OptionSection section) {
  section.Add("min_parallax_rad", &options->min_parallax_rad, "rad",
              "median parallax that makes a keyframe");
  section.Add("min_flow_rad", &options->min_flow_rad, "rad",
              "median flow, rotation included, that makes a keyframe");
  section.Add("min_tracks_left", &options->min_tracks_left, "",
              "share of the last keyframe's tracks below which a keyframe is due");
  section.Add("min_interval_s", &options->min_interval_s, "s",
              "shortest time between keyframes, unless tracks are being lost");
  section.Add("max_interval_s", &options->max_interval_s, "s",
              "longest time between keyframes while the camera moves");
  section.Add("moving_flow_rad", &options->moving_flow_rad, "rad",
              "flow since the last keyframe above which the camera counts as moving");
}

void AddSubmap(SubmapBuilderOptions* options, OptionSection section) {
  section.Add("max_keyframes", &options->max_keyframes, "keyframes",
              "keyframes that fill a submap");
  section.Add("max_distance_depths", &options->max_distance_depths, "depths",
              "travelled distance that fills a submap, in median scene depths");
  section.Add("max_rotation_rad", &options->max_rotation_rad, "rad",
              "accumulated rotation that fills a submap");
  section.Add("min_keyframes", &options->min_keyframes, "keyframes",
              "a submap that ends in a failure with fewer is not uploaded");
  section.Add("max_observations_per_keyframe", &options->max_observations_per_keyframe, "tracks",
              "tracks that are uploaded, those that most keyframes see");
  section.Add("keyframes_per_description", &options->keyframes_per_description, "keyframes",
              "every n-th keyframe is described for place recognition; costs uplink");
}

void AddHealth(TrackingHealthOptions* options, OptionSection section) {
  section.Add("min_inliers", &options->min_inliers, "landmarks", "a frame with fewer is bad");
  section.Add("max_bad_frames", &options->max_bad_frames, "frames",
              "this many bad frames in a row close the submap");
  section.Add("max_pause_s", &options->max_pause_s, "s",
              "a longer pause between images closes the submap");
  section.Add("short_pause_s", &options->short_pause_s, "s",
              "a pause longer than this closes it unless enough landmarks are seen again");
  section.Add("min_inliers_after_pause", &options->min_inliers_after_pause, "landmarks",
              "how many that must be");
}

void AddImu(ImuOptions* options, OptionSection section) {
  section.Add("gravity_m_s2", &options->model.gravity_m_s2, "m/s^2", "gravity of the place");
  section.Add("noise_factor", &options->model.noise_factor, "",
              "factor of the calibration's noise densities; data sheets describe a sensor at rest");
  section.Add("gyro_bias_sigma", &options->initializer.alignment.gyro_bias_sigma, "rad/s",
              "spread of the gyro's bias at the start");
  section.Add("accel_bias_sigma", &options->initializer.alignment.accel_bias_sigma, "m/s^2",
              "spread of the accelerometer's bias at the start");
  section.Add("max_log_scale_sigma", &options->initializer.alignment.max_log_scale_sigma, "",
              "the submaps become metric when the motion has told the scale this well, relative");
  section.Add("patient_log_scale_sigma", &options->initializer.patient_log_scale_sigma, "",
              "the same once the longest stretch of motion has been tried");
  section.Add("min_window_s", &options->initializer.min_window_s, "s",
              "shortest stretch of motion that scale and gravity are taken from");
  section.Add("max_window_s", &options->initializer.max_window_s, "s",
              "longest stretch of motion that scale and gravity are taken from");
  section.Add("max_gap_s", &options->buffer.max_gap_s, "s",
              "samples farther apart leave a gap, which is bridged at constant velocity");
}

void AddOdometry(OdometryOptions* options, OptionSection section) {
  OdometryModelOptions* model = &options->model;
  section.Add("translation_per_sqrt_m", &model->translation_per_sqrt_m, "m/sqrt(m)",
              "error along and across that grows with the way");
  section.Add("rotation_per_sqrt_m", &model->rotation_per_sqrt_m, "rad/sqrt(m)",
              "error of the heading that grows with the way: slip");
  section.Add("rotation_per_sqrt_rad", &model->rotation_per_sqrt_rad, "rad/sqrt(rad)",
              "error of the heading that grows with the turn");
  section.Add("out_of_plane_per_sqrt_m", &model->out_of_plane_per_sqrt_m, "rad, m/sqrt(m)",
              "roll, pitch and height that the wheels do not see");
  section.Add("scale_sigma", &model->scale_sigma, "", "relative error of the wheels' radius");
  section.Add("max_gap_s", &options->buffer.max_gap_s, "s",
              "samples farther apart leave a gap, which is bridged at constant velocity");
}

void AddLocalAdjustment(LocalAdjustmentOptions* options, OptionSection section) {
  section.Add("max_keyframes", &options->max_keyframes, "keyframes", "keyframes of an adjustment");
  section.Add("max_free_keyframes", &options->max_free_keyframes, "keyframes",
              "how many of them it moves; the older ones hold pose and scale");
  section.Add("max_iterations", &options->bundle.max_iterations, "",
              "Levenberg-Marquardt steps a keyframe");
  section.Add("max_start_iterations", &options->max_start_iterations, "",
              "the same at the start and after a correction of the server");
  section.Add("loss_scale_sigmas", &options->bundle.loss_scale_sigmas, "sigmas",
              "errors beyond this many weigh less");
  section.Add(
      "max_lens_windows", &options->max_lens_windows, "windows",
      "the lens's radial distortion and the readout are looked for over this many windows of "
      "max_keyframes; 0: lens and shutter are taken as they are");
  section.Add("trust_distortion", &options->trust_distortion, "",
              "a calibration with distortion is taken as it is");
  section.Add("readout_sigma_s", &options->readout_sigma_s, "s",
              "how long it may take from reading an image's first row to its last; 0: all rows are "
              "taken at once");
  section.Add("lens_corner_sigma_px", &options->lens_corner_sigma_px, "px",
              "how far the calibration may be off at the image's corner");
}

void AddRevisit(RevisitOptions* options, OptionSection section) {
  section.Add("enabled", &options->enabled, "",
              "live poses hold on to landmarks of the map that the agent sees again");
  section.Add("keyframe_interval", &options->keyframe_interval, "keyframes",
              "every n-th keyframe is searched for them");
  section.Add("offered_bytes_per_second", &options->offered_bytes_per_second, "bytes/s",
              "what the server may send of other agents' landmarks; 0 for nothing");
}

void AddStereo(StereoOptions* options, OptionSection section) {
  section.Add("nearest_m", &options->nearest_m, "m",
              "nothing nearer is looked for in the second camera's image");
  section.Add("min_correlation", &options->min_correlation, "",
              "least normalised cross-correlation of the two cameras' views of a patch");
  section.Add("max_epipolar_px", &options->max_epipolar_px, "px",
              "a match farther than this from its epipolar curve is none");
  section.Add("calibration_sigma_px", &options->calibration_sigma_px, "px",
              "error of the cameras' calibration towards each other");
  section.Add("pyramid_levels", &options->pyramid_levels, "levels",
              "pyramid levels above the images for the search");
}

void AddRange(RangeOptions* options, OptionSection section) {
  section.Add("max_spots", &options->max_spots, "tracks",
              "spots of the laser that are followed in the images at a time");
  section.Add("spot_interval_s", &options->spot_interval_s, "s", "least time between two of them");
  section.Add("min_parallax_rad", &options->min_parallax_rad, "rad",
              "a spot's distance is known once it is seen from so far apart");
  section.Add("max_depth_sigma_ratio", &options->max_depth_sigma_ratio, "",
              "and with such a relative error");
  section.Add("good_depth_sigma_ratio", &options->good_depth_sigma_ratio, "",
              "it counts when its track ends, or as soon as it is known so well");
  section.Add("spot_sigma", &options->spot_sigma, "",
              "relative error of the distance by where exactly the laser met the surface");
  section.Add("map_sigma", &options->map_sigma, "",
              "relative error of the map about a spot against the whole of it");
  section.Add("min_ranges", &options->scale.min_ranges, "ranges",
              "ranges that have to agree before the submaps become metric");
  section.Add("max_log_scale_sigma", &options->scale.max_log_scale_sigma, "",
              "the submaps become metric when the ranges tell the scale this well, relative");
  section.Add("window_s", &options->scale.window_s, "s",
              "ranges of so long are compared to find the scale");
  section.Add("scale_drift", &options->scale_drift, "",
              "relative drift of a map's scale over a median scene depth of way");
  section.Add("gate_chi2", &options->gate_chi2, "",
              "chi-square limit of a range's innovation; 6.63 keeps 99 % of the right ones");
  section.Add("max_age_s", &options->max_age_s, "s",
              "a range this much older than an image is not used with it");
  section.Add("max_rejected_in_row", &options->max_rejected_in_row, "ranges",
              "after so many beyond the limit in a row the scale is looked for anew");
  section.Add("trusted_gap_s", &options->trusted_gap_s, "s",
              "submaps are no longer called metric after so long without a range that fits");
}

}  // namespace

void AddAgentOptions(AgentOptions* options, OptionTable* table) {
  AddTracker(&options->tracker, table->Section("tracker"));
  AddFilter(&options->filter, table->Section("filter"));
  AddMotion(&options->motion, table->Section("motion"));
  AddLandmarks(&options->landmarks, table->Section("landmarks"));
  AddInitialization(&options->initialization, table->Section("initialization"));
  AddTrackPlaces(&options->track_places, table->Section("track_places"));
  AddKeyframes(&options->keyframes, table->Section("keyframes"));
  AddSubmap(&options->submap, table->Section("submap"));
  AddHealth(&options->health, table->Section("health"));
  AddImu(&options->imu, table->Section("imu"));
  AddOdometry(&options->odometry, table->Section("odometry"));
  AddStereo(&options->stereo, table->Section("stereo"));
  AddRange(&options->range, table->Section("range"));
  AddLocalAdjustment(&options->local_adjustment, table->Section("local_adjustment"));
  AddRevisit(&options->revisit, table->Section("revisit"));
  table->Add(
      "min_landmarks_for_places", &options->min_landmarks_for_places, "landmarks",
      "with fewer measured, tracks are neither looked for where they must be nor end elsewhere");
  table->Add("min_tracks_share", &options->min_tracks_share, "",
             "new corners are looked for when fewer than this share of the points is left");
}

}  // namespace portolan
