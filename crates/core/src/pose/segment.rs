//! Segments of a take that somebody names: a point, and times.

use super::Poses;
use crate::Result;
use serde::Serialize;

/// A segment of frames of a point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Segment {
    /// The point.
    pub point: String,
    /// The first and the last time, seconds as the file has them.
    pub seconds: [f64; 2],
}

impl Segment {
    /// `NAME:FROM-TO`, such as `Ann:LFHD:1.2-1.9`: the last colon parts them.
    ///
    /// ```
    /// use posing_core::pose::Segment;
    ///
    /// let segment = Segment::parse("Ann:LFHD:1.2-1.9")?;
    /// assert_eq!(segment.point, "Ann:LFHD");
    /// assert_eq!(segment.seconds, [1.2, 1.9]);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: it is not of this form.
    pub fn parse(text: &str) -> Result<Segment> {
        let expected = "expected NAME:FROM-TO in seconds, such as LFHD:1.2-1.9";
        let (point, times) = text.rsplit_once(':').ok_or(expected)?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        // A hyphen may also be a sign: each is tried as the one between the times.
        let parted = times
            .match_indices('-')
            .find_map(|(at, _)| Some([number(&times[..at])?, number(&times[at + 1..])?]));
        match parted.filter(|[from, to]| from <= to && !point.is_empty()) {
            Some(seconds) => Ok(Segment {
                point: point.to_string(),
                seconds,
            }),
            None => Err(expected.into()),
        }
    }

    /// The frames of the segment. `rate` is that of a take without times.
    #[doc(hidden)]
    pub fn frames(&self, poses: &Poses, rate: Option<f64>) -> Vec<usize> {
        let [from, to] = self.seconds;
        // Times may be given with fewer digits than the file has.
        let near = 0.1 / rate.unwrap_or(1.0);
        let is_in =
            |t: &usize| (from - near..=to + near).contains(&Segment::time_of(poses, rate, *t));
        (0..poses.frames()).filter(is_in).collect()
    }

    /// The time of a frame, seconds as the file has them. `rate` is that of a take without times.
    #[doc(hidden)]
    pub fn time_of(poses: &Poses, rate: Option<f64>, frame: usize) -> f64 {
        let by_rate = frame as f64 / rate.unwrap_or(1.0);
        poses.time.as_ref().map_or(by_rate, |time| time[frame])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_colon_parts_name_and_times() {
        let of = |text: &str| Segment::parse(text).ok().map(|s| (s.point, s.seconds));
        assert_eq!(
            of("Ann:LFHD:1.2-1.9"),
            Some(("Ann:LFHD".into(), [1.2, 1.9]))
        );
        assert_eq!(of("a-b:1e-3-2"), Some(("a-b".into(), [0.001, 2.0])));
        assert_eq!(of("a:-1--0.5"), Some(("a".into(), [-1.0, -0.5])));
        for bad in ["a", "a:1", ":1-2", "a:2-1", "a:x-y", "a:nan-1", ""] {
            assert!(of(bad).is_none(), "{bad}");
        }
    }
}
