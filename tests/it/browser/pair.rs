//! The page of two takes: over each other and side by side, with their differences.

use super::chromium::{NARROW, Page, Screen, WIDE};
use super::pages::address;
use crate::common::evaluations::Folder;
use crate::common::{run, text};
use serde_json::json;

/// A take of points that walk along x at `rate` for two seconds; the knee of `wrong` is 3 cm off
/// along y and 4 along z in the frames of half a second around second 1.
fn table(points: &[&str], rate: usize, wrong: bool) -> String {
    let head = points.iter().map(|p| format!(",{p}.x,{p}.y,{p}.z"));
    let mut out = format!("time{}\n", head.collect::<String>());
    for t in 0..=2 * rate {
        let time = t as f64 / rate as f64;
        out += &format!("{time}");
        for (p, name) in points.iter().enumerate() {
            let off = wrong && *name == "knee" && (time - 1.0).abs() <= 0.25;
            let [y, z] = if off { [3.0, 4.0] } else { [0.0; 2] };
            let high = 90.0 - 40.0 * p as f64 + y;
            out += &format!(",{},{high},{z}", 50.0 * time);
        }
        out.push('\n');
    }
    out
}

const LEG: [&str; 3] = ["hip", "knee", "toe"];

/// The page of two tables, which has to live as long as the folder.
fn open(tables: [&str; 2], screen: Screen) -> Option<(Page, Folder)> {
    let folder = Folder(tempfile::tempdir().unwrap());
    let [before, after] = [("before.csv", tables[0]), ("after.csv", tables[1])]
        .map(|(name, table)| folder.file(name, table));
    let file = folder.path("both.html");
    run(
        "plot",
        &[
            "-q",
            "--bones",
            "hip-knee,knee-toe",
            "-o",
            text(&file),
            &before,
            &after,
        ],
        "",
    );
    let page = Page::open(&address(&file), screen)?;
    page.until("document.querySelector('.clock').textContent");
    Some((page, folder))
}

fn texts(page: &Page, selector: &str) -> serde_json::Value {
    page.eval(&format!(
        "[...document.querySelectorAll('{selector}')].map(e => e.textContent)"
    ))
}

fn canvases(page: &Page) -> f64 {
    page.number("document.querySelectorAll('canvas.view').length")
}

#[test]
fn two_takes_stand_over_each_other_in_two_colors_or_side_by_side() {
    let Some((page, _folder)) = open([&table(&LEG, 50, false), &table(&LEG, 50, true)], WIDE)
    else {
        return;
    };
    assert_eq!(canvases(&page), 1.0);
    assert_eq!(texts(&page, ".names button"), json!(["before", "after"]));
    let colors = "new Set([...document.querySelectorAll('.names .swatch')].map(e => getComputedStyle(e).backgroundColor)).size";
    assert_eq!(page.number(colors), 2.0);
    let pressed = |name: &str| {
        page.holds(&format!(
            "document.querySelector('.{name}').getAttribute('aria-pressed') === 'true'"
        ))
    };
    assert!(pressed("over") && !pressed("beside"));
    page.key("o");
    page.until("document.querySelectorAll('canvas.view').length === 2");
    assert_eq!(texts(&page, ".head .name"), json!(["before", "after"]));
    page.drawn();
    assert!(!pressed("over") && pressed("beside"));
    page.click_on("button.beside");
    assert_eq!(canvases(&page), 2.0, "a button that is pressed stays so");
    page.click_on("button.over");
    page.until("document.querySelectorAll('canvas.view').length === 1");
    page.shows("canvas.view");
    page.shot("pair-wide");
    page.sound();
}

#[test]
fn differences_are_told_by_frame_over_time_and_by_point() {
    let Some((page, _folder)) = open([&table(&LEG, 50, false), &table(&LEG, 50, true)], WIDE)
    else {
        return;
    };
    assert_eq!(texts(&page, ".apart b"), json!(["0.00 cm", "0.00 cm, hip"]));
    page.shows(".apart canvas");
    // 26 of 101 frames are 5 cm off.
    let listed = json!([
        ["knee", "5.00 cm", "0.76 s", "2.49 cm"],
        ["hip", "0.00 cm", "0.00 s", "0.00 cm"],
        ["toe", "0.00 cm", "0.00 s", "0.00 cm"],
    ]);
    let rows = "[...document.querySelectorAll('.differences tbody tr')].map(row => [...row.cells].map(cell => cell.textContent))";
    assert_eq!(page.eval(rows), listed);
    page.focus(".differences tbody button");
    page.key("Enter");
    page.until("document.querySelector('.clock small').textContent === 'frame 38'");
    // 5 cm of one point in three.
    assert_eq!(
        texts(&page, ".apart b"),
        json!(["2.89 cm", "5.00 cm, knee"])
    );
    assert_eq!(
        page.eval("document.querySelector('select.trail').value"),
        "1"
    );
    page.key("End");
    page.until("document.querySelector('.apart b').textContent === '0.00 cm'");
    let [x, y] = page.middle(".apart canvas");
    page.click([x, y]);
    page.until("document.querySelector('.apart b').textContent === '2.89 cm'");
    page.sound();
}

#[test]
fn takes_of_other_rates_play_in_seconds_and_those_without_a_common_name_have_no_differences() {
    let short = table(&LEG, 25, false);
    let short = short.lines().take(26).collect::<Vec<_>>().join("\n") + "\n";
    let Some((page, _folder)) = open([&table(&LEG, 100, false), &short], WIDE) else {
        return;
    };
    page.key("End");
    page.until("document.querySelector('.clock').textContent.startsWith('2.000 s')");
    assert_eq!(page.text(".clock small"), "frames 200 and –");
    assert_eq!(texts(&page, ".apart b"), json!(["–", "–"]));
    assert_eq!(page.text(".differences tbody td:nth-child(2)"), "0.00 cm");
    assert!(page.text("main").contains("Both play in seconds."));
    assert!(
        page.holds("document.querySelector('.gaps').hidden"),
        "an end is no gap"
    );
    page.sound();
    let other = table(&["hip_", "knee_", "toe_"], 50, false);
    let (page, _folder) = {
        let folder = Folder(tempfile::tempdir().unwrap());
        let [a, b] = [("a.csv", table(&LEG, 50, false)), ("b.csv", other)]
            .map(|(name, table)| folder.file(name, &table));
        let file = folder.path("both.html");
        run("plot", &["-q", "-o", text(&file), &a, &b], "");
        (Page::open(&address(&file), WIDE).unwrap(), folder)
    };
    page.until("document.querySelector('.clock').textContent");
    assert!(page.text("main").contains("no differences can be told"));
    assert!(page.holds(
        "!document.querySelector('.apart') && document.querySelector('.differences').hidden"
    ));
    page.shows("canvas.view");
    page.sound();
}

#[test]
fn the_page_of_two_takes_fits_a_narrow_screen() {
    let screen = Screen {
        size: [420, 850],
        dark: true,
        ..NARROW
    };
    let long = [
        "a_name_without_a_place_to_break_in_it_at_all",
        "knee",
        "toe",
    ];
    let mut tables = [table(&long, 50, false), table(&long, 50, true)];
    for table in &mut tables {
        table.push_str("2.02,,,,1,2,3,4,5,6\n");
    }
    let folder = Folder(tempfile::tempdir().unwrap());
    let [a, b] = [("a.csv", &tables[0]), ("b.csv", &tables[1])]
        .map(|(name, table)| folder.file(name, table));
    let file = folder.path("both.html");
    run("plot", &["-q", "-o", text(&file), &a, &b], "");
    let Some(page) = Page::open(&address(&file), screen) else {
        return;
    };
    page.until("document.querySelector('.clock').textContent");
    assert!(page.number("document.documentElement.scrollWidth") <= 420.0);
    let wider = "[...document.querySelectorAll('.rows')].filter(e => e.scrollWidth > e.clientWidth + 1).length";
    assert_eq!(page.number(wider), 0.0, "every column is seen");
    page.shot("pair-narrow");
    page.key("o");
    page.until("document.querySelectorAll('canvas.view').length === 2");
    assert!(page.number("document.documentElement.scrollWidth") <= 420.0);
    page.sound();
}
