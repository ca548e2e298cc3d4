//! What a table is told by, and how tables and arrays turn into each other.

use crate::common::{command, fails, long, run, text};
use std::fs;
use std::path::Path;

#[test]
fn inputs_are_known_by_content() {
    use std::io::Write;
    let dir = tempfile::tempdir().unwrap();
    let plain = long(50);
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(plain.as_bytes()).unwrap();
    let same = ["corrupt", "--dense", "0"];
    let gz = gz.finish().unwrap();
    for bytes in [gz.clone(), zstd::encode_all(plain.as_bytes(), 3).unwrap()] {
        let file = dir.path().join("named.npy");
        fs::write(&file, &bytes).unwrap();
        assert_eq!(
            run(same[0], &[&same[1..], &[text(&file)]].concat(), ""),
            plain
        );
        let piped = command(same[0])
            .args(&same[1..])
            .write_stdin(bytes)
            .output()
            .unwrap();
        assert_eq!(String::from_utf8(piped.stdout).unwrap(), plain);
    }
    // Cut off in the middle, it is an error, not a shorter table.
    let said = fails("corrupt", &["--dense", "0"], &gz[..gz.len() / 2], 1);
    assert!(said.starts_with("corrupt: standard input"), "{said}");
}

#[test]
fn line_endings_marks_and_comments() {
    let plain = long(20);
    let same = |input: &str| run("corrupt", &["--dense", "0"], input);
    assert_eq!(same(&plain.replace('\n', "\r\n")), plain);
    assert_eq!(same(&format!("\u{feff}{plain}")), plain);
    assert_eq!(same(plain.trim_end()), plain);
    // Blank lines are no rows.
    assert_eq!(same(&plain.replace('\n', "\n\n")), plain);
    let said = fails(
        "corrupt",
        &["--dense", "0"],
        format!("# made by hand\n{plain}").as_bytes(),
        1,
    );
    assert!(
        said.contains("standard input:1: starts with a comment"),
        "{said}"
    );
    // Takes and skeletons have comments, and old ones DOS line ends.
    let (Some(asf), Some(amc)) = (
        crate::common::cmu("07/07.asf"),
        crate::common::cmu("07/07_01.amc"),
    ) else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let read = |path: &Path| String::from_utf8_lossy(&fs::read(path).unwrap()).replace('\r', "");
    let (asf, amc) = (read(&asf), read(&amc));
    let convert = |asf: &str, amc: &str| {
        let (a, m) = (dir.path().join("a.asf"), dir.path().join("m.amc"));
        fs::write(&a, asf).unwrap();
        fs::write(&m, amc).unwrap();
        run(
            "amc2xyz",
            &["--asf", text(&a), "--fps", "120", text(&m)],
            "",
        )
    };
    let odd = |t: &str| format!("\u{feff}# a comment\n\n{t}").replace('\n', "  # more\r\n\r\n");
    assert_eq!(convert(&odd(&asf), &odd(&amc)), convert(&asf, &amc));
}

/// An NPY file of these values, (frames, 6), C order.
fn array(values: &[f64], narrow: bool, fortran: bool) -> Vec<u8> {
    let frames = values.len() / 6;
    let (kind, order) = (
        if narrow { "<f4" } else { "<f8" },
        if fortran { "True" } else { "False" },
    );
    let head =
        format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': ({frames}, 6), }}\n");
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend_from_slice(&(head.len() as u16).to_le_bytes());
    out.extend_from_slice(head.as_bytes());
    for i in 0..values.len() {
        let v = values[if fortran {
            i % frames * 6 + i / frames
        } else {
            i
        }];
        if narrow {
            out.extend_from_slice(&(v as f32).to_le_bytes());
        } else {
            out.extend_from_slice(&v.to_le_bytes());
        }
    }
    out
}

#[test]
fn arrays_and_tables_turn_into_each_other_exactly() {
    let mut values: Vec<f64> = (0..60)
        .map(|i| (f64::from(i) * 0.7).sin() * 1e3 / 3.0)
        .collect();
    values[7] = f64::NAN;
    values[20] = 0.1 + 0.2;
    values[21] = -0.0;
    let flags = ["--dense", "0", "--joints", "a,b"];
    let convert = |bytes: Vec<u8>, to: &str| {
        let args = [&flags[..], &["--to", to]].concat();
        let out = command("corrupt")
            .args(args)
            .write_stdin(bytes)
            .output()
            .unwrap();
        assert!(
            out.status.success(),
            "{}",
            String::from_utf8_lossy(&out.stderr)
        );
        out.stdout
    };
    let numbers = |csv: &[u8]| -> Vec<u64> {
        let table = crate::common::Numbers::read(std::str::from_utf8(csv).unwrap());
        assert_eq!(table.points, ["a", "b"]);
        table.rows.concat().iter().map(|v| v.to_bits()).collect()
    };
    for narrow in [false, true] {
        let want: Vec<u64> = values
            .iter()
            .map(|&v| if narrow { f64::from(v as f32) } else { v })
            .map(|v| {
                if v.is_nan() {
                    f64::NAN.to_bits()
                } else {
                    v.to_bits()
                }
            })
            .collect();
        for fortran in [false, true] {
            let csv = convert(array(&values, narrow, fortran), "csv");
            assert_eq!(numbers(&csv), want, "f32 {narrow}, Fortran {fortran}");
            let npy = convert(csv.clone(), "npy");
            assert_eq!(convert(npy, "csv"), csv);
        }
    }
}

#[test]
fn an_array_of_another_size_than_it_says_is_refused_from_a_pipe_too() {
    let whole = array(&[1.0; 12], false, false);
    let args = ["--dense", "0", "--joints", "a,b"];
    let cut = fails("corrupt", &args, &whole[..whole.len() - 8], 1);
    assert!(
        cut.contains("ends before its last frame: has 1 of 2"),
        "{cut}"
    );
    let longer = [&whole[..], b"more"].concat();
    let long = fails("corrupt", &args, &longer, 1);
    assert!(long.contains("more bytes than its header says"), "{long}");
}
