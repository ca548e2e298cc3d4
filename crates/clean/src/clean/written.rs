//! A file whose result is written.

use super::record::Fingerprint;
use super::replaced::{ReplacedPosition, replaced};
use super::restored::Restored;
use super::skeleton;
use super::sources::OutputFormat;
use crate::io::NewTake;
use crate::io::motion_folder::name_of;
use crate::io::output::{TemporaryFile, write_file};
use crate::pose::{LengthUnit, Poses, Units, UpAxis};
use crate::{Error, Place, Result};
use std::path::Path;

/// A file whose result is written.
pub(super) struct Written<'t> {
    pub restored: Restored<'t>,
    /// Its positions that were replaced as outliers.
    pub replaced: Vec<ReplacedPosition>,
    /// How many positions the numbers of the result do not hold, or how many values of rotations
    /// are missing in it still.
    pub unheld: usize,
}

impl<'t> Restored<'t> {
    /// Writes the result to its path; whatever stops that, it is known who made what stands there.
    ///
    /// # Errors
    /// [`Error::Data`]: somebody may have changed what stands there, or the format does not hold
    /// the take. [`Error::Io`]: writing fails.
    pub(super) fn written(self) -> Result<Written<'t>> {
        let (take, run) = (self.take, &self.take.run);
        if !run.settings.again && run.earlier.is_in_doubt() {
            self.check_same()?;
        }
        skeleton::remove_old(&run.earlier);
        let begun = run.earlier.begin(&run.made_from)?;
        match self.write(&run.job.output) {
            Ok(unheld) => Ok(Written {
                replaced: replaced(&self.points, take.labels.captured(&take.file)),
                restored: self,
                unheld,
            }),
            Err(e) => {
                begun.give_up();
                Err(e)
            }
        }
    }

    /// Fails where the file at the path of the result is not what is to be written there.
    fn check_same(&self) -> Result<()> {
        let output = &self.take.run.job.output;
        // Its name ends as that of the result, which says how it is packed.
        let suffix = format!("-{}", name_of(output).display());
        let made = TemporaryFile::new(&suffix, b"").map_err(|e| Error::io(output, e))?;
        self.write(made.path())?;
        let digest = |path| Fingerprint::read(path).map(|of| of.sha256);
        if digest(made.path())? == digest(output)? {
            return Ok(());
        }
        let what = "a run was stopped as it wrote this, and somebody may have changed it since; \
                    move it, or make it again with the option `again`";
        Err(Error::data(Place::file(output.display().to_string()), what))
    }

    /// Writes the result; see [`Written::unheld`].
    fn write(&self, path: &Path) -> Result<usize> {
        let (file, xyz) = (&self.take.file, self.points.xyz());
        let Some(to) = self.take.run.job.other_format(file.format) else {
            return self.write_back(path);
        };
        match (to, to.table()) {
            (_, Some(table)) => file.write_table(path, table, xyz)?,
            (OutputFormat::C3d, _) => write_file(path, &self.new_take(UpAxis::Z)?.c3d()?)?,
            _ => write_file(path, &self.new_take(UpAxis::Y)?.trc()?)?,
        }
        Ok(0)
    }

    /// Writes the file anew in its own format.
    fn write_back(&self, path: &Path) -> Result<usize> {
        let file = &self.take.file;
        match &self.rotations {
            Some(rotations) => {
                file.write_channels(path, rotations.cleaned.motion.view())?;
                Ok(rotations.missing())
            }
            None => file.write_back(path, self.points.xyz()),
        }
    }

    /// The take for a file of markers, millimeters.
    fn new_take(&self, up: UpAxis) -> Result<NewTake> {
        let file = &self.take.file;
        let poses = Poses {
            xyz: file.whole(self.points.xyz()),
            ..file.whole_table().poses.clone()
        };
        if poses.takes().len() > 1 {
            let what = "has several takes, which one file of markers cannot hold; clean it with \
                        the option `to csv`";
            return Err(Error::data(Place::file(&file.table.name), what));
        }
        let unit = LengthUnit::Mm;
        Ok(NewTake::new(
            poses,
            file.rate().unwrap_or(1.0),
            Units { unit, up },
        ))
    }
}
