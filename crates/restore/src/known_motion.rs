//! The motion that may fill gaps of a whole body, and what became of these.

use crate::inbetween::{MotionLibrary, MotionSource, Verdict};
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
    /// A gap of which it was found what becomes.
    #[doc(hidden)]
    pub fn of(frames: Range<usize>, verdict: &Verdict) -> BodyGap {
        let fill = match verdict {
            Verdict::Filled(fill) => Some(fill),
            _ => None,
        };
        BodyGap {
            frames,
            source: fill.map(|fill| fill.source.clone()),
            sd: fill.map_or(f64::NAN, |fill| fill.variance.mean().unwrap_or(0.0).sqrt()),
            is_unlike: matches!(verdict, Verdict::Unlike(_)),
        }
    }

    /// A line on what fills it; it lasts from and to these seconds.
    #[doc(hidden)]
    pub fn note(&self, [from, to]: [f64; 2]) -> String {
        let span = format!("{from:.2} to {to:.2} s: the whole body is missing");
        let Some(source) = &self.source else {
            let why = if self.is_unlike {
                "no similar motion was found"
            } else {
                "too little motion is known beside it"
            };
            return format!("{span}; {why}");
        };
        let near = source.nearest.iter().map(|(take, seconds)| {
            let take = take.as_deref().unwrap_or("the take itself");
            format!("{take} at {seconds:.1} s")
        });
        format!(
            "{span}; filled from similar motion ({}), within about {:.1} cm, which is {:.2} of the \
             error of a smooth path",
            near.collect::<Vec<_>>().join(", "),
            self.sd * 3.0_f64.sqrt(),
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
    /// Standard deviation of a coordinate, cm, where motion fills it: the root mean square.
    pub sd: f64,
    /// Whether nothing alike is known; else too little is, beside it or in all.
    pub is_unlike: bool,
}
