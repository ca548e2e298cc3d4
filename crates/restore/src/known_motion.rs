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

impl BodyGap {
    /// A line on what fills it; it lasts from and to these seconds.
    #[doc(hidden)]
    pub fn note(&self, [from, to]: [f64; 2]) -> String {
        let span = format!("{from:.2} to {to:.2} s: the whole body is missing");
        let Some(source) = &self.source else {
            return format!("{span}; no motion that is known is alike");
        };
        let near = source.nearest.iter().map(|(take, seconds)| {
            let take = take.as_deref().unwrap_or("the take itself");
            format!("{take} at {seconds:.1} s")
        });
        format!(
            "{span}; filled from motion like that of {}: the error expected is {:.2} of that of a \
             cubic",
            near.collect::<Vec<_>>().join(", "),
            source.expected
        )
    }
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
