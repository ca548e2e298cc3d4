//! Each kind of page, made by its command from small inputs: seen wide and narrow, light and dark.

use super::chromium::{NARROW, Page, Screen, WIDE};
use crate::common::evaluations::{Folder, takes};
use crate::common::{command, meshes, run, take, text};
use std::path::{Path, PathBuf};

/// Tests of pages: the name, what makes the page in a folder, and the elements that are drawn on
/// it.
macro_rules! pages {
    ($($name:ident: $make:ident, $drawn:expr;)*) => {
        mod each { $(
            #[test]
            fn $name() {
                super::opens(stringify!($name), super::$make, &$drawn);
            }
        )* }
    };
}

pages! {
    plot_of_poses: plot, ["section:nth-child(1) canvas.view", "section:nth-child(2) canvas.view", ".strip canvas", "canvas.plot", ".gaps tbody", ".legend"];
    plot_of_one_pose: one_pose, ["svg.view"];
    plot_as_svg: svg, ["svg"];
    found_poses: found, ["svg"];
    plot_of_meshes: plot_meshes, ["canvas.view"];
    pairs_to_label: pairs, ["section:nth-child(1) canvas", "section:nth-child(2) canvas", "section:nth-child(3) canvas", "section:nth-child(4) canvas"];
    audit: audit, ["svg.takes", "section ul"];
    clean: clean, ["table"];
    evaluated_models: models, ["table", "figure svg", ".player .view"];
    evaluated_takes: evaluated_takes, ["table"];
    evaluated_metric: metric, ["table", "svg"];
    tables: tables, ["table"];
}

/// Opens a page that is made in a folder, and looks at it.
fn opens(name: &str, make: fn(&Folder) -> PathBuf, drawn: &[&str]) {
    let folder = Folder(tempfile::tempdir().unwrap());
    // Nothing is made where nothing can be opened.
    let Some(blank) = Page::open("data:text/html,<title>blank", WIDE) else {
        return;
    };
    drop(blank);
    let address = address(&make(&folder));
    let screens = [
        ("wide", WIDE),
        (
            "narrow",
            Screen {
                dark: true,
                ..NARROW
            },
        ),
    ];
    for (kind, screen) in screens {
        let Some(page) = Page::open(&address, screen) else {
            return;
        };
        for selector in drawn {
            page.shows(selector);
        }
        page.eval("scrollTo(0, 0)");
        page.shot(&format!("{name}-{kind}"));
        let wider = "document.body && document.documentElement.scrollWidth > document.documentElement.clientWidth";
        assert!(
            !page.holds(wider),
            "{name} is wider than the window, {kind}"
        );
        page.sound();
        linked(&page);
    }
}

/// Opens the first few pages that a page links to.
fn linked(page: &Page) {
    let links = page.eval(
        "[...new Set([...document.querySelectorAll('a[href]')].map(a => new URL(a.getAttribute('href'), location).href.split('#')[0]))]
           .filter(link => /^file:.*[.]html$/.test(link) && link !== location.href.split('#')[0]).slice(0, 3)",
    );
    for link in links.as_array().unwrap() {
        let other = Page::open(link.as_str().unwrap(), WIDE).unwrap();
        assert!(other.holds("document.body.innerText.length > 20"), "{link}");
        other.sound();
    }
}

/// The address of a file.
pub fn address(path: &Path) -> String {
    format!("file://{}", text(path))
}

/// A walk with a gap: a wrist is away for a quarter of a second, a foot at the start.
pub fn gaps() -> String {
    let walk = take("07", "07_01", &[]).unwrap();
    let mut lines: Vec<String> = walk.lines().map(String::from).collect();
    let columns: Vec<String> = lines[0].split(',').map(String::from).collect();
    let mut hide = |point: &str, frames: std::ops::Range<usize>| {
        for line in &mut lines[frames.start + 1..frames.end + 1] {
            let cells = line.split(',').zip(&columns);
            let kept = cells.map(|(cell, column)| match column.rsplit_once('.') {
                Some((name, _)) if name == point => "",
                _ => cell,
            });
            *line = kept.collect::<Vec<_>>().join(",");
        }
    };
    hide("lwrist", 60..90);
    hide("rfoot", 0..10);
    lines.join("\n") + "\n"
}

fn plot(folder: &Folder) -> PathBuf {
    let gaps = folder.file("gaps.csv", &gaps());
    let filled = run("complete", &["-q", "--status", &gaps], "");
    let filled = folder.file("filled.csv", &filled);
    let page = folder.path("plot.html");
    // Two would be compared.
    run(
        "plot",
        &["-q", "-o", text(&page), &filled, &gaps, &filled],
        "",
    );
    page
}

fn one_pose(folder: &Folder) -> PathBuf {
    let walk = take("07", "07_01", &[]).unwrap();
    let first: Vec<&str> = walk.lines().take(2).collect();
    let page = folder.path("pose.html");
    run(
        "plot",
        &["-q", "--fps", "120", "-o", text(&page)],
        &(first.join("\n") + "\n"),
    );
    page
}

fn svg(folder: &Folder) -> PathBuf {
    let page = folder.path("walk.svg");
    let walk = take("07", "07_01", &[]).unwrap();
    run("plot", &["-q", "-o", text(&page)], &walk);
    page
}

/// Poses of two takes found for some of one, whose name is long.
fn found(folder: &Folder) -> PathBuf {
    let walk = take("07", "07_01", &[]).unwrap();
    let long = walk.replace("07_01,", "walk_of_subject_07_trial_01,");
    let runs = take("09", "09_06", &[]).unwrap();
    let all = long.clone() + runs.split_once('\n').unwrap().1;
    let (walk, all) = (folder.file("walk.csv", &long), folder.file("all.csv", &all));
    let classes = "take,class\nwalk_of_subject_07_trial_01,walk\n09_06,run\n";
    let (classes, page) = (
        folder.file("classes.csv", classes),
        folder.path("found.svg"),
    );
    let flags = [
        "-q",
        "--every",
        "12",
        "--classes",
        &classes,
        "--database",
        &all,
    ];
    run(
        "retrieve",
        &[&flags[..], &["--picture", text(&page), &walk]].concat(),
        "",
    );
    page
}

#[test]
fn labels_of_found_poses_are_large_enough_and_apart() {
    let folder = Folder(tempfile::tempdir().unwrap());
    let Some(page) = Page::open("data:text/html,<title>blank", WIDE) else {
        return;
    };
    page.go(&address(&found(&folder)));
    let texts = "const texts = [...document.querySelectorAll('text')], boxes = texts.map(t => t.getBoundingClientRect());";
    let small = "return texts.filter(t => parseFloat(getComputedStyle(t).fontSize) < 12).length";
    assert_eq!(
        page.number(&format!("(() => {{ {texts} {small} }})()")),
        0.0
    );
    let meet = "return boxes.filter((a, i) => boxes.some((b, k) => k < i && a.left < b.right && b.left < a.right && a.top + 2 < b.bottom && b.top + 2 < a.bottom)).length";
    assert_eq!(page.number(&format!("(() => {{ {texts} {meet} }})()")), 0.0);
    let inside = "const all = document.documentElement.getBoundingClientRect(); return boxes.every(b => b.left >= all.left && b.right <= all.right && b.bottom <= all.bottom)";
    assert!(page.holds(&format!("(() => {{ {texts} {inside} }})()")));
    page.sound();
}

fn plot_meshes(folder: &Folder) -> PathBuf {
    meshes::of_examples(folder.0.path());
    let page = folder.path("meshes.html");
    let (scans, bodies) = (folder.name("scans"), folder.name("bodies.npz"));
    let flags = ["-q", "--fps", "30", "--units", "m", "-o", text(&page)];
    run("plot", &[&flags[..], &[&scans, &bodies]].concat(), "");
    page
}

pub fn pairs(folder: &Folder) -> PathBuf {
    let page = folder.path("pairs.html");
    let walk = take("07", "07_01", &[]).unwrap();
    let flags = ["-q", "--count", "3", "--seconds", "0.2", "--near", "15"];
    run(
        "pair-label",
        &[&flags[..], &["-o", text(&page)]].concat(),
        &walk,
    );
    page
}

fn audit(folder: &Folder) -> PathBuf {
    let gaps = folder.file("gaps.csv", &gaps());
    let walk = folder.file("walk.csv", &take("07", "07_01", &[]).unwrap());
    let page = folder.path("audit.html");
    // There are findings.
    let done = command("audit")
        .args(["-q", "--max-gap", "0.2", "-o", text(&page), &gaps, &walk])
        .output();
    assert_eq!(done.unwrap().status.code(), Some(3));
    page
}

fn cleaned(folder: &Folder) -> PathBuf {
    std::fs::create_dir(folder.path("captures")).unwrap();
    folder.file("captures/gaps.csv", &gaps());
    folder.file("captures/walk.csv", &take("07", "07_01", &[]).unwrap());
    let out = folder.path("cleaned");
    let done = command("clean")
        .args(["-q", &folder.name("captures"), "-o", text(&out)])
        .output();
    assert!(matches!(done.unwrap().status.code(), Some(0 | 3)));
    out
}

fn clean(folder: &Folder) -> PathBuf {
    cleaned(folder).join("clean.html")
}

/// The arguments of a small evaluation into a folder.
fn small(folder: &Folder, out: &str, more: &[&str]) -> PathBuf {
    let walk = folder.file("walk.csv", &takes("07", "07_01", 4));
    let runs = folder.file("run.csv", &takes("09", "09_06", 3));
    let out = folder.path(out);
    let flags = ["-q", "--seeds", "1", "--frames", "20", "-o", text(&out)];
    run(
        "evaluate",
        &[more, &flags[..], &[&walk, &runs]].concat(),
        "",
    );
    out
}

fn models(folder: &Folder) -> PathBuf {
    small(folder, "models", &["--models", "ksvd:n=20,gaussian"]).join("report.html")
}

fn tables(folder: &Folder) -> PathBuf {
    std::fs::create_dir(folder.path("tables")).unwrap();
    let run_of = small(
        folder,
        "tables/single",
        &["--models", "ksvd-omp:n=20,gaussian"],
    );
    let out = folder.name("tables");
    run("evaluate", &["--paper", text(&run_of), "-o", &out], "");
    folder.path("tables/tables.html")
}

fn evaluated_takes(folder: &Folder) -> PathBuf {
    let walk = folder.file("walk.csv", &take("07", "07_01", &[]).unwrap());
    let out = folder.name("takes");
    let flags = [
        "takes",
        "--self",
        "--gaps",
        "1",
        "--lengths",
        "0.1",
        "--points",
        "1",
        "--noise",
        "0",
    ];
    run("evaluate", &[&flags[..], &["-o", &out, &walk]].concat(), "");
    folder.path("takes/report.html")
}

fn metric(folder: &Folder) -> PathBuf {
    let table = takes("07", "07_01", 4) + takes("09", "09_06", 4).split_once('\n').unwrap().1;
    let poses = folder.file("poses.csv", &table);
    let mut classes = String::from("take,class,subject\n");
    for (subject, class) in [("07", "walk"), ("09", "run")] {
        for part in ["a", "b", "c", "d"] {
            classes += &format!("{subject}_{part},{class},{part}\n");
        }
    }
    let (classes, out) = (folder.file("classes.csv", &classes), folder.name("metric"));
    let flags = [
        "metric",
        "--classes",
        &classes,
        "--labels",
        "class,phase",
        "--pairs",
        "20",
        "--short",
    ];
    run(
        "evaluate",
        &[&flags[..], &["-o", &out, &poses]].concat(),
        "",
    );
    folder.path("metric/report.html")
}

/// What the driver takes for a fault is one.
#[test]
fn faults_of_a_page_are_seen() {
    let folder = Folder(tempfile::tempdir().unwrap());
    let policy = "<meta http-equiv=Content-Security-Policy content=\"script-src 'none'\">";
    for (body, fault) in [
        (
            "<script>nothing_of_this_name()</script>",
            "nothing_of_this_name",
        ),
        (
            "<script>console.error('out of paper')</script>",
            "out of paper",
        ),
        (
            &*format!("{policy}<script>1</script>"),
            "Content Security Policy",
        ),
    ] {
        let file = folder.file("page.html", body);
        let Some(page) = Page::open(&address(Path::new(&file)), WIDE) else {
            return;
        };
        page.sound_but(&[fault]);
        let seen = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| page.sound()));
        let said = seen.unwrap_err();
        let said = said.downcast_ref::<String>().unwrap();
        assert!(said.contains(fault), "{said}");
    }
}
