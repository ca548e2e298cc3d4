//! The messages between a session and the page that shows it: JSON, lengths in cm, joints by name.

use super::keys::Key;
use super::other_poses::OtherPose;
use super::photograph::Marks;
use super::pose_solver::Pose;
use super::session::{DRAG_SD, Drags, Pins, Session};
use crate::{Error, Result};
use glam::{DVec2, DVec3};
use ndarray::ArrayView1;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Coordinates by the names of joints; `null` leaves one free.
pub(crate) type NamedPins = BTreeMap<String, [Option<f64>; 3]>;

/// The goals of a pose.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct SolveRequest {
    /// Joints that are exact.
    pub pins: NamedPins,
    /// Joints that are dragged.
    pub drags: BTreeMap<String, NamedDrag>,
    /// The standard deviation of the others about where they were, cm; that of the session if
    /// absent.
    pub rest: Option<f64>,
}

/// Where a joint is dragged.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct NamedDrag {
    /// The target, cm.
    pub xyz: [f64; 3],
    /// Its standard deviation, cm.
    #[serde(default = "drag_sd")]
    pub sd: f64,
}

fn all_axes() -> String {
    "xyz".to_string()
}

fn drag_sd() -> f64 {
    DRAG_SD
}

/// A change of the session that is no drag.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) enum Action {
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
    /// Pins joints where they are now.
    PinHere {
        /// Their names.
        joints: Vec<String>,
        /// The coordinates, such as `xyz` or `y`.
        #[serde(default = "all_axes")]
        axes: String,
    },
    /// Takes their pins away.
    Unpin {
        /// Their names.
        joints: Vec<String>,
    },
    /// Sets how far joints may go from where they were.
    Rest {
        /// Centimeters.
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
    /// Takes a row of the table that was given.
    Row {
        /// Its index.
        row: usize,
    },
    /// Takes one of the poses that were found last.
    Take {
        /// Its index.
        solution: usize,
    },
    /// Exchanges left and right, or copies one side to the other.
    Mirror {
        /// The side that is copied.
        side: Side,
    },
    /// Resets joints: the model places them by the others.
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
pub(crate) enum Side {
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
    pub(crate) fn solve_request(&mut self, request: &SolveRequest) -> Result<()> {
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
    /// [`Error::Usage`]: a joint, key or pose that there is not, or a number that cannot be.
    /// Nothing changes then.
    pub(crate) fn act(&mut self, action: &Action) -> Result<()> {
        match action {
            Action::Release => self.release(),
            Action::Cancel => self.cancel(),
            Action::Undo => self.undo(),
            Action::Redo => self.redo(),
            Action::Pin { pins } => self.pin_all(&self.pins_by_index(pins)?)?,
            Action::PinHere { joints, axes } => {
                if axes.is_empty() || !axes.chars().all(|c| "xyz".contains(c)) {
                    return Err(Error::usage("axes are some of the letters x, y and z"));
                }
                let axes = ['x', 'y', 'z'].map(|c| axes.contains(c));
                self.pin_here(&self.all_named(joints)?, axes)?;
            }
            Action::Unpin { joints } => self.pin_here(&self.all_named(joints)?, [false; 3])?,
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
            Action::Row { row } => self.take_row(*row)?,
            Action::Take { solution } => self.take_other(*solution)?,
            Action::Mirror { side } => match side {
                Side::Both => self.mirror(),
                Side::Left => self.copy_side("l"),
                Side::Right => self.copy_side("r"),
            },
            Action::Reset { joints } => {
                self.reset(&self.all_named(joints)?)?;
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
    pub(crate) fn named(&self, name: &str) -> Result<usize> {
        let found = self.joint(name);
        found.ok_or_else(|| {
            let name: String = name.chars().take(40).collect();
            Error::usage(format!("there is no joint \"{name}\""))
        })
    }

    fn all_named(&self, names: &[String]) -> Result<Vec<usize>> {
        names.iter().map(|name| self.named(name)).collect()
    }

    fn pins_by_index(&self, pins: &NamedPins) -> Result<Pins> {
        let by_index = pins.iter().map(|(name, pin)| Ok((self.named(name)?, *pin)));
        let pins: Result<Pins> = by_index.collect();
        let mut pins = pins?;
        pins.retain(|_, pin| pin.iter().any(Option::is_some));
        Ok(pins)
    }

    /// A pose as the page has it.
    pub(crate) fn pose_json(&self, pose: &Pose) -> Value {
        let by_name = |values: &[f64], keep: fn(f64) -> bool| -> Value {
            let named = self.rig().names.iter().zip(values);
            let kept = named.filter(|(_, v)| keep(**v));
            kept.map(|(n, v)| (n.clone(), json!(rounded(*v)))).collect()
        };
        json!({
            "pose": self.positions_json(&pose.xyz),
            "sd": by_name(&pose.sd, f64::is_finite),
            "missed": by_name(&pose.missed, |v| v > 0.0),
            "unlike": pose.unlike.map(rounded),
            "moving": pose.is_moving,
            "revision": self.revision(),
        })
    }

    /// Positions of joints (3 K, cm) by name.
    pub(crate) fn positions_json(&self, xyz: &[f64]) -> Value {
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
    pub(crate) fn state_json(&self) -> Map<String, Value> {
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
                "pose": self.positions_json(&key.pose.xyz),
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
            "rows": self.rows().nrows(),
            "rate": state.keys.rate(),
            "keys": state.keys.iter().map(key).collect::<Value>(),
            "key": state.keys.find(&state.pose, &state.pins),
        });
        let mut out = object(self.pose_json(&state.pose));
        out.extend(object(rest));
        out
    }

    /// The start poses as the page has them.
    pub(crate) fn starts_json(&self) -> Value {
        let start = |s: &super::StartPose| {
            let pose = self.positions_json(&s.pose.xyz);
            json!({ "name": s.name, "pose": pose })
        };
        self.starts().iter().map(start).collect()
    }
}

/// Marks on a photograph, in pixels from its upper left corner, y down.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PhotographRequest {
    /// Where joints are.
    pub marks: BTreeMap<String, [f64; 2]>,
    /// Width and height of the picture.
    pub size: [f64; 2],
    /// The focal length, mm on a picture 36 mm long; weak perspective if absent.
    #[serde(default)]
    pub focal: Option<f64>,
    /// Joints below which the limb is bent the other way in depth.
    #[serde(default)]
    pub flips: Vec<String>,
}

impl Session {
    /// Poses the figure by a photograph; the answer is a pose with `picture`, where each joint
    /// falls, and `next`, the joint to mark next.
    ///
    /// # Errors
    /// [`Error::Usage`]: a joint that there is not, numbers that cannot be, or too few marks.
    pub(crate) fn photograph_request(&mut self, request: &PhotographRequest) -> Result<Value> {
        let [width, height] = request.size;
        let is_size = |v: f64| (1.0..=1e5).contains(&v);
        if !is_size(width) || !is_size(height) {
            return Err(Error::usage(
                "the size of the picture is not 1 to 100000 pixels",
            ));
        }
        if request
            .focal
            .is_some_and(|mm| !(5.0..=1000.0).contains(&mm))
        {
            return Err(Error::usage("the focal length is not 5 to 1000 mm"));
        }
        let mut marks = Marks {
            focal: request.focal.map(|mm| mm / 36.0 * width.max(height)),
            ..Marks::default()
        };
        for (name, at) in &request.marks {
            if !at.iter().all(|v| v.abs() <= 2e5) {
                return Err(Error::usage(format!(
                    "{name}: the mark is not in the picture"
                )));
            }
            let from_middle = DVec2::new(at[0] - width / 2.0, height / 2.0 - at[1]);
            marks.at.insert(self.named(name)?, from_middle);
        }
        marks.flips = self.all_named(&request.flips)?;
        let fit = self.photograph(&marks)?;
        let picture = self.rig().names.iter().zip(fit.pose.xyz.chunks_exact(3));
        let picture = picture.map(|(name, at)| {
            let at = fit.camera.project(DVec3::from_slice(at));
            (
                name.clone(),
                json!([rounded(width / 2.0 + at.x), rounded(height / 2.0 - at.y)]),
            )
        });
        let mut answer = object(self.pose_json(&fit.pose));
        answer.insert("picture".into(), picture.collect());
        answer.insert("next".into(), json!(fit.next.map(|k| &self.rig().names[k])));
        Ok(Value::Object(answer))
    }

    /// Finds other poses with the present pins, as the page has them.
    pub(crate) fn others_json(&mut self) -> Value {
        self.find_others();
        let other = |other: &OtherPose| {
            let mut pose = object(self.pose_json(&other.pose));
            pose.insert("evidence".into(), json!(rounded(other.evidence)));
            Value::Object(pose)
        };
        let others: Value = self.others().iter().map(other).collect();
        json!({ "solutions": others })
    }

    /// The motion through the keys, as the page has it.
    ///
    /// # Errors
    /// As [`Session::motion`].
    pub(crate) fn motion_json(&self) -> Result<Value> {
        let motion = self.motion()?;
        let frame = |row: ArrayView1<'_, f64>| row.iter().map(|v| rounded(*v)).collect::<Vec<_>>();
        let frames: Vec<Vec<f64>> = motion.xyz.rows().into_iter().map(frame).collect();
        Ok(json!({ "rate": motion.rate, "first": motion.first, "frames": frames }))
    }
}

/// The members of an object.
fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(members) => members,
        _ => Map::new(),
    }
}

/// A thousandth of a millimeter is enough for a page.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
