//! The constants of filling gaps, by the file that they are used in.
//!
//! "Prototype": 600 simulated gaps of .1 to 5 s in CMU takes of subjects 01, 02 and 07 at 120
//! frames a second, their last takes held out, and 129 gaps of other people. A ratio is that of the
//! RMS error to the error of a Gaussian conditional. Where no measurement is named, none is
//! recorded.

/// Noise of what gaps are filled from.
pub(crate) mod noise {
    /// How often the variance beside a gap is added to that of what fills it: both ends err.
    /// Chosen in takes of 02, 13, 35 and 49 left out of the model, with white noise of .5 and 1 cm,
    /// denoised (seeds 1 and 2).
    pub(crate) const NOISE_SHARE: f64 = 1.2;
}

/// Groups of gaps.
pub(crate) mod filler {
    /// Gaps whose lengths are within this factor are filled at the same time.
    pub(crate) const SAME_LENGTH: usize = 4;
    /// Where there are more gaps than this, those of under so many frames are interpolated over
    /// time: there are too many to learn each, and the path is nearly as good.
    pub(crate) const MANY_GAPS: usize = 200;
    pub(crate) const BRIEF: usize = 8;
    /// Where a table has points that the model lacks, or poses unlike its: by how much its squared
    /// variance counts more than that of the take alone, and its share where no gap can be
    /// simulated.
    pub(crate) const MODEL_DOUBT: f64 = 4.0;
    pub(crate) const UNTRIED_SHARE: f64 = 0.3;
    /// More gaps than this are not filled once more.
    pub(crate) const MANY_AGAIN: usize = 200;
    /// How often a gap is tried at most since others are filled from whose frames it would be
    /// learned.
    pub(crate) const MOST_ROUNDS: usize = 16;
    /// Seconds on either side of a gap that are learned from.
    pub(crate) const WINDOW: f64 = 25.0;
    /// Seconds between two runs: what is further apart than anything.
    pub(crate) const BREAK: f64 = 1e6;
    /// A gap filled mostly by interpolation is called that.
    pub(crate) const MOSTLY: f64 = 0.5;
}

/// What a gap's points are learned from.
pub(crate) mod predictors {
    /// Complete frames that a gap's points can be learned from, at least; fewer where a model knows
    /// the points.
    pub(crate) const FEWEST_FRAMES: usize = 30;
    pub(crate) const FEWEST_WITH_OTHERS: usize = 8;
    /// Training poses of a model that are placed for one group, at most.
    pub(crate) const MOST_PLACED: usize = 3000;
    /// Predictors, at most: those at the steadiest distances. Over 900 gaps of 20 takes by
    /// themselves, errors are .97 to 1.00 of those with 40 up to .3 s, .96 at .6 and .90 at 1 s; 16
    /// are better still by themselves, and worse with a model of 22 joints (ratio .55
    /// for .50).
    pub(crate) const MOST_PREDICTORS: usize = 24;
    /// Frames with all predictors, as a share of those with the targets: predictors that are
    /// missing more often are left out.
    pub(crate) const SHARE_COMPLETE: f64 = 0.5;
    /// Frames that tell how steady a distance is, at most about.
    pub(crate) const STEADY_FRAMES: usize = 50;
}

/// The paths of single points.
pub(crate) mod path {
    /// Seconds on either side of a gap that interpolation over time looks at.
    pub(crate) const REACH: f64 = 1.0 / 6.0;
    /// Frames before an end in which the next is seen that gives its direction.
    pub(crate) const NEXT: usize = 3;
    /// How far going straight on may miss, cm: as in commercial practice.
    pub(crate) const MISS: f64 = 4.0;
    /// A point is at rest where it strays no further than this, cm, for so many seconds.
    pub(crate) const REST: f64 = 1.0;
    pub(crate) const REST_SECONDS: f64 = 0.1;
    /// A point at rest on either side of a gap of no more seconds rests all through it, if it is no
    /// further away, cm.
    pub(crate) const RESTS_SECONDS: f64 = 0.5;
    pub(crate) const RESTS_WITHIN: f64 = 2.0;
    /// Standard deviation of a coordinate in the middle of such a gap, cm.
    pub(crate) const RESTS_SD: f64 = 0.2;
    /// Simulated gaps that the deviation is measured in.
    pub(crate) const SIMULATED: usize = 20;
}

/// Gaps of a whole body. By a trial on 31 CMU takes of 17 people at 120 frames a second, RMS in cm
/// at 1, 12, 45 and 120 frames: PCHIP .060 .246 2.02 8.50, Hermite by chords of two frames .064
/// .216 1.32 7.66, the mix .061 .198 1.28 7.51; with .1 cm of noise .105 .307 2.09 8.60, .111 .293
/// 1.42 7.77, .105 .252 1.33 7.56. Within one and two sd .77 and .94.
pub(crate) mod whole_body {
    /// Points that place a body, at least.
    pub(crate) const PLACING: usize = 3;
    pub(crate) use crate::inbetween::LONGEST;
    /// Simulated gaps, at most.
    pub(crate) const SIMULATED: usize = 8;
    /// Seconds from which on w₀ is Hermite alone; briefer gaps have a share of PCHIP.
    pub(crate) const HERMITE: f64 = 0.1;
    /// The least variance of a coordinate in the middle of a gap, cm².
    pub(crate) const LEAST_VARIANCE: f64 = 1e-6;
}

/// Ends at which predictors go missing.
pub(crate) mod ends {
    /// Frames by which a predictor goes on.
    pub(crate) const FRAMES: usize = 9;
    /// Standard deviation of a coordinate that goes on for a frame, cm: .09 to .16 in arms and legs
    /// of 31 CMU takes at 120 frames a second.
    pub(crate) const SD: f64 = 0.15;
}

/// Reference frames.
pub(crate) mod local_poses {
    /// Frames that the mean shape of predictors is measured in.
    pub(crate) const SHAPE_FRAMES: usize = 200;
    /// Rounds of fitting them to their mean.
    pub(crate) const SHAPE_ROUNDS: usize = 2;
}

/// The conditional and the processes. Prototype: the processes bring the ratio from .74 to .65,
/// .67 without their share of time; frames, widths and the share of time were chosen there.
pub(crate) mod regression {
    /// Added to the variance of each predictor, cm²: what no predictor is more exact than.
    pub(crate) const RIDGE: f64 = 0.01;
    /// The share of noise in what a process learns beside a model's poses, at most; without these
    /// it has none, for where all is called noise the spread of what is left goes with it.
    pub(crate) const MOST_NOISE: f64 = 0.01;
    /// Own frames spread over the take, and other poses, nearest to the gap's and as many nearest
    /// to the simulated ones'. Over 490 gaps of .1 to 1.5 s in 20 takes, with and without a model,
    /// the errors with 330 and 180 are the same within 2% at each length.
    pub(crate) const SPREAD_FRAMES: usize = 240;
    pub(crate) const NEAREST_OTHERS: usize = 100;
    /// Frames of a gap that others are near to.
    pub(crate) const NEAR_TO: usize = 6;
    /// Frames of 1/120 s from a gap's end that are training frames too.
    pub(crate) const BESIDE: [f64; 14] = [
        1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 14.0, 22.0, 36.0, 60.0,
    ];
    /// Distances that are less than this share of squares are rounding.
    pub(crate) const ROUNDING: f64 = 1e-9;
    /// Share of the variance that no predictor explains.
    pub(crate) const NUGGET: f64 = 3e-4;
    /// Seconds over which residuals are alike: 25 frames of the prototype.
    pub(crate) const TIME_SCALE: f64 = 0.21;
    /// Times this scale, from which on they have nothing in common: under 10⁻⁶.
    pub(crate) const FAR_APART: f64 = 10.0;
    /// Own frames from which on the own statistics count as much as the others'.
    pub(crate) const OWN_FRAMES: f64 = 60.0;
    /// Frames that the covariance is computed from, at most; 2000 are no better.
    pub(crate) const COVARIANCE_FRAMES: usize = 600;

    /// A Gaussian process: whose frames it learns from, and which poses it treats as alike.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Kernel {
        /// Whether others' poses are training frames too.
        pub others: bool,
        /// w, the width over poses.
        pub width: f64,
        /// τ, the share of time.
        pub time: f64,
    }

    const fn kernel(others: bool, width: f64, time: f64) -> Kernel {
        Kernel {
            others,
            width,
            time,
        }
    }

    /// The processes for takes of people that others' poses are known for.
    pub(crate) const POOLED: [Kernel; 3] = [
        kernel(true, 2.0, 0.01),
        kernel(true, 8.0, 0.0),
        kernel(false, 8.0, 0.01),
    ];
    /// Gaps shorter than this, in seconds, of a take without a model have only the first process:
    /// both are 1% better there, thousandths of a centimeter. The share of coordinates within one
    /// and two sd is the same (.75 and .92).
    pub(crate) const ONE_PROCESS: f64 = 0.3;
    /// The processes that learn from the take alone.
    pub(crate) const OWN: [Kernel; 2] = [kernel(false, 8.0, 0.01), kernel(false, 8.0, 0.0)];
}

/// The estimates of a gap.
pub(crate) mod estimates {
    /// Seconds on either side that the regression's errors are read from.
    pub(crate) const ERROR_REACH: f64 = 1.0 / 12.0;
    /// Seconds beside a gap over which the speed there is measured.
    pub(crate) const SPEED_REACH: f64 = 0.05;
    /// Seconds after which e⁻¹ of an error is left where a gap has one end.
    pub(crate) const FADES: f64 = 0.25;
    /// The variance of estimates about their mean counts so often. With people left out of the
    /// model .86 of coordinates were within two stated deviations at 0, .89 at 1, .90 at 2.
    pub(crate) const DISAGREE: f64 = 2.0;
}

/// The weights of the estimates.
pub(crate) mod weights {
    /// Gaps are simulated at the first of these parts of the true length of which the take has room
    /// for two.
    pub(crate) const SHORTER: [usize; 4] = [1, 2, 4, 8];
    /// Gaps of more seconds are simulated at their own length or not at all: what is best in short
    /// ones is not in long ones.
    pub(crate) const LONG: f64 = 0.5;
    /// Simulated gaps, at most. Prototype: two give a ratio of .690, four .643, eight .645.
    pub(crate) const SIMULATED: usize = 4;
    /// A simulated gap and what is left to learn from: together at least this many lengths of it.
    pub(crate) const ROOM: f64 = 2.5;
    /// Frames of a simulated gap at which errors are measured, as in the prototype.
    pub(crate) const KNOTS: usize = 12;
    /// Seconds that a simulated gap with one end hides beyond it.
    pub(crate) const BEYOND: f64 = 1.0;
    /// The share in w₀ of what is interpolated over time: that of a gap of one frame, and the
    /// seconds from which on there is none.
    pub(crate) const TIME_SHARE: f64 = 0.5;
    pub(crate) const TIME_ENDS: f64 = 0.3;
    /// Up to this length, seconds, interpolation has half of the weight and its share of the rest
    /// where nothing can be simulated.
    pub(crate) const BRIEF: f64 = 0.1;
    /// Seconds of a gap from which on the conditional weighs half as much as a process in w₀: it is
    /// steady, but knows no details.
    pub(crate) const CONDITIONAL_SECONDS: f64 = 0.5;
    /// Starts of a part of the take whose speeds are looked at for a simulated gap, at most.
    pub(crate) const LOOKED_AT: usize = 100;
    /// How many simulated gaps w₀ is worth beside one, for each second: w is as good as they are
    /// many and the gap is short.
    pub(crate) const HOLD_SECONDS: f64 = 1.5;
    /// How strongly w is held to w₀, as in the prototype.
    pub(crate) const SHRINKAGE: f64 = 0.1;
    /// The variance that errors usually show, over that of the processes, with others' poses and
    /// of a take by itself, and how many simulated gaps that is worth.
    pub(crate) const USUAL_FACTOR: f64 = 0.42;
    pub(crate) const OWN_USUAL_FACTOR: f64 = 0.75;
    pub(crate) const USUAL_COUNT: f64 = 1.0;
    /// How many times as large it is where what is learned from was denoised: in-sample residuals
    /// hide the motion that denoising took. With it .65 to .73 and .89 to .94 are within one and
    /// two deviations, .56 to .62 and .83 to .88 without.
    pub(crate) const NOISY: f64 = 2.8;
    /// The variance of a predictor's coordinate at which half of that counts, cm².
    pub(crate) const HALF_NOISY: f64 = 4e-4;
    /// What is added to it for each second of a gap of which only the take's own frames tell: the
    /// longer, the more it lacks them.
    pub(crate) const OWN_FACTOR: f64 = 1.2;
    /// Errors of simulated gaps show no less than this.
    pub(crate) const LEAST_FACTOR: f64 = 1e-6;
}

/// Feet that stand. Prototype: whole legs missing in 12 CMU takes, .3, .6 and 1 s; the
/// errors at .3 and .6 s stand in testdata/FIGURES.md.
pub(crate) mod contacts {
    /// A leg stands upright if over half of its frames have a larger cosine of hip over ankle.
    pub(crate) const UPRIGHT: f64 = 0.7;
    /// The leg of an adult, hip to ankle, cm: of others, centimeters count as shares of theirs.
    pub(crate) const LEG: f64 = 80.0;
    /// Briefer gaps, seconds, are better filled without.
    pub(crate) const BRIEFEST: f64 = 0.15;
    /// A foot is planted at the end of a gap if over so many seconds there it is slower than this,
    /// cm/s, and so low over the ground, cm.
    pub(crate) const END_SECONDS: f64 = 0.05;
    pub(crate) const END_SPEED: f64 = 30.0;
    pub(crate) const LOW: f64 = 5.0;
    /// Planted at both ends, no further apart than this, cm, with a path that leaves the line
    /// between by no more than this, cm, it stands all through the gap.
    pub(crate) const SAME_PLACE: f64 = 3.0;
    pub(crate) const STRAYS: f64 = 15.0;
    /// Else it stands from a planted end on while its path is so near, cm, and so slow, cm/s.
    pub(crate) const NEAR: f64 = 8.0;
    pub(crate) const SLOW: f64 = 70.0;
    /// Or while the other foot swings, faster than this, cm/s, and than this over the root's speed,
    /// of which so much is usual, and its path is so near, cm.
    pub(crate) const SWING: f64 = 90.0;
    pub(crate) const SWING_MORE: f64 = 30.0;
    pub(crate) const ROOT_SPEED: f64 = 40.0;
    pub(crate) const NEAR_IN_SWING: f64 = 30.0;
    /// And its height, cm: higher, both feet are in the air.
    pub(crate) const HIGHEST: f64 = 15.0;
    /// Between: it stands where its path is slower than this, cm/s, and low, for so many seconds.
    pub(crate) const INSIDE_SPEED: f64 = 39.0;
    pub(crate) const INSIDE_SECONDS: f64 = 0.08;
    /// Seconds over which what holds it fades.
    pub(crate) const FADE: f64 = 0.1;
    /// A leg is stretched to this share of its length at most, if it is not already.
    pub(crate) const REACH: f64 = 0.9995;
    /// The weight of forward against the bend of a knee, cm, for a foot moved by so much, cm:
    /// knees bend forward.
    pub(crate) const FORWARD: f64 = 2.0;
    pub(crate) const MOVED: f64 = 5.0;
}

/// What a body can follow.
pub(crate) mod motion_limits {
    /// How much more than it is seen to do a point may do in a gap; what any point may do: cm/s,
    /// and cm beside.
    pub(crate) const MORE: f64 = 2.0;
    pub(crate) const ANY_SPEED: f64 = 800.0;
    pub(crate) const LEAST_DISTANCE: f64 = 10.0;
    /// Frames that tell what a point does.
    pub(crate) const FEWEST: usize = 10;
    /// Frames and other points that distances are measured in.
    pub(crate) const FRAMES: usize = 300;
    pub(crate) const OTHERS: usize = 50;
}

/// Gaps filled by the model.
pub(crate) mod model_fill {
    /// Noise of estimates to which no end belongs, in their standard deviations: errors last for
    /// some frames.
    pub(crate) const JUMPS: f64 = 4.0;
    /// The same of estimates by upright poses, which jump less. In 12 takes of people left out, 4
    /// gives 11.4, 13.0, 15.0 and 4.6 cm (head and hands; chest and up; no legs; six joints), 1
    /// gives 11.0, 12.4, 14.0 and 4.5, and .3 no less.
    pub(crate) const UPRIGHT_JUMPS: f64 = 1.0;
    /// A point's variance: so much of the stated one, and so much of the mean over the missing
    /// points. By calibration on 51 takes of people that the model does not know, of which six
    /// joints were seen.
    pub(crate) const OWN_SHARE: f64 = 1.5;
    pub(crate) const COMMON_SHARE: f64 = 2.0;
    /// A point that was filled counts as seen up to this standard deviation, cm.
    pub(crate) const KNOWN_SD: f64 = 1.5;
    /// Noise that is assumed, cm, as long as the estimates are no path that a body can follow.
    pub(crate) const STRONGER: [f64; 5] = [2.0, 4.0, 8.0, 16.0, 32.0];
}

/// Distances that are rigid in the take. Prototype: holding them brings the ratio from .66 to .57.
pub(crate) mod rigid_distances {
    /// The variance of a measured coordinate, cm².
    pub(crate) const MEASURED: f64 = 1e-10;
    /// Standard deviation of a rigid distance over the take, at most, cm.
    pub(crate) const RIGID: f64 = 0.1;
    /// Frames that distances are measured in: at least, and at most.
    pub(crate) const FEWEST_FRAMES: usize = 10;
    pub(crate) const MOST_FRAMES: usize = 400;
    /// Rigid distances of one point, the most rigid first.
    pub(crate) const MOST_PAIRS: usize = 8;
    /// Missing points of a frame that are solved together, at most.
    pub(crate) const MOST_POINTS: usize = 24;
    /// Variance added to that of a distance, cm².
    pub(crate) const LEAST_VARIANCE: f64 = 1e-4;
    /// Steps, at most, and how often one is halved until it helps.
    pub(crate) const STEPS: usize = 15;
    pub(crate) const HALVINGS: usize = 4;
    /// Steps that lower −2 log of the density by less are the last.
    pub(crate) const CONVERGED: f64 = 1e-6;
}
