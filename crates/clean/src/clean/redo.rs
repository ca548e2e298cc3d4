//! Segments of a take that somebody found bad: they count as missing.

use super::places::PlaceToSee;
use crate::io::{MotionFile, MotionFormat};
use crate::pose::{Poses, Segment};
use crate::restore::Restoration;
use crate::{Error, Place, Result};

/// What is done again.
pub(super) struct Redone {
    /// Where.
    pub places: Vec<PlaceToSee>,
    /// A line on each.
    pub notes: Vec<String>,
}

impl Redone {
    /// Empties segments of a file, which `keeps` its rotations or not.
    ///
    /// # Errors
    /// [`Error::Data`]: it keeps them, or has no such segment.
    pub(super) fn empty(
        segments: &[Segment],
        file: &mut MotionFile,
        keeps: bool,
    ) -> Result<Redone> {
        if keeps && !segments.is_empty() {
            let what = "holds rotations, and only positions can be done again; write nan for what \
                        is bad in a BVH file, or clean it with the option `to csv`";
            return Err(Error::data(Place::file(&file.table.name), what));
        }
        let rate = file.rate();
        let (mut places, mut notes) = (Vec::new(), Vec::new());
        for segment in segments {
            let emptied = empty(segment, &mut file.table.poses, rate);
            let (frame, count) = emptied.map_err(|e| e.at(Place::file(&file.table.name)))?;
            let [from, to] = segment.seconds;
            notes.push(format!(
                "{count} positions of {} from {from} to {to} s counted as missing, to be done \
                 again",
                segment.point
            ));
            let frames = [frame, frame + count.max(1)];
            places.push(PlaceToSee::of("done again", Some(&segment.point), frames));
        }
        Ok(Redone { places, notes })
    }
}

/// What a file of markers that is written in its own format keeps of segments that were to be done
/// again, and could not be filled.
pub(super) fn kept(
    segments: &[Segment],
    file: &MotionFile,
    restored: &Restoration<'_>,
) -> Option<String> {
    let is_table = matches!(file.format, MotionFormat::Csv | MotionFormat::Npy);
    let points = &file.table.poses.points;
    let is_left = |segment: &Segment| {
        let find = points.iter().position(|p| *p == segment.point);
        let frames = segment.frames(&file.table.poses, file.rate());
        let is_open = |p: usize, t: &usize| restored.xyz()[[*t, 3 * p]].is_nan();
        find.is_some_and(|p| frames.iter().any(|t| is_open(p, t)))
    };
    let what = "redo: what could not be filled again stays in the file as it was measured";
    (!is_table && segments.iter().any(is_left)).then(|| what.to_string())
}

/// Makes the positions of the segment missing. `rate` is that of a take without times. Returns
/// the first frame, and how many positions were there.
///
/// # Errors
/// [`crate::Error::Unfit`]: there is no such point or time, or there are several takes.
fn empty(segment: &Segment, poses: &mut Poses, rate: Option<f64>) -> Result<(usize, usize)> {
    let find = poses.points.iter().position(|p| *p == segment.point);
    let p = find.ok_or_else(|| format!("has no point \"{}\" to be done again", segment.point))?;
    if poses.takes().len() != 1 {
        return Err(
            "has not one take, and only of one can something be done again; part takes with \
             trim"
                .into(),
        );
    }
    let [from, to] = segment.seconds;
    let frames = segment.frames(poses, rate);
    let Some(&first) = frames.first() else {
        let last = poses.frames().saturating_sub(1);
        return Err(format!(
            "has no frame from {from} to {to} s to be done again: its times go from {} to {} s",
            Segment::time_of(poses, rate, 0),
            Segment::time_of(poses, rate, last)
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

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn only_the_segment_becomes_missing() {
        let mut poses = Poses {
            points: vec!["a".into(), "b".into()],
            xyz: Array2::ones((10, 6)),
            time: Some((0..10).map(|t| 3.0 + t as f64 / 30.0).collect()),
            ..Poses::default()
        };
        let segment = Segment::parse("b:3.0667-3.1333").unwrap();
        assert_eq!(empty(&segment, &mut poses, Some(30.0)).unwrap(), (2, 3));
        let missing: Vec<usize> = (0..10).filter(|t| poses.xyz[[*t, 3]].is_nan()).collect();
        assert_eq!(missing, [2, 3, 4]);
        assert!(poses.xyz.column(0).iter().all(|v| v.is_finite()));
        for bad in ["c:3-4", "a:9-10"] {
            let segment = Segment::parse(bad).unwrap();
            assert!(empty(&segment, &mut poses, Some(30.0)).is_err());
        }
    }
}
