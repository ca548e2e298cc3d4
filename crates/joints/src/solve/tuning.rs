//! The constants of joints from markers. Chosen by the prototype of the method on takes of CMU,
//! HDM05, Plug-in Gait and the synthetic people of AddBiomechanics' test; optima are flat.

/// Standard deviation of a marker on its bone, cm.
pub(super) const SD: f64 = 1.0;
/// Frames that bones and markers are fitted on: 12 to 24 give the same joints in eight takes, to
/// .02 cm in the mean.
pub(super) const FRAMES: usize = 18;
/// How many of these are of a static take, if there is one.
pub(super) const STATIC_FRAMES: usize = 6;
/// As many frames count against what is known of people: skin slides, so that frames are not
/// independent. At 60 and more the take's own motion is believed too much.
pub(super) const INDEPENDENT: f64 = 6.0;
/// Standard deviation of a marker's position, at least, cm: skin, and who put it on.
pub(super) const LEAST_SD: f64 = 1.2;
/// Steps of the fit of bones and markers, at most, and the share of the cost that ends them.
pub(super) const STEPS: usize = 12;
pub(super) const TOLERANCE: f64 = 3e-3;
/// The cost of a marker, at most, of a start that fits.
pub(super) const FITS: f64 = 10.0;
/// Damping of the first step, and its factors.
pub(super) const DAMPING: f64 = 1e-3;
pub(super) const RELAX: f64 = 0.2;
pub(super) const RAISE: f64 = 10.0;
pub(super) const MOST_DAMPING: f64 = 1e6;
/// Standard deviation of bones that are given, cm.
pub(super) const GIVEN_BONE: f64 = 1e-4;
/// How far the pelvis follows the width between the front hips.
pub(super) const PELVIS: f64 = 0.5;
/// How narrow and how wide people are there, in widths of the mean.
pub(super) const WIDTHS: [f64; 2] = [0.6, 1.5];
/// Markers that tell a body, at least.
pub(super) const FEWEST_MARKERS: usize = 8;
/// Share of a set's markers that a body has, where other tracks have no label, at least.
pub(super) const SHARE_NAMED: f64 = 0.67;
/// Share of the deviations of bones in joints that are CMU's.
pub(super) const CMU_BONES: f64 = 0.5;
/// Anatomical joints: by how much poses are freer, collar bones move besides, degrees, and left and
/// right may differ, cm.
pub(super) const FREER: f64 = 3.0;
pub(super) const COLLAR: f64 = 8.0;
pub(super) const UNEVEN: f64 = 0.4;
/// By how much more collar bones differ there than CMU's, whose shoulders are set by rule.
/// Measured on three takes: shoulders off by 1.8 cm without, 1.2 with 2, 1.1 with 3.
pub(super) const SHOULDERS: f64 = 2.0;
/// By how much more a shoulder may be off than the fit tells.
pub(super) const SHOULDER: f64 = 1.7;
/// Standard deviation of a joint that is known, cm, and of its position on its bone.
pub(super) const TRUE_SD: f64 = 0.15;
pub(super) const TRUE_PLACE: f64 = 0.05;
/// People as whom the built-in landmark counts, instead of a learned marker and its deviation.
pub(super) const BUILT_IN: f64 = 0.5;
pub(super) const LEAST_PEOPLE: f64 = 3.0;
/// A marker is named as one whose name may be wrong where its position on its bone is so many
/// deviations from where such markers are, or it is so far from it, cm. (Clean takes of the
/// prototype: at most 4.8 deviations; of 20 exchanged pairs all found.)
pub(super) const ODD_PLACE: f64 = 5.0;
pub(super) const FAR: f64 = 10.0;
/// Or where left and right of a bone, each at the other's position, have so much less of squared
/// deviations.
pub(super) const EXCHANGED: f64 = 16.0;

/// Names of points by the body.
pub(super) mod body_labels {
    /// Frames that bones and markers are fitted on.
    pub(crate) const FRAMES: usize = 12;
    /// Turns to start from; who is less high than this share of their length lies.
    pub(crate) const YAWS: usize = 8;
    pub(crate) const LYING: f64 = 0.5;
    /// Rounds, and the gates of the first and the last, cm; a gate is so many deviations.
    pub(crate) const GATES: usize = 14;
    pub(crate) const WIDE: f64 = 60.0;
    pub(crate) const NARROW: f64 = 8.0;
    pub(crate) const SIGMAS: f64 = 6.0;
    /// By how many variances of its position on the body a marker reaches farther.
    pub(crate) const WIDER: f64 = 2.0;
    /// Steps of the pose in a round.
    pub(crate) const STEPS: usize = 3;
    /// A step that lowers the cost by a smaller share is the last.
    pub(crate) const LEAST_GAIN: f64 = 1e-3;
    /// Rounds after which half of the turns are left.
    pub(crate) const HALVED: [usize; 3] = [0, 2, 5];
}

/// Markers that no set knows.
pub(super) mod learning {
    /// Frames that are looked at, at most, and in which a marker is seen, at least.
    pub(crate) const MOST_FRAMES: usize = 200;
    pub(crate) const FEWEST_FRAMES: usize = 20;
    /// How far a marker of a bone is from its position on it, cm: the median, at most.
    pub(crate) const MOVES_AS: f64 = 3.0;
    /// How far it is from its bone, cm, at most.
    pub(crate) const FARTHEST: f64 = 20.0;
    /// Standard deviation of that position in another take, cm.
    pub(crate) const OTHER_SD: f64 = 2.0;
}

/// What labeled takes teach.
pub(super) mod naming_model {
    /// Labels of a take, at least.
    pub(crate) const FEWEST_LABELS: usize = 4;
    /// Half of the labels of a static take move less, cm: who stands sways.
    pub(crate) const STILL: f64 = 3.0;
}
