//! Takes that were read in another unit than theirs: a body has a size that no person has, and is a
//! person's with numbers ten, a hundred or a thousand times as large or small.
//!
//! Where heads and feet have names, the distance between them tells. Elsewhere two lengths must,
//! since several people are large, and hands and faces small: the largest extent of all points, and
//! how far a point is from the one next to it. Where points do not go with each other rigidly, what
//! is large is no body.

use super::head_and_feet::head_and_feet;
use super::stray::points_apart;
use super::{LengthUnit, Poses, Units, point_at};
use crate::numeric::statistics::{median, range};
use crate::{Error, Place, Result};
use glam::DVec3;
use ndarray::{Array2, ArrayView2, Axis};
use std::ops::RangeInclusive;

/// Frames that are looked at, evenly spread.
const FRAMES: usize = 20;
/// How far the head is from the feet, cm, of people who stand or crouch; and what none has.
const REACH: RangeInclusive<f64> = 40.0..=250.0;
const POSSIBLE_REACH: RangeInclusive<f64> = 25.0..=400.0;
/// The extent of a limb or a body that a factor is to lead to, cm; and what faces and hands, and
/// one body, do not pass.
const EXTENT: RangeInclusive<f64> = 26.0..=260.0;
const POSSIBLE_EXTENT: RangeInclusive<f64> = 4.0..=600.0;
/// How far points are from the next, cm, in the median, in sets of markers of faces at least and in
/// those of a few joints of a body at most.
const POSSIBLE_APART: RangeInclusive<f64> = 0.6..=60.0;
/// Points without names are looked at from so many on, and the next of so many.
const FEWEST: usize = 8;
const MOST: usize = 200;
/// The largest less the least distance of a point from the next, of their sum, in the median: at
/// most of bodies.
const RIGID: f64 = 0.15;
/// What files of captures are in, whatever they say.
const USUAL: [LengthUnit; 3] = [LengthUnit::Cm, LengthUnit::M, LengthUnit::Mm];

/// A length that no person has.
#[derive(Debug, Clone, Copy, PartialEq)]
struct WrongSize {
    /// The length, cm.
    length: f64,
    /// The unit in which it is a person's.
    own: LengthUnit,
    is_of_names: bool,
}

/// Fails where `poses` (cm) of a file or table `name` that was read in `units` are no person's, and
/// are in another unit. A rig that is a person's in no usual unit passes.
///
/// # Errors
/// [`Error::Data`]: the size, the factor and the unit that is right.
pub fn check_unit(poses: &Poses, units: Units, name: &str) -> Result<()> {
    for take in poses.takes() {
        let xyz = poses.xyz.slice(ndarray::s![take, ..]);
        if let Some(wrong) = WrongSize::find(&poses.points, xyz, units.unit) {
            return Err(Error::data(Place::file(name), wrong.sentence(units.unit)));
        }
    }
    Ok(())
}

impl WrongSize {
    /// The size of `points` at `xyz` (frames, 3 P; cm) that were read in a `unit`, where it is
    /// surely wrong.
    fn find(points: &[String], xyz: ArrayView2<'_, f64>, unit: LengthUnit) -> Option<WrongSize> {
        let step = xyz.nrows().div_ceil(FRAMES).max(1);
        let frames: Vec<usize> = (0..xyz.nrows()).step_by(step).collect();
        let xyz = xyz.select(Axis(0), &frames);
        if let Some(length) = reach(points, &xyz) {
            let own = (!POSSIBLE_REACH.contains(&length)).then(|| own(length, unit, &REACH))??;
            return Some(WrongSize {
                length,
                own,
                is_of_names: true,
            });
        }
        let length = extent(&xyz)?;
        if POSSIBLE_EXTENT.contains(&length) {
            return None;
        }
        let (apart, looseness) = next(&xyz)?;
        let is_one =
            apart < *POSSIBLE_APART.start() || apart > *POSSIBLE_APART.end() && looseness < RIGID;
        Some(WrongSize {
            length,
            own: is_one.then(|| own(length, unit, &EXTENT))??,
            is_of_names: false,
        })
    }

    /// What is wrong, and what to do, for numbers that were read in a `unit`.
    fn sentence(&self, unit: LengthUnit) -> String {
        let of = if self.is_of_names {
            "from foot to head"
        } else {
            "in all"
        };
        let factor = self.own.centimeters() / unit.centimeters();
        let (times, size) = if factor < 1.0 {
            (1.0 / factor, "large")
        } else {
            (factor, "small")
        };
        format!(
            "the body measures {} {of}, {times:.0} times too {size} for a person: its numbers are \
             {}, not {}; give the option `units {}`",
            with_unit(self.length),
            plural(self.own),
            plural(unit),
            self.own.name()
        )
    }
}

/// The unit in which a length (cm) that was read in a `unit` is within a range.
fn own(length: f64, unit: LengthUnit, range: &RangeInclusive<f64>) -> Option<LengthUnit> {
    let is_in =
        |own: &LengthUnit| range.contains(&(length * own.centimeters() / unit.centimeters()));
    USUAL.into_iter().find(is_in)
}

/// Where a point is; NaN also at the origin, which stands for missing in many files.
fn position(xyz: &Array2<f64>, frame: usize, point: usize) -> DVec3 {
    let at = point_at(xyz.view(), frame, point);
    if at == DVec3::ZERO { DVec3::NAN } else { at }
}

/// How far the middle of the head's points is from that of the feet's, in the median.
fn reach(points: &[String], xyz: &Array2<f64>) -> Option<f64> {
    let groups = head_and_feet(points);
    let middle = |t: usize, of: &[usize]| {
        let seen = of
            .iter()
            .map(|&p| position(xyz, t, p))
            .filter(|at| at.is_finite());
        let (sum, count) = seen.fold((DVec3::ZERO, 0.0), |(sum, n), at| (sum + at, n + 1.0));
        sum / count
    };
    let reaches = (0..xyz.nrows()).map(|t| middle(t, &groups[0]).distance(middle(t, &groups[1])));
    median(reaches.filter(|reach| reach.is_finite()).collect())
}

/// The largest extent of the points of a frame without those that stand apart, in the median.
fn extent(xyz: &Array2<f64>) -> Option<f64> {
    let apart = points_apart(xyz.view(), *POSSIBLE_EXTENT.end());
    let of_all = |p: &usize| !apart.iter().any(|a| a.point == *p);
    let points: Vec<usize> = (0..xyz.ncols() / 3).filter(of_all).collect();
    let of_frame = |t: usize| {
        let seen = points
            .iter()
            .map(|&p| position(xyz, t, p))
            .filter(|at| at.is_finite());
        let seen: Vec<DVec3> = seen.collect();
        let axis = |c: usize| {
            let (low, high) = range(seen.iter().map(|at| at[c]));
            high - low
        };
        (seen.len() >= FEWEST).then(|| axis(0).max(axis(1)).max(axis(2)))
    };
    median((0..xyz.nrows()).filter_map(of_frame).collect())
}

/// How far points are from the next, and how loosely they go with it, in the median.
fn next(xyz: &Array2<f64>) -> Option<(f64, f64)> {
    let count = xyz.ncols() / 3;
    let between = |p: usize, q: usize| {
        let all = (0..xyz.nrows()).map(|t| position(xyz, t, p).distance(position(xyz, t, q)));
        let all: Vec<f64> = all.filter(|d| d.is_finite()).collect();
        let (low, high) = range(all.iter().copied());
        Some((median(all)?, (high - low) / (high + low)))
    };
    let nearest = |p: usize| {
        let others = (0..count).filter(|q| *q != p).filter_map(|q| between(p, q));
        others.min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let step = count.div_ceil(MOST).max(1);
    let (apart, loose): (Vec<f64>, Vec<f64>) = (0..count).step_by(step).filter_map(nearest).unzip();
    Some((median(apart)?, median(loose)?))
}

fn plural(unit: LengthUnit) -> &'static str {
    match unit {
        LengthUnit::Cm => "centimeters",
        LengthUnit::M => "meters",
        LengthUnit::Mm => "millimeters",
        LengthUnit::In => "inches",
        LengthUnit::Asf => "units of ASF files",
    }
}

/// A length of so many centimeters for people.
fn with_unit(cm: f64) -> String {
    match cm {
        ..0.1 => format!("{:.2} mm", 10.0 * cm),
        ..1.0 => format!("{:.1} mm", 10.0 * cm),
        ..1000.0 => format!("{cm:.1} cm"),
        _ => format!("{:.0} m", cm / 100.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a body that turns and walks, a row of them 170 cm tall, `wide` apart sideways.
    fn row(points: usize, frames: usize) -> Array2<f64> {
        Array2::from_shape_fn((frames, 3 * points), |(t, c)| {
            let (p, turn) = ((c / 3) as f64, 0.1 * t as f64);
            let (out, up) = (12.0 * (2.0 * p).sin(), 1.0 + 170.0 * p / points as f64);
            [out * turn.cos() + 5.0 * turn, up, out * turn.sin()][c % 3]
        })
    }

    fn own_unit(points: &[String], xyz: &Array2<f64>, unit: LengthUnit) -> Option<LengthUnit> {
        WrongSize::find(points, xyz.view(), unit).map(|w| w.own)
    }

    #[test]
    fn a_body_of_another_unit_is_found_and_what_is_sound_is_not() {
        use LengthUnit::*;
        let xyz = row(30, 40);
        let nameless: Vec<String> = (0..30).map(|p| format!("*{p}")).collect();
        let mut named = nameless.clone();
        (named[0], named[29]) = ("LTOE".into(), "LFHD".into());
        for points in [&nameless, &named] {
            for unit in LengthUnit::ALL {
                assert_eq!(own_unit(points, &xyz, unit), None);
            }
            // Numbers of a unit, read in another.
            let read = [(Mm, Cm), (Mm, M), (Mm, In), (Cm, M), (M, Cm), (M, Mm)];
            for (own, unit) in read {
                let times = unit.centimeters() / own.centimeters();
                assert_eq!(own_unit(points, &(&xyz * times), unit), Some(own));
            }
        }
        // A tenth without names may be a hand or a face, and in centimeters a rig of its own size.
        assert_eq!(own_unit(&nameless, &(&xyz * 0.1), Mm), None);
        assert_eq!(own_unit(&named, &(&xyz * 0.1), Mm), Some(Cm));
        assert_eq!(own_unit(&named, &(&xyz * 0.1), Cm), None);
        // A leg, and four people far from each other.
        assert_eq!(own_unit(&nameless[..9], &row(9, 40), Cm), None);
        let mut four = row(40, 40);
        for mut row in four.rows_mut() {
            (0..120).for_each(|c| row[c] += 2000.0 * ((c / 30) * (c % 3)) as f64);
        }
        let names: Vec<String> = (0..40).map(|p| format!("*{p}")).collect();
        assert_eq!(own_unit(&names, &four, Mm), None);
        // Players, a point each.
        let players = Array2::from_shape_fn((40, 66), |(t, c)| {
            let (p, t) = ((c / 3) as f64, t as f64);
            [
                4000.0 * (p + 0.02 * t * (1.0 + p % 3.0)).sin(),
                100.0,
                700.0 * (p * 1.3 + 0.05 * t).cos(),
            ][c % 3]
        });
        let names: Vec<String> = (0..22).map(|p| format!("*{p}")).collect();
        assert_eq!(own_unit(&names, &players, Mm), None);
        assert_eq!(own_unit(&[], &Array2::zeros((0, 0)), Cm), None);
        assert_eq!(own_unit(&nameless, &Array2::zeros((3, 90)), Cm), None);
        assert_eq!(
            own_unit(&nameless, &Array2::from_elem((3, 90), f64::NAN), Cm),
            None
        );
    }

    #[test]
    fn the_right_unit_is_named() {
        let of = |length: f64, own, unit| {
            let wrong = WrongSize {
                length,
                own,
                is_of_names: true,
            };
            wrong.sentence(unit)
        };
        let text = of(165_000.0, LengthUnit::Mm, LengthUnit::M);
        assert!(
            text.starts_with("the body measures 1650 m from foot to head, 1000 times too large")
        );
        assert!(
            text.ends_with("millimeters, not meters; give the option `units mm`"),
            "{text}"
        );
        assert!(
            of(1.65, LengthUnit::M, LengthUnit::Cm)
                .contains("meters, not centimeters; give the option `units m`")
        );
    }
}
