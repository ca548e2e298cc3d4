//! Markers of a set named by the body that they are on: a person's points without names.
//!
//! The mean body is put at the points of a frame, turned in some ways about the vertical, or
//! where they lie, about their length. In rounds, markers and points are assigned to each other
//! within a gate that narrows, and the pose follows
//! ([`FrameSolver`](crate::ik::frame_solver::FrameSolver)).

use super::body::{BONES, Body};
use super::landmarks::JointSet;
use super::marker_sets::{MarkerSet, NamedMarker};
use super::person::{calibrated, pose_prior};
use super::tuning::LEAST_SD;
use super::tuning::body_labels::*;
use crate::ik::frame_solver::{FrameSolver, FrameState, Scratch};
use crate::label::unlabeled::own_name;
use crate::label::{FittedLabels, LabelModel, NamedFrame};
use crate::numeric::assignment::assign;
use crate::numeric::parallel::map_chunks;
use crate::numeric::statistics::{median, quantile};
use crate::pose::kinematics::Posture;
use crate::pose::{Channel, Skeleton};
use crate::prior::rotations::{JointPrior, RotationPrior};
use crate::{Error, Result};
use glam::{DMat3, DQuat, DVec3};
use ndarray::ArrayView2;
use std::f64::consts::TAU;

/// The markers of a set on the body of people.
pub struct BodyModel {
    labels: Vec<String>,
    named: Vec<NamedMarker>,
    joints: JointSet,
    body: Body,
    skeleton: Skeleton,
    prior: JointPrior,
}

impl BodyModel {
    /// The model of a marker set.
    ///
    /// # Errors
    /// [`Error::Usage`]: the set has fewer than eight markers.
    pub fn new(set: &MarkerSet) -> Result<BodyModel> {
        let joints = set.joints;
        let (labels, named) = set.all();
        let rotations = RotationPrior::builtin()?;
        let bones = (rotations.bones()).ok_or_else(|| Error::usage("no bones of people"))?;
        let body = Body::new(&named, joints, bones, None)?;
        let skeleton = body.skeleton(&body.mean)?;
        let prior = pose_prior(&body, &rotations, joints)?;
        Ok(BodyModel {
            labels,
            named,
            joints,
            skeleton,
            prior,
            body,
        })
    }
}

impl LabelModel for BodyModel {
    fn labels(&self) -> &[String] {
        &self.labels
    }

    fn is_one_of_several(&self, label: usize) -> bool {
        let own = &self.named[label];
        let is_there =
            |m: &&NamedMarker| (&m.landmark, m.is_right) == (&own.landmark, own.is_right);
        self.named.iter().filter(is_there).count() > 1
    }

    fn is_label(&self, name: &str) -> bool {
        let own = |l: &String| l == own_name(name);
        self.labels.iter().any(own) || MarkerSet::shipped().iter().any(|set| set.knows(name))
    }

    fn name_frames(&self, frames: &[Vec<DVec3>]) -> Result<Vec<NamedFrame>> {
        let joints = self.body.marker_bones();
        let solver = FrameSolver::new(&self.skeleton, &joints, 0, &self.prior)?;
        let search = Search {
            model: self,
            solver: &solver,
            joints: &joints,
        };
        let found = map_chunks(frames.len(), 1, |range| search.name(&frames[range.start]));
        Ok(found)
    }

    fn fit(&self, known: ArrayView2<'_, f64>) -> Result<FittedLabels> {
        let fit = calibrated(&self.named, (&known, FRAMES), None, self.joints, None)?;
        Ok(FittedLabels {
            deviations: (0..self.labels.len()).map(|m| fit.deviations(m)).collect(),
            places: fit.positions()?,
            reach: vec![1.0; self.labels.len()],
            sd: fit.position_deviations()?,
        })
    }
}

/// The search for the names of a frame.
struct Search<'a> {
    model: &'a BodyModel,
    solver: &'a FrameSolver<'a>,
    joints: &'a [usize],
}

impl Search<'_> {
    fn name(&self, points: &[DVec3]) -> NamedFrame {
        let mut scratch = Scratch::default();
        let mut states: Vec<(f64, FrameState)> = self.starts(points);
        let shrink = (NARROW / WIDE).powf(1.0 / (GATES - 1) as f64);
        for round in 0..GATES {
            let gate = WIDE * shrink.powi(round as i32);
            for (cost, state) in &mut states {
                let targets = self.targets(points, state, gate);
                let shares = self.shares(gate).into_iter();
                let weights = shares.map(|share| share * (SIGMAS / gate).powi(2));
                let weights: Vec<f64> = weights.collect();
                let from = state.clone();
                let fit = self.solver.improve(
                    &targets,
                    &weights,
                    from,
                    (STEPS, LEAST_GAIN),
                    &mut scratch,
                );
                let left = targets.chunks_exact(3).filter(|y| y[0].is_nan()).count() as f64;
                *cost = fit.energy + left * SIGMAS * SIGMAS;
                *state = fit.state;
            }
            states.sort_by(|a, b| a.0.total_cmp(&b.0));
            if HALVED.contains(&round) {
                states.truncate(states.len().div_ceil(2));
            }
        }
        let state = &states[0].1;
        let mut labels = vec![None; points.len()];
        for (label, n) in self.assigned(points, state, NARROW).into_iter().enumerate() {
            if let Some(n) = n {
                labels[n] = Some(label);
            }
        }
        NamedFrame {
            labels,
            cost: states[0].0,
        }
    }

    /// The mean body in the middle of the points, turned.
    fn starts(&self, points: &[DVec3]) -> Vec<(f64, FrameState)> {
        let nowhere = vec![f64::NAN; 3 * self.joints.len()];
        let mean = self.solver.start(0, &nowhere);
        // Reflections far off do not move it.
        let of = |c: usize| median(points.iter().map(|p| p[c]).collect()).unwrap_or(0.0);
        let middle = DVec3::new(of(0), of(1), of(2));
        let root = &self.model.skeleton.bones()[0];
        let first = self.model.skeleton.dofs_of(0).start;
        let turned = |turn: DMat3| {
            let mut state = mean.clone();
            state.rotations[0] = turn * state.rotations[0];
            let markers = self.markers(&state);
            let off = middle - markers.iter().sum::<DVec3>() / markers.len() as f64;
            for (n, dof) in root.dofs.iter().enumerate() {
                if let Channel::Translate(axis) = dof.channel {
                    state.values[first + n] += off[axis.index()];
                }
            }
            (f64::INFINITY, state)
        };
        turns(points, middle).into_iter().map(turned).collect()
    }

    fn markers(&self, state: &FrameState) -> Vec<DVec3> {
        let mut posture = Posture::default();
        self.solver.equations.states.posture(state, &mut posture);
        self.joints.iter().map(|j| posture.ends[*j]).collect()
    }

    fn assigned(&self, points: &[DVec3], state: &FrameState, gate: f64) -> Vec<Option<usize>> {
        let markers = self.markers(state);
        let shares = self.shares(gate);
        // Where two positions are as near, the one that is better known is likelier.
        let vague = |share: f64| -3.0 * share.ln() * (gate / SIGMAS).powi(2);
        let cost = |m: usize, n: usize| {
            shares[m] * markers[m].distance_squared(points[n]) + vague(shares[m])
        };
        assign(markers.len(), points.len(), gate * gate, cost)
    }

    /// The share of its squared distance that counts of each marker: less of those whose position
    /// on the body is little known.
    fn shares(&self, gate: f64) -> Vec<f64> {
        let of = |marker: usize| {
            let own = BONES + 3 * marker..BONES + 3 * marker + 3;
            let variance: f64 = own.map(|n| self.model.body.precision[[n, n]].recip()).sum();
            let beyond = (variance - 3.0 * LEAST_SD * LEAST_SD).max(0.0);
            gate * gate / (gate * gate + WIDER * beyond)
        };
        (0..self.joints.len()).map(of).collect()
    }

    /// The points of the markers (3 a marker; NaN is missing).
    fn targets(&self, points: &[DVec3], state: &FrameState, gate: f64) -> Vec<f64> {
        let assigned = self.assigned(points, state, gate).into_iter();
        let position = |n: Option<usize>| n.map_or([f64::NAN; 3], |n| points[n].to_array());
        assigned.flat_map(position).collect()
    }
}

/// The turns to start from: about the vertical, or where points are far longer than high, about
/// their length, with the head at either end.
fn turns(points: &[DVec3], middle: DVec3) -> Vec<DMat3> {
    let about = |n: usize, of: usize| DMat3::from_rotation_y(n as f64 / of as f64 * TAU);
    let sum = |of: fn(DVec3) -> f64| points.iter().map(|p| of(*p - middle)).sum::<f64>();
    let angle = 0.5 * (2.0 * sum(|p| p.x * p.z)).atan2(sum(|p| p.x * p.x - p.z * p.z));
    let along = DVec3::new(angle.cos(), 0.0, angle.sin());
    let extent = |axis: DVec3| {
        let at = |share| quantile(points.iter().map(|p| p.dot(axis)).collect(), share);
        at(0.9).zip(at(0.1)).map_or(0.0, |(high, low)| high - low)
    };
    if extent(DVec3::Y) >= LYING * extent(along) {
        return (0..YAWS).map(|n| about(n, YAWS)).collect();
    }
    let laid = [along, -along].map(|to| DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Y, to)));
    let half = YAWS / 2;
    (0..YAWS)
        .map(|n| laid[n / half] * about(n % half, half))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::PointMove;
    use crate::label::Templates;
    use crate::label::nameless::name_tracks;
    use crate::pose::rotation::from_rotation_vector;
    use crate::pose::{Poses, point_at};
    use crate::solve::marker_solver::tests::person;
    use ndarray::Array2;

    /// The person's markers without names, in another order; pieces of some are tracks of their
    /// own, and two tracks are none of them. The marker of each track in each frame.
    fn nameless(poses: &Poses) -> (Poses, Array2<Option<usize>>) {
        let (frames, markers) = (poses.frames(), poses.points.len());
        let tracks = markers + markers / 4 + 2;
        let mut xyz = Array2::from_elem((frames, 3 * tracks), f64::NAN);
        let mut of = Array2::from_elem((frames, tracks), None);
        let mut put = |t: usize, track: usize, at: DVec3, marker: Option<usize>| {
            (0..3).for_each(|c| xyz[[t, 3 * track + c]] = at[c]);
            of[[t, track]] = marker;
        };
        let ordered = |marker: usize| (7 * marker) % markers;
        for t in 0..frames {
            for marker in 0..markers {
                let at = point_at(poses.xyz.view(), t, marker);
                match marker % 4 {
                    // A gap, behind which it is another track.
                    3 if t > 2 * frames / 3 => {
                        put(t, markers + marker / 4, at, Some(marker));
                    }
                    3 if t > frames / 2 => {}
                    _ => put(t, ordered(marker), at, Some(marker)),
                }
            }
            let still = DVec3::new(40.0, 70.0, 15.0);
            put(t, tracks - 2, still + 0.1 * (t as f64).sin(), None);
            if t < 40 {
                let near = point_at(poses.xyz.view(), t, 0) + DVec3::new(25.0, 12.0, 0.0);
                put(t, tracks - 1, near, None);
            }
        }
        let nameless = Poses {
            points: (0..tracks).map(|n| format!("*{n}")).collect(),
            xyz,
            ..poses.clone()
        };
        (nameless, of)
    }

    #[test]
    fn a_body_without_names_is_named_standing_and_lying() {
        let (mut poses, _) = person(240);
        for turn in [
            DMat3::IDENTITY,
            from_rotation_vector(DVec3::new(1.0, 0.0, 1.2)),
        ] {
            for mut row in poses.xyz.rows_mut() {
                let row = row.as_slice_mut().unwrap();
                for at in row.chunks_exact_mut(3) {
                    (turn * DVec3::from_slice(at)).write_to_slice(at);
                }
            }
            named_whole(&poses);
        }
    }

    fn named_whole(poses: &Poses) {
        let (nameless, truth) = nameless(poses);
        let model = BodyModel::new(MarkerSet::find("cmu41").unwrap()).unwrap();
        let found = name_tracks(&nameless, 60.0, &model, 0.9, &Templates::default()).unwrap();
        let mut xyz = nameless.xyz.clone();
        PointMove::make_all(&found.moves, &mut xyz);
        let (mut right, mut wrong) = (0, 0);
        for (track, name) in &found.names {
            let marker = poses.points.iter().position(|p| p == name);
            for t in 0..poses.frames() {
                let at = point_at(xyz.view(), t, *track);
                if at.is_finite() {
                    let is = marker.is_some_and(|m| point_at(poses.xyz.view(), t, m) == at);
                    *(if is { &mut right } else { &mut wrong }) += 1;
                }
            }
        }
        let all = truth.iter().flatten().count();
        assert_eq!(wrong, 0);
        assert!(right as f64 >= 0.98 * all as f64, "{right} of {all}");
        // Every position is still there.
        let count = |xyz: &Array2<f64>| xyz.iter().filter(|v| v.is_finite()).count();
        assert_eq!(count(&xyz), count(&nameless.xyz));
        assert_eq!(found.labels.len() + found.missing.len(), 41);
    }

    #[test]
    fn what_is_no_body_is_refused() {
        let (poses, _) = person(60);
        let mut nameless = nameless(&poses).0;
        nameless.xyz.mapv_inplace(|v| (v * 91.7).rem_euclid(300.0));
        let model = BodyModel::new(MarkerSet::find("pig").unwrap()).unwrap();
        let error = name_tracks(&nameless, 60.0, &model, 0.9, &Templates::default()).unwrap_err();
        assert!(
            error.to_string().contains("no body with these labels"),
            "{error}"
        );
    }
}
