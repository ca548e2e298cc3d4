//! The constants of the search for outliers, by the file that they are used in. Where no
//! measurement is named, none is recorded.

/// Which frames are searched, and when an outlier is one.
pub mod search {
    /// Least noise of a clean point, cm.
    pub const LEAST_NOISE: f64 = 0.01;
    /// Frames of one parallel task that measures noise floors.
    pub const FLOORS_PER_TASK: usize = 64;
    /// Frames on either side that count as evidence. In frames, not seconds: each is a measurement
    /// of its own.
    ///
    /// Measured: with the evidence of neighbors, takes under dense noise of 5.6 cm need a third of
    /// the time, as noise is no longer searched.
    pub const NEIGHBORS: usize = 10;
    /// Evidence of the frame alone that suffices, nats.
    pub const ALONE: f64 = 3.0;
    /// Evidence of the frame and its neighbors that suffices, nats.
    pub const TOGETHER: f64 = 8.0;
    /// Evidence of the neighbors on each side that suffices where the frame has none, nats.
    pub const EITHER_SIDE: f64 = 5.0;
    /// A point more likely an outlier than this probability is one.
    pub const LIKELY: f64 = 0.5;
    /// An outlier within this many standard deviations of where the rest of the take expects it is
    /// none.
    pub const EXPECTED: f64 = 3.0;
}

/// Spikes of single paths.
pub mod trajectory {
    /// Largest acceleration, cm/s²: that of a heel that strikes the ground.
    pub const MOST: f64 = 2e4;
    /// Largest acceleration for as long as spikes last, cm/s².
    pub const MOST_LONG: f64 = 5e3;
    /// Largest fourth derivative of a path, cm/s⁴.
    pub const MOST_BENT: f64 = 4e8;
    /// Least deviation of a spike, cm.
    pub const LEAST: f64 = 1.5;
    /// Standard deviations of noise that are allowed for.
    pub const SURE: f64 = 5.0;
    /// Neighbors on each side that a frame is compared with.
    pub const NEIGHBORS: usize = 3;
    /// How far away neighbors may be, s; at least [`NEIGHBORS`] frames.
    pub const REACH: f64 = 0.05;
    /// A point that agrees with fewer than one in this many pairs of neighbors is a spike.
    pub const AGREE: usize = 3;
    /// Frames within which only the largest deviation is a spike.
    pub const APART: usize = 3;
    /// Rounds of the first test. Spikes found in one are no neighbors in the next.
    pub const TIMES: usize = 3;
    /// Largest number of rounds of the second test.
    pub const ROUNDS: usize = 50;
    /// Rounds of both tests, each with the noise that is left without the spikes of the one before.
    pub const NOISE_ROUNDS: usize = 2;
}

/// Outliers by rigid distances alone.
pub mod rigid_likelihood {
    /// Probability that an outlier's distance deviates more than its variance says.
    pub const FAR: f64 = 0.3;
    /// Variance of a distance under a prior that knows no bones, cm²: the lengths count beyond
    /// that.
    pub const PRIOR_KNOWS: f64 = 1.0;
    /// Assignments in the beam.
    pub const WIDTH: usize = 64;
}

/// What is decided of a frame.
pub mod frame_state {
    /// A point is undecided if its probabilities to be clean and to be an outlier both exceed this.
    pub const SURE: f64 = 0.01;
    /// Most points hidden from the prior at a time.
    pub const MOST: usize = 12;
}

/// Points without their own observation.
pub mod leave_one_out {
    /// A posterior that keeps more than this share of the observation's variance has no information
    /// but that observation.
    pub const MOST_OWN: f64 = 0.98;
}

/// Assignments of undecided points.
pub mod assignment {
    use crate::restore::rigid::tuning::outliers::MIN_OUTLIER_VARIANCE;

    /// How wrong a prior may be: weight, factor of its variance, variance added (cm²).
    pub const SCALES: [(f64, f64, f64); 4] = [
        (0.4, 1.0, 0.01 * MIN_OUTLIER_VARIANCE),
        (0.3, 4.0, 0.05 * MIN_OUTLIER_VARIANCE),
        (0.2, 16.0, 0.2 * MIN_OUTLIER_VARIANCE),
        (0.1, 64.0, 0.5 * MIN_OUTLIER_VARIANCE),
    ];
    /// Assignments in the beam.
    pub const WIDTH: usize = 16;
    /// Most assignments that are kept.
    pub const MOST_KEPT: usize = 8;
    /// Assignments of a smaller weight relative to the largest are dropped.
    pub const LEAST: f64 = 0.05;
}

/// The average over the assignments.
pub mod frame_posterior {
    /// Factor of the log evidence of assignments: priors are too sure.
    pub const TEMPERATURE: f64 = 0.3;
    /// Frames of one parallel task.
    pub const CHUNK: usize = 16;
}
