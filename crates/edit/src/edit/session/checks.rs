//! What requests and files may say of a session.

use super::{Drags, Pins, Session};
use crate::edit::pose_solver::{DRAG_RANGE, REST, REST_RANGE};
use crate::{Error, Result};

/// The latest time of a key, seconds.
const LATEST: f64 = 3600.0;
/// Farther from the origin nothing is placed, cm.
const FARTHEST: f64 = 1e5;

impl Session {
    /// Checks a request for a pose: there are the joints, and the numbers are in range.
    pub(super) fn check(&self, drags: &Drags, pins: &Pins, rest: f64) -> Result<()> {
        self.check_joints(drags.keys().chain(pins.keys()))?;
        let name = |k: usize| &self.rig().names[k];
        for (&k, (target, sd)) in drags {
            check_position(&target.to_array(), || format!("{}: the target", name(k)))?;
            check_range(*sd, DRAG_RANGE, || format!("{}: sd", name(k)))?;
        }
        for (&k, pin) in pins {
            let pin: Vec<f64> = pin.iter().flatten().copied().collect();
            check_position(&pin, || format!("{}: the pin", name(k)))?;
        }
        check_range(rest, REST_RANGE, || "rest".to_string())
    }

    pub(super) fn check_joints<'k>(
        &self,
        joints: impl IntoIterator<Item = &'k usize>,
    ) -> Result<()> {
        let mut joints = joints.into_iter();
        match joints.find(|k| **k >= self.rig().joints()) {
            Some(k) => Err(Error::usage(format!("there is no joint {k}"))),
            None => Ok(()),
        }
    }

    /// Checks the numbers of a state that did not come from this session.
    pub(super) fn check_numbers(
        &self,
        rest: f64,
        rate: f64,
        mut times: impl Iterator<Item = f64>,
    ) -> Result<()> {
        self.check(&Drags::new(), &Pins::new(), rest)?;
        check_rate(rate)?;
        times.try_for_each(check_time)
    }

    /// Checks pins (K) that did not come from this session.
    pub(super) fn check_pins(&self, pins: &[[Option<f64>; 3]]) -> Result<()> {
        let pins = pins.iter().copied().enumerate().collect();
        self.check(&Drags::new(), &pins, REST)
    }

    pub(super) fn check_key(&self, key: usize) -> Result<()> {
        match self.now.keys.get(key) {
            Some(_) => Ok(()),
            None => Err(Error::usage(format!("there is no key {key}"))),
        }
    }
}

/// An error that tells what is wrong, unless all is right.
fn check(is_right: bool, wrong: impl FnOnce() -> String) -> Result<()> {
    if is_right {
        Ok(())
    } else {
        Err(Error::usage(wrong()))
    }
}

fn check_position(coordinates: &[f64], what: impl FnOnce() -> String) -> Result<()> {
    let is_near = coordinates.iter().all(|v| v.abs() <= FARTHEST);
    check(is_near, || {
        format!("{} is not a place within {FARTHEST} cm", what())
    })
}

fn check_range(cm: f64, (least, most): (f64, f64), what: impl FnOnce() -> String) -> Result<()> {
    let wrong = || format!("{} is {cm}; expected {least} to {most} cm", what());
    check((least..=most).contains(&cm), wrong)
}

pub(super) fn check_rate(rate: f64) -> Result<()> {
    let wrong = || format!("the rate is {rate}; expected 1 to 1000 frames a second");
    check((1.0..=1000.0).contains(&rate), wrong)
}

pub(super) fn check_time(time: f64) -> Result<()> {
    let wrong = || format!("the time is {time}; expected 0 to {LATEST} seconds");
    check((0.0..=LATEST).contains(&time), wrong)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edit::session::tests::session;
    use glam::DVec3;

    #[test]
    fn a_refused_request_changes_nothing() {
        let mut session = session();
        let before = session.state().clone();
        let wrist = session.joint("lwrist").unwrap();
        let at = |target, sd| Drags::from([(wrist, (target, sd))]);
        assert!(
            session
                .solve(&at(DVec3::NAN, 1.0), &Pins::new(), REST)
                .is_err()
        );
        assert!(
            session
                .solve(&at(DVec3::ZERO, -1.0), &Pins::new(), REST)
                .is_err()
        );
        assert!(
            session
                .solve(&at(DVec3::splat(1e300), 1.0), &Pins::new(), REST)
                .is_err()
        );
        assert!(
            session
                .solve(&at(DVec3::ZERO, 1.0), &Pins::new(), f64::NAN)
                .is_err()
        );
        assert!(session.pin(99, [Some(0.0); 3]).is_err());
        assert!(session.set_key(-1.0).is_err() && session.open_key(0).is_err());
        assert_eq!((session.state(), session.revision()), (&before, 0));
    }
}
