//! One frame to be scored.

/// One frame to be scored: 3 J numbers each in centimetres, NaN is missing, points in equal order.
#[derive(Debug, Clone, Copy)]
pub struct ScoredFrame<'a> {
    /// The true pose.
    pub truth: &'a [f64],
    /// The pose to be scored.
    pub result: &'a [f64],
    /// The pose that the result was made from.
    pub damaged: Option<&'a [f64]>,
    /// Whether this frame does not follow the previous one: see [`crate::pose::Poses::runs`].
    pub starts_run: bool,
    /// Frames a second of the take, if known.
    pub rate: Option<f64>,
}
