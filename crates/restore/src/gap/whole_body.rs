//! Gaps of a whole body: frames in which too little is seen to place it are bridged point by point.
//!
//! A point's path is the mix of PCHIP and of a cubic that meets both ends with the velocities there
//! (Hermite):
//!
//! ```text
//! w = argmin wᵀ G w + .1 g |w − w₀|²,   w ≥ 0,  Σ w = 1;     used is (n w + w₀) / (n + 1)
//! variance = σ² 4 u (1 − u)
//! ```
//!
//! G and g are those of [`super::weights`], here of all points together in n gaps of the same
//! length simulated where the body is seen; w₀ is Hermite, with PCHIP in brief gaps; u runs from 0
//! to 1 over the gap, and σ² is the point's in the simulated gaps. `rigid_distances` then holds the
//! bones' lengths.

use super::tuning::{path::MISS, path::REACH, weights::SHRINKAGE, whole_body::*};
use super::{FilledGap, Gap};

use crate::numeric::{hermite::hermite, mixing::best_weights, pchip::pchip};
use crate::pose::FillMethod;
use crate::take::Take;
use ndarray::{Array1, Array2, ArrayView2, CowArray, Ix2, array, s};
use std::collections::BTreeMap;
use std::ops::Range;

/// Bridges those of the gaps of a take that are mostly frames in which no body can be placed, if
/// they last for no more than `longest` seconds; `None`: one. The others are `None`, and so are
/// those at the start and end of a run.
pub(crate) fn bridge(
    take: &Take<'_>,
    gaps: &[Gap],
    longest: Option<f64>,
) -> Vec<Option<FilledGap>> {
    let mut out = vec![None; gaps.len()];
    let bare = bare_frames(take.xyz);
    let longest = longest.unwrap_or(LONGEST);
    let mut lengths: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (k, gap) in gaps.iter().enumerate() {
        let empty = gap.frames.clone().filter(|t| bare[*t]).count();
        let is_bridged = 2 * empty >= gap.frames.len()
            && gap.before.and(gap.after).is_some()
            && !gap.is_longer(Some(longest), take.rate);
        if is_bridged {
            lengths.entry(gap.frames.len()).or_default().push(k);
        }
    }
    for (length, members) in lengths {
        let mut points: Vec<usize> = members.iter().map(|k| gaps[*k].point).collect();
        points.sort_unstable();
        points.dedup();
        let bridges = Bridges::simulated(take, &bare, length, &points);
        for k in members {
            out[k] = bridges.fill(take, &gaps[k]);
        }
    }
    out
}

/// The frames of a take (frames, 3 J) with bridged gaps put in.
pub(crate) fn with_bridged<'a>(
    xyz: ArrayView2<'a, f64>,
    gaps: &[Gap],
    bridged: &[Option<FilledGap>],
) -> CowArray<'a, f64, Ix2> {
    let mut xyz = CowArray::from(xyz);
    for (gap, bridged) in gaps.iter().zip(bridged) {
        if let Some(bridged) = bridged {
            let columns = 3 * gap.point..3 * gap.point + 3;
            (xyz.slice_mut(s![gap.frames.clone(), columns])).assign(&bridged.xyz);
        }
    }
    xyz
}

/// Whether no body can be placed in each frame of `xyz` (frames, 3 J; NaN missing); never for
/// tables of fewer points than that takes.
pub(crate) fn bare_frames(xyz: ArrayView2<'_, f64>) -> Vec<bool> {
    let points = xyz.ncols() / 3;
    let is_bare = |t: usize| {
        let is_seen = |p: &usize| (3 * p..3 * p + 3).any(|i| xyz[[t, i]].is_finite());
        points >= PLACING && (0..points).filter(is_seen).take(PLACING).count() < PLACING
    };
    (0..xyz.nrows()).map(is_bare).collect()
}

/// How gaps of one length are bridged.
struct Bridges {
    /// The weights of PCHIP and Hermite.
    weights: Array1<f64>,
    /// σ² of each point that was simulated, cm².
    variance: BTreeMap<usize, f64>,
}

impl Bridges {
    /// Simulates gaps of `length` frames of some points.
    fn simulated(take: &Take<'_>, bare: &[bool], length: usize, points: &[usize]) -> Bridges {
        let share = (1.0 - length as f64 / take.rate / HERMITE).max(0.0);
        let plain = array![share, 1.0 - share];
        let starts = starts(take.runs, bare, length);
        let hidden = (starts.iter()).map(|s| *s..s + length);
        let mut errors: BTreeMap<usize, Vec<Errors>> = BTreeMap::new();
        let mut gram = Array2::<f64>::zeros((2, 2));
        for hidden in hidden {
            for &p in points {
                let Some(found) = Errors::simulated(take, p, &hidden) else {
                    continue;
                };
                gram += &found.values.dot(&found.values.t());
                errors.entry(p).or_default().push(found);
            }
        }
        let n = starts.len() as f64;
        let weights = if errors.is_empty() {
            plain
        } else {
            (best_weights(&gram, &plain, SHRINKAGE) * n + plain) / (n + 1.0)
        };
        let variance = |all: Vec<Errors>| {
            let squares = all.iter().map(|e| weights.dot(&e.values).powi(2).sum());
            let profile: f64 = all.iter().map(|e| e.profile).sum();
            (squares.sum::<f64>() / profile).max(LEAST_VARIANCE)
        };
        let variance = errors.into_iter().map(|(p, all)| (p, variance(all)));
        Bridges {
            variance: variance.collect(),
            weights,
        }
    }

    /// A gap, bridged.
    fn fill(&self, take: &Take<'_>, gap: &Gap) -> Option<FilledGap> {
        let frames: Vec<usize> = gap.frames.clone().collect();
        let [pchip, hermite] = paths(take, gap.point, &gap.frames, &frames)?;
        let apart = (&hermite - &pchip).mapv(|v| v * v).mean()?;
        let xyz = pchip * self.weights[0] + hermite * self.weights[1];
        // With no room to simulate, the paths' own doubt and what one may miss in a second.
        let longest = frames.len() as f64 / take.rate;
        let unknown = apart + (MISS * longest).powi(2);
        let level = self.variance.get(&gap.point).copied().unwrap_or(unknown);
        let n = frames.len() as f64;
        let variance = (1..=frames.len()).map(|k| level * profile(k as f64 / (n + 1.0)));
        Some(FilledGap {
            variance: variance.collect(),
            xyz,
            method: FillMethod::Interpolation,
            contacts: Vec::new(),
        })
    }
}

/// The errors of both paths in a simulated gap.
struct Errors {
    /// (2, 3 frames), cm.
    values: Array2<f64>,
    /// The sum over them of the share of σ² that is expected.
    profile: f64,
}

impl Errors {
    /// The errors of a point in the frames `hidden`; `None` where it is not seen in or around them.
    fn simulated(take: &Take<'_>, point: usize, hidden: &Range<usize>) -> Option<Errors> {
        let frames: Vec<usize> = (hidden.clone())
            .filter(|t| is_seen(take.xyz, *t, point))
            .collect();
        if frames.is_empty() {
            return None;
        }
        let found = paths(take, point, hidden, &frames)?;
        let run = run_of(take, hidden)?;
        let before = (run.start..hidden.start).rfind(|t| is_seen(take.xyz, *t, point))?;
        let after = (hidden.end..run.end).find(|t| is_seen(take.xyz, *t, point))?;
        // Where the frames beside are missing too, the gap is longer than the true one.
        let scale = ((hidden.len() + 1) as f64 / (after - before) as f64).powi(2);
        let mut values = Array2::zeros((2, 3 * frames.len()));
        for (k, t) in frames.iter().enumerate() {
            for (axis, path) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]) {
                let off = found[path][[k, axis]] - take.xyz[[*t, 3 * point + axis]];
                values[[path, 3 * k + axis]] = off * scale;
            }
        }
        let share = |t: &usize| profile((t - before) as f64 / (after - before) as f64);
        Some(Errors {
            values,
            profile: 3.0 * frames.iter().map(share).sum::<f64>(),
        })
    }
}

/// The share of σ² at `u`.
fn profile(u: f64) -> f64 {
    4.0 * u * (1.0 - u)
}

fn is_seen(xyz: ArrayView2<'_, f64>, t: usize, point: usize) -> bool {
    (3 * point..3 * point + 3).all(|i| xyz[[t, i]].is_finite())
}

fn run_of<'a>(take: &Take<'a>, frames: &Range<usize>) -> Option<&'a Range<usize>> {
    (take.runs.iter()).find(|r| r.contains(&frames.start))
}

/// PCHIP and Hermite (frames, 3) at some `frames` of a gap of a point. `None` where it is not seen
/// on both sides.
fn paths(
    take: &Take<'_>,
    point: usize,
    gap: &Range<usize>,
    frames: &[usize],
) -> Option<[Array2<f64>; 2]> {
    let run = run_of(take, gap)?;
    let reach = ((REACH * take.rate).ceil() as usize).max(2);
    let sides = (gap.start.saturating_sub(reach).max(run.start)..gap.start)
        .chain(gap.end..(gap.end + reach).min(run.end));
    let around: Vec<usize> = sides.filter(|t| is_seen(take.xyz, *t, point)).collect();
    let before = around.partition_point(|t| *t < gap.start);
    if before == 0 || before == around.len() {
        return None;
    }
    let seconds = |frames: &[usize]| frames.iter().map(|t| *t as f64 / take.rate).collect();
    let (x, at): (Vec<f64>, Vec<f64>) = (seconds(&around), seconds(frames));
    let mut out = [(); 2].map(|()| Array2::zeros((frames.len(), 3)));
    for axis in 0..3 {
        let y = around.iter().map(|t| take.xyz[[*t, 3 * point + axis]]);
        let y: Vec<f64> = y.collect();
        let both = [
            pchip(&x, &y, &at),
            hermite(&x, &y, before, &at, 1.0 / take.rate),
        ];
        for (out, values) in out.iter_mut().zip(both) {
            out.column_mut(axis).assign(&Array1::from(values));
        }
    }
    Some(out)
}

/// Where gaps of `length` frames are simulated: spread over the frames that are seen with those
/// beside them, or, where these are few, over all that are seen.
fn starts(runs: &[Range<usize>], bare: &[bool], length: usize) -> Vec<usize> {
    let windows = || {
        let of_run = |run: &Range<usize>| run.start + 1..run.end.saturating_sub(length);
        runs.iter().flat_map(of_run)
    };
    let is_whole = |s: &usize| !bare[s - 1..s + length + 1].contains(&true);
    let mut all: Vec<usize> = windows().filter(is_whole).collect();
    if all.len() < SIMULATED {
        all = windows()
            .filter(|s| !bare[*s] && !bare[s + length - 1])
            .collect();
    }
    let count = SIMULATED.min(all.len());
    let mut chosen: Vec<usize> = (0..count)
        .map(|k| all[(2 * k + 1) * all.len() / (2 * count)])
        .collect();
    chosen.dedup();
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::find_gaps;

    /// Three points that swing, 100 frames a second.
    fn swing(frames: usize) -> Array2<f64> {
        Array2::from_shape_fn((frames, 9), |(t, c)| {
            20.0 * c as f64 + 15.0 * (t as f64 / 12.0 + c as f64).sin()
        })
    }

    fn bridged(xyz: &Array2<f64>, longest: Option<f64>) -> Vec<(Gap, Option<FilledGap>)> {
        let run = 0..xyz.nrows();
        let take = Take {
            names: &[],
            xyz: xyz.view(),
            runs: std::slice::from_ref(&run),
            rate: 100.0,
            sd: None,
            motion: Default::default(),
        };
        let gaps = find_gaps(xyz.view(), take.runs);
        let bridged = bridge(&take, &gaps, longest);
        gaps.into_iter().zip(bridged).collect()
    }

    fn hidden(truth: &Array2<f64>, frames: impl IntoIterator<Item = usize>) -> Array2<f64> {
        let mut xyz = truth.clone();
        for t in frames {
            xyz.row_mut(t).fill(f64::NAN);
        }
        xyz
    }

    /// The root mean square error over its standard deviation, and the largest error, cm.
    fn errors(truth: &Array2<f64>, all: &[(Gap, Option<FilledGap>)]) -> (f64, f64) {
        let (mut squares, mut count, mut worst) = (0.0, 0.0, 0.0f64);
        for (gap, filled) in all {
            let filled = filled.as_ref().expect("a bridge");
            for (k, t) in gap.frames.clone().enumerate() {
                for axis in 0..3 {
                    let off = (filled.xyz[[k, axis]] - truth[[t, 3 * gap.point + axis]]).abs();
                    squares += off * off / filled.variance[k];
                    count += 1.0;
                    worst = worst.max(off);
                }
            }
        }
        (f64::sqrt(squares / count), worst)
    }

    #[test]
    fn a_body_is_bridged_over_time_with_a_deviation_that_holds() {
        let truth = swing(300);
        let (sds, off) = errors(&truth, &bridged(&hidden(&truth, 140..160), None));
        assert!(off < 0.5 && sds < 2.0, "{off} cm, {sds} sd");
        // Every second frame, with no room to simulate such a gap alone. Without noise errors
        // are largest in the few frames where paths turn.
        let other = bridged(&hidden(&truth, (5..295).step_by(2)), None);
        let (sds, off) = errors(&truth, &other);
        assert!(off < 0.05 && sds < 3.0, "{off} cm, {sds} sd");
        // A take with no room to simulate at all.
        let short = truth.slice(s![..40, ..]).to_owned();
        let (sds, off) = errors(&short, &bridged(&hidden(&short, 10..30), None));
        assert!(off < 1.0 && sds < 2.0, "{off} cm, {sds} sd");
    }

    #[test]
    fn what_is_long_or_has_one_end_or_shows_a_body_is_not_bridged() {
        let truth = swing(500);
        let is_any = |xyz: &Array2<f64>, longest| {
            bridged(xyz, longest)
                .iter()
                .any(|(_, filled)| filled.is_some())
        };
        let long = hidden(&truth, 200..320);
        assert!(!is_any(&long, None) && is_any(&long, Some(1.2)) && !is_any(&long, Some(1.19)));
        assert!(!is_any(&hidden(&truth, (0..20).chain(480..500)), None));
        // A point alone, in a table whose others place the body.
        let mut four = Array2::zeros((500, 12));
        four.slice_mut(s![.., ..9]).assign(&truth);
        four.slice_mut(s![200..220, 9..]).fill(f64::NAN);
        assert!(!is_any(&four, None));
    }
}
