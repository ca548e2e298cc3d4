//! Left and right.

use serde::Serialize;

/// A side of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

impl Side {
    /// Both, the left one first.
    pub const BOTH: [Side; 2] = [Side::Left, Side::Right];

    /// `L` or `R`, with which names of markers and curves begin.
    pub fn letter(self) -> &'static str {
        ["L", "R"][self as usize]
    }

    /// The opposite side.
    #[must_use]
    pub fn other(self) -> Side {
        Side::BOTH[1 - self as usize]
    }

    /// 1 left, -1 right: what turns an axis to the left into one outwards.
    pub(crate) fn sign(self) -> f64 {
        [1.0, -1.0][self as usize]
    }
}
