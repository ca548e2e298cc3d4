//! The default of each flag, as `--help` states it, is that of the library.

use crate::common::command;
use posing::cluster::KMeans;
use posing::draw::figure;
use posing::evaluate::benchmark::Settings;
use posing::evaluate::damage::Corruption;
use posing::prior::multiscale::TrainSettings;
use posing::prior::{OpenOptions, TrainOptions};
use posing::restore::Denoise;
use posing::sparse::{Ksvd, Omp, SelectionRule};
use std::collections::BTreeMap;

/// (command, flag) -> its default by the library. Flags of all tables (`--units`, `--up`,
/// `--space`) are conventions of the commands alone.
fn library() -> BTreeMap<(&'static str, &'static str), String> {
    let rule = |rule| match rule {
        SelectionRule::Oomp => "oomp",
        SelectionRule::Omp => "omp",
    };
    let auto = |is: bool| if is { "auto" } else { "?" };
    let (ksvd, omp, denoise) = (Ksvd::default(), Omp::default(), Denoise::default());
    let (open, settings) = (OpenOptions::default(), Settings::default());
    let audit = posing::audit::Limits::default();
    let mut all: BTreeMap<_, String> = [
        (("audit", "--max-gap"), audit.gap.to_string()),
        (("audit", "--max-missing"), audit.missing.to_string()),
        (("audit", "--max-speed"), (audit.speed / 100.0).to_string()),
        (("audit", "--max-jump"), audit.jump.to_string()),
        (("audit", "--max-drift"), audit.drift.to_string()),
        (
            ("cluster", "--restarts"),
            KMeans::default().restarts.to_string(),
        ),
        (("cluster", "--seed"), KMeans::default().seed.to_string()),
        (
            ("corrupt", "--seed"),
            Corruption::default().seed.to_string(),
        ),
        (
            ("corrupt", "--share"),
            Corruption::default().share.to_string(),
        ),
        (("denoise", "--noise"), auto(denoise.noise.is_none()).into()),
        (("denoise", "--outliers"), auto(denoise.outliers).into()),
        (("encode", "--pursuit"), rule(omp.rule).into()),
        (("encode", "--sparsity"), omp.sparsity.to_string()),
        (("evaluate", "--frames"), settings.frames.to_string()),
        (("evaluate", "--seed"), settings.first_seed.to_string()),
        (("evaluate", "--seeds"), settings.seeds.to_string()),
        (("ksvd-train", "--iterations"), ksvd.iterations.to_string()),
        (("ksvd-train", "--pursuit"), rule(ksvd.rule).into()),
        (("ksvd-train", "--seed"), ksvd.seed.to_string()),
        (("ksvd-train", "--sparsity"), ksvd.sparsity.to_string()),
        (
            ("plot", "--elevation"),
            figure::Options::default().elevation.to_string(),
        ),
        (
            ("prior-train", "--leaves"),
            TrainSettings::default().max_exemplars.to_string(),
        ),
        (
            ("prior-train", "--seed"),
            TrainOptions::default().seed.to_string(),
        ),
    ]
    .into_iter()
    .collect();
    for command in ["complete", "denoise"] {
        let sparsity = auto(open.sparsity.is_none());
        all.insert((command, "--sparsity"), sparsity.into());
    }
    all
}

/// The defaults in a command's help: of each flag the word after "default:".
fn stated(command_name: &str) -> BTreeMap<String, String> {
    let done = command(command_name).arg("--help").assert().success();
    let help = String::from_utf8(done.get_output().stdout.clone()).unwrap();
    // A flag's entry begins a line, its text stands further to the right and may be folded.
    let mut words: Vec<(&str, &str)> = Vec::new();
    let mut flag = "";
    for line in help.lines() {
        let text = line.trim_start();
        if text.starts_with('-') && line.len() - text.len() <= 6 {
            flag = text
                .split_whitespace()
                .find(|w| w.starts_with("--"))
                .unwrap_or("");
        }
        words.extend(text.split_whitespace().map(|word| (flag, word)));
    }
    let mut found = BTreeMap::new();
    for pair in words.windows(2) {
        if ["(default:", "[default:"].contains(&pair[0].1) {
            let value = pair[1].1.trim_end_matches([')', ']', ';', ',']);
            found.insert(pair[0].0.to_string(), value.to_string());
        }
    }
    found
}

#[test]
fn the_default_of_every_flag_is_that_of_the_library() {
    let library = library();
    let commands: std::collections::BTreeSet<&str> = library.keys().map(|(c, _)| *c).collect();
    for command in commands {
        let stated = stated(command);
        for ((_, flag), want) in library.iter().filter(|((c, _), _)| *c == command) {
            assert_eq!(stated.get(*flag), Some(want), "{command} {flag}");
        }
    }
}

#[test]
fn a_number_that_help_gives_as_a_default_is_compared() {
    // A new flag with a number for a default must be added to `library`, unless it counts what the
    // library does not know.
    let command_only = [("corrupt", "--points"), ("evaluate", "--base")];
    let library = library();
    for command in [
        "amc2xyz",
        "audit",
        "bvh2xyz",
        "c3d2xyz",
        "cluster",
        "complete",
        "corrupt",
        "csv2xyz",
        "decode",
        "denoise",
        "dict-concat",
        "encode",
        "evaluate",
        "ksvd-train",
        "plot",
        "prior-train",
        "score",
        "trc2xyz",
        "trim",
        "xyz2amc",
        "xyz2bvh",
        "xyz2c3d",
        "xyz2trc",
    ] {
        for (flag, value) in stated(command) {
            let is_known = library.keys().any(|(c, f)| *c == command && *f == flag)
                || command_only.contains(&(command, &flag));
            let is_number = value.parse::<f64>().is_ok();
            assert!(
                !is_number || is_known || flag == "--joints",
                "{command} {flag} {value}"
            );
        }
    }
}
