//! Inputs and names that would lose data or fill the memory, and what the commands say of them.

use crate::common::{command, fails, run};

const TABLE: &str = "take,time,a.x,a.y,a.z,note\nw,0,1,2,3,x\nw,0.01,1.5,2,3,y\n";

#[test]
fn rows_without_end_are_refused_in_one_line() {
    let long = "x".repeat(20 << 20);
    for table in [
        format!("take,time,{long}.x\n"),
        format!("{TABLE}w,0.02,{},2,3,z\n", "1".repeat(20 << 20)),
        format!("{TABLE}w,0.02,\"{long}"),
    ] {
        let said = fails("denoise", &["--per-frame", "--force"], table.as_bytes(), 1);
        assert!(said.len() < 400, "{said}");
    }
}

#[test]
fn a_name_in_gz_or_zst_is_a_packed_file() {
    let folder = tempfile::tempdir().unwrap();
    for (name, magic) in [
        ("t.csv.gz", &b"\x1f\x8b"[..]),
        ("t.csv.zst", b"\x28\xb5\x2f\xfd"),
    ] {
        let path = folder.path().join(name).display().to_string();
        run("corrupt", &["-q", "--dense", "0", "-o", &path], TABLE);
        assert!(std::fs::read(&path).unwrap().starts_with(magic), "{name}");
        assert_eq!(run("corrupt", &["-q", "--dense", "0", &path], ""), TABLE);
    }
}

#[test]
fn an_array_says_what_it_does_not_hold() {
    let done = command("corrupt")
        .args(["--dense", "0", "--to", "npy"])
        .write_stdin(TABLE)
        .assert();
    let said = String::from_utf8_lossy(&done.success().get_output().stderr).into_owned();
    assert!(
        said.contains("NPY holds coordinates only: without take, time, note"),
        "{said}"
    );
}

#[test]
fn takes_of_one_file_name_stay_two() {
    let (Some(asf), Some(amc)) = (
        crate::common::cmu("07/07.asf"),
        crate::common::cmu("07/07_01.amc"),
    ) else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("07_01.amc");
    std::fs::copy(&amc, &other).unwrap();
    let done = command("amc2xyz")
        .arg("--asf")
        .arg(asf)
        .args(["--fps", "120"])
        .args([&amc, &other])
        .assert();
    let done = done.success();
    let table = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    let of = |take: &str| {
        table
            .lines()
            .filter(|l| l.split(',').next() == Some(take))
            .count()
    };
    assert!(
        of("07_01") > 100 && of("07_01") == of("07_01'"),
        "{} {}",
        of("07_01"),
        of("07_01'")
    );
    assert!(String::from_utf8_lossy(&done.get_output().stderr).contains("is the take 07_01'"));
}

#[test]
fn a_split_that_fails_leaves_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let parts = folder.path().join("parts").display().to_string();
    let rows = |shift: i32| {
        let rows = (0..40).map(|t| format!("w,0.{t:02},{},0,0\n", (t % 4) * 100 + shift));
        format!("take,time,a.x,a.y,a.z\n{}", rows.collect::<String>())
    };
    run("cluster", &["-q", "-k", "4", "--split", &parts], &rows(0));
    let first = std::fs::read(format!("{parts}/0.csv")).unwrap();
    std::fs::remove_file(format!("{parts}/3.csv")).unwrap();
    std::fs::create_dir(format!("{parts}/3.csv")).unwrap();
    fails(
        "cluster",
        &["-q", "-k", "4", "--split", &parts],
        rows(7).as_bytes(),
        1,
    );
    assert_eq!(std::fs::read(format!("{parts}/0.csv")).unwrap(), first);
    let left = std::fs::read_dir(&parts).unwrap().flatten();
    assert!(
        left.map(|e| e.file_name())
            .all(|n| !n.to_string_lossy().starts_with('.'))
    );
}

#[test]
fn models_of_another_kind_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.npz").display().to_string();
    let row = |t: i32| format!("{t},{},3,40,{},0,0,70,{}\n", t * t % 7, t % 5, t % 3);
    let rows: String = (0..30).map(row).collect();
    let table = format!("a.x,a.y,a.z,b.x,b.y,b.z,c.x,c.y,c.z\n{rows}");
    run(
        "prior-train",
        &["-q", "--kind", "gaussian", "-o", &path],
        &table,
    );
    let said = fails("encode", &["-m", &path], table.as_bytes(), 1);
    assert!(
        said.contains("is a model of kind gaussian, expected a dictionary"),
        "{said}"
    );
}
