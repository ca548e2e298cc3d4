//! The same bytes at any number of threads, and after a kill.

use crate::common::{fails, text};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Takes with points that move on circles of their own: no two frames are the same.
fn table(frames: usize) -> String {
    let names = ["root", "lfemur", "rfemur", "lwrist", "rwrist", "head"];
    let header: Vec<String> = names
        .iter()
        .flat_map(|n| ["x", "y", "z"].map(|a| format!("{n}.{a}")))
        .collect();
    let mut out = format!("take,time,{}\n", header.join(","));
    for i in 0..frames {
        out += &format!("walk,{}", i as f64 / 60.0);
        for c in 0..3 * names.len() {
            let phase = i as f64 * (0.01 + 0.003 * c as f64);
            let v = if c < 3 {
                0.0
            } else {
                20.0 * c as f64 * phase.sin() / 3.0 + c as f64
            };
            out += &format!(",{v:.6}");
        }
        out.push('\n');
    }
    out
}

fn output(folder: &Path, words: &str) -> Vec<u8> {
    let mut words = words.split(' ');
    let out = Command::new(crate::common::bin().join(words.next().unwrap()))
        .args(words)
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    out.stdout
}

#[test]
fn threads_do_not_change_a_byte() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let body = match crate::common::take("09", "09_06", &["--space", "body"]) {
        Some(table) => crate::common::thin(&table, 150, 2),
        None => table(150),
    };
    fs::write(at("t.csv"), body).unwrap();
    fs::write(
        at("noisy.csv"),
        output(dir.path(), "corrupt --dense 3 --seed 2 t.csv"),
    )
    .unwrap();
    let gappy = "corrupt --gaps 4 --length 0.2 --points 3 --seed 2 t.csv";
    fs::write(at("gappy.csv"), output(dir.path(), gappy)).unwrap();
    let little = "corrupt --dense 0.5 --seed 2 t.csv";
    fs::write(at("little.csv"), output(dir.path(), little)).unwrap();
    let noisy = output(dir.path(), "xyz2bvh -q little.csv");
    fs::write(at("noisy.bvh"), noisy).unwrap();
    let train = "ksvd-train -q -n 60 --iterations 3 --seed 5 -o m.npz --threads";
    let mut first: Option<Vec<Vec<u8>>> = None;
    for threads in ["1", "2", "7"] {
        output(dir.path(), &format!("{train} {threads} t.csv"));
        let mut all = vec![fs::read(at("m.npz")).unwrap()];
        // Exit code 3: somebody should look at it.
        let cleaned = Command::new(crate::common::bin().join("clean"))
            .args(["-q", "--again", "-o", "clean.bvh", "--threads", threads])
            .arg("noisy.bvh")
            .current_dir(dir.path())
            .output()
            .unwrap();
        assert!(matches!(cleaned.status.code(), Some(0 | 3)), "{cleaned:?}");
        all.push(fs::read(at("clean.bvh")).unwrap());
        for line in [
            "cluster -k 12 --seed 5 --threads",
            "denoise -m m.npz --threads",
            "denoise --per-frame --threads",
            "complete -m m.npz --status --threads",
            "complete --per-frame --threads",
            "xyz2bvh -q --threads",
        ] {
            let file = match line.split(' ').next() {
                Some("denoise") => "noisy.csv",
                Some("complete") => "gappy.csv",
                _ => "t.csv",
            };
            all.push(output(dir.path(), &format!("{line} {threads} {file}")));
        }
        match &first {
            None => first = Some(all),
            Some(first) => {
                for (i, (a, b)) in first.iter().zip(&all).enumerate() {
                    assert!(a == b, "result {i} differs at {threads} threads");
                }
            }
        }
    }
}

#[test]
fn a_killed_training_goes_on_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("t.csv"), table(1500)).unwrap();
    let train = "ksvd-train -q --space body -n 150 --iterations 40 --seed 5";
    output(dir.path(), &format!("{train} -o whole.npz t.csv"));
    let words = format!("{train} -o killed.npz --checkpoint ck --log log.jsonl t.csv");
    let mut kills = 0;
    let checkpoint = || fs::read(at("ck")).ok();
    loop {
        let mut words = words.split(' ');
        let mut before = checkpoint();
        let mut child = Command::new(crate::common::bin().join(words.next().unwrap()))
            .args(words)
            .current_dir(dir.path())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // So that it gets on, and is killed at other moments each time.
        let mut changes = 0;
        while changes <= kills % 3 && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
            let now = checkpoint();
            changes += u32::from(now != before);
            before = now;
        }
        // The kill that cannot be caught, of this child alone. It may have ended just before: then
        // there is nothing to go on from.
        child.kill().unwrap();
        if let Some(code) = child.wait().unwrap().code() {
            assert_eq!(code, 0);
            break;
        }
        kills += 1;
        if let Ok(result) = fs::read(at("killed.npz")) {
            assert!(fs::read(at("whole.npz")).unwrap() == result);
        }
    }
    assert!(kills > 0);
    assert!(
        fs::read(at("whole.npz")).unwrap() == fs::read(at("killed.npz")).unwrap(),
        "after {kills} kills"
    );
    assert!(!at("ck").exists());
}

#[test]
fn a_checkpoint_of_another_run_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("t.csv"), table(400)).unwrap();
    // Stop with a checkpoint: the output's folder is not there, which is found out at the end.
    let (table, check) = (at("t.csv"), at("ck"));
    let args = |seed: &'static str, out: &Path| -> Vec<String> {
        let flags = [
            "-q",
            "--space",
            "body",
            "-n",
            "20",
            "--iterations",
            "2",
            "--seed",
            seed,
        ];
        let files = ["--checkpoint", text(&check), "-o", text(out), text(&table)];
        flags.iter().chain(&files).map(|s| s.to_string()).collect()
    };
    let train = |seed, out: &Path| {
        let args = args(seed, out);
        fails(
            "ksvd-train",
            &args.iter().map(String::as_str).collect::<Vec<_>>(),
            b"",
            1,
        )
    };
    let said = train("1", &at("no/where.npz"));
    assert!(said.contains("where.npz"), "{said}");
    if !check.exists() {
        // Refused before the work: nothing was lost. Any file of another kind will do.
        fs::write(&check, "").unwrap();
    }
    let said = train("2", &at("m.npz"));
    assert!(said.contains("ck"), "{said}");
    assert!(!at("m.npz").exists() && check.exists());
    if fs::metadata(&check).unwrap().len() > 0 {
        assert!(
            said.contains("other poses or flags") && said.contains("remove it to start again"),
            "{said}"
        );
        let done = args("1", &at("m.npz"));
        crate::common::command("ksvd-train")
            .args(done)
            .assert()
            .success();
        assert!(!check.exists());
    }
}
