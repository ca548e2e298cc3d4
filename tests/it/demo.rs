//! The first minute.

use crate::common::{bin, text};
use std::process::Command;

#[test]
fn the_demo_restores_a_run_and_says_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let out = Command::new(bin().join("posing"))
        .arg("demo")
        .current_dir(folder.path())
        .output()
        .unwrap();
    let [said, commands] = [out.stdout, out.stderr].map(|s| String::from_utf8(s).unwrap());
    assert!(out.status.success(), "{said}\n{commands}");
    let row = |name: &str| -> Vec<String> {
        let line = said.lines().find(|line| line.starts_with(name)).unwrap();
        line.split_whitespace().skip(1).map(String::from).collect()
    };
    let number = |cell: &str| cell.parse::<f64>().unwrap();
    let (damaged, restored) = (row("damaged"), row("restored"));
    assert!(number(&damaged[0]) > 0.0 && damaged[1] == "–", "{said}");
    assert_eq!(restored[0], "0");
    assert!(number(&restored[2]) < 0.5 * number(&damaged[2]), "{said}");
    // Each command that it printed can be typed again.
    let typed = commands
        .lines()
        .filter_map(|line| line.strip_prefix("demo: posing "));
    assert_eq!(typed.clone().count(), 6);
    for line in typed.take(5) {
        let again = Command::new(bin().join("posing"))
            .args(line.split(' '))
            .current_dir(folder.path().join("posing-demo"))
            .output()
            .unwrap();
        assert!(again.status.success(), "{line}");
    }
    for name in [
        "demo.html",
        "restored.bvh",
        "truth.csv",
        "damaged.csv",
        "restored.csv",
    ] {
        let path = folder.path().join("posing-demo").join(name);
        assert!(path.metadata().unwrap().len() > 1000, "{}", text(&path));
    }
}
