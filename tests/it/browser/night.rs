//! The page of a night of takes: as a table, as cards, by keyboard, and its links into takes.

use super::chromium::{NARROW, Page, Screen, WIDE};
use super::pages::address;
use crate::common::night::night;
use crate::common::{command, run, text};
use std::path::{Path, PathBuf};

/// The page of a cleaned night in a folder.
fn page_in(folder: &Path) -> PathBuf {
    let (raw, solved) = (folder.join("raw"), folder.join("solved"));
    std::fs::create_dir(&raw).unwrap();
    night(&raw);
    // A name without a place to break, and a take without a name for the person.
    std::fs::write(raw.join(format!("{}.c3d", "x".repeat(90))), "x").unwrap();
    let done = command("clean")
        .args(["-q", text(&raw), "--solve", "-o", text(&solved)])
        .args(["--outliers", "none"])
        .output();
    assert_eq!(done.unwrap().status.code(), Some(1));
    solved.join("clean.html")
}

/// Elements that are wider than the room that they have.
const WIDER: &str = "[...document.querySelectorAll('body, body *')].filter(e => e.scrollWidth > e.clientWidth + 1
    && e.clientWidth && !e.closest('thead') && !e.closest('svg')).map(e => e.outerHTML.slice(0, 80))";

#[test]
fn a_night_is_seen_wide_and_narrow_and_its_findings_lead_into_takes() {
    let folder = tempfile::tempdir().unwrap();
    let Some(blank) = Page::open("data:text/html,<title>blank", WIDE) else {
        return;
    };
    drop(blank);
    let night = address(&page_in(folder.path()));
    let screen = |size, dark| Screen {
        size,
        dark,
        ..NARROW
    };
    let mut strokes = Vec::new();
    for (name, screen) in [
        ("wide", WIDE),
        ("middle", screen([900, 800], false)),
        ("narrow", screen([420, 850], true)),
        ("least", screen([320, 700], false)),
    ] {
        let page = Page::open(&night, screen).unwrap();
        page.shot(&format!("night-{name}"));
        assert_eq!(page.eval(WIDER), serde_json::json!([]), "{name}");
        assert_eq!(page.number("document.querySelectorAll('svg').length"), 5.0);
        page.shows("svg");
        let stroke = "getComputedStyle(document.querySelector('svg .l')).stroke";
        strokes.push((screen.dark, page.eval(stroke)));
        // A card names its lines; the table has heads.
        let is_card = screen.size[0] <= 860;
        let label =
            "getComputedStyle(document.querySelector('td[data-t=Result]'), '::before').content";
        assert_eq!(
            page.eval(label) == "\"Result\"",
            is_card,
            "{name}: {}",
            page.eval(label)
        );
        let row = "document.querySelector('tbody > tr').getBoundingClientRect().height";
        assert!(
            page.number(row) < if is_card { 320.0 } else { 90.0 },
            "{name}"
        );
        page.sound();
    }
    assert_ne!(strokes[0].1, strokes[2].1, "light and dark");
    // Tab goes from link to link, Enter opens what is folded, and a finding leads to its frame.
    let page = Page::open(&night, WIDE).unwrap();
    page.key("Tab");
    assert!(page.holds("document.activeElement.matches('a[href]')"));
    page.focus("summary");
    page.key("Enter");
    page.until("document.querySelector('details[open] li')");
    page.focus("a[href*=\"frame=45\"]");
    page.key("Enter");
    page.until("document.querySelector('.clock small')?.textContent === 'frame 45'");
    page.sound();
}

/// Takes of every kind in a folder: rotations, markers, tables, names without a place to break,
/// labels that change places, gaps, noise, and what fails.
fn kinds(raw: &Path) {
    night(raw);
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata");
    for (from, to) in [
        ("cmu/07/07.asf", "07.asf"),
        ("cmu/07/07_01.amc", "07_01.amc"),
        ("examples/animator/goblin.bvh", "goblin.bvh"),
        ("examples/animator/walk.fbx.gz", "walk.fbx.gz"),
        ("examples/gait/walk.c3d", "walk.c3d"),
    ] {
        std::fs::copy(data.join(from), raw.join(to)).unwrap();
    }
    let walk = std::fs::read_to_string(raw.join("walk.csv")).unwrap();
    run("xyz2trc", &["-q", "-o", text(&raw.join("walk.trc"))], &walk);
    let long = format!("{}.csv", "a_name_without_a_place_to_break_".repeat(3));
    let gaps = ["-q", "--gaps", "5", "--length", "0.3", "--points", "3"];
    std::fs::write(raw.join(long), run("corrupt", &gaps, &walk)).unwrap();
    let noisy = run("corrupt", &["-q", "--dense", "1cm"], &walk);
    std::fs::write(raw.join("noisy.csv"), noisy).unwrap();
    // The markers of three columns each change places for a while.
    let swapped = walk.lines().enumerate().map(|(t, line)| {
        let mut cells: Vec<&str> = line.split(',').collect();
        if (60..140).contains(&t) {
            (0..3).for_each(|axis| cells.swap(1 + axis, 4 + axis));
        }
        cells.join(",") + "\n"
    });
    std::fs::write(raw.join("swapped.csv"), swapped.collect::<String>()).unwrap();
    std::fs::write(raw.join("broken.c3d"), "no C3D file").unwrap();
}

#[test]
fn a_page_of_every_kind_of_take_is_whole_on_a_narrow_screen() {
    let folder = tempfile::tempdir().unwrap();
    let Some(blank) = Page::open("data:text/html,<title>blank", WIDE) else {
        return;
    };
    drop(blank);
    let (raw, out) = (folder.path().join("raw"), folder.path().join("out"));
    std::fs::create_dir(&raw).unwrap();
    kinds(&raw);
    let done = command("clean")
        .args(["-q", text(&raw), "--solve", "--fps", "100", "--up", "y"])
        .args(["-o", text(&out)])
        .output();
    assert_eq!(done.unwrap().status.code(), Some(1));
    let address = address(&out.join("clean.html"));
    let cells = "[...document.querySelectorAll('.files tbody td[data-t], .files th')].filter(e => e.textContent && !e.closest('thead')).map(e => e.textContent)";
    let told = Page::open(&address, WIDE).unwrap().eval(cells);
    assert!(told.as_array().unwrap().len() > 40, "{told}");
    let mut links = serde_json::Value::Null;
    for width in [420, 360] {
        let screen = Screen {
            size: [width, 850],
            ..NARROW
        };
        let page = Page::open(&address, screen).unwrap();
        page.eval("document.querySelectorAll('details').forEach(e => { e.open = true; })");
        assert!(page.number("document.documentElement.scrollWidth") <= f64::from(width));
        assert_eq!(page.eval(WIDER), serde_json::json!([]), "{width}");
        assert_eq!(page.eval(cells), told);
        let cut = "[...document.querySelectorAll('.files tbody *:not(svg, svg *)')].filter(e => e.textContent).map(e => [e, e.getBoundingClientRect()])
            .filter(([e, box]) => !e.checkVisibility() || box.left < 0 || box.right > innerWidth || box.height < 8).map(([e]) => e.outerHTML.slice(0, 80))";
        assert_eq!(page.eval(cut), serde_json::json!([]), "{width}");
        page.shot(&format!("kinds-{width}"));
        page.sound();
        links = page.eval("[...new Set([...document.querySelectorAll('a[href*=\".html\"]')].map(a => a.href.split('#')[0]))]");
    }
    let links = links.as_array().unwrap();
    assert!(links.len() >= 4, "{links:?}");
    for link in links {
        let screen = Screen {
            size: [420, 850],
            ..NARROW
        };
        let page = Page::open(link.as_str().unwrap(), screen).unwrap();
        page.until("document.querySelector('.clock').textContent");
        assert!(
            page.number("document.documentElement.scrollWidth") <= 420.0,
            "{link}"
        );
        let beyond = "[...document.querySelectorAll('caption span, .scores td')].filter(e => e.getBoundingClientRect().right > 420).map(e => e.outerHTML)";
        assert_eq!(page.eval(beyond), serde_json::json!([]), "{link}");
        page.shot(&format!(
            "kind-{}",
            link.as_str().unwrap().rsplit('/').next().unwrap()
        ));
        page.sound();
    }
}
