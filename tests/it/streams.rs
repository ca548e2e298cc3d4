//! What every command does with its streams and files: closed pipes, full disks, missing files,
//! formats, exit codes.

use crate::common::{bin, command, fails, long, run, text};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Runs a line under bash, the binaries on its path (and without its builtin of the name
/// `complete`).
fn bash(folder: &Path, line: &str) -> Output {
    let path = std::env::var("PATH").unwrap();
    Command::new("bash")
        .args([
            "-c",
            &format!("set -o pipefail; enable -n complete; {line}"),
        ])
        .env("PATH", format!("{}:{path}", bin().display()))
        .current_dir(folder)
        .output()
        .unwrap()
}

/// A folder with a table, a model and codes.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("t.csv"), long(20_000)).unwrap();
    fs::write(at("s.csv"), long(40)).unwrap();
    let train = "ksvd-train -q --space body -n 8 --sparsity 2 --iterations 1 -o m.npz s.csv";
    assert!(bash(dir.path(), train).status.success());
    dir
}

/// Each command that writes a table, reading t.csv.
const STREAMING: [&str; 8] = [
    "corrupt --dense 1 t.csv",
    "corrupt --gaps 2 --length 0.5 t.csv",
    "complete --per-frame t.csv",
    "complete t.csv",
    "denoise --per-frame t.csv",
    "encode -m m.npz --sparsity 2 t.csv",
    "cluster -k 2 t.csv",
    "encode -m m.npz --sparsity 2 t.csv | decode -m m.npz",
];

#[test]
fn a_closed_pipe_is_success_and_silence() {
    let dir = folder();
    for line in STREAMING {
        let out = bash(dir.path(), &format!("{line} | head -1"));
        let said = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.success(), "{line}: {:?} {said}", out.status);
        assert_eq!(said, "", "{line}");
        assert_eq!(String::from_utf8_lossy(&out.stdout).lines().count(), 1);
    }
    if let (Some(asf), Some(amc)) = (
        crate::common::cmu("07/07.asf"),
        crate::common::cmu("07/07_01.amc"),
    ) {
        let line = format!(
            "amc2xyz --asf {} --fps 120 {} | head -1",
            text(&asf),
            text(&amc)
        );
        let out = bash(Path::new("/"), &line);
        assert!(out.status.success() && out.stderr.is_empty());
    }
    for line in [
        "posing | head -1",
        "complete --help | head -1",
        "posing man complete | head -1",
    ] {
        let out = bash(dir.path(), line);
        assert!(out.status.success() && out.stderr.is_empty(), "{line}");
    }
}

#[test]
fn rows_come_out_while_more_are_waited_for() {
    use std::io::{Read, Write};
    let mut child = Command::new(bin().join("corrupt"))
        .args(["--dense", "0"])
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let (mut to, mut from) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    let table = long(20_000);
    let (told, heard) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let mut buffer = vec![0; 1 << 16];
        while let Ok(n) = from.read(&mut buffer)
            && n > 0
        {
            told.send(n).unwrap();
        }
    });
    // All but a buffer of rows comes without a word about more, after one burst as after the next.
    let (mut sent, mut came) = (0, 0);
    for part in table.as_bytes().chunks(table.len() / 3 + 1) {
        to.write_all(part).unwrap();
        sent += part.len();
        while came + (1 << 16) + 100 < sent {
            // Only so that a test that fails ends.
            let more = heard.recv_timeout(std::time::Duration::from_secs(600));
            came += more.expect("rows that are there come out");
        }
    }
    drop(to);
    assert_eq!(came + heard.iter().sum::<usize>(), table.len());
    assert!(child.wait().unwrap().success());
}

#[test]
fn what_was_coded_before_a_bad_row_is_written() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    let table = fs::read_to_string(at("t.csv")).unwrap();
    let all = bash(dir.path(), "encode -m m.npz --sparsity 2 t.csv").stdout;
    for row in [5, 9_000] {
        let mut lines: Vec<&str> = table.lines().collect();
        lines[row] = "walk,0,x,80,1e1,,5,4,0.125";
        fs::write(at("bad.csv"), lines.join("\n") + "\n").unwrap();
        let out = bash(dir.path(), "encode -m m.npz --sparsity 2 bad.csv");
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{said}");
        let place = format!("bad.csv:{}", row + 1);
        assert!(said.contains(&place) && said.lines().count() == 1, "{said}");
        assert!(all.starts_with(&out.stdout));
        // All but the batch that the row is in.
        let written = out.stdout.iter().filter(|b| **b == b'\n').count();
        assert!(written + 4096 >= row && written <= row, "{written}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error_of_one_line() {
    let dir = folder();
    for line in STREAMING {
        for to in [" > /dev/full", " -o /dev/full"] {
            let out = bash(dir.path(), &format!("{line}{to}"));
            let said = String::from_utf8_lossy(&out.stderr);
            assert_eq!(out.status.code(), Some(1), "{line}{to}: {said}");
            assert_eq!(said.lines().count(), 1, "{line}{to}: {said}");
            assert!(said.contains("space"), "{line}{to}: {said}");
        }
    }
    for line in [
        "score s.csv s.csv",
        "posing",
        "model info m.npz",
        "complete --help",
        "posing man score",
    ] {
        let out = bash(dir.path(), &format!("{line} > /dev/full"));
        assert_eq!(out.status.code(), Some(1), "{line}");
    }
    let out = bash(
        dir.path(),
        "ksvd-train -q --space body -n 4 --iterations 1 -o /dev/full s.csv",
    );
    assert_eq!(out.status.code(), Some(1));
}

#[test]
fn inputs_that_cannot_be_read() {
    let dir = tempfile::tempdir().unwrap();
    let empty = dir.path().join("empty.csv");
    fs::write(&empty, "").unwrap();
    let here = text(dir.path());
    for name in ["complete", "denoise", "corrupt --dense 1", "cluster -k 2"] {
        let (name, flags) = name.split_once(' ').unwrap_or((name, ""));
        let with = |file: &str| -> Vec<String> {
            let flags = flags.split_whitespace().chain([file]);
            flags.map(String::from).collect()
        };
        let said = |file: &str| {
            let args = with(file);
            fails(
                name,
                &args.iter().map(String::as_str).collect::<Vec<_>>(),
                b"",
                1,
            )
        };
        assert!(said("missing.csv").contains("missing.csv: "));
        assert!(said(here).contains("is a directory"));
        assert!(said(text(&empty)).contains("empty.csv: is empty"));
        assert!(said("-").contains("standard input: is empty"));
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let closed = dir.path().join("closed.csv");
        fs::write(&closed, long(2)).unwrap();
        fs::set_permissions(&closed, fs::Permissions::from_mode(0o0)).unwrap();
        // Root reads whatever it likes.
        if fs::File::open(&closed).is_err() {
            let said = fails("complete", &[text(&closed)], b"", 1);
            assert!(said.contains("closed.csv"), "{said}");
        } else {
            eprintln!("skipped: the unreadable file, which this user can read");
        }
    }
    let out = bash(dir.path(), "complete < .");
    assert_eq!(out.status.code(), Some(1));
    assert_eq!(String::from_utf8_lossy(&out.stderr).lines().count(), 1);
}

#[test]
fn an_output_appears_whole_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.csv");
    let bad = format!("{}walk,1,2\n", long(3000));
    for name in ["complete", "denoise"] {
        for flag in [&["--per-frame"][..], &[]] {
            let args = [flag, &["-o", text(&out)]].concat();
            let said = fails(name, &args, bad.as_bytes(), 1);
            assert!(
                said.contains("standard input:3002: expected 9 cells, found 3"),
                "{said}"
            );
            assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
        }
    }
    // A file that was there stays as it was, or is replaced whole; its mode stays.
    fs::write(&out, "before").unwrap();
    fails(
        "complete",
        &["--per-frame", "-o", text(&out)],
        bad.as_bytes(),
        1,
    );
    assert_eq!(fs::read(&out).unwrap(), b"before");
    run("complete", &["--per-frame", "-o", text(&out)], &long(3));
    assert_eq!(fs::read_to_string(&out).unwrap().lines().count(), 4);
    // No command writes over its own input.
    fs::write(&out, long(500)).unwrap();
    fails(
        "corrupt",
        &["--dense", "0", "-o", text(&out), text(&out)],
        b"",
        2,
    );
    assert_eq!(fs::read_to_string(&out).unwrap(), long(500));
    let said = fails(
        "corrupt",
        &["--dense", "0", "-o", "/no/where/x.csv"],
        long(1).as_bytes(),
        1,
    );
    assert!(said.contains("/no/where/x.csv"), "{said}");
}

#[test]
fn exit_codes() {
    let dir = folder();
    let code = |line: &str, want: i32| {
        let out = bash(dir.path(), line);
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(want), "{line}: {said}");
        assert!(want == 0 || said.lines().count() == 1, "{line}: {said}");
    };
    for fine in [
        "complete --version",
        "complete -h",
        "posing",
        "complete -q s.csv",
    ] {
        code(fine, 0);
    }
    for usage in [
        "complete --nonsense",
        "posing nonsense",
        "corrupt s.csv",
        "complete --threads 0 s.csv",
        "complete --max-gap -1 s.csv",
        "complete --max-gap 1 --per-frame s.csv",
        "complete --observe nobody s.csv",
        "complete --fps 50 s.csv",
        "amc2xyz --asf x.asf x.amc",
        "ksvd-train -o x.npz s.csv",
        "ksvd-train -n 0 -o x.npz s.csv",
        "complete -q - - < s.csv",
        "complete -m - - < m.npz",
        "denoise -m - < m.npz",
        "encode -m - < m.npz",
        "decode -m - < m.npz",
        "score - - < s.csv",
        "amc2xyz --asf - --fps 120 < s.csv",
        "ksvd-train -n 2 --valid - -o x.npz < s.csv",
        "dict-concat -o x.npz - - < m.npz",
    ] {
        code(usage, 2);
    }
    for bad in [
        "complete m.npz",
        "complete -m s.csv s.csv",
        "complete -m missing.npz s.csv",
        "echo 'a.x,a.y,a.z' | complete -m m.npz",
        "echo hello | complete",
        "model info s.csv",
    ] {
        code(bad, 1);
    }
}

#[test]
fn binary_never_goes_to_a_terminal() {
    let dir = folder();
    // script gives its command a terminal, where the system has any to give (a bare chroot has
    // not).
    let terminal = bash(dir.path(), "script -qec 'test -t 1' /dev/null < /dev/null");
    if !terminal.status.success() {
        eprintln!("skipped: no command script to make a terminal");
        return;
    }
    let out = bash(
        dir.path(),
        "script -qec 'posing complete --to npy s.csv' /dev/null < /dev/null",
    );
    let said = String::from_utf8_lossy(&out.stdout);
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(
        said.contains("will not write binary output to a terminal"),
        "{said}"
    );
    let out = bash(dir.path(), "complete -q --to npy s.csv | head -c 6");
    assert_eq!(out.stdout, b"\x93NUMPY");
}

#[test]
fn a_cut_off_take_keeps_its_whole_frames_on_request() {
    let Some(amc) = crate::common::shared("data/cmu-broken/07_12.amc") else {
        return;
    };
    let Some(asf) = crate::common::cmu("07/07.asf") else {
        return;
    };
    let args = ["--asf", text(&asf), "--fps", "120", text(&amc)];
    let said = fails("amc2xyz", &args, b"", 1);
    assert!(
        said.contains("07_12.amc:") && said.contains("--keep-whole"),
        "{said}"
    );
    let out = command("amc2xyz")
        .arg("--keep-whole")
        .args(args)
        .output()
        .unwrap();
    assert!(out.status.success());
    assert!(String::from_utf8_lossy(&out.stderr).contains("dropped frame"));
    assert!(String::from_utf8_lossy(&out.stdout).lines().count() > 10);
}
