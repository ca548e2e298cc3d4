//! Files of other programs: text and arrays that `csv2xyz` and `clean` read, and files that are
//! named with the way that exists.

use crate::common::{Numbers, command, fails, run, shared, text};
use serde_json::Value;
use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

const NEXUS: &str = "Devices\r\n1000\r\n,,Plate - Force,,\r\nFrame,Sub Frame,Fx,Fy,Fz\r\n,,N,N,N\r\n11,0,1,2,3\r\n\r\nTrajectories\r\n100\r\n,,Ann:A,,,Bob:A,,\r\nFrame,Sub Frame,X,Y,Z,X,Y,Z\r\n,,mm,mm,mm,mm,mm,mm\r\n11,0,10,20,30,40,50,60\r\n12,0,10,20,30,,,\r\n";

const SIX_D: &str = "NO_OF_FRAMES\t1\nNO_OF_BODIES\t1\nFREQUENCY\t50\nDATA_INCLUDED\t6D\nBODY_NAMES\tFoot Left\n X\t Y\t Z\t Roll\t Pitch\t Yaw\t Residual\t Rot[0]\t Rot[1]\t Rot[2]\t Rot[3]\t Rot[4]\t Rot[5]\t Rot[6]\t Rot[7]\t Rot[8]\n10\t20\t30\t4.50\t5\t6\t0.2\t1\t0\t0\t0\t1\t0\t0\t0\t1\n";

const ANIPOSE: &str = "fnum,a_l_x,a_l_y,a_l_z,a_l_error\n0,1,2,3,0.50\n1,1,2,3,0.25\n";

const MOT: &str = "Coordinates\nversion=1\nnRows=3\nnColumns=3\ninDegrees=yes\n\nendheader\ntime\tpelvis_tilt\tknee_angle_r\n3.38\t0.00000\t-1.00000\n3.39\t3.97339\t-0.94496\n3.40\t7.78837\t-0.78589\n";

/// What follows the first cell of every line: the take's name is that of the file.
fn without_takes(table: &str) -> String {
    let rest = |line: &str| line.split_once(',').unwrap().1.to_string();
    table.lines().map(rest).collect::<Vec<_>>().join("\n")
}

#[test]
fn csv2xyz_reads_the_text_of_other_programs() {
    for (flags, input, table) in [
        (
            &["--up", "z"][..],
            NEXUS,
            "time,Ann:A.x,Ann:A.y,Ann:A.z,Bob:A.x,Bob:A.y,Bob:A.z\n0.1,1,3,-2,4,6,-5\n0.11,1,3,-2,,,",
        ),
        (
            &["--up", "z", "--units", "mm"],
            SIX_D,
            "time,Foot Left.x,Foot Left.y,Foot Left.z,Foot Left.rx,Foot Left.ry,Foot Left.rz\n0,1,3,-2,4.50,5,6",
        ),
        (
            &["--up", "y", "--units", "m", "--fps", "20"],
            ANIPOSE,
            "time,a_l.x,a_l.y,a_l.z,fnum,a_l_error\n0,100,200,300,0,0.50\n0.05,100,200,300,1,0.25",
        ),
        (
            &["--up", "y", "--units", "cm", "--fps", "20"],
            ",A,A,A\n,x,y,z\n0,1,2,3\n1,1,2,3\n",
            "time,A.x,A.y,A.z,index\n0,1,2,3,0\n0.05,1,2,3,1",
        ),
        (
            &[],
            MOT,
            "time,pelvis_tilt,knee_angle_r\n3.38,0.00000,-1.00000\n3.39,3.97339,-0.94496\n3.4,7.78837,-0.78589",
        ),
    ] {
        let out = run("csv2xyz", &[&["-q"], flags].concat(), input);
        assert_eq!(without_takes(&out), table);
    }
    for (flags, input, part) in [
        (&["-q"][..], NEXUS, "give it with --up z"),
        (&["-q", "--up", "z"], SIX_D, "give it with --units mm"),
        (
            &["-q", "--up", "y", "--units", "m"],
            ANIPOSE,
            "give it with --fps F",
        ),
        (
            &["-q"],
            "bodyparts,A,A\ncoords,x,y\n0,1,2\n",
            "two dimensions",
        ),
    ] {
        let said = fails("csv2xyz", flags, input.as_bytes(), 1);
        assert!(said.contains(part), "{said}");
    }
    // Tables of points are converted first: their unit is not known.
    let said = fails("complete", &["-q"], ANIPOSE.as_bytes(), 1);
    assert!(said.contains("convert it with csv2xyz"), "{said}");
}

/// Runs `clean` on a file; its exit code and what it said.
fn clean(input: &Path, output: &Path, flags: &[&str]) -> (i32, String) {
    let done = command("clean")
        .args([&[text(input), "-o", text(output), "--force"], flags].concat())
        .output()
        .unwrap();
    let said = [done.stdout, done.stderr].concat();
    let said = String::from_utf8_lossy(&said).into_owned();
    (done.status.code().unwrap(), said)
}

/// Coordinates of some points that move, in a frame.
fn moving(frame: usize, points: usize) -> Vec<f64> {
    let at = |i: usize| {
        let phase = frame as f64 / 15.0 + i as f64;
        (1000.0 + 300.0 * (i as f64 * 1.7).sin() + 40.0 * phase.sin() * 10.0).round() / 10.0
    };
    (0..3 * points).map(at).collect()
}

#[test]
fn clean_fills_each_in_its_own_format() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let points = 6;
    let cells = |t: usize, separator: &str| {
        let is_gap = (20..24).contains(&t);
        let cell = |(i, v): (usize, f64)| {
            if is_gap && (3..6).contains(&i) {
                String::new()
            } else {
                format!("{v:.2}")
            }
        };
        let cells: Vec<String> = moving(t, points)
            .into_iter()
            .enumerate()
            .map(cell)
            .collect();
        cells.join(separator)
    };
    let repeated = |what: &dyn Fn(usize) -> String| -> String {
        (0..points).map(what).collect::<Vec<_>>().join(",")
    };
    let rows = |row: &dyn Fn(usize) -> String| (0..60).map(row).collect::<String>();
    let nexus = format!(
        "\u{feff}Trajectories\r\n100\r\n,,{}\r\nFrame,Sub Frame,{}\r\n,,{}\r\n{}\r\nDevices\r\n1000\r\n,,F\r\nFrame,Sub Frame,F\r\n,,N\r\n1,0,5\r\n",
        repeated(&|p| format!("S:P{p},,")),
        repeated(&|_| "X,Y,Z".into()),
        repeated(&|_| "mm,mm,mm".into()),
        rows(&|t| format!("{},0,{}\r\n", t + 7, cells(t, ","))),
    );
    let titled = format!(
        "fnum;{};note\n{}",
        repeated(&|p| format!("p_{p}_x,p_{p}_y,p_{p}_z")).replace(',', ";"),
        rows(&|t| format!("{t};{};\"a;b\"\n", cells(t, ";"))),
    );
    for (name, file, flags) in [
        ("nexus.csv", nexus, &["--up", "z"][..]),
        (
            "titled.csv",
            titled,
            &["--up", "y", "--units", "cm", "--fps", "100"],
        ),
    ] {
        fs::write(at(name), &file).unwrap();
        let result = at(&format!("out-{name}"));
        let (code, said) = clean(&at(name), &result, flags);
        assert!(code == 0 || code == 3, "{name}: {said}");
        let result = fs::read_to_string(&result).unwrap();
        let pairs: Vec<(&str, &str)> = file.lines().zip(result.lines()).collect();
        assert_eq!(file.lines().count(), result.lines().count(), "{name}");
        let changed = pairs.iter().filter(|(a, b)| a != b).count();
        assert_eq!(changed, 4, "{name}: {said}");
        for (before, after) in pairs.iter().filter(|(a, b)| a != b) {
            let parted = |line: &str| {
                line.replace(';', ",")
                    .split(',')
                    .map(String::from)
                    .collect()
            };
            let (before, after): (Vec<String>, Vec<String>) = (parted(before), parted(after));
            let differ = before.iter().zip(&after).filter(|(a, b)| a != b);
            assert!(differ.clone().all(|(a, b)| a.is_empty() && !b.is_empty()));
            assert_eq!(differ.count(), 3);
        }
        assert_eq!(file.ends_with("\r\n"), result.ends_with("\r\n"));
    }
}

#[test]
fn clean_copies_columns_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("in")).unwrap();
    fs::write(at("in/angles.mot"), MOT).unwrap();
    let model = zipped(&[("meta", "|u1", "(1,)", vec![0])]);
    fs::write(at("in/model.npz"), model).unwrap();
    let (code, said) = clean(&at("in"), &at("out/"), &[]);
    assert_eq!(code, 0, "{said}");
    assert_eq!(fs::read_to_string(at("out/angles.mot")).unwrap(), MOT);
    assert!(!at("out/model.npz").exists(), "{said}");
    let record = fs::read(at("out/angles.mot.json")).unwrap();
    let record: Value = serde_json::from_slice(&record).unwrap();
    let notes = record["summary"]["notes"].to_string();
    assert!(notes.contains("copied: there are no positions"), "{notes}");
}

/// The bytes of an archive of arrays: name, type, shape, values.
fn zipped(arrays: &[(&str, &str, &str, Vec<u8>)]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, descr, shape, values) in arrays {
        let options = zip::write::SimpleFileOptions::default();
        zip.start_file(format!("{name}.npy"), options).unwrap();
        zip.write_all(&array(descr, shape, values)).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// The bytes of an array.
fn array(descr: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\0", &length[..], header.as_bytes(), values].concat()
}

fn f4(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    let bytes = |v: f64| (v as f32).to_le_bytes();
    values.into_iter().flat_map(bytes).collect()
}

/// AMASS' markers, meters, z up: two frames of six.
fn amass() -> Vec<u8> {
    let labels: Vec<u8> = (0..6)
        .flat_map(|p| format!("P{p}").chars().map(u32::from).collect::<Vec<_>>())
        .flat_map(u32::to_le_bytes)
        .collect();
    let meters = (0..2).flat_map(|t| moving(t, 6)).map(|v| v / 100.0);
    zipped(&[
        ("poses", "<f4", "(2, 3)", f4([0.0; 6])),
        ("betas", "<f4", "(1,)", f4([0.0])),
        ("mocap_framerate", "<f4", "()", f4([100.0])),
        ("marker_data", "<f4", "(2, 6, 3)", f4(meters)),
        ("marker_labels", "<U2", "(6,)", labels),
    ])
}

#[test]
fn every_command_reads_positions_of_archives() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: Vec<u8>| -> PathBuf {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    let file = put("walk.npz", amass());
    let done = command("trim").arg(&file).output().unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert_eq!(said.matches("meters, z up").count(), 1, "{said}");
    let table = Numbers::read(&String::from_utf8(done.stdout).unwrap());
    assert_eq!((table.points[5].as_str(), table.rows.len()), ("P5", 2));
    assert_eq!(table.time, [0.0, 0.01]);
    // z up in the file, y up in the table; centimeters.
    let is_near = |a: f64, b: f64| (a - b).abs() <= 1e-4;
    let first = moving(0, 6);
    assert!(is_near(table.rows[0][0], first[0]) && is_near(table.rows[0][1], first[2]));
    assert!(is_near(table.rows[0][2], -first[1]));
    // What the flags say is what the file has, once.
    let given = run(
        "trim",
        &["-q", "--units", "m", "--up", "z", text(&file)],
        "",
    );
    let given = Numbers::read(&given);
    assert!(is_near(100.0 * given.rows[0][1], first[1]));
    let same = Numbers::read(&run("csv2xyz", &["-q", text(&file)], ""));
    assert!(is_near(same.rows[1][4], table.rows[1][4]));
    let result = folder.path().join("out.npz");
    let (code, said) = clean(&file, &result, &[]);
    assert!(code == 0 || code == 3, "{said}");
    assert_eq!(
        Numbers::read(&run("trim", &["-q", text(&result)], "")).points,
        table.points
    );

    let parameters = zipped(&[
        ("poses", "<f4", "(1, 3)", f4([0.0; 3])),
        ("trans", "<f4", "(1, 3)", f4([0.0; 3])),
    ]);
    let parameters = put("poses.npz", parameters);
    for name in ["audit", "complete", "csv2xyz"] {
        let said = command(name).arg(&parameters).output().unwrap();
        let said = String::from_utf8_lossy(&[said.stdout, said.stderr].concat()).into_owned();
        assert!(
            said.contains("SMPL body and no positions"),
            "{name}: {said}"
        );
    }
}

#[test]
fn arrays_of_smpl_joints_have_names_and_no_silent_size() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("joints.npy");
    let meters = (0..2).flat_map(|t| moving(t, 22)).map(|v| v / 100.0);
    fs::write(&file, array("<f4", "(2, 22, 3)", &f4(meters))).unwrap();
    let file = text(&file);
    let said = fails("trim", &[file], b"", 1);
    assert!(said.contains("--joints (smpl"), "{said}");
    let said = fails("csv2xyz", &["--joints", "smpl", file], b"", 1);
    assert!(said.contains("give it with --units"), "{said}");
    let done = command("trim")
        .args(["--joints", "smpl", file])
        .output()
        .unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(said.contains("give --units m"), "{said}");
    let flags = [
        "-q",
        "--joints",
        "smpl",
        "--units",
        "m",
        "--out-units",
        "cm",
        file,
    ];
    let table = Numbers::read(&run("trim", &flags, ""));
    assert_eq!(
        (table.points[0].as_str(), table.points[21].as_str()),
        ("pelvis", "right_wrist")
    );
    assert!((table.rows[1][7] - moving(1, 22)[7]).abs() <= 1e-4);
}

#[test]
fn foreign_files_are_named_with_the_way_that_exists() {
    let folder = tempfile::tempdir().unwrap();
    for (name, start, what) in [
        ("a", &b"glTF\x02\0\0\0P\0\0\0<\0\0\0JSON{}"[..], "GLB"),
        ("b", b"Kaydara FBX Binary  \0\x1a\0\xe8\x1c\0\0", "FBX"),
        (
            "c",
            b"<?xml version=\"1.0\"?>\n<mvnx version=\"4\"/>\n",
            "MVNX",
        ),
        ("d", b"\x89HDF\r\n\x1a\n\0\0\0\0\0\x08\x08\0", "HDF5"),
        ("e", b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "MATLAB"),
        ("f", b"{\"asset\": {\"version\": \"2.0\"}}", "glTF"),
        (
            "g",
            b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1\0\0\0\0",
            "compound file",
        ),
        (
            "h",
            b"\x01\x02\x03\xff\xfe\x80\x81\x82\x83\x84\x85\x86\x87",
            "binary file",
        ),
    ] {
        // The name says nothing.
        let file = folder.path().join(name);
        fs::write(&file, start).unwrap();
        for command_name in [
            "audit", "complete", "c3d2xyz", "trc2xyz", "csv2xyz", "bvh2xyz",
        ] {
            let done = command(command_name).arg(&file).output().unwrap();
            let said = [done.stdout, done.stderr].concat();
            let said = String::from_utf8_lossy(&said).into_owned();
            assert!([Some(1), Some(3)].contains(&done.status.code()), "{said}");
            let is_known = command_name != "bvh2xyz" || name != "h";
            assert!(said.contains(what) || !is_known, "{command_name}: {said}");
            assert!(!said.contains("iconv"), "{command_name}: {said}");
        }
        let result = folder.path().join("out").join(name);
        let (code, said) = clean(&file, &result, &[]);
        assert!(
            code == 1 && said.contains(what) && !result.exists(),
            "{said}"
        );
    }
}

#[test]
fn field_files_of_other_programs_are_read() {
    let Some(folder) = shared("data/field") else {
        return;
    };
    for (name, flags) in [
        ("vicon-nexus", &["--up", "z"][..]),
        ("vicon-nexus-devices", &["--up", "z"]),
        ("qtm-6d", &["--up", "z", "--units", "mm"]),
        (
            "table-underscore",
            &["--up", "y", "--units", "cm", "--fps", "100"],
        ),
        (
            "table-two-rows",
            &["--up", "y", "--units", "cm", "--fps", "100"],
        ),
    ] {
        let extension = if name == "qtm-6d" { "tsv" } else { "csv" };
        let file = folder.join(format!("{name}.{extension}"));
        let table = run("csv2xyz", &[&["-q", text(&file)], flags].concat(), "");
        let table = Numbers::read(&table);
        let truth = fs::read_to_string(folder.join(format!("{name}.truth.csv"))).unwrap();
        let truth = Numbers::read(&truth);
        assert_eq!(table.points, truth.points, "{name}");
        let (far, _) = table.far(&truth);
        assert!(far <= 0.002, "{name}: {far}");
    }
}

#[test]
fn rigid_bodies_of_tracker_keep_their_rotations() {
    let tracker = "Objects\n100\n,,Wand:Wand,,,,,\nFrame,Sub Frame,RX,RY,RZ,TX,TY,TZ\n\
                   ,,deg,deg,deg,mm,mm,mm\n1,0,1.50,2,3,10,20,30\n2,0,1.50,2,3,10,20,31\n";
    let table = run("csv2xyz", &["-q", "--up", "z", "-"], tracker);
    let wanted = "Wand.x,Wand.y,Wand.z,Wand.rx,Wand.ry,Wand.rz";
    assert!(
        table.starts_with(&format!("take,time,{wanted}\n")),
        "{table}"
    );
    assert!(
        table.contains(",0,1,3,-2,1.50,2,3\n") && table.contains(",0.01,1,3.1,-2,"),
        "{table}"
    );
    let folder = tempfile::tempdir().unwrap();
    let [input, output] = ["in.csv", "out.csv"].map(|name| folder.path().join(name));
    fs::write(&input, tracker).unwrap();
    run(
        "clean",
        &["-q", "--up", "z", text(&input), "-o", text(&output)],
        "",
    );
    assert_eq!(fs::read_to_string(output).unwrap(), tracker);
    let said = fails("complete", &["-q"], tracker.as_bytes(), 1);
    assert!(said.contains("is a Vicon CSV file: convert"), "{said}");
}

#[test]
fn a_long_table_is_the_wide_one() {
    let folder = tempfile::tempdir().unwrap();
    let at_path = |name: &str| folder.path().join(name);
    let (mut wide, mut long) = (
        "frame".to_string(),
        "point,z,y,x,frame,likelihood\n".to_string(),
    );
    (0..6).for_each(|p| wide += &format!(",p{p}_x,p{p}_y,p{p}_z"));
    wide += "\n";
    for t in 0..60 {
        wide += &t.to_string();
        for p in 0..6 {
            let [x, y, z] = [0, 1, 2].map(|c| format!("{:.4}", moving(t, 6)[3 * p + c]));
            let is_seen = p != 2 || !(20..24).contains(&t);
            wide += &if is_seen {
                format!(",{x},{y},{z}")
            } else {
                ",,,".into()
            };
            if is_seen {
                long += &format!("p{p},{z},{y},{x},{t},0.5\n");
            }
        }
        wide += "\n";
    }
    let flags = ["-q", "--units", "cm", "--up", "z", "--fps", "30"];
    let [wide_table, long_table] =
        [&wide, &long].map(|input| Numbers::read(&run("csv2xyz", &flags, input)));
    assert_eq!(wide_table.points, long_table.points);
    assert_eq!(wide_table.far(&long_table).0, 0.0);
    fs::write(at_path("long.csv"), &long).unwrap();
    let (input, output) = (at_path("long.csv"), at_path("out.csv"));
    run(
        "clean",
        &[&flags[..], &[text(&input), "-o", text(&output)]].concat(),
        "",
    );
    let cleaned = fs::read_to_string(output).unwrap();
    assert_eq!(Numbers::read(&cleaned).points, long_table.points);
    assert!(!cleaned.contains(",,"), "{cleaned}");
    let said = fails("complete", &["-q"], long.as_bytes(), 1);
    assert!(said.contains("convert it with csv2xyz"), "{said}");
}
