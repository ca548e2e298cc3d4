//! Tracks without names: the people whom they are of, one found after another, and the label of
//! each track.
//!
//! Each person is found among the tracks that are left. Who leaves the cameras' view and returns is
//! found twice, and is one whose distances are the same. Then all are fitted together, and each
//! track is the label of whom it stays nearest to.

use super::hosts::Hosts;
use super::label_model::LabelModel;
use super::loose_tracks::{LooseTracks, PathLabels};
use super::marker_distances::Distances;
use super::named_tracks::NamedTracks;
use super::naming::{Naming, Run, count_labels};
use super::templates::Templates;
use super::tuning::nameless::*;
use super::tuning::naming::{FEWEST_LABELS, MOSTLY_SURE, SLOPE};
use crate::Result;
use crate::pose::Poses;
use crate::pose::zeros::Zeros;
use std::ops::Range;
use std::sync::Arc;

/// Names the tracks of a take at `rate` frames a second, none of which has a label; what is less
/// than `sure` (0 to 1) keeps none. Of several people, each label has its person's name before it,
/// as the labeled takes of `like` have it: `Ann:LFHD`.
///
/// # Errors
/// Errors of the model; no body is found.
pub fn name_tracks(
    poses: &Poses,
    rate: f64,
    model: &dyn LabelModel,
    sure: f64,
    like: &Templates,
) -> Result<NamedTracks> {
    let poses = &*Zeros::emptied(poses);
    let tracks = LooseTracks::new(poses.xyz.view(), &poses.runs(), rate);
    let naming = Naming::new(&tracks, model);
    let none = "no body with these labels is found in its tracks; is it another marker set, or \
                does another axis point up (the option `up`)?";
    let (naming, best) = named_bodies(naming)?.ok_or(none)?;
    let least = sure.max(0.5);
    let mut labels = best.sure(&tracks, SLOPE * (least / (1.0 - least)).ln());
    labels
        .iter_mut()
        .for_each(|label| *label = label.filter(|l| !naming.is_one_of_several(*l)));
    let people = naming.positions(&labels);
    let like_people = like.of_people(naming.set(), &people);
    let are_like = !like_people.is_empty();
    // Of other people, postures alone say little where many labels are not found.
    let most = MOSTLY_SURE * naming.set().len() as f64;
    if model.is_of_neighbors() && !are_like && (count_labels(&labels) as f64) < most {
        return Err(none.into());
    }
    let hosts = Hosts::new(&tracks, &labels, naming.labels());
    // A label without a column of its own has nowhere to go.
    labels
        .iter_mut()
        .for_each(|label| *label = label.filter(|l| hosts.has(*l)));
    let moves = hosts.moves(&tracks, &labels);
    let names = naming.names(&labels, like);
    let mut named = NamedTracks::new(moves, hosts.names(&names), poses);
    named.are_like = are_like;
    named.like = Arc::new(like_people);
    named.tell(
        &tracks,
        [&labels, &best.labels],
        &naming,
        (&names, &poses.points),
    );
    Ok(named)
}

/// The people whom the tracks are of, and their labels; `None` where nobody is found.
fn named_bodies(one: Naming<'_>) -> Result<Option<(Naming<'_>, Run)>> {
    let mut left = one.clone();
    let mut found: Vec<Run> = Vec::new();
    while found.len() < MOST_PEOPLE && (found.is_empty() || has_body(&left)) {
        let Some(mut run) = left.one_body()? else {
            break;
        };
        keep_one(&left, &mut run.labels);
        let labels = count_labels(&run.labels);
        if !found.is_empty() && 2 * labels < left.set().len() {
            break;
        }
        let taken = run.labels.iter().zip(&mut left.is_open);
        taken.for_each(|(label, is_open)| *is_open &= label.is_none());
        found.push(run);
    }
    if found.len() < 2 {
        return Ok(found.pop().map(|run| (one, run)));
    }
    let people = returned(&one, found.into_iter().map(|run| run.labels).collect());
    let all = Naming {
        people: people.len(),
        ..one
    };
    let width = all.set().len();
    let label_of = |path: usize| {
        let own = people.iter().enumerate();
        own.filter_map(|(k, labels)| Some(k * width + labels[path]?))
            .next()
    };
    let labels = (0..all.is_open.len()).map(label_of).collect();
    let run = all.fitted(labels, all.rounds())?;
    Ok(Some((all, run)))
}

/// Takes the labels off the tracks of others who come before or after the one that is seen longest:
/// each may have been the label of the frames in which nobody else is there.
fn keep_one(naming: &Naming<'_>, labels: &mut PathLabels) {
    let tracks = naming.tracks;
    let seen = Seen::new(naming, labels);
    let away = (AWAY * tracks.rate) as usize;
    let mut spans: Vec<Range<usize>> = Vec::new();
    for t in (0..seen.frames.len()).filter(|t| seen.frames[*t]) {
        match spans.last_mut() {
            Some(last) if t <= last.end + away => last.end = t + 1,
            _ => spans.push(t..t + 1),
        }
    }
    let Some(longest) = spans.iter().max_by_key(|s| s.len()).cloned() else {
        return;
    };
    let positions = tracks.positions(labels, naming.set().len());
    let within =
        |span: &Range<usize>| Distances::measure(positions.slice(ndarray::s![span.clone(), ..]));
    let own = within(&longest);
    let is_other = |span: &&Range<usize>| {
        let others = within(span);
        own.off(|a, b| others.between(a, b))
            .is_some_and(|off| off > SAME)
    };
    let others: Vec<Range<usize>> = spans.iter().filter(is_other).cloned().collect();
    for (path, label) in labels.iter_mut().enumerate() {
        let middle = tracks.middle(path);
        if others.iter().any(|span| span.contains(&middle)) {
            *label = None;
        }
    }
}

/// Whether the tracks that are left may be of another person: long ones, so many at a time.
fn has_body(left: &Naming<'_>) -> bool {
    let tracks = left.tracks;
    let fewest = FEWEST_LABELS.max(left.set().len() / FEWEST_SHARE);
    let longest = (LONG * tracks.rate) as usize;
    let is_seen = |t: &usize| {
        let long = left
            .seen(*t)
            .filter(|(path, _)| tracks.frames(*path) >= longest);
        long.count() >= fewest
    };
    let step = ((STEP * tracks.rate) as usize).max(1);
    let frames = (0..tracks.xyz.nrows()).step_by(step).filter(is_seen);
    frames.count() * step >= longest
}

/// People, those that are one put together: never seen at a time, of the same distances.
fn returned(one: &Naming<'_>, mut people: Vec<PathLabels>) -> Vec<PathLabels> {
    let mut k = 1;
    while k < people.len() {
        let bodies: Vec<Seen> = people.iter().map(|p| Seen::new(one, p)).collect();
        let off = |earlier: usize| bodies[earlier].off(&bodies[k]);
        let near = (0..k).filter_map(|earlier| Some((off(earlier)?, earlier)));
        let best = near.min_by(|a, b| a.0.total_cmp(&b.0));
        match best.filter(|(off, _)| *off <= SAME) {
            Some((_, earlier)) => {
                let late = people.remove(k);
                let both = people[earlier].iter_mut().zip(late);
                both.for_each(|(early, late)| *early = early.or(late));
            }
            None => k += 1,
        }
    }
    people
}

/// A person as seen.
struct Seen {
    /// The frames in which many of the labels are seen.
    frames: Vec<bool>,
    distances: Distances,
}

impl Seen {
    fn new(one: &Naming<'_>, labels: &PathLabels) -> Seen {
        let positions = one.tracks.positions(labels, one.set().len());
        let fewest = count_labels(labels).div_ceil(FEWEST_SHARE);
        let is_seen = |row: ndarray::ArrayView1<'_, f64>| {
            row.iter().filter(|v| v.is_finite()).count() >= 3 * fewest
        };
        Seen {
            frames: positions.rows().into_iter().map(is_seen).collect(),
            distances: Distances::measure(positions.view()),
        }
    }

    /// How far apart the steady distances of two people are, cm, the median; `None` where both are
    /// seen at a time, or few distances are known.
    fn off(&self, other: &Seen) -> Option<f64> {
        let mut both = self.frames.iter().zip(&other.frames);
        let apart = !both.any(|(a, b)| *a && *b);
        apart.then(|| self.distances.off(|a, b| other.distances.between(a, b)))?
    }
}
