//! The constants of labels, by the file that they are used in.

/// Left and right exchanged. Prototype: takes of 02, 13, 35 and 49 degraded to keypoints of 30
/// frames a second with correlated noise of 1 to 3 cm, seeds 2 and 3: 1.000 of 4,576 exchanged
/// positions found, none of 49,139 others. Each pair by itself, seeds 2 to 4, without the speed
/// nearby: 98% of 6,054, 70 of 67,025 others. In every sixth of CMU's takes here, with gaps, clean
/// or with white noise of 1 and 2 cm, at 120 and 30 frames a second: none found.
pub(crate) mod exchanges {
    /// How fast the points of a body are, at least, cm/s: 8 cm in a frame at 30 frames a second.
    /// They may be as fast as they are nearby, so many seconds, and frames, before and after.
    pub(crate) const FAST: f64 = 240.0;
    pub(crate) const NEARBY: f64 = 0.25;
    pub(crate) const FEWEST_NEARBY: usize = 3;
    /// Cost of a way that no body goes.
    pub(crate) const FARTHEST: f64 = 25.0;
    /// Cost of an exchange that begins or ends, for its first pair and each further one.
    pub(crate) const CHANGE: f64 = 5.0;
    pub(crate) const FURTHER_CHANGE: f64 = 1.0;
    /// Cost of a frame in which a pair is exchanged: names are right mostly.
    pub(crate) const EXCHANGED: f64 = 0.15;
    /// Pairs, frame by frame, both points of which are seen while they are exchanged, at least.
    pub(crate) const FEWEST_SEEN: usize = 2;
    /// Pairs of a limb, at most: the states of a frame double with each.
    pub(crate) const MOST_PAIRS: usize = 5;
}

/// How likely a distance is.
pub(crate) mod distances {
    /// Frames that a distance is measured in, at most about.
    pub(crate) const MOST_FRAMES: usize = 1500;
    /// Least spread of a distance, cm: skin and cloth move.
    pub(crate) const LEAST_SPREAD: f64 = 0.4;
    /// Share of lengths that are those to any point, within so many cm.
    pub(crate) const ANY: f64 = 0.03;
    pub(crate) const ANYWHERE: f64 = 60.0;
    /// By how much of its length a distance is looser.
    pub(crate) const LOOSER: f64 = 0.004;
}

/// Stretches of a track away from its point.
pub(crate) mod out_and_back {
    /// Least jump, cm.
    pub(crate) const LEAST: f64 = 4.0;
    /// Least jump, in differences that few of the steps nearby exceed.
    pub(crate) const UNUSUAL: f64 = 3.0;
    /// Frames on either side of a step that are nearby, and the share of their steps that are
    /// usual.
    pub(crate) const NEARBY: usize = 6;
    pub(crate) const USUAL: f64 = 0.8;
    /// One in so many of the steps nearby may be half as large as both jumps, these aside.
    pub(crate) const JUMPY: usize = 8;
    /// Longest stretch, seconds.
    pub(crate) const LONGEST: f64 = 0.6;
    /// Other points, the nearest, that may be steady beside a point, and the steadiest that count.
    pub(crate) const OTHERS: usize = 60;
    pub(crate) const STEADIEST: usize = 3;
    /// Distances that spread by no more are rigid, cm.
    pub(crate) const RIGID: f64 = 1.0;
    /// Frames in which a distance is known, at least.
    pub(crate) const FEWEST_FRAMES: usize = 20;
    /// Nats by which the way across is likelier, at least: where a fifth of all positions are off,
    /// distances seem loose, and what lies between two of these would else be away now and then.
    pub(crate) const EVIDENCE: f64 = 6.0;
    /// Frames of a stretch whose distances are looked at, at most.
    pub(crate) const MOST_FRAMES: usize = 48;
}
