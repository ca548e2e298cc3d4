//! A capture that is opened: its format is known, what its result is made from, and what an earlier
//! run made of it.

use super::earlier_result::EarlierResult;
use super::labeled_beside::{LabeledBeside, LabeledTakes};
use super::record::{Fingerprint, MadeFrom, Summary};
use super::settings::CleanSettings;
use super::skeleton::SkeletonSettings;
use super::sources::{Job, is_of_rotations};
use crate::Result;
use crate::io::motion_file::{LARGEST_MOTION_FILE, ReadOptions, skeleton_of};
use crate::io::{Input, MotionFile, MotionFormat};
use crate::pose::{PointNaming, Poses, joints};
use crate::restore::keypoint_noise;
use std::sync::Arc;

/// A file on its way to a result.
pub(super) struct Run<'a> {
    pub settings: &'a CleanSettings,
    pub job: &'a Job,
    /// The labeled takes beside captures.
    pub beside: &'a LabeledBeside,
    /// How the capture is read.
    pub read: ReadOptions,
    /// What the result is made from.
    pub made_from: MadeFrom,
    /// What stands at the path of the result.
    pub earlier: EarlierResult<'a>,
}

/// The bytes of a capture, unpacked.
pub(super) struct Unpacked {
    pub size: usize,
    pub sha256: String,
}

/// A capture that is not read yet.
pub(super) struct Opened<'a> {
    run: Run<'a>,
    bytes: Input,
    format: MotionFormat,
}

impl<'a> Opened<'a> {
    /// Opens the capture of a job, whose bytes are `packed`.
    ///
    /// # Errors
    /// Those of unpacking it, and of a skeleton that cannot be read.
    pub(super) fn new(
        settings: &'a CleanSettings,
        job: &'a Job,
        beside: &'a LabeledBeside,
        (input, packed): (Fingerprint, Vec<u8>),
    ) -> Result<Opened<'a>> {
        let packed = std::io::Cursor::new(packed);
        let mut bytes = Input::new(job.input.display().to_string(), packed)?;
        bytes.look_ahead()?;
        let format = MotionFormat::of(bytes.first_bytes());
        let read = settings.read.of(&job.input, format);
        let skeleton = match format {
            MotionFormat::Amc => Some(Fingerprint::read(&skeleton_of(&job.input, &read)?)?),
            _ => None,
        };
        let made_from = MadeFrom {
            posing: env!("CARGO_PKG_VERSION").to_string(),
            settings: settings.recorded(job, format, &read)?,
            input,
            skeleton,
            labeled_beside: None,
        };
        let run = Run {
            settings,
            job,
            beside,
            read,
            made_from,
            earlier: EarlierResult::read(&job.output),
        };
        Ok(Opened { run, bytes, format })
    }

    /// What became of the file in an earlier run, where that need not be done again.
    pub(super) fn unchanged(&self) -> Option<Summary> {
        let earlier = &self.run.earlier;
        let has_skeleton = self
            .run
            .skeletons(self.format)
            .is_none_or(|s| s.is_done(earlier));
        let mut made_from = self.run.made_from.clone();
        if earlier.names_came_from_beside() {
            made_from.labeled_beside = Some(self.run.labeled_beside().digest.clone());
        }
        let unchanged = earlier.unchanged(&made_from);
        unchanged.filter(|_| !self.run.settings.again && has_skeleton)
    }

    /// Reads the capture.
    ///
    /// # Errors
    /// A file of somebody else stands at a path that is to be written; those of reading.
    pub(super) fn read(self) -> Result<(Run<'a>, Unpacked, MotionFile)> {
        let Opened { run, bytes, format } = self;
        run.earlier.may_be_replaced(run.settings.again)?;
        if let Some(skeletons) = run.skeletons(format) {
            skeletons.check(&run.earlier, &run.job.named)?;
        }
        let is_utf16 = bytes.is_utf16();
        let bytes = bytes.read_all(LARGEST_MOTION_FILE)?;
        let unpacked = Unpacked {
            size: bytes.len(),
            sha256: Fingerprint::of(&run.job.input, &bytes).sha256,
        };
        let mut file = MotionFile::read(&run.job.input, bytes, &run.read)?;
        if is_utf16 {
            let what = "is a text in UTF-16; the result is in UTF-8".to_string();
            file.notes.push(what);
        }
        Ok((run, unpacked, file))
    }
}

impl<'a> Run<'a> {
    /// The labeled takes in the folder of the capture.
    pub(super) fn labeled_beside(&self) -> Arc<LabeledTakes> {
        self.beside.of(&self.job.input, &self.settings.read)
    }

    /// How the points of a take are called by the model; without one, by CMU's names.
    pub(super) fn naming(&self, poses: &Poses) -> PointNaming {
        let known = match &self.settings.model {
            Some((model, ..)) => &model.meta.points,
            None => &joints::cmu_names(),
        };
        match &self.settings.map {
            Some(map) => PointNaming::Map(map.clone()),
            None => PointNaming::of(&poses.points, poses.xyz.view(), known),
        }
    }

    /// Whether the points of every take are joints whose noise cleaning removes as that of
    /// keypoints, and whose sides it puts back.
    pub(super) fn has_keypoints(&self, file: &MotionFile) -> bool {
        self.are_keypoints(file.poses(), file.format)
    }

    /// Whether `poses`, perhaps one person of a file of this format, are such joints: see
    /// [`Self::has_keypoints`].
    pub(super) fn are_keypoints(&self, poses: &Poses, format: MotionFormat) -> bool {
        let settings = self.settings;
        let naming = self.naming(poses);
        let limit = settings.unless_noise_stays(settings.method.noise_limit);
        let is_mapped = settings.model.is_some() && matches!(naming, PointNaming::Map(_));
        is_mapped
            && settings.method.outliers
            && !self.job.keeps_rotations(format)
            && keypoint_noise(poses, &naming.model_names(&poses.points)).is_some_and(|n| n > limit)
    }

    /// How a skeleton is made beside the result, if one is asked for; none of rotations.
    pub(super) fn skeletons(&self, format: MotionFormat) -> Option<&'a SkeletonSettings> {
        let skeletons = self.settings.skeletons.as_ref();
        skeletons.filter(|_| !is_of_rotations(format))
    }
}
