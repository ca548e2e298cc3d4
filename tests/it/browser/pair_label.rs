//! The page on which pairs are labeled.

use super::chromium::{Page, WIDE};
use super::pages::{address, pairs};
use crate::common::evaluations::Folder;

#[test]
fn pairs_are_played_answered_saved_and_read() {
    let folder = Folder(tempfile::tempdir().unwrap());
    let file = pairs(&folder);
    let Some(page) = Page::open(&address(&file), WIDE) else {
        return;
    };
    // It plays by itself.
    let clock = page.eval("document.querySelector('.scrub').value");
    page.until(&format!(
        "document.querySelector('.scrub').value !== {clock}"
    ));
    page.key("m");
    page.until("document.querySelector('.clock').textContent === 'marked instant'");
    let before = page.look("section:nth-child(3) canvas");
    let [x, y] = page.middle("section:nth-child(3) canvas");
    page.press([x, y]);
    page.glide([x, y], [x + 60.0, y], 4);
    page.release([x + 60.0, y]);
    page.redrawn("section:nth-child(3) canvas", &before);
    page.key("a");
    assert_eq!(page.text(".where"), "Pair 2 of 3");
    page.click_on("button.not");
    page.key("u");
    assert_eq!(page.text(".tally"), "1 of 3, 1 alike");
    page.key("n");
    page.key("a");
    assert!(page.text(".notice").starts_with("All pairs are answered"));
    page.click_on("button.save");
    let saved = page.saved("labels.csv");
    let labels: Vec<&str> = saved.lines().skip(1).map(|l| &l[l.len() - 2..]).collect();
    assert_eq!(labels, [",1", ",0", ",1"]);
    page.sound();
    // Another browser knows nothing of it, until the file is loaded.
    let other = Page::open(&address(&file), WIDE).unwrap();
    assert_eq!(other.text(".tally"), "0 of 3, 0 alike");
    let file = folder.file("labels.csv", &saved);
    other.give(".file", file.as_ref());
    other.until("document.querySelector('.tally').textContent === '3 of 3, 2 alike'");
    other.sound();
}
