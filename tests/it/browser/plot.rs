//! The pages that play: time goes on, curves and gaps lead to frames, meshes turn.

use super::chromium::{Page, Screen, WIDE};
use super::pages::address;
use crate::common::evaluations::Folder;
use crate::common::{run, text};
use serde_json::json;
use std::f64::consts::TAU;

/// The gaps of the take: point, first frame, frames, method, standard deviation.
const GAPS: [(usize, usize, usize, &str, f64); 3] = [
    (1, 40, 20, "pchip", 0.5),
    (0, 100, 50, "regression", 0.2),
    (2, 0, 10, "", 0.0),
];
const FRAMES: usize = 1000;

/// A take of three points at 100 frames a second. `told`: how gaps were filled stands beside the
/// points; else gaps are empty cells.
fn table(told: bool) -> String {
    let columns = if told {
        &["x", "y", "z", "status", "sd", "method"][..]
    } else {
        &["x", "y", "z"]
    };
    let names = ["a", "b", "c"];
    let head = names
        .iter()
        .flat_map(|n| columns.iter().map(move |c| format!(",{n}.{c}")));
    let mut out = format!("time{}\n", head.collect::<String>());
    for t in 0..FRAMES {
        out += &format!("{}", t as f64 / 100.0);
        for p in 0..names.len() {
            let gap = GAPS
                .iter()
                .find(|g| g.0 == p && (g.1..g.1 + g.2).contains(&t));
            let filled = gap.filter(|g| !g.3.is_empty());
            out += &if gap.is_some() && !(told && filled.is_some()) {
                ",,,".to_string()
            } else {
                let high = 50.0 + 10.0 * (t as f64 / 20.0).sin();
                format!(",{},{high},{}", p as f64 * 20.0 + t as f64 / 50.0, p * 5)
            };
            out += &match (told, gap, filled) {
                (false, ..) => String::new(),
                (_, None, _) => ",observed,0.01,".to_string(),
                (_, _, Some(gap)) => format!(",inferred,{},{}", gap.4, gap.3),
                (_, _, None) => ",unknown,,".to_string(),
            };
        }
        out.push('\n');
    }
    out
}

/// The page of a table, which has to live as long as the folder.
fn open(table: &str, screen: Screen) -> Option<(Page, Folder)> {
    let folder = Folder(tempfile::tempdir().unwrap());
    let file = folder.path("page.html");
    run(
        "plot",
        &["-q", "--bones", "a-b,b-c", "-o", text(&file)],
        table,
    );
    let page = Page::open(&address(&file), screen)?;
    page.until("document.querySelector('.clock').textContent");
    Some((page, folder))
}

fn rows(page: &Page) -> serde_json::Value {
    page.eval("[...document.querySelectorAll('.gaps tbody tr')].map(row => [...row.cells].map(cell => cell.textContent))")
}

/// Waits until the frame of this number is shown.
fn shows(page: &Page, frame: usize) {
    page.until(&format!(
        "document.querySelector('.clock small').textContent === 'frame {frame}'"
    ));
}

fn value(page: &Page, selector: &str) -> String {
    let value = page.eval(&format!("document.querySelector('{selector}').value"));
    value.as_str().unwrap().to_string()
}

#[test]
fn gaps_are_listed_the_longest_first_and_sorted_by_a_click() {
    let Some((page, _folder)) = open(&table(true), WIDE) else {
        return;
    };
    let listed = json!([
        [
            "a",
            "1.00 s",
            "100",
            "0.50 s",
            "50",
            "regression",
            "0.20 cm"
        ],
        ["b", "0.40 s", "40", "0.20 s", "20", "pchip", "0.50 cm"],
        ["c", "0.00 s", "0", "0.10 s", "10", "not filled", "–"],
    ]);
    assert_eq!(rows(&page), listed);
    let sorted_by = |head: &str| {
        let at = page.eval(&format!(
            "[...document.querySelectorAll('.gaps th')].findIndex(th => th.textContent.trim().startsWith('{head}')) + 1"
        ));
        page.click_on(&format!(".gaps th:nth-child({at}) button"));
        page.drawn();
        let points = rows(&page);
        points
            .as_array()
            .unwrap()
            .iter()
            .map(|row| row[0].as_str().unwrap().to_string())
            .collect::<String>()
    };
    assert_eq!(sorted_by("sd"), "bac", "the least sure first");
    assert_eq!(sorted_by("sd"), "abc", "what has no deviation stays last");
    assert_eq!(sorted_by("Start"), "cba");
    page.sound();
}

#[test]
fn a_gap_that_is_clicked_shows_its_joint_a_little_before_it() {
    let Some((page, _folder)) = open(&table(true), WIDE) else {
        return;
    };
    assert_eq!(
        value(&page, "select.joint"),
        "0",
        "at first, the joint of the longest gap"
    );
    let before = page.look("canvas.plot");
    page.click_on(".gaps tbody tr:nth-child(2)");
    shows(&page, 10);
    assert_eq!(value(&page, "select.joint"), "1");
    assert_eq!(value(&page, "select.trail"), "1");
    assert_eq!(
        value(&page, "select.span"),
        "2",
        "a short gap is shown larger"
    );
    page.redrawn("canvas.plot", &before);
    page.key("ArrowRight");
    shows(&page, 11);
    page.key("End");
    shows(&page, FRAMES - 1);
    page.sound();
}

#[test]
fn the_list_and_the_choice_of_a_joint_work_by_keyboard() {
    let Some((page, _folder)) = open(&table(true), WIDE) else {
        return;
    };
    page.focus(".gaps tbody button");
    page.key("ArrowDown");
    page.key("Enter");
    shows(&page, 10);
    page.key("ArrowUp");
    page.key("Enter");
    shows(&page, 70);
    let before = page.look("canvas.plot");
    page.focus("select.joint");
    page.key("c");
    page.until("document.querySelector('select.joint').value === '2'");
    page.redrawn("canvas.plot", &before);
    shows(&page, 70);
    page.sound();
}

#[test]
fn a_click_or_drag_in_the_curves_moves_the_time() {
    let Some((page, _folder)) = open(&table(false), WIDE) else {
        return;
    };
    let [left, _, width, _] = page.area("canvas.plot");
    let [middle, height] = page.middle("canvas.plot");
    page.click([middle, height]);
    page.until("document.querySelector('.clock small').textContent !== 'frame 0'");
    let frame: f64 = page.text(".clock small")[6..].parse().unwrap();
    assert!((frame - 499.5).abs() < 3.0, "{frame}");
    page.press([middle, height]);
    page.glide([middle, height], [left + 2.0 * width, height], 5);
    page.release([left + 2.0 * width, height]);
    shows(&page, FRAMES - 1);
    page.sound();
}

#[test]
fn a_part_of_the_take_goes_on_with_the_time() {
    let Some((page, _folder)) = open(&table(false), WIDE) else {
        return;
    };
    page.choose("select.span", "2");
    page.drawn();
    let before = page.look("canvas.plot");
    page.eval("document.activeElement.blur()");
    page.key("End");
    shows(&page, FRAMES - 1);
    page.redrawn("canvas.plot", &before);
    page.sound();
}

#[test]
fn empty_cells_alone_are_gaps_and_a_take_without_any_has_no_list() {
    let Some((page, _folder)) = open(&table(false), WIDE) else {
        return;
    };
    let listed = json!([
        ["a", "1.00 s", "100", "0.50 s", "50"],
        ["b", "0.40 s", "40", "0.20 s", "20"],
        ["c", "0.00 s", "0", "0.10 s", "10"],
    ]);
    assert_eq!(rows(&page), listed);
    page.sound();
    let head = "time,a.x,a.y,a.z,b.x,b.y,b.z,c.x,c.y,c.z\n0,1,2,3,4,5,6,7,8,9\n";
    let seen = |page: &Page, selector: &str| {
        page.holds(&format!(
            "document.querySelector('{selector}').checkVisibility()"
        ))
    };
    let (whole, _folder) = open(&format!("{head}0.1,2,3,4,5,6,7,8,9,1\n"), WIDE).unwrap();
    assert!(!seen(&whole, ".gaps") && seen(&whole, "canvas.plot"));
    whole.sound();
    let (halted, _folder) = open(&format!("{head}0.1,,,,,,,,,\n"), WIDE).unwrap();
    assert_eq!(rows(&halted).as_array().unwrap().len(), 3);
    halted.sound();
}

#[test]
fn time_goes_on_when_it_is_played_and_the_figure_turns() {
    let Some((page, _folder)) = open(&table(false), WIDE) else {
        return;
    };
    let before = page.look("canvas.view");
    page.click_on("button.play");
    page.until("document.querySelector('.clock small').textContent !== 'frame 0'");
    page.key(" ");
    page.until("document.querySelector('button.play').getAttribute('aria-label') === 'Play'");
    page.redrawn("canvas.view", &before);
    let before = page.look("canvas.view");
    turn(&page);
    page.redrawn("canvas.view", &before);
    page.sound();
}

/// Drags the view to the side.
fn turn(page: &Page) {
    let [x, y] = page.middle("canvas.view");
    page.press([x, y]);
    page.glide([x, y], [x + 90.0, y], 6);
    page.release([x + 90.0, y]);
}

#[test]
fn meshes_play_and_turn() {
    let folder = Folder(tempfile::tempdir().unwrap());
    let scans = folder.path("scans");
    std::fs::create_dir(&scans).unwrap();
    for i in 0..8 {
        let mesh = crate::common::meshes::octahedron(f64::from(i) / 8.0 * TAU / 4.0);
        mesh.save(scans.join(format!("{i}.obj"))).unwrap();
    }
    let file = folder.path("page.html");
    let flags = [
        "-q",
        "--fps",
        "30",
        "--units",
        "m",
        "-o",
        text(&file),
        text(&scans),
    ];
    run("plot", &flags, "");
    let Some(page) = Page::open(&address(&file), WIDE) else {
        return;
    };
    page.until("document.querySelector('.clock').textContent");
    page.shows("canvas.view");
    let before = page.look("canvas.view");
    page.key("ArrowRight");
    page.redrawn("canvas.view", &before);
    let before = page.look("canvas.view");
    turn(&page);
    page.redrawn("canvas.view", &before);
    let before = page.look("canvas.view");
    page.key("m");
    page.redrawn("canvas.view", &before);
    let clock = page.text(".clock");
    page.click_on("button.play");
    page.until(&format!(
        "document.querySelector('.clock').textContent !== {}",
        json!(clock)
    ));
    page.sound();
}
