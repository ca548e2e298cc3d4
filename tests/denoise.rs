//! `denoise` end to end, with the built-in model.

mod common;

use common::{Numbers, run, take, thin};

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
fn clean_poses_stay_nearly_as_they_are() {
    let Some(walk) = walk(200) else { return };
    let answer = Numbers::read(&run("denoise", &["-q"], &walk));
    let rms = answer.rms(&Numbers::read(&walk));
    assert!(rms <= 0.5, "{rms} cm");
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
