//! The constants of the search for placements, by the file that they are used in (`solver`:
//! mod.rs). No measurement of them is recorded.

/// Starts, and the limits of each search.
pub(crate) mod solver {
    /// Starting placements, at most, the best fits first.
    pub(crate) const HEADINGS: usize = 4;
    /// Iterations from each, at most.
    pub(crate) const ITERATIONS: usize = 30;
    /// An iteration that lowers the objective by a smaller share is the last.
    pub(crate) const TOLERANCE: f64 = 1e-5;
    /// Starting rotations that differ by less are one, radians.
    pub(crate) const SAME_HEADING: f64 = 0.35;
}

/// Gauss-Newton steps of a rotation with a prior.
pub(crate) mod alternating {
    /// Steps, at most.
    pub(crate) const STEPS: usize = 10;
    /// A step that has to be halved to less than this share of itself does not help.
    pub(crate) const LEAST_SHARE: f64 = 1e-3;
    /// Steps that lower the cost by a smaller share are the last.
    pub(crate) const SETTLED: f64 = 1e-12;
}

/// Maximum evidence.
pub(crate) mod evidence {
    /// A step expected to gain less, nats, is the last: it moves the points by a seventieth of the
    /// placement's uncertainty.
    pub(crate) const SETTLED: f64 = 1e-4;
    /// A search that comes this close to a known maximum, radians and cm, would end there.
    pub(crate) const SAME_TOP: (f64, f64) = (0.1, 3.0);
    /// Evidence has single precision: smaller gains, nats, are accepted by the gradient alone.
    pub(crate) const ROUGH: f64 = 1e-3;
    /// Largest rotation (radians) and shift (cm) of a step: the gradient is local.
    pub(crate) const FARTHEST: (f64, f64) = (0.35, 20.0);
    /// The first damping, and the least after a rejected step; up to it a step counts as Newton's
    /// own.
    pub(crate) const UNDAMPED: f64 = 1e-3;
    /// Damping at which the search ends.
    pub(crate) const MOST_DAMPED: f64 = 1e6;
}

/// Frames of which only two coordinates are seen.
pub(crate) mod orthographic {
    /// Points of which something is seen, at least.
    pub(crate) const FEWEST_POINTS: usize = 4;
    /// Iterations of code and placement from each start, at most.
    pub(crate) const ITERATIONS: usize = 12;
    /// Iterations that lower the objective by a smaller share are the last.
    pub(crate) const SETTLED: f64 = 1e-5;
    /// Gauss-Newton steps of one placement, at most.
    pub(crate) const STEPS: usize = 15;
    /// Steps that lower the cost of a placement by a smaller share are the last.
    pub(crate) const STEP_SETTLED: f64 = 1e-9;
    /// The damping of the first step; a tenth of it after a step that helps, else ten times.
    pub(crate) const DAMPING: f64 = 1e-3;
    /// Damping at which a placement ends.
    pub(crate) const MOST_DAMPED: f64 = 1e6;
}
