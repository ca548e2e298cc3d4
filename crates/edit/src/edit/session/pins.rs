//! Pins: the coordinates of joints that are exact.

use super::{Drags, Pins, Session};
use crate::Result;

/// A joint this near to its pin is there, cm: pages round.
const THERE: f64 = 1e-3;

impl Session {
    /// The joints that are pinned.
    pub fn pins(&self) -> Pins {
        let pins = self.now.pins.iter().copied().enumerate();
        pins.filter(|(_, pin)| pin.iter().any(Option::is_some))
            .collect()
    }

    /// Pins a joint at some coordinates, cm, and moves it there; no coordinate: frees it.
    ///
    /// # Errors
    /// As [`Session::solve`].
    pub fn pin(&mut self, joint: usize, at: [Option<f64>; 3]) -> Result<()> {
        let mut pins = self.pins();
        if at.iter().any(Option::is_some) {
            pins.insert(joint, at)
        } else {
            pins.remove(&joint)
        };
        self.pin_all(&pins)
    }

    /// Replaces all pins. Joints that are not where they are pinned now move there.
    ///
    /// # Errors
    /// As [`Session::solve`].
    pub fn pin_all(&mut self, pins: &Pins) -> Result<()> {
        self.check(&Drags::new(), pins, self.now.rest)?;
        let is_there = |(&k, pin): (&usize, &[Option<f64>; 3])| {
            let at = self.position(k).to_array();
            let apart = pin.iter().zip(at).filter_map(|(p, at)| p.map(|p| p - at));
            apart.into_iter().all(|d| d.abs() <= THERE)
        };
        if pins.iter().all(is_there) {
            let goals = self.goals(&Drags::new(), pins, self.now.rest, &self.now.pose.xyz);
            self.change("the pins", |now, _| {
                now.pins = goals.pins;
                now.pose.missed.fill(0.0);
            });
            return Ok(());
        }
        self.solve(&Drags::new(), pins, self.now.rest)?;
        self.release();
        Ok(())
    }

    /// Pins joints at some of their coordinates (x, y, z), where they are now.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage): there is no such joint.
    pub fn pin_here(&mut self, joints: &[usize], axes: [bool; 3]) -> Result<()> {
        self.check_joints(joints)?;
        self.release();
        let mut pins = self.pins();
        for &k in joints {
            let at = self.position(k).to_array();
            pins.insert(k, std::array::from_fn(|c| axes[c].then_some(at[c])));
        }
        pins.retain(|_, pin| pin.iter().any(Option::is_some));
        self.pin_all(&pins)
    }
}

#[cfg(test)]
mod tests {
    use crate::edit::session::tests::{pins_of, session};
    use glam::DVec3;

    #[test]
    fn joints_without_their_pins_are_no_longer_out_of_reach() {
        let mut session = session();
        let mut pins = pins_of(&session, &["lfoot"]);
        let wrist = session.joint("lwrist").unwrap();
        let far = session.position(wrist) + DVec3::X * 300.0;
        pins.insert(wrist, far.to_array().map(Some));
        session.pin_all(&pins).unwrap();
        assert!(session.state().pose.missed[wrist] > 50.0);
        let pinned: Vec<usize> = pins.into_keys().collect();
        session.pin_here(&pinned, [false; 3]).unwrap();
        assert!(session.pins().is_empty());
        assert!(session.state().pose.missed.iter().all(|m| *m == 0.0));
    }
}
