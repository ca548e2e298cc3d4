//! `evaluate` around the library: its flags and TOML file, its tables and models, the cache of
//! results, the progress bar.

use super::{stem, write};
use clap::Args;
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::toml_file;
use posing::cli::{input, messages};
use posing::evaluate::benchmark::leakage::Provenance;
use posing::evaluate::benchmark::method::{ModelSource, PretrainedModel};
use posing::evaluate::benchmark::result::Case;
use posing::evaluate::benchmark::result_cache::{self, ResultCache};
use posing::evaluate::benchmark::runner::{Event, Results};
use posing::evaluate::benchmark::{
    Benchmark, BenchmarkResult, Method, Settings, Shard, Split, Task,
};
use posing::evaluate::report::BenchmarkReport;
use posing::evaluate::report::paper::{Comparison, FinishedRun};
use posing::pose::units::parse_length;
use posing::prior::provenance::hex;
use posing::prior::{self, OpenOptions};
use posing::{Error, Place, Result};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// No results.json is larger.
const LARGEST_RESULTS: u64 = 1 << 30;

/// What is run: flags of `evaluate`, or the keys of its TOML file.
#[derive(Debug, Clone, Default, PartialEq, Args, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BenchmarkArgs {
    /// Comma-separated models to train: kinds of prior-train, and ksvd and ksvd-omp, K-SVD as
    /// published; a dictionary takes :n=ATOMS and :k=SPARSITY (default: all)
    #[arg(long, value_name = "LIST", value_parser = list)]
    pub models: Option<::std::vec::Vec<String>>,
    /// Trained model to test as it is; may be repeated
    #[arg(short = 'm', long = "model", value_name = "MODEL.npz")]
    pub model_files: Vec<PathBuf>,
    /// Comma-separated tasks: dense, sparse, complete (default: all)
    #[arg(long, value_name = "LIST", value_parser = list)]
    pub tasks: Option<::std::vec::Vec<String>>,
    /// Comma-separated splits: frames, takes, subjects (default: all that the takes allow)
    #[arg(long, value_name = "LIST", value_parser = list)]
    pub splits: Option<::std::vec::Vec<String>>,
    /// Number of seeds; each has its own split, training and damage (default: 5)
    #[arg(long, value_name = "N")]
    pub seeds: Option<u64>,
    /// First seed (default: 0)
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Largest number of test frames per split, and of training frames that are scored (default:
    /// 800)
    #[arg(long, value_name = "N")]
    pub frames: Option<usize>,
    /// Comma-separated standard deviations of extra noise on every clean coordinate, in cm or with
    /// a unit (default: 0)
    #[arg(long, value_name = "LIST", value_parser = lengths)]
    #[serde(deserialize_with = "lengths_of_file")]
    pub base: Option<::std::vec::Vec<f64>>,
    /// Comma-separated joints that are visible in the task complete (default: Lai et al.'s six)
    #[arg(long, value_name = "LIST", value_parser = list)]
    pub observe: Option<::std::vec::Vec<String>>,
    /// Write results.csv, results.json, report.html and times.csv into DIR, and cache finished
    /// results there
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    pub output: Option<OutputPath>,
    /// Tables of poses; in the file only.
    #[arg(skip)]
    pub tables: Vec<PathBuf>,
    /// The subject of a take, where the take's name does not begin with it; in the file only.
    #[arg(skip)]
    pub subjects: BTreeMap<String, String>,
}

impl BenchmarkArgs {
    /// These flags, and what the TOML file says where a flag is absent. The file's paths are
    /// relative to its folder.
    ///
    /// # Errors
    /// [`Error::Data`] with file and line, also for an unknown key; also if the file cannot be
    /// read.
    pub fn or_file(self, path: Option<&Path>) -> Result<BenchmarkArgs> {
        let Some(path) = path else {
            return Ok(self);
        };
        let (file, _): (BenchmarkArgs, String) = toml_file::read(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let within = |names: Vec<PathBuf>| names.iter().map(|name| folder.join(name)).collect();
        Ok(BenchmarkArgs {
            models: self.models.or(file.models),
            model_files: if self.model_files.is_empty() {
                within(file.model_files)
            } else {
                self.model_files
            },
            tasks: self.tasks.or(file.tasks),
            splits: self.splits.or(file.splits),
            seeds: self.seeds.or(file.seeds),
            seed: self.seed.or(file.seed),
            frames: self.frames.or(file.frames),
            base: self.base.or(file.base),
            observe: self.observe.or(file.observe),
            output: self
                .output
                .or(file.output.map(|name| folder.join(&*name).into())),
            tables: within(file.tables),
            subjects: file.subjects,
        })
    }

    /// The settings of the run; reads the model files.
    ///
    /// # Errors
    /// [`Error::Usage`] for an unknown name or a file that cannot be read.
    pub fn settings(&self) -> Result<Settings> {
        // Model files without names of models are compared alone.
        let named = match &self.models {
            Some(named) => named.clone(),
            None if !self.model_files.is_empty() => Vec::new(),
            None => Method::default_names(),
        };
        let named = named.iter().map(|n| Method::parse(n));
        let methods = named.chain(self.model_files.iter().map(|f| pretrained(f)));
        let tasks = self.tasks.iter().flatten().map(|t| Task::parse(t));
        let tasks: Vec<Task> = tasks.collect::<Result<_>>()?;
        let splits = self.splits.iter().flatten().map(|s| Split::parse(s));
        let default = Settings::default();
        Ok(Settings {
            methods: methods.collect::<Result<_>>()?,
            tasks: if tasks.is_empty() {
                default.tasks
            } else {
                tasks
            },
            splits: splits.collect::<Result<_>>()?,
            seeds: self.seeds.unwrap_or(default.seeds),
            first_seed: self.seed.unwrap_or(default.first_seed),
            frames: self.frames.unwrap_or(default.frames),
            base: self.base.clone().unwrap_or(default.base),
            observe: self.observe.clone().unwrap_or(default.observe),
            examples: self.output.is_some(),
        })
    }
}

/// Lengths in a TOML file, cm: `"0.05asf"`, or a number of centimeters.
fn lengths_of_file<'de, D: Deserializer<'de>>(
    file: D,
) -> std::result::Result<Option<Vec<f64>>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Length {
        Number(f64),
        Text(String),
    }
    let parse = |length: Length| match length {
        Length::Number(v) => Ok(v),
        Length::Text(t) => parse_length(&t).map_err(|e| D::Error::custom(format!("\"{t}\": {e}"))),
    };
    Vec::<Length>::deserialize(file)?
        .into_iter()
        .map(parse)
        .collect::<std::result::Result<_, _>>()
        .map(Some)
}

/// A model file as a method.
fn pretrained(path: &Path) -> Result<Method> {
    let model = input::open_model(path)?;
    let source = path.display().to_string();
    if model.meta.space != "body" {
        let what = "is a model in world space; evaluate compares models in body space (train it \
                    with --space body)";
        return Err(Error::data(Place::file(&source), what));
    }
    let choice = OpenOptions::default();
    let width = 3 * model.meta.points.len();
    let arrays = model
        .arrays()
        .map(|(_, a)| a)
        .filter(|a| a.ncols() == width);
    let history = model.meta.history.iter();
    let provenance = Provenance {
        digests: history.flat_map(|e| e.inputs.clone()).collect(),
        poses: arrays.map(|a| a.floats().into_owned()).collect(),
    };
    if provenance.digests.is_empty() {
        messages::info(&format!(
            "{source}: has no digests of its training data; overlap with test takes is detected \
             only from poses it stores"
        ));
    }
    let pretrained = PretrainedModel {
        digest: hex(&Sha256::digest(model.to_bytes()?)),
        prior: Arc::from(prior::open(&model, &choice, &source)?),
        source,
        points: model.meta.points.clone(),
        tuning: model.meta.details.get("tuning").cloned(),
        provenance,
    };
    Ok(Method {
        name: stem(path),
        source: ModelSource::Pretrained(pretrained),
        choice,
        treated: false,
    })
}

/// Runs the benchmark with a progress bar; finished results go to the cache.
///
/// # Errors
/// Errors of [`Benchmark::run`]; when the cache cannot be written.
pub fn run(bench: &Benchmark<'_>, cache: Option<ResultCache>) -> Result<Vec<BenchmarkResult>> {
    bench.in_order(run_cases(bench, &bench.cases(), cache)?)
}

/// Runs a share of the cases; the results go to the cache alone.
///
/// # Errors
/// Errors of [`run`].
pub fn run_shard(bench: &Benchmark<'_>, shard: Shard, cache: ResultCache) -> Result<()> {
    let cases = bench.cases_of(shard);
    if cases.is_empty() {
        messages::info(
            "nothing to run in this share: there are more shares than models, splits and seeds to \
             train",
        );
    }
    run_cases(bench, &cases, Some(cache))?;
    Ok(())
}

/// Adds the results of other folders to a cache, which has those of all cases then.
///
/// # Errors
/// Errors of [`Benchmark::merge`]; when a folder cannot be read, or a case has no result.
pub fn merge(bench: &Benchmark<'_>, folders: &[PathBuf], cache: &mut ResultCache) -> Result<()> {
    let runs = folders.iter().map(|folder| result_cache::read(folder));
    let (merged, foreign) = bench.merge(runs.collect::<Result<_>>()?)?;
    if foreign > 0 {
        messages::info(&format!(
            "left out {foreign} results of other takes, other settings or another version"
        ));
    }
    cache.add(merged)?;
    let cases = bench.cases();
    let missing = bench.missing(&cases, cache.results());
    let Some(first) = missing.first() else {
        return Ok(());
    };
    let what = format!(
        "{} of {} results are missing, the first {}; name the folders of all --cells, each run to \
         its end",
        missing.len(),
        cases.len(),
        first.describe()
    );
    Err(Error::data(Place::file("--merge"), what))
}

/// Runs some cases with a progress bar.
fn run_cases(
    bench: &Benchmark<'_>,
    cases: &[Case],
    mut cache: Option<ResultCache>,
) -> Result<Results> {
    let cached = cache.as_mut().map(ResultCache::take).unwrap_or_default();
    let total = cases.len();
    let mut done = total - bench.missing(cases, &cached).len();
    if done > 0 {
        messages::info(&format!("{done} of {total} results found in the cache"));
    }
    let bar = Progress::new("evaluate", total as u64);
    bar.set(done as u64);
    bench.run_cases(cases, cached, &mut |event| {
        match event {
            Event::Training { model, split, seed } => {
                let words = format!("{model}, {} {seed}", split.name());
                messages::debug(&format!("training {words}"));
                bar.set_message(words);
            }
            Event::Result { key, result } => {
                done += 1;
                bar.set(done as u64);
                if let Some(cache) = &mut cache {
                    cache.append(key, result)?;
                }
            }
        }
        Ok(())
    })
}

/// Reports which frames and splits are left out, and which takes stay together.
pub fn report_exclusions(bench: &Benchmark) {
    let data = bench.dataset;
    if data.incomplete > 0 {
        messages::info(&format!(
            "{} frames skipped: missing points",
            data.incomplete
        ));
    }
    for twin in &bench.duplicates {
        messages::info(&format!(
            "{} stays on the same side of every split",
            twin.describe(data)
        ));
    }
    for what in &bench.skipped_splits {
        messages::info(&format!("left out: {what}"));
    }
}

/// Writes the tables and the page of a benchmark into a folder.
///
/// # Errors
/// When a file cannot be made or written.
pub fn write_results(folder: &Path, report: &BenchmarkReport) -> Result<()> {
    let files = [
        ("results.csv", report.csv()),
        ("results.json", report.json()?),
        ("times.csv", report.times()),
        ("report.html", report.html()?),
    ];
    write(folder, &files)
}

/// Writes Lai et al.'s tables beside what the finished runs measured.
///
/// # Errors
/// When a run cannot be read, or a file cannot be written.
pub fn write_paper_tables(runs: &[PathBuf], folder: &Path) -> Result<()> {
    let read = |folder: &PathBuf| {
        let input = input::open(&folder.join("results.json"))?;
        let source = input.name.clone();
        let bytes = input.read_all(LARGEST_RESULTS)?;
        let name = folder.file_name().map(|n| n.to_string_lossy().into_owned());
        FinishedRun::parse(&bytes, &name.unwrap_or_else(|| ".".into()), &source)
    };
    let runs: Vec<FinishedRun> = runs.iter().map(read).collect::<Result<_>>()?;
    let comparison = Comparison::new(&runs)?;
    let files = [
        ("tables.csv", comparison.csv()),
        ("tables.html", comparison.html()),
    ];
    write(folder, &files)
}

/// Reads a comma-separated list.
fn list(text: &str) -> std::result::Result<Vec<String>, String> {
    let names: Vec<String> = text.split(',').map(|n| n.trim().to_string()).collect();
    if names.iter().any(String::is_empty) {
        Err("expected names with commas between them".into())
    } else {
        Ok(names)
    }
}

/// Reads a comma-separated list of lengths, cm.
fn lengths(text: &str) -> Result<Vec<f64>> {
    text.split(',').map(|t| parse_length(t.trim())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_parsed() {
        let text = "tables = [\"01.csv\"]\n\
            models = [\"sparse\", \"ksvd:n=500\"]\n\
            seeds = 3\n\
            base = [0, \"0.05asf\"]\n\
            [subjects]\nwalk = \"anna\"\n";
        let config = toml_file::parse::<BenchmarkArgs>(text, "x.toml").unwrap();
        assert_eq!(config.seeds, Some(3));
        assert_eq!(
            config.base,
            Some(vec![0.0, parse_length("0.05asf").unwrap()])
        );
        assert_eq!(config.subjects["walk"], "anna");
        assert_eq!(
            toml_file::parse::<BenchmarkArgs>("", "x").unwrap(),
            BenchmarkArgs::default()
        );
    }

    #[test]
    fn unknown_keys_and_wrong_values_are_refused_with_file_and_line() {
        for (text, line, part) in [
            ("seeds = 3\nsplit = [\"takes\"]\n", 2, "split"),
            ("\n\nseeds = \"x\"\n", 3, "u64"),
            ("seeds = 1\nseeds = 2\n", 2, "duplicate"),
            ("seeds = \n", 1, ""),
            ("[more]\nx = 1", 1, "more"),
        ] {
            let e = toml_file::parse::<BenchmarkArgs>(text, "x.toml").unwrap_err();
            let said = e.to_string();
            assert!(said.starts_with(&format!("x.toml:{line}: ")), "{said}");
            assert!(said.contains(part) && said.lines().count() == 1, "{said}");
            assert_eq!(e.exit_code(), 1);
        }
    }
}
