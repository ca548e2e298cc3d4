//! Other starts for a frame that does not fit: the limbs that do not are turned at random.

use super::fitter::{Answer, Fitter};
use crate::pose::rotation::closest_turn;
use glam::DVec3;
use rand::Rng;

impl Fitter<'_> {
    /// Other starts, until one fits to `limit`: the bones above the joints that do not fit are turned at random.
    pub fn search(
        &mut self,
        best: &mut Answer,
        tries: usize,
        to_before: f64,
        to_rest: f64,
        limit: f64,
    ) {
        let seen = self.seen();
        // A step costs the cube of the values: large skeletons get fewer tries, none of a body's size does.
        let n = self.rest.len().max(1);
        for _ in 0..tries.min(1 + 4_000_000 / (n * n)) {
            if best.misfit <= limit * limit * seen as f64 {
                return;
            }
            let mut q = best.q.clone();
            for i in self.misfits(&best.q) {
                q[i] += self.random.random_range(-1.5..1.5);
            }
            let other = self.solve(q, to_before, to_rest);
            if other.energy < best.energy {
                *best = other;
            }
        }
    }

    /// The angles of the three nearest turning bones above each joint that fits worst, or half as badly.
    fn misfits(&mut self, q: &[f64]) -> Vec<usize> {
        let posture = self.solver.posture(q);
        let far: Vec<f64> = self
            .joints
            .iter()
            .zip(self.targets.chunks_exact(3))
            .map(|(&j, y)| (posture.ends[j] - DVec3::from_slice(y)).length())
            .collect();
        let worst = far.iter().fold(0.0, |z: f64, &f| z.max(f));
        let mut angles = Vec::new();
        for (&joint, _) in self
            .joints
            .iter()
            .zip(&far)
            .filter(|(_, f)| **f >= 0.5 * worst)
        {
            let (mut at, mut turning) = (Some(joint), 0);
            while let Some(bone) = at.filter(|_| turning < 3) {
                let b = &self.skeleton.bones()[bone];
                let dofs = self.skeleton.dofs_of(bone);
                // The root's own turn is found in closed form.
                if b.parent.is_some() && !dofs.is_empty() {
                    turning += 1;
                    angles.extend(dofs.filter(|i| {
                        b.dofs[i - self.skeleton.dofs_of(bone).start]
                            .channel
                            .is_angle()
                    }));
                }
                at = b.parent;
            }
        }
        angles.sort_unstable();
        angles.dedup();
        angles
    }

    /// Takes whole turns off, as a restart may have added some.
    pub fn nearest_turns(&self, q: &mut [f64], near: &[f64]) {
        let dofs = self.skeleton.bones().iter().flat_map(|b| &b.dofs);
        for ((q, near), dof) in q.iter_mut().zip(near).zip(dofs) {
            if dof.channel.is_angle() {
                *q = closest_turn(*q, *near);
            }
        }
    }
}
