//! What became of a point in a restoration.

/// The result of a restoration for a point in a frame: the column `NAME.status` of a table.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Status {
    /// Measured, and left as it was.
    #[default]
    Observed,
    /// Measured, and moved.
    Changed,
    /// Not measured: the model's estimate.
    Inferred,
    /// Measured, left as it was, and distrusted.
    Rejected,
    /// Nothing could be said.
    Unknown,
}

names!(Status {
    Observed = "observed",
    Changed = "changed",
    Inferred = "inferred",
    Rejected = "rejected",
    Unknown = "unknown",
});

/// How a point was filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FillMethod {
    /// By the other points, as the take and the model's training poses relate them.
    Regression,
    /// By its own path.
    Interpolation,
    /// By the model, frame by frame.
    Model,
    /// Held where a foot stands.
    Contact,
    /// By motion that is known, where a whole body is missing.
    Motion,
}

names!(FillMethod {
    Regression = "regression",
    Interpolation = "pchip",
    Model = "model",
    Contact = "contact",
    Motion = "motion",
});
