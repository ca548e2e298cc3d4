//! Rows of small stick figures: a pose, and those found for it.

use super::shapes::{At, n, shortened};
use crate::html::escape;
use crate::scene::Status;
use glam::DVec3;

/// Width and height of a figure's box, and of the text under it, px.
const WIDE: f64 = 96.0;
const HIGH: f64 = 132.0;
const TEXT: f64 = 16.0;
/// Pixels a body height, and the height of the hip in the box.
const SCALE: f64 = 88.0;
const HIP: f64 = 66.0;
/// Characters under a figure.
const CAPTION: usize = 17;

/// A pose of a row.
#[derive(Debug, Clone)]
pub struct StripPose {
    /// Its joints in the body's frame, body heights.
    pub joints: Vec<DVec3>,
    /// What stands under it.
    pub caption: String,
    /// Whether it is right; `None` for one that is not judged.
    pub is_right: Option<bool>,
}

/// The joints of a row's poses: a left one's name begins with L, a right one's with R.
#[derive(Debug, Clone, Copy)]
pub struct StripJoints<'a> {
    /// The names.
    pub names: &'a [&'a str],
    /// The parent of each; the first joint has none.
    pub parents: &'a [usize],
}

/// Rows of poses as SVG; the first of each row stands apart. Poses are seen from the front, turned
/// a little.
pub fn strip(rows: &[Vec<StripPose>], joints: StripJoints<'_>) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let (wide, high) = (columns * WIDE + 12.0, rows.len() as f64 * (HIGH + TEXT));
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" \
         height=\"{1}\" role=\"img\" aria-label=\"Poses and those found for them\" \
         font-family=\"sans-serif\" font-size=\"10\">\n<rect width=\"{0}\" height=\"{1}\" \
         fill=\"#fff\"/>\n",
        n(wide),
        n(high)
    );
    for (r, row) in rows.iter().enumerate() {
        for (k, pose) in row.iter().enumerate() {
            let apart = if k > 0 { 12.0 } else { 0.0 };
            let corner = [k as f64 * WIDE + apart, r as f64 * (HIGH + TEXT)];
            out += &panel(pose, joints, corner, k == 0);
        }
    }
    out + "</svg>\n"
}

fn panel(pose: &StripPose, joints: StripJoints<'_>, [x, y]: At, is_query: bool) -> String {
    let (edge, fill) = match (is_query, pose.is_right) {
        (true, _) => ("#39424e", "#f3f5f7"),
        (_, Some(true)) => ("#2a8f5b", "#f2faf5"),
        (_, Some(false)) => ("#cf1039", "#fdf3f4"),
        (_, None) => ("#c9d0d7", "#fff"),
    };
    // Right and wrong are told by more than color.
    let dashes = match pose.is_right {
        Some(false) => " stroke-dasharray=\"4 3\"",
        _ => "",
    };
    let mut out = format!(
        "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"4\" fill=\"{fill}\" \
         stroke=\"{edge}\"{dashes}/>\n",
        n(x + 3.0),
        n(y + 3.0),
        n(WIDE - 6.0),
        n(HIGH - 6.0)
    );
    let (sin, cos) = 0.5_f64.sin_cos();
    let at = |p: DVec3| -> At {
        // Seen from the front, the body's left is on the right.
        [
            x + WIDE / 2.0 + SCALE * (cos * p.x + sin * p.z),
            y + HIP - SCALE * (p.y - 0.12 * (cos * p.z - sin * p.x)),
        ]
    };
    for j in 1..pose.joints.len() {
        let (a, b) = (pose.joints[joints.parents[j]], pose.joints[j]);
        if a.is_finite() && b.is_finite() {
            let color = match joints.names[j].as_bytes()[0] {
                b'L' => super::shapes::LEFT,
                b'R' => super::shapes::RIGHT,
                _ => super::shapes::INK,
            };
            let ends = [Status::Observed, Status::Observed];
            out += &super::shapes::stick(at(a), at(b), color, 3.0, ends, false);
        }
    }
    out + &format!(
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\" fill=\"#39424e\">{}</text>\n",
        n(x + WIDE / 2.0),
        n(y + HIGH + 8.0),
        escape(&shortened(&pose.caption, CAPTION))
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_drawn_and_names_are_escaped() {
        let pose = |caption: &str, is_right| StripPose {
            joints: vec![DVec3::new(0.1, 0.2, 0.0); 4],
            caption: caption.into(),
            is_right,
        };
        let mut lacking = pose("c", Some(false));
        lacking.joints[3] = DVec3::NAN;
        let joints = StripJoints {
            names: &["Hip", "Chest", "LHip", "RHip"],
            parents: &[0, 0, 0, 0],
        };
        let row = vec![pose("a<b", None), pose("b", Some(true)), lacking];
        let svg = strip(&[row], joints);
        assert!(svg.contains("a&lt;b") && !svg.contains("NaN"));
        assert_eq!(svg.matches("<rect").count(), 4);
        assert_eq!(svg.matches("dasharray=\"4 3\"").count(), 1);
    }
}
