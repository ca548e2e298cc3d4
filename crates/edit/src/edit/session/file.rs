//! A session as a JSON file that opens again to the same state.

use super::{Session, State};
use crate::edit::keys::{Key, Keys};
use crate::edit::pose_solver::Pose;
use crate::pose::Similarity;
use crate::pose::rotation::is_rotation;
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// The largest file of a session, bytes: keys that would not fit are refused, so that what was
/// saved opens again.
pub const LARGEST_SESSION: usize = 64 << 20;
/// The most that a number takes in it, bytes, with its comma.
const LARGEST_NUMBER: usize = 26;
/// What the file says it is.
const FORMAT: &str = "posing session 1";
/// Values that put joints within this of where the file has them, cm, are of the same skeleton.
const SAME: f64 = 1e-6;
/// How far the numbers of a rotation may be from one.
const ROTATION: f64 = 1e-6;

/// A session in a file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SessionFile {
    format: String,
    /// The names of the joints, in the order of all arrays.
    joints: Vec<String>,
    pose: SavedPose,
    pins: Vec<[Option<f64>; 3]>,
    rest: f64,
    floor: bool,
    limits: bool,
    rate: f64,
    keys: Vec<SavedKey>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedKey {
    time: f64,
    pose: SavedPose,
    pins: Vec<[Option<f64>; 3]>,
}

/// A pose; numbers that are not known are null.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedPose {
    /// The values of the skeleton, radians and cm.
    values: Vec<f64>,
    /// The joints, cm.
    xyz: Vec<f64>,
    sd: Vec<Option<f64>>,
    /// How far each pinned joint is from its pin, cm.
    missed: Vec<f64>,
    unlike: Option<f64>,
    /// The rotation by rows and the shift (cm) of the placement.
    placement: [f64; 12],
}

impl Session {
    /// The session as a file; a gesture under way is in it as it is.
    pub fn to_json(&self) -> String {
        let state = self.state();
        let file = SessionFile {
            format: FORMAT.to_string(),
            joints: self.rig().names.clone(),
            pose: SavedPose::of(&state.pose),
            pins: state.pins.clone(),
            rest: state.rest,
            floor: state.floor,
            limits: state.limits,
            rate: state.keys.rate(),
            keys: (state.keys.iter())
                .map(|key| SavedKey {
                    time: key.time,
                    pose: SavedPose::of(&key.pose),
                    pins: key.pins.clone(),
                })
                .collect(),
        };
        serde_json::to_string(&file).unwrap_or_default()
    }

    /// The most keys that its file has room for.
    fn most_keys(&self) -> usize {
        let (joints, values) = (self.rig().joints(), self.rig().skeleton.dof_count());
        // Position, deviation, miss and pin of each joint, the placement and the time; a pin has
        // brackets.
        let numbers = values + 8 * joints + 16;
        let pose = LARGEST_NUMBER * numbers + 4 * joints + 200;
        let names: usize = self.rig().names.iter().map(|name| 6 * name.len() + 3).sum();
        (LARGEST_SESSION.saturating_sub(names) / pose).saturating_sub(1)
    }

    /// Checks that a session of so many keys can be saved.
    pub(super) fn check_key_count(&self, count: usize) -> Result<()> {
        let most = self.most_keys();
        if count <= most {
            Ok(())
        } else {
            Err(Error::usage(format!(
                "a session of this skeleton has at most {most} keys"
            )))
        }
    }

    /// Goes to the state of a file, as a step. Poses of another skeleton with the same joints are
    /// fitted with this one.
    ///
    /// # Errors
    /// [`Error::Usage`]: no session, of other joints, or with numbers that cannot be. Nothing
    /// changes then.
    pub fn open_json(&mut self, json: &[u8]) -> Result<()> {
        let file: SessionFile = serde_json::from_slice(json).map_err(|e| {
            Error::usage(format!(
                "is no session of posing edit: {}",
                shown(&e.to_string())
            ))
        })?;
        if file.format != FORMAT {
            let what = format!(
                "is no session that this version reads: its format is \"{}\"",
                shown(&file.format)
            );
            return Err(Error::usage(what));
        }
        if file.joints != self.rig().names {
            return Err(Error::usage(
                "the session is of a skeleton with other joints",
            ));
        }
        self.check_key_count(file.keys.len())?;
        self.check_numbers(file.rest, file.rate, file.keys.iter().map(|k| k.time))?;
        let pose = self.opened(&file.pose, &file.pins)?;
        let mut keys = Keys::default();
        keys.set_rate(file.rate);
        for key in &file.keys {
            keys.set(Key {
                time: key.time,
                pose: self.opened(&key.pose, &key.pins)?,
                pins: key.pins.clone(),
            });
        }
        let state = State {
            pose,
            pins: file.pins,
            rest: file.rest,
            floor: file.floor,
            limits: file.limits,
            keys,
        };
        self.restore("the opened session", state);
        Ok(())
    }

    fn opened(&self, saved: &SavedPose, pins: &[[Option<f64>; 3]]) -> Result<Pose> {
        let joints = self.rig().joints();
        let by_joint = [saved.sd.len(), saved.missed.len(), pins.len()];
        if saved.xyz.len() != 3 * joints || by_joint != [joints; 3] {
            return Err(Error::usage(
                "the session has poses of another number of joints",
            ));
        }
        self.check_pins(pins)?;
        let placement = saved.placement();
        if !is_rotation(placement.rotation, ROTATION) {
            return Err(Error::usage(
                "the session has a placement whose rotation is none",
            ));
        }
        let pose = Pose {
            q: saved.values.clone(),
            xyz: saved.xyz.clone(),
            sd: saved
                .sd
                .iter()
                .map(|sd| sd.unwrap_or(f64::INFINITY))
                .collect(),
            missed: saved.missed.clone(),
            unlike: saved.unlike,
            placement,
            is_moving: false,
        };
        let is_own = pose.q.len() == self.rig().skeleton.dof_count() && {
            let xyz = self.rig().positions(&pose.q);
            xyz.iter()
                .zip(&pose.xyz)
                .all(|(a, b)| (a - b).abs() <= SAME)
        };
        if is_own {
            return Ok(pose);
        }
        let fitted = self.solver().pose_at(&pose.xyz, &self.state().pose);
        fitted.ok_or_else(|| Error::usage("the session has a pose that is none"))
    }
}

impl SavedPose {
    fn of(pose: &Pose) -> SavedPose {
        let known = |v: f64| v.is_finite().then_some(v);
        let rows = pose.placement.rotation.transpose().to_cols_array();
        let shift = pose.placement.shift.to_array();
        SavedPose {
            values: pose.q.clone(),
            xyz: pose.xyz.clone(),
            sd: pose.sd.iter().map(|sd| known(*sd)).collect(),
            missed: pose.missed.clone(),
            unlike: pose.unlike,
            placement: std::array::from_fn(|i| if i < 9 { rows[i] } else { shift[i - 9] }),
        }
    }

    fn placement(&self) -> Similarity {
        Similarity {
            rotation: DMat3::from_cols_slice(&self.placement[..9]).transpose(),
            shift: DVec3::from_slice(&self.placement[9..]),
            ..Similarity::IDENTITY
        }
    }
}

/// Text from a file, fit for one line of a message.
fn shown(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(80).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edit::session::tests::{pins_of, session};

    #[test]
    fn a_file_opens_to_the_same_state() {
        let (mut session, mut other) = (session(), session());
        let pins = pins_of(&session, &["lfoot"]);
        session.pin_all(&pins).unwrap();
        let wrist = session.joint("lwrist").unwrap();
        session
            .drag(wrist, session.position(wrist) + DVec3::Y * 12.0)
            .unwrap();
        session.release();
        session.set_key(0.5).unwrap();
        let far = session.position(wrist) + DVec3::X * 300.0;
        session.pin(wrist, far.to_array().map(Some)).unwrap();
        let json = session.to_json();
        other.open_json(json.as_bytes()).unwrap();
        assert_eq!(other.to_json(), json);
        assert_eq!(other.state().pose.q, session.state().pose.q);
        assert!(session.state().pose.missed[wrist] > 50.0);
        assert_eq!(other.state().pose.missed, session.state().pose.missed);
        let before = other.state().clone();
        for wrong in [
            "",
            "{}",
            "[1",
            &json.replace("session 1", "session 9"),
            &json.replace("lwrist", "nose"),
        ] {
            assert!(other.open_json(wrong.as_bytes()).is_err());
        }
        let odd = other.open_json(b"{\"format\x7f\": 1}");
        let said = odd.unwrap_err().to_string();
        assert!(said.contains("is no session") && !said.contains(char::is_control));
        let stretched = json.replacen("\"xyz\":[", "\"xyz\":[0.5,", 1);
        assert!(
            other.open_json(stretched.as_bytes()).is_err(),
            "a number too many"
        );
        let mut stretching: serde_json::Value = serde_json::from_str(&json).unwrap();
        stretching["keys"][0]["pose"]["placement"][4] = 1.01.into();
        let refused = other.open_json(stretching.to_string().as_bytes());
        assert!(refused.unwrap_err().to_string().contains("rotation"));
        assert_eq!(other.state(), &before);
    }

    #[test]
    fn a_session_has_no_more_keys_than_open_again() {
        let mut session = session();
        let most = session.most_keys();
        assert!(most > 4000, "{most}");
        let before = session.to_json().len();
        session.set_key(0.5).unwrap();
        let key = session.to_json().len() - before;
        assert!(
            (most + 1) * key < LARGEST_SESSION,
            "{most} keys of {key} bytes"
        );
        assert!(session.check_key_count(most + 1).is_err());
    }
}
