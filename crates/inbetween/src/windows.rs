//! Windows of known motion: what surrounds a gap of n steps, told by features, and what is in it,
//! as the residual over the cubic that bridges it.
//!
//! A window has the frames before a gap, the gap and the frames after it, at 30 a second. The
//! frame of reference of a window has its heading in the middle; residuals are those of the root,
//! and of every other point relative to the root.

use super::RATE;
use super::body_tree::{BodyTree, Frames, turn, wrapped};
use crate::numeric::linalg::symmetric_eigen;
use crate::numeric::parallel;
use glam::DVec3;
use ndarray::{Array1, Array2, ArrayView1, s};
use std::sync::Arc;

/// Frames of a window before the gap, and after it.
pub(crate) const BESIDE: usize = 10;
/// Principal components of the features that are kept.
const COMPONENTS: usize = 80;
/// Windows by which these are found, at most.
const SAMPLED: usize = 2000;
/// Weights of the features: of velocities, of the way over [`BESIDE`] frames, of the root's height
/// and way, of the turn, and of the root's velocities, cm and radians a frame.
const VELOCITY: f64 = 3.0;
const WAY: f64 = 0.5;
const ROOT: f64 = 2.0;
const TURN: f64 = 40.0;
const ROOT_VELOCITY: f64 = 20.0;
const TURN_RATE: f64 = 200.0;

/// What is known beside a gap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Beside {
    /// Motion: [`BESIDE`] frames.
    Motion,
    /// Key poses: the frame at each end, and one so many frames before and after them; 0: none.
    Keys([usize; 2]),
}

impl Beside {
    /// Frames of a window before its gap, and after it.
    fn frames(self) -> [usize; 2] {
        match self {
            Beside::Motion => [BESIDE; 2],
            Beside::Keys(beyond) => beyond.map(|n| n + 1),
        }
    }
}

/// Where motion is from.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Origin {
    pub take: usize,
    pub person: usize,
    /// The frame of the take with which it begins, and the seconds there.
    pub start: usize,
    pub seconds: f64,
}

/// Motion without a break, at 30 frames a second.
#[derive(Debug, Clone)]
pub(crate) struct Clip {
    pub origin: Origin,
    frames: Frames,
    /// Every frame about its root, in its own heading.
    local: Frames,
    heading: Vec<f64>,
}

impl Clip {
    pub(crate) fn new(tree: &BodyTree, frames: Frames, origin: Origin) -> Clip {
        let heading: Vec<f64> = (0..frames.nrows())
            .map(|t| tree.heading(&frames, t))
            .collect();
        let turns: Vec<_> = heading.iter().map(|h| turn(-h)).collect();
        let local = Array2::from_shape_fn(frames.dim(), |(t, p)| {
            turns[t] * (frames[[t, p]] - frames[[t, tree.root]])
        });
        Clip {
            origin,
            frames,
            local,
            heading,
        }
    }

    /// The motion, and its mirror image.
    pub(crate) fn both(tree: &BodyTree, frames: Frames, origin: Origin) -> Vec<Clip> {
        let mirrored = tree.mirrored(&frames);
        let both = std::iter::once(frames).chain(mirrored);
        both.map(|frames| Clip::new(tree, frames, origin)).collect()
    }

    pub(crate) fn len(&self) -> usize {
        self.heading.len()
    }
}

/// The gap of a window: the frames of a clip before and after it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ends {
    pub before: usize,
    pub after: usize,
}

impl Ends {
    /// The heading in the middle of the gap, radians.
    pub(crate) fn heading(self, clip: &Clip) -> f64 {
        clip.heading[self.before] + self.turn(clip) / 2.0
    }

    fn turn(self, clip: &Clip) -> f64 {
        wrapped(clip.heading[self.after] - clip.heading[self.before])
    }

    /// What tells the motion in the gap.
    fn features(self, tree: &BodyTree, clip: &Clip, beside: Beside) -> Vec<f64> {
        let Ends {
            before: a,
            after: b,
        } = self;
        let mut out = Vec::with_capacity(24 * tree.points());
        let others = || (0..tree.points()).filter(|p| *p != tree.root);
        let local = |t: usize, p: usize| clip.local[[t, p]];
        let mut push = |weight: f64, v: DVec3| out.extend((weight * v).to_array());
        for p in others() {
            push(1.0, local(a, p));
            push(1.0, local(b, p));
        }
        let root = |t: usize| clip.frames[[t, tree.root]];
        push(ROOT, turn(-self.heading(clip)) * (root(b) - root(a)));
        match beside {
            Beside::Motion => {
                for p in others() {
                    push(VELOCITY, local(a, p) - local(a - 1, p));
                    push(VELOCITY, local(b + 1, p) - local(b, p));
                    push(1.0, local(a, p) - local(a - 3, p));
                    push(1.0, local(b + 3, p) - local(b, p));
                    push(WAY, local(a, p) - local(a - 9, p));
                    push(WAY, local(b + 9, p) - local(b, p));
                }
                let ahead = |t: usize| turn(-clip.heading[t]);
                push(ROOT_VELOCITY, ahead(a) * (root(a) - root(a - 1)));
                push(ROOT_VELOCITY, ahead(b) * (root(b + 1) - root(b)));
                for (t, from) in [(a, a - 2), (b + 2, b)] {
                    out.push(TURN_RATE / 2.0 * wrapped(clip.heading[t] - clip.heading[from]));
                }
            }
            Beside::Keys([before, after]) => {
                for (from, to) in [(a - before, a), (b, b + after)] {
                    if from < to {
                        others().for_each(|p| push(WAY, local(to, p) - local(from, p)));
                        push(WAY, turn(-self.heading(clip)) * (root(to) - root(from)));
                    }
                }
            }
        }
        let angle = self.turn(clip);
        out.extend([ROOT * root(a).y, ROOT * root(b).y]);
        out.extend([TURN * angle.sin(), TURN * angle.cos()]);
        out
    }

    /// The velocities at both ends of the bridge of a point, cm a step.
    pub(crate) fn velocities(self, clip: &Clip, beside: Beside, p: usize) -> [DVec3; 2] {
        let Ends {
            before: a,
            after: b,
        } = self;
        let at = |t: usize| clip.frames[[t, p]];
        let way = |from: usize, to: usize| (at(to) - at(from)) / (to - from) as f64;
        match beside {
            Beside::Motion => [way(a - 1, a), way(b, b + 1)],
            Beside::Keys([before, after]) => {
                let across = (way(a, b), (b - a) as f64);
                [(a - before, a), (b, b + after)].map(|(from, to)| match to - from {
                    0 => across.0,
                    steps => tangent([(way(from, to), steps as f64), across]),
                })
            }
        }
    }

    /// The cubic that bridges the gap with the velocities at its ends (steps, points).
    fn bridge(self, clip: &Clip, beside: Beside) -> Frames {
        let steps = self.after - self.before;
        let mut out = Frames::from_elem((steps - 1, clip.frames.ncols()), DVec3::ZERO);
        for (p, mut path) in out.columns_mut().into_iter().enumerate() {
            let ends = [self.before, self.after].map(|t| clip.frames[[t, p]]);
            let velocities = self.velocities(clip, beside, p);
            for (k, at) in path.iter_mut().enumerate() {
                let u = (k + 1) as f64 / steps as f64;
                *at = cubic(u, steps as f64, ends, velocities);
            }
        }
        out
    }

    /// What the motion in the gap is over the bridge (steps x points x 3), in the window's
    /// heading.
    fn residual(self, tree: &BodyTree, clip: &Clip, beside: Beside) -> Array1<f64> {
        let bridge = self.bridge(clip, beside);
        let back = turn(-self.heading(clip));
        let mut out = Vec::with_capacity(3 * bridge.len());
        for (k, bridge) in bridge.rows().into_iter().enumerate() {
            let true_pose = clip.frames.row(self.before + 1 + k);
            let root = true_pose[tree.root] - bridge[tree.root];
            for (p, (truth, bridge)) in true_pose.iter().zip(bridge).enumerate() {
                let off = *truth - *bridge;
                let off = if p == tree.root { off } else { off - root };
                out.extend((back * off).to_array());
            }
        }
        Array1::from(out)
    }
}

/// The velocity at a key between two spans, each with its mean velocity and its length: that of the
/// parabola through the three keys, which for equal spans is the tangent of Catmull and Rom.
pub(crate) fn tangent([(a, m), (b, n)]: [(DVec3, f64); 2]) -> DVec3 {
    (a * n + b * m) / (m + n)
}

/// A cubic from one value to another at `u` of `steps`, with velocities a step.
pub(crate) fn cubic(u: f64, steps: f64, [from, to]: [DVec3; 2], [v, w]: [DVec3; 2]) -> DVec3 {
    let (uu, uuu) = (u * u, u * u * u);
    (2.0 * uuu - 3.0 * uu + 1.0) * from
        + (uuu - 2.0 * uu + u) * steps * v
        + (3.0 * uu - 2.0 * uuu) * to
        + (uuu - uu) * steps * w
}

/// The principal components of features.
#[derive(Debug, Clone)]
pub(crate) struct Basis {
    mean: Array1<f64>,
    /// (features, components).
    axes: Array2<f64>,
}

impl Basis {
    /// Of rows of features (windows, features).
    fn of(rows: &Array2<f64>) -> Option<Basis> {
        let mean = rows.mean_axis(ndarray::Axis(0))?;
        let off = rows - &mean;
        let (_, vectors) = symmetric_eigen(&off.t().dot(&off))?;
        let first = vectors.ncols().saturating_sub(COMPONENTS);
        Some(Basis {
            mean,
            // Eigenvalues rise.
            axes: vectors.slice(s![.., first..]).to_owned(),
        })
    }
}

/// All windows of one length in some clips.
#[derive(Debug, Clone)]
pub(crate) struct Windows {
    clips: Arc<[Clip]>,
    pub beside: Beside,
    /// Steps between the frames beside the gap.
    pub steps: usize,
    /// The clip of each window, and its first frame there.
    pub at: Vec<(usize, usize)>,
    /// (windows, components).
    pub features: Array2<f64>,
    pub basis: Basis,
}

impl Windows {
    /// Cuts windows every `stride` frames; `basis` is that of other windows. `None` where there
    /// are none to find one by.
    pub(crate) fn cut(
        tree: &BodyTree,
        clips: Arc<[Clip]>,
        [steps, stride]: [usize; 2],
        beside: Beside,
        basis: Option<&Basis>,
    ) -> Option<Windows> {
        let length = beside.frames().iter().sum::<usize>() + steps - 1;
        let starts = |(c, clip): (usize, &Clip)| {
            let count = (clip.len() + 1).saturating_sub(length);
            (0..count).step_by(stride).map(move |s| (c, s))
        };
        let at: Vec<(usize, usize)> = clips.iter().enumerate().flat_map(starts).collect();
        let features = |at: &[(usize, usize)]| -> Array2<f64> {
            let rows = parallel::map_chunks(at.len(), 64, |range| {
                let of = |(c, s): &(usize, usize)| {
                    ends_of(*s, steps, beside).features(tree, &clips[*c], beside)
                };
                at[range].iter().flat_map(of).collect::<Vec<f64>>()
            });
            let rows = rows.concat();
            let width = rows.len() / at.len().max(1);
            // As many as there are: cannot fail.
            Array2::from_shape_vec((at.len(), width), rows).unwrap_or_default()
        };
        let basis = match basis {
            Some(basis) => basis.clone(),
            None if at.is_empty() => return None,
            None => {
                let every = at.len().div_ceil(SAMPLED);
                let some: Vec<_> = at.iter().step_by(every).copied().collect();
                Basis::of(&features(&some))?
            }
        };
        let mut projected = Array2::zeros((at.len(), basis.axes.ncols()));
        for (chunk, mut out) in at
            .chunks(SAMPLED)
            .zip(projected.axis_chunks_iter_mut(ndarray::Axis(0), SAMPLED))
        {
            out.assign(&(features(chunk) - &basis.mean).dot(&basis.axes));
        }
        Some(Windows {
            clips,
            beside,
            steps,
            at,
            features: projected,
            basis,
        })
    }

    /// The features of a gap that is none of the windows.
    pub(crate) fn features_of(&self, tree: &BodyTree, clip: &Clip, ends: Ends) -> Array1<f64> {
        let raw = Array1::from(ends.features(tree, clip, self.beside));
        (raw - &self.basis.mean).dot(&self.basis.axes)
    }

    /// The clip of a window, and its gap there.
    fn place(&self, window: usize) -> (&Clip, Ends) {
        let (clip, start) = self.at[window];
        (&self.clips[clip], ends_of(start, self.steps, self.beside))
    }

    /// How far apart the gaps of two windows start at least if none has a frame of the other's
    /// gap.
    pub(crate) fn apart(&self) -> usize {
        let [before, after] = self.beside.frames();
        self.steps - 1 + before.max(after)
    }

    /// The first frame of the gap of a window, in its take.
    pub(crate) fn gap_start(&self, window: usize) -> usize {
        let (clip, ends) = self.place(window);
        clip.origin.start + ends.before + 1
    }

    /// The seconds of its take at which the gap of a window starts.
    pub(crate) fn seconds(&self, window: usize) -> f64 {
        let (clip, ends) = self.place(window);
        clip.origin.seconds + (ends.before + 1) as f64 / RATE
    }

    pub(crate) fn origin(&self, window: usize) -> Origin {
        self.place(window).0.origin
    }

    /// Whether all motion is one person's.
    pub(crate) fn is_of_one(&self) -> bool {
        let mut people = self.clips.iter().map(|c| c.origin.person);
        let first = people.next();
        people.all(|person| Some(person) == first)
    }

    pub(crate) fn row(&self, window: usize) -> ArrayView1<'_, f64> {
        self.features.row(window)
    }

    /// [`Ends::residual`] of a window.
    pub(crate) fn residual(&self, tree: &BodyTree, window: usize) -> Array1<f64> {
        let (clip, ends) = self.place(window);
        ends.residual(tree, clip, self.beside)
    }
}

fn ends_of(start: usize, steps: usize, beside: Beside) -> Ends {
    let before = start + beside.frames()[0] - 1;
    Ends {
        before,
        after: before + steps,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body_tree::tests::walk;

    #[test]
    fn a_window_and_its_turned_copy_are_alike() {
        let (tree, frames) = walk(60, 30.0, 1.0);
        let turned = frames.mapv(|v| turn(1.1) * v + DVec3::new(50.0, 0.0, -20.0));
        let clips = [frames, turned].map(|f| Clip::new(&tree, f, Origin::default()));
        let clips: Arc<[Clip]> = clips.into();
        for beside in [Beside::Motion, Beside::Keys([0, 0]), Beside::Keys([4, 7])] {
            let cut = Windows::cut(&tree, clips.clone(), [9, 4], beside, None).unwrap();
            let half = cut.at.len() / 2;
            for k in 0..half {
                let off = &cut.row(k) - &cut.row(k + half);
                assert!(off.dot(&off) < 1e-9);
                let off = cut.residual(&tree, k) - cut.residual(&tree, k + half);
                assert!(off.dot(&off) < 1e-9);
                assert_eq!(cut.gap_start(k), cut.gap_start(k + half));
            }
            let (clip, ends) = cut.place(1);
            let own = cut.features_of(&tree, clip, ends) - cut.row(1);
            assert!(own.dot(&own) < 1e-9);
        }
    }

    #[test]
    fn a_cubic_meets_both_ends_with_their_velocities() {
        let [a, b, v, w] = [1.0, 4.0, 0.5, -0.2].map(DVec3::splat);
        let at = |u: f64| cubic(u, 8.0, [a, b], [v, w]);
        assert!((at(0.0) - a).length() < 1e-12 && (at(1.0) - b).length() < 1e-12);
        let slope = |u: f64| (at(u + 1e-6) - at(u - 1e-6)) / 2e-6 / 8.0;
        assert!((slope(0.0) - v).length() < 1e-6 && (slope(1.0) - w).length() < 1e-6);
    }
}
