//! C3D and TRC files of many makers, that contradict themselves or are written otherwise than most.

use crate::common::{Numbers, command, fails, run, shared, skipped, text};
use std::fs;
use std::path::{Path, PathBuf};

/// A file of the collection of faults, and its right table.
fn field(name: &str) -> Option<(PathBuf, Option<Numbers>)> {
    let Some(path) = shared(&format!("data/field/{name}")) else {
        skipped(&format!("no ../shared/data/field/{name}"));
        return None;
    };
    let truth = path.with_extension("").with_extension("truth.csv");
    let truth = fs::read_to_string(truth).ok();
    Some((path, truth.map(|truth| Numbers::read(&truth))))
}

/// Asserts that a table has the points and the values of another, within .002 cm.
fn same(table: &Numbers, truth: &Numbers, name: &str) {
    assert_eq!(table.points, truth.points, "{name}");
    assert_eq!(table.rows.len(), truth.rows.len(), "{name}");
    let pairs = table.rows.iter().flatten().zip(truth.rows.iter().flatten());
    for (own, right) in pairs {
        let agrees = (own - right).abs() <= 0.002 || own.is_nan() && right.is_nan();
        assert!(agrees, "{name}: {own}, right {right}");
    }
}

/// The missing positions that `audit --json` counts.
fn audited(path: &Path, flags: &[&str]) -> usize {
    let done = command("audit")
        .args(flags)
        .args(["--json", text(path)])
        .output()
        .unwrap();
    let audit: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    let points = audit[0]["takes"][0]["gaps"]["by_point"].as_array().unwrap();
    let frames = points.iter().map(|point| point["frames"].as_u64().unwrap());
    frames.sum::<u64>() as usize
}

/// The table of a file that `clean` wrote, with its notes.
fn cleaned(path: &Path, flags: &[&str]) -> (PathBuf, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join(path.file_name().unwrap());
    let mut args = vec!["--self", text(path), "-o", text(&out)];
    args.extend(flags);
    let done = command("clean").args(args).output().unwrap();
    assert!(matches!(done.status.code(), Some(0 | 3)), "{done:?}");
    (out, folder)
}

#[test]
fn files_are_read_audited_and_cleaned_as_their_truth() {
    let up: &[&str] = &["--up", "y"];
    for (name, reader, flags, said) in [
        ("c3d-hidden-32768-real.c3d", "c3d2xyz", &[][..], ""),
        ("c3d-hidden-sign-bit-int.c3d", "c3d2xyz", &[], ""),
        (
            "c3d-analog-count-contradicts.c3d",
            "c3d2xyz",
            &[],
            "its header says 16 analog values",
        ),
        (
            "c3d-y-screen-minus-z.c3d",
            "c3d2xyz",
            &[],
            "z is taken for up",
        ),
        (
            "c3d-angles-among-points.c3d",
            "c3d2xyz",
            &[],
            "--model-outputs",
        ),
        ("c3d-first-frame-elsewhere.c3d", "c3d2xyz", &[], ""),
        ("trc-time-3.38.trc", "trc2xyz", up, ""),
        ("trc-double-tabs.trc", "trc2xyz", up, ""),
        ("trc-rows-end-in-tab.trc", "trc2xyz", up, ""),
        (
            "trc-numframes-too-large.trc",
            "trc2xyz",
            up,
            "announces 109 frames but has 30",
        ),
        ("trc-cr.trc", "trc2xyz", up, ""),
        ("trc-blank-line-lower-case.trc", "trc2xyz", up, ""),
    ] {
        let Some((path, Some(truth))) = field(name) else {
            return;
        };
        let done = command(reader).args(flags).arg(&path).output().unwrap();
        let stderr = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{name}: {stderr}");
        if said.is_empty() {
            assert_eq!(stderr, "", "{name}")
        } else {
            assert_eq!(stderr.matches(said).count(), 1, "{name}: {stderr}")
        }
        let table = Numbers::read(&String::from_utf8_lossy(&done.stdout));
        same(&table, &truth, name);
        for (own, right) in table.time.iter().zip(&truth.time) {
            assert!((own - right).abs() < 1e-9, "{name}: {own}, right {right}");
        }
        let missing = truth.rows.iter().flatten().filter(|v| v.is_nan()).count() / 3;
        assert_eq!(audited(&path, flags), missing, "{name}");
        let (out, _folder) = cleaned(&path, &[flags, &["--outliers", "none"]].concat());
        let back = Numbers::read(&run(reader, &[&["-q"], flags, &[text(&out)]].concat(), ""));
        assert_eq!(back.time, table.time, "{name}");
        let pairs = back.rows.iter().flatten().zip(table.rows.iter().flatten());
        for (new, old) in pairs.filter(|(_, old)| !old.is_nan()) {
            assert!((new - old).abs() <= 1e-4, "{name}: {new}, was {old}");
        }
    }
}

#[test]
fn a_jump_of_the_whole_body_in_the_first_frame_is_a_cut() {
    let Some((path, Some(truth))) = field("c3d-first-frame-elsewhere.c3d") else {
        return;
    };
    let (out, _folder) = cleaned(&path, &[]);
    let back = Numbers::read(&run("c3d2xyz", &["-q", text(&out)], ""));
    for (new, old) in back.rows.iter().flatten().zip(truth.rows.iter().flatten()) {
        assert!(new.is_finite() && (old.is_nan() || (new - old).abs() <= 0.01));
    }
}

/// A C3D file of integers, one point and so many frames, which header and POINT:FRAMES count no
/// further than 16 bits do.
fn long(frames: usize) -> Vec<u8> {
    let mut section = vec![1, 80, 1, 84];
    let mut entry = |group: i8, name: &str, value: &[u8]| {
        section.extend([name.len() as u8, group as u8]);
        section.extend(name.as_bytes());
        section.extend((2 + value.len() as u16 + 1).to_le_bytes());
        section.extend(value);
        section.push(0);
    };
    entry(-1, "POINT", &[]);
    entry(1, "FRAMES", &[2, 0, 0xff, 0xff]);
    entry(1, "UNITS", &[0xff, 1, 2, b'm', b'm']);
    entry(1, "Y_SCREEN", &[0xff, 1, 2, b'+', b'Z']);
    section.resize(512, 0);
    let mut file = vec![2, 80];
    for word in [1, 0, 1, 65_535, 10] {
        file.extend(u16::to_le_bytes(word));
    }
    file.extend(0.1_f32.to_le_bytes());
    file.extend(3_u16.to_le_bytes());
    file.extend(0_u16.to_le_bytes());
    file.extend(100_f32.to_le_bytes());
    file.resize(512, 0);
    file.extend(section);
    for t in 0..frames {
        let numbers = [(t % 1000) as u16, 500, 900, 0];
        file.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
    }
    file.resize(file.len().next_multiple_of(512), 0);
    file
}

#[test]
fn frames_beyond_what_the_header_counts_are_read_by_the_length() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.c3d");
    fs::write(&path, long(70_000)).unwrap();
    let done = command("c3d2xyz").arg(&path).output().unwrap();
    let table = String::from_utf8(done.stdout).unwrap();
    assert_eq!(table.lines().count(), 70_001);
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(
        said.contains("counts 65535 frames") && said.contains("70000"),
        "{said}"
    );
}

#[test]
fn a_file_without_points_says_what_it_has() {
    let Some((path, _)) = field("c3d-rotations-only.c3d") else {
        return;
    };
    let said = fails("c3d2xyz", &[text(&path)], b"", 1);
    assert!(said.contains("5 rotations of segments"), "{said}");
    let audit = run_any("audit", &[text(&path)]);
    assert!(audit.contains("5 rotations of segments"), "{audit}");
}

/// What a command says on both streams, whatever its exit code.
fn run_any(name: &str, args: &[&str]) -> String {
    let done = command(name).args(args).output().unwrap();
    String::from_utf8_lossy(&[done.stdout, done.stderr].concat()).into_owned()
}

#[test]
fn model_outputs_are_columns_of_their_own() {
    let Some((path, Some(truth))) = field("c3d-angles-among-points.c3d") else {
        return;
    };
    let plain = Numbers::read(&run("c3d2xyz", &["-q", text(&path)], ""));
    assert_eq!(plain.names.len(), 2 + 3 * truth.points.len());
    let table = run("c3d2xyz", &["-q", "--model-outputs", text(&path)], "");
    let numbers = Numbers::read(&table);
    same(&numbers, &truth, "--model-outputs");
    let columns = path.with_extension("").with_extension("columns.json");
    let right: serde_json::Value = serde_json::from_slice(&fs::read(columns).unwrap()).unwrap();
    let endings = |name: &str| match &name[name.len() - 5..] {
        "ngles" => &["rx", "ry", "rz"][..],
        "Force" => &["fx", "fy", "fz"],
        "oment" => &["mx", "my", "mz"],
        _ => &["p"],
    };
    for (name, values) in right.as_object().unwrap() {
        for (c, ending) in endings(name).iter().enumerate() {
            let column = numbers
                .names
                .iter()
                .position(|n| *n == format!("{name}.{ending}"));
            for (row, value) in numbers.cells.iter().zip(values.as_array().unwrap()) {
                let own: f64 = row[column.unwrap()].parse().unwrap();
                let parts = value
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|v| v.as_f64().unwrap());
                let wanted = match endings(name).len() {
                    1 => parts.sum::<f64>(),
                    _ => parts.collect::<Vec<f64>>()[c],
                };
                assert!(
                    (own - wanted).abs() < 0.02,
                    "{name}.{ending}: {own}, {wanted}"
                );
            }
        }
    }
    // They travel with the table, and the file keeps its own.
    let done = command("xyz2c3d")
        .args(["-q", "--into", text(&path)])
        .write_stdin(table)
        .assert()
        .success();
    assert_eq!(done.get_output().stdout, fs::read(&path).unwrap());
}

#[test]
fn zeros_are_missing_where_that_is_said() {
    let Some((path, Some(truth))) = field("c3d-zeros.c3d") else {
        return;
    };
    let said = run_any("c3d2xyz", &["-o", "/dev/null", text(&path)]);
    assert!(
        said.contains("exactly 0 0 0") && said.contains("--zeros-are-missing"),
        "{said}"
    );
    let table = run("c3d2xyz", &["-q", "--zeros-are-missing", text(&path)], "");
    same(&Numbers::read(&table), &truth, "--zeros-are-missing");
    let missing = truth.rows.iter().flatten().filter(|v| v.is_nan()).count() / 3;
    assert_eq!(audited(&path, &["--zeros-are-missing"]), missing);
    assert!(run_any("audit", &[text(&path)]).contains("--zeros-are-missing"));
}

const TRC: &str = "PathFileType\t4\t(X/Y/Z)\twalk.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n100.00\t100.00\t3\t1\tmm\t100.00\t1\t3\nFrame#\tTime\tHEAD\t\t\t\n\t\tX1\tY1\tZ1\t\n\n1\t3.3838\t1\t2\t3\n2\t3.3938\t0\t0\t0\n3\t3.4038\t4\t5\t6\n";

#[test]
fn times_of_a_trc_file_go_there_and_back() {
    let table = run("trc2xyz", &["-q", "--up", "y"], TRC);
    let back = run("xyz2trc", &["-q"], &table);
    for time in ["3.3838", "3.3938", "3.4038"] {
        assert!(back.contains(&format!("\t{time}\t")), "{back}");
    }
    let empty = run("trc2xyz", &["-q", "--up", "y", "--zeros-are-missing"], TRC);
    assert!(empty.contains("3.3938,,,"), "{empty}");
}

#[test]
fn texts_in_utf16_are_read() {
    let table = run("trc2xyz", &["-q", "--up", "y"], TRC);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("walk.trc");
    for (mark, order) in [
        ("\u{feff}", u16::to_le_bytes as fn(u16) -> [u8; 2]),
        ("", u16::to_be_bytes),
    ] {
        let units = format!("{mark}{TRC}");
        let bytes: Vec<u8> = units.encode_utf16().flat_map(order).collect();
        let done = command("trc2xyz")
            .args(["-q", "--up", "y"])
            .write_stdin(bytes.clone())
            .assert()
            .success();
        assert_eq!(String::from_utf8_lossy(&done.get_output().stdout), table);
        fs::write(&path, bytes).unwrap();
        let said = run_any("audit", &["--up", "y", text(&path)]);
        assert!(said.contains("3 frames"), "{said}");
    }
}
