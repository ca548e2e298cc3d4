//! A file that is restored: its points, or its rotations where it keeps them.

use super::body_motion::body_motion;
use super::held::held_of;
use super::prepared::Prepared;
use super::rotations::CleanedFile;
use crate::ik::rotation_cleaning::{RotationCleaning, clean_rotations};
use crate::pose::PointNaming;
use crate::restore::body_size::check_body_size;
use crate::restore::{Clean, Restoration, Restorer};
use crate::{Place, Result};
use ndarray::ArrayView2;

/// A file that is restored.
pub(super) struct Restored<'t> {
    pub take: &'t Prepared<'t>,
    /// How its points are named, for the model; without one, for CMU's names, by which a body is
    /// measured.
    pub naming: PointNaming,
    /// Its points.
    pub points: Restoration<'t>,
    /// Its rotations, where it keeps them.
    pub rotations: Option<CleanedFile>,
    /// A line on the low-pass filter.
    pub low_pass: Option<String>,
}

impl Prepared<'_> {
    /// Restores the points; rotations that stay rotations by themselves.
    ///
    /// # Errors
    /// Those of restoring; a body of no person's size; a filter that does not fit the rate.
    pub(super) fn restored(&self) -> Result<Restored<'_>> {
        let naming = self.run.naming(&self.file.table.poses);
        let keeps = self.keeps_rotations();
        let (mut points, rotations) = match self.file.motion().filter(|_| keeps) {
            Some(motion) => self.clean_rotations(motion)?,
            None if keeps => (Restoration::unchanged(&self.file.table), None),
            None => (self.clean_points(&naming)?, None),
        };
        points.reject(self.labels.taken_out());
        let (points, low_pass) = self.low_passed(points)?;
        Ok(Restored {
            take: self,
            naming,
            points,
            rotations,
            low_pass,
        })
    }

    fn clean_rotations(
        &self,
        motion: ArrayView2<'_, f64>,
    ) -> Result<(Restoration<'_>, Option<CleanedFile>)> {
        let (settings, file) = (self.run.settings, &self.file);
        let how = RotationCleaning {
            noise_limit: settings.unless_noise_stays(settings.rotation_noise_limit),
            pops: settings.method.outliers,
            max_gap: settings.method.max_gap,
            held: held_of(file),
        };
        let rate = file.rate().unwrap_or(1.0);
        let body = body_motion(file, settings.library(), settings.method.max_gap)?;
        let motion = body.as_ref().map_or(motion, |body| body.motion.view());
        let cleaned = clean_rotations(&file.channels(), motion, rate, &how);
        let xyz = file.positions_of(cleaned.motion.view())?;
        let rotations = CleanedFile::new(file, cleaned, settings.method.most_sd());
        let mut points = Restoration::followed(&file.table, xyz);
        if let Some(body) = body {
            points = points.with_motion(body.bodies, body.sd.view());
        }
        Ok((points, Some(rotations)))
    }

    fn clean_points(&self, naming: &PointNaming) -> Result<Restoration<'_>> {
        let (settings, table) = (self.run.settings, &self.file.table);
        let names = naming.model_names(&table.poses.points);
        if !settings.force {
            let remedy = "give the file's unit with the option `units`";
            check_body_size(&table.poses, &names, &table.name, remedy)?;
        }
        let method = Clean {
            fps: self.file.rate().or(Some(1.0)),
            noise_limit: settings.unless_noise_stays(settings.method.noise_limit),
            ..settings.method
        };
        // The model, where it knows any of the points.
        let mut restorer = match &settings.model {
            Some((model, name, _)) if names.iter().any(|n| model.meta.points.contains(n)) => {
                let restorer = Restorer::new(model).named(name);
                restorer.with_naming(naming.clone())
            }
            _ => Restorer::without_model(),
        };
        if let Some(library) = settings.library() {
            restorer = restorer.with_motion(library);
        }
        restorer.clean(table, &method)
    }

    /// The points after the low-pass filter, and a line on that.
    fn low_passed<'t>(&self, points: Restoration<'t>) -> Result<(Restoration<'t>, Option<String>)> {
        let Some(cutoff) = self.run.settings.butterworth else {
            return Ok((points, None));
        };
        if self.keeps_rotations() {
            let what =
                "no low-pass filter, since the file holds rotations; as csv, its positions have it";
            return Ok((points, Some(what.to_string())));
        }
        let (points, short) = (points.low_passed(cutoff, self.file.rate()))
            .map_err(|e| e.at(Place::file(&self.file.table.name)))?;
        let mut note = format!("smoothed (Butterworth, {cutoff} Hz, forwards and backwards)");
        if short > 0 {
            note += &format!("; {short} pieces of fewer than 10 frames are not");
        }
        Ok((points, Some(note)))
    }
}
