//! Constants of keypoints. Chosen on made video keypoints of 8 takes of CMU's subjects 02, 13, 35
//! and 49 (17, 25 and 33 points, 30 frames a second, noise half of .15 and half of .3 s, depth 2.5
//! times worse), seeds 1 to 9 and 21 to 25, and 7 takes of 01, 05, 07, 09, 10 and 14. Not looked at
//! before the last change: seeds 41 to 46, and takes of 06, 08, 43 and 55 (5 stances), of 01, 05,
//! 07, 09, 10 and 14, and of 01, 09, 13 and 35. There the error is .85 to .89 of that of a
//! Butterworth told its cut-off and all faults, accelerations .12 to .17 of the input's, wrists at
//! .96 to .99 of their speed, and feet move by .16 to .48 cm, but for the 5 stances (2.3 cm).

/// Frames a second, at least.
pub(super) const LEAST_RATE: f64 = 12.0;
/// Bones that have to be known, and frames of them, at least.
pub(super) const FEWEST_BONES: usize = 6;
pub(super) const FEWEST_FRAMES: usize = 40;
/// The share of what trembles in the ends of bones that trembles in their lengths, at least, where
/// it is noise. White noise of .1 cm on motion of 30 frames a second shows .58 to .96, made noise
/// of video 1.1 to 1.4, motion alone less than .001.
pub(super) const NOISE_SHARE: f64 = 0.5;
/// The middle half of the lengths of a bone differs by no more than this share of it, or by so many
/// times what its noise tells, whose lag is taken for so much at most: seen in a plane alone, bones
/// change their lengths as they turn.
pub(super) const MOST_VARYING: f64 = 0.2;
pub(super) const MOST_OF_NOISE: f64 = 1.5;
pub(super) const MOST_LAG: f64 = 0.9;
/// Noise of which so much is that of the frame before is slow.
pub(super) const SLOW: f64 = 0.6;
/// Points without a bone of their own are of a foot if this near to its ankle or toe, cm.
pub(super) const OF_FOOT: f64 = 25.0;

/// A point jumps that stands off in one frame by more than so many cm, and so many times as far as
/// is usual so many seconds before and after. In 31 made takes that rule by itself finds all of 441
/// jumps of 15 to 50 cm but one, and two points that do not jump.
pub(super) const JUMP: f64 = 6.0;
pub(super) const JUMP_TIMES: f64 = 6.0;
pub(super) const JUMP_NEARBY: f64 = 0.5;

/// The edges of the bands, Hz, and where the last stands at most, as a share of the frame rate.
pub(super) const EDGES: [f64; 13] = [
    0.2, 0.4, 0.8, 1.2, 1.8, 2.6, 3.8, 4.8, 6.4, 8.5, 11.3, 15.0, 20.0,
];
pub(super) const LAST_EDGE: f64 = 0.22;
/// Noise of a band is this much denser than that of the highest, and counts so many times.
pub(super) const DENSER: f64 = 1.5;
pub(super) const NOISE_WEIGHT: f64 = 2.0;
/// Power is a mean over frames weighed by a Gaussian of so many periods of the band's width, and
/// so many seconds at most.
pub(super) const PERIODS: f64 = 1.5;
pub(super) const MOST_SECONDS: f64 = 0.2;

/// What draws bones to their lengths changes more slowly than this, Hz. Without that the error of
/// accelerations grows by a fifth to a quarter.
pub(super) const LENGTHS_CUTOFF: f64 = 3.2;
/// Rounds over the bones of a frame.
pub(super) const ROUNDS: usize = 15;

/// A foot stands where it stays within so many standard deviations of the noise that is left of its
/// middle, its copy below so many Hz slower than so many cm/s, for so many seconds.
pub(super) const STANCE_RADIUS: f64 = 4.2;
pub(super) const STANCE_CUTOFF: f64 = 2.4;
pub(super) const STANCE_SPEED: f64 = 25.0;
pub(super) const STANCE_SECONDS: f64 = 0.2;
/// How much of its way to the middle it is moved: one that did not move at all would look as if its
/// last value were held.
pub(super) const HELD: f64 = 0.95;
/// Seconds over which a foot comes to where it stands.
pub(super) const FADE: f64 = 0.15;

/// What a fill is off by, as a share of what it would be by the points around it, whose noise is
/// taken out later: in 31 made takes gaps of .3 s are off by 1.6 cm (root mean square; the median
/// take), where 3.6 are stated.
pub(super) const OF_FILL: f64 = 0.5;
