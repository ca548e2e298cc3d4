//! The key poses of a session, and the motion through them.

use super::Session;
use super::checks::{check_rate, check_time};
use crate::Result;
use crate::edit::in_betweens::{Motion, in_betweens};
use crate::edit::keys::Key;

impl Session {
    /// Makes the pose and its pins a key at `time`, seconds.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage): the time is negative or too large, or there are too
    /// many keys.
    pub fn set_key(&mut self, time: f64) -> Result<()> {
        check_time(time)?;
        self.check_key_count(self.now.keys.len() + 1)?;
        self.change("the key", |now, _| {
            let (pose, pins) = (now.pose.clone(), now.pins.clone());
            now.keys.set(Key { time, pose, pins });
        });
        Ok(())
    }

    /// Makes the pose and the pins of a key the present ones.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage): there is no such key.
    pub fn open_key(&mut self, key: usize) -> Result<()> {
        self.check_key(key)?;
        self.change("the way to another key", |now, _| {
            now.pose = now.keys[key].pose.clone();
            now.pins = now.keys[key].pins.clone();
        });
        Ok(())
    }

    /// Moves a key to another time, seconds; it replaces a key that is there.
    ///
    /// # Errors
    /// As [`Session::set_key`] and [`Session::open_key`].
    pub fn move_key(&mut self, key: usize, time: f64) -> Result<()> {
        self.check_key(key)?;
        check_time(time)?;
        self.change("the move of a key", |now, _| {
            let moved = now.keys.remove(key);
            now.keys.set(Key { time, ..moved });
        });
        Ok(())
    }

    /// Removes a key.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage): there is no such key.
    pub fn remove_key(&mut self, key: usize) -> Result<()> {
        self.check_key(key)?;
        self.change("the removal of a key", |now, _| {
            now.keys.remove(key);
        });
        Ok(())
    }

    /// Sets the frames a second of the motion between keys.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage): not from 1 to 1000.
    pub fn set_rate(&mut self, rate: f64) -> Result<()> {
        check_rate(rate)?;
        self.change("the rate", |now, _| now.keys.set_rate(rate));
        Ok(())
    }

    /// The motion through the keys.
    ///
    /// # Errors
    /// As [`in_betweens`].
    pub fn motion(&self) -> Result<Motion> {
        let keys = &self.now.keys;
        in_betweens(&self.solver, keys, keys.rate(), self.now.floor)
    }

    /// The present pose as a motion of one frame; joints that are pinned have no standard
    /// deviation.
    pub fn still(&self, rate: f64) -> Motion {
        Motion::of_one(&self.now.pose, &self.now.pins, rate)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{DRAG_SD, Drags};
    use crate::edit::pose_solver::REST;
    use crate::edit::session::tests::{pins_of, session};
    use glam::DVec3;

    #[test]
    fn keys_are_met_exactly_and_pinned_feet_stay_between() {
        let mut session = session();
        let feet = pins_of(&session, &["lfoot", "rfoot"]);
        session.pin_all(&feet).unwrap();
        session.set_key(0.0).unwrap();
        let first = session.state().pose.xyz.clone();
        let root = session.joint("root").unwrap();
        let down = session.position(root) + DVec3::new(0.0, -25.0, -5.0);
        session
            .solve(&Drags::from([(root, (down, DRAG_SD))]), &feet, REST)
            .unwrap();
        session.release();
        session.set_key(1.01).unwrap();
        let last = session.state().pose.xyz.clone();
        assert!(session.motion().is_ok());
        let motion = session.motion().unwrap();
        assert_eq!(motion.xyz.nrows(), 31);
        assert_eq!(motion.xyz.row(0).to_vec(), first);
        assert_eq!(motion.xyz.row(30).to_vec(), last);
        for ((_, k), is_fixed) in motion.fixed.indexed_iter() {
            assert_eq!(*is_fixed, feet.contains_key(&k));
        }
        for row in motion.xyz.rows() {
            for (&foot, pin) in &feet {
                let at = DVec3::from_slice(&row.to_vec()[3 * foot..]);
                assert!((at - DVec3::from_array(pin.map(Option::unwrap))).length() < 1e-2);
            }
        }
        let step = |t: usize| {
            (&motion.xyz.row(t + 1) - &motion.xyz.row(t)).fold(0.0, |z: f64, v| z.max(v.abs()))
        };
        assert!((0..30).all(|t| step(t) < 4.0), "no frame jumps");
        session.remove_key(0).unwrap();
        assert!(session.motion().is_err());
    }
}
