//! Segments of a take that somebody found bad: they count as missing.

use crate::Result;
use crate::pose::Poses;
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
    /// # Errors
    /// [`crate::Error::Unfit`]: it is not of this form.
    pub fn parse(text: &str) -> Result<Segment> {
        let expected = "expected NAME:FROM-TO in seconds, such as LFHD:1.2-1.9";
        let (point, times) = text.rsplit_once(':').ok_or(expected)?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        // A hyphen may also be a sign: every place to part the times is tried.
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
    pub(crate) fn frames(&self, poses: &Poses, rate: Option<f64>) -> Vec<usize> {
        let [from, to] = self.seconds;
        // Times may be given with fewer digits than the file has.
        let near = 0.1 / rate.unwrap_or(1.0);
        let is_in = |t: &usize| (from - near..=to + near).contains(&time_of(poses, rate, *t));
        (0..poses.frames()).filter(is_in).collect()
    }

    /// Makes the positions of the segment missing. `rate` is that of a take without times. Returns
    /// the first frame, and how many positions were there.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: there is no such point or time, or there are several takes.
    pub(crate) fn empty(&self, poses: &mut Poses, rate: Option<f64>) -> Result<(usize, usize)> {
        let find = poses.points.iter().position(|p| *p == self.point);
        let p = find.ok_or_else(|| format!("has no point \"{}\" to be done again", self.point))?;
        if poses.takes().len() != 1 {
            return Err(
                "has not one take, and only of one can something be done again; part takes with \
                 trim"
                    .into(),
            );
        }
        let [from, to] = self.seconds;
        let frames = self.frames(poses, rate);
        let Some(&first) = frames.first() else {
            let last = poses.frames().saturating_sub(1);
            return Err(format!(
                "has no frame from {from} to {to} s to be done again: its times go from {} to {} s",
                time_of(poses, rate, 0),
                time_of(poses, rate, last)
            )
            .into());
        };
        let mut count = 0;
        for t in frames {
            let mut point = poses.xyz.slice_mut(ndarray::s![t, 3 * p..3 * p + 3]);
            count += usize::from(point.iter().all(|v| v.is_finite()));
            point.fill(f64::NAN);
        }
        Ok((first, count))
    }
}

fn time_of(poses: &Poses, rate: Option<f64>, frame: usize) -> f64 {
    let by_rate = frame as f64 / rate.unwrap_or(1.0);
    poses.time.as_ref().map_or(by_rate, |time| time[frame])
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

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

    #[test]
    fn only_the_segment_becomes_missing() {
        let mut poses = Poses {
            points: vec!["a".into(), "b".into()],
            xyz: Array2::ones((10, 6)),
            time: Some((0..10).map(|t| 3.0 + t as f64 / 30.0).collect()),
            ..Poses::default()
        };
        let segment = Segment::parse("b:3.0667-3.1333").unwrap();
        assert_eq!(segment.empty(&mut poses, Some(30.0)).unwrap(), (2, 3));
        let missing: Vec<usize> = (0..10).filter(|t| poses.xyz[[*t, 3]].is_nan()).collect();
        assert_eq!(missing, [2, 3, 4]);
        assert!(poses.xyz.column(0).iter().all(|v| v.is_finite()));
        for bad in ["c:3-4", "a:9-10"] {
            let segment = Segment::parse(bad).unwrap();
            assert!(segment.empty(&mut poses, Some(30.0)).is_err());
        }
    }
}
