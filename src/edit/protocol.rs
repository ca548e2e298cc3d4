//! The messages between a session and the page that shows it: JSON, lengths in cm, joints by name.

use super::keys::Key;
use super::pose_solver::Pose;
use super::session::{DRAG_SD, Drags, Pins, Session};
use crate::{Error, Result};
use glam::DVec3;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Coordinates by the names of joints; `null` leaves one free.
pub type NamedPins = BTreeMap<String, [Option<f64>; 3]>;

/// What a pose is asked to do.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolveRequest {
    /// Joints that are exact.
    pub pins: NamedPins,
    /// Joints that are dragged.
    pub drags: BTreeMap<String, NamedDrag>,
    /// The standard deviation of the others about where they were, cm; that of the session if absent.
    pub rest: Option<f64>,
}

/// Where a joint is dragged.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NamedDrag {
    /// The target, cm.
    pub xyz: [f64; 3],
    /// Its standard deviation, cm.
    #[serde(default = "drag_sd")]
    pub sd: f64,
}

fn drag_sd() -> f64 {
    DRAG_SD
}

/// A change of the session that is no drag.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Action {
    /// Ends the gesture.
    Release,
    /// Goes back to where the gesture began.
    Cancel,
    /// Undoes a step.
    Undo,
    /// Does it again.
    Redo,
    /// Replaces all pins.
    Pin {
        /// The joints that are pinned.
        pins: NamedPins,
    },
    /// Sets how far joints may go from where they were.
    Rest {
        /// Centimetres.
        cm: f64,
    },
    /// Keeps the skeleton's limits, or not.
    Limits {
        /// Whether.
        on: bool,
    },
    /// Keeps joints above the floor, or not.
    Floor {
        /// Whether.
        on: bool,
    },
    /// Takes a start pose.
    Start {
        /// Its index.
        start: usize,
    },
    /// Exchanges left and right, or copies one side to the other.
    Mirror {
        /// The side that is copied.
        side: Side,
    },
    /// Joints forget where they were.
    Reset {
        /// Their names.
        joints: Vec<String>,
    },
    /// Makes the pose a key.
    Key {
        /// Seconds.
        time: f64,
    },
    /// Makes a key's pose the present one.
    KeyOpen {
        /// Its index.
        key: usize,
    },
    /// Moves a key in time.
    KeyMove {
        /// Its index.
        key: usize,
        /// Seconds.
        time: f64,
    },
    /// Removes a key.
    KeyRemove {
        /// Its index.
        key: usize,
    },
    /// Sets the rate of the motion.
    Rate {
        /// Frames a second.
        fps: f64,
    },
}

/// What is mirrored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Left and right are exchanged.
    Both,
    /// The left side is copied to the right.
    Left,
    /// The right side is copied to the left.
    Right,
}

impl Session {
    /// Solves what a request asks for; see [`Session::solve`].
    ///
    /// # Errors
    /// [`Error::Usage`]: a joint that there is not, or a number that cannot be.
    pub fn solve_request(&mut self, request: &SolveRequest) -> Result<()> {
        let pins = self.pins_by_index(&request.pins)?;
        let mut drags = Drags::new();
        for (name, drag) in &request.drags {
            drags.insert(self.named(name)?, (DVec3::from_array(drag.xyz), drag.sd));
        }
        let rest = request.rest.unwrap_or(self.state().rest);
        self.solve(&drags, &pins, rest)?;
        Ok(())
    }

    /// Does what an action says.
    ///
    /// # Errors
    /// [`Error::Usage`]: a joint, key or pose that there is not, or a number that cannot be. Nothing changes then.
    pub fn act(&mut self, action: &Action) -> Result<()> {
        match action {
            Action::Release => self.release(),
            Action::Cancel => self.cancel(),
            Action::Undo => self.undo(),
            Action::Redo => self.redo(),
            Action::Pin { pins } => self.pin_all(&self.pins_by_index(pins)?)?,
            Action::Rest { cm } => self.set_rest(*cm)?,
            Action::Limits { on } => self.set_limits(*on),
            Action::Floor { on } => self.set_floor(*on),
            Action::Start { start } => {
                let Some(start) = self.starts().get(*start) else {
                    return Err(Error::usage(format!("there is no start pose {start}")));
                };
                let pose = start.pose.clone();
                self.take("the start pose", pose);
            }
            Action::Mirror { side } => match side {
                Side::Both => self.mirror(),
                Side::Left => self.copy_side("l"),
                Side::Right => self.copy_side("r"),
            },
            Action::Reset { joints } => {
                let joints: Result<Vec<usize>> = joints.iter().map(|j| self.named(j)).collect();
                self.reset(&joints?)?;
            }
            Action::Key { time } => self.set_key(*time)?,
            Action::KeyOpen { key } => self.open_key(*key)?,
            Action::KeyMove { key, time } => self.move_key(*key, *time)?,
            Action::KeyRemove { key } => self.remove_key(*key)?,
            Action::Rate { fps } => self.set_rate(*fps)?,
        }
        Ok(())
    }

    /// The joint of a name.
    ///
    /// # Errors
    /// [`Error::Usage`]: there is none.
    pub fn named(&self, name: &str) -> Result<usize> {
        let found = self.joint(name);
        found.ok_or_else(|| {
            let name: String = name.chars().take(40).collect();
            Error::usage(format!("there is no joint \"{name}\""))
        })
    }

    fn pins_by_index(&self, pins: &NamedPins) -> Result<Pins> {
        let by_index = pins.iter().map(|(name, pin)| Ok((self.named(name)?, *pin)));
        let pins: Result<Pins> = by_index.collect();
        let mut pins = pins?;
        pins.retain(|_, pin| pin.iter().any(Option::is_some));
        Ok(pins)
    }

    /// A pose as the page has it.
    pub fn pose_json(&self, pose: &Pose) -> Value {
        let by_name = |values: &[f64], keep: fn(f64) -> bool| -> Value {
            let named = self.rig().names.iter().zip(values);
            let kept = named.filter(|(_, v)| keep(**v));
            kept.map(|(n, v)| (n.clone(), json!(rounded(*v)))).collect()
        };
        json!({
            "pose": self.places_json(&pose.xyz),
            "sd": by_name(&pose.sd, f64::is_finite),
            "missed": by_name(&pose.missed, |v| v > 0.0),
            "unlike": pose.unlike.is_finite().then(|| rounded(pose.unlike)),
            "moving": pose.is_moving,
            "revision": self.revision(),
        })
    }

    /// Positions of joints (3 K, cm) by name.
    pub fn places_json(&self, xyz: &[f64]) -> Value {
        let named = self.rig().names.iter().zip(xyz.chunks_exact(3));
        named
            .map(|(name, p)| {
                (
                    name.clone(),
                    json!([rounded(p[0]), rounded(p[1]), rounded(p[2])]),
                )
            })
            .collect()
    }

    /// The pins by name.
    fn pins_json(&self, pins: &[[Option<f64>; 3]]) -> Value {
        let named = self.rig().names.iter().zip(pins);
        let pinned = named.filter(|(_, pin)| pin.iter().any(Option::is_some));
        pinned.map(|(n, pin)| (n.clone(), json!(pin))).collect()
    }

    /// The whole state as the page has it, but for the start poses.
    pub fn state_json(&self) -> Map<String, Value> {
        let (rig, state) = (self.rig(), self.state());
        let name = |k: usize| &rig.names[k];
        let of_joints = |of: &dyn Fn(usize) -> Value| -> Value {
            (0..rig.joints())
                .map(|k| (name(k).clone(), of(k)))
                .collect()
        };
        let mirrors =
            (0..rig.joints()).filter_map(|k| Some((name(k).clone(), json!(name(rig.mirrors[k]?)))));
        let key = |key: &Key| {
            json!({
                "time": key.time,
                "pose": self.places_json(&key.pose.xyz),
                "pins": self.pins_json(&key.pins),
            })
        };
        let limits = rig.skeleton.limits();
        let rest = json!({
            "joints": rig.names,
            "parents": of_joints(&|k| json!(rig.parents[k].map(name))),
            "mirrors": mirrors.collect::<Value>(),
            "pins": self.pins_json(&state.pins),
            "rest": state.rest,
            "limits": state.limits,
            "can_limit": limits.iter().any(|(low, high)| low.is_finite() || high.is_finite()),
            "floor": state.floor,
            "undo": self.history().undo_step(),
            "redo": self.history().redo_step(),
            "rate": state.keys.rate(),
            "keys": state.keys.iter().map(key).collect::<Value>(),
            "key": state.keys.find(&state.pose, &state.pins),
        });
        let mut out = object(self.pose_json(&state.pose));
        out.extend(object(rest));
        out
    }

    /// The start poses as the page has them.
    pub fn starts_json(&self) -> Value {
        let start =
            |s: &super::StartPose| json!({ "name": s.name, "pose": self.places_json(&s.pose.xyz) });
        self.starts().iter().map(start).collect()
    }
}

/// The members of an object.
fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(members) => members,
        _ => Map::new(),
    }
}

/// A thousandth of a millimetre is enough for a page.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
