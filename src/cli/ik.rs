//! What `xyz2bvh` and `xyz2amc` share: a skeleton solved for a table's points, with a bar, and what the fit has to say.

use super::messages;
use super::progress::Progress;
use crate::Result;
use crate::pose::{Poses, Skeleton};
use crate::restore::ik::correspondence::Correspondence;
use crate::restore::ik::sequence::{SequenceFit, SequenceSettings, fit_sequence};

/// Says where a take's times jump, which `format` has no word for.
pub fn report_time_jumps(poses: &Poses, name: &str, format: &str) {
    let jumps = poses.runs().len().saturating_sub(1);
    if jumps > 0 {
        let times = if jumps == 1 {
            "once"
        } else {
            &format!("{jumps} times")
        };
        messages::info(&format!(
            "{name}: the time jumps {times}; in {format} those frames follow at once"
        ));
    }
}

/// Solves `skeleton` for the matched points of a table named `name`; with `limits` within its joints' limits.
pub fn solve(
    skeleton: &Skeleton,
    matched: &Correspondence,
    limits: bool,
    name: &str,
) -> Result<SequenceFit> {
    matched.notes(name).iter().for_each(|n| messages::info(n));
    let mut settings = SequenceSettings::default();
    settings.solve.limits = limits;
    let bar = Progress::new("solving", matched.xyz.nrows() as u64);
    let joints = &matched.joints;
    let fitted = fit_sequence(skeleton, joints, matched.xyz.view(), &settings, &mut |n| {
        bar.set(n as u64)
    })?;
    drop(bar);
    fitted
        .notes(&matched.names)
        .iter()
        .for_each(|n| messages::info(n));
    Ok(fitted)
}
