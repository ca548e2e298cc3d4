//! The labels of a table of points put right, take by take and person by person.

use super::body_exchanges::judged;
use super::changes::{Change, ChangeKind, changes, exchange_in_take, moves, wanted};
use super::label_model::LabelModel;
use super::label_settings::LabelSettings;
use super::labeled_take::LabeledTake;
use super::people::{Person, parted_by_distances, people_of_markers};
use super::repair::repair;
use super::sides::{SideBy, Unsure};
use super::templates::{Templates, WholeTake, WholeTakeKind};
use super::unlabeled::{is_unlabeled, labeled};
use crate::io::PointMove;
use crate::pose::repeated_frames::RepeatedFrames;
use crate::pose::zeros::Zeros;
use crate::pose::{Poses, point_at};
use ndarray::{ArrayView2, Axis, s};
use std::borrow::Cow;
use std::ops::Range;

/// What is done to the labels of a table; points and frames are those of the table.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Relabeling {
    pub changes: Vec<Change>,
    pub unsure: Vec<Unsure>,
    /// What is wrong in every frame of a take, and the take; some of it may be put right by
    /// changes.
    pub whole: Vec<(Range<usize>, WholeTake)>,
    /// What is to be known of people and labeled takes, a line each.
    pub notes: Vec<String>,
    /// Why labels were not checked, if they were not.
    pub unchecked: Option<&'static str>,
}

/// More labels are not checked: all pairs of them are compared.
const MOST_LABELS: usize = 500;
/// Fewer labels say nothing of each other.
const FEWEST_LABELS: usize = 4;

/// Finds what is wrong with the labels of some poses at `rate` frames a second, take by take.
pub fn relabel(poses: &Poses, rate: f64, settings: &LabelSettings) -> Relabeling {
    let poses = &*Zeros::emptied(poses);
    let mut out = Relabeling::default();
    if labeled(&poses.points).len() > MOST_LABELS {
        out.unchecked = Some("there are over 500 labels");
        return out;
    }
    let all_runs = poses.runs();
    for frames in poses.takes() {
        let own = |r: &&Range<usize>| r.start >= frames.start && r.end <= frames.end;
        let runs = all_runs.iter().filter(own);
        let runs: Vec<_> = runs
            .map(|r| r.start - frames.start..r.end - frames.start)
            .collect();
        let measured = RepeatedFrames::at_their_times(poses.xyz.slice(s![frames.clone(), ..]));
        out.add(&Part {
            poses,
            runs: measured.kept_runs(&runs),
            rate: measured.rate(rate),
            frames,
            measured,
            like: &settings.like,
            body: settings.body.as_deref(),
        });
    }
    let kept: Vec<(usize, Vec<usize>)> = (settings.keep.iter())
        .filter_map(|segment| {
            let point = poses.points.iter().position(|p| *p == segment.point)?;
            Some((point, segment.frames(poses, Some(rate))))
        })
        .collect();
    let is_kept = |change: &Change| {
        let is_of = |m: &PointMove, point: usize| m.from == point || m.to == Some(point);
        kept.iter().any(|(point, frames)| {
            let mut moves = change.moves.iter().filter(|m| is_of(m, *point));
            moves.any(|m| frames.iter().any(|t| m.frames.contains(t)))
        })
    };
    let is_wanted = |c: &Change| (settings.take_out || c.kind != ChangeKind::Out) && !is_kept(c);
    let has = |point: usize, t: usize| point_at(poses.xyz.view(), t, point).is_finite();
    out.changes = wanted(std::mem::take(&mut out.changes), is_wanted, has);
    if out.unchecked.is_none() {
        let is_kept = |point: usize, take: &Range<usize>| {
            let of = |(p, frames): &(usize, Vec<usize>)| {
                *p == point && frames.iter().any(|t| take.contains(t))
            };
            kept.iter().any(of)
        };
        out.check_whole_takes(poses, settings, is_kept);
    }
    out
}

/// The frames of a table that are one take.
struct Part<'a> {
    poses: &'a Poses,
    frames: Range<usize>,
    /// Those that do not repeat the one before: a track's next frame is the next of these.
    measured: RepeatedFrames,
    /// Ranges of consecutive measured frames, within them.
    runs: Vec<Range<usize>>,
    /// Rows a second: measured frames, or all where these keep their times.
    rate: f64,
    like: &'a Templates,
    body: Option<&'a dyn LabelModel>,
}

impl Part<'_> {
    /// The table's frames that show a range of measured ones.
    fn frames_of(&self, measured: &Range<usize>) -> Range<usize> {
        let frames = self.measured.frames(measured);
        frames.start + self.frames.start..frames.end + self.frames.start
    }
}

impl Relabeling {
    /// All positions that are another label's, or none's.
    pub(crate) fn moves(&self) -> Vec<PointMove> {
        (self.changes.iter())
            .flat_map(|c| c.moves.iter().cloned())
            .collect()
    }

    /// Adds what is wrong in every frame of a take once these changes are made. Labels that are
    /// exchanged in takes of the same people are put right where that is sure, and those that body
    /// and mirror image say are, unless one `is_kept` in a take.
    fn check_whole_takes(
        &mut self,
        poses: &Poses,
        settings: &LabelSettings,
        is_kept: impl Fn(usize, &Range<usize>) -> bool,
    ) {
        let mut poses = Cow::Borrowed(poses);
        if !self.changes.is_empty() {
            PointMove::make_all(&self.moves(), &mut poses.to_mut().xyz);
        }
        for take in poses.takes() {
            let ordered = exchange_as_ordered(&poses, &settings.exchange);
            for pair in ordered.chunks_exact(2) {
                exchange_in_take(&mut self.changes, pair, &take, SideBy::Given);
                let moved = |from, to| PointMove {
                    from,
                    to: Some(to),
                    frames: take.clone(),
                };
                let moves = [moved(pair[0], pair[1]), moved(pair[1], pair[0])];
                PointMove::make_all(&moves, &mut poses.to_mut().xyz);
            }
            let (found, notes) = settings.like.check(&poses, &take);
            self.notes.extend(notes);
            let xyz = poses.xyz.slice(s![take.clone(), ..]);
            let people = people_of_markers(&poses.points, xyz);
            let mut found = judged(found, &people, (&poses.points, xyz), settings);
            // What somebody ordered stands.
            found.retain(|whole| !whole.points.iter().any(|p| ordered.contains(p)));
            // Pairs are those of a body whose hand is right.
            let has_hand = found.iter().any(|w| w.kind == WholeTakeKind::Hand);
            for mut whole in found {
                let is_pair = match whole.kind {
                    WholeTakeKind::Hand | WholeTakeKind::Body => true,
                    WholeTakeKind::Exchanged => whole.points.len() == 2 && !has_hand,
                    WholeTakeKind::EitherSide => false,
                };
                let is_free = !whole.points.iter().any(|p| is_kept(*p, &take));
                let may_be = settings.like.are_same_person() || whole.kind == WholeTakeKind::Body;
                if may_be && is_pair && is_free && whole.is_sure {
                    let by = match whole.kind {
                        WholeTakeKind::Body => SideBy::Body,
                        _ => SideBy::Template,
                    };
                    exchange_in_take(&mut self.changes, &whole.points, &take, by);
                    whole.is_put_back = true;
                }
                self.whole.push((take.clone(), whole));
            }
        }
        self.notes.dedup();
    }

    /// Adds what is wrong in one take, person by person.
    fn add(&mut self, take: &Part<'_>) {
        let points = &take.poses.points;
        let all = 0..points.len();
        let loose: Vec<usize> = all.filter(|p| is_unlabeled(&points[*p])).collect();
        let xyz = take.poses.xyz.slice(s![take.frames.clone(), ..]);
        let mut xyz = take.measured.rows(xyz);
        let people = people_of_markers(points, xyz.view());
        self.notes.extend(parted_by_distances(points, &people));
        for person in people {
            if person.points.len() < FEWEST_LABELS {
                continue;
            }
            for taken in self.add_person(take, xyz.view(), &person, &loose) {
                // What is one person's is no other's.
                (0..3).for_each(|c| {
                    let own = s![taken.frames.clone(), 3 * taken.from + c];
                    xyz.slice_mut(own).fill(f64::NAN);
                });
            }
        }
    }

    /// Adds what is wrong with some labels; the fragments of `loose` tracks that are joined to
    /// them, in measured frames of the take.
    fn add_person(
        &mut self,
        take: &Part<'_>,
        xyz: ArrayView2<'_, f64>,
        person: &Person,
        loose: &[usize],
    ) -> Vec<PointMove> {
        let labels = &person.points;
        let points = &take.poses.points;
        let order: Vec<usize> = labels.iter().chain(loose).copied().collect();
        let columns: Vec<usize> = order.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        let names: Vec<String> = order
            .iter()
            .map(|p| person.own_name(&points[*p]).to_string())
            .collect();
        let xyz = xyz.select(Axis(1), &columns);
        let found = repair(LabeledTake {
            names: &names,
            labels: labels.len(),
            xyz: xyz.view(),
            runs: &take.runs,
            rate: take.rate,
            person: &person.name,
            like: take.like,
            body: take.body,
        });
        let Some(found) = found else {
            self.unchecked = Some(
                "most pieces of tracks have under 5 frames, or there are too few frames a second",
            );
            return Vec::new();
        };
        let mut taken = Vec::new();
        for change in changes(moves(&found.fragments), labels.len()) {
            let nats = found.nats(&change, &xyz, take.rate);
            let side = found.side(&change);
            // A gap between two fragments stays where it is: another may be there.
            let fragments = change.moves.iter().flat_map(|step| {
                let is_of = |p: &&PointMove| {
                    (p.from, p.to) == (step.from, step.to)
                        && step.frames.start <= p.frames.start
                        && p.frames.end <= step.frames.end
                };
                found.fragments.iter().filter(is_of)
            });
            let fragments: Vec<&PointMove> = fragments.collect();
            let joined = fragments.iter().filter(|m| m.from >= labels.len());
            taken.extend(joined.map(|m| PointMove {
                from: order[m.from],
                ..(*m).clone()
            }));
            let moved = fragments.iter().map(|m| PointMove {
                from: order[m.from],
                to: m.to.map(|to| order[to]),
                frames: take.frames_of(&m.frames),
            });
            self.changes.push(Change {
                kind: change.kind,
                frames: take.frames_of(&change.frames),
                tracks: change.tracks.iter().map(|t| order[*t]).collect(),
                moves: moved.collect(),
                nats,
                side,
            });
        }
        self.unsure.extend(found.unsure.iter().map(|u| Unsure {
            labels: u.labels.iter().map(|l| order[*l]).collect(),
            frames: u.frames.iter().map(|r| take.frames_of(r)).collect(),
            is_part: u.is_part,
        }));
        taken
    }
}

/// The points that somebody ordered to be exchanged, pair by pair: of the names as they stand, or
/// of each person's own.
fn exchange_as_ordered(poses: &Poses, pairs: &[[String; 2]]) -> Vec<usize> {
    let points = &poses.points;
    let at = |name: &str| points.iter().position(|p| p == name);
    let of_pair = |[a, b]: &[String; 2]| {
        if let (Some(a), Some(b)) = (at(a), at(b)) {
            return vec![a, b];
        }
        let own = |p: &String| {
            let person = p.strip_suffix(a.as_str())?;
            Some([at(p)?, at(&format!("{person}{b}"))?])
        };
        points.iter().filter_map(own).flatten().collect()
    };
    pairs.iter().flat_map(of_pair).collect()
}
