//! Files of markers: c3d2xyz, trc2xyz and csv2xyz, and back with xyz2c3d and xyz2trc.

use crate::common::{Numbers, command, fails, run, shared, text};
use predicates::str::contains;
use std::fs;
use std::path::Path;

/// A table of markers with a gap.
fn table() -> String {
    let mut out = "take,time,LASI.x,LASI.y,LASI.z,RASI 2.x,RASI 2.y,RASI 2.z\n".to_string();
    for t in 0..40 {
        let time = (30.0 + f64::from(t)) / 120.0;
        let (a, b) = (12.5 + 0.125 * f64::from(t), -3.75);
        let gap = (10..15).contains(&t);
        let second = if gap {
            ",,".into()
        } else {
            format!("{b},0,{a}")
        };
        out += &format!("walk,{time},{a},90.125,{b},{second}\n");
    }
    out
}

/// What follows the first cell of every line: the take's name is that of the file.
fn without_takes(table: &str) -> String {
    let rest = |line: &str| line.split_once(',').unwrap().1.to_string();
    table.lines().map(rest).collect::<Vec<_>>().join("\n")
}

/// The bytes that a command writes.
fn bytes(name: &str, args: &[&str], input: &str) -> Vec<u8> {
    let done = command(name)
        .args(args)
        .write_stdin(input)
        .assert()
        .success();
    done.get_output().stdout.clone()
}

/// The table of a C3D file of the collection, with the flags that the file asks for.
fn c3d(path: &Path) -> (Numbers, bool) {
    let bare = command("c3d2xyz")
        .args(["-q", "--model-outputs", text(path)])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&bare.stderr).into_owned();
    let asks = !bare.status.success();
    assert!(!asks || said.contains("give it with --u"), "{said}");
    let out = if asks {
        run(
            "c3d2xyz",
            &[
                "-q",
                "--model-outputs",
                "--units",
                "mm",
                "--up",
                "z",
                text(path),
            ],
            "",
        )
    } else {
        String::from_utf8(bare.stdout).unwrap()
    };
    (Numbers::read(&out), asks)
}

/// The greatest difference of two tables, cm, that miss the same values.
fn distance(a: &Numbers, b: &Numbers) -> f64 {
    assert_eq!((&a.points, a.rows.len()), (&b.points, b.rows.len()));
    let pairs = a.rows.iter().flatten().zip(b.rows.iter().flatten());
    let far = pairs.map(|(a, b)| match (a.is_nan(), b.is_nan()) {
        (true, true) => 0.0,
        (false, false) => (a - b).abs(),
        _ => f64::INFINITY,
    });
    far.fold(0.0, f64::max)
}

#[test]
fn a_table_becomes_a_file_and_the_same_table() {
    let folder = tempfile::tempdir().unwrap();
    for (write, read, flags) in [
        ("xyz2c3d", "c3d2xyz", &[][..]),
        ("xyz2c3d", "c3d2xyz", &["--units", "m", "--up", "y"]),
        ("xyz2trc", "trc2xyz", &[]),
        ("xyz2trc", "trc2xyz", &["--units", "cm", "--up", "z"]),
    ] {
        let file = folder.path().join("walk");
        run(
            write,
            &[&["-q", "-o", text(&file)], flags].concat(),
            &table(),
        );
        // A TRC file does not say what is up.
        let up = match (read, flags.is_empty()) {
            ("c3d2xyz", _) => &[][..],
            (_, true) => &["--up", "y"],
            (_, false) => &["--up", "z"],
        };
        let back = run(read, &[&["-q", text(&file)], up].concat(), "");
        let (back, table) = (Numbers::read(&back), Numbers::read(&table()));
        assert_eq!(back.time, table.time);
        // C3D files have single precision.
        let most = if write == "xyz2c3d" { 1e-5 } else { 1e-12 };
        let far = distance(&back, &table);
        assert!(far <= most, "{write} {flags:?}: {far}");
    }
}

#[test]
fn a_missing_point_of_a_new_c3d_file_has_a_residual_of_minus_1() {
    let file = bytes("xyz2c3d", &["-q"], &table());
    // Word 9 of the header is the block of the first frame; a frame is two points of four reals.
    let start = 512 * (usize::from(u16::from_le_bytes([file[16], file[17]])) - 1);
    for frame in 0..40 {
        for point in 0..2 {
            let at = start + 16 * (2 * frame + point);
            let real = |i: usize| {
                let at = at + 4 * i;
                f32::from_le_bytes([file[at], file[at + 1], file[at + 2], file[at + 3]])
            };
            let is_missing = point == 1 && (10..15).contains(&frame);
            assert_eq!(real(3), if is_missing { -1.0 } else { 0.0 });
            // Millimeters, z up: the second point is on the ground, 37.5 to the left.
            let x = [125.0 + 1.25 * frame as f32, -37.5][point];
            assert_eq!(real(0), if is_missing { 0.0 } else { x });
        }
    }
}

#[test]
fn points_are_put_into_a_file_and_nothing_else_changes() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("walk.c3d");
    fs::write(&file, bytes("xyz2c3d", &[], &table())).unwrap();
    let file = text(&file);
    assert_eq!(
        bytes("xyz2c3d", &["--into", file], &table()),
        fs::read(file).unwrap()
    );
    let few = crate::common::thin(&table(), 9, 1);
    let said = fails("xyz2c3d", &["--into", file], few.as_bytes(), 1);
    assert!(
        said.contains("has 9 frames") && said.contains("has 40"),
        "{said}"
    );
    let other = table().replace("LASI", "LPSI");
    let said = fails("xyz2c3d", &["--into", file], other.as_bytes(), 1);
    assert!(said.contains("a point \"LPSI\""), "{said}");
}

#[test]
fn a_cut_c3d_file_is_refused_or_read_as_far_as_it_goes() {
    let whole = bytes("xyz2c3d", &[], &table());
    let cut = &whole[..whole.len() - 600];
    let said = fails("c3d2xyz", &[], cut, 1);
    assert!(said.contains("of its 40 frames; --keep-whole"), "{said}");
    let kept = command("c3d2xyz")
        .arg("--keep-whole")
        .write_stdin(cut)
        .assert()
        .success()
        .stderr(contains("of its 40 frames"));
    let rows = kept.get_output().stdout.split(|b| *b == b'\n').count();
    assert!((20..41).contains(&rows), "{rows}");
    for (input, part) in [
        (&b""[..], "is empty"),
        (b"HIERARCHY\n", "bvh2xyz"),
        (b"PathFileType\t4\t(X/Y/Z)\n", "trc2xyz"),
        (b"time,a.x,a.y,a.z\n", "no C3D file"),
    ] {
        let said = fails("c3d2xyz", &[], input, 1);
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn c3d_files_of_many_systems_have_the_counts_of_an_independent_scanner() {
    let Some(list) = shared("expected/c3d-samples.txt") else {
        return;
    };
    let folder = list.parent().unwrap().join("../data/formats");
    let list = fs::read_to_string(list).unwrap();
    let (mut files, mut asking) = (0, Vec::new());
    for line in list.lines().skip(1) {
        let (file, facts) = line.split_once(": ").unwrap();
        let path = folder.join(file);
        if facts.contains("too short") {
            let said = fails("c3d2xyz", &[text(&path)], b"", 1);
            assert!(said.contains("is empty"), "{said}");
            continue;
        }
        let number = |key: &str| {
            let rest = facts.split_once(key).unwrap().1;
            let end = rest.find([' ', '%']).unwrap();
            rest[..end].parse::<f64>().unwrap()
        };
        let (table, asks) = c3d(&path);
        // The first column of each point that is no position.
        let firsts = [".rx", ".fx", ".mx", ".p", ".s"];
        let names = table.names.iter().enumerate();
        let others = names.filter(|(_, name)| firsts.iter().any(|end| name.ends_with(end)));
        let others: Vec<usize> = others.map(|(column, _)| column).collect();
        let points = table.points.len() + others.len();
        assert_eq!(points as f64, number("pts="), "{file}");
        assert_eq!(table.rows.len() as f64, number("frames="), "{file}");
        let cells = table.cells.iter();
        let empty = cells.flat_map(|row| others.iter().filter(|column| row[**column].is_empty()));
        let missing = table.missing() / 3 + empty.count();
        let missing = 100.0 * missing as f64 / (points * table.rows.len()) as f64;
        assert!(
            (missing - number("invalid ")).abs() <= 0.051,
            "{file}: {missing}"
        );
        let first = facts.split_once('(').unwrap().1;
        let first: f64 = first[..first.find("..").unwrap()].parse().unwrap();
        let time = (first - 1.0) / number("rate=");
        // The list rounds the rate.
        assert!((table.time[0] - time).abs() <= 1e-3 * time, "{file}");
        if asks {
            asking.push(path.file_name().unwrap().to_string_lossy().into_owned());
        }
        files += 1;
    }
    assert_eq!(files, 37);
    let wanted = [
        "phasespace_sample.c3d",
        "dynamic.C3D",
        "standing.C3D",
        "type1.C3D",
    ];
    assert_eq!(asking, wanted);
}

#[test]
fn the_byte_orders_and_number_kinds_of_a_c3d_file_give_one_table() {
    // Of sample02, some 60 values are a step of 0.28 mm apart in the files themselves.
    for (folder, files, step) in [
        (
            "sample01",
            "Eb015pi.c3d Eb015si.c3d Eb015vi.c3d Eb015pr.c3d Eb015sr.c3d Eb015vr.c3d",
            0.0,
        ),
        (
            "sample02",
            "pc_int.c3d sgi_int.c3d DEC_INT.C3D pc_real.c3d sgi_real.c3d Dec_real.c3d",
            0.0282,
        ),
    ] {
        let Some(folder) = shared(&format!("data/formats/c3d/{folder}")) else {
            return;
        };
        let tables: Vec<Numbers> = files.split(' ').map(|f| c3d(&folder.join(f)).0).collect();
        for (i, table) in tables.iter().enumerate() {
            let far = distance(&tables[3 * (i / 3)], table);
            assert!(far <= step, "{i}: {far}");
            // Reals round what an integer's step gives.
            let far = distance(&tables[0], table);
            assert!(far <= step + 2e-5, "{i}: {far}");
        }
    }
}

#[test]
fn into_changes_the_bytes_of_the_changed_points_alone() {
    for file in [
        "c3d/sample01/Eb015pi.c3d",
        "c3d/sample01/Eb015si.c3d",
        "c3d/sample01/Eb015vr.c3d",
        "c3d/sample02/Dec_real.c3d",
        "c3d/sample02/DEC_INT.C3D",
        "c3d/sample18/bad_parameter_section.c3d",
        "c3d/others/Res16bits.c3d",
        "c3d/pig/PiG_Motion-FlatFoot-Full.c3d",
    ] {
        let Some(path) = shared(&format!("data/formats/{file}")) else {
            return;
        };
        let before = fs::read(&path).unwrap();
        let table = run("c3d2xyz", &["-q", text(&path)], "");
        let into = |table: &str| bytes("xyz2c3d", &["-q", "--into", text(&path)], table);
        assert!(into(&table) == before, "{file}");
        let (filled, point) = filled(&table);
        let after = into(&filled);
        assert_eq!(before.len(), after.len());
        let changed: Vec<usize> = (0..before.len())
            .filter(|&i| before[i] != after[i])
            .collect();
        let span = changed[changed.len() - 1] - changed[0];
        assert!(span < 16, "{file}: {span}");
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("filled.c3d");
        fs::write(&copy, after).unwrap();
        let far = distance(&c3d(&copy).0, &Numbers::read(&filled));
        // An integer's step is at most a third of a millimeter in these files.
        assert!(far <= 0.02, "{file}, {point}: {far}");
    }
}

/// A table whose first gap, of one point in one frame, has a place; and where that is.
fn filled(table: &str) -> (String, String) {
    let mut lines: Vec<String> = table.lines().map(str::to_string).collect();
    let columns: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    for (i, line) in lines.iter_mut().enumerate() {
        let mut cells: Vec<&str> = line.split(',').collect();
        if let Some(c) = cells.iter().position(|cell| cell.is_empty()) {
            cells.splice(c..c + 3, ["10", "20", "30"]);
            let place = format!("row {i}, {}", columns[c]);
            *line = cells.join(",");
            return (lines.join("\n") + "\n", place);
        }
    }
    panic!("no gap");
}

const TRC: &str = "PathFileType\t4\t(X/Y/Z)\twalk.trc\r\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\r\n100.00\t100.00\t   3\t2\tmm\t100.00\t1\t   3\r\nFrame#\tTime\tHEAD\t\t\t HAND \t\t\t\r\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\t\r\n\r\n11\t0.100\t1\t2\t3\t4\t5\t6\t\r\n12\t0.110\t0.0\t0.0\t0.0\t\t\t\t7\t8\t9\r\n13\t0.120\tNaN\tNaN\tNaN\t4\t5\t6\r\n";

#[test]
fn trc_files_become_tables() {
    let done = command("trc2xyz")
        .args(["--up", "z"])
        .write_stdin(TRC)
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(
        said.contains("names 2 of its 3 points; the others are *3 to *3"),
        "{said}"
    );
    assert!(said.contains("1 positions are exactly 0 0 0"), "{said}");
    let table = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
    let read = Numbers::read(&table);
    assert_eq!(read.points, ["HEAD", "HAND", "*3"]);
    assert_eq!(read.time, [0.1, 0.11, 0.12]);
    let gap = f64::NAN;
    let rows = [
        [0.1, 0.3, -0.2, 0.4, 0.6, -0.5, gap, gap, gap],
        [0.0, 0.0, 0.0, gap, gap, gap, 0.7, 0.9, -0.8],
        [gap, gap, gap, 0.4, 0.6, -0.5, gap, gap, gap],
    ];
    let wanted = Numbers {
        rows: rows.iter().map(|row| row.to_vec()).collect(),
        ..read.clone()
    };
    assert!(distance(&read, &wanted) <= 1e-12, "{table}");
}

#[test]
fn what_a_trc_file_lacks_is_asked_for() {
    let said = fails("trc2xyz", &["-q"], TRC.as_bytes(), 1);
    assert!(
        said.contains("does not say its up axis; give it with --up"),
        "{said}"
    );
    let flags = ["-q", "--up", "y"];
    let unitless = TRC.replace("\tmm\t", "\t\t");
    let said = fails("trc2xyz", &flags, unitless.as_bytes(), 1);
    assert!(said.contains("--units"), "{said}");
    // Without DataRate, the times tell the rate; without times too, it is asked for.
    let rateless = TRC.replacen("100.00", "", 1);
    run("trc2xyz", &flags, &rateless);
    let timeless = ["0.100", "0.110", "0.120"];
    let timeless = timeless
        .iter()
        .fold(rateless, |text, t| text.replace(t, ""));
    assert!(fails("trc2xyz", &flags, timeless.as_bytes(), 1).contains("--fps"));
    let said = fails(
        "trc2xyz",
        &["-q", "--up", "y", "--fps", "60"],
        TRC.as_bytes(),
        2,
    );
    assert!(said.contains("contradicts"), "{said}");
    // Fewer rows than announced are all that there are, unless the last is cut off.
    let early = TRC.replace("   3\t2", "   5\t2");
    command("trc2xyz")
        .args(["--up", "y"])
        .write_stdin(early.clone())
        .assert()
        .success()
        .stderr(contains("announces 5 frames but has 3"));
    let cut = early.trim_end().trim_end_matches("\t5\t6");
    let said = fails("trc2xyz", &flags, cut.as_bytes(), 1);
    assert!(
        said.contains("ends after 2 of its 5 frames; --keep-whole"),
        "{said}"
    );
    run("trc2xyz", &["-q", "--up", "y", "--keep-whole"], cut);
    let far = TRC.replace("\t4\t5\t6\t", "\t4e300\t5\t6\t");
    let said = fails("trc2xyz", &flags, far.as_bytes(), 1);
    assert!(
        said.contains("frame 11: ") && said.contains("too large"),
        "{said}"
    );
}

#[test]
fn trc_files_of_many_programs_are_read_or_refused_for_a_reason() {
    let Some(folder) = shared("data/formats/trc") else {
        return;
    };
    for (name, frames, points) in [
        ("10002-20130626160334-Unnamed", 882, 10),
        ("10002-20130731010438-Unnamed", 1313, 37),
        ("Anto", 128, 34),
        ("Gait", 487, 92),
        ("Knee", 200, 71),
        ("Res16bits", 100, 44),
        ("SprintCalib", 337, 70),
        ("SprintMotion", 788, 59),
        ("UpperLimbStatic", 146, 36),
        ("MOTEK/T", 89, 41),
        ("MOTEK/ballet_reduced", 100, 41),
    ] {
        let path = folder.join(format!("{name}.trc"));
        let table = run("trc2xyz", &["-q", "--up", "z", text(&path)], "");
        let read = Numbers::read(&table);
        assert_eq!(
            (read.rows.len(), read.points.len()),
            (frames, points),
            "{name}"
        );
        let written = bytes("xyz2trc", &["-q", "--up", "z"], &table);
        let again = run(
            "trc2xyz",
            &["-q", "--up", "z"],
            &String::from_utf8(written).unwrap(),
        );
        assert_eq!(without_takes(&again), without_takes(&table), "{name}");
    }
    for (name, part) in [
        ("Empty", "is empty"),
        ("Truncated", "ends within its header"),
    ] {
        let path = folder.join(format!("{name}.trc"));
        let said = fails("trc2xyz", &["--up", "z", text(&path)], b"", 1);
        assert!(said.contains(part), "{said}");
    }
}

const MOTIVE: &str = "Format Version,1.23,Take Name,walk,Capture Frame Rate,120.000000,Export Frame Rate,120.000000,Total Exported Frames,2,Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global\n\n,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker\n,Name,Bat,Bat,Bat,Bat,Bat,Bat,Bat,\"Bat:1, tip\",\"Bat:1, tip\",\"Bat:1, tip\"\n,ID,1,1,1,1,1,1,1,2,2,2\n,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z\n0,0.000000,0,0,0,1,1,2,3,0.1,0.2,0.3\n1,0.008333,0,0,0,1,1,2,3,,,\n";

const QUALISYS: &str = "NO_OF_FRAMES\t2\r\nNO_OF_CAMERAS\t4\r\nNO_OF_MARKERS\t1\r\nFREQUENCY\t50\r\nDESCRIPTION\t--\r\nDATA_INCLUDED\t3D\r\nMARKER_NAMES\tNew 0000\r\nFrame\tTime\tNew 0000 X\tNew 0000 Y\tNew 0000 Z\t\r\n1\t0.00000\t10.000\t20.000\t30.000\r\n2\t0.02000\t\t\t\r\n";

#[test]
fn tables_of_motive_and_qualisys_are_known_by_their_first_line() {
    let motive = run("csv2xyz", &["-q", "--up", "y"], MOTIVE);
    assert_eq!(
        without_takes(&motive),
        "time,\"Bat:1, tip.x\",\"Bat:1, tip.y\",\"Bat:1, tip.z\"\n0,10,20,30\n0.008333333333333333,,,"
    );
    let bones = run("csv2xyz", &["-q", "--up", "y", "--points", "bones"], MOTIVE);
    assert!(
        bones.contains("Bat.x") && bones.contains("0,100,200,300"),
        "{bones}"
    );
    command("csv2xyz")
        .args(["--up", "y"])
        .write_stdin(MOTIVE)
        .assert()
        .stderr(contains("1 bones and rigid bodies, rotations are not (see --points)").count(1));
    let qualisys = run("csv2xyz", &["-q", "--units", "mm", "--up", "z"], QUALISYS);
    assert_eq!(
        without_takes(&qualisys),
        "time,New 0000.x,New 0000.y,New 0000.z\n0,1,3,-2\n0.02,,,"
    );
    for (flags, input, part) in [
        (&["-q"][..], MOTIVE, "does not say its up axis"),
        (&["-q", "--up", "z"], QUALISYS, "does not say its unit"),
        (&["-q", "--points", "bones"], QUALISYS, "leave --points out"),
        (
            &["-q", "--points", "expected"],
            MOTIVE,
            "no columns of expected markers",
        ),
        (&[], "time,a.x,a.y\n0,1,2\n", "two dimensions"),
        (&[], TRC, "trc2xyz"),
        (&[], "", "is empty"),
    ] {
        let said = fails("csv2xyz", flags, input.as_bytes(), 1);
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn real_tables_of_motive_and_qualisys_are_read() {
    let Some(folder) = shared("data/formats/csv") else {
        return;
    };
    let motive = folder.join("motive-example.csv");
    let motive = text(&motive);
    // It was cut for the collection.
    let said = fails("csv2xyz", &["-q", "--up", "y", motive], b"", 1);
    assert!(said.contains("ends after 32 of its 17263 frames"), "{said}");
    for (points, count) in [("markers", 82), ("expected", 54), ("bones", 51)] {
        let flags = [
            "-q",
            "--up",
            "y",
            "--keep-whole",
            "--points",
            points,
            motive,
        ];
        let table = Numbers::read(&run("csv2xyz", &flags, ""));
        assert_eq!((table.points.len(), table.rows.len()), (count, 32));
    }
    let qualisys = folder.join("Measurement1.tsv");
    let flags = ["-q", "--units", "mm", "--up", "z", text(&qualisys)];
    let table = Numbers::read(&run("csv2xyz", &flags, ""));
    assert_eq!((table.points.len(), table.rows.len()), (15, 2000));
    assert!((table.rows[0][0] - 81.9834).abs() <= 1e-9 && table.missing() == 0);
    assert_eq!(table.time[1999], 19.99);
}
