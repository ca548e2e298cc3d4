//! What became of a file, in numbers and in lines.

use super::person::TakePerson;
use super::places::{Told, places};
use super::record::{Fingerprint, Summary};
use super::written::Written;
use crate::io::Input;
use crate::io::motion_file::LARGEST_MOTION_FILE;
use crate::label::unlabeled::labeled;
use crate::pose::zeros::Zeros;
use crate::pose::{Status, point_at};
use crate::restore::typical_noise;
use ndarray::ArrayView2;

impl Written<'_> {
    /// What became of the file, of whose people and skeletons this is told.
    pub(super) fn summary(&self, people: Vec<TakePerson>, of_skeleton: Vec<Told>) -> Summary {
        let take = self.restored.take;
        let file = &take.file;
        let poses = &file.table.poses;
        let (points, rotations) = (&self.restored.points, self.restored.rotations.as_ref());
        // Whole limbs come first.
        let told: Vec<Told> = of_skeleton.into_iter().chain(self.findings()).collect();
        let of_rotations = rotations.iter().flat_map(|r| r.places());
        let redone = take.redone.places.iter().cloned();
        let changed = redone.chain(take.labels.places()).chain(of_rotations);
        let mut places = places(&told, changed.collect(), &take.before, &self.replaced);
        for place in &mut places {
            // A bone that is none of the points has no trail.
            place.point = place.point.take().filter(|p| poses.points.contains(p));
        }
        let named = take.labels.named.as_ref();
        let (missing, left) = (self.missing(poses.xyz.view()), self.missing(points.xyz()));
        let not_held = if take.keeps_rotations() {
            0
        } else {
            self.unheld
        };
        let copied = !take.labels.are_changed() && self.is_copied();
        Summary {
            format: file.format.name().to_string(),
            frames: poses.frames(),
            points: poses.points.len(),
            computed: file.computed().into_iter().map(String::from).collect(),
            rate: file.rate(),
            missing,
            filled: (missing - left).saturating_sub(not_held),
            outliers: self.replaced.len() + rotations.map_or(0, |r| r.popped()),
            noise: typical_noise(Zeros::emptied(poses).xyz.view(), &poses.runs()),
            noise_deg: rotations.map(|r| r.noise()),
            denoised: match rotations {
                Some(rotations) => rotations.is_smoothed(),
                None => points.counts().mean_noise() > 0.0,
            },
            noise_stays: self.noise_that_stays().is_some(),
            copied,
            named_by: named.and_then(|named| named.by.clone()),
            names_fit: named.map(|named| named.fit),
            put_right: take.labels.put_right(),
            people,
            findings: told.into_iter().map(|told| told.line).collect(),
            notes: self.notes(copied),
            places,
        }
    }

    /// How many positions of labeled points are missing at `xyz`; what was taken out is an outlier.
    fn missing(&self, xyz: ArrayView2<'_, f64>) -> usize {
        let points = labeled(&self.restored.take.file.table.poses.points);
        let is_missing = |t: usize, p: usize| {
            !point_at(xyz, t, p).is_finite()
                && self.restored.points.status(t, p) != Status::Rejected
        };
        let of_frame = |t: usize| points.iter().filter(move |p| is_missing(t, **p)).count();
        (0..xyz.nrows()).map(of_frame).sum()
    }

    /// Whether the result is what the capture was: the same bytes, or the same numbers in the same
    /// format where all are positions and none was taken for missing.
    fn is_copied(&self) -> bool {
        let take = self.restored.take;
        let (settings, job) = (take.run.settings, take.run.job);
        if job.other_format(take.file.format).is_some() {
            return false;
        }
        let (was, is) = (&take.file.table.poses.xyz, self.restored.points.xyz());
        let is_same = |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
        let is_emptied = settings.read.all.zeros_are_missing || !settings.redo.is_empty();
        if !take.keeps_rotations() && !is_emptied {
            return was.iter().zip(&is).all(is_same);
        }
        let written = Input::open(&job.output).and_then(|i| i.read_all(LARGEST_MOTION_FILE));
        written.is_ok_and(|of| Fingerprint::of(&job.output, &of).sha256 == take.capture.sha256)
    }
}
