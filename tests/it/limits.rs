//! What ends a command or limits it from outside: signals, limits of memory and of files, a closed
//! standard output.
#![cfg(target_os = "linux")]

use crate::common::bin;
use posing::numeric::parallel::rng;
use rand::Rng;
use std::fs;
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

/// The signals that end a process, and are handled.
const ENDING: [(&str, i32); 12] = [
    ("HUP", 1),
    ("INT", 2),
    ("QUIT", 3),
    ("TRAP", 5),
    ("USR1", 10),
    ("USR2", 12),
    ("ALRM", 14),
    ("TERM", 15),
    ("XCPU", 24),
    ("VTALRM", 26),
    ("PROF", 27),
    ("SYS", 31),
];

/// Runs a line of a shell in a folder, with the commands on the path.
fn shell(folder: &Path, line: &str) -> Output {
    let path = format!("{}:{}", bin().display(), std::env::var("PATH").unwrap());
    let mut sh = Command::new("sh");
    let sh = sh.args(["-c", line]).current_dir(folder).env("PATH", path);
    sh.env_remove("RUST_BACKTRACE");
    sh.output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// `corrupt` that writes `out` and waits for its table.
fn corrupt(out: &Path, cwd: &Path) -> Child {
    let mut command = Command::new(bin().join("corrupt"));
    let command = command.args(["--dense", "0", "-o", out.to_str().unwrap()]);
    let command = command.current_dir(cwd).stderr(Stdio::null());
    command.stdin(Stdio::piped()).spawn().unwrap()
}

/// The shell's own `kill`: small systems have no program of that name.
fn kill(child: &Child, signal: &str) {
    let line = format!("kill -{signal} {}", child.id());
    assert!(
        Command::new("sh")
            .args(["-c", &line])
            .status()
            .unwrap()
            .success()
    );
}

/// Whether this process ignores a signal, as its children then do.
fn is_ignored(number: i32) -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let mut lines = status.lines();
    let bits = lines.find_map(|l| l.strip_prefix("SigIgn:")).unwrap();
    u64::from_str_radix(bits.trim(), 16).unwrap() >> (number - 1) & 1 == 1
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    entries
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect()
}

#[test]
fn a_signal_leaves_nothing_half_written() {
    let (folder, cwd) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let out = folder.path().join("x.csv");
    // With so many files open, the unfinished one has a name, which the handler has to remove.
    let line = format!(
        "exec 3<&0 4<&0 5<&0 6<&0 7<&0 8<&0 9<&0; for i in {{1..90}}; do exec {{file}}</dev/null; done; exec {} --dense 0 -o {}",
        bin().join("corrupt").display(),
        out.display()
    );
    for (signal, number) in ENDING.into_iter().filter(|s| !is_ignored(s.1)) {
        let mut command = Command::new("bash");
        let command = command.args(["-c", &line]).current_dir(cwd.path());
        let command = command.stdin(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let mut pipe = child.stdin.take().unwrap();
        pipe.write_all(b"a.x,a.y,a.z\n1,2,3\n").unwrap();
        while names(folder.path()).is_empty() {
            assert!(child.try_wait().unwrap().is_none(), "it ended before");
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        kill(&child, signal);
        assert_eq!(child.wait().unwrap().signal(), Some(number), "{signal}");
        assert_eq!(names(folder.path()), [""; 0], "{signal}");
    }
}

#[test]
fn whenever_it_is_killed_a_file_is_the_old_or_the_new_one() {
    let (folder, cwd) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let rows: String = (0..3000).map(|i| format!("{i},2,3\n")).collect();
    let table = format!("a.x,a.y,a.z\n{rows}");
    let mut rng = rng(5, 0);
    for round in 0..60 {
        let (name, signal) = match round % 3 {
            // The kill that nothing can handle, where no file is replaced.
            0 => (format!("{round}.csv"), "KILL"),
            1 => ("x.csv".to_string(), "TERM"),
            _ => ("x.csv".to_string(), "USR1"),
        };
        let out = folder.path().join(&name);
        let before = (signal != "KILL").then(|| format!("before {round}"));
        if let Some(before) = &before {
            fs::write(&out, before).unwrap();
        }
        let mut child = corrupt(&out, cwd.path());
        let mut pipe = child.stdin.take().unwrap();
        // A part of the table, or all of it.
        let part = rng.random_range(0..=2 * table.len()).min(table.len());
        let _ = pipe.write_all(&table.as_bytes()[..part]);
        if part == table.len() {
            drop(pipe);
            for _ in 0..rng.random_range(0..200) {
                std::thread::yield_now();
            }
        }
        kill(&child, signal);
        child.wait().unwrap();
        let now = fs::read_to_string(&out).ok();
        let is_new = now.as_ref() == Some(&table);
        assert!(is_new || now == before, "{round}: {now:?}");
        let names = names(folder.path());
        assert!(names.iter().all(|name| name.ends_with(".csv")), "{names:?}");
    }
}

#[test]
fn a_file_over_its_limit_is_an_error_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let rows = "1,2,3\n".repeat(100_000);
    fs::write(folder.path().join("t.csv"), format!("a.x,a.y,a.z\n{rows}")).unwrap();
    let out = shell(
        folder.path(),
        "ulimit -f 64; exec corrupt --dense 0 -o x.csv t.csv",
    );
    let said = said(&out);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(
        said.contains("x.csv") && said.lines().count() == 1,
        "{said}"
    );
    assert_eq!(names(folder.path()), ["t.csv"]);
}

#[test]
fn a_limit_of_memory_gives_a_result_or_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let rows: String = (0..200)
        .map(|t| {
            let gap = (80..90).contains(&t);
            let of = |p: i32| {
                if gap && p == 2 {
                    ",,,".to_string()
                } else {
                    format!(",{},{},{}", 3 * p + t, 4 * p * p, (7 * p) % 5 + t / 3)
                }
            };
            format!(
                "{:.4}{}\n",
                f64::from(t) / 120.0,
                (0..6).map(of).collect::<String>()
            )
        })
        .collect();
    let head: String = (0..6).map(|p| format!(",p{p}.x,p{p}.y,p{p}.z")).collect();
    fs::write(folder.path().join("t.csv"), format!("time{head}\n{rows}")).unwrap();
    let complete = |limit: u32| {
        // The limit of seconds ends what does not end by itself.
        let line = format!("ulimit -v {limit}; ulimit -t 100; exec complete --self -q t.csv");
        shell(folder.path(), &line)
    };
    let free = shell(folder.path(), "complete --self -q t.csv");
    assert!(free.status.success() && !free.stdout.is_empty());
    for limit in [100_000, 200_000, 300_000, 400_000, 1_000_000] {
        let out = complete(limit);
        match out.status.code() {
            Some(0) => assert!(out.stdout == free.stdout, "{limit}"),
            code => {
                let said = said(&out);
                assert_eq!(code, Some(1), "{limit}: {said}");
                assert!(
                    said.contains("memory") && said.lines().count() == 1,
                    "{limit}: {said}"
                );
            }
        }
    }
    assert!(complete(1_000_000).status.success());
}

#[test]
fn a_closed_standard_output_is_told() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("t.csv"), "a.x,a.y,a.z\n1,2,3\n").unwrap();
    for line in [
        "corrupt --dense 0 t.csv >&-",
        "posing corrupt --dense 0 t.csv >&-",
        "corrupt --dense 0 -o /dev/stdout t.csv >&-",
        "corrupt --help >&-",
        "posing list >&-",
        "posing man corrupt >&-",
    ] {
        let out = shell(folder.path(), line);
        let said = said(&out);
        assert_eq!(out.status.code(), Some(1), "{line}: {said}");
        assert!(
            said.contains("standard output") && said.lines().count() == 1,
            "{line}: {said}"
        );
    }
    for line in [
        "corrupt --dense 0 -o x.csv t.csv >&-",
        "corrupt --dense 0 t.csv > /dev/null",
        // As other programs open it for theirs.
        "corrupt --dense 0 t.csv 1<> /dev/null",
    ] {
        let out = shell(folder.path(), line);
        assert!(out.status.success(), "{line}: {}", said(&out));
    }
}
