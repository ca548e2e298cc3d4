//! `denoise` end to end, with the built-in model.

use crate::common::{Numbers, run, take, thin};

fn walk(frames: usize) -> Option<String> {
    Some(thin(&take("07", "07_01", &[])?, frames, 1))
}

#[test]
fn dense_noise_becomes_a_quarter_at_most() {
    let Some(walk) = walk(316) else { return };
    let truth = Numbers::read(&walk);
    let noisy = run("corrupt", &["--dense", "1asf", "--seed", "1"], &walk);
    let before = truth.rms(&Numbers::read(&noisy)).powi(2);
    let after = truth
        .rms(&Numbers::read(&run("denoise", &["-q"], &noisy)))
        .powi(2);
    assert!(
        before > 20.0 && after <= before / 4.0,
        "MSE {before} became {after}"
    );
}

#[test]
fn the_noise_of_single_frames_need_not_be_told() {
    let Some(walk) = walk(60) else { return };
    let truth = Numbers::read(&walk);
    for (noise, share) in [("0.2asf", 0.75), ("0.5asf", 0.5)] {
        let noisy = run("corrupt", &["--dense", noise, "--seed", "1"], &walk);
        let before = truth.rms(&Numbers::read(&noisy)).powi(2);
        let mse = |flags: &[&str]| {
            let flags = [&["-q", "--per-frame"], flags].concat();
            truth
                .rms(&Numbers::read(&run("denoise", &flags, &noisy)))
                .powi(2)
        };
        let (measured, told) = (mse(&[]), mse(&["--noise", noise]));
        assert!(
            measured <= share * before,
            "{noise}: {before} became {measured}"
        );
        assert!(measured <= 2.0 * told, "{noise}: {measured}, told {told}");
    }
}

#[test]
fn clean_poses_stay_nearly_as_they_are() {
    let Some(walk) = walk(200) else { return };
    let answer = Numbers::read(&run("denoise", &["-q"], &walk));
    let rms = answer.rms(&Numbers::read(&walk));
    assert!(rms <= 0.5, "{rms} cm");
    // By themselves, too: this person's bones are not as long as the model's, and no point is
    // corrupt for it.
    let alone = run("denoise", &["-q", "--per-frame", "--status"], &walk);
    let rejected = alone.matches("rejected").count();
    let rms = Numbers::read(&alone).rms(&Numbers::read(&walk));
    assert!(
        rms <= 0.3 && rejected <= 60,
        "{rms} cm, {rejected} rejected"
    );
}

#[test]
fn empty_cells_stay_empty_unless_asked_for() {
    let Some(walk) = walk(60) else { return };
    let gaps = [
        "--gaps", "3", "--length", "0.2", "--points", "3", "--dense", "1",
    ];
    let damaged = run("corrupt", &gaps, &walk);
    let before = Numbers::read(&damaged);
    assert!(before.missing() > 0);
    let empty =
        |t: &Numbers| -> Vec<bool> { t.rows.iter().flatten().map(|v| v.is_nan()).collect() };
    for flags in [&["-q"][..], &["-q", "--per-frame"]] {
        assert_eq!(
            empty(&Numbers::read(&run("denoise", flags, &damaged))),
            empty(&before)
        );
        let filled = run("denoise", &[flags, &["--fill"]].concat(), &damaged);
        assert_eq!(Numbers::read(&filled).missing(), 0);
    }
}

#[test]
fn frames_by_themselves_are_the_same_in_any_table() {
    let Some(walk) = walk(5) else { return };
    let noisy = run("corrupt", &["--dense", "2", "--seed", "3"], &walk);
    let flags = ["-q", "--per-frame", "--noise", "2"];
    let whole = run("denoise", &flags, &noisy);
    let (head, rows) = noisy.split_once('\n').unwrap();
    let mut apart = format!("{}\n", whole.lines().next().unwrap());
    for row in rows.lines() {
        let one = run("denoise", &flags, &format!("{head}\n{row}\n"));
        apart += one.split_once('\n').unwrap().1;
    }
    assert_eq!(whole, apart);
}

#[test]
fn the_status_says_what_changed() {
    let Some(walk) = walk(40) else { return };
    let noisy = run("corrupt", &["--dense", "2", "--drop", "lwrist"], &walk);
    let answer = Numbers::read(&run("denoise", &["-q", "--status", "--fill"], &noisy));
    let words = |name: &str| -> Vec<&str> {
        let at = answer.names.iter().position(|n| n == name).unwrap();
        answer.cells.iter().map(|c| c[at].as_str()).collect()
    };
    assert!(words("lwrist.status").iter().all(|w| *w == "inferred"));
    assert!(
        words("rwrist.status")
            .iter()
            .all(|w| ["changed", "rejected"].contains(w))
    );
    assert!(
        words("lwrist.sd")
            .iter()
            .all(|w| w.parse::<f64>().unwrap() > 0.0)
    );
}

/// A Gaussian learned from some of subject 07's walks, and a walk that it has not seen.
fn learned(space: &str, name: &str) -> Option<(tempfile::TempDir, String, String)> {
    let dir = tempfile::tempdir().unwrap();
    let space = ["--space", space];
    let mut all = take("07", "07_02", &space)?;
    for more in ["07_03", "07_04", "07_05", "07_06"] {
        all += take("07", more, &space)?.split_once('\n')?.1;
    }
    let model = dir.path().join(name);
    let model = crate::common::text(&model).to_string();
    let flags = ["-q", "--kind", "gaussian", "-o", &model];
    run("prior-train", &[&flags[..], &space].concat(), &all);
    let walk = thin(&take("07", "07_01", &space)?, 316, 2);
    Some((dir, model, walk))
}

#[test]
fn outliers_of_single_frames_are_found() {
    for space in ["body", "world"] {
        let Some((_dir, model, walk)) = learned(space, "g.npz") else {
            return;
        };
        let truth = Numbers::read(&walk);
        let hit = run("corrupt", &["--sparse", "1asf", "--seed", "2"], &walk);
        let mse = |more: &[&str]| {
            let flags = ["-q", "--per-frame", "--space", space, "-m", &model];
            let answer = Numbers::read(&run("denoise", &[&flags[..], more].concat(), &hit));
            truth.rms(&answer).powi(2)
        };
        let (plain, sought) = (mse(&["--outliers", "none"]), mse(&[]));
        assert!(sought <= 0.4 * plain, "{space}: {plain} became {sought}");
    }
}

#[test]
fn clean_points_among_outliers_stay_exactly_where_they_are() {
    let Some((_dir, model, walk)) = learned("body", "g.npz") else {
        return;
    };
    let truth = Numbers::read(&walk);
    let hit = run("corrupt", &["--sparse", "1asf", "--seed", "3"], &walk);
    let before = Numbers::read(&hit);
    let flags = [
        "-q",
        "--per-frame",
        "--space",
        "body",
        "--status",
        "-m",
        &model,
    ];
    let answer = Numbers::read(&run("denoise", &flags, &hit));
    let (mut clean, mut same) = (0, 0);
    for ((a, b), c) in truth.rows.iter().zip(&before.rows).zip(&answer.rows) {
        for p in (0..a.len())
            .step_by(3)
            .filter(|&p| a[p..p + 3] == b[p..p + 3])
        {
            clean += 1;
            same += usize::from(b[p..p + 3] == c[p..p + 3]);
        }
    }
    assert!(clean > 2000 && same * 10 >= clean * 7, "{same} of {clean}");
}

/// A walk with points that were hit by about so much, one in five of each frame, and what an
/// answer's MSE is.
fn hit<'a>(walk: &'a str, noise: &str) -> (String, impl Fn(&str, &[&str]) -> f64 + use<'a>) {
    let hit = run("corrupt", &["--sparse", noise, "--seed", "4"], walk);
    let truth = Numbers::read(walk);
    let mse = move |table: &str, flags: &[&str]| {
        let flags = [&["-q"], flags].concat();
        truth
            .rms(&Numbers::read(&run("denoise", &flags, table)))
            .powi(2)
    };
    (hit, mse)
}

#[test]
fn outliers_of_a_take_are_found_by_its_motion_however_far_off() {
    let Some(walk) = walk(316) else { return };
    for noise in ["1asf", "20cm", "100cm"] {
        let (hit, mse) = hit(&walk, noise);
        let (sought, plain) = (mse(&hit, &[]), mse(&hit, &["--outliers", "none"]));
        assert!(
            sought <= 0.05 && plain >= 50.0 * sought,
            "{noise}: {plain} became {sought}"
        );
    }
}

#[test]
fn outliers_of_single_frames_are_told_from_noise() {
    let Some(walk) = walk(60) else { return };
    for (noise, most) in [("10cm", 1.0), ("50cm", 1.0), ("100cm", 1.0)] {
        let (hit, mse) = hit(&walk, noise);
        let sought = mse(&hit, &["--per-frame"]);
        let plain = mse(&hit, &["--per-frame", "--outliers", "none"]);
        assert!(
            sought <= most && sought <= 0.3 * plain,
            "{noise}: {plain} became {sought}"
        );
    }
}

#[test]
fn rows_used_as_they_are_may_be_a_strangers_and_a_noise_that_is_told_is_that_of_clean_points() {
    let Some(walk) = take("07", "07_01", &["--space", "body"]) else {
        return;
    };
    let walk = thin(&walk, 60, 1);
    let (hit, mse) = hit(&walk, "10cm");
    let flags = ["--per-frame", "--space", "body"];
    let [auto, told, none] = [
        vec![],
        vec!["--noise", "0.1"],
        vec!["--outliers", "none", "--noise", "0.1"],
    ]
    .map(|more| mse(&hit, &[&flags[..], &more].concat()));
    assert!(
        auto <= 4.0 && told <= 4.0 && none >= 10.0,
        "{auto} {told} {none}"
    );
}

#[test]
fn points_seen_in_part_among_whole_ones_are_filled_in_a_take() {
    let Some(walk) = walk(120) else { return };
    let truth = Numbers::read(&walk);
    let damaged = truth.lacking_parts().write();
    let filled = Numbers::read(&run("denoise", &["-q", "--fill"], &damaged));
    let rms = truth.rms(&filled);
    assert!(rms <= 0.3, "{rms} cm");
    let kept = Numbers::read(&run("denoise", &["-q"], &damaged));
    assert_eq!(kept.missing(), Numbers::read(&damaged).missing());
    let whole = Numbers::read(&run("denoise", &["-q"], &walk));
    let (far, _) = kept.far(&whole);
    assert!(far <= 1.0, "{far} cm");
}

/// Blocks learned from some of subject 07's walks, and a walk that they have not seen.
fn blocks() -> Option<(tempfile::TempDir, String, String)> {
    let dir = tempfile::tempdir().unwrap();
    let thinned = |name| Some(thin(&take("07", name, &[])?, 320, 4));
    let mut all = thinned("07_02")?;
    for more in ["07_03", "07_04", "07_05"] {
        all += thinned(more)?.split_once('\n')?.1;
    }
    let model = crate::common::text(&dir.path().join("blocks.npz")).to_string();
    run(
        "prior-train",
        &["-q", "--kind", "blocks", "-o", &model],
        &all,
    );
    Some((dir, model, thin(&take("07", "07_01", &[])?, 160, 4)))
}

/// The upper body mirrored at the root, where the legs are: bones keep their lengths.
fn folded(walk: &str) -> String {
    let mut table = Numbers::read(walk);
    let at = |name: &str| table.points.iter().position(|p| p == name).unwrap();
    let (root, first) = (at("root"), at("lowerback"));
    for row in &mut table.rows {
        for i in 3 * first..row.len() {
            row[i] = 2.0 * row[3 * root + i % 3] - row[i];
        }
    }
    table.write()
}

#[test]
fn poses_unlike_any_seen_are_told() {
    let Some((_dir, model, walk)) = blocks() else {
        return;
    };
    let folded = folded(&walk);
    let frames = walk.lines().count() - 1;
    for (name, flags) in [
        ("denoise", &["-m", &model, "--status"][..]),
        ("denoise", &["-m", &model, "--status", "--per-frame"]),
        ("complete", &["-m", &model, "--status"]),
        ("complete", &["-m", &model, "--status", "--per-frame"]),
    ] {
        let run = |table: &str| {
            let table = run("corrupt", &["--drop", "lwrist"], table);
            let done = crate::common::command(name)
                .args(flags)
                .write_stdin(table)
                .assert();
            let out = done.success().get_output().clone();
            let table = Numbers::read(&String::from_utf8(out.stdout).unwrap());
            assert_eq!(table.names.last().unwrap(), "unlike");
            let cells = table.cells.iter().map(|c| c.last().unwrap().clone());
            (
                cells.collect::<Vec<_>>(),
                String::from_utf8(out.stderr).unwrap(),
            )
        };
        let (cells, said) = run(&folded);
        assert!(cells.iter().all(|c| c.parse::<f64>().unwrap() > 100.0));
        let line =
            format!("{name}: {frames} of {frames} frames have a pose unlike all training poses");
        assert!(said.contains(&line), "{said}");
        let (cells, said) = run(&walk);
        let like = cells.iter().filter(|c| *c == "0").count();
        assert!(
            10 * like >= 9 * frames,
            "{name}: {like} of {frames}, {said}"
        );
    }
}
