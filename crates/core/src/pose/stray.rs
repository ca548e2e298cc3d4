//! Points that stand far off all others, and so belong to no body among them.

use crate::numeric::statistics::median;
use glam::DVec3;
use ndarray::ArrayView2;

/// Fewer points that stand together are no body.
const FEWEST: usize = 7;
/// One in so many points may stand apart with others: more are another body.
const POINTS_TO_ONE: usize = 5;
/// What stands apart is this many times as far from the middle as the farthest of the others.
const FARTHER: f64 = 2.5;
/// Frames that are looked at, evenly spread, and the share of them that shows a point.
const FRAMES: usize = 400;
const SEEN: f64 = 0.1;
/// Three points that are at least and at most so far from each other, cm, are a thing of their own,
/// such as a prop.
const TOGETHER: std::ops::RangeInclusive<f64> = 1.0..=100.0;
const OF_A_THING: usize = 3;
/// More points that stand apart are no single ones.
const MOST_STRAY: usize = 50;

/// A point that stands apart from all others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointApart {
    /// The point.
    pub point: usize,
    /// How far it is from the middle of all points, in the median over the frames, cm.
    pub distance: f64,
    /// Whether it is by itself; else it is of a thing of several points, such as a prop.
    pub is_stray: bool,
}

/// The points of frames x 3 J numbers, cm, that are farther than `reach` (cm) from the middle of
/// all, and much farther than all others are; none where fewer than seven others stand together.
/// The middle of a frame is the median of each coordinate.
pub fn points_apart(xyz: ArrayView2<'_, f64>, reach: f64) -> Vec<PointApart> {
    let positions = positions(xyz);
    let mut far: Vec<(f64, usize)> = (positions.iter().enumerate())
        .filter_map(|(p, position)| Some((position.as_ref()?.1, p)))
        .collect();
    far.sort_by(|a, b| a.0.total_cmp(&b.0));
    let most = (far.len() / POINTS_TO_ONE).max(1);
    let position = |p: usize| positions[p].map_or(DVec3::NAN, |(position, _)| position);
    let is_gap = |k: &usize| far[*k].0 > reach.max(FARTHER * far[k - 1].0);
    // Those of one direction, no farther from each other than a body reaches.
    let are_few = |k: &usize| {
        let is_near = |p: usize, q: usize| position(p).distance(position(q)) <= reach;
        let near = |p: usize| far[*k..].iter().filter(|(_, q)| is_near(p, *q)).count();
        let count = far.len() - k;
        count <= most || count <= MOST_STRAY && far[*k..].iter().all(|&(_, p)| near(p) <= most)
    };
    // The middle is among the others, which are more.
    let first = FEWEST.max(far.len() / 2 + 1);
    let Some(first) = (first..far.len()).find(|k| is_gap(k) && are_few(k)) else {
        return Vec::new();
    };
    let apart = &far[first..];
    let is_with = |p: usize, q: usize| TOGETHER.contains(&position(p).distance(position(q)));
    let mut out: Vec<PointApart> = apart
        .iter()
        .map(|&(distance, point)| PointApart {
            point,
            distance,
            is_stray: apart.len() <= MOST_STRAY
                && apart.iter().filter(|(_, q)| is_with(point, *q)).count() + 1 < OF_A_THING,
        })
        .collect();
    out.sort_by_key(|a| a.point);
    out
}

/// Where each point is from the middle of its frame, in the median of each coordinate, and how far,
/// in the median; `None` for points that are hardly seen.
fn positions(xyz: ArrayView2<'_, f64>) -> Vec<Option<(DVec3, f64)>> {
    let points = xyz.ncols() / 3;
    let step = xyz.nrows().div_ceil(FRAMES).max(1);
    let mut offsets: Vec<Vec<DVec3>> = vec![Vec::new(); points];
    let mut frames = 0;
    for row in xyz.rows().into_iter().step_by(step) {
        frames += 1;
        let at = |p: usize| DVec3::new(row[3 * p], row[3 * p + 1], row[3 * p + 2]);
        let seen: Vec<usize> = (0..points).filter(|&p| at(p).is_finite()).collect();
        let Some(middle) = middle(seen.iter().map(|&p| at(p))) else {
            continue;
        };
        for p in seen {
            offsets[p].push(at(p) - middle);
        }
    }
    let fewest = (SEEN * frames as f64).max(1.0);
    let of = |offsets: Vec<DVec3>| {
        let position = middle(offsets.iter().copied())?;
        let distance = median(offsets.iter().map(|o| o.length()).collect())?;
        (offsets.len() as f64 >= fewest).then_some((position, distance))
    };
    offsets.into_iter().map(of).collect()
}

/// The median of each coordinate; `None` if there are none.
fn middle(positions: impl Iterator<Item = DVec3> + Clone) -> Option<DVec3> {
    let axis = |c: usize| median(positions.clone().map(|at| at[c]).collect());
    Some(DVec3::new(axis(0)?, axis(1)?, axis(2)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// A body of `points` points, 170 cm tall, that walks.
    fn body(points: usize) -> Array2<f64> {
        Array2::from_shape_fn((60, 3 * points), |(t, c)| match c % 3 {
            0 => 20.0 * ((c / 3) as f64).sin(),
            1 => 170.0 * (c / 3) as f64 / points as f64,
            _ => t as f64,
        })
    }

    fn put(xyz: &mut Array2<f64>, point: usize, at: [f64; 3]) {
        for mut row in xyz.rows_mut() {
            (0..3).for_each(|c| row[3 * point + c] = at[c]);
        }
    }

    fn apart(xyz: &Array2<f64>) -> Vec<(usize, bool)> {
        let all = points_apart(xyz.view(), 260.0).into_iter();
        all.map(|a| (a.point, a.is_stray)).collect()
    }

    #[test]
    fn points_far_off_are_stray_and_the_body_is_not() {
        let mut xyz = body(15);
        assert_eq!(apart(&xyz), []);
        put(&mut xyz, 3, [900.0, 5.0, -400.0]);
        assert_eq!(apart(&xyz), [(3, true)]);
        put(&mut xyz, 9, [0.0, 4000.0, 0.0]);
        put(&mut xyz, 14, [0.0, 0.0, -700.0]);
        assert_eq!(apart(&xyz), [(3, true), (9, true), (14, true)]);
        let mut few = body(11);
        put(&mut few, 3, [900.0, 5.0, -400.0]);
        put(&mut few, 6, [0.0, 4000.0, 0.0]);
        put(&mut few, 9, [0.0, 0.0, -700.0]);
        assert_eq!(apart(&few), [(3, true), (6, true), (9, true)]);
        // In meters that are taken for centimeters nothing is far.
        assert_eq!(apart(&(xyz * 0.01)), []);
    }

    #[test]
    fn a_second_body_or_a_prop_is_no_stray_point() {
        let mut two = body(30);
        for p in 15..30 {
            put(&mut two, p, [400.0, 10.0 * (p - 15) as f64, 0.0]);
        }
        assert_eq!(apart(&two), []);
        let mut prop = body(25);
        for (i, p) in [4, 5, 6, 7].into_iter().enumerate() {
            put(&mut prop, p, [600.0 + 15.0 * i as f64, 5.0, 0.0]);
        }
        let all = apart(&prop);
        assert!(all.len() == 4 && all.iter().all(|a| !a.1), "{all:?}");
    }

    #[test]
    fn few_points_or_none_have_none_apart() {
        let mut few = body(7);
        put(&mut few, 2, [900.0, 0.0, 0.0]);
        assert_eq!(apart(&few), []);
        for shape in [(0, 30), (5, 0), (1, 3)] {
            assert_eq!(apart(&Array2::zeros(shape)), []);
        }
        assert_eq!(apart(&Array2::from_elem((5, 30), f64::NAN)), []);
    }
}
