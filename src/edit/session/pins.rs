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
        match at.iter().any(Option::is_some) {
            true => pins.insert(joint, at),
            false => pins.remove(&joint),
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
            let asked = self.asked(&Drags::new(), pins, self.now.rest, &self.now.pose.xyz);
            self.change("the pins", |now, _| now.pins = asked.pins);
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
