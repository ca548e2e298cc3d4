//! Segments of a take that somebody found bad: they count as missing.

use crate::Result;
use crate::pose::{Poses, Segment};

/// Makes the positions of the segment missing. `rate` is that of a take without times. Returns
/// the first frame, and how many positions were there.
///
/// # Errors
/// [`crate::Error::Unfit`]: there is no such point or time, or there are several takes.
pub(crate) fn empty(
    segment: &Segment,
    poses: &mut Poses,
    rate: Option<f64>,
) -> Result<(usize, usize)> {
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
