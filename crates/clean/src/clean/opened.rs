//! A capture that is opened: its format is known, what its result is made from, and what an earlier
//! run made of it.

use super::earlier_result::EarlierResult;
use super::record::{Fingerprint, MadeFrom, Summary};
use super::settings::CleanSettings;
use super::skeleton::SkeletonSettings;
use super::sources::{Job, is_of_rotations};
use crate::Result;
use crate::io::motion_file::{ReadOptions, skeleton_of};
use crate::io::{Input, MotionFormat};

/// A file on its way to a result.
pub(super) struct Run<'a> {
    pub settings: &'a CleanSettings,
    pub job: &'a Job,
    /// How the capture is read.
    pub read: ReadOptions,
    /// What the result is made from.
    pub made_from: MadeFrom,
    /// What stands in the place of the result.
    pub earlier: EarlierResult<'a>,
}

/// A capture that is not read yet.
pub(super) struct Opened<'a> {
    pub run: Run<'a>,
    /// Its bytes, unpacked.
    pub bytes: Input,
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
        };
        let run = Run {
            settings,
            job,
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
        let unchanged = earlier.unchanged(&self.run.made_from);
        unchanged.filter(|_| !self.run.settings.again && has_skeleton)
    }

    /// Fails where a file of somebody else stands in a place that is to be written.
    pub(super) fn check_places(&self) -> Result<()> {
        let earlier = &self.run.earlier;
        earlier.may_be_replaced(self.run.settings.again)?;
        match self.run.skeletons(self.format) {
            Some(skeletons) => skeletons.check(earlier),
            None => Ok(()),
        }
    }
}

impl<'a> Run<'a> {
    /// How a skeleton is made beside the result, if one is asked for; none of rotations.
    pub(super) fn skeletons(&self, format: MotionFormat) -> Option<&'a SkeletonSettings> {
        let skeletons = self.settings.skeletons.as_ref();
        skeletons.filter(|_| !is_of_rotations(format))
    }
}
