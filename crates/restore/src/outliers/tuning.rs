//! The constants of the search for outliers, by the file that they are used in (`search`:
//! mod.rs). Where no measurement is named, none is recorded.

/// Which frames are searched, and when an outlier is one.
pub(crate) mod search {
    /// Least noise of a clean point, cm.
    pub(crate) const LEAST_NOISE: f64 = 0.01;
    /// Frames of one parallel task that measures noise floors.
    pub(crate) const FLOORS_PER_TASK: usize = 64;
    /// Frames on either side that count as evidence. In frames, not seconds: each is a measurement
    /// of its own.
    ///
    /// Measured: with the evidence of neighbors, takes under dense noise of 5.6 cm need a third of
    /// the time, as noise is no longer searched.
    pub(crate) const NEIGHBORS: usize = 10;
    /// Evidence of the frame alone that suffices, nats.
    pub(crate) const ALONE: f64 = 3.0;
    /// Evidence of the frame and its neighbors that suffices, nats.
    pub(crate) const TOGETHER: f64 = 8.0;
    /// Evidence that suffices where the frame has none, nats, on each side within so many frames.
    pub(crate) const EITHER_SIDE: f64 = 3.5;
    pub(crate) const BESIDE: usize = 2;
    /// Standard deviation of any rigid distance in a sound take, cm: a low-pass filter shortens the
    /// bones of what turns fast, and skin moves on them. A take with
    /// spikes in more than the share [`MANY`] of its frames is searched without it.
    ///
    /// Measured: bones of the joints of CMU takes low-passed at 15 Hz are off by .02 to .46 cm in
    /// one frame of a hundred; at 0, .1, .2, .3 cm the take with the most such frames (135_06)
    /// loses 77, 0, 0, 0 sound points, 01_12 24, 4, 1, 0. Under sparse noise of 5.6 cm the squared
    /// error left is .0047 cm² without it, .014 with it.
    pub(crate) const LENGTHS_VARY: f64 = 0.3;
    /// The share of frames with spikes from which a take is no sound one.
    pub(crate) const MANY: f64 = 0.1;
    /// A point less likely an outlier by distances than this, or as little likely none, is decided
    /// in a take. One without any distance has .2: its path has been looked at.
    pub(crate) const DECIDED: f64 = 0.25;
    /// A point more likely an outlier than this probability is one.
    pub(crate) const LIKELY: f64 = 0.5;
}

/// Spikes of single paths.
pub(crate) mod trajectory {
    pub(crate) use crate::tuning::cuts::{MOST, MOST_LONG};

    /// Largest fourth derivative of a path, cm/s⁴.
    pub(crate) const MOST_BENT: f64 = 4e8;
    /// Least deviation of a spike, cm.
    pub(crate) const LEAST: f64 = 1.5;
    /// Standard deviations of noise that are allowed for.
    pub(crate) const SURE: f64 = 5.0;
    /// Neighbors on each side that a frame is compared with.
    pub(crate) const NEIGHBORS: usize = 3;
    /// How far away neighbors may be, s; at least [`NEIGHBORS`] frames.
    pub(crate) const REACH: f64 = 0.05;
    /// A point that agrees with fewer than one in this many pairs of neighbors is a spike.
    pub(crate) const AGREE: usize = 3;
    /// Frames within which only the largest deviation is a spike.
    pub(crate) const APART: usize = 3;
    /// Rounds of the first test. Spikes found in one are no neighbors in the next.
    pub(crate) const TIMES: usize = 3;
    /// Largest number of rounds of the second test.
    pub(crate) const ROUNDS: usize = 50;
    /// Rounds of both tests, each with the noise that is left without the spikes of the one before.
    pub(crate) const NOISE_ROUNDS: usize = 2;
}

/// Outliers by rigid distances alone.
pub(crate) mod rigid_likelihood {
    /// Probability that an outlier's distance deviates more than its variance says.
    pub(crate) const FAR: f64 = 0.3;
    /// Variance of a distance under a prior that knows no bones, cm²: the lengths count beyond
    /// that.
    pub(crate) const PRIOR_KNOWS: f64 = 1.0;
    /// Assignments in the beam.
    pub(crate) const WIDTH: usize = 64;
}

/// What is decided of a frame.
pub(crate) mod frame_state {
    /// A point is undecided if its probabilities to be clean and to be an outlier both exceed this.
    pub(crate) const SURE: f64 = 0.01;
    /// Most points hidden from the prior at a time.
    pub(crate) const MOST: usize = 12;
}

/// Points without their own observation.
pub(crate) mod leave_one_out {
    /// A posterior that keeps more than this share of the observation's variance has no information
    /// but that observation.
    pub(crate) const MOST_OWN: f64 = 0.98;
}

/// Assignments of undecided points.
pub(crate) mod assignment {
    use crate::rigid::tuning::outliers::MIN_OUTLIER_VARIANCE;

    /// How wrong a prior may be: weight, factor of its variance, variance added (cm²).
    pub(crate) const SCALES: [(f64, f64, f64); 4] = [
        (0.4, 1.0, 0.01 * MIN_OUTLIER_VARIANCE),
        (0.3, 4.0, 0.05 * MIN_OUTLIER_VARIANCE),
        (0.2, 16.0, 0.2 * MIN_OUTLIER_VARIANCE),
        (0.1, 64.0, 0.5 * MIN_OUTLIER_VARIANCE),
    ];
    /// Assignments in the beam.
    pub(crate) const WIDTH: usize = 16;
    /// Most assignments that are kept.
    pub(crate) const MOST_KEPT: usize = 8;
    /// Assignments of a smaller weight relative to the largest are dropped.
    pub(crate) const LEAST: f64 = 0.05;
}

/// The average over the assignments.
pub(crate) mod frame_posterior {
    /// Factor of the log evidence of assignments: priors are too sure.
    pub(crate) const TEMPERATURE: f64 = 0.3;
    /// Frames of one parallel task.
    pub(crate) const CHUNK: usize = 16;
}
