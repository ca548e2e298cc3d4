//! Computed points: those that a model or a force plate made, as their positions show it. No
//! camera measures a point that stays in one plane, or at right angles to others, to the last
//! digit.

mod axes;
mod plates;

use super::Poses;
use super::poses::point_at;
use super::zeros::Zeros;
use glam::DVec3;
use ndarray::ArrayView2;
use std::ops::Range;

/// More points are not tried: every pair is compared.
const MOST_POINTS: usize = 500;
/// Fewer frames show nothing.
const FEWEST_FRAMES: usize = 10;
/// What is equal to the last digit, cm. Single precision and four decimals leave 0.0003 of a
/// distance, the steadiest marker of a still take 0.002.
const EXACT: f64 = 5e-4;
/// Points that a note names.
const LISTED: usize = 3;
/// A point that moves less, cm, may be a thing that stands: its distances say nothing.
const MOVES: f64 = 1.0;

/// The indices of computed points among those of some poses, y up, in order: centers of pressure
/// and tips of forces, the axes of segments and what is fixed to them, a center of mass above its
/// projection. Of a table of joints, which are rigid to each other, no axes.
pub fn computed_points(poses: &Poses) -> Vec<usize> {
    if poses.frames() < FEWEST_FRAMES || poses.points.len() > MOST_POINTS {
        return Vec::new();
    }
    let all = spans(poses.xyz.view());
    let tracks = Tracks {
        names: &poses.points,
        xyz: poses.xyz.view(),
        spans: &all,
    };
    let mut found = plates::computed(tracks);
    let emptied = Zeros::emptied(poses);
    found.extend(axes::computed(Tracks {
        xyz: emptied.xyz.view(),
        spans: &spans(emptied.xyz.view()),
        ..tracks
    }));
    found.sort_unstable();
    found.dedup();
    found
}

/// What to say of computed points of these names; `None` if there are none.
pub fn computed_note(names: &[&str]) -> Option<String> {
    let some = names[..names.len().min(LISTED)].join(", ");
    match names.len() {
        0 => None,
        1 => Some(format!("{some} is computed, no marker: left alone")),
        n => {
            let more = if n > LISTED { ", …" } else { "" };
            let what = "points are computed, no markers: left alone";
            Some(format!("{n} {what} ({some}{more})"))
        }
    }
}

/// Points over time.
#[derive(Clone, Copy)]
struct Tracks<'a> {
    names: &'a [String],
    /// (frames, 3 P), cm, y up.
    xyz: ArrayView2<'a, f64>,
    /// From which frame to which each is seen: most tracks of many are seen for a short while.
    spans: &'a [Range<usize>],
}

/// The frames from the first to the last in which each point is seen.
fn spans(xyz: ArrayView2<'_, f64>) -> Vec<Range<usize>> {
    let of = |p: usize| {
        let is_seen = |t: &usize| point_at(xyz, *t, p).is_finite();
        let first = (0..xyz.nrows()).find(is_seen);
        let last = (0..xyz.nrows()).rev().find(is_seen);
        first
            .zip(last)
            .map_or(0..0, |(first, last)| first..last + 1)
    };
    (0..xyz.ncols() / 3).map(of).collect()
}

impl Tracks<'_> {
    fn frames(&self) -> usize {
        self.xyz.nrows()
    }

    fn points(&self) -> usize {
        self.xyz.ncols() / 3
    }

    /// A position; not finite where it is missing.
    fn at(&self, frame: usize, point: usize) -> DVec3 {
        point_at(self.xyz, frame, point)
    }

    /// A name in small letters, without the subject's prefix.
    fn own_name(&self, point: usize) -> String {
        let name = self.names[point].rsplit(':').next().unwrap_or_default();
        name.to_lowercase()
    }

    /// How far a point goes along each axis, in frames that `are_wanted`.
    fn extent(&self, point: usize, are_wanted: impl Fn(usize) -> bool) -> DVec3 {
        let positions = (0..self.frames()).filter(|t| are_wanted(*t));
        let positions = positions
            .map(|t| self.at(t, point))
            .filter(|x| x.is_finite());
        let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = positions.fold(start, |(low, high), x| (low.min(x), high.max(x)));
        (high - low).max(DVec3::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use ndarray::Array2;

    const FRAMES: usize = 120;

    /// What a camera adds, cm.
    fn jitter(t: usize, k: usize) -> DVec3 {
        let of = |c: usize| ((t * 7919 + k * 104_729 + c * 1_299_709) % 1000) as f64 / 1e3 - 0.5;
        DVec3::new(of(0), of(1), of(2)) * 0.02
    }

    /// Nine measured markers of a body that walks, the last three near the floor.
    fn marker(t: usize, k: usize) -> DVec3 {
        let time = t as f64 / 100.0;
        let height = [120.0, 110.0, 100.0, 90.0, 70.0, 50.0, 9.0, 4.0, 3.0][k];
        let swing = 6.0 * (5.0 * time + k as f64).sin();
        let side = (k as f64 * 2.0).sin() * 15.0;
        DVec3::new(120.0 * time + swing, height + 0.3 * swing.abs(), side) + jitter(t, k)
    }

    /// The axes of a segment in a frame: its turn by measured markers.
    fn turn(t: usize) -> DMat3 {
        let x = (marker(t, 0) - marker(t, 1)).normalize();
        let z = x.cross(marker(t, 2) - marker(t, 1)).normalize();
        DMat3::from_cols(x, z.cross(x), z)
    }

    /// The markers and further points.
    fn take(others: &[(&str, &dyn Fn(usize) -> DVec3)]) -> Poses {
        let mut points: Vec<String> = (0..9).map(|k| format!("M{k}")).collect();
        points.extend(others.iter().map(|(name, _)| name.to_string()));
        let position = |t: usize, p: usize| match p {
            0..9 => marker(t, p),
            p => others[p - 9].1(t),
        };
        // As files of single precision have it.
        let value = |(t, i): (usize, usize)| f64::from(position(t, i / 3)[i % 3] as f32);
        Poses {
            xyz: Array2::from_shape_fn((FRAMES, 3 * points.len()), value),
            points,
            ..Poses::default()
        }
    }

    fn found(poses: &Poses) -> Vec<&str> {
        let all = computed_points(poses).into_iter();
        all.map(|p| poses.points[p].as_str()).collect()
    }

    const IDLE: DVec3 = DVec3::new(23.0, 0.0, -25.0);

    fn pressure(t: usize) -> DVec3 {
        let position = DVec3::new(60.0 + 0.8 * t as f64, 0.0, 8.0 + 0.1 * (t as f64).sin());
        if (40..75).contains(&t) {
            position
        } else {
            IDLE
        }
    }

    #[test]
    fn what_plates_make_is_computed() {
        let tip = |t: usize| match pressure(t) {
            IDLE => IDLE,
            foot => foot + DVec3::new(3.0, 75.0 + 9.0 * (t as f64 / 5.0).sin(), 1.0),
        };
        let zero = |t: usize| {
            if pressure(t) == IDLE {
                DVec3::ZERO
            } else {
                pressure(t)
            }
        };
        let poses = take(&[("P1", &pressure), ("V1", &tip), ("P2", &zero)]);
        assert_eq!(found(&poses), ["P1", "V1", "P2"]);
        let empty = |t: usize| {
            if pressure(t) == IDLE {
                DVec3::NAN
            } else {
                pressure(t)
            }
        };
        assert_eq!(found(&take(&[("COP2", &empty), ("N", &empty)])), ["COP2"]);
    }

    #[test]
    fn markers_that_are_held_or_missing_are_none() {
        let held = |t: usize| marker(if (40..75).contains(&t) { 40 } else { t }, 7);
        let zero = |t: usize| {
            if (40..75).contains(&t) {
                DVec3::ZERO
            } else {
                marker(t, 8)
            }
        };
        let high = |t: usize| pressure(t) + DVec3::Y * 60.0;
        let still = |_: usize| DVec3::new(5.0, 0.0, 5.0);
        let on_path = |t: usize| DVec3::new(t.clamp(40, 75) as f64, 0.0, 5.0);
        let poses = take(&[
            ("COP", &held),
            ("B", &zero),
            ("C", &high),
            ("D", &still),
            ("E", &on_path),
        ]);
        assert_eq!(found(&poses), [""; 0]);
    }

    #[test]
    fn a_center_of_mass_stands_above_its_projection() {
        let mass = |t: usize| marker(t, 3) + jitter(t, 77);
        let floor = |t: usize| mass(t) * DVec3::new(1.0, 0.0, 1.0);
        let names = [("CenterOfMass", "F"), ("M9", "F")];
        for ((name, below), want) in names.into_iter().zip([&["CenterOfMass", "F"][..], &["F"]]) {
            assert_eq!(found(&take(&[(name, &mass), (below, &floor)])), want);
        }
    }

    #[test]
    fn axes_and_what_is_fixed_to_them_are_computed_and_their_markers_are_not() {
        let origin = |t: usize| marker(t, 4) + turn(t) * DVec3::new(1.0, 2.0, 3.0);
        let end = |t: usize, off: DVec3| origin(t) + turn(t) * off;
        let long = |t: usize| 20.0 + marker(t, 5).x.sin();
        let ends: [&dyn Fn(usize) -> DVec3; 3] = [
            &|t| end(t, DVec3::X * long(t)),
            &|t| end(t, DVec3::Y * long(t)),
            &|t| end(t, DVec3::Z * long(t)),
        ];
        let fixed: [&dyn Fn(usize) -> DVec3; 3] = [
            &|t| marker(t, 6) + turn(t) * DVec3::X * 5.0,
            &|t| marker(t, 6) + turn(t) * DVec3::Y * 5.0,
            &|t| marker(t, 6) + turn(t) * DVec3::Z * 5.0,
        ];
        let copy = |t: usize| marker(t, 6);
        let joint = |t: usize| marker(t, 6) + turn(t) * DVec3::new(4.0, -7.0, 2.0);
        // A knee is beside its joint center, on an axis.
        let knee = |t: usize| end(t, DVec3::Z * 5.6);
        let number = |t: usize| DVec3::Y * (2.0 + 0.01 * t as f64);
        let poses = take(&[
            ("KNE", &knee),
            ("TIBO", &origin),
            ("TIBA", ends[0]),
            ("TIBL", ends[1]),
            ("TIBP", ends[2]),
            ("X1", fixed[0]),
            ("X2", fixed[1]),
            ("X3", fixed[2]),
            ("X0", &copy),
            ("J", &joint),
            ("arch", &number),
        ]);
        let want = [
            "TIBO", "TIBA", "TIBL", "TIBP", "X1", "X2", "X3", "X0", "J", "arch",
        ];
        assert_eq!(found(&poses), want);
    }

    #[test]
    fn rigid_markers_and_joints_of_a_skeleton_are_not() {
        let cross =
            |off: DVec3, k: usize| move |t: usize| marker(t, 4) + turn(t) * off + jitter(t, k);
        let (a, b, c) = (
            cross(DVec3::X, 20),
            cross(DVec3::Y, 21),
            cross(DVec3::Z, 22),
        );
        let poses = take(&[
            ("LFEO", &|t| marker(t, 4)),
            ("LFEA", &a),
            ("LFEL", &b),
            ("LFEP", &c),
        ]);
        assert_eq!(found(&poses), [""; 0]);
        // Joints, all of which follow from rotations.
        let mut points = vec!["root".to_string()];
        points.extend("XYZOALP".chars().map(|axis| format!("joint{axis}")));
        let offs = [
            DVec3::ZERO,
            DVec3::X,
            DVec3::Y,
            DVec3::Z,
            DVec3::NEG_X,
            DVec3::NEG_Y,
            DVec3::NEG_Z,
            DVec3::ONE,
        ];
        let position = |t: usize, p: usize| marker(t, 4) + turn(t) * offs[p] * 10.0;
        let poses = Poses {
            xyz: Array2::from_shape_fn((FRAMES, 24), |(t, i)| position(t, i / 3)[i % 3]),
            points,
            ..Poses::default()
        };
        assert_eq!(found(&poses), [""; 0]);
    }

    #[test]
    fn takes_of_few_or_no_positions_show_nothing() {
        let mut poses = take(&[("COP", &pressure)]);
        poses.xyz.fill(f64::NAN);
        assert_eq!(found(&poses), [""; 0]);
        assert_eq!(computed_points(&Poses::default()), [0; 0]);
    }
}
