//! A capture whose tracks have no names gets them: from labeled takes beside it, from those that
//! were given, from a marker set that was given or a built-in one, whichever fits first.

use super::labeled_beside::labels_of;
use super::name_source::Source;
use super::named_by::NamedBy;
use super::opened::Run;
use crate::Result;
use crate::io::MotionFile;
use crate::label::unlabeled::is_unlabeled;
use crate::label::{LabelReport, LabelSettings, NamedTracks, labeled_as, name_file};
use crate::pose::point_at;
use crate::pose::zeros::Zeros;
use crate::solve::MarkerSet;
use std::sync::LazyLock;

/// Labels and tracks fit each other as well as this where names are given: right ones of 60 takes
/// .93 to 1.00, wrong ones at most .76.
const GOOD: f64 = 0.88;
/// A built-in set that fits so well is taken before others are tried.
const BEST: f64 = 0.97;
/// Confidence from which on a label is given.
const SURE: f64 = 0.9;
/// Fewer tracks at a time are no body; with as many labels a take has names.
const FEWEST: usize = 8;
/// Frames that are looked at for how many tracks are seen at a time.
const LOOKED_AT: usize = 40;

/// The built-in sets.
static BUILT_IN: LazyLock<Vec<Source>> = LazyLock::new(|| {
    let sets = MarkerSet::shipped().iter();
    sets.filter_map(|set| Source::of_set(set).ok()).collect()
});

/// What became of a capture without names.
pub(super) struct Named {
    pub by: NamedBy,
    /// The labels as they were put right then, where it got some.
    pub report: Option<LabelReport>,
}

/// Names the tracks of a capture that has no names; the capture as it is where it has some, or
/// where nothing fits.
///
/// # Errors
/// The file cannot hold the names.
pub(super) fn named(file: MotionFile, run: &Run<'_>) -> Result<(MotionFile, Option<Named>)> {
    let settings = run.settings;
    let (Some(labels), Some(tracks)) = (&settings.labels, tracks_without_names(&file)) else {
        return Ok((file, None));
    };
    let takes = run.labeled_beside();
    let given = settings.naming.like.iter().chain(&settings.naming.set);
    let mut best: Option<(&Source, NamedTracks)> = None;
    let fit_of = |best: &Option<(&Source, NamedTracks)>| best.as_ref().map_or(0.0, |(_, n)| n.fit);
    for source in takes.sources.iter().chain(given) {
        try_source(&file, source, &mut best);
        if fit_of(&best) >= GOOD {
            break;
        }
    }
    if fit_of(&best) < GOOD {
        let mut sets: Vec<(f64, &Source)> = (BUILT_IN.iter())
            .map(|source| (source.best_fit(tracks), source))
            .collect();
        sets.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (at_best, source) in sets {
            if at_best < GOOD || at_best <= fit_of(&best) || fit_of(&best) >= BEST {
                break;
            }
            try_source(&file, source, &mut best);
        }
    }
    let fit = fit_of(&best);
    let passed_over = takes.passed_over.clone();
    let Some((source, names)) = best.filter(|(_, names)| names.fit >= GOOD) else {
        let none = NamedBy {
            by: None,
            fit,
            passed_over,
        };
        let named = Named {
            by: none,
            report: None,
        };
        return Ok((file, Some(named)));
    };
    let is_theirs = names.are_like;
    let settings = LabelSettings {
        like: if is_theirs {
            source.like.clone()
        } else {
            labels.like.clone()
        },
        are_by_like: is_theirs,
        body: Some(source.model.clone()),
        ..labels.clone()
    };
    let by = NamedBy {
        by: Some(source.by.clone()),
        fit,
        passed_over,
    };
    let (file, report) = labeled_as(&file, names, &settings)?;
    let report = Some(report);
    Ok((file, Some(Named { by, report })))
}

/// Names the tracks by a source, where that fits better than what is known.
fn try_source<'s>(
    file: &MotionFile,
    source: &'s Source,
    best: &mut Option<(&'s Source, NamedTracks)>,
) {
    let Ok(names) = name_file(file, &*source.model, SURE, &source.like) else {
        return;
    };
    if best.as_ref().is_none_or(|(_, known)| names.fit > known.fit) {
        *best = Some((source, names));
    }
}

/// How many tracks of a capture without names are seen at a time, few frames aside; `None` where
/// it has names, or too few tracks for a body.
fn tracks_without_names(file: &MotionFile) -> Option<usize> {
    let poses = file.poses();
    let loose: Vec<usize> = (0..poses.points.len())
        .filter(|p| is_unlabeled(&poses.points[*p]))
        .collect();
    if file.motion().is_some() || loose.len() < FEWEST || labels_of(poses).len() >= FEWEST {
        return None;
    }
    let poses = &*Zeros::emptied(poses);
    let is_seen = |t: usize, p: &&usize| point_at(poses.xyz.view(), t, **p).is_finite();
    let seen = |t: usize| loose.iter().filter(|p| is_seen(t, p)).count();
    let step = poses.frames().div_ceil(LOOKED_AT).max(1);
    let mut counts: Vec<usize> = (0..poses.frames()).step_by(step).map(seen).collect();
    counts.sort_unstable();
    let most = *counts.get(9 * counts.len() / 10)?;
    (most >= FEWEST).then_some(most)
}
