//! The command `corrupt` from outside.

use assert_cmd::Command;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use proptest::prelude::*;

fn corrupt(args: &[&str], input: &str) -> assert_cmd::assert::Assert {
    Command::new(crate::common::bin().join("corrupt"))
        .args(args)
        .write_stdin(input)
        .assert()
}

fn out(args: &[&str], input: &str) -> String {
    let done = corrupt(args, input).success();
    String::from_utf8(done.get_output().stdout.clone()).unwrap()
}

/// Two takes of so many frames at 10 a second, two points, and a column of words.
fn table(frames: usize) -> String {
    let mut text = String::from("take,time,a.x,a.y,a.z,note,b.x,b.y,b.z\n");
    for take in ["one", "two"] {
        for i in 0..frames {
            let t = i as f64 / 10.0;
            text += &format!("{take},{t:.3},{i}.50,1e0,2,\"so, so\",3,4,{i}\n");
        }
    }
    text
}

/// The cells of a column.
fn column(text: &str, name: &str) -> Vec<String> {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let at = reader.headers().unwrap().iter().position(|h| h == name);
    let records = reader
        .records()
        .map(|r| r.unwrap()[at.unwrap()].to_string());
    records.collect()
}

#[test]
fn nothing_asked_is_an_error_that_names_the_flags() {
    let said = corrupt(&[], &table(3)).failure().code(2);
    said.stderr(contains("--dense, --sparse, --keep, --drop or --gaps"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn without_a_change_every_byte_stays(
        cells in prop::collection::vec("(-?[0-9]{1,6}(\\.[0-9]{0,20})?(e-[0-9])?|nan|NaN| ?[0-9]|)", 1..30),
        words in prop::collection::vec("[a-z,\" ]{0,6}", 1..5)
    ) {
        let mut text = String::from("a.x,note,a.y,a.z\n");
        for (i, xyz) in cells.chunks_exact(3).enumerate() {
            let word = &words[i % words.len()];
            let word = if word.contains([',', '"']) { format!("\"{}\"", word.replace('"', "\"\"")) } else { word.clone() };
            text += &format!("{},{word},{},{}\n", xyz[0], xyz[1], xyz[2]);
        }
        for args in [&["--dense", "0"][..], &["--keep", "a"], &["--sparse", "1", "--share", "0"]] {
            prop_assert_eq!(&out(args, &text), &text);
        }
    }
}

#[test]
fn a_seed_repeats_whatever_the_threads_and_another_does_not() {
    let input = table(40);
    let noise = |seed, threads| {
        let args = [
            "--dense",
            "1asf",
            "--sparse",
            "2cm",
            "--seed",
            seed,
            "--threads",
            threads,
        ];
        out(&args, &input)
    };
    assert_eq!(noise("5", "1"), noise("5", "7"));
    assert_ne!(noise("5", "1"), noise("6", "1"));
    // Gaps read the whole table; the noise is the same.
    let gaps = ["--gaps", "1", "--length", "0.5"];
    let both = out(
        &[&["--dense", "1", "--seed", "5"], &gaps[..]].concat(),
        &input,
    );
    let dense = column(&out(&["--dense", "1", "--seed", "5"], &input), "a.x");
    for (gap, noise) in column(&both, "a.x").iter().zip(&dense) {
        assert!(gap.is_empty() || gap == noise);
    }
    assert_eq!(column(&both, "note"), column(&input, "note"));
}

#[test]
fn noise_has_the_standard_deviation_of_its_unit() {
    let input = table(3000);
    let noisy = out(&["--dense", "1asf", "--seed", "3"], &input);
    let read = |text: &str| -> Vec<f64> {
        let cells = column(text, "b.y");
        cells.iter().map(|c| c.parse().unwrap()).collect()
    };
    let off: Vec<f64> = read(&noisy).iter().map(|v| v - 4.0).collect();
    let n = off.len() as f64;
    let sd = (off.iter().map(|v| v * v).sum::<f64>() / n).sqrt();
    let asf = 2.54 / 0.45;
    assert!((sd - asf).abs() <= 6.0 * asf / (2.0 * n).sqrt(), "{sd}");
}

#[test]
fn missing_values_stay_missing() {
    let input = "a.x,a.y,a.z\n,NaN,3\n1,2,\n";
    let noisy = out(&["--dense", "1", "--sparse", "1", "--share", "1"], input);
    let lines: Vec<Vec<&str>> = noisy.lines().map(|l| l.split(',').collect()).collect();
    assert_eq!((lines[1][0], lines[1][1], lines[2][2]), ("", "NaN", ""));
    assert!(lines[1][2] != "3" && lines[2][0] != "1");
}

#[test]
fn points_are_hidden_by_name() {
    let input = table(2);
    for args in [["--drop", "a"], ["--keep", "b"]] {
        let text = out(&args, &input);
        assert!(column(&text, "a.y").iter().all(String::is_empty));
        assert_eq!(column(&text, "b.z"), column(&input, "b.z"));
    }
    let said = corrupt(&["--keep", "c"], &input).failure().code(2);
    said.stderr(contains("--keep: the table has no point \"c\""));
}

#[test]
fn every_take_has_its_gaps() {
    let input = table(60);
    let args = [
        "--gaps", "2", "--length", "0.7", "--points", "1", "--seed", "4",
    ];
    let text = out(&args, &input);
    assert_eq!(text, out(&args, &input));
    let (mut stretches, mut cells) = (Vec::new(), 0);
    for name in ["a.x", "a.y", "a.z", "b.x", "b.y", "b.z"] {
        let column = column(&text, name);
        cells += column.iter().filter(|c| c.is_empty()).count();
        let (one, two) = column.split_at(60);
        for take in [one, two] {
            assert!(!take[0].is_empty() && !take[59].is_empty());
            let runs = take.split(|c| !c.is_empty()).map(<[String]>::len);
            stretches.extend(runs.filter(|l| *l > 0));
        }
    }
    assert_eq!(stretches, vec![7; 2 * 2 * 3]);
    assert_eq!(cells, 2 * 2 * 7 * 3);
}

#[test]
fn gaps_need_a_rate_room_and_a_length() {
    let bare = "a.x,a.y,a.z\n".to_string() + &"1,2,3\n".repeat(31);
    let gaps = ["--gaps", "1", "--length", "0.5"];
    let said = corrupt(&gaps, &bare).failure().code(1);
    said.stderr(contains("standard input: has no column time").and(contains("--fps")));
    let text = out(&[&gaps[..], &["--fps", "10"]].concat(), &bare);
    assert_eq!(text.lines().filter(|l| *l == ",,").count(), 5);

    let said = corrupt(&["--gaps", "1"], &bare).failure().code(2);
    said.stderr(contains("--length"));
    let long = ["--gaps", "1", "--length", "9", "--fps", "10"];
    corrupt(&long, &bare)
        .failure()
        .code(1)
        .stderr(contains("shorter"));
    let many = ["--gaps", "9", "--length", "1", "--fps", "10"];
    corrupt(&many, &bare)
        .failure()
        .code(1)
        .stderr(contains("of 9 gaps"));
    let wide = [
        "--gaps", "1", "--length", "1", "--points", "2", "--fps", "10",
    ];
    corrupt(&wide, &bare)
        .failure()
        .code(2)
        .stderr(contains("--points 2: expected 1 to 1"));
}

#[test]
fn a_take_too_short_for_a_gap_is_told_and_left() {
    let short = table(60)
        .lines()
        .take(1 + 60 + 3)
        .collect::<Vec<_>>()
        .join("\n")
        + "\n";
    let done = corrupt(&["--gaps", "1", "--length", "1"], &short).success();
    let done = done.stderr(contains("take \"two\" gets no gap").and(contains("3 frames")));
    let text = String::from_utf8(done.get_output().stdout.clone()).unwrap();
    let tail = |t: &str| t.lines().skip(61).map(String::from).collect::<Vec<_>>();
    assert_eq!(tail(&text), tail(&short));
}

#[test]
fn bad_numbers_are_usage_errors() {
    for args in [
        &["--dense", "-1"][..],
        &["--dense", "2ft"],
        &["--dense", "9e9"],
        &["--sparse", "1", "--share", "nan"],
        &["--share", "0.1"],
        &["--gaps", "0", "--length", "1"],
        &["--gaps", "1", "--length", "0"],
        &["--keep", "a,,b"],
    ] {
        let said = corrupt(args, &table(9)).failure().code(2);
        let lines = String::from_utf8_lossy(&said.get_output().stderr)
            .lines()
            .count();
        assert_eq!(lines, 1, "{args:?}");
    }
}
