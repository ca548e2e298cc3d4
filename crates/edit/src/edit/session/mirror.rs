//! Left and right: mirroring a pose, and copying one side of it onto the other.

use super::Session;

impl Session {
    /// Exchanges left and right about the body's own plane.
    pub fn mirror(&mut self) {
        let mirrored = self.solver.rig.mirrored(&self.now.pose.xyz);
        self.take_mirrored(&mirrored, &|_| true, "the mirroring");
    }

    /// Copies one side of the body, the joints whose names (or those of their points) begin with
    /// `from`, onto the other; joints between the sides move onto the plane between them.
    pub fn copy_side(&mut self, from: &str) {
        let (rig, xyz) = (&self.solver.rig, &self.now.pose.xyz);
        let points = &self.solver.model.points;
        let begins = |name: &str| name.to_lowercase().starts_with(from);
        let name = |k: usize| rig.model_points[k].map_or(&rig.names[k], |p| &points[p]);
        let mirrored = rig.mirrored(xyz);
        let is_other: Vec<bool> = (0..rig.joints())
            .map(|k| rig.mirrors[k].is_some_and(|m| begins(name(m))))
            .collect();
        let share = |k: usize| match rig.mirrors[k] {
            None => 0.5,
            Some(_) if is_other[k] => 1.0,
            Some(_) => 0.0,
        };
        let positions: Vec<f64> = (0..xyz.len())
            .map(|c| xyz[c] + share(c / 3) * (mirrored[c] - xyz[c]))
            .collect();
        self.take_mirrored(&positions, &|k| is_other[k], "the copy of a side");
    }

    /// Takes mirrored positions (3 K, cm) of the joints. A copied joint is pinned where its other
    /// was.
    fn take_mirrored(&mut self, positions: &[f64], is_copied: &dyn Fn(usize) -> bool, step: &str) {
        let Some(pose) = self.solver.pose_at(positions, &self.now.pose) else {
            return;
        };
        let mirrors = self.solver.rig.mirrors.clone();
        self.change(step, |now, _| {
            let pins = std::mem::replace(&mut now.pins, vec![[None; 3]; mirrors.len()]);
            now.pose = pose;
            for (k, pin) in now.pins.iter_mut().enumerate() {
                let source = if is_copied(k) {
                    mirrors[k].unwrap_or(k)
                } else {
                    k
                };
                let at = &now.pose.xyz[3 * k..3 * k + 3];
                *pin = std::array::from_fn(|c| pins[source][c].map(|_| at[c]));
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edit::session::tests::session;
    use glam::DVec3;

    #[test]
    fn mirroring_twice_comes_back_and_a_side_is_copied() {
        let mut session = session();
        let at = |s: &Session, name: &str| s.position(s.joint(name).unwrap());
        let wrist = session.joint("lwrist").unwrap();
        session
            .drag(wrist, at(&session, "lwrist") + DVec3::new(10.0, 25.0, 5.0))
            .unwrap();
        session.release();
        let before = session.state().pose.xyz.clone();
        session.mirror();
        let mirrored = session.rig().mirrored(&before);
        let apart = |a: &[f64], b: &[f64]| {
            a.iter()
                .zip(b)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max)
        };
        // The bones of the two sides are not of one length.
        assert!(apart(&session.state().pose.xyz, &mirrored) < 3.0);
        session.mirror();
        assert!(apart(&session.state().pose.xyz, &before) < 3.0);
        session.copy_side("l");
        assert!(at(&session, "rwrist").y > at(&session, "rhumerus").y - 60.0);
        assert!((at(&session, "rwrist").y - at(&session, "lwrist").y).abs() < 5.0);
    }
}
