//! `denoise` and `complete` around the library: their flags, the model, whole takes or batches of
//! frames.

use super::args::{InputArgs, OutUnitArgs, OutputArgs, Space};
use super::choice::choice;
use super::input::{RowStream, check_single_stdin_with, open_model_or_builtin, read_table};
use super::json_report::JsonArgs;
use super::messages;
use super::motion_library::report_body_gaps;
use super::name_maps::name_map;
use super::progress::Progress;
use super::streams::{create_table, write_bytes, write_table};
use super::summary::{StatusColumns, report};
use crate::inbetween::{MotionLibrary, NO_BODY, knows_body};
use crate::io::text::excerpt;
use crate::io::{Cells, Columns, Model, PosesBuilder, Row, Table, TableFormat, deviations};
use crate::label::unlabeled::left_alone;
use crate::pose::computed::{computed_note, computed_points};
use crate::pose::{BonePoints, NameMap, PointNaming, Poses, Units, check_unit, joints};
use crate::prior::OpenOptions;
use crate::restore::body_size::check_body_size;
use crate::restore::gap_report::RestorationReport;
use crate::restore::{Complete, Denoise, Restoration, RestorationCounts, Restorer};
use crate::{Error, Result};
use clap::Args;
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Frames worked on at a time where each is answered by itself: enough for many threads, little
/// memory.
const BATCH: usize = 512;

/// Which model, and how it is used.
#[derive(Debug, Clone, Args)]
struct ModelFlags {
    /// Model file (default: the built-in model)
    #[arg(short, long, value_name = "MODEL.npz", help_heading = "Model")]
    model: Option<PathBuf>,
    /// Use no model: learn from the take's own frames alone. Takes any points
    #[arg(long = "self", conflicts_with_all = ["model", "per_frame"], help_heading = "Model")]
    take_alone: bool,
    /// For a dictionary: largest number of atoms per pose, 1 to 1000; auto: as in training
    #[arg(
        long,
        value_name = "K|auto",
        default_value = "auto",
        value_parser = parse_sparsity,
        help_heading = "Model"
    )]
    sparsity: Sparsity,
    /// Restore as published: by the sparse code or the posterior alone, without error model, rigid
    /// distances and outliers
    #[arg(long, help_heading = "Model")]
    published: bool,
}

/// How many atoms a pose.
#[derive(Debug, Clone, Copy)]
struct Sparsity(Option<usize>);

fn parse_sparsity(text: &str) -> std::result::Result<Sparsity, String> {
    match text.parse::<usize>() {
        _ if text == "auto" => Ok(Sparsity(None)),
        Ok(k) if (1..=1000).contains(&k) => Ok(Sparsity(Some(k))),
        _ => Err("expected a number of atoms from 1 to 1000, or auto".into()),
    }
}

/// Flags of `denoise` and `complete`.
#[derive(Debug, Clone, Args)]
pub struct RestoringArgs {
    /// The tables.
    #[command(flatten)]
    pub input: InputArgs,
    /// Add columns: NAME.status (observed, changed, inferred, rejected, unknown), NAME.sd
    /// (standard deviation, in the unit of the output) and NAME.method (how it was filled:
    /// regression, pchip, model, contact, motion) for each point; unlike for each frame (novelty of
    /// its pose in nats; 0: like the training poses)
    #[arg(long, help_heading = "Output")]
    status: bool,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    model: ModelFlags,
    /// Restore each frame by itself, without its neighbors, in constant memory
    #[arg(long)]
    pub per_frame: bool,
    /// Where points stand on the bones they are named after: starts, as the joints of BVH files,
    /// or ends, as the joints of CMU and of the built-in model (default: by names and lengths)
    #[arg(
        long,
        value_parser = choice::<BonePoints>(),
        value_name = "starts|ends",
        help_heading = "Input"
    )]
    bones: Option<BonePoints>,
    /// Which points of the table are which of the model's: a shipped map (anatomical,
    /// bandai-namco, biped, cmu-bvh, coco, h36m, halpe, hik, kinect, lafan, makehuman, mediapipe,
    /// mixamo, motive, neuron, openpose, plug-in-gait, poser, rokoko, smpl, unity, unreal), or a
    /// TOML file of lines such as lhumerus = "LeftForeArm", the model's point first (default: the
    /// names themselves, else the shipped map that fits best)
    #[arg(
        long,
        value_name = "NAME|FILE.toml",
        conflicts_with_all = ["bones", "take_alone"],
        help_heading = "Input"
    )]
    map: Option<String>,
    /// Go on with a body that is smaller or larger than people are
    #[arg(long, help_heading = "Input")]
    force: bool,
    /// Space of the table's poses
    #[arg(long, value_parser = choice::<Space>(), default_value = "world")]
    space: Space,
    #[command(flatten)]
    out: OutputArgs,
    #[command(flatten)]
    out_units: OutUnitArgs,
}

/// What is done to the poses.
#[derive(Debug, Clone)]
pub enum Task {
    /// Missing points are estimated, and a list of the gaps is written to a file.
    Complete {
        /// How.
        options: Complete,
        /// The file of the list.
        report: Option<PathBuf>,
        /// Motion that may fill gaps of a whole body.
        motion: Option<MotionLibrary>,
    },
    /// Noise and outliers are removed.
    Denoise(Denoise),
}

impl Task {
    fn name(&self) -> &'static str {
        match self {
            Task::Complete { .. } => "complete",
            Task::Denoise(_) => "denoise",
        }
    }

    /// Whether a table of 2-D points is accepted.
    fn planar(&self) -> bool {
        matches!(self, Task::Complete { .. })
    }

    fn max_gap(&self) -> Option<f64> {
        match self {
            Task::Complete { options, .. } => options.max_gap,
            Task::Denoise(_) => None,
        }
    }

    /// The file of the list of gaps.
    fn report(&self) -> Option<&Path> {
        match self {
            Task::Complete { report, .. } => report.as_deref(),
            Task::Denoise(_) => None,
        }
    }

    /// Checks the options against the points of the table.
    fn check(&self, points: &[String]) -> Result<()> {
        match self {
            Task::Complete { options, .. } => options.check(points),
            Task::Denoise(_) => Ok(()),
        }
    }

    /// Says that the next command will not know how sure denoised points are.
    fn tell_what_is_lost(&self, told: &StatusColumns, counts: &RestorationCounts) {
        if matches!(self, Task::Denoise(_)) && told.added.is_empty() && counts.unfilled > 0 {
            messages::info(
                "complete will take these values for exact: --status passes their uncertainty on",
            );
        }
    }

    /// Restores a table; `progress` is called with the number of frames finished since its last
    /// call.
    fn restore<'t>(
        &self,
        restorer: &Restorer<'_>,
        table: &'t Table,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Restoration<'t>> {
        match self {
            Task::Complete { options, .. } => restorer.complete_with(table, options, progress),
            Task::Denoise(options) => restorer.denoise_with(table, options, progress),
        }
    }
}

/// Restores the tables that the flags name.
pub fn restore(args: &RestoringArgs, task: &Task) -> Result<()> {
    check_single_stdin_with(&args.input, &args.model.model)?;
    args.json.prepare(args.out.output.as_deref())?;
    let listed = task.report();
    let as_json = listed.filter(|path| path.extension().is_some_and(|e| e == "json"));
    let as_json = as_json.map(JsonArgs::to_file);
    if let Some(json) = &as_json {
        json.prepare(None)?;
    }
    let restored = match (args.per_frame, task.max_gap()) {
        (true, Some(_)) => {
            let what = "--max-gap needs times and cannot be used with --per-frame";
            return Err(Error::usage(what));
        }
        (true, None) if task.report().is_some() => {
            let what = "--report lists gaps in time and cannot be used with --per-frame";
            return Err(Error::usage(what));
        }
        (true, None) => RestorationReport::of_counts(frame_by_frame(args, task)?),
        (false, _) => take_by_take(args, task)?,
    };
    let left = match task {
        Task::Complete { .. } => "keep empty cells: too little is known there",
        Task::Denoise(_) => "are left unchanged by the model: too little is seen there",
    };
    let counts = restored.counts();
    report(counts, left, args.status, task.max_gap().is_some());
    match (listed, as_json) {
        (_, Some(json)) => json.write(&restored)?,
        (Some(path), None) => write_bytes(Some(path), restored.text().as_bytes(), false)?,
        (None, None) => {}
    }
    args.json.write(&restored)
}

/// Restores a whole table, and shows progress.
fn take_by_take(args: &RestoringArgs, task: &Task) -> Result<RestorationReport> {
    let table = read_table(&args.input, task.planar(), true)?;
    task.check(&table.columns.points)?;
    let units = args.units();
    let told = args.told(&table.columns, &table.cells);
    args.out.format().check_added(&told.added)?;
    let model = args.model.open()?;
    let naming = args.naming(&table.poses, model.as_ref())?;
    let mut restorer = args.restorer(model.as_ref(), &table, &naming)?;
    if let Task::Complete {
        motion: Some(library),
        ..
    } = task
    {
        restorer = restorer.with_motion(library);
        if !knows_body(&naming.model_names(&table.poses.points)) {
            messages::info(NO_BODY);
        }
    }
    if args.input.rate(&table.poses)?.is_none() {
        let lack = match table.poses.time {
            Some(_) => "the table's times give no frame rate",
            None => "the table has no time",
        };
        if let Task::Complete {
            motion: Some(_), ..
        } = task
        {
            let what = format!("--prior needs a frame rate, but {lack}; give it with --fps");
            return Err(Error::usage(what));
        }
        if task.max_gap().is_some() {
            let what = format!("--max-gap needs a frame rate, but {lack}; give it with --fps");
            return Err(Error::usage(what));
        }
        messages::info(&format!(
            "{lack}: restoring each frame by itself (--fps sets the frame rate)"
        ));
    }
    let computed = match args.input.rate(&table.poses)? {
        Some(_) => computed_points(&table.poses),
        None => Vec::new(),
    };
    let points = &table.poses.points;
    let computed: Vec<&str> = computed.iter().map(|p| points[*p].as_str()).collect();
    let aside = left_alone(&table.columns.points).into_iter();
    for what in aside.chain(computed_note(&computed)) {
        messages::info(&what);
    }
    let bar = Progress::new(task.name(), table.poses.frames() as u64);
    let finished = AtomicU64::new(0);
    let progress = |n: usize| bar.set(finished.fetch_add(n as u64, Ordering::Relaxed) + n as u64);
    let restored = task.restore(&restorer, &table, &progress)?;
    drop(bar);
    let report = RestorationReport::of(&restored);
    report_body_gaps(restored.body_gaps());
    task.tell_what_is_lost(&told, report.counts());
    write_table(&args.out, units, &table, restored.xyz(), &told.added, |t| {
        told.cells(&restored, t)
    })?;
    Ok(report)
}

/// Restores frames in batches as they come: constant memory.
fn frame_by_frame(args: &RestoringArgs, task: &Task) -> Result<RestorationCounts> {
    let mut stream = RowStream::open(&args.input, task.planar(), true)?;
    let columns = stream.columns().clone();
    task.check(&columns.points)?;
    let model = args.model.open()?;
    let (mut restorer, mut naming) = (None, None);
    let units = args.units();
    // Whose the columns are is told by the first rows.
    let maybe = args.told(&columns, &[]);
    let told_in = (!maybe.added.is_empty()).then(|| units[0].unit.centimeters());
    let mut written = None;
    let mut counts = RestorationCounts::default();
    for batch in 0.. {
        let (mut rows, table) = next_batch(&mut stream, told_in)?;
        if rows.is_empty() && batch > 0 {
            break;
        }
        let (told, sink) = match &mut written {
            Some(written) => written,
            None => {
                let told = args.told(&columns, &table.cells);
                let sink = create_table(&args.out, units, &columns, &told.added)?;
                written.insert((told, sink))
            }
        };
        if batch == 0 {
            // The last batch may be a few frames, whose rounded times may seem to contradict the
            // rate.
            args.input.rate(&table.poses)?;
        }
        // Frames in which nothing is seen tell nothing of where points stand.
        let is_seen = table.poses.xyz.iter().any(|v| v.is_finite());
        let own = match &restorer {
            Some(_) => None,
            None => {
                let of = naming.insert(args.naming(&table.poses, model.as_ref())?);
                Some(args.restorer(model.as_ref(), &table, of)?)
            }
        };
        if let (Some(_), Some(naming), false) = (&restorer, &naming, args.force) {
            args.check_body(&table, naming)?;
        }
        let Some(current) = own.as_ref().or(restorer.as_ref()) else {
            break;
        };
        let restored = task.restore(current, &table, &|_| ())?;
        if is_seen {
            restorer = own.or(restorer);
        }
        counts.add(restored.counts());
        for (t, row) in rows.iter_mut().enumerate() {
            let cells = told.cells(&restored, t);
            sink.write(row, &restored.xyz().row(t).to_vec(), &cells)?;
        }
    }
    if let Some((told, sink)) = written {
        sink.finish()?;
        task.tell_what_is_lost(&told, &counts);
    }
    Ok(counts)
}

/// The next frames of a stream, as they were read and as a table; none at its end. The table has
/// what columns tell of points, whose unit is `told_in` centimeters; `None`: nothing is told.
fn next_batch(stream: &mut RowStream<'_>, told_in: Option<f64>) -> Result<(Vec<Row>, Table)> {
    let mut rows = Vec::with_capacity(BATCH);
    let mut row = Row::default();
    while rows.len() < BATCH && stream.read(&mut row)? {
        rows.push(std::mem::take(&mut row));
    }
    let columns = stream.columns().clone();
    let mut builder = PosesBuilder::new(&columns);
    rows.iter().for_each(|row| builder.push(row));
    let cells: Vec<Cells> = match told_in {
        Some(_) => rows.iter().map(|row| row.cells.clone()).collect(),
        None => Vec::new(),
    };
    let table = Table {
        name: stream.name().to_string(),
        poses: builder.finish(),
        sd: deviations(&columns, &cells, told_in.unwrap_or(1.0)),
        columns,
        cells,
    };
    Ok((rows, table))
}

impl ModelFlags {
    /// The model that the flags name, and its name in messages; `None` for no model.
    fn open(&self) -> Result<Option<(Model, String)>> {
        let open = || open_model_or_builtin(self.model.as_deref());
        (!self.take_alone).then(open).transpose()
    }
}

impl RestoringArgs {
    /// The units of the table, and those of the result.
    fn units(&self) -> [Units; 2] {
        let input = self.input.table_units();
        [input, self.out_units.table_units(input)]
    }

    /// The columns that tell what became of points. An array has none, unless they are asked for:
    /// then it is refused.
    fn told(&self, columns: &Columns, cells: &[Cells]) -> StatusColumns {
        let units = self.units()[1];
        if self.out.format() == TableFormat::Npy && !self.status {
            return StatusColumns::new(false, &Columns::default(), &[], units);
        }
        StatusColumns::new(self.status, columns, cells, units)
    }

    /// How the points of a table are named, for the model; without one, for CMU's names, by which a
    /// body is measured.
    fn naming(&self, poses: &Poses, model: Option<&(Model, String)>) -> Result<PointNaming> {
        let known = model.map_or_else(joints::cmu_names, |(model, _)| model.meta.points.clone());
        Ok(match (self.bones, &self.map) {
            (Some(bones), _) => PointNaming::Bones(bones),
            (None, Some(map)) => PointNaming::Map(name_map(map, &known)?),
            (None, None) => PointNaming::of(&poses.points, poses.xyz.view(), &known),
        })
    }

    /// Fails where the body is of no person's size.
    fn check_body(&self, table: &Table, naming: &PointNaming) -> Result<()> {
        check_unit(&table.poses, self.input.table_units(), &table.name)?;
        let remedy = "give the table's unit with --units (m, mm, in, asf)";
        let names = naming.model_names(&table.poses.points);
        check_body_size(&table.poses, &names, &table.name, remedy)
    }

    /// What restores tables like this one, which may be the first frames of a longer one.
    fn restorer<'m>(
        &self,
        model: Option<&'m (Model, String)>,
        table: &Table,
        naming: &PointNaming,
    ) -> Result<Restorer<'m>> {
        let poses = &table.poses;
        if !self.force {
            self.check_body(table, naming)?;
        }
        let Some((model, name)) = model else {
            return Ok(Restorer::without_model());
        };
        let options = OpenOptions {
            sparsity: self.model.sparsity.0,
            published: self.model.published,
            ..OpenOptions::default()
        };
        let kind = &model.meta.kind;
        if options.sparsity.is_some() && kind != "sparse" {
            messages::info(&format!(
                "{name} is of kind {kind}, not a dictionary: --sparsity has no effect"
            ));
        }
        let mut restorer = Restorer::new(model).with_options(options).named(name);
        if self.space == Space::Body {
            restorer = restorer.in_body_space();
        }
        restorer = restorer.with_naming(naming.clone());
        match (naming, restorer.model_names(poses)?) {
            (PointNaming::Map(map), _) => report_map(map, &poses.points, self.map.is_some()),
            (_, Cow::Borrowed(names)) => report_unknown_points(names, &model.meta.points),
            (_, Cow::Owned(_)) => messages::info(
                "the points are the starts of bones, as in BVH files: matched with the bone ends \
                 of the model (--bones says otherwise)",
            ),
        }
        Ok(restorer)
    }
}

/// Says which map is taken, and what of it the table does not have.
fn report_map(map: &NameMap, points: &[String], is_given: bool) {
    if !is_given {
        let what = "the points have the names of the map";
        messages::info(&format!("{what} {} (--map says otherwise)", map.name));
    }
    let missing = map.missing(points);
    if !missing.is_empty() {
        let some = missing
            .iter()
            .take(4)
            .copied()
            .collect::<Vec<_>>()
            .join(", ");
        let more = if missing.len() > 4 { ", …" } else { "" };
        messages::info(&format!(
            "{} of the {} joints of the map {} are not in the table ({some}{more}): the model \
             estimates without them",
            missing.len(),
            map.joints.len(),
            map.name
        ));
    }
}

/// Reports the points that are not in the model.
fn report_unknown_points(points: &[String], known: &[String]) {
    let unknown: Vec<String> = (points.iter().filter(|p| !known.contains(p)))
        .map(|p| excerpt(p))
        .collect();
    let (count, shown) = (unknown.len(), &unknown[..unknown.len().min(3)]);
    let more = if count > 3 { ", …" } else { "" };
    let names = format!("({}{more})", shown.join(", "));
    match count {
        0 => {}
        1 => messages::info(&format!(
            "1 point is not in the model: only its take restores it {names}"
        )),
        _ => messages::info(&format!(
            "{count} points are not in the model: only their takes restore them {names}"
        )),
    }
}
