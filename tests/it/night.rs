//! A night of raw takes: its page and its list say the same of each.

use crate::common::night::night;
use crate::common::{command, text};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Cleans and solves raw/ in a folder; its page and its list.
fn cleaned(folder: &Path) -> (String, Vec<Value>) {
    let args = ["-q", "raw", "--solve", "--outliers", "none", "-o", "solved"];
    let done = command("clean").current_dir(folder).args(args).output();
    assert_eq!(done.unwrap().status.code(), Some(3));
    let read = |name: &str| fs::read_to_string(folder.join("solved").join(name)).unwrap();
    let list = serde_json::from_str(&read("clean.json")).unwrap();
    (read("clean.html"), list)
}

/// The part of a page that is of a take.
fn part<'a>(page: &'a str, take: &str) -> &'a str {
    let mut parts = page.split("<tbody ").skip(1);
    let is_its = |part: &&str| part.contains(&format!(">{take}<"));
    parts
        .find(is_its)
        .unwrap()
        .split("</tbody>")
        .next()
        .unwrap()
}

#[test]
fn a_night_is_told_on_one_page_and_in_one_list() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("raw")).unwrap();
    night(&folder.path().join("raw"));
    let (page, list) = cleaned(folder.path());
    let row = |take: &str| list.iter().find(|row| row["file"] == take).unwrap();
    let named = row("nameless.csv");
    let by = named["named_by"].as_str().unwrap();
    assert!(by.contains("jumps.csv") && by.contains("walk.csv"), "{by}");
    assert!(named["names_fit"].as_f64().unwrap() > 0.9, "{named}");
    assert_eq!(row("walk.csv")["named_by"], Value::Null);
    assert!(part(&page, "nameless.csv").contains(by));
    // Each of two people has a file and a picture.
    let of = |person: &str| {
        let file = format!("two-{person}.bvh");
        json!({"person": person, "file": file, "none": null})
    };
    assert_eq!(row("two.csv")["people"], json!([of("Ann"), of("Bob")]));
    let two = part(&page, "two.csv");
    assert_eq!(two.matches("<svg").count(), 2);
    assert!(two.contains("<a href=\"two-Bob.bvh\">Bob</a>"));
    // What is said of eight markers is one line, with the frames and seconds of each.
    let jumps = row("jumps.csv");
    let findings = jumps["findings"].as_array().unwrap();
    let is_jump = |finding: &&Value| finding.as_str().unwrap().starts_with("jump: ");
    assert_eq!(findings.iter().filter(is_jump).count(), 8);
    let places = jumps["places"].as_array().unwrap();
    let second = findings.iter().position(|f| is_jump(&f)).unwrap() + 1;
    let place = places.iter().find(|p| p["finding"] == second).unwrap();
    assert_eq!(
        place,
        &json!({"finding": second, "what": "jump", "point": "RASI", "frames": [45, 46],
                "seconds": [0.45, 0.46]})
    );
    let told = part(&page, "jumps.csv");
    assert_eq!(told.matches("<b>jump</b>").count(), 1);
    assert!(told.contains("7 more like it"), "{told}");
    let link = "<a href=\"jumps.csv.html#frame=45&amp;trail=RASI\">RASI 0.45 s, frame 45</a>";
    assert!(told.contains(link), "{told}");
    let all: usize = findings.iter().map(|f| f.as_str().unwrap().len()).sum();
    let visible: usize = told
        .split('>')
        .filter_map(|t| Some(t.split_once('<')?.0.len()))
        .sum();
    assert!(visible < all, "{visible} of {all}");
    // Another run has all of it from the records.
    let (again, list_again) = cleaned(folder.path());
    let picture = |page: &str| part(page, "two.csv").matches("<path").count();
    assert_eq!(picture(&again), picture(&page));
    assert!(
        part(&again, "nameless.csv").contains("then cleaned: named, 1 solved"),
        "{again}"
    );
    for (was, is) in list.iter().zip(&list_again) {
        for key in [
            "named_by",
            "names_fit",
            "put_right",
            "people",
            "places",
            "findings",
        ] {
            assert_eq!(was[key], is[key], "{key}");
        }
    }
    // A record from before there were such things is read.
    let record = folder.path().join("solved/two.csv.json");
    let mut old: Value = serde_json::from_str(&fs::read_to_string(&record).unwrap()).unwrap();
    for key in ["people", "put_right", "named_by", "names_fit"] {
        old["summary"].as_object_mut().unwrap().remove(key);
    }
    fs::write(&record, old.to_string()).unwrap();
    let (page, _) = cleaned(folder.path());
    assert!(part(&page, "two.csv").contains("unchanged"));
}

/// Sound takes: a row each, and nothing below it.
#[test]
fn a_page_of_sound_takes_is_short() {
    let folder = tempfile::tempdir().unwrap();
    let (raw, one) = (folder.path().join("raw"), folder.path().join("one"));
    for folder in [&raw, &one] {
        fs::create_dir(folder).unwrap();
    }
    night(&one);
    for n in 0..30 {
        fs::copy(one.join("walk.csv"), raw.join(format!("walk{n}.csv"))).unwrap();
    }
    let clean = |out: &Path| {
        let args = ["-q", text(&raw), "-o", text(out)];
        let done = command("clean").args(args).output();
        assert_eq!(done.unwrap().status.code(), Some(0));
        fs::read_to_string(out.join("clean.html")).unwrap()
    };
    let page = clean(&folder.path().join("out"));
    assert!(page.contains("There are no findings."));
    assert!(!page.contains("class=\"more\"") && !page.contains("<li>"));
    assert_eq!(page.matches("<svg").count(), 30);
    let rows = &page[page.find("<tbody").unwrap()..];
    assert!(rows.len() < 30 * 1500, "{} bytes", rows.len());
}
