//! The motion that may fill gaps of a whole body, and what became of these.

use crate::inbetween::{MotionLibrary, MotionSource};
use std::ops::Range;

/// The motion that may fill gaps of a whole body.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) enum KnownMotion<'a> {
    /// None.
    #[default]
    Nothing,
    /// The take's own.
    Own,
    /// The take's own, and a library.
    Library(&'a MotionLibrary),
}

/// A gap of a whole body, and where the motion in it is from; `None`: it was filled without, or
/// not at all.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyGap {
    /// Its frames.
    pub frames: Range<usize>,
    /// What fills it.
    pub source: Option<MotionSource>,
}
