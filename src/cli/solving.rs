//! What `xyz2bvh` and `xyz2amc` share: a skeleton solved for a table's points, with a bar, and what the fit has to say.

use super::progress::Progress;
use super::say;
use crate::Result;
use crate::pose::Skeleton;
use crate::restore::fit::{Fit, FitSettings, fit};
use crate::restore::report::Matched;

/// Solves `skeleton` for the matched points of a table named `name`; with `limits` within its joints' limits.
pub fn solve(skeleton: &Skeleton, matched: &Matched, limits: bool, name: &str) -> Result<Fit> {
    matched.notes(name).iter().for_each(|n| say::note(n));
    let mut settings = FitSettings::default();
    settings.solve.limits = limits;
    let bar = Progress::new("solving", matched.xyz.nrows() as u64);
    let joints = &matched.joints;
    let fitted = fit(skeleton, joints, matched.xyz.view(), &settings, &mut |n| {
        bar.set(n as u64)
    })?;
    drop(bar);
    fitted
        .notes(&matched.names)
        .iter()
        .for_each(|n| say::note(n));
    Ok(fitted)
}
