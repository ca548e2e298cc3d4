//! The page of a night of takes: as a table, as cards, by keyboard, and its links into takes.

use super::chromium::{NARROW, Page, Screen, WIDE};
use super::pages::address;
use crate::common::night::night;
use crate::common::{command, text};
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
