//! Motion of one skeleton on another: rotations carried over, the root scaled by the legs, feet
//! planted as they were.
//!
//! [`Retargeter`] holds a rig and takes sources with rotations, one after another. Directions of
//! limbs are the source's (see `transfer`); the middle of the hips is at `k` times its position,
//! `k` the ratio of the legs, and the root follows from it; see `feet` for the contacts and `soles`
//! for how feet stand. A source's missing channels (nan) are missing in the rig's joints that
//! depend on them, and in no others.
//!
//! Joints are told by maps of names, else by the shape of the tree (`segments`, `shape`). Rest
//! poses that are no bodies are replaced by a frame in which one stands (`rest`).

pub(in crate::ik) mod feet;
mod figure;
pub(in crate::ik) mod hierarchy;
mod rest;
pub(in crate::ik) mod segments;
pub(in crate::ik) mod shape;
mod soles;
mod transfer;
pub(in crate::ik) mod tuning;
mod up_axis;

pub use rest::Rest;
pub use segments::cmu_map;
pub use up_axis::up_axis;

use crate::io::Bvh;
use crate::numeric::parallel::map_chunks;
use crate::pose::rotation::{Axis, decompose};
use crate::pose::two_bone::TwoBones;
use crate::pose::{Channel, NameMap, UpAxis};
use crate::{Error, Result};
use feet::{LegFrame, Planted, plant};
use figure::Figure;
use glam::{DMat3, DVec3};
use hierarchy::{Hierarchy, Missing, Pose};
use ndarray::Array2;
use rest::{RestPose, is_same_convention};
use segments::BodyJoints;
use soles::{Ground, Stance, foot_joints};
use transfer::Transfer;
use tuning::{BLOCK, CHUNK};

/// A rig that takes over motions.
///
/// ```
/// use posing_core::pose::UpAxis;
/// use posing_io::{Amc, Asf, Bvh};
/// use posing_joints::ik::{SkeletonFit, retarget::{RetargetOptions, Retargeter}};
///
/// let asf = Asf::open("../../testdata/cmu/09/09.asf")?;
/// let take = Amc::open("../../testdata/cmu/09/09_06.amc", &asf)?.to_poses(120.0)?;
/// let run = SkeletonFit::new(&asf.skeleton).fit(&take.slice(0..3))?.to_bvh()?;
/// let goblin = Bvh::open("../../testdata/examples/animator/goblin.bvh")?;
/// let retargeter = Retargeter::new(goblin, UpAxis::Y, None)?;
/// let retargeted = retargeter.retarget(&run, &RetargetOptions::default())?;
/// assert_eq!(retargeted.bvh.motion.nrows(), 3);
/// assert!(retargeted.scale < 1.0); // the goblin is small
/// # Ok::<(), posing_core::Error>(())
/// ```
pub struct Retargeter {
    bvh: Bvh,
    tree: Hierarchy,
    body: BodyJoints,
    up: UpAxis,
    /// The joint whose position channels move the body as a whole.
    carrier: Option<usize>,
}

/// How a motion is carried over.
#[derive(Debug, Clone, Copy)]
pub struct RetargetOptions<'a> {
    /// The axis of the source that points up.
    pub up: UpAxis,
    /// The source's frames per second, where it does not say them.
    pub rate: Option<f64>,
    /// The names of the source, as for [`Retargeter::new`].
    pub map: Option<&'a NameMap>,
    /// Whether feet are planted as the source's, on their own soles.
    pub plants_feet: bool,
}

impl Default for RetargetOptions<'_> {
    fn default() -> Self {
        RetargetOptions {
            up: UpAxis::Y,
            rate: None,
            map: None,
            plants_feet: true,
        }
    }
}

/// A motion of the rig, and how it came about.
#[derive(Debug)]
pub struct Retargeted {
    /// The rig with the motion.
    pub bvh: Bvh,
    /// The maps of the source's and of the rig's names; `shape` where the shape of the tree told.
    pub maps: [String; 2],
    /// What lengths of the source were multiplied by.
    pub scale: f64,
    /// The poses in which source and rig were compared.
    pub rests: [Rest; 2],
    /// The number of joints that follow none of the source's and keep their rest pose.
    pub resting: usize,
    /// The number of contacts in which a foot is held; `None`: feet were not asked for.
    pub contacts: Option<usize>,
    /// How far a held foot leaves its goal at most, in the rig's unit: where that is out of reach.
    pub slide: f64,
    /// How much higher than the source's, times the scale, the body stands, in the rig's unit:
    /// ankles are as high above soles as the rig's. 0 where feet were not asked for.
    pub raised: f64,
    /// How high the ground is on which feet stand, in the rig's unit; `None`: they never do, the
    /// rig has no position channels, or both skeletons have the same joints.
    pub ground: Option<f64>,
    /// The number of values that are missing (nan), as the source lacks what they depend on.
    pub missing: usize,
    /// Whether the rig has position channels that move it.
    pub moves: bool,
}

impl Retargeter {
    /// A rig by its file, whose axis `up` points up; `map`: its names, else they are told from the
    /// names or the tree.
    ///
    /// # Errors
    /// [`Error::Unfit`]: nothing tells which joints are legs and arms.
    pub fn new(rig: Bvh, up: UpAxis, map: Option<&NameMap>) -> Result<Retargeter> {
        let tree = Hierarchy::new(&rig, up.rotation());
        let body = BodyJoints::find(&tree, map, "map_to")?;
        let slides = |joint: &usize| {
            let (channels, _) = tree.channels(*joint);
            let slide = |c: &&Channel| matches!(c, Channel::Translate(_));
            channels.iter().filter(slide).count() == 3
        };
        let carrier = tree.upwards(body.base).find(slides);
        Ok(Retargeter {
            bvh: rig,
            tree,
            body,
            up,
            carrier,
        })
    }

    /// The motion of `source` on this rig.
    ///
    /// # Errors
    /// [`Error::Unfit`]: nothing tells which joints of the source are legs and arms, or its rate.
    pub fn retarget(&self, source: &Bvh, options: &RetargetOptions<'_>) -> Result<Retargeted> {
        let rate = source.rate_or(options.rate)?;
        let tree = Hierarchy::new(source, options.up.rotation());
        let body = BodyJoints::find(&tree, options.map, "map_from")?;
        let is_same = is_same_convention(&tree, &self.tree);
        let [own, rest] = if is_same {
            [
                RestPose::zero(&tree, &body),
                RestPose::zero(&self.tree, &self.body),
            ]
        } else {
            [
                RestPose::of(&tree, &body, source.motion.view()),
                RestPose::of(&self.tree, &self.body, self.bvh.motion.view()),
            ]
        };
        let figure = Figure {
            tree: &tree,
            body: &body,
            rest: &own,
        };
        let rig = Figure {
            tree: &self.tree,
            body: &self.body,
            rest: &rest,
        };
        let legs = [figure.leg(), rig.leg()];
        if legs.iter().any(|leg| !(*leg > 0.0 && leg.is_finite())) {
            return Err(Error::unfit("legs without a length"));
        }
        let scale = legs[1] / legs[0];
        let mut transfer = Transfer::new(figure, rig, is_same);
        let mut stance = Stance::default();
        if options.plants_feet {
            stance = Stance::of([figure, rig], [source, &self.bvh], rate, scale, is_same);
            transfer.stand([&body, &self.body], &stance.soles);
            if self.carrier.is_none() {
                // A body that nothing moves is no higher or lower.
                (stance.raised, stance.grounds) = (0.0, [None, None]);
            }
        }
        let run = Run {
            rig: self,
            transfer,
            tree: &tree,
            body: &body,
            source,
            scale,
            raised: stance.raised,
        };
        let planted = if options.plants_feet {
            run.plant([figure.centimeter(), legs[1]], rate, &stance.grounds)
        } else {
            Default::default()
        };
        let (motion, missing) = run.motion(&planted);
        Ok(Retargeted {
            bvh: Bvh {
                joints: self.bvh.joints.clone(),
                frame_time: match source.rate() {
                    Some(_) => source.frame_time,
                    None => 1.0 / rate,
                },
                motion,
                notes: Vec::new(),
            },
            maps: [body.map.clone(), self.body.map.clone()],
            scale: run.scale,
            rests: [own.kind, rest.kind],
            resting: run.transfer.resting(),
            contacts: (options.plants_feet).then(|| planted.iter().map(|p| p.contacts).sum()),
            slide: planted.iter().map(|p| p.slide).fold(0.0, f64::max),
            raised: run.raised,
            ground: stance
                .grounds
                .iter()
                .flatten()
                .map(|ground| ground.height)
                .next(),
            missing,
            moves: self.carrier.is_some(),
        })
    }
}

/// A source on its way to a rig.
struct Run<'a> {
    rig: &'a Retargeter,
    transfer: Transfer,
    tree: &'a Hierarchy,
    body: &'a BodyJoints,
    source: &'a Bvh,
    scale: f64,
    /// How much higher than the source's, times the scale, the hips are.
    raised: f64,
}

impl Run<'_> {
    /// The source's pose in a frame.
    fn source(&self, frame: usize, pose: &mut Pose) {
        self.tree.pose(self.source.motion.row(frame), pose);
    }

    /// The rig's pose by the source's, with some of its joints turned further; the shift of its
    /// carrier, in the world.
    fn pose(&self, source: &Pose, turns: &[(usize, DMat3)], pose: &mut Pose) -> DVec3 {
        let rig = &self.rig.tree;
        pose.rotations.clear();
        pose.positions.clear();
        for (j, parent) in rig.parents.iter().enumerate() {
            let above = parent.map_or(DMat3::IDENTITY, |p| pose.rotations[p]);
            let rotation = self.transfer.rotation(j, source);
            let rotation = rotation.unwrap_or(above * self.transfer.rest_local(j));
            let own = turns.iter().filter(|(joint, _)| *joint == j);
            let wanted = own.fold(rotation, |r, (_, turn)| *turn * r);
            let position = match parent {
                Some(p) => pose.positions[*p] + above * rig.offsets[j],
                None => rig.offsets[j],
            };
            let possible = above * self.rig.possible(j, above.transpose() * wanted);
            pose.rotations.push(possible);
            pose.positions.push(position);
        }
        let shift = match self.rig.carrier {
            Some(_) => {
                let goal = self.scale * hips(self.body, source) + self.raised * DVec3::Y;
                goal - hips(&self.rig.body, pose)
            }
            None => DVec3::ZERO,
        };
        pose.positions
            .iter_mut()
            .for_each(|position| *position += shift);
        shift
    }

    /// What plants each foot, on its ground; `unit` counts as a centimeter of the source, and `leg`
    /// is the rig's.
    fn plant(
        &self,
        [unit, leg]: [f64; 2],
        rate: f64,
        grounds: &[Option<Ground>; 2],
    ) -> Vec<Planted> {
        let ankles = [0, 1].map(|side| self.body.legs[side].joints[2]);
        let toes_rest = [0, 1].map(|side: usize| {
            let [_, toes] = foot_joints(&self.rig.body.legs[side]);
            self.transfer.rests(toes)
        });
        let frames = map_chunks(self.source.motion.nrows(), CHUNK, |range| {
            let (mut source, mut pose) = (Pose::default(), Pose::default());
            let mut of_frame = |frame: usize| {
                self.source(frame, &mut source);
                self.pose(&source, &[], &mut pose);
                let missing = self.missing(frame);
                [0, 1].map(|side| {
                    let joints = self.rig.body.legs[side].joints;
                    let [hip, knee, ankle] = joints.map(|j| pose.positions[j]);
                    LegFrame {
                        bones: TwoBones { hip, knee, ankle },
                        thigh: pose.rotations[joints[0]],
                        source: if self.tree.lacks_position(ankles[side], &missing) {
                            DVec3::NAN
                        } else {
                            source.positions[ankles[side]]
                        },
                        foot: foot_joints(&self.rig.body.legs[side]).map(|j| pose.rotations[j]),
                        toes_rest: toes_rest[side],
                    }
                })
            };
            range.map(&mut of_frame).collect::<Vec<_>>()
        });
        let side = |side: usize| {
            let of_side: Vec<LegFrame> = frames.iter().flatten().map(|f| f[side]).collect();
            let scales = [self.scale, leg, unit];
            plant(&of_side, rate, scales, grounds[side].as_ref())
        };
        vec![side(0), side(1)]
    }

    /// What the source's joints lack in a frame.
    fn missing(&self, frame: usize) -> Vec<Missing> {
        self.tree.missing(self.source.motion.row(frame))
    }

    /// The channels of all frames, and how many values are missing.
    fn motion(&self, planted: &[Planted]) -> (Array2<f64>, usize) {
        let rig = &self.rig.tree;
        let frames = self.source.motion.nrows();
        let mut motion = Array2::zeros((frames, Bvh::channels(&self.rig.bvh.joints)));
        let needed: Vec<Vec<usize>> = (0..rig.len())
            .map(|j| self.transfer.needed(j, [self.tree, rig]))
            .collect();
        let hips = [0, 1].map(|side: usize| self.body.legs[side].joints[0]);
        let (mut near, mut missing) = (vec![[0.0; 3]; rig.len()], 0);
        for first in (0..frames).step_by(BLOCK) {
            // Rotations in parallel; then angles, each beside those of the frame before.
            let poses = map_chunks(BLOCK.min(frames - first), CHUNK, |range| {
                let (mut source, mut pose) = (Pose::default(), Pose::default());
                let mut of_frame = |frame: usize| {
                    self.source(frame, &mut source);
                    let shift = self.pose(&source, &self.turns(planted, frame), &mut pose);
                    (self.rig.locals(&pose), self.rig.carried(&pose, shift))
                };
                range.map(|n| of_frame(first + n)).collect::<Vec<_>>()
            });
            for (n, (locals, position)) in poses.into_iter().flatten().enumerate() {
                let lacks = self.missing(first + n);
                let lost = hips
                    .iter()
                    .any(|&hip| self.tree.lacks_position(hip, &lacks));
                let mut row = motion.row_mut(first + n);
                for (j, local) in locals.iter().enumerate() {
                    let is_missing = needed[j].iter().any(|s| lacks[*s].rotation);
                    let values = self.rig.values(j, local, position, &mut near[j]);
                    let (channels, at) = rig.channels(j);
                    for (c, value) in values.into_iter().enumerate() {
                        let is_lost = if channels[c].is_angle() {
                            is_missing
                        } else {
                            self.rig.carrier == Some(j) && lost
                        };
                        missing += usize::from(is_lost);
                        row[at + c] = if is_lost { f64::NAN } else { value };
                    }
                }
            }
        }
        (motion, missing)
    }

    /// What turns the legs in a frame.
    fn turns(&self, planted: &[Planted], frame: usize) -> Vec<(usize, DMat3)> {
        let legs = planted.iter().zip(&self.rig.body.legs);
        let of_leg = |(planted, leg): (&Planted, &shape::Limb)| {
            let [hip, knee, _] = leg.joints;
            let [foot, toes] = foot_joints(leg);
            let turns = [hip, knee, foot, toes]
                .into_iter()
                .zip(planted.turns[frame]);
            turns
                .filter_map(|(joint, turn)| Some((joint, turn?)))
                .collect::<Vec<_>>()
        };
        legs.flat_map(of_leg).collect()
    }
}

/// The middle of the hips.
fn hips(body: &BodyJoints, pose: &Pose) -> DVec3 {
    let [left, right] = [0, 1].map(|side: usize| pose.positions[body.legs[side].joints[0]]);
    (left + right) / 2.0
}

impl Retargeter {
    /// The rotation channels of a joint, then the axes that it lacks.
    fn order(&self, joint: usize) -> ([Axis; 3], usize) {
        let (channels, _) = self.tree.channels(joint);
        let own = channels.iter().filter_map(|channel| match channel {
            Channel::Rotate(axis) => Some(*axis),
            _ => None,
        });
        let mut axes: Vec<Axis> = own.collect();
        let count = axes.len();
        for axis in [Axis::X, Axis::Y, Axis::Z] {
            if !axes.contains(&axis) {
                axes.push(axis);
            }
        }
        ([axes[0], axes[1], axes[2]], count)
    }

    /// A joint's rotation in its parent's frame, ours, as nearly as its channels can turn it.
    fn possible(&self, joint: usize, local: DMat3) -> DMat3 {
        let (order, count) = self.order(joint);
        if count == 3 {
            return local;
        }
        let turn = self.up.rotation();
        let angles = decompose(&(turn.transpose() * local * turn), order, [0.0; 3]);
        let own = order.into_iter().zip(angles).take(count);
        let possible = own.fold(DMat3::IDENTITY, |r, (axis, angle)| r * axis.rotation(angle));
        turn * possible * turn.transpose()
    }

    /// The joints' rotations in their parents' frames, in the file's axes.
    fn locals(&self, pose: &Pose) -> Vec<DMat3> {
        let turn = self.up.rotation();
        let local = |(j, parent): (usize, &Option<usize>)| {
            let above = parent.map_or(DMat3::IDENTITY, |p| pose.rotations[p]);
            turn.transpose() * (above.transpose() * pose.rotations[j]) * turn
        };
        self.tree.parents.iter().enumerate().map(local).collect()
    }

    /// The position of the carrier in its parent's frame, in the file's axes, where the body is
    /// shifted in the world.
    fn carried(&self, pose: &Pose, shift: DVec3) -> DVec3 {
        let Some(carrier) = self.carrier else {
            return DVec3::ZERO;
        };
        let above = self.tree.parents[carrier].map(|p| pose.rotations[p]);
        let own = above.map_or(shift, |above| above.transpose() * shift);
        self.up.rotation().transpose() * (self.tree.offsets[carrier] + own)
    }

    /// The channels of a joint; angles stay near those of the frame before, which they replace.
    fn values(&self, joint: usize, local: &DMat3, carried: DVec3, near: &mut [f64; 3]) -> Vec<f64> {
        let (order, _) = self.order(joint);
        *near = decompose(local, order, *near);
        let offset = if self.carrier == Some(joint) {
            carried
        } else {
            self.up.rotation().transpose() * self.tree.offsets[joint]
        };
        let mut angles = near.iter();
        let value = |channel: &Channel| match channel {
            Channel::Rotate(_) => angles.next().copied().unwrap_or(0.0),
            Channel::Translate(axis) => offset[axis.index()],
            Channel::Length => 0.0,
        };
        self.tree.channels(joint).0.iter().map(value).collect()
    }
}

#[cfg(test)]
mod tests;
