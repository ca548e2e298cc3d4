//! A capture whose tracks have no names gets them: from labeled takes of the person beside it, from
//! takes or a marker set that were given, else from other takes or the built-in set that fits best.

use super::labeled_beside::labels_of;
use super::name_source::{NamingSettings, Source, called};
use super::named_by::NamedBy;
use super::opened::Run;
use crate::io::MotionFile;
use crate::label::unlabeled::is_unlabeled;
use crate::label::{LabelReport, LabelSettings, NamedTracks, labeled_as, name_file};
use crate::pose::point_at;
use crate::pose::zeros::Zeros;
use crate::solve::MarkerSet;
use std::sync::LazyLock;

/// Labels and tracks fit each other at least so well where names are given. The right ones of 40
/// takes do by .91 to 1.00; those of cmu41 on a body of Plug-in Gait by .89, of sets that nothing
/// knows by at most .66.
const GOOD: f64 = 0.9;
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
pub(super) fn named(file: MotionFile, run: &Run<'_>) -> (MotionFile, Option<Named>) {
    let settings = run.settings;
    let (Some(labels), Some(tracks)) = (&settings.labels, tracks_without_names(&file)) else {
        return (file, None);
    };
    let takes = run.labeled_beside();
    let nothing = |fit, why: Option<String>| Named {
        by: NamedBy {
            by: None,
            takes: Vec::new(),
            fit,
            why,
            passed_over: takes.passed_over.clone(),
        },
        report: None,
    };
    if file.poses().takes().len() > 1 {
        let why = "it holds several takes; cut one out with the command `trim`";
        return (file, Some(nothing(0.0, Some(why.to_string()))));
    }
    let best = best_names(&file, tracks, &takes.sources, &settings.naming);
    let fit = best.as_ref().map_or(0.0, |(_, names)| names.fit);
    let Some((source, names)) = best.filter(|(_, names)| names.fit >= GOOD) else {
        return (file, Some(nothing(fit, None)));
    };
    let (is_theirs, own) = (names.are_like, names.like.files());
    let settings = LabelSettings {
        like: if is_theirs {
            names.like.clone()
        } else {
            labels.like.clone()
        },
        named_by_like: is_theirs,
        body: Some(source.model.clone()),
        ..labels.clone()
    };
    let by = NamedBy {
        by: Some(if is_theirs {
            called(&own)
        } else {
            source.by.clone()
        }),
        takes: if is_theirs { own } else { source.takes.clone() },
        fit,
        why: None,
        passed_over: takes.passed_over.clone(),
    };
    // What the file cannot hold loses nothing else.
    match labeled_as(&file, names, &settings) {
        Ok((file, report)) => {
            let report = Some(report);
            (file, Some(Named { by, report }))
        }
        Err(e) => (file, Some(nothing(fit, Some(e.to_string())))),
    }
}

/// The names that fit best, and what gives them: takes of the same person before all others, then
/// what was given, other takes beside the capture, and built-in sets.
fn best_names<'s>(
    file: &MotionFile,
    tracks: usize,
    beside: &'s [Source],
    given: &'s NamingSettings,
) -> Option<(&'s Source, NamedTracks)> {
    let named = |source: &'s Source| {
        let names = name_file(file, &*source.model, SURE, &source.like).ok()?;
        (!names.may_mix_people()).then_some((source, names))
    };
    let fit_of = |best: &Option<(&Source, NamedTracks)>| best.as_ref().map_or(0.0, |(_, n)| n.fit);
    let mut best: Option<(&Source, NamedTracks)> = None;
    for source in beside {
        // Postures alone, where the body that they are on does not fit.
        if source.is_second && fit_of(&best) >= GOOD {
            continue;
        }
        let found = named(source);
        if let Some((_, names)) = &found
            && names.are_like
            && names.fit >= GOOD
        {
            return found;
        }
        if fit_of(&found) > fit_of(&best) {
            best = found;
        }
    }
    for source in given.like.iter().chain(&given.set) {
        let found = named(source);
        if fit_of(&found) >= GOOD {
            return found;
        }
        if fit_of(&found) > fit_of(&best) {
            best = found;
        }
    }
    let mut sets: Vec<(f64, &Source)> = (BUILT_IN.iter())
        .map(|source| (source.best_fit(tracks), source))
        .collect();
    sets.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (at_best, source) in sets {
        let reached = fit_of(&best);
        if at_best < GOOD || at_best <= reached || reached >= BEST {
            break;
        }
        let found = named(source);
        if fit_of(&found) > reached {
            best = found;
        }
    }
    best
}

/// Whether a capture has no names.
pub(super) fn are_nameless(file: &MotionFile) -> bool {
    tracks_without_names(file).is_some()
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
