//! Restoring a table with a pose model: the door to [`complete`](Restorer::complete) and
//! [`denoise`](Restorer::denoise).
//!
//! ```
//! use posing_io::Table;
//! use posing_restore::{Complete, Restorer};
//! # fn main() -> posing_core::Result<()> {
//! let model = posing_models::prior::builtin_model()?;
//! # let text = "time,root.x,root.y,root.z\n";
//! # let input = posing_io::Input::new("walk.csv", text.as_bytes())?;
//! # let walk = Table::read(input, &Default::default())?;
//! let options = Complete { fps: Some(120.0), max_gap: Some(0.5), ..Complete::default() };
//! let done = Restorer::new(&model).complete(&walk, &options)?;
//! println!("{} points filled, {} rejected", done.filled(), done.rejected());
//! # Ok(())
//! # }
//! ```

use super::clean::Clean;
use super::complete::Complete;
use super::cuts::split_at_cuts;
use super::denoise::Denoise;
use super::known_motion::KnownMotion;
use super::pose_model::PoseModel;
use super::restoration::Restoration;
use super::take::{Method, PointMapping, Take, TakeResult};
use crate::inbetween::MotionLibrary;
use crate::io::Model;
use crate::io::Table;
use crate::label::people::{Person, people};
use crate::label::unlabeled::{labeled, labeled_poses};
use crate::pose::computed::computed_points;
use crate::pose::repeated_frames::RepeatedFrames;
use crate::pose::zeros::Zeros;
use crate::pose::{BonePoints, PointNaming, Poses};
use crate::prior::OpenOptions;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2, Axis, CowArray, Ix2, s};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::OnceLock;

/// Restores tables with one model, which is opened at the first table, or with none.
pub struct Restorer<'m> {
    /// `None`: by the takes themselves.
    model: Option<&'m Model>,
    motion: Option<&'m MotionLibrary>,
    options: OpenOptions,
    name: String,
    world: bool,
    naming: Option<PointNaming>,
    opened: OnceLock<PoseModel>,
}

impl<'m> Restorer<'m> {
    /// Restores poses that stand anywhere in the world, by a model. Their points have the names of
    /// the model's ([`builtin_model`](crate::prior::builtin_model): the joints of the CMU
    /// database), or are mapped to them by [`Restorer::with_naming`]; for markers see
    /// [`Restorer::without_model`].
    pub fn new(model: &'m Model) -> Restorer<'m> {
        Restorer::with(Some(model))
    }

    /// Restores takes of any points, such as markers, by their own frames and by time alone; single
    /// frames cannot be restored.
    pub fn without_model() -> Restorer<'m> {
        Restorer::with(None)
    }

    fn with(model: Option<&'m Model>) -> Restorer<'m> {
        Restorer {
            model,
            motion: None,
            options: OpenOptions::default(),
            name: "the model".to_string(),
            world: true,
            naming: None,
            opened: OnceLock::new(),
        }
    }

    /// Sets how the model is opened.
    #[must_use]
    pub fn with_options(mut self, options: OpenOptions) -> Restorer<'m> {
        self.options = options;
        self
    }

    /// Names the model in errors.
    #[doc(hidden)]
    pub fn named(mut self, name: impl Into<String>) -> Restorer<'m> {
        self.name = name.into();
        self
    }

    /// Restores poses that stand in body space: root at the origin, no global rotation, the model's
    /// body.
    #[must_use]
    pub fn in_body_space(mut self) -> Restorer<'m> {
        self.world = false;
        self
    }

    /// Says how the points of the tables are named; without it, the names
    /// themselves tell.
    #[must_use]
    pub fn with_naming(mut self, naming: PointNaming) -> Restorer<'m> {
        self.naming = Some(naming);
        self
    }

    /// Fills gaps of a whole body from a library too; without it, from the take itself.
    #[must_use]
    pub fn with_motion(mut self, library: &'m MotionLibrary) -> Restorer<'m> {
        self.motion = Some(library);
        self
    }

    /// Fills the missing points of a table. A table without times and without [`Complete::fps`] is
    /// completed frame by frame.
    ///
    /// # Errors
    /// [`Error::Data`] if the model cannot be opened, the table has none of its points, `fps`
    /// contradicts the table's times, or `max_gap` is set and there is no rate;
    /// [`Error::Usage`] if `observe` names a point that the table lacks.
    pub fn complete<'t>(&self, table: &'t Table, options: &Complete) -> Result<Restoration<'t>> {
        self.complete_with(table, options, &|_| {})
    }

    /// [`Restorer::complete`] with progress: `progress` is called with numbers of frames that are
    /// finished.
    ///
    /// # Errors
    /// As [`Restorer::complete`].
    pub fn complete_with<'t>(
        &self,
        table: &'t Table,
        options: &Complete,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Restoration<'t>> {
        options.check(&table.poses.points)?;
        let hidden = hidden_columns(&table.poses, options.observe.as_deref());
        let rate = rate(table, options.fps, options.per_frame)?;
        if rate.is_none() && options.max_gap.is_some() {
            return Err(no_rate(table));
        }
        self.restore(table, options, rate, &hidden, progress)
    }

    /// Cleans the takes of a table: those with noise over [`Clean::noise_limit`] are denoised, the
    /// others keep what was measured; outliers are replaced and gaps filled. A table without
    /// times and without [`Clean::fps`] is completed frame by frame.
    ///
    /// # Errors
    /// As [`Restorer::complete`].
    pub fn clean<'t>(&self, table: &'t Table, options: &Clean) -> Result<Restoration<'t>> {
        let rate = rate(table, options.fps, false)?;
        if rate.is_none() && options.max_gap.is_some() {
            return Err(no_rate(table));
        }
        self.restore(table, options, rate, &[], &|_| {})
    }

    /// Denoises the points of a table. A table without times and without [`Denoise::fps`] is
    /// denoised frame by frame.
    ///
    /// # Errors
    /// [`Error::Data`] if the model cannot be opened, the table has none of its points, or `fps`
    /// contradicts the table's times.
    pub fn denoise<'t>(&self, table: &'t Table, options: &Denoise) -> Result<Restoration<'t>> {
        self.denoise_with(table, options, &|_| {})
    }

    /// [`Restorer::denoise`] with progress: `progress` is called with numbers of frames that are
    /// finished.
    ///
    /// # Errors
    /// As [`Restorer::denoise`].
    pub fn denoise_with<'t>(
        &self,
        table: &'t Table,
        options: &Denoise,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Restoration<'t>> {
        let rate = rate(table, options.fps, options.per_frame)?;
        self.restore(table, options, rate, &[], progress)
    }

    /// The names by which the model knows the points of `poses`: their own, where they are the
    /// starts of bones and the model has ends, those of the bones that end there, or those of a
    /// map.
    ///
    /// # Errors
    /// [`Error::Data`] if the model cannot be opened, or has none of these points.
    pub fn model_names<'p>(&self, poses: &'p Poses) -> Result<Cow<'p, [String]>> {
        let Some(model) = self.model else {
            return Ok(Cow::Borrowed(&poses.points));
        };
        Ok(self.mapping(model, poses)?.1)
    }

    /// The points of `model` among those of `poses`, and the names by which it knows these.
    fn mapping<'p>(
        &self,
        model: &Model,
        poses: &'p Poses,
    ) -> Result<(PointMapping<'_>, Cow<'p, [String]>)> {
        let opened = self.opened(model)?;
        let of = || PointNaming::of(&poses.points, poses.xyz.view(), &opened.points);
        let naming = self.naming.clone().unwrap_or_else(of);
        let names = match (&naming, opened.bone_points()) {
            (PointNaming::Bones(_), BonePoints::Starts) => Cow::Borrowed(&poses.points[..]),
            _ => naming.model_names(&poses.points),
        };
        let is_mapped = matches!(naming, PointNaming::Map(_));
        let mapping = PointMapping::new(opened, &self.name, &names, is_mapped)?;
        Ok((mapping, names))
    }

    /// The opened model.
    fn opened(&self, model: &Model) -> Result<&PoseModel> {
        if let Some(opened) = self.opened.get() {
            return Ok(opened);
        }
        let mut opened = PoseModel::open(model, &self.options, &self.name, self.world)?;
        if !self.options.published {
            opened = opened.with_rigid_distances(model, &self.name)?;
        }
        Ok(self.opened.get_or_init(|| opened))
    }

    /// Restores each take of a table, or each frame where there is no rate, each person by itself;
    /// `hidden` columns count as missing.
    fn restore<'t>(
        &self,
        table: &'t Table,
        method: &dyn Method,
        rate: Option<f64>,
        hidden: &[usize],
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Restoration<'t>> {
        let mut out = Restoration::unchanged(table);
        let poses = &*Zeros::emptied(&table.poses);
        let computed = match rate {
            Some(_) => computed_points(&table.poses),
            None => Vec::new(),
        };
        let mut points = labeled(&poses.points);
        points.retain(|p| computed.binary_search(p).is_err());
        let people = people(&poses.points, &points, poses.xyz.view());
        let of_person = |person: &Person| Labeled::of(table, poses, &person.points);
        let people: Vec<Labeled<'_>> = people.iter().map(of_person).collect();
        let mapped = people.iter().map(|labeled| {
            let mapped = self.model.map(|model| self.mapping(model, &labeled.poses));
            mapped.transpose()
        });
        let mut mapped: Vec<Result<_>> = mapped.collect();
        // The model need not know a second person's points.
        if !mapped.is_empty() && mapped.iter().all(Result::is_err) {
            mapped.swap_remove(0)?;
        }
        for (n, (labeled, mapped)) in people.iter().zip(mapped).enumerate() {
            let mapped = mapped.unwrap_or_default();
            let (mapping, names) = match &mapped {
                Some((mapping, names)) => (Some(mapping), &names[..]),
                None => (None, &labeled.poses.points[..]),
            };
            if rate.is_none() && mapping.is_none() && self.model.is_some() {
                continue;
            }
            let is_first = n == 0;
            let count = |frames: usize| {
                if is_first {
                    progress(frames);
                }
            };
            let restorer = PersonRestorer {
                table,
                method,
                motion: self.motion.map_or(KnownMotion::Own, KnownMotion::Library),
                rate,
                hidden,
                progress: &count,
            };
            restorer.restore(labeled, mapping, names, &mut out)?;
        }
        out.count_people(people.len());
        Ok(out)
    }
}

/// Restores the points of one person in a table; `hidden` columns count as missing.
struct PersonRestorer<'a> {
    table: &'a Table,
    method: &'a dyn Method,
    motion: KnownMotion<'a>,
    rate: Option<f64>,
    hidden: &'a [usize],
    progress: &'a (dyn Fn(usize) + Sync),
}

impl PersonRestorer<'_> {
    /// Restores the points of one person, which the model knows by these names.
    fn restore(
        &self,
        labeled: &Labeled<'_>,
        mapping: Option<&PointMapping<'_>>,
        names: &[String],
        out: &mut Restoration<'_>,
    ) -> Result<()> {
        let poses = &*labeled.poses;
        let seen = labeled.hide(&poses.xyz, self.hidden);
        let Some(rate) = self.rate else {
            let mapping = mapping.ok_or_else(no_model)?;
            let restored = self.method.restore_frames(mapping, seen.view());
            out.add(0, &restored, &labeled.points);
            return Ok(());
        };
        let runs = self.table.poses.runs();
        for (frames, own) in poses.takes().into_iter().zip(poses.rates()) {
            // Takes and runs are both in order.
            let first = runs.partition_point(|r| r.start < frames.start);
            let runs: Vec<Range<usize>> = runs[first..]
                .iter()
                .take_while(|r| r.end <= frames.end)
                .map(|r| r.start - frames.start..r.end - frames.start)
                .collect();
            let rate = own.unwrap_or(rate);
            let take = Take {
                names,
                xyz: seen.slice(s![frames.clone(), ..]),
                runs: &runs,
                rate,
                sd: (labeled.sd.as_ref()).map(|sd| sd.slice(s![frames.clone(), ..])),
                motion: self.motion,
            };
            let whole = poses.xyz.slice(s![frames.clone(), ..]);
            let (restored, cuts) = self.restore_take(mapping, &take, whole);
            out.count_cuts(cuts);
            out.add(frames.start, &restored, &labeled.points);
        }
        Ok(())
    }

    /// Restores one take, whose frames with no point hidden are `whole`, between its cuts; also
    /// how many these are. Frames that repeat the one before follow it.
    fn restore_take(
        &self,
        mapping: Option<&PointMapping<'_>>,
        take: &Take<'_>,
        whole: ArrayView2<'_, f64>,
    ) -> (TakeResult, usize) {
        let repeated = RepeatedFrames::at_their_times(whole);
        if !repeated.is_any() {
            let runs = split_at_cuts(whole, take.runs, take.rate);
            let cuts = runs.len() - take.runs.len();
            let take = Take {
                runs: &runs,
                ..*take
            };
            return (
                self.method.restore_take(mapping, &take, self.progress),
                cuts,
            );
        }
        let kept_runs = repeated.kept_runs(take.runs);
        let (xyz, whole) = (repeated.rows(take.xyz), repeated.rows(whole));
        let rate = repeated.rate(take.rate);
        let runs = split_at_cuts(whole.view(), &kept_runs, rate);
        let sd = take.sd.map(|sd| repeated.rows(sd));
        let kept = Take {
            names: take.names,
            xyz: xyz.view(),
            runs: &runs,
            rate,
            sd: sd.as_ref().map(|sd| sd.view()),
            motion: take.motion,
        };
        let restored = self.method.restore_take(mapping, &kept, self.progress);
        (self.progress)(take.xyz.nrows() - xyz.nrows());
        (
            restored.repeated(&repeated, take.xyz),
            runs.len() - kept_runs.len(),
        )
    }
}

/// What to say where the length of a gap is unknown.
fn no_rate(table: &Table) -> Error {
    let what = "a longest gap needs a frame rate, and the table's times give none";
    Error::data(Place::file(&table.name), what)
}

/// What to say where only a model would do.
fn no_model() -> Error {
    Error::usage(
        "without a model only whole takes can be restored: a frame by itself says nothing of what \
         it lacks (the option `fps` sets a table's frame rate)",
    )
}

/// The frame rate of a table: `fps`, else by its times. `None` where each frame is restored by
/// itself.
fn rate(table: &Table, fps: Option<f64>, per_frame: bool) -> Result<Option<f64>> {
    if per_frame {
        return Ok(None);
    }
    let poses = &table.poses;
    let timed = 0..poses.time.as_ref().map_or(0, Vec::len);
    match (poses.rate(), fps) {
        (Some(own), Some(fps)) if !poses.is_consistent_with_rate(timed, fps) => {
            let what =
                format!("{fps} frames a second contradict the times, which step {own} a second");
            Err(Error::data(Place::file(&table.name), what))
        }
        (own, fps) => Ok(fps.or(own)),
    }
}

/// The columns of points that are not in `observe`.
fn hidden_columns(poses: &Poses, observe: Option<&[String]>) -> Vec<usize> {
    let Some(observe) = observe else {
        return Vec::new();
    };
    let hidden = (0..poses.points.len()).filter(|&p| !observe.contains(&poses.points[p]));
    hidden.flat_map(|p| 3 * p..3 * p + 3).collect()
}

/// The labeled points of a person in a table: others are neither filled nor learned from.
struct Labeled<'t> {
    /// Their indices among the table's points.
    points: Vec<usize>,
    poses: Cow<'t, Poses>,
    /// Standard deviations (frames, points), cm, where the table says them.
    sd: Option<CowArray<'t, f64, Ix2>>,
}

impl<'t> Labeled<'t> {
    /// Some points of a table, at the indices that they have in `poses`.
    fn of(table: &'t Table, poses: &'t Poses, points: &[usize]) -> Labeled<'t> {
        let sd = table.sd.as_ref().map(|sd| {
            if points.len() == sd.ncols() {
                CowArray::from(sd)
            } else {
                CowArray::from(sd.select(Axis(1), points))
            }
        });
        Labeled {
            poses: labeled_poses(poses, points),
            points: points.to_vec(),
            sd,
        }
    }

    /// Frames of these points with some of the table's columns missing.
    fn hide<'a>(&self, xyz: &'a Array2<f64>, columns: &[usize]) -> CowArray<'a, f64, Ix2> {
        let mut xyz = CowArray::from(xyz);
        for (own, point) in self.points.iter().enumerate() {
            for axis in (0..3).filter(|axis| columns.contains(&(3 * point + axis))) {
                xyz.column_mut(3 * own + axis).fill(f64::NAN);
            }
        }
        xyz
    }
}
