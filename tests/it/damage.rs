//! Thousands of damaged files for every reader: no panic, no endless loop, no memory out of
//! proportion, and errors of one line that name the file.

use posing::io::{Asf, Input, Model, amc};
use posing::io::{Table, TableOptions};
use posing::numeric::parallel::rng;
use posing::prior::rigid_pairs::RigidPairs;
use rand::Rng;
use std::io::Cursor;
use std::time::Duration;

const FILES: u64 = 10_000;
const NAME: &str = "damaged.file";

const ASF: &str = "# made for tests\n:version 1.10\n:name t\n:units\n  mass 1.0\n  length 0.45\n  angle deg\n:documentation\n  none\n:root\n  order TX TY TZ RX RY RZ\n  axis XYZ\n  position 0 0 0\n  orientation 0 0 0\n:bonedata\n  begin\n    id 1\n    name hip\n    direction 0.6 -0.7 0.3\n    length 2.4\n    axis 0 0 0 XYZ\n  end\n  begin\n    id 2\n    name leg\n    direction 0.3 -0.9 0\n    length 7.1\n    axis 0 0 20 XYZ\n    dof rx ry rz\n    limits (-160.0 20.0)\n           (-70.0 70.0)\n           (-60.0 70.0)\n  end\n:hierarchy\n  begin\n    root hip\n    hip leg\n  end\n";

fn take() -> String {
    let mut text = String::from("#!made for tests\n:FULLY-SPECIFIED\n:DEGREES\n");
    for i in 1..12 {
        text += &format!(
            "{i}\nroot 9.3722 {i}.8693 -17.3198 -2.01677 -3.38 -3.0578\nleg -13.{i} 2.5 1e-014\n"
        );
    }
    text
}

fn table() -> String {
    let mut text = String::from("take,time,root.x,root.y,root.z,note,lwrist.x,lwrist.y,lwrist.z\n");
    for i in 0..12 {
        text += &format!(
            "walk,{},1.5,{i}.25,-3,\"so, so\",,4.125,1e-3\n",
            f64::from(i) / 120.0
        );
    }
    text
}

/// What stands before an array's numbers.
fn head(descr: &str, fortran: bool, shape: &str) -> Vec<u8> {
    let order = if fortran { "True" } else { "False" };
    let text =
        format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}          \n");
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend_from_slice(&(text.len() as u16).to_le_bytes());
    out.extend_from_slice(text.as_bytes());
    out
}

fn array(fortran: bool, shape: &str) -> Vec<u8> {
    let mut out = head("<f8", fortran, shape);
    for i in 0..48 {
        out.extend_from_slice(&(f64::from(i) * 0.5).to_le_bytes());
    }
    out
}

fn model() -> Model {
    let mut model = Model::new("sparse", &["root".into(), "lwrist".into()], "body");
    let atoms = ndarray::Array2::from_shape_fn((4, 6), |(i, j)| ((i * 7 + j) as f32).sin());
    model.insert("atoms", atoms);
    model
}

/// One to six blows.
fn damage(bytes: &[u8], rng: &mut impl Rng) -> Vec<u8> {
    const WORDS: [&[u8]; 13] = [
        b"nan",
        b"-",
        b"1e999",
        b"\0",
        b"\"",
        b",",
        b"\n\n",
        b"9999999999",
        b":",
        b"begin",
        b"1e308",
        b"99999999999999999999999",
        b"\x1b[2J",
    ];
    let mut out = bytes.to_vec();
    for _ in 0..rng.random_range(1..=6) {
        if out.is_empty() {
            break;
        }
        let at = rng.random_range(0..out.len());
        match rng.random_range(0..6) {
            0 => out[at] = rng.random(),
            1 => {
                let end = (at + rng.random_range(1..=400)).min(out.len());
                out.drain(at..end);
            }
            2 => {
                let word = WORDS[rng.random_range(0..WORDS.len())];
                out.splice(at..at, word.iter().copied());
            }
            3 => out.truncate(at + 1),
            4 => {
                let from = rng.random_range(0..out.len());
                let end = (from + rng.random_range(1..=200)).min(out.len());
                let again = out[from..end].to_vec();
                out.splice(at..at, again);
            }
            _ => {
                out.splice(at..=at, *b"\xff\xfe");
            }
        }
    }
    out
}

/// Damages `whole` many times and reads each; a panic fails the test, an error must be one line
/// with the file's name.
fn batter(stream: u64, whole: &[&[u8]], read: impl Fn(Input) -> posing::Result<bool>) {
    let mut rng = rng(4, stream);
    let mut refused = 0;
    for i in 0..FILES {
        let bytes = damage(whole[i as usize % whole.len()], &mut rng);
        let kept = bytes.clone();
        let result = Input::new(NAME, Cursor::new(bytes)).and_then(&read);
        let shown = || String::from_utf8_lossy(&kept).into_owned();
        match result {
            Ok(finite) => assert!(finite, "infinite numbers from file {i}:\n{}", shown()),
            Err(e) => {
                refused += 1;
                let said = e.to_string();
                let plain = !said.chars().any(char::is_control);
                assert!(plain, "file {i}: {said:?}\n{}", shown());
                assert!(said.starts_with(NAME), "file {i}: {said:?}\n{}", shown());
                assert!(said.len() < 400, "file {i}: {said:?}");
                assert_eq!(e.exit_code(), 1, "file {i}: {said}");
            }
        }
    }
    // Most damage is seen, and some is harmless: else this test tests nothing.
    assert!(refused > FILES / 10 && refused < FILES, "{refused} refused");
}

#[test]
fn skeletons() {
    batter(1, &[ASF.as_bytes()], |input| {
        let skeleton = Asf::read(input, None)?.skeleton;
        let values = vec![0.0; skeleton.dof_count()];
        let ends = skeleton.posture(&values).ends;
        Ok(ends.iter().all(|p| p.is_finite()))
    });
}

#[test]
fn takes() {
    let skeleton = Asf::read(Input::new("t.asf", ASF.as_bytes()).unwrap(), None).unwrap();
    for keep in [false, true] {
        batter(2 + u64::from(keep), &[take().as_bytes()], |input| {
            let mut reader = amc::AmcReader::new(&skeleton, input, keep)?;
            let mut frame = amc::AmcFrame::default();
            let mut finite = true;
            while reader.read(&mut frame)? {
                let ends = skeleton.skeleton.posture(&frame.values).ends;
                finite &= ends.iter().all(|p| p.is_finite());
            }
            Ok(finite)
        });
    }
}

fn read_table(input: Input) -> posing::Result<bool> {
    let options = TableOptions {
        joints: Some(vec!["root".into(), "lwrist".into()]),
        planar: true,
        cells: true,
    };
    let table = Table::read(input, &options)?;
    let poses = &table.poses;
    // The rate, the runs and the takes of whatever times there are.
    let _ = (poses.rate(), poses.runs(), poses.takes());
    Ok(poses.xyz.iter().all(|v| !v.is_infinite()))
}

#[test]
fn tables() {
    batter(5, &[table().as_bytes()], read_table);
}

#[test]
fn arrays() {
    let files = [
        array(false, "(8, 6)"),
        array(true, "(8, 6)"),
        array(true, "(8, 2, 3)"),
    ];
    let files: Vec<&[u8]> = files.iter().map(Vec::as_slice).collect();
    batter(6, &files, read_table);
}

#[test]
fn models() {
    batter(7, &[&model().to_bytes().unwrap()], |input| {
        let model = Model::read(input)?;
        Ok(model.meta.points.len() < 1000)
    });
}

#[test]
fn compressed_tables() {
    use std::io::Write;
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(table().as_bytes()).unwrap();
    let gz = gz.finish().unwrap();
    let zst = zstd::encode_all(table().as_bytes(), 1).unwrap();
    batter(8, &[&gz, &zst], read_table);
}

/// The most memory this process has had, in KiB.
#[cfg(target_os = "linux")]
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmHWM")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

#[cfg(target_os = "linux")]
#[test]
fn what_a_file_claims_takes_no_memory() {
    let before = peak();
    for shape in [
        "(1000000000000000, 6)",
        "(1000000000000000, 2, 3)",
        "(18446744073709551615, 6)",
        "(6, 1000000000000000)",
        "(1, 18446744073709551615, 3)",
        "(99999999999999999999999, 6)",
    ] {
        for fortran in [false, true] {
            let input = Input::new(NAME, Cursor::new(array(fortran, shape))).unwrap();
            assert!(read_table(input).is_err(), "{shape}");
        }
    }
    // One long name with many children.
    let children: Vec<String> = (0..100_000).map(|i| format!("b{i}")).collect();
    let line = format!("{} {}", "p".repeat(300_000), children.join(" "));
    let text = ASF.replace("root hip\n", &format!("root hip\n{line}\n"));
    assert!(
        Input::new(NAME, Cursor::new(text))
            .and_then(|input| Asf::read(input, None))
            .is_err()
    );
    // An archive that unpacks to a thousand times its size.
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    let options = options.compression_method(zip::CompressionMethod::Deflated);
    zip.start_file("atoms.npy", options).unwrap();
    for _ in 0..1024 {
        std::io::Write::write_all(&mut zip, &[0; 1 << 20]).unwrap();
    }
    let bytes = zip.finish().unwrap().into_inner();
    let said = Model::from_bytes(bytes, NAME).unwrap_err().to_string();
    assert!(said.contains("unpacks to far more"), "{said}");
    // An array of very many rows of nothing.
    for shape in ["(1000000000000000, 0)", "(18446744073709551615, 0)"] {
        let bytes = model().to_bytes().unwrap();
        let mut zip = zip::ZipWriter::new_append(Cursor::new(bytes)).unwrap();
        zip.start_file("rigid_lengths.npy", options).unwrap();
        std::io::Write::write_all(&mut zip, &head("<i2", false, shape)).unwrap();
        zip.start_file("rigid.npy", options).unwrap();
        std::io::Write::write_all(&mut zip, &head("<i2", false, shape)).unwrap();
        let bytes = zip.finish().unwrap().into_inner();
        let refused = match Model::from_bytes(bytes, NAME) {
            Ok(model) => RigidPairs::read(&model, NAME).is_err(),
            Err(_) => true,
        };
        assert!(refused, "{shape}");
    }
    let took = peak() - before;
    assert!(took < 200 << 10, "{took} KiB");
}

#[test]
fn damaged_files_through_the_commands() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let write = |name: &str, bytes: &[u8]| std::fs::write(path(name), bytes).unwrap();
    write("t.asf", ASF.as_bytes());
    write("t.amc", take().as_bytes());
    write("t.csv", table().as_bytes());
    write("m.npz", &model().to_bytes().unwrap());
    let mut rng = rng(4, 9);
    for i in 0..60 {
        write("x.asf", &damage(ASF.as_bytes(), &mut rng));
        write("x.amc", &damage(take().as_bytes(), &mut rng));
        write("x.csv", &damage(table().as_bytes(), &mut rng));
        write("x.npz", &damage(&model().to_bytes().unwrap(), &mut rng));
        for words in [
            "amc2xyz --joints all --fps 120 --asf x.asf t.amc",
            "amc2xyz --joints all --fps 120 --asf t.asf x.amc",
            "complete -o out.csv x.csv",
            "denoise -o out.csv x.csv",
            "complete -m x.npz -o out.csv t.csv",
            "corrupt --dense 1 x.csv",
            "score x.csv t.csv",
            "encode -m m.npz x.csv",
            "cluster -k 2 x.csv",
        ] {
            let mut words = words.split(' ');
            let name = words.next().unwrap();
            let out = crate::common::command(name)
                .args(words)
                .current_dir(dir.path())
                // Only so that a test that fails ends.
                .timeout(Duration::from_secs(600))
                .output()
                .unwrap();
            let said = String::from_utf8_lossy(&out.stderr);
            let code = out.status.code();
            assert!(matches!(code, Some(0..=2)), "{name} {i}: {code:?} {said}");
            assert!(!said.contains("panicked"), "{name} {i}: {said}");
            if code != Some(0) {
                assert!(!said.is_empty(), "{name} {i}: {code:?}");
                assert!(!path("out.csv").exists(), "{name} {i}: {said}");
            }
            let _ = std::fs::remove_file(path("out.csv"));
        }
    }
}

/// Arrays that read well and yet are no answer to what is asked of them.
#[test]
fn sound_files_that_do_not_fit_are_told_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).unwrap();
    write("t.csv", table().as_bytes());
    let header = table().lines().next().unwrap().to_string();
    let row = |from: usize| {
        let numbers: Vec<String> = (0..header.split(',').count())
            .map(|c| (from + c * c).to_string())
            .collect();
        numbers.join(",")
    };
    write(
        "whole.csv",
        format!("{header}\n{}\n{}\n", row(1), row(2)).as_bytes(),
    );
    write("codes.csv", b"atom1,coef1,rms\n0,1,0\n");
    let mut narrow = model();
    let atoms = narrow
        .array("atoms", "narrow")
        .unwrap()
        .slice(ndarray::s![.., ..1])
        .to_owned();
    narrow.insert("atoms", atoms);
    write("narrow.npz", &narrow.to_bytes().unwrap());
    let mut zero = model();
    let atoms = 0.0 * &zero.array("atoms", "zero").unwrap();
    zero.insert("atoms", atoms);
    write("zero.npz", &zero.to_bytes().unwrap());
    let wide: Vec<String> = (0..2100).map(|k| format!("p{k}.x,p{k}.y,p{k}.z")).collect();
    let row = vec!["1"; 6300].join(",");
    let wide = format!("{}\n{row}\n{row}\n{row}\n", wide.join(","));
    write("wide.csv", wide.as_bytes());
    for (words, part) in [
        ("encode -m narrow.npz t.csv", "narrow.npz: atoms"),
        ("decode -m narrow.npz codes.csv", "narrow.npz: atoms"),
        (
            "dict-concat -o o.npz narrow.npz narrow.npz",
            "narrow.npz: atoms",
        ),
        (
            "ksvd-train -n 2 --space body --init zero.npz -o o.npz whole.csv",
            "zero.npz: ",
        ),
        ("encode -m zero.npz t.csv", "zero.npz: atoms"),
        (
            "prior-train --kind gaussian --space body -o o.npz wide.csv",
            "at most",
        ),
        ("ksvd-train -n 2 --space body -o o.npz wide.csv", "at most"),
        ("cluster -k 2 --save o.npz wide.csv", "at most"),
    ] {
        let mut words = words.split(' ');
        let name = words.next().unwrap();
        let mut command = crate::common::command(name);
        let out = command
            .args(words)
            .current_dir(dir.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{name}: {said}");
        assert!(said.contains(part) && said.lines().count() == 1, "{said}");
    }
}
