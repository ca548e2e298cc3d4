//! A file as it is to be restored: its labels are put right, and what counts as missing is missing.

use super::held::empty_held;
use super::labels::{Relabeled, relabeled};
use super::naming::named;
use super::opened::{Opened, Run, Unpacked};
use super::redo::Redone;
use crate::audit::{TakeAudit, audit_motion, name_options};
use crate::io::MotionFile;
use crate::label::LabelSettings;
use crate::pose::check_unit;
use crate::{Error, Place, Result};

/// A file that is ready to be restored.
pub(super) struct Prepared<'a> {
    pub run: Run<'a>,
    pub capture: Unpacked,
    pub file: MotionFile,
    /// The audit of the capture.
    pub before: Vec<TakeAudit>,
    /// What was done to its labels.
    pub labels: Relabeled,
    /// What is done again.
    pub redone: Redone,
}

impl<'a> Opened<'a> {
    /// Reads the capture, audits and prepares it.
    ///
    /// # Errors
    /// Those of reading. [`Error::Data`]: it has no rate or an odd unit, its labels cannot be
    /// checked, or what is to be done again is not there.
    pub(super) fn prepared(self) -> Result<Prepared<'a>> {
        let (mut run, capture, file) = self.read()?;
        check(&run, &file)?;
        let settings = run.settings;
        let (file, named) = named(file, &run);
        if named.is_some() {
            run.made_from.labeled_beside = Some(run.labeled_beside().digest.clone());
        }
        let mut before = audit_motion(&file, &settings.limits);
        name_options(&mut before, settings.option_names);
        // Sides of keypoints are put back with their noise, and no marker tells more.
        let is_asked = |l: &LabelSettings| !l.exchange.is_empty() || !l.keep.is_empty();
        let labels = settings.labels.as_ref();
        let labels = labels.filter(|labels| is_asked(labels) || !run.has_keypoints(&file));
        let (mut file, labels) = relabeled(labels, file, named)?;
        if settings.held_is_missing {
            empty_held(&mut file)?;
        }
        let keeps = run.job.keeps_rotations(file.format);
        if keeps && file.table.poses.points.is_empty() {
            file.notes
                .push("copied: there are no positions to clean".into());
        }
        let redone = Redone::empty(&settings.redo, &mut file, keeps)?;
        Ok(Prepared {
            run,
            capture,
            file,
            before,
            labels,
            redone,
        })
    }
}

impl Prepared<'_> {
    /// Whether the result holds rotations or columns, as the file does, and no positions.
    pub(super) fn keeps_rotations(&self) -> bool {
        self.run.job.keeps_rotations(self.file.format)
    }
}

/// Fails where times or lengths would be taken wrong.
fn check(run: &Run<'_>, file: &MotionFile) -> Result<()> {
    if file.rate().is_none() && file.table.poses.frames() > 1 {
        let what = "has no times that give a rate; give it with the option `fps F` (frames per \
                    second)";
        return Err(Error::data(Place::file(&file.table.name), what));
    }
    if !run.settings.force && !run.job.keeps_rotations(file.format) {
        check_unit(file.poses(), file.units(), &file.table.name)?;
    }
    Ok(())
}
