//! Completing: what a capture did not see is filled in, what it saw is not changed.
//!
//! Frame by frame, the model answers the missing points from the seen ones. In a take, that answer is then carried over
//! to its neighbours: at both ends of a gap the points were seen, so the answer's error there is known; it is predicted
//! into the gap as a Gaussian process whose correlation falls off over a quarter of a second and over four.

use super::bound_model::BoundModel;
use super::frame_restorer::{RestoredFrame, RestoredFrames};
use super::outliers::{Outliers, leave_out};
use crate::numeric::parallel;
use crate::pose::Observation;
use crate::pose::Status;
use crate::prior::EXACT_VARIANCE;
use glam::DVec3;
use ndarray::{Array2, ArrayView2, s};
use std::collections::BTreeMap;
use std::ops::Range;

/// Frames restored by one piece of parallel work.
const CHUNK: usize = 8;
/// What is seen in part for no longer than this, in seconds, is told better by its neighbours in time.
const BRIEF: f64 = 0.25;

/// What to do where.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Complete {
    /// Gaps longer than this (seconds) stay empty.
    pub max_gap: Option<f64>,
    /// Also change points that cannot be where they were captured.
    pub overwrite: bool,
}

/// Completes frames each by itself (in the model's order): no time, no body but the frame's own.
pub fn frames(bound: &BoundModel, xyz: ArrayView2<'_, f64>) -> RestoredFrames {
    let answers = parallel::map_chunks(xyz.nrows(), CHUNK, |range| {
        range
            .map(|t| {
                let y = xyz.row(t).to_vec();
                if bound.is_whole(&y) {
                    return (Answer::Whole, f64::NAN);
                }
                let frame = xyz.slice(s![t..t + 1, ..]);
                let adapted = bound.prior_for(frame, 0.0);
                let rigid = bound.treatment_for(&adapted, frame, 0.0);
                let noise = noise_of(&y, &[]);
                let restorer = bound.restorer(&adapted).with_rigid_model(&rigid);
                match restorer.restore(&y, &noise) {
                    Some(found) => {
                        let unlike = unlike(&restorer, &y, &found);
                        (Answer::Found(found), unlike)
                    }
                    None => (Answer::TooLittle, f64::NAN),
                }
            })
            .collect::<Vec<_>>()
    });
    let mut out = RestoredFrames::of(xyz.to_owned());
    for (t, (answer, unlike)) in answers.into_iter().flatten().enumerate() {
        fill(bound, &mut out, t, &answer, &[], None, false);
        out.unlike[t] = unlike;
    }
    out
}

/// What became of a frame.
enum Answer {
    /// Nothing was missing.
    Whole,
    TooLittle,
    Found(RestoredFrame),
}

/// How unlike all that was seen a completed frame is, nats; what it lacks still is taken from the answer.
fn unlike(restorer: &super::FrameRestorer<'_>, frame: &[f64], found: &RestoredFrame) -> f64 {
    let all = frame.iter().zip(&found.mean);
    let pose: Vec<f64> = all
        .map(|(y, m)| if y.is_finite() { *y } else { *m })
        .collect();
    restorer.unlike(&pose, &found.placement)
}

/// EXACT_VARIANCE where a number is seen and its point is not suspected; infinite elsewhere.
fn noise_of(y: &[f64], outliers: &[usize]) -> Vec<f64> {
    let seen = |i: usize| y[i].is_finite() && !outliers.contains(&(i / 3));
    (0..y.len())
        .map(|i| {
            if seen(i) {
                EXACT_VARIANCE
            } else {
                f64::INFINITY
            }
        })
        .collect()
}

/// Writes an answer's missing numbers (with `correction` added to each point) and the frame's statuses.
fn fill(
    bound: &BoundModel,
    out: &mut RestoredFrames,
    t: usize,
    answer: &Answer,
    outliers: &[usize],
    correction: Option<&[(DVec3, f64)]>,
    overwrite: bool,
) {
    let mut lacked = false;
    for p in (0..out.points()).filter(|&p| bound.in_table(p).is_some()) {
        let missing: Vec<usize> = (3 * p..3 * p + 3)
            .filter(|&i| out.xyz[[t, i]].is_nan())
            .collect();
        let suspect = outliers.contains(&p);
        if missing.is_empty() && !suspect {
            continue;
        }
        // A model of another unit may answer with what is no number: that is no answer.
        let is_told =
            |found: &&RestoredFrame| found.mean[3 * p..3 * p + 3].iter().all(|v| v.is_finite());
        let found = match answer {
            Answer::Found(found) => Some(found).filter(is_told),
            _ => None,
        };
        let Some(found) = found else {
            lacked = true;
            let status = if missing.is_empty() {
                Status::Rejected
            } else {
                Status::Unknown
            };
            out.set(t, p, status, f64::NAN);
            continue;
        };
        let (add, share) = correction.map_or((DVec3::ZERO, 1.0), |c| c[p]);
        let sd = found.sd[p] * share;
        if suspect {
            out.set(t, p, Status::Rejected, sd);
            if !overwrite {
                continue;
            }
        } else {
            out.set(t, p, Status::Inferred, sd);
        }
        for axis in 0..3 {
            let i = 3 * p + axis;
            if suspect || missing.contains(&i) {
                out.xyz[[t, i]] = found.mean[i] + add[axis];
            }
        }
    }
    out.too_little += usize::from(lacked && !matches!(answer, Answer::Whole));
}

/// Completes one take: `runs` are the stretches of frames that follow one another, `rate` frames a second.
pub fn take(
    bound: &BoundModel,
    xyz: ArrayView2<'_, f64>,
    runs: &[Range<usize>],
    rate: f64,
    settings: Complete,
    done: &(dyn Fn(usize) + Sync),
) -> RestoredFrames {
    let outliers = Outliers::find(bound, xyz, runs, rate, None).points;
    let adapted = bound.prior_for(xyz, 0.0);
    let rigid = bound.treatment_for(&adapted, xyz, 0.0);
    let restorer = bound.restorer(&adapted).with_rigid_model(&rigid);
    // What counts: the numbers seen, without the suspects.
    let mut counted = xyz.to_owned();
    leave_out(&mut counted, &outliers);
    let parts = brief_parts(&counted, runs, rate);
    leave_out(&mut counted, &parts);
    let gaps: Vec<Gap> = runs.iter().flat_map(|run| gaps_of(&counted, run)).collect();
    let answers: Vec<Answer> = parallel::map_chunks(xyz.nrows(), CHUNK, |range| {
        let out: Vec<Answer> = range
            .clone()
            .map(|t| {
                let y = counted.row(t).to_vec();
                if bound.is_whole(&y) {
                    return Answer::Whole;
                }
                restorer
                    .restore(&y, &noise_of(&y, &[]))
                    .map_or(Answer::TooLittle, Answer::Found)
            })
            .collect();
        done(range.len());
        out
    })
    .into_iter()
    .flatten()
    .collect();
    let errors = errors_at_ends(&restorer, &counted, &gaps);
    let mut out = RestoredFrames::of(xyz.to_owned());
    let corrections = corrections(&counted, &answers, &gaps, &errors, rate, bound.points());
    for (t, answer) in answers.iter().enumerate() {
        fill(
            bound,
            &mut out,
            t,
            answer,
            &outliers[t],
            corrections.get(&t).map(Vec::as_slice),
            true,
        );
    }
    converge(&mut out, &counted, &gaps, runs, rate);
    for (t, points) in parts.iter().enumerate() {
        let seen = points.iter().flat_map(|p| 3 * p..3 * p + 3);
        for i in seen.filter(|&i| xyz[[t, i]].is_finite()) {
            out.xyz[[t, i]] = xyz[[t, i]];
        }
    }
    out.unlike = parallel::map_chunks(answers.len(), CHUNK, |range| {
        let of = |t: usize| match &answers[t] {
            Answer::Found(found) => unlike(&restorer, &out.xyz.row(t).to_vec(), found),
            Answer::Whole | Answer::TooLittle => f64::NAN,
        };
        range.map(of).collect::<Vec<_>>()
    })
    .concat();
    if !settings.overwrite {
        // The answers stood in for the rejected values while their neighbours were settled.
        for (t, points) in outliers.iter().enumerate() {
            for i in points.iter().flat_map(|p| 3 * p..3 * p + 3) {
                out.xyz[[t, i]] = xyz[[t, i]];
            }
        }
    }
    if let Some(longest) = settings.max_gap {
        for gap in gaps
            .iter()
            .filter(|g| g.frames.len() as f64 / rate > longest * (1.0 + 1e-9))
        {
            for t in gap.frames.clone() {
                if xyz
                    .slice(s![t, 3 * gap.point..3 * gap.point + 3])
                    .iter()
                    .all(|v| v.is_finite())
                {
                    continue;
                }
                out.xyz
                    .slice_mut(s![t, 3 * gap.point..3 * gap.point + 3])
                    .assign(&xyz.slice(s![t, 3 * gap.point..3 * gap.point + 3]));
                out.set(t, gap.point, Status::Unknown, f64::NAN);
            }
        }
        // A frame that got nothing is not judged.
        for t in 0..out.xyz.nrows() {
            let got =
                |p: usize| matches!(out.of_point(t, p).0, Status::Inferred | Status::Rejected);
            if !(0..out.points()).any(got) {
                out.unlike[t] = f64::NAN;
            }
        }
    }
    out
}

/// The points of each frame that are seen in part among whole ones, for a while and whole before and after: their neighbours in
/// time tell more than a part does, which costs a descent a frame. Of what is seen in part for longer, the part tells more.
fn brief_parts(counted: &Array2<f64>, runs: &[Range<usize>], rate: f64) -> Vec<Vec<usize>> {
    let among_whole = |row: ndarray::ArrayView1<'_, f64>| {
        let y = row.to_vec();
        let noise = noise_of(&y, &[]);
        let seen = Observation {
            values: &y,
            variance: &noise,
        };
        seen.removable_partial_points()
    };
    let parts: Vec<Vec<usize>> = counted.rows().into_iter().map(among_whole).collect();
    let mut brief = vec![Vec::new(); parts.len()];
    for gap in runs.iter().flat_map(|run| gaps_of(counted, run)) {
        let between = gap.before.is_some() && gap.after.is_some();
        if between && gap.frames.len() as f64 <= BRIEF * rate {
            let here = gap.frames.filter(|&t| parts[t].contains(&gap.point));
            here.for_each(|t| brief[t].push(gap.point));
        }
    }
    brief
}

/// A point missing (or suspected) for some frames on end.
#[derive(Debug, Clone, PartialEq)]
struct Gap {
    point: usize,
    frames: Range<usize>,
    /// The frame before, where the point was seen.
    before: Option<usize>,
    /// The frame after, where the point was seen.
    after: Option<usize>,
}

fn gaps_of(counted: &Array2<f64>, run: &Range<usize>) -> Vec<Gap> {
    let mut gaps = Vec::new();
    for point in 0..counted.ncols() / 3 {
        let missing = |t: usize| (3 * point..3 * point + 3).any(|i| counted[[t, i]].is_nan());
        let mut t = run.start;
        while t < run.end {
            if !missing(t) {
                t += 1;
                continue;
            }
            let start = t;
            while t < run.end && missing(t) {
                t += 1;
            }
            gaps.push(Gap {
                point,
                frames: start..t,
                before: (start > run.start).then(|| start - 1),
                after: (t < run.end).then_some(t),
            });
        }
    }
    gaps
}

/// (frame, points hidden there) -> the answer's errors in the directions of its placement.
type Errors = BTreeMap<(usize, Vec<usize>), Option<Vec<DVec3>>>;

/// The points that are missing at a frame.
fn hidden(counted: &Array2<f64>, t: usize) -> Vec<usize> {
    (0..counted.ncols() / 3)
        .filter(|&p| (3 * p..3 * p + 3).any(|i| counted[[t, i]].is_nan()))
        .collect()
}

/// The frame where a gap's point is seen and the one beside it whose points are to be hidden there.
fn ends(gap: &Gap) -> [Option<(usize, usize)>; 2] {
    [
        gap.before.map(|b| (b, gap.frames.start)),
        gap.after.map(|a| (a, gap.frames.end - 1)),
    ]
}

/// How wrong the answer is where the truth is known: at the ends of gaps, with the points of the gap hidden.
fn errors_at_ends(
    restorer: &super::FrameRestorer<'_>,
    counted: &Array2<f64>,
    gaps: &[Gap],
) -> Errors {
    let mut keys: Vec<(usize, Vec<usize>)> = gaps
        .iter()
        .flat_map(ends)
        .flatten()
        .map(|(frame, beside)| (frame, hidden(counted, beside)))
        .collect();
    keys.sort();
    keys.dedup();
    let found = parallel::map_chunks(keys.len(), 1, |range| {
        let (frame, hide) = &keys[range.start];
        let truth = counted.row(*frame).to_vec();
        let noise = noise_of(&truth, hide);
        let found = restorer.restore(&truth, &noise)?;
        let back = found.placement.rotation.transpose();
        let error = |p: usize| {
            back * (DVec3::from_slice(&truth[3 * p..]) - DVec3::from_slice(&found.mean[3 * p..]))
        };
        Some((0..truth.len() / 3).map(error).collect())
    });
    keys.into_iter().zip(found).collect()
}

/// How alike the answer's errors are `seconds` apart: part of them passes in a quarter of a second, part in four.
fn likeness(seconds: f64) -> f64 {
    0.5 * (-seconds / 0.25).exp() + 0.5 * (-seconds / 4.0).exp()
}

/// For each frame with a gap, what to add to each point, and the share of its standard deviation that is left.
fn corrections(
    counted: &Array2<f64>,
    answers: &[Answer],
    gaps: &[Gap],
    errors: &Errors,
    rate: f64,
    points: usize,
) -> BTreeMap<usize, Vec<(DVec3, f64)>> {
    let mut out: BTreeMap<usize, Vec<(DVec3, f64)>> = BTreeMap::new();
    for gap in gaps {
        let error = |end: Option<(usize, usize)>| {
            let (frame, beside) = end?;
            let hide = hidden(counted, beside);
            errors
                .get(&(frame, hide))?
                .as_ref()
                .map(|e| e[gap.point])
                .filter(|e| e.is_finite())
        };
        let [before, after] = ends(gap).map(error);
        let whole = likeness((gap.frames.len() + 1) as f64 / rate);
        for t in gap.frames.clone() {
            let Answer::Found(found) = &answers[t] else {
                continue;
            };
            let a = likeness((t + 1 - gap.frames.start) as f64 / rate);
            let b = likeness((gap.frames.end - t) as f64 / rate);
            // The best linear prediction from the ends that are known.
            let (wa, wb) = match (before, after) {
                (Some(_), Some(_)) => {
                    let det = 1.0 - whole * whole;
                    ((a - whole * b) / det, (b - whole * a) / det)
                }
                (Some(_), None) => (a, 0.0),
                (None, Some(_)) => (0.0, b),
                (None, None) => continue,
            };
            let add = before.unwrap_or(DVec3::ZERO) * wa + after.unwrap_or(DVec3::ZERO) * wb;
            // The errors' likeness is itself a guess: never more than nine tenths of them are taken to be known.
            let left = (1.0 - wa * a - wb * b).max(0.01).sqrt();
            out.entry(t)
                .or_insert_with(|| vec![(DVec3::ZERO, 1.0); points])[gap.point] =
                (found.placement.rotation * add, left);
        }
    }
    out
}

/// Takes the frame-to-frame jitter out of what was filled in: a Gaussian of 25 ms over the filled and seen around.
fn converge(
    out: &mut RestoredFrames,
    counted: &Array2<f64>,
    gaps: &[Gap],
    runs: &[Range<usize>],
    rate: f64,
) {
    let sigma = 0.025 * rate;
    let reach = (3.0 * sigma).floor() as usize;
    if reach == 0 {
        return;
    }
    let before = out.xyz.clone();
    for gap in gaps {
        let Some(run) = runs.get(runs.partition_point(|r| r.end <= gap.frames.start)) else {
            continue;
        };
        for t in gap.frames.clone() {
            let status = out.status[t * (before.ncols() / 3) + gap.point];
            if !matches!(status, Status::Inferred | Status::Rejected) {
                continue;
            }
            // Never past either end of the run, and symmetric, so that a straight line stays one.
            let reach = reach.min(t - run.start).min(run.end - 1 - t);
            // A coordinate that was seen stays as it was (2-D input).
            for i in (3 * gap.point..3 * gap.point + 3).filter(|&i| counted[[t, i]].is_nan()) {
                let (mut sum, mut weight) = (0.0, 0.0);
                for k in t - reach..=t + reach {
                    let w = (-0.5 * ((k as f64 - t as f64) / sigma).powi(2)).exp();
                    sum += w * before[[k, i]];
                    weight += w;
                }
                if (sum / weight).is_finite() {
                    out.xyz[[t, i]] = sum / weight;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_found_with_their_ends() {
        let mut xyz = Array2::<f64>::zeros((6, 6));
        xyz[[0, 1]] = f64::NAN;
        xyz[[2, 4]] = f64::NAN;
        xyz[[3, 3]] = f64::NAN;
        xyz[[5, 5]] = f64::NAN;
        let gaps = gaps_of(&xyz, &(0..6));
        let gap = |point, frames: Range<usize>, before, after| Gap {
            point,
            frames,
            before,
            after,
        };
        assert_eq!(
            gaps,
            [
                gap(0, 0..1, None, Some(1)),
                gap(1, 2..4, Some(1), Some(4)),
                gap(1, 5..6, Some(4), None)
            ]
        );
        // A run's edge is an end like the take's.
        assert_eq!(gaps_of(&xyz, &(3..6))[0], gap(1, 3..4, None, Some(4)));
    }

    #[test]
    fn errors_fall_off_between_the_ends() {
        assert!((likeness(0.0) - 1.0).abs() <= 1e-12);
        assert!(likeness(0.1) > likeness(1.0) && likeness(20.0) < 0.01);
    }
}
