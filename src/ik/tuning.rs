//! The constants of inverse kinematics, by the file that they are used in (`bones`: several). Where
//! no measurement is named, none is recorded.

/// Bones.
pub(crate) mod bones {
    /// Shorter than this, cm, a bone has no direction.
    pub(crate) const NO_LENGTH: f64 = 1e-9;
}

/// The solver of one frame (Levenberg-Marquardt).
pub(crate) mod solver {
    /// Steps, at most. The paper: "usually converge within 20 iterates".
    pub(crate) const STEPS: usize = 40;
    /// Ends when a step lowers E by less, cm².
    pub(crate) const TOLERANCE: f64 = 1e-9;
    /// Ends when a step lowers E by less than this share of it: noise leaves an E that no step
    /// removes.
    pub(crate) const RELATIVE_TOLERANCE: f64 = 1e-4;
    /// The weight of a length against that of an angle in what regularizes them.
    pub(crate) const LENGTH_WEIGHT: f64 = 0.01;
    /// The damping of the first step.
    pub(crate) const DAMPING: f64 = 1e-6;
    /// The damping of any step, at least.
    pub(crate) const LEAST_DAMPING: f64 = 1e-12;
    /// Damping at which the solution is a minimum, to rounding.
    pub(crate) const MOST_DAMPING: f64 = 1e8;
    /// Factor of the damping after a step that helped at once.
    pub(crate) const RELAX: f64 = 0.1;
    /// Factor of the damping after a step that helped when it was tried again, shorter.
    pub(crate) const RELAX_RETRIED: f64 = 0.5;
    /// Factor of the damping after a step that did not help.
    pub(crate) const RAISE: f64 = 10.0;
    /// The damping after a step that did not help, at least.
    pub(crate) const LEAST_RAISED: f64 = 1e-3;
    /// Damps what no target moves, cm² a squared radian.
    pub(crate) const FLOOR: f64 = 1e-3;
}

/// The first posture, bone by bone.
pub(crate) mod initial_pose {
    /// What holds a bone's twist to the frame before, against the next joints, as a share of its
    /// squared length. A neck bent by ten degrees has .03, an elbow at a right angle .3.
    pub(crate) const TWIST_HELD: f64 = 0.1;
    /// What holds a bone's twist to that of its parent, as such a share. It is for straight limbs,
    /// and takes a hundred frames.
    pub(crate) const TWIST_REST: f64 = 0.001;
}

/// Frame after frame.
pub(crate) mod sequence {
    /// Weight that holds the values that the joints leave open to the frame before, cm² a squared
    /// radian.
    pub(crate) const PREVIOUS_WEIGHT: f64 = 1e-4;
    /// Weight that draws them to the rest posture, cm² a squared radian: so little that it takes a
    /// hundred frames.
    pub(crate) const REST_WEIGHT: f64 = 1e-6;
    /// The same weight in the first frame, which has none before it.
    pub(crate) const FIRST_REST_WEIGHT: f64 = 1e-4;
    /// A noisy take's share of its mean squared misfit: one centimeter of noise is about 0.4
    /// radians of twist.
    pub(crate) const NOISE_WEIGHT: f64 = 5.0;
    /// How often the first frame follows itself.
    pub(crate) const FIRST_FRAME_ROUNDS: usize = 100;
    /// The first frame is searched from this many times as many starts as another.
    pub(crate) const FIRST_FRAME_STARTS: usize = 4;
    /// A root-mean-square misfit, cm a joint, below which nothing is searched for.
    pub(crate) const FITS: f64 = 1e-4;
    /// A search that leaves no less than this share of the misfit did not help.
    pub(crate) const HELPED: f64 = 0.25;
    /// Frames among which the first one is searched for, unless none of them shows anything.
    pub(crate) const FIRST_AMONG: usize = 1000;
    /// Rounds after which a pose near a pole of its angles stays where it is.
    pub(crate) const POLE_ROUNDS: usize = 3;
    /// A round that leaves no less than this share of the misfit did not help.
    pub(crate) const POLE_HELPED: f64 = 0.5;
    /// Frames to the next search after some that did not help, at least and at most; they double.
    pub(crate) const PAUSE: (usize, usize) = (2, 64);
    /// The share of a frame in the typical misfit: about the last twenty frames.
    pub(crate) const TYPICAL_SHARE: f64 = 0.05;
}

/// How good a fit is.
pub(crate) mod fit_quality {
    /// Mean distance over which a fit is poor: share of the leg, and cm.
    pub(crate) const POOR: (f64, f64) = (0.05, 2.0);
    /// Mean distance over which a fit is none: share of the leg, and cm.
    pub(crate) const FAILED: (f64, f64) = (0.25, 10.0);
    /// The leg's share of a body's largest extent, where the names tell no leg.
    pub(crate) const LEG: f64 = 0.5;
    /// A smaller share of the joints of a whole body's skeleton is half a body.
    pub(crate) const FEWEST_DRIVEN: f64 = 0.5;
    /// Joints of a whole body's skeleton, at least: those of fewer are parts anyway.
    pub(crate) const WHOLE_BODY: usize = 12;
}

/// Missing channels by positions.
pub(crate) mod missing_channels {
    /// Holds what the joints leave open to the path, cm² a squared radian.
    pub(crate) const PATH_WEIGHT: f64 = 1e-2;
    /// The weight of a joint that the table does not have, of 1.
    pub(crate) const UNKNOWN_WEIGHT: f64 = 1e-3;
    /// Frames of one parallel task.
    pub(crate) const CHUNK: usize = 8;
}
