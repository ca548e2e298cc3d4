//! Poses that are taken whole: another one, one that the model finds, or one with the same pins.

use super::{Drags, Session};
use crate::edit::other_poses::{OtherPose, other_poses};
use crate::edit::pose_solver::{Constraints, Pose, Reference, floor_under};
use crate::{Error, Result};

impl Session {
    /// Takes another pose, without its pins.
    pub fn take(&mut self, step: &str, pose: Pose) {
        self.change(step, |now, _| {
            now.pose = pose;
            now.pins.fill([None; 3]);
        });
    }

    /// Takes the pose nearest to these positions of the joints (3 K, cm; NaN: the model says).
    ///
    /// # Errors
    /// [`Error::Usage`]: too few joints to place a pose.
    pub fn take_places(&mut self, step: &str, xyz: &[f64]) -> Result<()> {
        let Some(pose) = self.solver.pose_at(xyz, &self.now.pose) else {
            return Err(Error::usage(
                "fewer than three joints are there, or all on a line",
            ));
        };
        self.take(step, pose);
        Ok(())
    }

    /// Resets joints: their positions are discarded, and the model places them by the others.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is no such joint.
    pub fn reset(&mut self, joints: &[usize]) -> Result<()> {
        self.check_joints(joints)?;
        self.change("the reset", |now, solver| {
            joints.iter().for_each(|&k| now.pins[k] = [None; 3]);
            let mut goals = Constraints {
                rest: 1.0,
                pins: now.pins.clone(),
                floor: now.floor.then(|| floor_under(&now.pose.xyz)),
                limits: now.limits,
                ..Constraints::none(solver.rig.joints())
            };
            joints.iter().for_each(|&k| goals.forgotten[k] = true);
            let reference = Reference::at(now.pose.xyz.clone());
            now.pose = solver.follow(&goals, &reference, &now.pose, f64::INFINITY);
        });
        Ok(())
    }

    /// Finds other poses with the present pins; see `other_poses`.
    pub fn find_others(&mut self) -> &[OtherPose] {
        self.release();
        let goals = self.goals(
            &Drags::new(),
            &self.pins(),
            self.now.rest,
            &self.now.pose.xyz,
        );
        self.others = other_poses(&self.solver, &goals, &self.now.pose);
        &self.others
    }

    /// What [`Session::find_others`] found last.
    pub fn others(&self) -> &[OtherPose] {
        &self.others
    }

    /// Takes the pose of one that [`Session::find_others`] found last, with the pins as they are.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is none.
    pub fn take_other(&mut self, index: usize) -> Result<()> {
        let Some(other) = self.others.get(index) else {
            return Err(Error::usage(format!("there is no solution {index}")));
        };
        let pose = other.pose.clone();
        self.change("the other pose", |now, _| now.pose = pose);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::edit::session::tests::{pins_of, session};
    use glam::DVec3;

    #[test]
    fn other_poses_hold_the_pins_and_differ() {
        let mut session = session();
        let pins = pins_of(&session, &["lfoot", "rfoot", "lwrist"]);
        session.pin_all(&pins).unwrap();
        let now = session.state().pose.xyz.clone();
        let others = session.find_others().to_vec();
        assert!(!others.is_empty());
        let apart = |a: &[f64], b: &[f64]| {
            let joints = a.chunks_exact(3).zip(b.chunks_exact(3));
            joints
                .map(|(a, b)| (DVec3::from_slice(a) - DVec3::from_slice(b)).length())
                .fold(0.0, f64::max)
        };
        for (i, other) in others.iter().enumerate() {
            assert!(apart(&other.pose.xyz, &now) >= 5.0);
            assert!(others[..i].iter().all(
                |o| apart(&o.pose.xyz, &other.pose.xyz) >= 5.0 && o.evidence >= other.evidence
            ));
            for (&k, pin) in &pins {
                let at = DVec3::from_array(pin.map(Option::unwrap));
                assert!((DVec3::from_slice(&other.pose.xyz[3 * k..]) - at).length() < 0.05);
            }
        }
        session.take_other(0).unwrap();
        assert_eq!(session.pins(), pins);
        assert!(session.take_other(99).is_err());
    }
}
