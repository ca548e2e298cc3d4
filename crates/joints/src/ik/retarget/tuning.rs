//! The constants of retargeting. Where no measurement is named, none is recorded.

/// Contacts of the source's feet, and how the rig's are held there. Measured by a prototype on five
/// CMU takes (walks, an acrobat, one on straight legs) and three rigs: feet slide no more than the
/// source's where the goal is in reach, and a knee's steps grow by 2.8 degrees at most.
pub(in crate::ik) mod feet {
    /// An ankle is in contact below this speed, cm/s, for a leg of [`LEG`].
    pub(in crate::ik) const SPEED: f64 = 40.0;
    /// And lower than this over the lowest of its take, cm, likewise.
    pub(in crate::ik) const HEIGHT: f64 = 6.0;
    /// And for as long as this, seconds.
    pub(in crate::ik) const LEAST: f64 = 0.1;
    /// Over this time, seconds, what holds a foot fades before and after a contact.
    pub(in crate::ik) const FADE: f64 = 0.12;
    /// A leg is stretched to this share of its length at most, if it is not already.
    pub(in crate::ik) const REACH: f64 = 0.9995;
    /// The weight of the side to which a knee bends in the mean against its bend in a frame, cm
    /// for a leg of [`LEG`]. Without it the knee of a straight leg pops by 14 to 19 degrees.
    pub(in crate::ik) const HINGE: f64 = 2.0;
    /// A foot that is moved by less than this share of the leg is hardly moved.
    pub(in crate::ik) const HARDLY: f64 = 1e-3;
    /// The leg of an adult, hip to ankle, cm.
    pub(in crate::ik) const LEG: f64 = 80.0;
    /// Legs of people, cm, longer than an adult's in inches: a source with another is in another
    /// unit, and its limits are shares of its leg.
    pub(in crate::ik) const LEGS: std::ops::RangeInclusive<f64> = 42.0..=130.0;
}

/// How feet stand.
pub(super) mod soles {
    /// A foot stands while ankle and ball are slower than this, cm/s, for a leg of
    /// [`LEG`](super::feet::LEG).
    pub(in super::super) const SPEED: f64 = 15.0;
    /// And the ankle is lower than this over the lowest of its take, cm, likewise.
    pub(in super::super) const HEIGHT: f64 = 5.0;
    /// And for as long as this, seconds.
    pub(in super::super) const LEAST: f64 = 0.08;
    /// The cosine of how far a sole that stands may tilt against that of the rest pose: farther,
    /// it stands on its toes.
    pub(in super::super) const NEAR: f64 = 0.9;
    /// A foot that points up or down more than by this sine of its angle has no sole.
    pub(in super::super) const STEEP: f64 = 0.25;
    /// The floor of a take is at 0 if its feet stand there to so many cm, for a leg of
    /// [`LEG`](super::feet::LEG): joints are above soles.
    pub(in super::super) const FLOOR: f64 = 8.0;
    /// How high an ankle is over its sole where nothing tells it, cm, likewise.
    pub(in super::super) const ANKLE: f64 = 8.0;
}

/// Rest poses.
pub(super) mod rest {
    /// In the rest pose of a standing body, the cosine of legs and trunk is below this.
    pub(in super::super) const OPPOSITE: f64 = -0.7;
    /// And that of the line of the hips and the trunk is smaller than this.
    pub(in super::super) const ACROSS: f64 = 0.5;
    /// The trunk of such a body is along an axis of the world if its cosine is over this.
    pub(in super::super) const UPRIGHT: f64 = 0.9;
    /// Frames that are looked at for a standing pose.
    pub(in super::super) const FRAMES: usize = 500;
    /// Offsets of one convention differ by less than this cosine.
    pub(in super::super) const SAME: f64 = 0.97;
    /// Shorter than this share of the leg, a segment has no direction.
    pub(in super::super) const NO_LENGTH: f64 = 1e-3;
}

/// Bodies found by the shape of the tree.
pub(super) mod shape {
    /// Limbs on both sides have lengths within this share of each other.
    pub(in super::super) const ALIKE: f64 = 0.1;
    /// The upper bone of a limb is this many times as long as the lower.
    pub(in super::super) const RATIO: std::ops::RangeInclusive<f64> = 0.55..=1.8;
    /// Branches of a joint that are compared with each of them.
    pub(in super::super) const MOST_BRANCHES: usize = 16;
    /// Two bones are about as long as the longest two from this share of their length on.
    pub(in super::super) const ABOUT_AS_LONG: f64 = 0.85;
    /// A leg is this many times as long as an arm.
    pub(in super::super) const LEG_TO_ARM: std::ops::RangeInclusive<f64> = 1.05..=2.2;
    /// The cosine over which toes point away from the line of the hips.
    pub(in super::super) const FORWARD: f64 = 0.5;
}

/// Frames of one parallel task, and of all tasks whose rotations are in memory at once.
pub(super) const CHUNK: usize = 64;
pub(super) const BLOCK: usize = 4096;
