//! Training in parts, by the scripts of testdata/examples: one machine, make and GNU parallel.
//! Slurm: tests/slurm/run.sh.

use crate::common::{bin, skipped};
use std::fs;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, SystemTime};

/// The commands that the scripts run, one after another.
const COMMANDS: &str = r#"
posing cluster -q -k 4 --balance --split parts 'my poses.csv'
for i in 0 1 2 3; do posing ksvd-train -q -n 8 --iterations 40 -o parts/$i.npz parts/$i.csv; done
posing dict-concat -q --prune 0.999 -o dict.npz parts/0.npz parts/1.npz parts/2.npz parts/3.npz
"#;
const MAKE: &str = "cp $EXAMPLES/train.mk $EXAMPLES/train.sh . && make -s -j2 -f train.mk";
const PARALLEL: &str = "JOBS=2 sh $EXAMPLES/train.parallel.sh";

/// A folder, with a space in its name as the table of poses has.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        let folder = Folder(
            tempfile::Builder::new()
                .prefix("my takes ")
                .tempdir()
                .unwrap(),
        );
        let cmu = "$EXAMPLES/../cmu/07";
        folder.must(&format!(
            "posing amc2xyz -q --space body --asf {cmu}/07.asf --fps 120 -o 'my poses.csv' {cmu}/07_01.amc"
        ));
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn shell(&self, script: &str) -> Command {
        let path = std::env::var("PATH").unwrap();
        let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples");
        let mut command = Command::new("sh");
        command.args(["-ec", script]).current_dir(self.0.path());
        for name in [
            "CLUSTER",
            "DICT",
            "FORMAT",
            "JOIN",
            "LOGS",
            "PARTS",
            "POSING",
            "SSHLOGIN",
            "THREADS",
            "MAKEFLAGS",
        ] {
            command.env_remove(name);
        }
        let posing = format!("{}:{path}", bin().display());
        command.env("PATH", posing).env("EXAMPLES", examples);
        command.env("POSES", "my poses.csv").env("K", "4");
        command.env("TRAIN", "-n 8 --iterations 40");
        command
    }

    fn run(&self, script: &str) -> (Output, String) {
        let out = self.shell(script).output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        (out, said)
    }

    fn must(&self, script: &str) {
        let (out, said) = self.run(script);
        assert!(out.status.success(), "{script}: {said}");
    }

    fn refuses(&self, script: &str, part: &str) {
        let (out, said) = self.run(script);
        assert!(!out.status.success(), "{script}");
        assert!(said.contains(part), "{script}: {said}");
    }

    fn dictionary(&self) -> Vec<u8> {
        fs::read(self.path("dict.npz")).unwrap()
    }

    /// When the models of the parts were written.
    fn times(&self) -> [SystemTime; 4] {
        let time = |i| {
            fs::metadata(self.path(&format!("parts/{i}.npz")))
                .unwrap()
                .modified()
                .unwrap()
        };
        [0, 1, 2, 3].map(time)
    }
}

/// The ways to train that can be tested here.
fn ways() -> Vec<&'static str> {
    let parallel = Command::new("parallel").arg("--version").output();
    let has_parallel =
        parallel.is_ok_and(|out| String::from_utf8_lossy(&out.stdout).contains("GNU"));
    if !has_parallel {
        skipped("GNU parallel is not installed");
    }
    let mut ways = vec!["sh $EXAMPLES/train.sh", MAKE, PARALLEL];
    ways.truncate(if has_parallel { 3 } else { 2 });
    ways
}

#[test]
fn every_way_gives_the_bytes_of_the_commands() {
    let one = Folder::new();
    one.must(COMMANDS);
    for way in ways() {
        let folder = Folder::new();
        folder.must(way);
        assert!(folder.dictionary() == one.dictionary(), "{way}");
        let times = folder.times();
        folder.must(way);
        assert_eq!(folder.times(), times, "{way}: trained again");
        // Other flags: all anew, but not split again.
        folder.must(&format!("export TRAIN='-n 5 --iterations 2'; {way}"));
        let anew = folder.times();
        assert!((0..4).all(|i| anew[i] > times[i]), "{way}");
        assert!(folder.dictionary() != one.dictionary());
    }
}

#[test]
fn a_part_that_fails_is_named_and_stops_no_other() {
    let one = Folder::new();
    one.must(COMMANDS);
    for way in ways() {
        let folder = Folder::new();
        folder.must("sh $EXAMPLES/train.sh split");
        let part = fs::read(folder.path("parts/2.csv")).unwrap();
        fs::write(folder.path("parts/2.csv"), "nonsense\n").unwrap();
        let (out, said) = folder.run(way);
        assert!(!out.status.success());
        assert!(
            said.contains("train.sh: parts/2.csv") && said.contains("parts/2.csv:1: has no points"),
            "{said}"
        );
        assert!(
            !said.contains("parts/1.csv") && !said.contains("parts/3.csv"),
            "{said}"
        );
        assert!(folder.path("parts/3.npz").exists() && !folder.path("dict.npz").exists());
        let log = fs::read_to_string(folder.path("logs/2.log")).unwrap();
        assert!(log.contains("has no points"), "{log}");
        let models = ["0", "1", "3"].map(|i| {
            fs::metadata(folder.path(&format!("parts/{i}.npz")))
                .unwrap()
                .modified()
                .unwrap()
        });
        fs::write(folder.path("parts/2.csv"), part).unwrap();
        folder.must(way);
        let times = folder.times();
        assert_eq!(
            [times[0], times[1], times[3]],
            models,
            "{way}: trained again"
        );
        assert!(folder.dictionary() == one.dictionary(), "{way}");
    }
}

#[test]
fn a_part_that_is_killed_goes_on_from_its_checkpoint() {
    let long = "export TRAIN='-n 8 --iterations 2000'";
    let one = Folder::new();
    one.must(&COMMANDS.replace("--iterations 40", "--iterations 2000"));
    let folder = Folder::new();
    folder.must(&format!("{long}; sh $EXAMPLES/train.sh split"));
    let part = format!("{long}; exec sh $EXAMPLES/train.sh part 1");
    let mut child = folder.shell(&part).process_group(0).spawn().unwrap();
    while !folder.path("parts/1.npz.checkpoint").exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before");
        std::thread::sleep(Duration::from_millis(1));
    }
    // The shell and what it runs.
    folder.must(&format!("kill -9 -{}", child.id()));
    child.wait().unwrap();
    assert!(!folder.path("parts/1.npz").exists());
    folder.must(&format!("{long}; sh $EXAMPLES/train.sh"));
    let log = fs::read_to_string(folder.path("logs/1.log")).unwrap();
    assert!(log.contains("resuming from iteration"), "{log}");
    assert!(folder.dictionary() == one.dictionary());
    assert!(!folder.path("parts/1.npz.checkpoint").exists());
}

#[test]
fn parts_from_a_pipe_are_trained_where_no_poses_are_named() {
    let folder = Folder::new();
    folder.must("posing cluster -q -k 4 --split parts < 'my poses.csv'; cp -R parts was");
    folder.refuses(
        "sh $EXAMPLES/train.sh",
        "parts is a split of other poses or by other flags (given; now",
    );
    folder.must("unset POSES; mv 'my poses.csv' poses.csv; sh $EXAMPLES/train.sh; for i in 0 1 2 3; do cmp parts/$i.csv was/$i.csv; done");
    assert!(folder.dictionary().starts_with(b"PK"));
    folder.refuses(
        "unset POSES; K=5 sh $EXAMPLES/train.sh",
        "parts has 4 tables: set K=4",
    );
}

#[test]
fn the_steps_agree_on_poses_flags_and_number_of_parts() {
    let (whole, folder) = (Folder::new(), Folder::new());
    whole.must("sh $EXAMPLES/train.sh");
    // What the split was told holds for the other steps; files of others do not count.
    folder.must(
        "sh $EXAMPLES/train.sh split; cp 'my poses.csv' parts/00_take1.csv; unset K TRAIN; export K=2
        for i in 0 1 2 3; do sh $EXAMPLES/train.sh part $i; done; sh $EXAMPLES/train.sh join",
    );
    assert!(folder.dictionary() == whole.dictionary());
    for part in ["9", "''", "abc", "-1"] {
        folder.refuses(&format!("sh $EXAMPLES/train.sh part {part}"), "has no part");
    }
    folder.refuses(
        "sh $EXAMPLES/train.sh rm dict.npz",
        "expected nothing, split",
    );
    for k in ["0", "08", "abc"] {
        folder.refuses(
            &format!("K={k} sh $EXAMPLES/train.sh"),
            "expected a number from 1",
        );
    }
    // A split that is refused stops the steps after it, too, which say why.
    folder.refuses(
        "K=3 sh $EXAMPLES/train.sh split",
        "parts is a split of other poses",
    );
    folder.refuses(
        "sh $EXAMPLES/train.sh join",
        "parts is not split: parts is a split of other poses",
    );
    folder.must("sh $EXAMPLES/train.sh");
    assert!(folder.dictionary() == whole.dictionary());
    // Contents count, and times do not.
    let times = folder.times();
    folder.must("touch parts/?.csv; sh $EXAMPLES/train.sh");
    assert_eq!(folder.times(), times);
    folder.must("cp -p parts/1.csv was.csv; cp -p parts/0.csv parts/1.csv; : > parts/2.npz; sh $EXAMPLES/train.sh");
    let now = folder.times();
    let anew: Vec<bool> = (0..4).map(|i| now[i] != times[i]).collect();
    assert_eq!(anew, [false, true, true, false]);
    folder.must("cp -p was.csv parts/1.csv; sh $EXAMPLES/train.sh");
    assert!(folder.dictionary() == whole.dictionary());
    folder.refuses(
        "rm parts/1.csv; sh $EXAMPLES/train.sh",
        "parts has 3 of 4 tables: restore",
    );
}

#[test]
fn no_part_is_removed_or_written_over() {
    let folder = Folder::new();
    folder.must("sh $EXAMPLES/train.sh; head -n 200 'my poses.csv' > other.csv; echo mine > parts/shot2.txt");
    let (times, dictionary) = (folder.times(), folder.dictionary());
    for other in ["POSES=other.csv", "K=5000", "K=3", "CLUSTER=", "FORMAT=npy"] {
        let refusal = "parts is a split of other poses or by other flags";
        folder.refuses(&format!("{other} sh $EXAMPLES/train.sh"), refusal);
    }
    folder.refuses("PARTS=. sh $EXAMPLES/train.sh", ". holds other files");
    folder.refuses(
        "POSES=none.csv sh $EXAMPLES/train.sh",
        "none.csv: no such file",
    );
    folder.must("sh $EXAMPLES/train.sh; test -e parts/shot2.txt");
    assert_eq!(folder.times(), times);
    // Another folder and the same result: the dictionary that is there is not that of these parts.
    folder.must(
        "export PARTS=parts2 POSES=other.csv; sh $EXAMPLES/train.sh; mv dict.npz other.npz
        DICT=again.npz sh $EXAMPLES/train.sh; cmp other.npz again.npz",
    );
    folder.must("cp other.npz dict.npz; sh $EXAMPLES/train.sh");
    assert!(folder.dictionary() == dictionary);
    assert_eq!(folder.times(), times);
}
