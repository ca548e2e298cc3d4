//! Files in and out: several that make one table, slow pipes, links, and what an array has no room
//! for.

use crate::common::{Numbers, command, fails, run, take, thin};
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Stdio;

/// `frames` of a walk with its left foot hidden in the first or last ten.
fn walk(from: usize, hidden: std::ops::Range<usize>) -> Option<String> {
    let table = thin(&take("07", "07_01", &[])?, 400, 1);
    let (header, rows) = table.split_once('\n')?;
    let foot: Vec<usize> = header
        .split(',')
        .enumerate()
        .filter_map(|(c, n)| n.starts_with("lfoot.").then_some(c))
        .collect();
    let rows = rows
        .lines()
        .skip(from)
        .take(60)
        .enumerate()
        .map(|(t, row)| {
            let cells = row.split(',').enumerate();
            let shown = |(c, cell): (usize, &str)| {
                if hidden.contains(&t) && foot.contains(&c) {
                    String::new()
                } else {
                    cell.to_string()
                }
            };
            cells.map(shown).collect::<Vec<_>>().join(",") + "\n"
        });
    Some(format!("{header}\n{}", rows.collect::<String>()))
}

/// A table as an array in a folder.
fn array(folder: &Path, name: &str, table: &str) -> String {
    let path = folder.join(name).to_str().unwrap().to_string();
    run("corrupt", &["--dense", "0", "-o", &path], table);
    path
}

#[test]
fn files_that_tell_no_take_are_takes() {
    let (Some(one), Some(two)) = (walk(0, 50..60), walk(300, 0..10)) else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let one = array(folder.path(), "one.npy", &one);
    let two = array(folder.path(), "two.npy", &two);
    let done = |files: &[&str]| run("complete", &[&["-q", "--fps", "120"], files].concat(), "");
    let rows = |table: String| table.split_once('\n').unwrap().1.to_string();
    assert_eq!(done(&[&one, &two]), done(&[&one]) + &rows(done(&[&two])));
    // The same file twice is two takes too, whatever is between them.
    let thrice = done(&[&one, &two, &one]);
    assert!(thrice.ends_with(&rows(done(&[&one]))));
    assert_eq!(done(&[&one, &one]), done(&[&one]) + &rows(done(&[&one])));
    let said = fails("xyz2bvh", &["--fps", "120", &one, &two], b"", 1);
    assert!(
        said.contains("one") && said.contains("two") && said.contains("--take"),
        "{said}"
    );
}

#[test]
fn each_take_has_its_own_rate() {
    let Some(fast) = walk(0, 25..35) else { return };
    // A quarter of the rate: 10 frames are a third of a second.
    let mut slow = String::new();
    for (t, row) in fast.lines().skip(1).enumerate() {
        let cells = row.splitn(3, ',').nth(2).unwrap();
        slow += &format!("slow,{},{cells}\n", t as f64 / 30.0);
    }
    let header = fast.lines().next().unwrap().to_string() + "\n";
    let args = ["-q", "--max-gap", "0.2"];
    let both = run("complete", &args, &format!("{fast}{slow}"));
    let alone = run("complete", &args, &format!("{header}{slow}"));
    assert!(both.ends_with(alone.split_once('\n').unwrap().1));
    assert_eq!(Numbers::read(&alone).missing(), 30);
    assert_eq!(Numbers::read(&both).missing(), 30);
}

#[test]
fn a_last_batch_of_few_frames_contradicts_no_rate() {
    let rows = (0..515).map(|t| format!("{:.3},1,2,3\n", t as f64 / 120.0));
    let table = "time,root.x,root.y,root.z\n".to_string() + &rows.collect::<String>();
    let args = ["-q", "--per-frame", "--space", "body", "--fps", "120"];
    assert_eq!(run("complete", &args, &table), table);
    let args = [&args[..5], &["100"]].concat();
    assert!(fails("complete", &args, table.as_bytes(), 2).contains("--fps 100 contradicts"));
}

#[cfg(unix)]
#[test]
fn what_a_link_names_is_written_and_the_link_stays() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let table = "a.x,a.y,a.z\n1,2,3\n";
    fs::write(at("there.csv"), "old").unwrap();
    for target in ["there.csv", "not-yet.csv"] {
        let link = at("link.csv");
        let _ = fs::remove_file(&link);
        std::os::unix::fs::symlink(target, &link).unwrap();
        run(
            "corrupt",
            &["--dense", "0", "-o", link.to_str().unwrap()],
            table,
        );
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(at(target)).unwrap(), table);
    }
    let round = at("round.csv");
    std::os::unix::fs::symlink("round.csv", &round).unwrap();
    let said = fails(
        "corrupt",
        &["--dense", "0", "-o", round.to_str().unwrap()],
        table.as_bytes(),
        1,
    );
    assert!(said.contains("links"), "{said}");
    if Path::new("/dev/stdout").exists() {
        // Between what others write to the same file.
        std::os::unix::fs::symlink("/dev/stdout", at("out.csv")).unwrap();
        for to in ["/dev/stdout", at("out.csv").to_str().unwrap()] {
            let mut shell = std::process::Command::new("sh");
            shell.args([
                "-c",
                "(echo before; \"$0\" --dense 0 -o \"$1\"; echo after) > all.csv",
            ]);
            shell.arg(crate::common::bin().join("corrupt")).arg(to);
            let mut shell = shell
                .current_dir(folder.path())
                .stdin(Stdio::piped())
                .spawn()
                .unwrap();
            shell
                .stdin
                .take()
                .unwrap()
                .write_all(table.as_bytes())
                .unwrap();
            assert!(shell.wait().unwrap().success());
            let all = fs::read_to_string(at("all.csv")).unwrap();
            assert_eq!(all, format!("before\n{table}after\n"));
        }

        assert_eq!(
            run("corrupt", &["--dense", "0", "-o", "/dev/stdout"], table),
            table
        );
        assert!(Path::new("/dev/stdout").is_symlink());
    }
}

#[test]
fn a_slow_pipe_is_told_by_what_it_holds() {
    let folder = tempfile::tempdir().unwrap();
    let path = array(folder.path(), "a.npy", "root.x,root.y,root.z\n1,2,3\n");
    let bytes = fs::read(path).unwrap();
    let mut child = std::process::Command::new(crate::common::bin().join("corrupt"))
        .args(["--dense", "0", "--joints", "root"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = child.stdin.take().unwrap();
    pipe.write_all(&bytes[..3]).unwrap();
    pipe.flush().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(100));
    pipe.write_all(&bytes[3..]).unwrap();
    drop(pipe);
    let out = child.wait_with_output().unwrap();
    assert_eq!(
        String::from_utf8(out.stdout).unwrap(),
        "root.x,root.y,root.z\n1,2,3\n"
    );
}

#[test]
fn an_array_never_swallows_columns() {
    let table = "a.x,a.y,a.z\n1,2,3\n4,5,6\n";
    let said = fails("cluster", &["-k", "2", "--to", "npy"], table.as_bytes(), 2);
    assert!(said.contains("the column cluster would be lost"), "{said}");
    let folder = tempfile::tempdir().unwrap();
    let parts = folder.path().to_str().unwrap();
    run(
        "cluster",
        &["-q", "-k", "2", "--split", parts, "--to", "npy"],
        table,
    );
    assert!(folder.path().join("1.npy").exists());
    // Others would be taken for parts of this: of more clusters, in another format, with other
    // zeros.
    for (args, left) in [
        (&["-k", "1", "--to", "npy"][..], "1.npy"),
        (&["-k", "2"], ".npy"),
    ] {
        let args = [args, &["--split", parts]].concat();
        let said = fails("cluster", &args, table.as_bytes(), 1);
        assert!(
            said.contains(left) && said.contains("is from another split"),
            "{said}"
        );
    }
    run(
        "cluster",
        &["-q", "-k", "2", "--split", parts, "--to", "npy"],
        table,
    );
}

#[test]
fn balanced_parts_have_equally_many_frames() {
    let rows: String = (0..50)
        .map(|i| format!("{},{i},{}\n", i * i, i % 3))
        .collect();
    let table = format!("a.x,a.y,a.z\n{rows}");
    let folder = tempfile::tempdir().unwrap();
    let parts = folder.path().to_str().unwrap();
    let args = ["-q", "-k", "4", "--balance", "--split", parts];
    run("cluster", &args, &table);
    let part = |i: usize| std::fs::read_to_string(folder.path().join(format!("{i}.csv"))).unwrap();
    let frames = |part: &String| part.lines().count() - 1;
    let all: Vec<String> = (0..4).map(part).collect();
    assert_eq!(all.iter().map(frames).collect::<Vec<_>>(), [12, 13, 12, 13]);
    let mut found: Vec<&str> = all.iter().flat_map(|p| p.lines().skip(1)).collect();
    let mut given: Vec<&str> = rows.lines().collect();
    found.sort_unstable();
    given.sort_unstable();
    assert_eq!(found, given);
    let said = fails(
        "cluster",
        &["-k", "4", "--balance", "--branch", "2"],
        table.as_bytes(),
        2,
    );
    assert!(said.contains("--branch"), "{said}");
}

#[test]
fn what_was_never_seen_stays_missing_in_codes() {
    let table = "root.x,root.y,root.z,a.x,a.y,a.z\n1,2,3,4,5,7\n,,,,,\n4,5,6,1,0,2\n0,0,0,0,0,0\n";
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.npz").to_str().unwrap().to_string();
    let whole: Vec<&str> = table
        .lines()
        .filter(|l| !l.starts_with(',') && *l != "0,0,0,0,0,0")
        .collect();
    run(
        "ksvd-train",
        &[
            "-q",
            "-n",
            "2",
            "--space",
            "body",
            "--iterations",
            "1",
            "-o",
            &model,
        ],
        &(whole.join("\n") + "\n"),
    );
    let codes = run("encode", &["-m", &model], table);
    let lines: Vec<&str> = codes.lines().collect();
    assert_eq!((lines[2], lines[4]), (",,,,,,", ",,,,,,0"));
    let back = run("decode", &["-m", &model], &codes);
    let lines: Vec<&str> = back.lines().collect();
    assert_eq!((lines[2], lines[4]), (",,,,,", "0,0,0,0,0,0"));
    let torn = "atom1,coef1,rms\n,5,0\n";
    assert!(fails("decode", &["-m", &model], torn.as_bytes(), 1).contains("atom1 is empty"));
    let torn = "atom1,coef1,rms\n0,3,1\n0,2,\"1\n0,1,1\n";
    assert!(fails("decode", &["-m", &model], torn.as_bytes(), 1).contains("quote"));
    // Standard input is no place for both.
    command("decode").args(["-m", "-", "-"]).assert().failure();
}

#[test]
fn frames_with_gaps_are_not_learned_from_but_coded() {
    let table = "root.x,root.y,root.z,a.x,a.y,a.z\n1,2,3,4,5,7\n,,,4,5,7\n4,5,6,1,0,2\n7,8,1,,,\n";
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.npz").to_str().unwrap().to_string();
    let how = ["-n", "2", "--space", "body", "--iterations", "1", "-o"];
    let done = command("ksvd-train")
        .args(how)
        .arg(&model)
        .write_stdin(table)
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(
        said.contains("2 of 4 frames skipped: missing points"),
        "{said}"
    );
    let codes = run("encode", &["-m", &model, "--sparsity", "1"], table);
    let code = |row: usize| {
        let cells: Vec<&str> = codes.lines().nth(row).unwrap().split(',').collect();
        (cells[0].to_string(), cells[1].parse::<f64>().unwrap())
    };
    // A pose of which one point is hidden has the atom and the coefficient of the whole: the atom's
    // seen part is weighed alone.
    let (whole, part) = (code(1), code(2));
    assert_eq!(whole.0, part.0);
    assert!((whole.1 - part.1).abs() <= 1e-4, "{codes}");
}

#[test]
fn many_poses_are_coded_in_their_order_and_those_before_a_faulty_row_too() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.npz").to_str().unwrap().to_string();
    let header = "root.x,root.y,root.z,a.x,a.y,a.z\n";
    let atoms = format!("{header}1,2,3,4,5,7\n4,5,6,1,0,2\n7,-1,2,2,8,1\n");
    let train = [
        "-q",
        "-n",
        "3",
        "--space",
        "body",
        "--iterations",
        "0",
        "-o",
    ];
    run("ksvd-train", &[&train[..], &[&model]].concat(), &atoms);
    // Each pose a number of times an atom: more than all threads are given at once.
    let poses = |n: usize| -> String {
        let row = |t: usize| {
            [1, 2, 3, 4, 5, 7]
                .map(|v| (v * (t + 1)).to_string())
                .join(",")
        };
        (0..n).map(|t| row(t) + "\n").collect()
    };
    let coded = |threads: &str| {
        let args = ["-m", &model, "--sparsity", "1", "--threads", threads];
        run("encode", &args, &(header.to_string() + &poses(3000)))
    };
    let codes = coded("2");
    assert_eq!((coded("1"), codes.lines().count()), (codes.clone(), 3001));
    let lines: Vec<&str> = codes.lines().skip(1).collect();
    let coefficient = |line: &str| line.split(',').nth(1).unwrap().parse::<f64>().unwrap();
    let one = coefficient(lines[0]);
    for (t, line) in (1..).zip(&lines) {
        assert!(
            (coefficient(line) / one / f64::from(t) - 1.0).abs() <= 1e-6,
            "{t}"
        );
    }
    let torn = format!("{header}{}1,2,x,4,5,7\n", poses(700));
    let mut encode = command("encode");
    let output = encode
        .args(["-m", &model])
        .write_stdin(torn)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("702"), "{said}");
    assert_eq!(output.stdout.iter().filter(|b| **b == b'\n').count(), 701);
}
