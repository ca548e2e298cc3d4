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

impl Status {
    /// Every status, in the order of their numbers in a page.
    pub const ALL: [Status; 5] = [
        Status::Observed,
        Status::Changed,
        Status::Inferred,
        Status::Rejected,
        Status::Unknown,
    ];

    /// The word that tables use.
    pub fn name(self) -> &'static str {
        match self {
            Status::Observed => "observed",
            Status::Changed => "changed",
            Status::Inferred => "inferred",
            Status::Rejected => "rejected",
            Status::Unknown => "unknown",
        }
    }

    /// The status that a table's word means; `None` for any other word.
    pub fn from_name(name: &str) -> Option<Status> {
        Status::ALL.into_iter().find(|status| status.name() == name)
    }
}

/// How a point was filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FillMethod {
    /// By the other points, as the take and the model's training poses relate them.
    Regression,
    /// By its own path.
    Interpolation,
    /// By the model, frame by frame.
    Model,
}

impl FillMethod {
    /// Every method, in the order of their numbers in a page.
    pub const ALL: [FillMethod; 3] = [
        FillMethod::Regression,
        FillMethod::Interpolation,
        FillMethod::Model,
    ];

    /// The method that a table's word means; `None` for any other word.
    pub fn from_name(name: &str) -> Option<FillMethod> {
        FillMethod::ALL.into_iter().find(|m| m.name() == name)
    }

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            FillMethod::Regression => "regression",
            FillMethod::Interpolation => "pchip",
            FillMethod::Model => "model",
        }
    }
}
