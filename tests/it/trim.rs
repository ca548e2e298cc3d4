//! trim: frames, points, rates and filters of tables.

use crate::common::{Numbers, command, fails, run};

/// A point that moves evenly and one that trembles, 100 frames a second.
fn table() -> String {
    let mut text = String::from("take,time,a.x,a.y,a.z,b.x,b.y,b.z,note\n");
    for t in 0..200 {
        let wave = if t % 2 == 0 { 1.0 } else { -1.0 };
        let gap = if (80..90).contains(&t) {
            String::new()
        } else {
            format!("{t}")
        };
        text += &format!("w,{},{gap},0,0,{wave},5,5,n\n", t as f64 / 100.0);
    }
    text
}

#[test]
fn frames_and_points_are_chosen_and_renamed() {
    let flags = [
        "--from", "0.5", "--to", "0.99", "--points", "b,a", "--rename", "a=hand",
    ];
    let out = run("trim", &flags, &table());
    assert!(
        out.starts_with("take,time,b.x,b.y,b.z,hand.x,hand.y,hand.z\nw,0.5,1,5,5,50,0,0\n"),
        "{out}"
    );
    assert_eq!(out.lines().count(), 51);
    let swapped = run("trim", &["--rename", "a=b,b=a"], &table());
    assert!(
        swapped.starts_with("take,time,b.x,b.y,b.z,a.x"),
        "{swapped}"
    );
    for (flags, what) in [
        (["--points", "c"], "no point \"c\""),
        (["--take", "x"], "no take \"x\""),
        (["--rename", "a=b"], "two points \"b\""),
        (["--from", "7"], "no frame"),
        (["--butterworth", "45"], "below .4"),
    ] {
        let failed = command("trim")
            .args(flags)
            .write_stdin(table())
            .assert()
            .failure();
        let said = String::from_utf8(failed.get_output().stderr.clone()).unwrap();
        assert!(said.contains(what), "{said}");
    }
}

#[test]
fn an_axis_may_point_down() {
    for flags in [&["--up=-y"][..], &["--up", "-y"]] {
        // What goes back in the file's own axes is what it was.
        assert_eq!(run("trim", flags, &table()), run("trim", &[], &table()));
        let up = run("trim", &[flags, &["--out-up", "y"]].concat(), &table());
        assert!(up.contains("w,0.01,1,-0,-0,-1,-5,-5\n"), "{up}");
    }
    assert!(fails("trim", &["--up", "-w"], table().as_bytes(), 2).contains("-w"));
}

#[test]
fn a_filter_leaves_even_movement_and_stills_trembling() {
    let out = Numbers::read(&run("trim", &["--butterworth", "6Hz"], &table()));
    for (t, row) in out.rows.iter().enumerate() {
        if (80..90).contains(&t) {
            assert!(row[0].is_nan(), "{t}");
        } else {
            assert!((row[0] - t as f64).abs() < 0.05, "{t}: {}", row[0]);
            assert!(
                row[3].abs() < if (20..180).contains(&t) { 0.01 } else { 1.1 },
                "{t}"
            );
        }
    }
}

#[test]
fn another_rate_keeps_the_gap_and_the_unit() {
    let out = Numbers::read(&run(
        "trim",
        &["-q", "--resample", "25", "--units", "mm"],
        &table(),
    ));
    assert_eq!(out.rows.len(), 50);
    for (t, row) in out.rows.iter().enumerate() {
        let at = 4 * t;
        if (80..90).contains(&at) {
            assert!(row[0].is_nan(), "{t}");
        } else {
            assert!((row[0] - at as f64).abs() < 1e-6, "{t}: {}", row[0]);
        }
    }
}

#[test]
fn the_end_and_the_format_share_a_flag() {
    let asked = ["-q", "--from", "0.5", "--to", "1", "--to", "npy", "-"];
    let done = command("trim")
        .args(asked)
        .write_stdin(table())
        .output()
        .unwrap();
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    assert!(done.stdout.starts_with(b"\x93NUMPY"));
    let text = Numbers::read(&run("trim", &asked[..5], &table()));
    assert_eq!(text.rows.len(), 51);
    let wrong = command("trim").args(["--to", "soon"]).output().unwrap();
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("csv, npy or npz"));
}
