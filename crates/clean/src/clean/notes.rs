//! How a file was taken, and what was done, a line each.

use super::findings::listed;
use super::replaced::ReplacedPosition;
use super::restored::Restored;
use super::sources::OutputFormat;
use super::written::Written;
use crate::audit::count;
use crate::io::motion_file::Source;
use crate::io::{MotionFile, MotionFormat};
use crate::label::people::people_by_name;
use crate::label::unlabeled::{labeled_poses, left_alone};
use crate::pose::{PointNaming, point_at};
use crate::restore::Restoration;
use crate::restore::inbetween::{NO_BODY, knows_body};

impl Written<'_> {
    /// The notes on a file whose result is a copy, or not.
    pub(super) fn notes(&self, is_copied: bool) -> Vec<String> {
        let restored = &self.restored;
        let take = restored.take;
        let limit = take.run.settings.rotation_noise_limit;
        let rotations = restored.rotations.as_ref();
        let mut out = of_file(&take.file);
        out.extend(of_points(restored));
        out.extend(replacements(&self.replaced));
        out.extend(rotations.iter().flat_map(|r| r.notes(limit)));
        out.extend(take.redone.notes.iter().chain(&restored.low_pass).cloned());
        out.extend(take.labels.notes());
        if take.run.job.other_format(take.file.format) == Some(OutputFormat::Npy) {
            out.extend(take.file.table.columns.lost_in_array());
        }
        let noise = rotations.map(|r| r.noise());
        let is_little = |noise: &f64| is_copied && *noise < limit.to_degrees();
        let unchanged = |noise| format!("unchanged: the noise is {noise:.2} degrees");
        out.extend(noise.filter(is_little).map(unchanged));
        let names = take.run.settings.option_names;
        out.iter().map(|line| names.in_text(line)).collect()
    }
}

/// The replaced positions in one line; the record has all.
fn replacements(moved: &[ReplacedPosition]) -> Option<String> {
    let one =
        |m: &ReplacedPosition| format!("{} in frame {} by {:.1} cm", m.point, m.frame, m.moved);
    (!moved.is_empty()).then(|| {
        let some = listed(moved.iter().map(one));
        format!(
            "outliers: {} replaced ({some}); the record has them as they were",
            moved.len()
        )
    })
}

/// What a person should know of how the file was taken.
fn of_file(file: &MotionFile) -> Vec<String> {
    let mut out = file.notes.clone();
    let (unit, up) = (&file.read_as.unit, &file.read_as.up);
    if file.format == MotionFormat::Bvh
        && (unit.from == Source::Custom || up.from == Source::Custom)
    {
        out.push(format!(
            "taken as {} and {} up, as BVH files are by custom",
            unit.value, up.value
        ));
    }
    let is_custom = matches!(
        file.format,
        MotionFormat::Bvh | MotionFormat::Csv | MotionFormat::Npy
    );
    if is_custom && (unit.from == Source::Option || up.from == Source::Option) {
        out.push(format!(
            "taken as {} and {} up, by the flags",
            unit.value, up.value
        ));
    }
    out
}

/// What a person should know of how the points were restored.
fn of_points(restored: &Restored<'_>) -> Vec<String> {
    let points = &restored.points;
    let mut out = Vec::new();
    let file = &restored.take.file;
    let rate = file.rate().unwrap_or(1.0);
    let seconds = |t: usize| t as f64 / rate;
    let bodies = points.body_gaps().iter();
    out.extend(bodies.map(|b| b.note([b.frames.start, b.frames.end].map(seconds))));
    let library = restored.take.run.settings.library();
    if library.is_some() && !knows_body(&restored.naming.model_names(&file.poses().points)) {
        out.push(NO_BODY.into());
    }
    if library.is_none() && points.body_gaps().iter().any(|b| b.is_unlike) {
        out.push("a library of other takes may have similar motion: see prior-train".into());
    }
    if let PointNaming::Map(map) = &restored.naming {
        out.push(format!("the points have the names of the map {}", map.name));
    }
    let is_noisy = |(_, own): &(String, Vec<(usize, String)>)| {
        let own: Vec<usize> = own.iter().map(|(p, _)| *p).collect();
        let run = &restored.take.run;
        run.are_keypoints(&labeled_poses(file.poses(), &own), file.format)
    };
    let people = people_by_name(&file.poses().points);
    if people.iter().any(is_noisy) {
        out.push(format!(
            "the joints of {} people are cleaned as markers are, and slow noise of video stays: \
             give a file of each person alone",
            people.len()
        ));
    }
    out.extend(left_alone(&seen(points)));
    match points.counts().exchanged {
        0 => {}
        n => out.push(format!(
            "left and right are exchanged ({} of points, frame by frame): put back",
            count(n, "pair")
        )),
    }
    if let Some(noise) = points.counts().doubtful_noise() {
        out.push(format!(
            "noise: at most {noise:.2} cm, which cannot be told from motion: it stays"
        ));
    }
    match points.counts().cuts {
        0 => {}
        n => out.push(format!(
            "the whole body jumps ({n}): nothing is joined across"
        )),
    }
    out
}

/// The names of the points that are seen: what was moved from a track leaves it empty.
fn seen(points: &Restoration<'_>) -> Vec<String> {
    let names = &points.source().columns.points;
    let is_seen =
        |p: usize| (0..points.xyz().nrows()).any(|t| point_at(points.xyz(), t, p).is_finite());
    let all = (0..names.len()).filter(|p| is_seen(*p));
    all.map(|p| names[p].clone()).collect()
}
