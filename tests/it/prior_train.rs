//! `prior-train`: a model of each kind, from a real take to what denoise and complete make of it.

use crate::common::{command, fails, run, text};

/// Every fourth pose of a walk, as rows are.
fn walk() -> String {
    let table =
        crate::common::take("07", "07_01", &["--space", "body"]).expect("a take of testdata");
    crate::common::thin(&table, 400, 2)
}

fn rms(a: &str, b: &str) -> f64 {
    let (a, b) = (
        crate::common::Numbers::read(a),
        crate::common::Numbers::read(b),
    );
    let pairs = || a.rows.iter().flatten().zip(b.rows.iter().flatten());
    let sum: f64 = pairs().map(|(a, b)| (a - b) * (a - b)).sum();
    (sum / pairs().count() as f64).sqrt()
}

#[test]
fn models_of_each_kind_denoise_and_complete() {
    let folder = tempfile::tempdir().unwrap();
    let walk = walk();
    let noisy = run("corrupt", &["--dense", "1asf", "--seed", "1"], &walk);
    for kind in ["pca", "gaussian", "clustered", "mfa", "mixture"] {
        let path = folder.path().join(format!("{kind}.npz"));
        let model = text(&path);
        let args = ["-q", "--kind", kind, "--space", "body", "-o", model];
        run("prior-train", &args, &walk);
        let how = ["-m", model, "--space", "body", "--per-frame", "-q"];
        let denoised = run(
            "denoise",
            &[&how[..], &["--noise", "5.644"]].concat(),
            &noisy,
        );
        let (before, after) = (rms(&noisy, &walk), rms(&denoised, &walk));
        assert!(after <= 0.6 * before, "{kind}: {after} of {before}");
        let six = "lclavicle,rclavicle,lwrist,rwrist,lfoot,rfoot";
        let completed = run("complete", &[&how[..], &["--observe", six]].concat(), &walk);
        let after = rms(&completed, &walk);
        assert!(after <= 4.0, "{kind}: {after}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_at_any_threads() {
    let folder = tempfile::tempdir().unwrap();
    let walk = walk();
    let model = |threads: &str| {
        let path = folder.path().join(threads);
        let args = [
            "-q",
            "--kind",
            "mfa",
            "--threads",
            threads,
            "-o",
            text(&path),
        ];
        run("prior-train", &args, &walk);
        std::fs::read(path).unwrap()
    };
    assert!(model("1") == model("2") && model("1") == model("7"));
}

#[test]
fn what_cannot_be_done_is_told() {
    let done = command("prior-train")
        .args(["--kind", "magic", "-o", "x.npz"])
        .assert();
    done.code(2);
    let said = fails("prior-train", &["-o", "x.npz"], b"a.x,a.y,a.z\n,,\n", 1);
    assert!(said.contains("no complete pose"), "{said}");
}

#[test]
fn a_few_poses_are_enough() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("few.npz");
    let few = crate::common::thin(&walk(), 3, 1);
    for kind in ["pca", "gaussian", "clustered", "mfa", "mixture"] {
        let args = ["-q", "--kind", kind, "--space", "body", "-o", text(&path)];
        run("prior-train", &args, &few);
        let how = ["-q", "-m", text(&path), "--space", "body", "--noise", "1"];
        let clean = crate::common::Numbers::read(&run("denoise", &how, &few));
        let truth = crate::common::Numbers::read(&few);
        assert_eq!(clean.rows.len(), 3, "{kind}");
        let errors = clean.rows.iter().flatten().zip(truth.rows.iter().flatten());
        let worst = errors.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // The poses are those that the model was trained on: the answer stays within the stated
        // noise's reach.
        assert!(worst.is_finite() && worst <= 5.0, "{kind}: {worst} cm");
    }
}

#[test]
fn a_thousand_points_are_learned_and_filled() {
    let columns: Vec<String> = (0..1000).map(|p| format!("p{p}.x,p{p}.y,p{p}.z")).collect();
    let mut table = format!("time,{}", columns.join(","));
    for t in 0..20 {
        table += &format!("\n{}", t as f64 / 100.0);
        for c in 0..3000 {
            let rest = 40.0 * (1.7 * f64::from(c)).sin();
            table += &format!(",{:.4}", rest + 5.0 * (0.1 * t as f64 + f64::from(c)).sin());
        }
    }
    table.push('\n');
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("many.npz");
    let said = command("prior-train")
        .args(["-o", text(&path)])
        .write_stdin(table.clone())
        .assert()
        .success();
    let said = String::from_utf8_lossy(&said.get_output().stderr).into_owned();
    assert!(
        said.contains("1000 points") && said.contains("nlm"),
        "{said}"
    );
    let gaps = ["-q", "--gaps", "1", "--length", "0.03", "--points", "30"];
    let damaged = run("corrupt", &gaps, &table);
    let filled = run("complete", &["-q", "-m", text(&path)], &damaged);
    let [truth, filled] = [&table, &filled].map(|t| crate::common::Numbers::read(t));
    assert_eq!(filled.missing(), 0);
    assert!(filled.far(&truth).0 <= 0.5, "{} cm", filled.far(&truth).0);
}
