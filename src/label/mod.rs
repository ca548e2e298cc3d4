//! Which track is which point: what the distances within a body say of the labels of a take.

pub(crate) mod distances;
pub(crate) mod exchanges;
pub(crate) mod out_and_back;
mod tuning;
pub(crate) mod unlabeled;
