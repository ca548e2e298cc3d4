//! How a figure stands in the world: along which axis, and whether it is a mirror image.
//!
//! **Up.** The way from the feet to the head is along the axis that is up, in nearly all frames of
//! a take in which somebody stands, walks or sits. People also lie, crawl and stand on their hands;
//! what could be that is not sure.
//!
//! **Mirrored.** With `l` the way from the right side to the left and `u` the way up the body, a
//! person's front is along `l × u` where axes are right-handed, and opposite it in a mirror image:
//! toes are before ankles, knees bend backward, and markers of front and back say it. Each sum of
//! triple products over the take, of the product of the lengths, is one witness. (64 takes of CMU:
//! feet at least 0.75, knees at least 0.45.)

use super::joints::cmu_names;
use super::{NameMap, PointNaming, UpAxis, point_at};
use crate::numeric::statistics::{median, quantile, range, span};
use glam::DVec3;
use ndarray::ArrayView2;

/// Frames that are looked at, evenly spread.
const FRAMES: usize = 400;
/// The share of the frames in which a body is along an axis, and the cosine that it then has.
const SHARE: f64 = 0.9;
const ALONG: f64 = 0.8;
/// What lies has its lowest point on the floor, and rolls only so far: the quantiles, and both in
/// lengths of what is seen of the body. (Takes of CMU: whoever stands has the lowest point within
/// 0.06, but for jumps; sideways it is farther in nearly all, of boxing too.)
const QUANTILES: [f64; 2] = [0.05, 0.95];
const FLOOR: f64 = 0.08;
const FARTHER: f64 = 1.2;
/// A witness of a mirror image says so much at least, and one against it no more than this.
const MIRRORED: f64 = -0.2;
const AGAINST: f64 = 0.1;

/// Where a figure is in a frame; NaN where it is not known.
#[derive(Debug, Clone, Copy)]
pub struct Figure {
    /// The head, else the shoulders or the hips.
    pub head: DVec3,
    pub hips: DVec3,
    pub feet: DVec3,
    pub hands: DVec3,
    /// The lowest and the highest of all points along y.
    pub heights: [f64; 2],
}

/// The axis that a figure stands along.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Standing {
    /// The axis that is up for it.
    pub axis: UpAxis,
    /// The share of the frames.
    pub share: f64,
    /// Whether it cannot be that somebody lies, or stands on the hands.
    pub is_sure: bool,
}

impl Standing {
    /// How the figure of a take stands; `None` where it is along no axis for most of it.
    pub fn of(frames: &[Figure]) -> Option<Standing> {
        let is_seen = |f: &&Figure| f.head.is_finite() && f.feet.is_finite();
        let seen: Vec<&Figure> = frames.iter().filter(is_seen).collect();
        let upward = |f: &Figure| (f.head - f.feet).normalize_or_zero();
        let share = |axis: UpAxis| {
            let is_along = |f: &&&Figure| upward(f).dot(axis.direction()) > ALONG;
            seen.iter().filter(is_along).count() as f64 / seen.len() as f64
        };
        let mut all = UpAxis::ALL.into_iter().map(|axis| (axis, share(axis)));
        let (axis, share) = all.find(|(_, share)| *share >= SHARE)?;
        let length = median(seen.iter().map(|f| f.head.distance(f.feet)).collect())?;
        // How far the lowest or the highest point goes up and down.
        let spread = |end: usize| {
            let heights: Vec<f64> = seen.iter().map(|f| f.heights[end]).collect();
            let [low, high] = QUANTILES.map(|share| quantile(heights.clone(), share));
            low.zip(high).map_or(f64::NAN, |(low, high)| high - low) / length
        };
        let is_sure = match axis {
            UpAxis::Y => true,
            // Who stands on the hands has them beyond the head, or the feet off any floor.
            UpAxis::MinusY => {
                let is_beyond = |f: &&&Figure| (f.hands - f.head).dot(upward(f)) > 0.0;
                let known = seen.iter().filter(|f| f.hands.is_finite()).count();
                let is_floor = spread(1) < FLOOR && spread(1) < spread(0);
                2 * seen.iter().filter(is_beyond).count() < known || known == 0 && is_floor
            }
            _ => {
                let across = 2 - axis.direction().abs().max_position();
                let moved = span(
                    seen.iter()
                        .map(|f| f.hips[across])
                        .filter(|v| v.is_finite()),
                );
                spread(0) > FLOOR || moved > FARTHER * length
            }
        };
        Some(Standing {
            axis,
            share,
            is_sure,
        })
    }
}

impl Standing {
    /// What is wrong where the axis is not y, and what to do.
    pub fn sentence(&self) -> String {
        let (axis, share) = (self.axis.name(), 100.0 * self.share);
        match self.axis {
            UpAxis::MinusY => format!(
                "the body is below its feet in {share:.0}% of the frames: y points down (the \
                 option `up -y`)"
            ),
            _ => format!(
                "the body is along {}, upwards to {axis}, in {share:.0}% of the \
                 frames: {axis} is up (the option `up {axis}`)",
                axis.trim_start_matches('-')
            ),
        }
    }
}

/// The points of a side of the body.
#[derive(Debug, Clone, Default)]
pub struct SidePoints {
    pub shoulder: Vec<usize>,
    pub hip: Vec<usize>,
    pub knee: Vec<usize>,
    pub ankle: Vec<usize>,
    pub toe: Vec<usize>,
    pub wrist: Vec<usize>,
}

/// Which points of a table are where on the body.
#[derive(Debug, Clone, Default)]
pub struct BodyPoints {
    pub head: Vec<usize>,
    /// Left and right.
    pub sides: [SidePoints; 2],
    /// Points at the front and at the back of one bone.
    pub fronts: Vec<[Vec<usize>; 2]>,
}

impl BodyPoints {
    /// Those of joints at `xyz` (frames, 3 P), by a map, else by the shipped one that fits or CMU's
    /// names.
    pub fn of_joints(
        points: &[String],
        xyz: ArrayView2<'_, f64>,
        map: Option<&NameMap>,
    ) -> BodyPoints {
        let naming = match map {
            Some(map) => PointNaming::Map(map.clone()),
            None => PointNaming::of(points, xyz, &cmu_names()),
        };
        let names = naming.model_names(points);
        let at = |name: &str| Vec::from_iter(names.iter().position(|n| n == name));
        let of_map = match &naming {
            PointNaming::Map(map) => map.trunk_column("Head", points),
            PointNaming::Bones(_) => None,
        };
        let side = |side: &str| SidePoints {
            shoulder: at(&format!("{side}clavicle")),
            hip: at(&format!("{side}hipjoint")),
            knee: at(&format!("{side}femur")),
            ankle: at(&format!("{side}tibia")),
            toe: at(&format!("{side}foot")),
            wrist: at(&format!("{side}radius")),
        };
        BodyPoints {
            head: of_map.map_or_else(|| at("head"), |p| vec![p]),
            sides: ["l", "r"].map(side),
            fronts: Vec::new(),
        }
    }

    /// Whether points of both hips and feet are known.
    pub fn has_legs(&self) -> bool {
        let has_foot = |s: &SidePoints| !s.ankle.is_empty() || !s.toe.is_empty();
        self.sides.iter().all(|s| has_foot(s) && !s.hip.is_empty())
    }

    /// How the body stands in a take at `xyz` (frames, 3 P).
    pub fn standing(&self, xyz: ArrayView2<'_, f64>) -> Option<Standing> {
        let feet = self.both(|s| if s.ankle.is_empty() { &s.toe } else { &s.ankle });
        let [hips, shoulders, hands] = [
            self.both(|s| &s.hip),
            self.both(|s| &s.shoulder),
            self.both(|s| &s.wrist),
        ];
        let figure = |t: usize| {
            let middle = |of: &[Vec<usize>; 2]| between(xyz, t, of);
            let head = position(xyz, t, &self.head);
            let mut above = [head, middle(&shoulders), middle(&hips)].into_iter();
            Figure {
                head: above.find(|at| at.is_finite()).unwrap_or(DVec3::NAN),
                hips: middle(&hips),
                feet: middle(&feet),
                hands: middle(&hands),
                heights: heights(xyz, t),
            }
        };
        let frames: Vec<Figure> = frames(xyz).map(figure).collect();
        Standing::of(&frames)
    }

    /// Whether the body is a mirror image in a take at `xyz` (frames, 3 P).
    pub fn is_mirrored(&self, xyz: ArrayView2<'_, f64>) -> bool {
        let witnesses = self.witnesses(xyz);
        let count = witnesses.iter().filter(|w| **w <= MIRRORED).count();
        count >= 2 && witnesses.iter().all(|w| *w < AGAINST)
    }

    /// What feet, knees, and fronts say, from −1 for a mirror image to 1.
    fn witnesses(&self, xyz: ArrayView2<'_, f64>) -> Vec<f64> {
        let mut sums = vec![[0.0; 2]; 2 + self.fronts.len()];
        let mut add = |witness: usize, [a, b, c]: [DVec3; 3]| {
            let (product, lengths) = (a.cross(b).dot(c), a.length() * b.length() * c.length());
            if product.is_finite() {
                sums[witness][0] += product;
                sums[witness][1] += lengths;
            }
        };
        for t in frames(xyz) {
            let at = |of: &[usize]| position(xyz, t, of);
            let across = |of: [&Vec<usize>; 2]| at(of[0]) - at(of[1]);
            let [left, right] = &self.sides;
            let pelvis = across([&left.hip, &right.hip]);
            let shoulders = across([&left.shoulder, &right.shoulder]);
            let lateral = if pelvis.is_finite() {
                pelvis
            } else {
                shoulders
            };
            for side in &self.sides {
                let [hip, knee, ankle] = [&side.hip, &side.knee, &side.ankle].map(|of| at(of));
                add(0, [lateral, knee - ankle, at(&side.toe) - ankle]);
                add(1, [knee - hip, ankle - knee, lateral]);
            }
            let [hips, shoulders_at] = [
                between(xyz, t, &self.both(|s| &s.hip)),
                between(xyz, t, &self.both(|s| &s.shoulder)),
            ];
            let lateral = if shoulders.is_finite() {
                shoulders
            } else {
                pelvis
            };
            let up = if shoulders_at.is_finite() {
                shoulders_at
            } else {
                at(&self.head)
            } - hips;
            for (n, [front, back]) in self.fronts.iter().enumerate() {
                add(2 + n, [lateral, up, at(front) - at(back)]);
            }
        }
        let known = sums.into_iter().filter(|[_, lengths]| *lengths > 0.0);
        known.map(|[sum, lengths]| sum / lengths).collect()
    }

    fn both<'a>(&'a self, of: impl Fn(&'a SidePoints) -> &'a Vec<usize>) -> [Vec<usize>; 2] {
        [0, 1].map(|side: usize| of(&self.sides[side]).clone())
    }
}

/// Frames that are looked at.
fn frames(xyz: ArrayView2<'_, f64>) -> impl Iterator<Item = usize> {
    (0..xyz.nrows()).step_by(xyz.nrows().div_ceil(FRAMES).max(1))
}

/// The middle of those points that are seen.
fn position(xyz: ArrayView2<'_, f64>, frame: usize, points: &[usize]) -> DVec3 {
    let seen = points.iter().map(|&p| point_at(xyz, frame, p));
    let seen = seen.filter(|at| at.is_finite());
    let (sum, count) = seen.fold((DVec3::ZERO, 0.0), |(sum, n), at| (sum + at, n + 1.0));
    sum / count
}

/// The lowest and the highest of all points along y.
fn heights(xyz: ArrayView2<'_, f64>, frame: usize) -> [f64; 2] {
    let row = xyz.row(frame);
    let heights = row.into_iter().skip(1).step_by(3).copied();
    range(heights.filter(|y| y.is_finite())).into()
}

/// The middle of two sides.
fn between(xyz: ArrayView2<'_, f64>, frame: usize, sides: &[Vec<usize>; 2]) -> DVec3 {
    (position(xyz, frame, &sides[0]) + position(xyz, frame, &sides[1])) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::joints::CMU_REST;
    use ndarray::Array2;

    /// CMU's rest pose, arms down, knees bent, that walks along z; each position carried by `turn`.
    fn walk(turn: impl Fn([f64; 3]) -> [f64; 3], hands: f64) -> Array2<f64> {
        let mut xyz = Array2::zeros((60, 69));
        for t in 0..60 {
            for (p, rest) in CMU_REST.iter().enumerate() {
                let mut at = *rest;
                at[1] += 92.0;
                at[2] += 4.0 * t as f64;
                match p {
                    2 | 6 => at[2] += 12.0,
                    17 | 21 => at = [at[0].signum() * 20.0, hands, at[2]],
                    _ => {}
                }
                let at = turn(at);
                (0..3).for_each(|c| xyz[[t, 3 * p + c]] = at[c]);
            }
        }
        xyz
    }

    fn told(xyz: &Array2<f64>) -> (Option<(UpAxis, bool)>, bool) {
        let body = BodyPoints::of_joints(&cmu_names(), xyz.view(), None);
        let standing = body.standing(xyz.view());
        let axis = standing.map(|s| (s.axis, s.is_sure));
        (axis, body.is_mirrored(xyz.view()))
    }

    #[test]
    fn an_axis_that_is_wrong_is_told_and_a_mirror_image() {
        for up in UpAxis::ALL {
            let xyz = walk(|at| up.turn_from_y(at), 80.0);
            let axis = up.handed(false);
            assert_eq!(told(&xyz), (Some((axis, true)), axis != up), "{up:?}");
        }
        let mirrored = walk(|[x, y, z]| [-x, y, z], 80.0);
        assert_eq!(told(&mirrored), (Some((UpAxis::Y, true)), true));
    }

    #[test]
    fn who_lies_or_stands_on_the_hands_is_not_sure() {
        // On the hands: they are beyond the head.
        let hands = walk(|[x, y, z]| [x, 180.0 - y, -z], 190.0);
        assert_eq!(told(&hands), (Some((UpAxis::MinusY, false)), false));
        // On the back along x, not moving.
        let lies = walk(|[x, y, z]| [y, 20.0 + (z % 3.0), x], 80.0);
        let still = lies.slice(ndarray::s![..1, ..]).to_owned();
        assert!(!told(&still).0.unwrap().1);
        let nobody = Array2::from_elem((5, 69), f64::NAN);
        assert_eq!(told(&nobody), (None, false));
    }
}
