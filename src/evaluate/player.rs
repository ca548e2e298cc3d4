//! One self-contained HTML page that plays a scene: nothing is fetched, the motion is inside.
//!
//! The page carries the scene as JSON. Coordinates are base64 of little-endian numbers, frame after
//! frame: 16-bit steps between a column's least and greatest value (`-32768`: missing), or 32-bit floats
//! (NaN: missing) where such a step would show. Statuses are run lengths, point by point.
//! A content security policy lets the browser run the page's own script and nothing else.

use super::markup::{base64, escape, fill, script_json};
use super::scene::{Scene, Status, Table};
use super::stance::{Side, Stance};
use crate::{Error, Result};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

const PAGE: &str = include_str!("player.html");
const PART: &str = include_str!("player_part.html");
const KEYS: &str = include_str!("player_keys.html");
const LINKS: &str = include_str!("player_links.html");
const PAGE_STYLE: &str = concat!(include_str!("player.css"), include_str!("player_page.css"));
/// What brings every player of a page to life.
pub(super) const SCRIPT: &str = concat!(
    include_str!("player_paper.js"),
    "\nfunction player(root, scene) {",
    include_str!("player_view.js"),
    include_str!("player.js"),
    "}\n",
    include_str!("player_start.js"),
);

/// A step between neighbouring 16-bit values above this (cm) would be seen.
const COARSEST: f64 = 0.05;
/// The 16-bit value of what is missing.
const MISSING: i16 = i16::MIN;

/// What may be left out to keep the page small.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// Embed every how manieth frame; `None`: as few are left out as the limit allows.
    pub every: Option<usize>,
    /// The most bytes that the coordinates may take in the page, without `every`.
    pub limit: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            every: None,
            limit: 12_000_000,
        }
    }
}

impl Options {
    /// Fails on zero.
    pub fn check(&self) -> Result<()> {
        if self.every == Some(0) {
            return Err(Error::usage("every 0th frame: must be at least 1"));
        }
        if self.limit == 0 {
            return Err(Error::usage("a limit of 0 bytes: must be at least 1"));
        }
        Ok(())
    }
}

/// The page that plays a scene: HTML, complete in itself, the same bytes for the same scene.
///
/// # Errors
/// Usage, if [`Scene::check`] or [`Options::check`] fails.
pub fn page(scene: &Scene<'_>, options: &Options) -> Result<String> {
    let (player, remarks) = placed(scene, options, " data-alone")?;
    let title = escape(if scene.title.is_empty() {
        "Motion"
    } else {
        scene.title
    });
    let note = scene
        .note
        .map(|note| format!("<p>{}</p>", escape(note)))
        .unwrap_or_default();
    let table = scene.table.as_ref().map(html_table).unwrap_or_default();
    Ok(fill(
        PAGE,
        &[
            ("title", &title),
            ("note", &note),
            ("remarks", &remarks),
            ("table", &table),
            ("credit", &escape(scene.credit.unwrap_or_default())),
            ("player", &player),
            ("keys", &fill(KEYS, &[("links", LINKS)])),
            ("style", PAGE_STYLE),
            ("style-hash", &policy_hash(PAGE_STYLE)),
            ("script", SCRIPT),
            ("script-hash", &policy_hash(SCRIPT)),
        ],
    ))
}

/// A player to stand among others on a page that has `player.css`, [`keys`] and, at its end, [`SCRIPT`]. A scene of one frame
/// is drawn as SVG, without the controls.
///
/// # Errors
/// As [`page`].
pub(super) fn part(scene: &Scene<'_>, options: &Options) -> Result<String> {
    Ok(placed(scene, options, "")?.0)
}

/// The list of keys that all players of a page share.
pub(super) fn keys() -> String {
    fill(KEYS, &[("links", "")])
}

/// The player with its scene, and what must be admitted below it.
fn placed(scene: &Scene<'_>, options: &Options, attributes: &str) -> Result<(String, String)> {
    scene.check()?;
    options.check()?;
    let stance = Stance::of(scene);
    let every = options
        .every
        .unwrap_or_else(|| sparing(scene, options.limit));
    let kept: Vec<usize> = (0..scene.frames()).step_by(every).collect();
    let data = script_json(&embedded(scene, &stance, &kept, every));
    let values = [("attributes", attributes), ("scene", &data)];
    Ok((fill(PART, &values), remarks(scene, &stance, every)))
}

/// The smallest step through the frames that keeps the coordinates' base64 within the limit.
fn sparing(scene: &Scene<'_>, limit: usize) -> usize {
    let figures = scene.figures.len() as u128;
    let a_frame = figures * scene.points.len() as u128 * 3 * 2 * 4 / 3;
    let most = (limit as u128)
        .checked_div(a_frame)
        .unwrap_or(u128::MAX)
        .max(1);
    (scene.frames() as u128).div_ceil(most).max(1) as usize
}

/// Everything the script reads.
fn embedded(scene: &Scene<'_>, stance: &Stance<'_, '_>, kept: &[usize], every: usize) -> Value {
    let side = |side: &Side| match side {
        Side::Left => 'l',
        Side::Right => 'r',
        Side::Middle => 'm',
    };
    let figures: Vec<Value> = (0..scene.figures.len())
        .map(|figure| embedded_figure(scene, stance, kept, figure))
        .collect();
    json!({
        "points": scene.points,
        "bones": scene.bones,
        "sides": stance.sides.iter().map(side).collect::<String>(),
        "head": stance.head,
        "rate": scene.rate / every as f64,
        "every": every,
        "frames": kept.len(),
        "reference": stance.reference,
        "behind": scene.behind,
        "start": scene.start / every,
        "ground": rounded(stance.ground),
        "size": rounded(stance.size),
        "azimuth": rounded(stance.azimuth()),
        "runs": runs(scene, kept.len(), every),
        "figures": figures,
    })
}

/// Name, first embedded frame and its time of every run that has an embedded frame.
fn runs(scene: &Scene<'_>, kept: usize, every: usize) -> Vec<Value> {
    let first = |i: usize| scene.runs[i].first.div_ceil(every);
    (0..scene.runs.len())
        .filter(|i| first(*i) < kept)
        .filter(|i| i + 1 == scene.runs.len() || first(i + 1) > first(*i))
        .map(|i| {
            json!([
                scene.runs[i].name,
                first(i),
                rounded(scene.moment(first(i) * every).1)
            ])
        })
        .collect()
}

fn embedded_figure(
    scene: &Scene<'_>,
    stance: &Stance<'_, '_>,
    kept: &[usize],
    figure: usize,
) -> Value {
    let columns = 3 * scene.points.len();
    let mut values = Vec::with_capacity(kept.len() * columns);
    for frame in kept {
        for point in 0..scene.points.len() {
            values.extend(stance.at(figure, *frame, point).unwrap_or([f64::NAN; 3]));
        }
    }
    let mut coded = coordinates(&values, columns);
    coded["name"] = json!(scene.figures[figure].name);
    coded["note"] = json!(scene.notes.get(figure));
    coded["status"] = match scene.figures[figure].status {
        Some(_) => (0..scene.points.len())
            .map(|point| run_lengths(kept.iter().map(|t| stance.status(figure, *t, point))))
            .collect(),
        None => Value::Null,
    };
    coded
}

/// Rows of `columns` values as base64, and how to read it. NaN is missing.
fn coordinates(values: &[f64], columns: usize) -> Value {
    let mut low = vec![f64::INFINITY; columns];
    let mut high = vec![f64::NEG_INFINITY; columns];
    for (i, value) in values.iter().enumerate() {
        // min and max pass over NaN.
        low[i % columns] = low[i % columns].min(*value);
        high[i % columns] = high[i % columns].max(*value);
    }
    let low: Vec<f64> = low
        .iter()
        .map(|v| {
            if v.is_finite() {
                rounded(*v - 0.0005)
            } else {
                0.0
            }
        })
        .collect();
    let steps: Vec<f64> = (0..columns)
        .map(|c| ((high[c] - low[c]) / 65534.0).max(0.0))
        // Rounded up to a short decimal, so that the greatest value stays in range.
        .map(|step| (step * 1e8).ceil() / 1e8)
        .collect();
    if steps.iter().any(|step| *step > COARSEST) {
        let bytes: Vec<u8> = values
            .iter()
            .flat_map(|v| (*v as f32).to_le_bytes())
            .collect();
        return json!({ "format": "f32", "data": base64(&bytes) });
    }
    let code = |(i, value): (usize, &f64)| {
        if value.is_nan() {
            return MISSING;
        }
        let (low, step) = (low[i % columns], steps[i % columns]);
        let steps = if step > 0.0 {
            ((value - low) / step).round().clamp(0.0, 65534.0)
        } else {
            0.0
        };
        (steps - 32767.0) as i16
    };
    let bytes: Vec<u8> = values
        .iter()
        .enumerate()
        .map(code)
        .flat_map(i16::to_le_bytes)
        .collect();
    json!({ "format": "i16", "low": low, "step": steps, "data": base64(&bytes) })
}

/// Status and how often it follows itself, again and again.
fn run_lengths(statuses: impl Iterator<Item = Status>) -> Value {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for status in statuses {
        let code = Status::ALL.iter().position(|s| *s == status).unwrap_or(0);
        match runs.last_mut() {
            Some([last, length]) if *last == code => *length += 1,
            _ => runs.push([code, 1]),
        }
    }
    json!(runs.concat())
}

/// What the page must admit: frames left out, figures that are flat.
fn remarks(scene: &Scene<'_>, stance: &Stance<'_, '_>, every: usize) -> String {
    let mut said = Vec::new();
    if every > 1 {
        let count = scene.frames();
        said.push(format!(
            "One frame of every {every} is shown (there are {count}), to keep this page small."
        ));
    }
    for (figure, of) in scene.figures.iter().enumerate() {
        let flat = stance.flat_axes(figure);
        if !flat.is_empty() {
            said.push(format!("{} has no {flat}: it is drawn flat.", of.name));
        }
    }
    said.iter()
        .map(|text| format!("<p class=\"remarks\">{}</p>\n", escape(text)))
        .collect()
}

fn html_table(table: &Table) -> String {
    let number =
        |text: &str| text.trim_end_matches(['%', ' ']).parse::<f64>().is_ok() || text == "–";
    // A column is set flush right if it holds numbers only.
    let flush: Vec<bool> = (0..table.header.len())
        .map(|c| {
            let cells = || {
                table
                    .rows
                    .iter()
                    .filter_map(|row| row.get(c))
                    .filter(|cell| !cell.is_empty())
            };
            cells().count() > 0 && cells().all(|cell| number(cell))
        })
        .collect();
    let class = |c: usize| if flush[c] { " class=\"number\"" } else { "" };
    let mut out = String::from("<div class=\"scores\"><table>\n");
    if !table.caption.is_empty() {
        out.push_str(&format!("<caption>{}</caption>\n", escape(&table.caption)));
    }
    out.push_str("<thead><tr>");
    for (c, head) in table.header.iter().enumerate() {
        out.push_str(&format!(
            "<th scope=\"col\"{}>{}</th>",
            class(c),
            escape(head)
        ));
    }
    out.push_str("</tr></thead>\n<tbody>\n");
    for row in &table.rows {
        out.push_str("<tr>");
        for c in 0..table.header.len() {
            let cell = row.get(c).map(String::as_str).unwrap_or_default();
            out.push_str(&format!("<td{}>{}</td>", class(c), escape(cell)));
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody></table></div>");
    out
}

/// A source's hash as a content security policy wants it.
pub(super) fn policy_hash(source: &str) -> String {
    format!("sha256-{}", base64(&Sha256::digest(source.as_bytes())))
}

/// A thousandth of a centimetre, degree or second is enough for a picture.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::scene::{Figure, Run};
    use ndarray::Array2;

    fn names(count: usize) -> Vec<String> {
        (0..count).map(|i| format!("p{i}")).collect()
    }

    fn wave(frames: usize, points: usize, size: f64) -> Array2<f64> {
        Array2::from_shape_fn((frames, 3 * points), |(t, c)| {
            size * (t as f64 * 0.1 + c as f64).sin()
        })
    }

    /// The JSON between the page's own script tags, found as a browser would: up to the first `</script`.
    fn data(page: &str) -> Value {
        let (_, after) = page
            .split_once("<script type=\"application/json\">")
            .unwrap();
        serde_json::from_str(after.split("</script").next().unwrap()).unwrap()
    }

    fn unbase64(text: &str) -> Vec<u8> {
        let value = |c: u8| match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            _ => 63,
        };
        let padding = text.bytes().rev().take_while(|c| *c == b'=').count();
        let mut bytes: Vec<u8> = text
            .as_bytes()
            .chunks(4)
            .flat_map(|four| {
                let word = four
                    .iter()
                    .fold(0u32, |w, c| w << 6 | u32::from(value(*c) & 63));
                [(word >> 16) as u8, (word >> 8) as u8, word as u8]
            })
            .collect();
        bytes.truncate(bytes.len() - padding);
        bytes
    }

    /// What the script decodes.
    fn decoded(figure: &Value, columns: usize) -> Vec<f64> {
        let bytes = unbase64(figure["data"].as_str().unwrap());
        if figure["format"] == "f32" {
            let read = |b: &[u8]| f64::from(f32::from_le_bytes(b.try_into().unwrap()));
            return bytes.chunks(4).map(read).collect();
        }
        let read = |(i, b): (usize, &[u8])| match i16::from_le_bytes(b.try_into().unwrap()) {
            MISSING => f64::NAN,
            q => {
                let of = |name: &str| figure[name][i % columns].as_f64().unwrap();
                of("low") + (f64::from(q) + 32767.0) * of("step")
            }
        };
        bytes.chunks(2).enumerate().map(read).collect()
    }

    #[test]
    fn missing_stays_missing_and_the_rest_stays_put() {
        let points = names(4);
        for (size, format, tolerance) in
            [(200.0, "i16", 0.01), (5e4, "f32", 0.01), (0.0, "i16", 1e-3)]
        {
            let mut xyz = wave(50, 4, size);
            xyz[[3, 4]] = f64::NAN;
            xyz[[4, 0]] = f64::INFINITY;
            let figure = Figure {
                name: "f",
                xyz: xyz.view(),
                status: None,
            };
            let scene = Scene {
                points: &points,
                rate: 60.0,
                figures: vec![figure],
                ..Scene::default()
            };
            let page = page(&scene, &Options::default()).unwrap();
            let figure = &data(&page)["figures"][0];
            assert_eq!(figure["format"], format);
            let back = decoded(figure, 12);
            assert_eq!(back.len(), 600);
            for (i, (back, value)) in back.iter().zip(xyz.iter()).enumerate() {
                let (frame, point) = (i / 12, i % 12 / 3);
                if (frame, point) == (3, 1) || (frame, point) == (4, 0) {
                    assert!(back.is_nan(), "the whole point is missing");
                } else {
                    assert!((back - value).abs() <= tolerance, "{back} {value}");
                }
            }
        }
    }

    #[test]
    fn statuses_are_run_lengths() {
        use Status::*;
        assert_eq!(
            run_lengths([Observed, Observed, Inferred, Observed].into_iter()),
            json!([0, 2, 2, 1, 0, 1])
        );
        assert_eq!(run_lengths([].into_iter()), json!([]));
    }

    #[test]
    fn hostile_text_stays_text() {
        let hostile = "</script><script>alert(1)</script><!-- \" {{script}} \u{0}";
        let points = vec![hostile.to_string()];
        let xyz = wave(2, 1, 1.0);
        let status = Array2::from_elem((2, 1), Status::Inferred);
        let runs = [Run {
            name: hostile,
            first: 0,
            time: 0.0,
        }];
        let table = Table {
            caption: hostile.into(),
            header: vec![hostile.into(), "n".into()],
            rows: vec![vec![hostile.into()], vec![hostile.into(), "1.5".into()]],
        };
        let scene = Scene {
            title: hostile,
            points: &points,
            bones: &[],
            rate: 60.0,
            figures: vec![Figure {
                name: hostile,
                xyz: xyz.view(),
                status: Some(status.view()),
            }],
            runs: &runs,
            note: Some(hostile),
            table: Some(table),
            credit: Some(hostile),
            ..Scene::default()
        };
        let page = page(&scene, &Options::default()).unwrap();
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
            &Options::default(),
        )
        .unwrap();
        for loading in [
            "http://", "https://", "//cdn", "src=", "url(", "@import", "fetch(", "XMLHttp",
            "import(",
        ] {
            assert!(!page.contains(loading), "{loading}");
        }
        assert_eq!(page.matches("href=").count(), 1, "the empty icon");
        for source in [SCRIPT, PAGE_STYLE] {
            assert!(
                page.contains(&policy_hash(source)),
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
        assert_eq!(
            data(&page(&nothing, &Options::default()).unwrap())["frames"],
            0
        );
        for xyz in [
            Array2::zeros((0, 3)),
            Array2::zeros((1, 3)),
            Array2::from_elem((3, 3), f64::NAN),
        ] {
            let figure = Figure {
                name: "f",
                xyz: xyz.view(),
                status: None,
            };
            let scene = Scene {
                points: &points,
                rate: 1.0,
                figures: vec![figure],
                ..Scene::default()
            };
            let page = page(&scene, &Options::default()).unwrap();
            let data = data(&page);
            assert_eq!(data["frames"], xyz.nrows());
            assert_eq!(decoded(&data["figures"][0], 3).len(), xyz.len());
            assert!(
                !page.contains("null,null"),
                "no number of the page is missing"
            );
        }
    }

    #[test]
    fn frames_are_left_out_to_keep_the_limit_and_the_page_says_so() {
        let points = names(10);
        let xyz = wave(1000, 10, 100.0);
        let figure = Figure {
            name: "f",
            xyz: xyz.view(),
            status: None,
        };
        let runs = [
            Run {
                name: "a",
                first: 0,
                time: 0.0,
            },
            Run {
                name: "short",
                first: 499,
                time: 7.0,
            },
            Run {
                name: "b",
                first: 500,
                time: 1.0,
            },
        ];
        let scene = Scene {
            points: &points,
            rate: 60.0,
            figures: vec![figure],
            runs: &runs,
            ..Scene::default()
        };
        let whole = page(&scene, &Options::default()).unwrap();
        assert_eq!(
            (&data(&whole)["every"], &data(&whole)["frames"]),
            (&json!(1), &json!(1000))
        );
        assert!(!whole.contains("to keep this page small"));
        let small = page(
            &scene,
            &Options {
                limit: 20_000,
                ..Options::default()
            },
        )
        .unwrap();
        let data_of_small = data(&small);
        assert!(data_of_small["figures"][0]["data"].as_str().unwrap().len() <= 20_000);
        assert_eq!(data_of_small["every"], 4);
        assert_eq!(data_of_small["rate"], 15.0);
        assert_eq!(
            data_of_small["runs"],
            json!([["a", 0, 0.0], ["b", 125, 1.0]])
        );
        assert!(small.contains("One frame of every 4 is shown (there are 1000)"));
        let tenth = page(
            &scene,
            &Options {
                every: Some(10),
                ..Options::default()
            },
        )
        .unwrap();
        assert_eq!(data(&tenth)["frames"], 100);
        assert!(
            page(
                &scene,
                &Options {
                    every: Some(0),
                    ..Options::default()
                }
            )
            .is_err()
        );
        assert!(
            page(
                &scene,
                &Options {
                    limit: 0,
                    ..Options::default()
                }
            )
            .is_err()
        );
    }

    #[test]
    fn the_same_scene_gives_the_same_bytes() {
        let points = names(5);
        let xyz = wave(300, 5, 80.0);
        let figure = Figure {
            name: "f",
            xyz: xyz.view(),
            status: None,
        };
        let scene = Scene {
            points: &points,
            rate: 60.0,
            figures: vec![figure],
            ..Scene::default()
        };
        let first = page(&scene, &Options::default()).unwrap();
        assert_eq!(first, page(&scene, &Options::default()).unwrap());
    }
}
