//! One self-contained HTML page on which a person labels pairs of poses as alike or not.
//!
//! Each pair is shown in motion: the two takes around the labeled frames, one over the other, and
//! the cut from one to the other. The page carries the motion as JSON, keeps the answers in the
//! browser, and saves them as CSV.

mod motion;

use crate::draw::html::{self, escape, script_json};
use crate::draw::player::parts::{self, PAPER, Part, parts};
use crate::joint_map::{JOINTS, PARENTS, joint};
use crate::pair_proposal::{ProposedPair, TakeFrame};
use base64::prelude::{BASE64_STANDARD, Engine};
use glam::DVec3;
pub use motion::Motion;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::sync::LazyLock;

const PAGE: &str = include_str!("page.html");
static STYLE: LazyLock<String> =
    LazyLock::new(|| [parts::STYLE, parts::PAGE_STYLE, include_str!("label.css")].concat());
static SCRIPT: LazyLock<String> = LazyLock::new(|| {
    let view = parts(&[Part::View]);
    let (show, label) = (include_str!("show.js"), include_str!("label.js"));
    format!(
        "{PAPER}\n\
        function view(scene) {{{view}return {{ camera, path, readInk, drawPanel }};\n\
        }}\n{show}{label}"
    )
});
/// What stands for a missing coordinate.
const MISSING: i16 = i16::MIN;

/// The page that shows `pairs` of `takes`, each through `seconds` before and after its frames;
/// bodies are `height` cm high from the ankles to the head. The same bytes for the same pairs.
pub fn page(
    title: &str,
    takes: &[Motion],
    pairs: &[ProposedPair],
    seconds: f64,
    height: f64,
) -> String {
    let title = match title {
        "" => "Alike or not?",
        title => title,
    };
    let data = script_json(&embedded(takes, pairs, seconds, height));
    let values = [("title", &*escape(title)), ("data", &data)];
    html::page(PAGE, &STYLE, &SCRIPT, &values)
}

/// Everything the script reads.
fn embedded(takes: &[Motion], pairs: &[ProposedPair], seconds: f64, height: f64) -> Value {
    let pose = |at: TakeFrame| {
        let take = &takes[at.take];
        json!([take.name, at.frame, round(take.time(at.frame), 3)])
    };
    let pair = |pair: &ProposedPair| {
        let [a, b] = [pair.a, pair.b].map(|at| takes[at.take].around(at.frame, seconds));
        let cut = motion::cut(&a, &b);
        let motion = [a, b, cut].map(|poses| encoded(&poses));
        json!({
            "a": pose(pair.a),
            "b": pose(pair.b),
            "distance": round(pair.distance, 1),
            "motion": motion,
        })
    };
    let ids: Vec<Value> = (pairs.iter())
        .map(|p| {
            json!([
                takes[p.a.take].name,
                p.a.frame,
                takes[p.b.take].name,
                p.b.frame
            ])
        })
        .collect();
    let digest = Sha256::digest(json!(ids).to_string().as_bytes());
    let digest: String = digest[..8].iter().map(|b| format!("{b:02x}")).collect();
    json!({
        "digest": digest,
        "points": JOINTS,
        "sides": JOINTS.map(side).concat(),
        "bones": (1..16).map(|j| [PARENTS[j], j]).collect::<Vec<_>>(),
        "head": joint::HEAD,
        "rate": motion::RATE,
        "frames": motion::samples(seconds),
        "fade": motion::FADE,
        "size": round(height, 1),
        "pairs": pairs.iter().map(pair).collect::<Vec<_>>(),
    })
}

/// The side of the body that a joint is on: l, r or m.
fn side(joint: &str) -> &'static str {
    let mut letters = joint.chars();
    let (first, second) = (letters.next(), letters.next());
    match (first, second.is_some_and(char::is_uppercase)) {
        (Some('L'), true) => "l",
        (Some('R'), true) => "r",
        _ => "m",
    }
}

/// Base64 of x, y, z of each joint, frame after frame: little-endian 16-bit integers, mm.
fn encoded(poses: &[[DVec3; 16]]) -> String {
    let number = |v: f64| match (10.0 * v).round() {
        mm if mm.abs() < f64::from(i16::MAX) => mm as i16,
        _ => MISSING,
    };
    let all = poses.iter().flatten().flat_map(|p| p.to_array());
    let bytes: Vec<u8> = all.flat_map(|v| number(v).to_le_bytes()).collect();
    BASE64_STANDARD.encode(bytes)
}

fn round(value: f64, digits: i32) -> f64 {
    let scale = 10f64.powi(digits);
    (value * scale).round() / scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::JointMap;
    use crate::pose::Poses;
    use ndarray::Array2;

    fn take(name: &str) -> Motion {
        let poses = Poses {
            points: JOINTS.map(String::from).into(),
            xyz: Array2::from_shape_fn((60, 48), |(t, c)| (t * c % 97) as f64),
            ..Poses::default()
        };
        let own = JOINTS.map(|j| (j.to_string(), j.to_string()));
        Motion::new(name, &poses, &JointMap::new(own.into()).unwrap(), 30.0, 1.0).unwrap()
    }

    fn pair(frame: usize) -> ProposedPair {
        let at = |take, frame| TakeFrame { take, frame };
        ProposedPair {
            a: at(0, frame),
            b: at(1, 40),
            distance: 4.26,
        }
    }

    fn data(page: &str) -> Value {
        let (_, after) = page
            .split_once("<script type=\"application/json\">")
            .unwrap();
        serde_json::from_str(after.split("</script").next().unwrap()).unwrap()
    }

    #[test]
    fn the_page_carries_every_pair() {
        let takes = [take("a"), take("b")];
        let page = page("", &takes, &[pair(20), pair(30)], 0.5, 150.0);
        let data = data(&page);
        assert_eq!(data["frames"], 61);
        assert_eq!(data["sides"], "mmmmlllrrrlllrrr");
        let second = &data["pairs"][1];
        assert_eq!(second["a"], json!(["a", 30, 1.0]));
        assert_eq!(second["distance"], 4.3);
        for motion in second["motion"].as_array().unwrap() {
            let bytes = BASE64_STANDARD.decode(motion.as_str().unwrap()).unwrap();
            assert_eq!(bytes.len(), 61 * 48 * 2);
        }
    }

    #[test]
    fn answers_belong_to_the_pairs() {
        let takes = [take("a"), take("b")];
        let digest = |frame| data(&page("", &takes, &[pair(frame)], 0.5, 150.0))["digest"].clone();
        assert_eq!(digest(20), digest(20));
        assert_ne!(digest(20), digest(21));
    }

    #[test]
    fn missing_and_far_coordinates_are_marked() {
        let mut pose = [DVec3::new(1.0, -2.0, 0.04); 16];
        pose[0] = DVec3::new(f64::NAN, 1e9, -1e9);
        let bytes = BASE64_STANDARD.decode(encoded(&[pose])).unwrap();
        let read = |i: usize| i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
        let first: Vec<i16> = (0..6).map(read).collect();
        assert_eq!(first, [MISSING, MISSING, MISSING, 10, -20, 0]);
    }

    #[test]
    fn nothing_is_fetched_and_hostile_names_stay_text() {
        let hostile = "</script><script>alert(1)</script><!-- \" {{script}}";
        let page = page(
            hostile,
            &[take(hostile), take("b")],
            &[pair(20)],
            0.5,
            150.0,
        );
        assert_eq!(page.matches("<script").count(), 2);
        assert_eq!(page.matches("</script").count(), 2);
        assert_eq!(data(&page)["pairs"][0]["a"][0], hostile);
        for loading in [
            "http://", "https://", "src=", "url(", "@import", "fetch(", "XMLHttp",
        ] {
            assert!(!page.contains(loading), "{loading}");
        }
        for source in [SCRIPT.as_str(), STYLE.as_str()] {
            assert!(page.contains(&html::policy_hash(source)));
            assert!(!source.to_lowercase().contains("</s"));
        }
    }
}
