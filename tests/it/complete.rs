//! `complete` end to end, with the built-in model.

use crate::common::{Numbers, command, run, take, thin};
use predicates::prelude::*;
use predicates::str::contains;

const SIX: [&str; 6] = [
    "lclavicle",
    "rclavicle",
    "lwrist",
    "rwrist",
    "lfoot",
    "rfoot",
];

/// A walk, every fourth frame: 30 a second.
fn walk(frames: usize) -> Option<String> {
    Some(thin(&take("07", "07_01", &[])?, 4 * frames, 4))
}

fn gappy(walk: &str) -> String {
    let args = [
        "--gaps", "4", "--length", "0.4", "--points", "3", "--seed", "1",
    ];
    run("corrupt", &args, walk)
}

/// A rotation about no axis in particular (column by column), and a shift.
fn carry([x, y, z]: [f64; 3]) -> [f64; 3] {
    // Rz(0.7) Ry(2.1) Rx(-1.3)
    let (sx, cx) = (-1.3f64).sin_cos();
    let (sy, cy) = 2.1f64.sin_cos();
    let (sz, cz) = 0.7f64.sin_cos();
    let (y, z) = (cx * y - sx * z, sx * y + cx * z);
    let (x, z) = (cy * x + sy * z, -sy * x + cy * z);
    let (x, y) = (cz * x - sz * y, sz * x + cz * y);
    [x + 300.0, y - 20.0, z + 150.0]
}

/// A rotation about y, and a shift.
fn carry_upright([x, y, z]: [f64; 3]) -> [f64; 3] {
    let (s, c) = 2.1f64.sin_cos();
    [c * x + s * z + 300.0, y - 20.0, c * z - s * x + 150.0]
}

fn close(a: &Numbers, b: &Numbers, tolerance: f64) {
    assert_eq!(a.missing(), 0);
    assert_eq!(b.missing(), 0);
    let (far, n) = a.far(b);
    assert!(n > 0 && far <= tolerance, "{far} cm");
}

/// Only the six points are left.
fn six_of(table: &Numbers) -> Numbers {
    let mut out = table.clone();
    for row in &mut out.rows {
        for (p, name) in table.points.iter().enumerate() {
            if !SIX.contains(&name.as_str()) {
                row[3 * p..3 * p + 3].fill(f64::NAN);
            }
        }
    }
    out
}

#[test]
fn what_is_there_keeps_its_text_and_what_is_missing_is_filled() {
    let Some(walk) = walk(79) else { return };
    let damaged = gappy(&walk);
    let (before, after) = (
        Numbers::read(&damaged),
        Numbers::read(&run("complete", &["-q"], &damaged)),
    );
    assert_eq!(before.names, after.names);
    assert!(before.missing() > 100 && after.missing() == 0);
    for (b, a) in before
        .cells
        .iter()
        .flatten()
        .zip(after.cells.iter().flatten())
    {
        assert!(b.is_empty() || a == b, "{b} became {a}");
    }
    // The model has learned from this walk: what it fills in is near.
    let rms = after.rms(&Numbers::read(&walk));
    assert!(rms <= 0.6, "{rms} cm over all coordinates");
}

#[test]
fn a_turned_and_shifted_take_has_the_turned_answer() {
    let Some(walk) = walk(40) else { return };
    let table = Numbers::read(&walk);
    let whole = Numbers::read(&gappy(&walk));
    let (take, each) = (&["-q"][..], &["-q", "--per-frame"][..]);
    // Of which few points are seen stands upright, as feet do that are held: it may turn about y
    // alone.
    let upright = six_of(&table);
    let all = [
        (whole.clone(), carry as fn(_) -> _, &[each][..]),
        (whole, carry_upright, &[take]),
        (upright, carry_upright, &[take, each]),
    ];
    for (damaged, carry, all) in all {
        for flags in all {
            let answer = |t: &Numbers| Numbers::read(&run("complete", flags, &t.write()));
            close(
                &answer(&damaged.map(carry)),
                &answer(&damaged).map(carry),
                0.1,
            );
        }
    }
}

#[test]
fn a_body_of_which_little_is_seen_stands_upright() {
    let Some(walk) = walk(40) else { return };
    let table = Numbers::read(&walk);
    for seen in [
        "head,lwrist,rwrist",
        "root,head,lwrist,rwrist,lfoot,rfoot",
        "thorax,lowerneck,upperneck,head,lclavicle,lhumerus,lradius,lwrist,rclavicle,rhumerus,\
         rradius,rwrist",
    ] {
        for flags in [&["-q"][..], &["-q", "--per-frame"]] {
            // Empty columns and hidden ones alike.
            let flags = [flags, &["--observe", seen]].concat();
            let hidden = Numbers::read(&run("complete", &flags, &walk));
            let mut empty = table.clone();
            for row in &mut empty.rows {
                for (p, name) in table.points.iter().enumerate() {
                    if !seen.split(',').any(|s| s == name) {
                        row[3 * p..3 * p + 3].fill(f64::NAN);
                    }
                }
            }
            let filled = Numbers::read(&run("complete", &flags[..flags.len() - 2], &empty.write()));
            close(&hidden, &filled, 1e-3);
            let rms = hidden.rms(&table);
            assert!(rms <= 6.0, "{rms} cm where {seen} are seen");
        }
    }
}

#[test]
fn another_axis_up_has_the_same_answer() {
    let Some(walk) = walk(30) else { return };
    let damaged = Numbers::read(&gappy(&walk));
    let plain = Numbers::read(&run("complete", &["-q"], &damaged.write()));
    for (up, turned) in [
        ("z", damaged.map(|[x, y, z]| [x, -z, y])),
        ("x", damaged.map(|[x, y, z]| [y, -x, z])),
    ] {
        let y_up = run(
            "complete",
            &["-q", "--up", up, "--out-up", "y"],
            &turned.write(),
        );
        close(&Numbers::read(&y_up), &plain, 0.1);
        // Without a wish the table comes out as it came in.
        let own = run("complete", &["-q", "--up", up], &turned.write());
        let back = Numbers::read(&own).map(|[x, y, z]| match up {
            "z" => [x, z, -y],
            _ => [-y, x, z],
        });
        close(&back, &plain, 0.1);
    }
}

#[test]
fn a_table_in_meters_stays_one_and_bodies_of_no_size_are_refused() {
    let Some(walk) = walk(60) else { return };
    let damaged = Numbers::read(&gappy(&walk));
    let meters = damaged.map(|p| p.map(|v| v / 100.0)).write();
    let plain = Numbers::read(&run("complete", &["-q", "--status"], &damaged.write()));
    let in_meters = run("complete", &["-q", "--status", "--units", "m"], &meters);
    let answer = Numbers::read(&in_meters);
    close(&answer.map(|p| p.map(|v| 100.0 * v)), &plain, 1e-3);
    let sd = (answer.names.iter())
        .position(|n| n == "lfemur.sd")
        .unwrap();
    for (m, cm) in answer.cells.iter().zip(&plain.cells) {
        let [m, cm] = [m, cm].map(|row| row[sd].parse::<f64>().unwrap());
        assert!(
            (100.0 * m - cm).abs() <= 1e-3 + 0.01 * cm,
            "{m} m for {cm} cm"
        );
    }
    // Measured cells keep their text; deviations that a table brings are converted with it.
    let columns = meters.lines().next().unwrap().split(',').count();
    for (before, after) in meters.lines().skip(1).zip(
        run("complete", &["-q", "--units", "m"], &meters)
            .lines()
            .skip(1),
    ) {
        let cells = before.split(',').zip(after.split(','));
        assert!(cells.clone().all(|(b, a)| b.is_empty() || a == b));
        assert_eq!(cells.count(), columns);
    }
    let again = run(
        "complete",
        &["-q", "--units", "m", "--out-units", "cm"],
        &in_meters,
    );
    let again = Numbers::read(&again);
    let text = |table: &Numbers| table.cells[30][sd].parse::<f64>().unwrap();
    assert!((text(&again) - 100.0 * text(&answer)).abs() <= 1e-9);
    command("complete")
        .write_stdin(meters.clone())
        .assert()
        .code(1)
        .stderr(contains("--units").and(contains("foot to head")));
    run("complete", &["-q", "--force"], &meters);
    // Noise makes bones longer, not bodies; a small second take, or a late one, is found.
    let noisy = run("corrupt", &["-q", "--dense", "10"], &walk);
    run("denoise", &["-q"], &noisy);
    let (head, rows) = meters.split_once('\n').unwrap();
    let empty = |t: i32| format!("{}{}\n", f64::from(t - 600) / 30.0, ",".repeat(columns - 1));
    let empty: String = (0..600).map(empty).collect();
    command("denoise")
        .args(["--per-frame"])
        .write_stdin(format!("{head}\n{empty}{rows}"))
        .assert()
        .code(1)
        .stderr(contains("too small"));
}

#[test]
fn joints_of_a_bvh_are_matched_with_the_bone_ends_of_the_model() {
    let Some(walk) = walk(120) else { return };
    let bvh = run("xyz2bvh", &["-q"], &walk);
    let starts = run("bvh2xyz", &["-q"], &bvh);
    let damaged = run(
        "corrupt",
        &["-q", "--gaps", "3", "--length", "0.3", "--points", "2"],
        &starts,
    );
    let said = command("complete")
        .write_stdin(damaged.clone())
        .assert()
        .success();
    let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    assert!(
        said.contains("starts of bones") && !said.contains("not in the model"),
        "{said}"
    );
    let filled = Numbers::read(&run("complete", &["-q"], &damaged));
    close(&filled, &Numbers::read(&starts), 2.0);
    assert_eq!(
        run("complete", &["-q", "--bones", "starts"], &damaged),
        run("complete", &["-q"], &damaged)
    );
    // Noise: the model and the rigid distances help the starts as they do the ends.
    let noisy = run("corrupt", &["-q", "--dense", "2"], &starts);
    let [clean, noisy] = [run("denoise", &["-q"], &noisy), noisy].map(|t| Numbers::read(&t));
    let off = |table: &Numbers| {
        let truth = Numbers::read(&starts);
        let far = table.rows.iter().zip(&truth.rows);
        far.flat_map(|(a, b)| a.iter().zip(b))
            .map(|(a, b)| (a - b).powi(2))
            .sum::<f64>()
    };
    assert!(
        off(&clean) <= 0.15 * off(&noisy),
        "{}",
        off(&clean) / off(&noisy)
    );
}

#[test]
fn six_joints_tell_the_pose() {
    let Some(walk) = walk(60) else { return };
    let table = Numbers::read(&walk);
    let observed = Numbers::read(&run(
        "complete",
        &["-q", "--observe", &SIX.join(",")],
        &walk,
    ));
    let filled = Numbers::read(&run("complete", &["-q"], &six_of(&table).write()));
    // All others count as missing, and the six stay as they are.
    close(&observed, &filled, 1e-3);
    for (a, b) in observed.rows.iter().zip(&table.rows) {
        for name in SIX {
            let p = 3 * table.points.iter().position(|q| q == name).unwrap();
            assert_eq!(a[p..p + 3], b[p..p + 3]);
        }
    }
    let rms = filled.rms(&table);
    assert!(rms <= 8.0, "{rms} cm");
}

#[test]
fn a_tracker_that_pops_for_a_moment_leaves_the_body_where_it_is() {
    let Some(run_at_60) = take("09", "09_06", &[]).map(|run| thin(&run, 140, 2)) else {
        return;
    };
    let trackers = six_of(&Numbers::read(&run_at_60));
    let mut popped = trackers.clone();
    for (t, name) in [(19, "lfoot"), (37, "lfoot"), (55, "rfoot")] {
        let p = 3 * popped.points.iter().position(|q| q == name).unwrap();
        (t..t + 2).for_each(|t| popped.rows[t][p] += 40.0);
    }
    let of = |table: &Numbers| Numbers::read(&run("complete", &["-q"], &table.write()));
    let [whole, popped] = [of(&trackers), of(&popped)];
    for (t, (a, b)) in whole.rows.iter().zip(&popped.rows).enumerate() {
        for (p, name) in whole.points.iter().enumerate() {
            // What was measured stays.
            if SIX.contains(&name.as_str()) {
                continue;
            }
            let far = (3 * p..3 * p + 3).map(|i| (a[i] - b[i]).abs());
            let far = far.fold(0.0, f64::max);
            assert!(far <= 3.0, "{name} in frame {t}: {far} cm");
        }
    }
}

#[test]
fn two_dimensions_are_given_the_third() {
    flat_input(&["-q", "--per-frame"]);
}

#[test]
fn two_dimensions_are_given_the_third_in_a_take() {
    flat_input(&["-q"]);
}

fn flat_input(flags: &[&str]) {
    let Some(walk) = walk(10) else { return };
    let table = Numbers::read(&walk);
    let mut flat = String::new();
    for (i, line) in table.write().lines().enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        // time, then x and y of each point.
        let kept = cells
            .iter()
            .enumerate()
            .filter(|(c, _)| *c == 0 || (c - 1) % 3 != 2);
        let kept: Vec<&str> = kept.map(|(_, c)| *c).collect();
        assert_eq!(kept.len(), 47, "line {i}");
        flat += &(kept.join(",") + "\n");
    }
    let answer = Numbers::read(&run("complete", flags, &flat));
    assert_eq!(answer.points, table.points);
    assert_eq!(answer.missing(), 0);
    for (a, b) in answer.rows.iter().zip(&Numbers::read(&table.write()).rows) {
        for p in 0..23 {
            assert_eq!(a[3 * p..3 * p + 2], b[3 * p..3 * p + 2]);
        }
    }
}

#[test]
fn points_seen_in_part_among_whole_ones_are_filled_and_what_was_seen_of_them_stays() {
    let Some(walk) = walk(40) else { return };
    let truth = Numbers::read(&walk);
    let damaged = truth.lacking_parts().write();
    let table = Numbers::read(&damaged);
    for (flags, most) in [(&["-q"][..], 0.25), (&["-q", "--per-frame"], 1.0)] {
        let filled = Numbers::read(&run("complete", flags, &damaged));
        for (row, seen) in filled.rows.iter().zip(&table.rows) {
            let mut pairs = row.iter().zip(seen);
            assert!(pairs.all(|(a, b)| a.is_finite() && (b.is_nan() || a == b)));
        }
        let rms = truth.rms(&filled);
        assert!(rms <= most, "{flags:?}: {rms} cm");
    }
}

#[test]
fn points_seen_in_part_all_the_time_tell_what_they_can() {
    let Some(walk) = walk(12) else { return };
    let truth = Numbers::read(&walk);
    let mut flat = truth.clone();
    for row in &mut flat.rows {
        for p in [3, 4, 7, 8, 17, 18, 21, 22] {
            row[3 * p + 2] = f64::NAN;
        }
    }
    for flags in [&["-q"][..], &["-q", "--per-frame"]] {
        let rms = truth.rms(&Numbers::read(&run("complete", flags, &flat.write())));
        assert!(rms <= 0.6, "{flags:?}: {rms} cm");
    }
}

#[test]
fn flags_that_change_nothing_are_told() {
    let Some(walk) = walk(3) else { return };
    let out = command("complete")
        .args(["--sparsity", "3"])
        .write_stdin(walk)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(
        out.status.success() && said.contains("--sparsity has no effect"),
        "{said}"
    );
}

#[test]
fn a_frame_without_points_stays_unknown_and_is_counted() {
    let Some(walk) = walk(20) else { return };
    let mut damaged = Numbers::read(&walk);
    damaged.rows[0].fill(f64::NAN);
    damaged.time.clear();
    let out = command("complete")
        .arg("--status")
        .write_stdin(damaged.write())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{said}");
    assert!(said.contains("1 of 20 frames keep empty cells"), "{said}");
    let answer = Numbers::read(std::str::from_utf8(&out.stdout).unwrap());
    assert!(answer.rows[0].iter().all(|v| v.is_nan()));
    assert_eq!(answer.missing(), 69);
    let status = answer
        .names
        .iter()
        .position(|n| n == "head.status")
        .unwrap();
    assert_eq!(answer.cells[0][status], "unknown");
    assert_eq!(answer.cells[1][status], "observed");
    let words = ["observed", "changed", "inferred", "rejected", "unknown"];
    for (c, name) in answer.names.iter().enumerate() {
        let said = |row: &Vec<String>| words.contains(&row[c].as_str());
        assert!(!name.ends_with(".status") || answer.cells.iter().all(said));
    }
}

#[test]
fn several_takes_are_each_taken_alone() {
    let Some(walk) = walk(60) else { return };
    let first = gappy(&walk);
    let second = gappy(&Numbers::read(&walk).map(carry).write());
    let second = format!("take,{}", second.replace('\n', "\nb,"));
    let second = second.trim_end_matches("b,").to_string();
    let (head, rows) = second.split_once('\n').unwrap();
    assert!(first.starts_with(head));
    let both = run("complete", &["-q"], &format!("{first}{rows}"));
    let (one, two) = (
        run("complete", &["-q"], &first),
        run("complete", &["-q"], &second),
    );
    assert_eq!(both, one + two.split_once('\n').unwrap().1);
}

#[test]
fn other_columns_and_points_are_carried_along() {
    let Some(walk) = walk(20) else { return };
    let damaged = gappy(&walk);
    let mut more = String::new();
    for (i, line) in damaged.lines().enumerate() {
        more += line;
        more += if i == 0 {
            ",note,sword.x,sword.y,sword.z\n"
        } else {
            ",\"so, so\",1e2,,003\n"
        };
    }
    let plain = run("complete", &["-q"], &damaged);
    let answer = run("complete", &["-q"], &more);
    for (a, p) in answer.lines().zip(plain.lines()).skip(1) {
        assert_eq!(a, format!("{p},\"so, so\",1e2,,003"));
    }
    let status = run("complete", &["-q", "--status"], &more);
    let (points, _unlike) = status.lines().nth(1).unwrap().rsplit_once(',').unwrap();
    assert!(points.ends_with("1e2,,003,unknown,,"), "{status}");
}

#[test]
fn long_gaps_stay_empty_on_request() {
    let Some(walk) = walk(70) else { return };
    let mut damaged = Numbers::read(&walk);
    let wrist = damaged.points.iter().position(|p| p == "lwrist").unwrap();
    let head = damaged.points.iter().position(|p| p == "head").unwrap();
    for t in 10..40 {
        damaged.rows[t][3 * wrist..3 * wrist + 3].fill(f64::NAN);
    }
    for t in 10..15 {
        damaged.rows[t][3 * head..3 * head + 3].fill(f64::NAN);
    }
    let answer = run("complete", &["-q", "--max-gap", "0.5"], &damaged.write());
    let answer = Numbers::read(&answer);
    for (t, row) in answer.rows.iter().enumerate() {
        assert_eq!(row[3 * wrist].is_nan(), (10..40).contains(&t), "frame {t}");
        assert!(!row[3 * head].is_nan());
    }
}

#[test]
fn a_larger_body_has_the_larger_answer() {
    let Some(walk) = walk(60) else { return };
    let damaged = Numbers::read(&gappy(&walk));
    let grown = |t: &Numbers| t.map(|p| p.map(|v| 1.15 * v));
    let answer = |t: &Numbers| Numbers::read(&run("complete", &["-q"], &t.write()));
    close(&answer(&grown(&damaged)), &grown(&answer(&damaged)), 0.5);
}

#[test]
fn a_dictionary_of_another_unit_answers_with_numbers() {
    let Some(walk) = walk(60) else { return };
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("m.npz").to_str().unwrap().to_string();
    let large = Numbers::read(&walk).map(|p| p.map(|v| 100.0 * v)).write();
    run("ksvd-train", &["-q", "-n", "20", "-o", &model], &large);
    let done = run("complete", &["-q", "-m", &model], &gappy(&walk));
    assert_eq!(Numbers::read(&done).missing(), 0);
}

#[test]
fn what_is_filled_trembles_no_more_than_the_movement() {
    let Some(whole) = take("07", "07_01", &[]) else {
        return;
    };
    let truth = thin(&whole, 300, 1);
    let args = [
        "--gaps", "6", "--length", "0.3", "--points", "3", "--seed", "1",
    ];
    let damaged = run("corrupt", &args, &truth);
    let filled = Numbers::read(&run("complete", &["-q"], &damaged));
    let (truth, damaged) = (Numbers::read(&truth), Numbers::read(&damaged));
    // Sums of squared second differences within the gaps and where they join what was measured.
    let (mut ours, mut theirs) = (0.0, 0.0);
    for t in 1..truth.rows.len() - 1 {
        for c in 0..truth.rows[t].len() {
            if (t - 1..=t + 1).all(|t| !damaged.rows[t][c].is_nan()) {
                continue;
            }
            let second = |rows: &[Vec<f64>]| rows[t - 1][c] - 2.0 * rows[t][c] + rows[t + 1][c];
            ours += second(&filled.rows).powi(2);
            theirs += second(&truth.rows).powi(2);
        }
    }
    assert!(theirs > 0.0 && ours <= theirs, "{ours} {theirs}");
}

/// The root-mean-square distance of what was filled from the truth beside a file of strangers'
/// names, cm; and what was said.
fn filled_names(name: &str) -> Option<(f64, String)> {
    let file = crate::common::shared(&format!("data/field/{name}.csv"))?;
    let truth = crate::common::shared(&format!("data/field/{name}.truth.csv"))?;
    let read = |path: &std::path::Path| std::fs::read_to_string(path).unwrap();
    let done = command("complete").arg(&file).assert().success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    let out = Numbers::read(&String::from_utf8_lossy(&done.get_output().stdout));
    let (gaps, truth) = (Numbers::read(&read(&file)), Numbers::read(&read(&truth)));
    assert_eq!(out.missing(), 0);
    let (mut sum, mut count) = (0.0, 0.0);
    for ((gaps, out), truth) in gaps.rows.iter().zip(&out.rows).zip(&truth.rows) {
        for c in (0..gaps.len()).filter(|c| gaps[*c].is_nan()) {
            sum += (out[c] - truth[c]).powi(2);
            count += 1.0 / 3.0;
        }
    }
    Some(((sum / count).sqrt(), said))
}

#[test]
fn maps_of_names_are_found_though_names_are_missing() {
    let (Some((lafan, said)), Some((biped, of_biped))) =
        (filled_names("names-lafan1"), filled_names("names-biped"))
    else {
        return;
    };
    assert!(lafan < 4.0 && said.contains("map lafan"), "{lafan}: {said}");
    assert!(!said.contains("LeftToe"), "{said}");
    assert!(
        biped < 4.0 && of_biped.contains("map biped"),
        "{biped}: {of_biped}"
    );
}

#[test]
fn names_that_no_map_has_are_told_the_way() {
    let table =
        "time,hipL.x,hipL.y,hipL.z,kneeA.x,kneeA.y,kneeA.z\n0,1,90,0,1,50,0\n0.01,1,90,0,,,\n";
    let said = crate::common::fails("complete", &[], table.as_bytes(), 1);
    assert!(said.contains("--map") && said.contains("mixamo"), "{said}");
    let said = crate::common::fails("complete", &["--map", "nosuch"], table.as_bytes(), 2);
    assert!(said.contains("biped") && said.contains("neuron"), "{said}");
    // Help lists the maps that are shipped.
    let help = run("complete", &["--help"], "");
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    let names = posing::cli::name_maps::shipped_names();
    assert!(help.contains(&names), "{names}");
}
