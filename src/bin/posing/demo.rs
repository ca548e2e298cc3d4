//! The first minute: a captured run is damaged, restored and drawn.

use clap::Parser;
use posing::cli::paths::OutputPath;
use posing::cli::{messages, streams};
use posing::io::output::write_file;
use posing::{Error, Place, Result};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};

/// Damage a captured run, restore it, and draw what came of it
///
/// Writes into DIR a run of CMU's database (take 09_06), which is built in; the run with 1 cm of
/// noise on every coordinate and four gaps of 0.2 s in three points each; the run as denoise and
/// complete restore it with the built-in model, which has seen no take of this person; a BVH file;
/// and a page that plays all three. Files of these names there are replaced. The commands that do
/// it are printed: they work with files of yours as well.
#[derive(Parser)]
#[command(
    name = "demo",
    version,
    after_help = "Examples:\n  posing demo\n  posing demo first-minute/"
)]
pub struct Args {
    /// Folder for the files; it is made if it is not there
    #[arg(value_name = "DIR", default_value = "posing-demo")]
    folder: OutputPath,
}

const SKELETON: &[u8] = include_bytes!(concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/testdata/cmu/09/09.asf"
));
const TAKE: &[u8] = include_bytes!(concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/testdata/cmu/09/09_06.amc"
));
const CREDIT: &str = "The data used in this project was obtained from mocap.cs.cmu.edu. The \
                      database was created with funding from NSF EIA-0196217.";

/// The commands; words in the folder.
const RESTORE: &[&[&str]] = &[
    &[
        "amc2xyz",
        "--asf",
        "09.asf",
        "--fps",
        "120",
        "-o",
        "truth.csv",
        "09_06.amc",
    ],
    &[
        "corrupt",
        "--dense",
        "1cm",
        "--gaps",
        "4",
        "--length",
        "0.2",
        "--points",
        "3",
        "--seed",
        "1",
        "-o",
        "damaged.csv",
        "truth.csv",
    ],
    &["denoise", "--status", "-o", "denoised.csv", "damaged.csv"],
    &["complete", "--status", "-o", "restored.csv", "denoised.csv"],
    &[
        "xyz2bvh",
        "--skeleton",
        "09.asf",
        "-o",
        "restored.bvh",
        "restored.csv",
    ],
];
const DRAW: &[&str] = &[
    "plot",
    "--title",
    "A run: truth, damaged, restored",
    "--names",
    "truth,damaged,restored",
    "--note",
    "CMU take 09_06 with 1 cm of noise and 4 gaps of 0.2 s in 3 points each, restored by denoise, \
     then complete. The built-in model has seen no take of this person.",
    "--table",
    "scores.csv",
    "--caption",
    "Coordinates left missing, RMS error (cm) in the gaps and elsewhere, RMS acceleration (cm/s²)",
    "--credit",
    CREDIT,
    "-o",
    "demo.html",
    "truth.csv",
    "damaged.csv",
    "restored.csv",
];

pub fn work(args: &Args) -> Result<()> {
    let folder = &args.folder;
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    write_file(folder.join("09.asf"), SKELETON)?;
    write_file(folder.join("09_06.amc"), TAKE)?;
    messages::info(&format!("in {}:", folder.display()));
    for words in RESTORE {
        run(folder, words)?;
    }
    let rows = ["truth", "damaged", "restored"].map(|name| row(folder, name));
    let rows = rows.into_iter().collect::<Result<Vec<_>>>()?;
    let titles = ["", "left", "in gaps", "elsewhere", "accel."];
    let table = [&[titles.map(String::from)], &rows[..]].concat();
    let lines = table.iter().map(|row| row.join(",") + "\n");
    write_file(
        folder.join("scores.csv"),
        lines.collect::<String>().as_bytes(),
    )?;
    run(folder, DRAW)?;
    streams::write_bytes(None, summary(folder, &rows).as_bytes(), false)
}

/// What came of it, and where it is.
fn summary(folder: &Path, rows: &[[String; 5]]) -> String {
    let titles = [
        [
            "",
            "coordinates",
            "RMS error, cm,",
            "RMS error, cm,",
            "RMS acceleration,",
        ],
        ["", "still missing", "where missing", "where noisy", "cm/s²"],
    ];
    let titles = titles.map(|row| row.map(String::from));
    let line = |[name, cells @ ..]: &[String; 5]| {
        let cells: String = cells.iter().map(|cell| format!("  {cell:>17}")).collect();
        format!("{name:<10}{cells}\n")
    };
    let table: String = titles.iter().chain(rows).map(line).collect();
    let at = |name: &str| folder.join(name).display().to_string();
    format!(
        "\n{table}\nThe built-in model has seen no take of this person.\n\n\
         Watch       {}   (in any browser: truth, damaged and restored side by side)\n\
         Open        {}   in Blender or any other tool that reads BVH\n\
         The tables  {}, damaged.csv, restored.csv\n",
        at("demo.html"),
        at("restored.bvh"),
        at("truth.csv")
    )
}

/// The words of a command as a shell reads them, without the texts of a page.
fn typed(words: &[&str]) -> String {
    let is_text = |word: &str| ["--title", "--note", "--caption", "--credit"].contains(&word);
    let behind = std::iter::once(&"").chain(words);
    let words = words.iter().zip(behind);
    let words = words.filter(|(word, before)| !is_text(word) && !is_text(before));
    words.map(|(word, _)| *word).collect::<Vec<_>>().join(" ")
}

/// Runs a command of this program in the folder, and prints how it is typed; what it prints.
fn run(folder: &Path, words: &[&str]) -> Result<Vec<u8>> {
    messages::info(&format!("posing {}", typed(words)));
    output(folder, words)
}

fn output(folder: &Path, words: &[&str]) -> Result<Vec<u8>> {
    // Without /proc the system does not say what runs.
    let called = std::env::args_os().next().unwrap_or_default();
    let program = std::env::current_exe().unwrap_or_else(|_| {
        let is_path = Path::new(&called).components().count() > 1;
        let path = is_path
            .then(|| std::fs::canonicalize(&called).ok())
            .flatten();
        path.unwrap_or_else(|| called.into())
    });
    let done = Command::new(&program)
        .args(words)
        .arg("--quiet")
        .current_dir(folder)
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|e| Error::io(&program, e))?;
    if done.status.success() {
        Ok(done.stdout)
    } else {
        Err(Error::data(
            Place::file(folder.display().to_string()),
            format!("posing {} failed", words[0]),
        ))
    }
}

/// How a table compares with the truth: its name, the coordinates that are missing, the errors
/// where they were missing and elsewhere, and the accelerations.
fn row(folder: &Path, name: &str) -> Result<[String; 5]> {
    let table = format!("{name}.csv");
    let words = [
        "score",
        "--json",
        "--damaged",
        "damaged.csv",
        "truth.csv",
        &table,
    ];
    let score: Value = serde_json::from_slice(&output(folder, &words)?)
        .map_err(|e| Error::usage(e.to_string()))?;
    let number = |pointer: &str, decimals: usize| match score.pointer(pointer) {
        Some(value) if value.is_number() => {
            format!("{:.decimals$}", value.as_f64().unwrap_or(f64::NAN))
        }
        _ => "–".to_string(),
    };
    Ok([
        name.to_string(),
        number("/all/still_missing", 0),
        number("/damaged/missing/rms", 2),
        number("/damaged/observed/rms", 2),
        number("/accelerations/result", 0),
    ])
}
