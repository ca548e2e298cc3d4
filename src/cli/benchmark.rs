//! What `evaluate` does around the library: flags and TOML file in one, tables and models, the work file, the bar.

use super::args::{InputArgs, parse_length};
use super::progress::Progress;
use super::{input, messages};
use crate::evaluate::benchmark::config::Length;
use crate::evaluate::benchmark::dataset::SourceTable;
use crate::evaluate::benchmark::examples::ExampleSet;
use crate::evaluate::benchmark::leakage::Provenance;
use crate::evaluate::benchmark::method::{ModelSource, PretrainedModel};
use crate::evaluate::benchmark::runner::{CachedResults, Event};
use crate::evaluate::benchmark::{
    Benchmark, BenchmarkResult, Config, Method, Settings, Split, Task,
};
use crate::evaluate::report::BenchmarkReport;
use crate::evaluate::report::paper::{Comparison, FinishedRun};
use crate::prior;
use crate::prior::provenance::hex;
use crate::{Error, Place, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// No results.json is larger.
const LARGEST_RESULTS: u64 = 1 << 30;
/// No TOML file is larger.
const LARGEST_CONFIG: u64 = 1 << 20;

/// What was asked for by flags; each that is absent is what the TOML file says, else the default.
#[derive(Debug, Default)]
pub struct BenchmarkArgs {
    /// `--models`
    pub models: Option<Vec<String>>,
    /// `-m`
    pub files: Vec<PathBuf>,
    /// `--tasks`
    pub tasks: Option<Vec<String>>,
    /// `--splits`
    pub splits: Option<Vec<String>>,
    /// `--seeds`
    pub seeds: Option<u64>,
    /// `--seed`
    pub seed: Option<u64>,
    /// `--frames`
    pub frames: Option<usize>,
    /// `--base`, cm
    pub base: Option<Vec<f64>>,
    /// `--observe`
    pub observe: Option<Vec<String>>,
    /// `-o`
    pub output: Option<PathBuf>,
}

/// What is to be done.
pub struct BenchmarkPlan {
    /// The settings.
    pub settings: Settings,
    /// Tables to read.
    pub tables: Vec<PathBuf>,
    /// Whose each take is, where its name does not say.
    pub subjects: BTreeMap<String, String>,
    /// Where results go.
    pub output: Option<PathBuf>,
}

/// Joins flags, tables and the TOML file.
pub fn plan(
    asked: BenchmarkArgs,
    tables: Vec<PathBuf>,
    config: Option<&Path>,
) -> Result<BenchmarkPlan> {
    let (file, folder) = match config {
        Some(path) => (read_config(path)?, path.parent().unwrap_or(Path::new(""))),
        None => (Config::default(), Path::new("")),
    };
    let place = |name: &String| folder.join(name);
    let usual = Settings::default();
    let named = asked.models.or(file.models);
    let mut models = asked.files;
    if models.is_empty() {
        models.extend(file.model_files.iter().flatten().map(place));
    }
    // Where files are given and nothing is named, they alone are compared.
    let named = match named {
        Some(named) => named,
        None if !models.is_empty() => Vec::new(),
        None => Method::default_names(),
    };
    let mut methods: Vec<Method> = named
        .iter()
        .map(|n| Method::parse(n))
        .collect::<Result<_>>()?;
    for path in &models {
        methods.push(given(path)?);
    }
    let list = |names: Option<Vec<String>>| names.unwrap_or_default();
    let tasks = list(asked.tasks.or(file.tasks));
    let tasks: Vec<Task> = tasks
        .iter()
        .map(|t| Task::parse(t))
        .collect::<Result<_>>()?;
    let splits = list(asked.splits.or(file.splits));
    let base = match (asked.base, file.base) {
        (Some(base), _) => base,
        (None, Some(base)) => base.iter().map(length).collect::<Result<_>>()?,
        (None, None) => usual.base,
    };
    let tables = match tables.is_empty() {
        true => file.tables.iter().flatten().map(place).collect(),
        false => tables,
    };
    let output = asked.output.or(file.output.as_ref().map(place));
    Ok(BenchmarkPlan {
        settings: Settings {
            methods,
            tasks: if tasks.is_empty() { usual.tasks } else { tasks },
            splits: splits
                .iter()
                .map(|s| Split::parse(s))
                .collect::<Result<_>>()?,
            seeds: asked.seeds.or(file.seeds).unwrap_or(usual.seeds),
            first_seed: asked.seed.or(file.seed).unwrap_or(usual.first_seed),
            frames: asked.frames.or(file.frames).unwrap_or(usual.frames),
            base,
            observe: asked.observe.or(file.observe).unwrap_or(usual.observe),
            examples: output.is_some(),
        },
        tables,
        subjects: file.subjects,
        output,
    })
}

fn read_config(path: &Path) -> Result<Config> {
    let input = input::open(path)?;
    let name = input.name.clone();
    let bytes = input.read_all(LARGEST_CONFIG)?;
    let text = String::from_utf8(bytes)
        .map_err(|_| Error::data(Place::file(&name), "is not a TOML file: it is not UTF-8"))?;
    Config::parse(&text, &name)
}

/// A length of the TOML file, cm.
fn length(length: &Length) -> Result<f64> {
    match length {
        Length::Number(v) => Ok(*v),
        Length::Text(t) => parse_length(t).map_err(|e| Error::usage(format!("base \"{t}\": {e}"))),
    }
}

/// The name of a file without folder and last extension.
fn stem(path: &Path) -> String {
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
    stem.unwrap_or_else(|| "model".into())
}

/// A model file as a method.
fn given(path: &Path) -> Result<Method> {
    let model = input::open_model(path)?;
    let source = path.display().to_string();
    if model.meta.space != "body" {
        let what = "is a model in world space; evaluate compares models in body space (train it with --space body)";
        return Err(Error::data(Place::file(&source), what));
    }
    let choice = prior::OpenOptions::default();
    let prior = Arc::from(prior::open(&model, &choice, &source)?);
    let width = 3 * model.meta.points.len();
    let history = model.meta.history.iter();
    let provenance = Provenance {
        digests: history.flat_map(|e| e.inputs.clone()).collect(),
        poses: (model.arrays().map(|(_, a)| a))
            .filter(|a| a.ncols() == width)
            .map(|a| a.floats().into_owned())
            .collect(),
    };
    if provenance.digests.is_empty() {
        messages::info(&format!(
            "{source}: has no digests of its training data; overlap with test takes is detected only from poses it stores"
        ));
    }
    Ok(Method {
        name: stem(path),
        source: ModelSource::Pretrained(PretrainedModel {
            digest: hex(&Sha256::digest(model.to_bytes()?)),
            source,
            prior,
            points: model.meta.points.clone(),
            tuning: model.meta.details.get("tuning").cloned(),
            provenance,
        }),
        choice,
        treated: false,
    })
}

/// Reads the tables, each by itself.
pub fn sources(flags: &InputArgs, tables: &[PathBuf]) -> Result<Vec<SourceTable>> {
    input::check_single_stdin(tables)?;
    let standard_input = [PathBuf::from("-")];
    let tables = if tables.is_empty() {
        &standard_input
    } else {
        tables
    };
    let read = |path: &PathBuf| {
        let one = InputArgs {
            files: vec![path.clone()],
            ..flags.clone()
        };
        let table = input::read_table(&one, false, false)?;
        Ok(SourceTable {
            name: table.name,
            label: stem(path),
            poses: table.poses,
        })
    };
    tables.iter().map(read).collect()
}

/// A line of a work file.
#[derive(Serialize, Deserialize)]
struct CacheLine<T> {
    key: String,
    #[serde(alias = "cell")]
    done: T,
}

/// A file that finished things are kept in, a line of JSON each.
struct CacheFile {
    path: PathBuf,
    file: File,
}

impl CacheFile {
    /// Opens it, or starts it; `fresh` forgets what it holds. A last line that a kill has cut off is taken away.
    ///
    /// # Errors
    /// A line that is not what it should be, with its number.
    fn open<T: DeserializeOwned>(
        path: PathBuf,
        fresh: bool,
    ) -> Result<(CacheFile, BTreeMap<String, T>)> {
        let fail = |e| Error::io(&path, e);
        let text = match fs::read(&path) {
            Ok(bytes) if !fresh => bytes,
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(fail(e)),
            _ => Vec::new(),
        };
        let whole = text
            .iter()
            .rposition(|b| *b == b'\n')
            .map_or(0, |at| at + 1);
        let mut finished = BTreeMap::new();
        let lines = text[..whole].split(|b| *b == b'\n');
        for (i, line) in lines.enumerate().filter(|(_, l)| !l.is_empty()) {
            let line: CacheLine<T> = serde_json::from_slice(line).map_err(|e| {
                let name = path.display().to_string();
                let what = format!("is not a cached result ({e}); remove the file, or use --fresh");
                Error::data(Place::line(name, i as u64 + 1), what)
            })?;
            finished.insert(line.key, line.done);
        }
        let mut options = OpenOptions::new();
        let file = options
            .create(true)
            .append(true)
            .open(&path)
            .map_err(fail)?;
        file.set_len(whole as u64).map_err(fail)?;
        Ok((CacheFile { path, file }, finished))
    }

    fn keep<T: Serialize>(&mut self, key: &str, done: &T) -> Result<()> {
        let key = key.into();
        let line = serde_json::to_vec(&CacheLine { key, done });
        let mut text = line.map_err(|e| Error::usage(e.to_string()))?;
        text.push(b'\n');
        let write = self.file.write_all(&text);
        write.map_err(|e| Error::io(&self.path, e))
    }
}

/// What a run keeps in its folder, so that the next one goes on from there.
pub struct ResultCache {
    cells: CacheFile,
    examples: CacheFile,
    finished: CachedResults,
}

impl ResultCache {
    /// Opens `cells.jsonl` and `examples.jsonl` in a folder, which is made where it is absent; `fresh` forgets what they
    /// hold.
    ///
    /// # Errors
    /// A line that is not what it should be, with its number.
    pub fn open(folder: &Path, fresh: bool) -> Result<ResultCache> {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let (cells, done) = CacheFile::open(folder.join("cells.jsonl"), fresh)?;
        let (examples, shown) = CacheFile::open(folder.join("examples.jsonl"), fresh)?;
        let finished = CachedResults {
            results: done,
            examples: shown,
        };
        Ok(ResultCache {
            cells,
            examples,
            finished,
        })
    }
}

/// Runs the bench with a bar; what is finished goes to the work files.
pub fn run(
    bench: &Benchmark<'_>,
    mut work: Option<ResultCache>,
) -> Result<(Vec<BenchmarkResult>, ExampleSet)> {
    let finished = work.as_mut().map(|w| std::mem::take(&mut w.finished));
    let finished = finished.unwrap_or_default();
    let total = bench.cases().len();
    let had = total - bench.remaining(&finished);
    if had > 0 {
        messages::info(&format!("{had} of {total} results found in the cache"));
    }
    let bar = Progress::new("evaluate", total as u64);
    bar.set(had as u64);
    let mut done = had as u64;
    bench.run(&finished, &mut |event| {
        match event {
            Event::Training { model, split, seed } => {
                let words = format!("{model}, {} {seed}", split.name());
                messages::debug(&format!("training {words}"));
                bar.set_message(words);
            }
            Event::Result { key, result } => {
                done += 1;
                bar.set(done);
                if let Some(work) = &mut work {
                    work.cells.keep(key, result)?;
                }
            }
            Event::Examples { key, examples } => {
                if let Some(work) = &mut work {
                    work.examples.keep(key, examples)?;
                }
            }
        }
        Ok(())
    })
}

/// Writes the results into a folder.
pub fn write(folder: &Path, files: &[(&str, String)]) -> Result<()> {
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    for (name, text) in files {
        crate::io::output::write_file(folder.join(name), text.as_bytes())?;
    }
    Ok(())
}

/// Reads the results of finished runs, each a folder that [`write()`] has written.
pub fn finished(folders: &[PathBuf]) -> Result<Vec<FinishedRun>> {
    let read = |folder: &PathBuf| {
        let path = folder.join("results.json");
        let input = input::open(&path)?;
        let source = input.name.clone();
        let bytes = input.read_all(LARGEST_RESULTS)?;
        let name = folder.file_name().map(|n| n.to_string_lossy().into_owned());
        FinishedRun::parse(&bytes, &name.unwrap_or_else(|| ".".into()), &source)
    };
    folders.iter().map(read).collect()
}

/// Says which frames and splits are left out, and which takes stay together.
pub fn report_exclusions(bench: &Benchmark, data: &crate::evaluate::benchmark::Dataset) {
    if data.incomplete > 0 {
        messages::info(&format!(
            "{} frames skipped: missing points",
            data.incomplete
        ));
    }
    for twin in bench.duplicates() {
        messages::info(&format!(
            "{} stays on the same side of every split",
            twin.describe(data)
        ));
    }
    for what in bench.skipped_splits() {
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

/// Writes the paper's tables beside what the finished runs measured.
///
/// # Errors
/// When a run cannot be read, or a file cannot be written.
pub fn write_paper_tables(runs: &[PathBuf], folder: &Path) -> Result<()> {
    let runs = finished(runs)?;
    let comparison = Comparison::new(&runs)?;
    let files = [
        ("tables.csv", comparison.csv()),
        ("tables.html", comparison.html()),
    ];
    write(folder, &files)
}

/// Reads a comma-separated list.
pub fn list(text: &str) -> std::result::Result<Vec<String>, String> {
    let names: Vec<String> = text.split(',').map(|n| n.trim().to_string()).collect();
    match names.iter().any(String::is_empty) {
        true => Err("expected names with commas between them".into()),
        false => Ok(names),
    }
}

/// Reads a comma-separated list of lengths, cm.
pub fn lengths(text: &str) -> std::result::Result<Vec<f64>, String> {
    text.split(',').map(|t| parse_length(t.trim())).collect()
}
