//! The constants of inverse kinematics, by the file that they are used in (`bones`: several). Where
//! no measurement is named, none is recorded.

/// Bones.
pub(crate) mod bones {
    /// Shorter than this, cm, a bone has no direction.
    pub(crate) const NO_LENGTH: f64 = 1e-9;
}

/// The solver of one frame (Levenberg-Marquardt).
pub(crate) mod solver {
    /// Steps, at most. Lai et al.: "usually converge within 20 iterates".
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

/// The most probable rotations of a frame (Levenberg-Marquardt). The damping is the prototype's.
pub(crate) mod frame_solver {
    /// The damping of the first step from afar; near a minimum it only holds back what is little
    /// known.
    pub(crate) const FAR_DAMPING: f64 = 1e-3;
    pub(crate) const NEAR_DAMPING: f64 = 1e-5;
    /// Factor of the damping after a step that helped.
    pub(crate) const RELAX: f64 = 0.2;
    /// Factor of the damping after a step that did not.
    pub(crate) const RAISE: f64 = 20.0;
    /// Damping at which the solution is a minimum, to rounding.
    pub(crate) const MOST_DAMPING: f64 = 1e9;
    /// Steps that help, at most.
    pub(crate) const STEPS: usize = 100;
    /// Last steps at most, how much more sure points weigh there, and the E that may be left: some
    /// ten thousandths of a centimeter.
    pub(crate) const LAST_STEPS: usize = 6;
    pub(crate) const SURE: f64 = 1e4;
    pub(crate) const LAST_TOLERANCE: (f64, f64) = (10.0, 0.0);
    /// Ends when a step lowers E, which has no unit, by less than the first and this share of it.
    /// (The prototype's .001 gives the same errors in six takes.)
    pub(crate) const TOLERANCE: (f64, f64) = (0.05, 1e-4);
    /// Damps what neither points nor prior move, 1 / radian².
    pub(crate) const LEAST_PRECISION: f64 = 1e-3;
    /// Standard deviation of a bone that slides below the root, cm.
    pub(crate) const SLIDE_SD: f64 = 2.0;
    /// Standard deviation of a point at the start that is rigid with the root, cm.
    pub(crate) const START_SD: f64 = 0.3;
    /// Deviations from which on a point counts as an outlier, where some are.
    pub(crate) const OUTLIER: f64 = 4.0;
    /// Rounds in which the angles nearest to a mean rotation are found.
    pub(crate) const ANGLE_ROUNDS: usize = 20;
}

/// Frame after frame.
pub(crate) mod sequence {
    /// Frames of one parallel task, and of a block after which progress is told.
    pub(crate) const CHUNK: usize = 8;
    pub(crate) const BLOCK: usize = 512;
    /// Key frames a second, from which the others start.
    pub(crate) const KEY_RATE: f64 = 24.0;
    /// Weight that holds the values to the most probable ones where they are carried into the
    /// skeleton's limits, cm² a squared radian.
    pub(crate) const LIMITS_WEIGHT: f64 = 1e-4;
    /// A frame whose neighbor has every bone within this angle, radians, would end where it is from
    /// its neighbor's rotations too.
    pub(crate) const NEAR: f64 = 0.26;
    /// A solution from another start counts if its E is lower by this, more than two solutions of
    /// one minimum differ by.
    pub(crate) const LOWER: f64 = 0.1;
    /// Standard deviation of a point that says none, cm: with .1 the AMC of clean points is .02 cm
    /// off them.
    pub(crate) const LEAST_SD: f64 = 0.03;
    /// And at most: what fills a gap is as probable as can be already, and its errors last. Without
    /// a limit limbs that were missing in takes of people left out are 1.7 and 2.18 cm off where
    /// points that all count alike give 1.55 and 1.72; with it 1.56 and 1.70.
    pub(crate) const MOST_SD: f64 = 1.0;
    /// A point with a deviation of this times the most is hardly known, and counts less and less.
    pub(crate) const FAR_SD: f64 = 20.0;
}

/// Skeletons from named points. Lengths are shares of the leg (thigh and shin), the medians of
/// CMU's subjects; they stand in for what no frame shows.
pub(crate) mod named_skeleton {
    /// From the middle of the hips to a hip.
    pub(crate) const HIP: f64 = 0.1;
    /// One of three bones of the spine.
    pub(crate) const SPINE: f64 = 0.14;
    /// The neck.
    pub(crate) const NECK: f64 = 0.117;
    /// The head.
    pub(crate) const HEAD: f64 = 0.12;
    /// A collar bone.
    pub(crate) const COLLAR_LENGTH: f64 = 0.234;
    /// The arm's bones, from the shoulder, and the fingers.
    pub(crate) const UPPER_ARM: f64 = 0.36;
    pub(crate) const FOREARM: f64 = 0.223;
    pub(crate) const HAND: f64 = 0.088;
    pub(crate) const FINGERS: f64 = 0.08;
    /// The foot to the ball.
    pub(crate) const FOOT_LENGTH: f64 = 0.145;
    /// The toes, as a share of the foot.
    pub(crate) const TOES: f64 = 1.0 / 3.0;
    /// No End Site is nearer than this, cm.
    pub(crate) const LEAST_END: f64 = 1.0;
    /// Where a foot points in the rest pose.
    pub(crate) const FOOT: [f64; 3] = [0.0, -0.35, 0.94];
    /// Where a left collar bone points: from a point of its own, from the chest as CMU's does, and
    /// from the middle of the shoulders.
    pub(crate) const COLLAR: [f64; 3] = [1.0, 0.1, 0.0];
    pub(crate) const CMU_COLLAR: [f64; 3] = [0.95, 0.32, -0.04];
    pub(crate) const LEVEL: [f64; 3] = [1.0, 0.0, 0.0];
    /// A root nearer to the middle of the hips tells no tilt of the pelvis, share of the leg.
    pub(crate) const LEAST_TILT: f64 = 0.02;
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
