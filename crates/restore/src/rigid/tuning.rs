//! The constants of rigid distances, by what they are about. Where no measurement is named, none
//! is recorded.

/// Frames and bodies.
pub(crate) mod model {
    /// Frames of one parallel task.
    pub(crate) const CHUNK: usize = 16;
    /// Standard deviation of a person's lengths relative to the model's. Chosen among 0, .02, .04,
    /// .05 and .06 on single frames of subjects 02, 07, 08, 35 and 49, one take each, with the
    /// built-in model: at .05 clean frames change by an MSE of 5e-7 to .005 asf² (.007 to .09 at
    /// 0), and sparse noise leaves .016 to .033 (.023 to .11).
    pub(crate) const ANYONES_SHARE: f64 = 0.05;
    /// The share of the noise variance that a posterior leaves open for a pose like the training
    /// poses: up to it all of the posterior's correlations are used. Measured: with no correlations
    /// at all, errors on frames of training takes are 10% larger.
    pub(crate) const KNOWN: f64 = 0.09;
    /// The same share for a pose unlike the training poses: from it on no correlations are used.
    /// Measured: with all correlations always, errors on unseen takes are 7% larger.
    pub(crate) const UNKNOWN: f64 = 0.15;
    /// How much of a posterior's correlations is used where the noise is not dense, from 0 to 1.
    pub(crate) const CORRELATED: f64 = 0.5;
}

/// Outliers of a frame, here and in [`crate::outliers`].
pub(crate) mod outliers {
    use crate::pose::ASF_UNIT_CM;

    /// Prior probability of a point to be an outlier.
    pub(crate) const OUTLIER_SHARE: f64 = 0.2;
    /// Least variance of an outlier's coordinate, cm²: (1 asf)².
    pub(crate) const MIN_OUTLIER_VARIANCE: f64 = ASF_UNIT_CM * ASF_UNIT_CM;
}

/// Unknown bodies.
pub(crate) mod body_lengths {
    /// Share of unknown bodies, and the standard deviation of their lengths relative to the mean of
    /// the known ones.
    pub(crate) const STRANGER: (f64, f64) = (0.02, 0.06);
}

/// The noise of a frame.
pub(crate) mod noise_floor {
    use crate::rigid::tuning::outliers::MIN_OUTLIER_VARIANCE;

    /// Noise floors tried, cm.
    pub(crate) const BASES: [f64; 12] = [
        0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.3, 2.2, 3.6, 6.0,
    ];
    /// Weight and variance (cm²) that an outlier at an end adds to a distance. A marker mistaken
    /// for another is off by much more than one shifted by a few pixels.
    pub(crate) const SLABS: [(f64, f64); 4] = [
        (0.5, MIN_OUTLIER_VARIANCE),
        (0.25, 4.0 * MIN_OUTLIER_VARIANCE),
        (0.15, 16.0 * MIN_OUTLIER_VARIANCE),
        (0.1, 64.0 * MIN_OUTLIER_VARIANCE),
    ];
    /// Least number of distances that determine a noise floor.
    pub(crate) const FEWEST: usize = 6;
    /// A body less likely than the best so far by this many nats is not tried with other noise
    /// floors.
    pub(crate) const HOPELESS: f64 = 20.0;
}

/// Poses held to the distances.
pub(crate) mod projection {
    /// Values of i tried, asf².
    pub(crate) const UNSURE: [f64; 4] = [0.003, 0.02, 0.1, 0.6];
    /// Most steps. From the third on a step is halved where steps do not shrink, except for the
    /// last.
    pub(crate) const STEPS: usize = 10;
    /// Steps that compute the Jacobian anew; later steps are too small to need it.
    pub(crate) const TURNS: usize = 3;
    /// Largest move of a coordinate in a step, cm: on a straight limb the gradient of a distance is
    /// misleading.
    pub(crate) const FARTHEST: f64 = 3.0;
    /// A step that moves no coordinate by more, cm, is the last.
    pub(crate) const SETTLED: f64 = 2e-3;
}
