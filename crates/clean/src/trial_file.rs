//! Trials of gait from their C3D files: gaps filled, computed, and written back.

use crate::gait::{Finding, GaitSettings, GaitTrial, MARKERS, Markers, SessionTrial, Trial};
use crate::io::motion_file::ReadRules;
use crate::io::{MotionFile, Table};
use crate::pose::one_take::first_frame_number;
use crate::pose::point_at;
use crate::restore::{Complete, Restorer};
use crate::solve::{MarkerSet, SolveSettings, SolvedTake, solve};
use crate::{Error, Place, Result};
use ndarray::Array2;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

/// A filled position that is less sure is left empty, cm: as clean does.
const MOST_SD: f64 = 5.0;

/// A trial of gait with its C3D file.
pub struct TrialFile {
    /// The name of the trial: that of its file without `.c3d`.
    name: String,
    shown: String,
    file: Arc<MotionFile>,
    trial: Trial,
}

impl TrialFile {
    /// Opens a file.
    ///
    /// ```
    /// use posing_clean::TrialFile;
    /// use posing_gait::GaitSettings;
    /// use posing_io::motion_file::ReadRules;
    ///
    /// let case = "../../testdata/examples/gait";
    /// let open = |name| TrialFile::open(format!("{case}/{name}").as_ref(), &ReadRules::default());
    /// let (walk, standing) = (open("walk.c3d")?, open("static.c3d")?);
    /// let (computed, c3d) = walk.compute(Some(&standing), &GaitSettings::default())?;
    /// assert_eq!((computed.gait.cycles.len(), computed.gait.findings.len()), (3, 0));
    /// assert!(c3d.is_some());
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Io`]: it cannot be read. [`Error::Data`]: it is no C3D file, is damaged, or neither
    /// it nor a rule says its rate, unit or axis.
    pub fn open(path: &Path, rules: &ReadRules) -> Result<TrialFile> {
        let file = MotionFile::open_by(path, rules)?;
        let place = || Place::file(path.display().to_string());
        file.c3d()
            .ok_or_else(|| Error::unfit("is no C3D file").at(place()))?;
        TrialFile::new(path, Arc::new(file))
    }

    /// The trial of a file of markers. It has force plates, events and the subject's parameters if
    /// it is a C3D file.
    ///
    /// # Errors
    /// [`Error::Data`]: it does not say its rate.
    pub fn new(path: &Path, file: Arc<MotionFile>) -> Result<TrialFile> {
        let shown = path.display().to_string();
        let trial = if let Some(c3d) = file.c3d() {
            let mut c3d = Cow::Borrowed(c3d);
            if c3d.take.rate.is_none() {
                c3d.to_mut().take.rate = file.rate();
            }
            let units = file.units();
            Trial::from_c3d(&c3d, Some(units.unit), Some(units.up))?
        } else {
            let no_rate = "does not say its rate; give it with the option `fps`";
            let no_rate = || Error::unfit(no_rate).at(Place::file(&shown));
            let rate = file.rate().ok_or_else(no_rate)?;
            Trial {
                first_frame: first_frame_number(file.poses(), Some(rate)) as u32,
                ..Trial::new(Markers::from_poses(file.poses()), rate)
            }
        };
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let ends = name.len().checked_sub(4);
        let ends = ends.filter(|at| name.is_char_boundary(*at));
        let stem = ends.filter(|at| name[*at..].eq_ignore_ascii_case(".c3d"));
        Ok(TrialFile {
            trial,
            name: stem.map_or(&*name, |at| &name[..at]).to_string(),
            shown,
            file,
        })
    }

    /// Remarks on the file.
    pub fn notes(&self) -> &[String] {
        self.file.c3d().map_or(&[], |c3d| &c3d.take.notes)
    }

    /// Fills the gaps and computes the trial; with the bytes of its C3D file with outputs and
    /// events. These are missing of other marker sets than Plug-in Gait's, and where the file has
    /// no room, which a finding says.
    ///
    /// # Errors
    /// Those of [`GaitTrial::new`], of other marker sets those of
    /// [`solve`](fn@crate::solve::solve).
    pub fn compute(
        &self,
        statics: Option<&TrialFile>,
        settings: &GaitSettings,
    ) -> Result<(SessionTrial, Option<Vec<u8>>)> {
        let place = |e: Error| e.at(Place::file(&self.shown));
        let mut done = self.computed(None, statics, settings).map_err(place)?;
        if !self.trial.markers.are_plug_in_gait() {
            return Ok((done, None));
        }
        match self.with_outputs(&done) {
            Ok(bytes) => Ok((done, bytes)),
            Err(e) => {
                let why = e.message().map(ToString::to_string).unwrap_or_default();
                done.gait.findings.push(Finding {
                    kind: "no_c3d",
                    points: Vec::new(),
                    what: format!("no C3D file is written: {why}"),
                });
                Ok((done, None))
            }
        }
    }

    /// The trial computed as by [`TrialFile::compute`], without a file; of other marker sets than
    /// Plug-in Gait's by the bones of `solved`, a take that is solved of it, and the set.
    ///
    /// # Errors
    /// Those of [`TrialFile::compute`].
    pub fn computed(
        &self,
        solved: Option<(&SolvedTake, Option<&MarkerSet>)>,
        statics: Option<&TrialFile>,
        settings: &GaitSettings,
    ) -> Result<SessionTrial> {
        if !self.trial.markers.are_plug_in_gait() {
            return match solved {
                Some((take, set)) => self.by_bones(take, set, statics, settings),
                None => self.by_bones(&self.solved(None)?, None, statics, settings),
            };
        }
        let (trial, sd, doubtful) = filled(&self.trial)?;
        let mut gait = GaitTrial::new(&trial, statics.map(|s| &s.trial), settings)?;
        gait.findings.extend(doubtful);
        self.session_trial(trial, gait, &sd)
    }

    fn with_outputs(&self, done: &SessionTrial) -> Result<Option<Vec<u8>>> {
        let outputs = done.outputs(&self.file.whole_table().poses.points);
        let c3d = self.file.c3d();
        let bytes = c3d.map(|c3d| c3d.with_outputs(&outputs, &done.events()));
        bytes.transpose()
    }

    fn session_trial(
        &self,
        trial: Trial,
        gait: GaitTrial,
        sd: &Array2<f64>,
    ) -> Result<SessionTrial> {
        SessionTrial::new(self.name.clone(), self.shown.clone(), trial, gait, sd)
    }

    fn solved(&self, set: Option<&MarkerSet>) -> Result<SolvedTake> {
        let by_set = SolveSettings {
            set,
            ..SolveSettings::default()
        };
        solve(self.file.poses(), &by_set, &mut |_| {})
    }

    /// A trial of other markers, by the bones that are solved under them.
    fn by_bones(
        &self,
        take: &SolvedTake,
        set: Option<&MarkerSet>,
        statics: Option<&TrialFile>,
        settings: &GaitSettings,
    ) -> Result<SessionTrial> {
        let standing = statics.map(|own| own.solved(set)).transpose()?;
        let set = set.or_else(|| MarkerSet::find(&take.set));
        let set = set.ok_or_else(|| {
            Error::unfit("has not the markers of Plug-in Gait, nor of a known set")
        })?;
        let mut trial = self.trial.clone();
        trial.markers = take.gait_markers(self.file.poses(), set);
        let curves = take.gait_curves(&trial.markers, standing.as_ref());
        let gait = GaitTrial::of_other_model(&trial, curves, settings)?;
        let none = Array2::zeros((trial.markers.frames(), MARKERS.len()));
        self.session_trial(trial, gait, &none)
    }
}

/// The trial with its gaps filled by what the other markers of its own frames tell, as clean does;
/// the deviations of what was filled and of markers that leave their path, and findings on these.
fn filled(trial: &Trial) -> Result<(Trial, Array2<f64>, Vec<Finding>)> {
    let times = (0..trial.markers.frames()).map(|t| trial.time(t)).collect();
    let table = Table::from_poses(trial.markers.to_poses(times));
    let how = Complete {
        fps: Some(trial.rate),
        overwrite_outliers: true,
        ..Complete::default()
    };
    let restored = Restorer::without_model().complete(&table, &how)?;
    let (frames, points) = (table.poses.frames(), table.poses.points.len());
    let sd = Array2::from_shape_fn((frames, points), |(t, p)| restored.sd(t, p));
    let after = restored.table().poses;
    let (filled, mut deviations) = trial.filled(&after, sd.view(), MOST_SD);
    let mut findings = Vec::new();
    for (p, name) in table.poses.points.iter().enumerate() {
        // A marker stays where it was seen; how far it is from where it is expected is its doubt.
        let away = |t: usize| {
            let [was, is] = [&table.poses, &after].map(|poses| point_at(poses.xyz.view(), t, p));
            10.0 * was.distance(is)
        };
        let off: Vec<usize> = (0..frames).filter(|t| away(*t) > 0.0).collect();
        let marker = MARKERS.iter().position(|marker| marker == name);
        let ends = off.first().zip(off.last());
        let Some((marker, (first, last))) = marker.zip(ends) else {
            continue;
        };
        off.iter().for_each(|t| deviations[[*t, marker]] = away(*t));
        let [first, last] = [first, last].map(|t| trial.time(*t));
        let what = format!(
            "{name} leaves its path ({} frames, from {first:.2} to {last:.2} s): it was taken as \
             it is; clean replaces it",
            off.len()
        );
        findings.push(Finding {
            kind: "marker_doubtful",
            points: vec![name.clone()],
            what,
        });
    }
    Ok((filled, deviations, findings))
}
