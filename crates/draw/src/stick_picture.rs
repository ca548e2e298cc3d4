//! One pose as a small picture: the paths of its bones in a box, few bytes each.

use super::scene::{Figure, Scene};
use super::scene_geometry::{SceneGeometry, Side};
use ndarray::ArrayView2;
use std::fmt::Write;

/// The width and the height of the box.
pub const BOX: f64 = 64.0;
/// Room around what is drawn: half a line.
const ROOM: f64 = 2.0;

/// The paths of a pose (1, 3 points), cm, y up, for SVG in a box of [`BOX`] by [`BOX`]: the middle
/// of the body, its left and its right. Points are drawn where there are no `bones`; `None` where
/// nothing is seen.
pub fn stick_picture(
    points: &[String],
    bones: &[(usize, usize)],
    pose: ArrayView2<'_, f64>,
) -> Option<[String; 3]> {
    let figures = vec![Figure::new("", pose)];
    let scene = Scene {
        points,
        figures,
        ..Scene::default()
    };
    let geometry = SceneGeometry::of(&scene);
    let (sin, cos) = geometry.azimuth().to_radians().sin_cos();
    let at: Vec<Option<[f64; 2]>> = (0..points.len())
        .map(|p| (geometry.at(0, 0, p)).map(|[x, y, z]| [x * cos - z * sin, y]))
        .collect();
    let extent = |axis: usize| {
        let seen = at.iter().flatten().map(|v| v[axis]);
        let low = seen.clone().fold(f64::INFINITY, f64::min);
        [low, seen.fold(f64::NEG_INFINITY, f64::max)]
    };
    let [[left, right], [low, high]] = [extent(0), extent(1)];
    let scale = (BOX - 2.0 * ROOM) / (right - left).max(high - low).max(1.0);
    let on_paper = |[x, y]: [f64; 2]| {
        let x = BOX / 2.0 + scale * (x - (left + right) / 2.0);
        let y = BOX - ROOM - scale * (y - low);
        format!("{x:.0} {y:.0}")
    };
    let mut paths: [String; 3] = Default::default();
    let path_of = |side| match side {
        Side::Middle => 0,
        Side::Left => 1,
        Side::Right => 2,
    };
    // Where each path has come to.
    let mut pens = [usize::MAX; 3];
    for (a, b) in bones {
        let (Some(from), Some(to)) = (at[*a], at[*b]) else {
            continue;
        };
        let own = path_of(geometry.bone_side((*a, *b)));
        let path = &mut paths[own];
        // Writing to memory cannot fail.
        if pens[own] != *a {
            let _ = write!(path, "M{}", on_paper(from));
        }
        let _ = write!(path, "L{}", on_paper(to));
        pens[own] = *b;
    }
    if bones.is_empty() {
        // A line of no length with round ends is a dot.
        for (p, at) in at.iter().enumerate() {
            let path = &mut paths[path_of(geometry.sides[p])];
            let _ = at.map(|at| write!(path, "M{}h0", on_paper(at)));
        }
    }
    paths.iter().any(|path| !path.is_empty()).then_some(paths)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn bones_are_paths_by_sides_and_points_without_bones_are_dots() {
        let points = ["root", "lknee", "rknee", "lfoot"].map(String::from);
        let pose = array![[
            0.0, 100.0, 0.0, 10.0, 50.0, 0.0, -10.0, 50.0, 0.0, 10.0, 0.0, 0.0
        ]];
        let bones = [(0, 1), (1, 3), (0, 2)];
        let [middle, left, right] = stick_picture(&points, &bones, pose.view()).unwrap();
        assert!(middle.is_empty());
        // From the root to the knee and on to the foot in one go.
        assert_eq!(
            (left.matches('M').count(), left.matches('L').count()),
            (1, 2)
        );
        assert!(
            left.ends_with(" 62") && right.starts_with("M32 2L"),
            "{left} {right}"
        );
        let dots = stick_picture(&points, &[], pose.view()).unwrap().concat();
        assert_eq!(dots.matches("h0").count(), 4);
        let nothing = array![[f64::NAN; 12]];
        assert_eq!(stick_picture(&points, &bones, nothing.view()), None);
    }
}
