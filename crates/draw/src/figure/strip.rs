//! Rows of small stick figures: a pose, and those found for it.

use super::shapes::{At, INK, LEFT, PALE, RIGHT, n, stick};
use crate::html::escape;
use crate::scene::Status;
use glam::DVec3;

/// Width and height of a figure's box, of the two lines under it, and of those over all, px.
const WIDE: f64 = 116.0;
const HIGH: f64 = 140.0;
const TEXT: f64 = 38.0;
const HEAD: f64 = 58.0;
/// Room beside the queries.
const APART: f64 = 16.0;
/// The narrowest picture: that of its heading.
const LEAST: f64 = 400.0;
/// Pixels a body height, and the height of the hip in the box.
const SCALE: f64 = 88.0;
const HIP: f64 = 74.0;
/// Characters under a figure.
const CAPTION: usize = 15;
/// Looks of what is right and what is wrong: edge and fill. They are told by more than color.
const RIGHT_EDGE: [&str; 2] = ["#2a8f5b", "#f2faf5"];
const WRONG_EDGE: [&str; 2] = ["#cf1039", "#fdf3f4"];
const DASHES: &str = " stroke-dasharray=\"4 3\"";

/// A pose of a row.
#[derive(Debug, Clone)]
pub struct StripPose {
    /// Its joints in the body's frame, body heights.
    pub joints: Vec<DVec3>,
    /// What stands under it, such as its take and its frame.
    pub captions: [String; 2],
    /// How far it is from the query; `None` of a query.
    pub distance: Option<f32>,
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

/// Rows of poses as SVG: a query and those found for it, nearest first, with rank and distance.
/// Poses are seen from the front, turned a little.
pub fn strip(rows: &[Vec<StripPose>], joints: StripJoints<'_>) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let wide = (columns * WIDE + APART).max(LEAST);
    let high = HEAD + rows.len() as f64 * (HIGH + TEXT);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" \
         height=\"{1}\" role=\"img\" aria-label=\"Poses and those found for them\" \
         font-family=\"system-ui, 'Segoe UI', Helvetica, Arial, sans-serif\" font-size=\"12\" \
         fill=\"{INK}\">\n<rect width=\"{0}\" height=\"{1}\" fill=\"#fff\"/>\n",
        n(wide),
        n(high)
    );
    out += &heading(rows);
    for (r, row) in rows.iter().enumerate() {
        for (k, pose) in row.iter().enumerate() {
            let apart = if k > 0 { APART } else { 0.0 };
            let corner = [k as f64 * WIDE + apart, HEAD + r as f64 * (HIGH + TEXT)];
            out += &panel(pose, joints, corner, k);
        }
    }
    out + "</svg>\n"
}

/// What the columns are, and what colors and edges mean.
fn heading(rows: &[Vec<StripPose>]) -> String {
    let title = |x: f64, text: &str| {
        let (x, y) = (n(x), n(HEAD - 10.0));
        format!("<text x=\"{x}\" y=\"{y}\" font-size=\"13\" font-weight=\"600\">{text}</text>\n")
    };
    let found = WIDE + APART + 3.0;
    let mut out = title(3.0, "Query") + &title(found, "Found, nearest first: rank, distance");
    let mut x = 3.0;
    let mut entry = |sign: String, text: &str| {
        out += &format!(
            "<g transform=\"translate({} 20)\">{sign}<text x=\"19\" \
             fill=\"{PALE}\">{text}</text></g>\n",
            n(x)
        );
        x += 34.0 + 6.5 * text.len() as f64;
    };
    for (color, text) in [(LEFT, "left"), (RIGHT, "right")] {
        let line = format!("<path d=\"M0 -4h13\" stroke=\"{color}\" stroke-width=\"3\"/>");
        entry(line, text);
    }
    let judged = |is_right| {
        rows.iter()
            .flatten()
            .any(|pose| pose.is_right == Some(is_right))
    };
    let boxed = |[edge, fill]: [&str; 2], dashes: &str| {
        format!(
            "<rect y=\"-10\" width=\"13\" height=\"12\" rx=\"2\" fill=\"{fill}\" \
             stroke=\"{edge}\"{dashes}/>"
        )
    };
    if judged(true) || judged(false) {
        entry(boxed(RIGHT_EDGE, ""), "of the query's class");
        entry(boxed(WRONG_EDGE, DASHES), "of another class");
    }
    out
}

/// A pose in its box; the query has rank 0.
fn panel(pose: &StripPose, joints: StripJoints<'_>, [x, y]: At, rank: usize) -> String {
    let ([edge, fill], dashes) = match (rank, pose.is_right) {
        (0, _) => ([INK, "#f3f5f7"], ""),
        (_, Some(true)) => (RIGHT_EDGE, ""),
        (_, Some(false)) => (WRONG_EDGE, DASHES),
        (_, None) => (["#c9d0d7", "#fff"], ""),
    };
    let mut out = format!(
        "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"4\" fill=\"{fill}\" \
         stroke=\"{edge}\"{dashes}/>\n",
        n(x + 3.0),
        n(y + 3.0),
        n(WIDE - 6.0),
        n(HIGH - 6.0)
    );
    out += &body(pose, joints, [x, y]);
    let text = |[x, y]: At, look: &str, text: &str| {
        format!(
            "<text x=\"{}\" y=\"{}\" {look}>{}</text>\n",
            n(x),
            n(y),
            escape(text)
        )
    };
    if let Some(distance) = pose.distance {
        let pale = format!("text-anchor=\"end\" fill=\"{PALE}\"");
        out += &text(
            [x + 10.0, y + 18.0],
            "font-weight=\"600\"",
            &rank.to_string(),
        );
        out += &text([x + WIDE - 9.0, y + 18.0], &pale, &three_digits(distance));
    }
    let looks = [
        String::from("font-weight=\"600\""),
        format!("fill=\"{PALE}\""),
    ];
    for (line, (caption, look)) in pose.captions.iter().zip(looks).enumerate() {
        let at = [x + WIDE / 2.0, y + HIGH + 10.0 + 15.0 * line as f64];
        let look = format!("text-anchor=\"middle\" {look}");
        out += &text(at, &look, &captioned(caption));
    }
    out
}

/// The bones of a pose in a box.
fn body(pose: &StripPose, joints: StripJoints<'_>, [x, y]: At) -> String {
    let (sin, cos) = 0.5_f64.sin_cos();
    let at = |p: DVec3| -> At {
        // Seen from the front, the body's left is on the right.
        [
            x + WIDE / 2.0 + SCALE * (cos * p.x + sin * p.z),
            y + HIP - SCALE * (p.y - 0.12 * (cos * p.z - sin * p.x)),
        ]
    };
    let mut out = String::new();
    for j in 1..pose.joints.len() {
        let (a, b) = (pose.joints[joints.parents[j]], pose.joints[j]);
        if a.is_finite() && b.is_finite() {
            let color = match joints.names[j].as_bytes()[0] {
                b'L' => LEFT,
                b'R' => RIGHT,
                _ => INK,
            };
            let ends = [Status::Observed, Status::Observed];
            out += &stick(at(a), at(b), color, 3.0, ends, false);
        }
    }
    out
}

/// A name of at most [`CAPTION`] characters: the ends of long ones tell them apart.
fn captioned(text: &str) -> String {
    let count = text.chars().count();
    if count <= CAPTION {
        return text.into();
    }
    let (start, end) = (CAPTION / 3, CAPTION - CAPTION / 3 - 1);
    let last = text.chars().skip(count - end);
    text.chars().take(start).chain(['…']).chain(last).collect()
}

/// A number in three digits.
fn three_digits(value: f32) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let whole = value.abs().max(1e-6).log10().floor() as i32;
    let decimals = (2 - whole).clamp(0, 6) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_drawn_and_names_are_escaped() {
        let pose = |caption: &str, is_right: Option<bool>| StripPose {
            joints: vec![DVec3::new(0.1, 0.2, 0.0); 4],
            captions: [caption.into(), "frame 7".into()],
            distance: is_right.map(|_| 0.012_34),
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
        // Each pose and its legend are boxes, beside that of all.
        assert_eq!(svg.matches("<rect").count(), 6);
        assert_eq!(svg.matches("dasharray=\"4 3\"").count(), 2);
        assert_eq!(
            svg.matches(">0.0123<").count(),
            2,
            "distances of what was found"
        );
        assert_eq!(svg.matches(">frame 7<").count(), 3);
        assert!(svg.contains(">Query<") && svg.contains("of another class"));
        let plain = strip(&[vec![pose("b", None)]], joints);
        assert!(!plain.contains("class") && !plain.contains(">0.0"));
    }

    #[test]
    fn a_long_name_keeps_its_ends() {
        assert_eq!(captioned("07_01"), "07_01");
        let long = captioned("S01_walking_fast_trial_03");
        assert_eq!((&*long, long.chars().count()), ("S01_w…_trial_03", CAPTION));
    }

    #[test]
    fn distances_have_three_digits() {
        let texts = [0.0, 0.001_234, 1.459_3, 23.44, 1234.4].map(three_digits);
        assert_eq!(texts, ["0", "0.00123", "1.46", "23.4", "1234"]);
    }
}
