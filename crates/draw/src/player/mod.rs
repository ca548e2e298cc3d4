//! One self-contained HTML page that plays a scene: nothing is fetched, the motion is inside.
//!
//! The page carries the scene as JSON.
//! A content security policy lets the browser run the page's own script and nothing else.

mod embedded;
pub mod mesh;
#[doc(hidden)]
pub mod parts;
mod table;

use crate::html::{self, escape, fill, script_json};
use crate::scene::{Scene, Table};
use crate::scene_geometry::SceneGeometry;
use crate::{Error, Result};
use embedded::{embedded, sparing};
use parts::{PAPER, Part, parts};
use std::sync::LazyLock;

const PAGE: &str = include_str!("page.html");
const PART: &str = include_str!("part.html");
const KEYS: &str = include_str!("keys.html");
const LINKS: &str = include_str!("links.html");
const TRAIL: &str = include_str!("trail.html");
const CURVES: &str = include_str!("curves.html");
const DIFFERENCES: &str = include_str!("differences.html");
/// What the list of keys and links says of poses alone.
const OWN_KEYS: &str = "<dt>hover, click</dt><dd>name a point; leave its trail</dd>";
const OWN_LINKS: &str = "<code>&amp;trail=NAME</code>, ";
/// What they say of two takes, which begin over each other.
const PAIR_LINKS: &str = "<code>&amp;beside</code>, <code>&amp;trail=NAME</code>, ";
/// What it says of curves, which a player in a report has not.
const CURVE_KEYS: &str = "<dt>click, drag in curves</dt><dd>go to that time</dd>";
const PAGE_STYLE: &str = concat!(
    include_str!("player.css"),
    include_str!("page.css"),
    include_str!("curves.css"),
);
/// The script of all players of a page.
#[doc(hidden)]
pub static SCRIPT: LazyLock<String> = LazyLock::new(|| {
    let player = parts(&[Part::Controls]);
    let start = include_str!("start.js");
    format!("{PAPER}\nfunction player(root, scene) {{{player}}}\n{start}")
});

/// The page that plays a scene: HTML, complete in itself, the same bytes for the same scene. It has
/// one frame of every `every`; `None`: as many as 24 MB of coordinates allow.
///
/// ```
/// use posing_draw::{player, scene::{Figure, Scene}};
///
/// let points = ["hip", "knee"].map(String::from);
/// let xyz = ndarray::array![[0.0, 90.0, 0.0, 0.0, 45.0, 5.0], [0.0, 90.0, 0.0, 0.0, 45.0, -5.0]];
/// let figures = vec![Figure::new("a leg", xyz.view())];
/// let (title, bones, rate) = ("A swing", &[(0, 1)][..], 30.0);
/// let scene = Scene { title, points: &points, bones, rate, figures, ..Scene::default() };
/// let page = player::page(&scene, None)?;
/// assert!(page.contains("<title>A swing</title>"));
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// [`Error::Usage`]: a rate that is not above 0, a bone without its points, figures of different
/// shapes, runs out of order; `every` is 0.
pub fn page(scene: &Scene<'_>, every: Option<usize>) -> Result<String> {
    let (differences, links) = match scene.pair {
        Some(_) => (DIFFERENCES, PAIR_LINKS),
        None => ("", OWN_LINKS),
    };
    let below = format!("{CURVES}{differences}");
    let (player, remarks) = player_and_remarks(scene, every, " data-alone", &below)?;
    Ok(whole_page(&Page {
        title: scene.title,
        note: scene.note,
        table: scene.table.as_ref(),
        credit: scene.credit,
        player: &player,
        remarks: &remarks,
        keys: &format!("{OWN_KEYS}\n{CURVE_KEYS}"),
        links,
        style: PAGE_STYLE,
        script: &SCRIPT,
    }))
}

/// What a page with one player is made of. The player and the remarks are HTML, as are the entries
/// of its own in the list of keys and links; the first three are text.
struct Page<'a> {
    title: &'a str,
    note: Option<&'a str>,
    credit: Option<&'a str>,
    table: Option<&'a Table>,
    player: &'a str,
    remarks: &'a str,
    keys: &'a str,
    links: &'a str,
    style: &'a str,
    script: &'a str,
}

/// The HTML of a page.
fn whole_page(page: &Page<'_>) -> String {
    let title = escape(if page.title.is_empty() {
        "Motion"
    } else {
        page.title
    });
    let note = page
        .note
        .map(|note| format!("<p>{}</p>", escape(note)))
        .unwrap_or_default();
    let links = fill(LINKS, &[("own", page.links)]);
    html::page(
        PAGE,
        page.style,
        page.script,
        &[
            ("title", &title),
            ("note", &note),
            ("remarks", page.remarks),
            ("table", &page.table.map(table::html).unwrap_or_default()),
            ("credit", &escape(page.credit.unwrap_or_default())),
            ("player", page.player),
            (
                "keys",
                &fill(KEYS, &[("own", page.keys), ("links", &links)]),
            ),
        ],
    )
}

/// A player to stand among others on a page that has `player.css`, [`keys`] and, at its end,
/// [`SCRIPT`]. A scene of one frame is drawn as SVG, without the controls.
///
/// # Errors
/// As [`page`].
#[doc(hidden)]
pub fn part(scene: &Scene<'_>) -> Result<String> {
    Ok(player_and_remarks(scene, None, "", "")?.0)
}

/// The list of keys that all players of a page share.
#[doc(hidden)]
pub fn keys() -> String {
    fill(KEYS, &[("own", OWN_KEYS), ("links", "")])
}

/// The player with its scene and these curves below the figures, and the remarks below it.
fn player_and_remarks(
    scene: &Scene<'_>,
    every: Option<usize>,
    attributes: &str,
    curves: &str,
) -> Result<(String, String)> {
    scene.check()?;
    if every == Some(0) {
        return Err(Error::usage("every 0th frame: must be at least 1"));
    }
    let geometry = SceneGeometry::of(scene);
    let every = every.unwrap_or_else(|| sparing(scene));
    let kept: Vec<usize> = (0..scene.frames()).step_by(every).collect();
    let data = script_json(&embedded(scene, &geometry, &kept, every));
    let values = [
        ("attributes", attributes),
        ("more", TRAIL),
        ("below", curves),
        ("scene", &data),
    ];
    Ok((fill(PART, &values), remarks(scene, &geometry, every)))
}

/// Remarks on frames left out and on flat figures.
fn remarks(scene: &Scene<'_>, geometry: &SceneGeometry<'_, '_>, every: usize) -> String {
    let mut remarks = Vec::new();
    remarks.extend(scene.pair.iter().flat_map(|pair| pair.remarks.clone()));
    remarks.extend(frames_left_out(every, scene.frames()));
    for (figure, of) in scene.figures.iter().enumerate() {
        let flat = geometry.flat_axes(figure);
        if !flat.is_empty() {
            remarks.push(format!("{} has no {flat}: it is drawn flat.", of.name));
        }
    }
    paragraphs(&remarks)
}

/// The remark that the page has one frame of `every` only.
fn frames_left_out(every: usize, count: usize) -> Option<String> {
    (every > 1).then(|| {
        format!("One frame of every {every} is shown (there are {count}), to keep this page small.")
    })
}

/// Remarks as HTML.
fn paragraphs(remarks: &[String]) -> String {
    let paragraph = |text: &String| format!("<p class=\"remarks\">{}</p>\n", escape(text));
    remarks.iter().map(paragraph).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Status;
    use crate::scene::tests::{run, scene};
    use base64::prelude::{BASE64_STANDARD, Engine};
    use ndarray::Array2;
    use serde_json::{Value, json};

    fn names(count: usize) -> Vec<String> {
        (0..count).map(|i| format!("p{i}")).collect()
    }

    fn wave(frames: usize, points: usize, size: f64) -> Array2<f64> {
        Array2::from_shape_fn((frames, 3 * points), |(t, c)| {
            size * (t as f64 * 0.1 + c as f64).sin()
        })
    }

    /// The JSON between the page's own script tags, found as a browser would: up to the first
    /// `</script`.
    fn data(page: &str) -> Value {
        let (_, after) = page
            .split_once("<script type=\"application/json\">")
            .unwrap();
        serde_json::from_str(after.split("</script").next().unwrap()).unwrap()
    }

    /// What the script decodes.
    fn decoded(figure: &Value) -> Vec<f32> {
        let bytes = BASE64_STANDARD.decode(figure["data"].as_str().unwrap());
        let read = |b: &[u8]| f32::from_le_bytes(b.try_into().unwrap());
        bytes.unwrap().chunks(4).map(read).collect()
    }

    #[test]
    fn missing_stays_missing_and_the_rest_stays_put() {
        let points = names(4);
        let mut xyz = wave(50, 4, 200.0);
        xyz[[3, 4]] = f64::NAN;
        xyz[[4, 0]] = f64::INFINITY;
        let page = page(&scene(&points, &xyz), None).unwrap();
        let back = decoded(&data(&page)["figures"][0]);
        assert_eq!(back.len(), 600);
        for (i, (back, value)) in back.iter().zip(&xyz).enumerate() {
            let (frame, point) = (i / 12, i % 12 / 3);
            // One missing coordinate makes the whole point missing.
            match (frame, point) {
                (3, 1) | (4, 0) => assert!(back.is_nan()),
                _ => assert_eq!(*back, *value as f32),
            }
        }
    }

    #[test]
    fn hostile_text_stays_text() {
        let hostile = "</script><script>alert(1)</script><!-- \" {{script}} \u{0}";
        let points = vec![hostile.to_string()];
        let xyz = wave(2, 1, 1.0);
        let status = Array2::from_elem((2, 1), Status::Inferred);
        let runs = [run(hostile, 0, 0.0)];
        let table = Table {
            caption: hostile.into(),
            header: vec![hostile.into(), "n".into()],
            rows: vec![vec![hostile.into(), "1.5".into()]; 2],
            links: vec![hostile.into()],
        };
        let mut scene = Scene {
            title: hostile,
            runs: &runs,
            note: Some(hostile),
            table: Some(table),
            credit: Some(hostile),
            ..scene(&points, &xyz)
        };
        scene.figures[0].name = hostile;
        scene.figures[0].status = Some(status.view());
        let page = page(&scene, None).unwrap();
        assert_eq!(
            page.matches("<script").count(),
            2,
            "the scene and the program, nothing else"
        );
        assert_eq!(page.matches("</script").count(), 2);
        assert!(!page.contains("<script>alert") && !page.contains('\u{0}'));
        assert_eq!(data(&page)["figures"][0]["name"], hostile);
        assert_eq!(data(&page)["points"][0], hostile);
        assert!(page.contains("<td class=\"number\">1.5</td>"));
        assert!(
            page.contains("{{script}}"),
            "what looks like a placeholder is left as it is"
        );
    }

    #[test]
    fn nothing_is_fetched() {
        let page = page(
            &Scene {
                rate: 1.0,
                ..Scene::default()
            },
            None,
        )
        .unwrap();
        for loading in [
            "http://", "https://", "//cdn", "src=", "url(", "@import", "fetch(", "XMLHttp",
            "import(",
        ] {
            assert!(!page.contains(loading), "{loading}");
        }
        assert_eq!(page.matches("href=").count(), 1, "the empty icon");
        for source in [SCRIPT.as_str(), PAGE_STYLE] {
            assert!(
                page.contains(&html::policy_hash(source)),
                "the policy knows the page's own sources"
            );
            assert!(
                !source.to_lowercase().contains("</s"),
                "nothing in them ends them"
            );
        }
        assert!(!page.contains("{{"), "every placeholder is filled");
    }

    #[test]
    fn nothing_one_point_and_everything_missing_make_a_page() {
        let points = names(1);
        let nothing = Scene {
            rate: 1.0,
            ..Scene::default()
        };
        assert_eq!(data(&page(&nothing, None).unwrap())["frames"], 0);
        for xyz in [
            Array2::zeros((0, 3)),
            Array2::zeros((1, 3)),
            Array2::from_elem((3, 3), f64::NAN),
        ] {
            let page = page(&scene(&points, &xyz), None).unwrap();
            let data = data(&page);
            assert_eq!(data["frames"], xyz.nrows());
            assert_eq!(decoded(&data["figures"][0]).len(), xyz.len());
            // No number of the page is missing.
            assert!(!page.contains("null,null"));
        }
    }

    #[test]
    fn every_few_frames_are_embedded_and_the_page_says_so() {
        let points = names(10);
        let xyz = wave(1000, 10, 100.0);
        let runs = [run("a", 0, 0.0), run("short", 499, 7.0), run("b", 500, 1.0)];
        let scene = Scene {
            runs: &runs,
            ..scene(&points, &xyz)
        };
        let whole = page(&scene, None).unwrap();
        assert_eq!(data(&whole)["every"], 1);
        assert_eq!(data(&whole)["frames"], 1000);
        assert!(!whole.contains("to keep this page small"));
        assert_eq!(whole, page(&scene, None).unwrap());
        let small = page(&scene, Some(4)).unwrap();
        let embedded = data(&small);
        assert_eq!(
            (&embedded["every"], &embedded["frames"]),
            (&json!(4), &json!(250))
        );
        assert_eq!(embedded["rate"], 15.0);
        let runs = json!([["a", 0, 0.0, 15.0], ["b", 125, 1.0, 15.0]]);
        assert_eq!(embedded["runs"], runs);
        assert!(small.contains("One frame of every 4 is shown (there are 1000)"));
        assert!(page(&scene, Some(0)).is_err());
    }
}
