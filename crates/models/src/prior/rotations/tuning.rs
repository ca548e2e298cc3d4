//! The constants of the prior over rotations. Measured on six CMU takes at 24 frames a second,
//! skeletons measured from the points: errors of bones, once a constant rotation of each is taken
//! out, are 3.5 degrees with a floor of 1 degree, 3.6 with 2, 4.2 with 4.

/// Rounds of the mean rotation: each squares what is left.
pub(super) const MEAN_ROUNDS: usize = 8;
/// Standard deviation that every rotation has beside the learned one, degrees.
pub(super) const FLOOR: f64 = 2.0;
/// Standard deviation of a joint that CMU's bones do not tell of, in a body that they do, degrees.
pub(super) const UNKNOWN: f64 = 10.0;
/// Standard deviation of each joint of a body that they do not tell of, degrees. Measured: errors
/// of 8.6 degrees, where the prior of CMU's bones has 4.1 (nine takes).
pub(super) const NO_BODY: f64 = 30.0;
/// Standard deviation of a hand's bend, degrees: CMU's wrist only turns about the forearm. Measured
/// on three rigs of other makers: the fit .51 to .57 cm for .63 to .85, errors the same.
pub(super) const HAND_BEND: f64 = 20.0;
/// Standard deviation of a collar bone of a rig that is not CMU's, degrees: CMU's never move.
/// Measured on the same rigs: the fit .20 to .23 cm.
pub(super) const COLLAR: f64 = 8.0;
/// Bones of the trunk that lean by less in a rest pose, degrees, count as upright: its joints are
/// elsewhere than CMU's. Measured on a rig whose neck leans by 22: head and neck 95 and 64 degrees
/// off without it.
pub(super) const LEAN: f64 = 45.0;
