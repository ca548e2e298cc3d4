//! Geometry of a scene that every drawing needs: sides of the body, ground, size and heading.

use super::scene::{Scene, Status};
use crate::numeric::statistics::quantile;
use std::collections::HashSet;

/// Points farther than this from the origin (cm, 100 km) count as missing.
const MAX_COORDINATE: f64 = 1e7;

/// The side of the body that a point or bone is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Middle,
    Left,
    Right,
}

/// The geometry of a scene, computed once.
pub(super) struct SceneGeometry<'s, 'a> {
    scene: &'s Scene<'a>,
    /// Figures x axes: whether the axis is missing throughout, and so drawn as zero.
    flat: Vec<[bool; 3]>,
    /// The side of each point.
    pub sides: Vec<Side>,
    /// The point drawn as a head.
    pub head: Option<usize>,
    /// The figure whose ground and center count: the first of those that miss fewest points.
    pub reference: usize,
    /// Height of the ground (cm): where the reference figure's lowest point is in its lowest
    /// frames.
    pub ground: f64,
    /// The reference figure's usual size (cm): the median diagonal of the box around it.
    pub size: f64,
}

impl<'s, 'a> SceneGeometry<'s, 'a> {
    pub(crate) fn of(scene: &'s Scene<'a>) -> Self {
        let mut geometry = SceneGeometry {
            scene,
            flat: scene.figures.iter().map(|f| flat_axes(f.xyz)).collect(),
            sides: sides(scene.points),
            head: scene
                .points
                .iter()
                .position(|name| bare(name).eq_ignore_ascii_case("head")),
            reference: 0,
            ground: 0.0,
            size: 0.0,
        };
        let missing: Vec<usize> = (0..scene.figures.len())
            .map(|f| geometry.count_missing(f))
            .collect();
        geometry.reference = (0..missing.len()).min_by_key(|f| missing[*f]).unwrap_or(0);
        let boxes: Vec<[[f64; 2]; 3]> = (0..scene.frames())
            .filter_map(|t| geometry.extent(t))
            .collect();
        // The 1% quantile, not the minimum: one outlier must not move the ground.
        let lows = boxes.iter().map(|b| b[1][0]).collect();
        geometry.ground = quantile(lows, 0.01).unwrap_or(0.0);
        let diagonal = |b: &[[f64; 2]; 3]| {
            b.iter()
                .map(|[low, high]| (high - low).powi(2))
                .sum::<f64>()
        };
        let sizes = boxes.iter().map(|b| diagonal(b).sqrt()).collect();
        geometry.size = quantile(sizes, 0.5).unwrap_or(0.0).max(1.0);
        geometry
    }

    /// Where a point is (cm), unless it is missing.
    pub(crate) fn at(&self, figure: usize, frame: usize, point: usize) -> Option<[f64; 3]> {
        let xyz = self.scene.figures[figure].xyz;
        let mut position = [0.0; 3];
        for axis in 0..3 {
            if !self.flat[figure][axis] {
                position[axis] = xyz[[frame, 3 * point + axis]];
            }
        }
        position
            .iter()
            .all(|v| v.abs() <= MAX_COORDINATE)
            .then_some(position)
    }

    /// The status of a point that is there.
    pub(crate) fn status(&self, figure: usize, frame: usize, point: usize) -> Status {
        self.scene.figures[figure]
            .status
            .map_or(Status::Observed, |s| s[[frame, point]])
    }

    /// The side of a bone: that of the end which has one.
    pub(crate) fn bone_side(&self, (a, b): (usize, usize)) -> Side {
        if self.sides[b] != Side::Middle {
            self.sides[b]
        } else {
            self.sides[a]
        }
    }

    /// The box around the reference figure in a frame: lowest and highest x, y, z.
    pub(crate) fn extent(&self, frame: usize) -> Option<[[f64; 2]; 3]> {
        let mut extent = None;
        for position in
            (0..self.scene.points.len()).filter_map(|p| self.at(self.reference, frame, p))
        {
            let known = extent.get_or_insert(position.map(|v| [v, v]));
            for axis in 0..3 {
                known[axis][0] = known[axis][0].min(position[axis]);
                known[axis][1] = known[axis][1].max(position[axis]);
            }
        }
        extent
    }

    /// The horizontal middle (x, z) of the reference figure in a frame: the medians, which an
    /// outlier hardly moves.
    pub(crate) fn middle(&self, frame: usize) -> Option<[f64; 2]> {
        let points = 0..self.scene.points.len();
        let seen: Vec<[f64; 3]> = points
            .filter_map(|p| self.at(self.reference, frame, p))
            .collect();
        let median = |axis: usize| quantile(seen.iter().map(|at| at[axis]).collect(), 0.5);
        Some([median(0)?, median(2)?])
    }

    /// Where the camera should stand (degrees): the body is seen three quarters from the front
    /// and looks to the right, as walks are printed. 0 is at +z, 90 at +x.
    pub(crate) fn azimuth(&self) -> f64 {
        const AWAY_FROM_THE_FRONT: f64 = -55.0;
        let frames = self.scene.frames();
        let step = frames.div_ceil(200).max(1);
        let (mut x, mut z) = (0.0, 0.0);
        for frame in (0..frames).step_by(step) {
            let Some([dx, dz]) = self.leftward(frame) else {
                continue;
            };
            // Facing is leftward turned by -90 degrees about y: left x up.
            (x, z) = (x - dz, z + dx);
        }
        if x.hypot(z) > 1e-9 {
            let azimuth = x.atan2(z).to_degrees() + AWAY_FROM_THE_FRONT;
            return (azimuth + 540.0).rem_euclid(360.0) - 180.0;
        }
        30.0
    }

    /// From the right side of the body to its left, in the plane (x, z), in one frame.
    fn leftward(&self, frame: usize) -> Option<[f64; 2]> {
        let mean = |side: Side| {
            let (mut sum, mut count) = ([0.0; 2], 0.0);
            for p in (0..self.sides.len()).filter(|p| self.sides[*p] == side) {
                if let Some([x, _, z]) = self.at(self.reference, frame, p) {
                    sum = [sum[0] + x, sum[1] + z];
                    count += 1.0;
                }
            }
            (count > 0.0).then(|| sum.map(|v| v / count))
        };
        let (left, right) = (mean(Side::Left)?, mean(Side::Right)?);
        let across = [left[0] - right[0], left[1] - right[1]];
        let length = across[0].hypot(across[1]);
        (length > 1e-9).then(|| across.map(|v| v / length))
    }

    fn count_missing(&self, figure: usize) -> usize {
        let points = self.scene.points.len();
        (0..self.scene.frames())
            .map(|t| {
                (0..points)
                    .filter(|p| self.at(figure, t, *p).is_none())
                    .count()
            })
            .sum()
    }

    /// The axes that a figure does not have at all, as letters.
    pub(crate) fn flat_axes(&self, figure: usize) -> String {
        let axes = ["x", "y", "z"];
        (0..3)
            .filter(|a| self.flat[figure][*a])
            .map(|a| axes[a])
            .collect::<Vec<_>>()
            .join(", ")
    }
}

/// Which axes are missing throughout although another is not.
fn flat_axes(xyz: ndarray::ArrayView2<'_, f64>) -> [bool; 3] {
    let mut seen = [false; 3];
    for row in xyz.rows() {
        for (column, value) in row.iter().enumerate() {
            seen[column % 3] |= value.is_finite();
        }
        if seen == [true; 3] {
            break;
        }
    }
    seen.map(|one| !one && seen != [false; 3])
}

/// A name without its namespace: `mixamorig:LeftArm` is `LeftArm`.
fn bare(name: &str) -> &str {
    name.rsplit(':').next().unwrap_or(name)
}

/// Beginnings and ends of names that tell left from right.
const STARTS: [[&str; 2]; 5] = [
    ["Left", "Right"],
    ["left", "right"],
    ["LEFT", "RIGHT"],
    ["l", "r"],
    ["L", "R"],
];
const ENDS: [[&str; 2]; 4] = [["_l", "_r"], ["_L", "_R"], [".l", ".r"], [".L", ".R"]];

/// Left and right by name: a point `l...` is left if there is a point `r...`, and so on.
fn sides(points: &[String]) -> Vec<Side> {
    let known: HashSet<&str> = points.iter().map(|name| bare(name)).collect();
    let has_twin = |name: &str, own: usize| twins(name, own).any(|twin| known.contains(&*twin));
    let side = |name: &str| match (has_twin(name, 0), has_twin(name, 1)) {
        (true, false) => Side::Left,
        (false, true) => Side::Right,
        _ => Side::Middle,
    };
    points.iter().map(|name| side(bare(name))).collect()
}

/// A name with each mark of its side, left (0) or right (1), replaced by the other side's.
fn twins(name: &str, own: usize) -> impl Iterator<Item = String> + '_ {
    let starts = STARTS.iter().filter_map(move |pair| {
        let rest = name.strip_prefix(pair[own])?;
        Some(format!("{}{rest}", pair[1 - own]))
    });
    let ends = ENDS.iter().filter_map(move |pair| {
        let rest = name.strip_suffix(pair[own])?;
        Some(format!("{rest}{}", pair[1 - own]))
    });
    starts.chain(ends)
}

#[cfg(test)]
mod tests {
    use super::super::scene::tests::{names, scene};
    use super::*;
    use crate::scene::Figure;
    use ndarray::{Array2, array};

    #[test]
    fn sides_need_a_twin() {
        use Side::*;
        let points = "root lfoot rfoot lowerback m:LeftArm m:RightArm".split(' ');
        let points = names(&points.collect::<Vec<_>>());
        assert_eq!(sides(&points), [Middle, Left, Right, Middle, Left, Right]);
        let points = names(&["hand_l", "hand_r", "rest"]);
        assert_eq!(sides(&points), [Left, Right, Middle]);
    }

    #[test]
    fn a_body_that_faces_z_is_seen_looking_to_the_right() {
        let points = names(&["lfoot", "rfoot"]);
        let xyz = array![[10.0, 0.0, 0.0, -10.0, 0.0, 0.0]]; // y up: left of +z is +x
        let azimuth = SceneGeometry::of(&scene(&points, &xyz)).azimuth();
        assert!((azimuth + 55.0).abs() <= 1e-9, "{azimuth}");
        // From there the screen's right is (cos, -sin) of the azimuth in (x, z): +z points right.
        assert!(-azimuth.to_radians().sin() > 0.0);
    }

    #[test]
    fn ground_and_size_come_from_the_figure_that_misses_least() {
        let points = names(&["a", "b"]);
        let mut whole = Array2::zeros((4, 6));
        whole.column_mut(1).fill(2.0);
        whole.column_mut(4).fill(102.0);
        let mut torn = whole.clone();
        torn[[0, 0]] = f64::NAN;
        torn.column_mut(1).fill(-50.0);
        let mut scene = scene(&points, &torn);
        scene.figures.push(Figure::new("g", whole.view()));
        let geometry = SceneGeometry::of(&scene);
        assert_eq!(
            (geometry.reference, geometry.ground, geometry.size),
            (1, 2.0, 100.0)
        );
        assert_eq!(geometry.at(0, 0, 0), None);
    }

    #[test]
    fn an_outlier_does_not_move_the_middle() {
        let points = names(&["a", "b", "c"]);
        let xyz = array![[1.0, 0.0, 5.0, 2.0, 0.0, 6.0, 9e4, 0.0, 9e4]];
        let scene = scene(&points, &xyz);
        assert_eq!(SceneGeometry::of(&scene).middle(0), Some([2.0, 6.0]));
    }

    #[test]
    fn an_axis_missing_throughout_is_drawn_flat() {
        let points = names(&["a"]);
        let xyz = array![[1.0, 2.0, f64::NAN], [f64::NAN, 2.0, f64::NAN]];
        let scene = scene(&points, &xyz);
        let geometry = SceneGeometry::of(&scene);
        assert_eq!(geometry.at(0, 0, 0), Some([1.0, 2.0, 0.0]));
        assert_eq!(geometry.at(0, 1, 0), None);
        assert_eq!(geometry.flat_axes(0), "z");
    }
}
