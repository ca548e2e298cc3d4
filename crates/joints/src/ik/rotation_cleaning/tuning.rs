//! Settings of this room. Measured on six CMU takes of 120 frames a second and eight BVH files of
//! other makers' rigs (30 to 120), unless it says otherwise.

use std::f64::consts::PI;

/// A degree, radians.
const DEGREE: f64 = PI / 180.0;

/// The noise over which all is smoothed, radians. Files without noise have a median over their
/// joints of up to 0.18 degrees, with half a degree added 0.48 and more.
pub(super) const NOISE_LIMIT: f64 = 0.25 * DEGREE;
/// A pop leaves its path and comes back within this, seconds, and frames at least. 195 of 197
/// planted ones are found, and 7 frames of 65,000 in files without.
pub(super) const POP_SECONDS: f64 = 0.035;
pub(super) const POP_FRAMES: usize = 2;
/// Its smaller step, radians, and how many times as large it is as the median and the largest step
/// around it.
pub(super) const POP_STEP: f64 = 8.0 * DEGREE;
pub(super) const TIMES_MEDIAN: f64 = 4.0;
pub(super) const TIMES_LARGEST: f64 = 2.0;
/// The median step counts as this at least, radians.
pub(super) const LEAST_MEDIAN: f64 = 0.25 * DEGREE;
/// How far the frames beside a pop may be apart, as a share of its smaller step.
pub(super) const POP_RETURN: f64 = 0.4;
/// A pop that is out and back within this, seconds, is no motion; another one has to be this many
/// times as large as every other step of its joint, of so many frames at least. Measured on 62 CMU
/// takes at 7 rates: at 30 frames a second 9 false ones of 333 are left, and 36, 54 and 87% of
/// those planted are found (10 to 20, 20 to 40, 40 to 90 degrees); with twice as large 26, and 47,
/// 72 and 94%.
pub(super) const POP_FAST: f64 = 0.031;
pub(super) const POP_UNIQUE: f64 = 3.0;
pub(super) const POP_FRAMES_OF_TAKE: usize = 40;
/// Steps before and after it that count, and how many of them there must be.
pub(super) const AROUND: usize = 4;
pub(super) const LEAST_AROUND: usize = 3;

/// Strengths: λ = 10^(first + step i).
pub(super) const FIRST_STRENGTH: f64 = -3.0;
pub(super) const STRENGTH_STEP: f64 = 0.33;
pub(super) const STRENGTHS: usize = 37;
/// The weight of a frame that counts for nothing: the system stays regular over long gaps.
pub(super) const NO_WEIGHT: f64 = 1e-6;

/// Gaps simulated at most to weigh the paths over one.
pub(super) const SIMULATED: usize = 16;
/// Frames beside a gap that give velocities.
pub(super) const SIDE: usize = 8;
/// The penalty of the regression a frame, radians².
pub(super) const RIDGE: f64 = DEGREE * DEGREE;
/// The regression near a gap: a frame this many seconds away, or this share of the gap, weighs
/// 1 / e; frames up to so many times that count; the penalty is that of all frames times the
/// square of the gap's seconds, of a tenth at least. By itself it errs by .79 .62 .58 .47 of slerp
/// in gaps of .1 .3 .6 1 s (24 CMU takes of 4 s), that of all frames by .97 .73 .50 .40.
pub(super) const LOCAL: f64 = 0.25;
pub(super) const LOCAL_SHARE: f64 = 0.5;
pub(super) const LOCAL_REACH: f64 = 6.0;
pub(super) const LEAST_RIDGE: f64 = 0.1;
/// Gaps of a joint beside which one is learned, at most.
pub(super) const MOST_LOCAL: usize = 200;
/// Joints that turn by less do not predict others (rms, radians).
pub(super) const STILL: f64 = 0.1 * DEGREE;
/// Axes that predict, at most: those that move most.
pub(super) const MOST_PREDICTORS: usize = 300;
/// Shorter gaps are bridged by time alone, seconds; and kinds of gaps of a joint that are
/// regressed, at most.
pub(super) const SHORT: f64 = 0.04;
pub(super) const MOST_REGRESSED: usize = 24;

/// An angle this far from the pole, as its cosine, is at it: the first angle then stays. (At 1
/// degree, rotations would be written up to a degree off.)
pub(super) const AT_POLE: f64 = 0.1 * DEGREE;
/// A rotation that moved by less keeps the file's branch of its angles, radians.
pub(super) const UNCHANGED: f64 = 10.0 * DEGREE;
