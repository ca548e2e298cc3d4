//! The constants of restoring takes and frames, by the file that they are used in; those of the
//! rooms below stand in a `tuning` of their own. Where no measurement is named, none is recorded.

/// The size of a body.
pub(crate) mod body_size {
    /// The statures of people, from the foot along the bones to the head, cm.
    pub(crate) const PEOPLE: std::ops::RangeInclusive<f64> = 80.0..=260.0;
}

/// Cleaned takes.
pub(crate) mod clean {
    /// Largest standard deviation of a coordinate in a gap that is filled, cm. With a tenth of the
    /// frames of an acrobat, a cartwheel, a jump and a dance of 41 markers in gaps of up to .5 s
    /// (three draws each), no frame is over 10 cm off where it is less than 1, one in a thousand up
    /// to 3, and one in four from 3 to 5.
    pub(crate) const MOST_SD: f64 = 3.0;
    /// That holds where points are off by no more themselves, cm.
    pub(crate) const USUAL_NOISE: f64 = 0.5;
    /// Distances that change by no more over a take are steady, cm; frames in which they are
    /// measured, at most about, and at least.
    pub(crate) const STEADY: f64 = 6.0;
    pub(crate) const STEADY_FRAMES: usize = 1500;
    pub(crate) const FEWEST_STEADY: usize = 60;
    /// Fills with a lower standard deviation are not asked whether they break them, cm.
    pub(crate) const SURE_SD: f64 = 0.5;
}

/// Upright poses for frames that show few points. Prototype: 24 takes of 15 people left out, of
/// which head and hands, root, head, hands and feet, six joints, the chest and up, all but the legs
/// or all but an arm are seen. The errors change by up to 4% from 100 to 500 poses and with every
/// second pose left out, and by up to 8%, to either side, from a ridge of 10 to 30 cm².
pub(crate) mod upright {
    /// Poses that are searched, at most.
    pub(crate) const MOST_POSES: usize = 8000;
    /// The nearest poses that a frame is learned from.
    pub(crate) const NEAREST: usize = 500;
    /// Added to the squared distance of the seen points, cm².
    pub(crate) const SOFTENING: f64 = 1.0;
    /// Variance of a coordinate that the nearest poses do not explain, cm²: where it is seen, and
    /// what is left of it where it is not.
    pub(crate) const RIDGE: f64 = 20.0;
    pub(crate) const LEFT: f64 = 1.0;
    /// The variance of errors over that of the Gaussian. With 2, 68 to 76% of the coordinates are
    /// within one and 88 to 95% within two standard deviations, in 24 takes of people left out.
    pub(crate) const SPREAD: f64 = 2.0;
    /// Distance, cm, of a point from the vertical axis through the center of all, at least.
    pub(crate) const LEAST_BREADTH: f64 = 1.0;
    /// Frames of a take that tell which way is up.
    pub(crate) const JUDGED_FRAMES: usize = 10;
    /// Poses that are fitted to them at any tilt.
    pub(crate) const TILTED_POSES: usize = 200;
    /// y is not up where the distance to upright poses is so many times that at any tilt: for fewer
    /// points, and for so many and more. In the prototype's takes, cartwheels among them, it was at
    /// most 2.9 times for three points and 1.96 for more; tilted by 60 degrees, in the median 6 to
    /// 9 and 2.3 to 7.5.
    pub(crate) const NOT_UP: (f64, f64) = (4.0, 2.0);
    /// What rounding leaves of an exact fit, cm².
    pub(crate) const ROUNDING: f64 = 1e-8;
    pub(crate) const MANY_POINTS: usize = 6;
}

/// Cuts of a take.
pub(crate) mod cuts {
    /// Largest acceleration of a body, cm/s²: that of a heel that strikes the ground.
    pub(crate) const MOST: f64 = 2e4;
    /// Largest acceleration that lasts for some frames, cm/s².
    pub(crate) const MOST_LONG: f64 = 5e3;
    /// Least jump, cm.
    pub(crate) const LEAST: f64 = 5.0;
    /// Least jump, in medians of what the points of the take do otherwise.
    pub(crate) const UNUSUAL: f64 = 5.0;
    /// Least jump at an end of a run, cm, where another pose may stand before or behind the take.
    pub(crate) const LEAST_AT_END: f64 = 3.0;
    /// Share of the points that jump, at least.
    pub(crate) const SHARE: f64 = 0.8;
    /// Points that are seen on both sides of a jump, at least.
    pub(crate) const POINTS: usize = 3;
    /// A body that is back within so many seconds was never gone: all of its points were measured
    /// wrongly.
    pub(crate) const BACK: f64 = 0.05;
    /// The frames of [`BACK`], at least.
    pub(crate) const BACK_FRAMES: usize = 3;
}

/// Bodies of other sizes.
pub(crate) mod pose_model {
    /// A body whose bones differ from the model's by no more than this share is the model's.
    pub(crate) const SAME_BODY: f64 = 0.002;
    /// Standard deviation of the log ratio of bone lengths between people.
    pub(crate) const PEOPLE_DIFFER: f64 = 0.1;
}

/// Whether a model knows a take.
pub(crate) mod adapted_prior {
    /// Frames by which a model is judged to know a take, at most.
    pub(crate) const JUDGED_FRAMES: usize = 50;
    /// Noise under which that can be judged, cm.
    pub(crate) const JUDGED_NOISE: f64 = 0.3;
    /// Frames that a distance between points is measured in, at least.
    pub(crate) const MEASURED_FRAMES: usize = 20;
    /// Standard deviation of a distance that is rigid but for the noise, at most, cm.
    pub(crate) const MOST_SPREAD: f64 = 0.15;
    /// Share of the points that a take never shows, from which on upright poses place a body. Of 8
    /// takes of people left out: without the legs (.26) 11.1 cm in place of 14.6, without an arm
    /// (.13) 14.2 in place of 12.9.
    pub(crate) const FEW_OF_TAKE: f64 = 0.2;
    /// The same of a frame by itself, whose gaps differ from one to the next: where most points are
    /// seen, the placement is left free.
    pub(crate) const FEW_OF_FRAME: f64 = 0.4;
}

/// Estimates of single frames.
pub(crate) mod frame_estimator {
    /// A noisier pelvis (variance of a coordinate, cm²) gives no placement to start from alone.
    pub(crate) const NOISY: f64 = 0.25;
    /// A point more likely an outlier than this probability does not place a pose.
    pub(crate) const SUSPECT: f64 = 0.05;
}

/// The noise of a capture.
pub(crate) mod noise_estimation {
    /// Up to this noise of most points, cm, deviating points of a single frame are outliers. Above,
    /// everything is noise unless the distances say otherwise.
    pub(crate) const NEARLY_CLEAN: f64 = 1.0;
    /// Takes with less noise stay as they are measured: standard deviation of a coordinate, cm.
    pub(crate) const NOISE_LIMIT: f64 = 0.1;
    /// Frames that the model measures the noise of where motion says nothing.
    pub(crate) const SAMPLED_FRAMES: usize = 20;
}

/// The noise of a capture by its bones.
pub(crate) mod capture_noise {
    /// Frames of a bone, at least.
    pub(crate) const FEWEST_FRAMES: usize = 30;
    /// Bones, at least.
    pub(crate) const FEWEST_BONES: usize = 4;
    /// Seconds over which a bone's length is compared with its mean: what changes more slowly is
    /// the body, or a camera's distortion.
    pub(crate) const LOCAL_SECONDS: f64 = 1.0;
    /// Distances of markers, which skin moves, are compared with their mean over fewer seconds.
    pub(crate) const PAIR_SECONDS: f64 = 0.35;
    /// Frames in which distances are compared, at most about.
    pub(crate) const PAIR_FRAMES: usize = 150;
    /// More correlation of distances of markers is that of skin, and so is such a difference
    /// between the correlation with the next frame and the root of that with the one after it.
    pub(crate) const PAIR_CORRELATION: f64 = 0.85;
    pub(crate) const UNLIKE_NOISE: f64 = 0.15;
    /// Rounds in which correlation and mean are told apart.
    pub(crate) const ROUNDS: usize = 4;
    /// Standard deviations beyond which a length counts as this far off.
    pub(crate) const FAR: f64 = 3.0;
    /// Less correlation from frame to frame is none. White noise of 300 frames and 22 bones reads
    /// as .0 +- .02.
    pub(crate) const LEAST_CORRELATION: f64 = 0.1;
    /// The largest correlation that is told from motion.
    pub(crate) const MOST_CORRELATION: f64 = 0.95;
    /// The two estimates of a variance differ by a larger factor where they measure other things.
    pub(crate) const MORE: f64 = 1.3;
    /// Fourth differences whose level is within this factor of the bones' say how the points
    /// differ.
    pub(crate) const ALIKE: f64 = 2.0;
    /// The variances of points differ by no more than this factor from the median.
    pub(crate) const POINTS_DIFFER: f64 = 4.0;
}

/// Kalman smoothers of many strengths.
pub(crate) mod adaptive_smoothing {
    /// Densities of white acceleration, cm²/s³: from a body at rest to a punch.
    pub(crate) const DENSITIES: [f64; 16] = [
        1e1, 3e1, 1e2, 3e2, 1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 1e6, 3e6, 1e7, 3e7, 1e8, 1e9,
    ];
    /// Frames that risks are averaged over, at least.
    pub(crate) const LEAST_FRAMES: f64 = 6.0;
    /// Frames that risks are averaged over, as so many times λ^¼.
    pub(crate) const FRAMES: f64 = 8.0;
    /// Sharpness of the weights: the variance of risks, in noise variances.
    pub(crate) const SPREAD: f64 = 4.0;
    /// The noise variance that motion without any reads as, cm².
    pub(crate) const MOTION_VARIANCE: f64 = 2e-4;
    /// The least noise variance that a path is smoothed by, cm².
    pub(crate) const LEAST_VARIANCE: f64 = 1e-8;
}

/// Frames that are estimated.
pub(crate) mod knots {
    /// How many a second, at least. Errors are those with 40 within .8% under noise of .1 cm, and
    /// within .5% under .3 to 5.6 cm.
    pub(crate) const PER_SECOND: f64 = 24.0;
}

/// What a model expects in a smoothed take.
pub(crate) mod model_estimates {
    /// Up to this noise of a smoothed coordinate, cm, a take shows its body's lengths well enough
    /// to hold poses to them.
    pub(crate) const MEASURES_LENGTHS: f64 = 0.3;
    /// The share of the noise's variance that trembles in the estimates.
    pub(crate) const SHARE_LEFT: f64 = 0.02;
}

/// Bones held to their lengths.
pub(crate) mod bone_lengths {
    /// Frames that a bone is measured in, at least.
    pub(crate) const FEWEST_FRAMES: usize = 20;
    /// Standard deviation of its length, at most, as a share.
    pub(crate) const MOST_SPREAD: f64 = 0.15;
    /// Rounds over the bones of a frame, at most.
    pub(crate) const ROUNDS: usize = 60;
    /// How far a length is off, at most, cm.
    pub(crate) const NEAR: f64 = 1e-3;
}

/// Outliers that are none.
pub(crate) mod sifted_take {
    /// An outlier within this many standard deviations of where the rest of the take expects it is
    /// none.
    pub(crate) const EXPECTED: f64 = 3.0;
}

/// Denoised takes and frames.
pub(crate) mod denoise {
    /// Noise assumed to measure the body of one frame by, cm, where none is given.
    pub(crate) const UNKNOWN_NOISE: f64 = 2.0;
    /// A point that moves by no more, cm, is unchanged.
    pub(crate) const UNCHANGED: f64 = 1e-9;
    /// The variance of a coordinate about the model's estimate that the noise is weighed against,
    /// cm². On 9 CMU takes of subjects 01, 02, 07 and 6 of other people, under noise of .1 to 5.6
    /// cm, takes so denoised are nowhere worse than captured, smoothed alone or filtered
    /// (Butterworth).
    pub(crate) const MODEL_VARIANCE: f64 = 0.04;
    /// The variance of a model's estimate: so much of the stated one, which leaves out that
    /// estimates are smoothed over time, and of the mean over the frame up to so much, the more
    /// noise the smoother leaves (half of it at so many cm²): the placement's error moves all
    /// points together. Chosen by eye to fit the errors by fifths of the stated deviation, in takes
    /// of 02, 13, 35 and 49 left out of the model, under white noise and noise of 5 and 15 Hz of
    /// .3, 1 and 3 cm; within one and two deviations are .61 to .80 and .90 to .98 (white noise,
    /// correlated noise and rounding, seeds 1 to 3; outliers aside).
    pub(crate) const OWN_SHARE: f64 = 0.5;
    pub(crate) const COMMON_SHARE: f64 = 0.8;
    pub(crate) const HALF_COMMON: f64 = 0.3;
    /// The variance that the smoother leaves, cm², for which that counts by half: without it .81
    /// are within one deviation under noise of .3 cm.
    pub(crate) const HALF_OWN: f64 = 0.004;
}
