//! How feet stand: the axes of each sole in the frames of its joints, and how high the ankle is
//! above it.
//!
//! A sole is level while its foot stands. So its normal n is the median of the vertical in the
//! frame of the joint, over the frames in which ankle and ball rest; without such frames it is the
//! vertical of a rest pose that stands. With z the direction of the foot across n, the axes of the
//! sole are `L = [n × z, n, z]`, and the rig's foot follows the source's by `G' = G L L'ᵀ`: soles
//! turn alike, whatever the slopes from ankles to toes.
//!
//! The ankle of the source stands a over its ground, that of the rig a' over its own: the rig's
//! body is `a' - k a` higher than k times the source's. The ground of a take is at 0, unless its
//! feet stand far from there.

use super::figure::Figure;
use super::hierarchy::Pose;
use super::rest::Rest;
use super::shape::Limb;
use super::tuning::CHUNK;
use super::tuning::soles::*;
use crate::io::Bvh;
use crate::numeric::parallel::map_chunks;
use crate::numeric::statistics::{mean_of_finite, median};
use crate::pose::foot_contacts::{ContactLimits, contacts, speed};
use crate::pose::rotation::frame_along;
use glam::{DMat3, DVec3};

/// The sole of a foot.
#[derive(Debug, Clone)]
pub(super) struct Sole {
    /// Its axes in the frames of the foot's joint and of the toes'.
    pub axes: [DMat3; 2],
    /// How high the ankle is above it; `None`: the skeleton has nothing below the ankle.
    pub ankle: Option<f64>,
    /// Where the toes' joint is in the foot's frame.
    ball: DVec3,
    /// What hangs on the foot's joint and on the toes', in their frames.
    points: [Vec<DVec3>; 2],
}

/// The ground on which a foot stands.
#[derive(Debug, Clone)]
pub(super) struct Ground {
    /// How high it is under the rig.
    pub height: f64,
    /// How much higher the ankle of the rig stands than the source's, scaled.
    pub raise: f64,
    /// The rig's.
    sole: Sole,
}

/// How a rig stands beside a source.
#[derive(Debug, Default)]
pub(super) struct Stance {
    /// The soles of source and rig, left and right; `None`: not known of both.
    pub soles: [Option<[Sole; 2]>; 2],
    /// How much higher than the source's, times the scale, the rig's body is.
    pub raised: f64,
    /// The ground of each foot; `None`: the source never stands.
    pub grounds: [Option<Ground>; 2],
}

impl Stance {
    /// How a rig stands beside a source, by their files, `scale` times as large. With `is_same`
    /// their rotations mean the same: feet turn alike.
    pub(super) fn of(
        [source, rig]: [Figure; 2],
        [file, rig_file]: [&Bvh; 2],
        rate: f64,
        scale: f64,
        is_same: bool,
    ) -> Stance {
        if is_same {
            let ankle = |figure: &Figure, side| Sole::of(figure, side, None)?.ankle;
            let more = |side| Some(ankle(&rig, side)? - scale * ankle(&source, side)?);
            let raised = mean_of_finite([0, 1].into_iter().filter_map(more));
            return Stance {
                raised: raised.unwrap_or(0.0),
                ..Stance::default()
            };
        }
        let standing = Standing::both(&source, file, rate);
        // A rest pose that stands is level; only other rigs are looked at as they move.
        let rig_standing = match rig.rest.kind {
            Rest::Frame(_) => Standing::both(&rig, rig_file, rig_file.rate().unwrap_or(rate)),
            _ => [None; 2],
        };
        let mut of_rig = [0, 1].map(|side| Sole::of(&rig, side, rig_standing[side].as_ref()));
        // Joints are above the skin of a sole: those of a rig that stands tell by how much.
        let rig_floor = floor(&rig_standing, &of_rig, rig.centimeter());
        for (sole, standing) in of_rig.iter_mut().zip(rig_standing) {
            if let (Some(sole), Some(standing), Some(floor)) = (sole, standing, rig_floor) {
                sole.ankle = sole.ankle.map(|ankle| ankle.max(standing.height - floor));
            }
        }
        let of_source = [0, 1].map(|side| Sole::of(&source, side, standing[side].as_ref()));
        let unit = source.centimeter();
        let floor = floor(&standing, &of_source, unit);
        let raise = |side: usize| {
            let ankle = standing[side]?.height - floor?;
            Some(of_rig[side].as_ref()?.ankle? - scale * ankle)
        };
        let raises = [0, 1].map(raise);
        let raised = mean_of_finite(raises.into_iter().flatten()).unwrap_or(0.0);
        let ground = |side: usize| {
            Some(Ground {
                height: scale * floor?,
                raise: raises[side].unwrap_or(raised),
                sole: of_rig[side].clone()?,
            })
        };
        let grounds = [0, 1].map(ground);
        let each = of_source.into_iter().zip(of_rig);
        let soles: Vec<_> = each.map(|(source, rig)| Some([source?, rig?])).collect();
        Stance {
            soles: soles.try_into().unwrap_or_default(),
            raised,
            grounds,
        }
    }
}

/// How high the ground of a take is: 0, unless its feet stand far from there. `None`: they never
/// do.
fn floor(standing: &[Option<Standing>; 2], soles: &[Option<Sole>; 2], unit: f64) -> Option<f64> {
    let of_side = |side: usize| {
        let ankle = soles[side].as_ref().and_then(|sole| sole.ankle);
        Some(standing[side]?.height - ankle.unwrap_or(ANKLE * unit))
    };
    let floor = mean_of_finite([0, 1].into_iter().filter_map(of_side))?;
    Some(if floor.abs() <= FLOOR * unit {
        0.0
    } else {
        floor
    })
}

/// A foot in one frame, where it is all known.
#[derive(Debug, Clone, Copy)]
struct FootFrame {
    ankle: DVec3,
    /// Where the toes begin; the ankle where nothing says it.
    ball: DVec3,
    /// The vertical in the frames of the foot's joint and of the toes'.
    up: [DVec3; 2],
}

impl FootFrame {
    /// A foot that is not all known.
    const MISSING: FootFrame = FootFrame {
        ankle: DVec3::NAN,
        ball: DVec3::NAN,
        up: [DVec3::NAN; 2],
    };

    /// The foot of these joints in a pose.
    fn of([foot, toes]: [usize; 2], pose: &Pose) -> FootFrame {
        FootFrame {
            ankle: pose.positions[foot],
            ball: pose.positions[toes],
            up: [foot, toes].map(|j| pose.rotations[j].transpose() * DVec3::Y),
        }
    }
}

/// How a foot stands in a motion.
#[derive(Debug, Clone, Copy)]
struct Standing {
    /// The normals of the sole in the frames of the foot's joint and of the toes'.
    normals: [DVec3; 2],
    /// The median height of the ankle.
    height: f64,
}

/// The joints of foot and toes; without toes that of the foot.
pub(super) fn foot_joints(leg: &Limb) -> [usize; 2] {
    [leg.joints[2], leg.end.unwrap_or(leg.joints[2])]
}

impl Standing {
    /// How both feet of a figure stand in its file.
    fn both(figure: &Figure, file: &Bvh, rate: f64) -> [Option<Standing>; 2] {
        let feet = [0, 1].map(|side: usize| foot_joints(&figure.body.legs[side]));
        let frames = map_chunks(file.motion.nrows(), CHUNK, |range| {
            let mut pose = Pose::default();
            let mut of_frame = |frame: usize| {
                figure.tree.pose(file.motion.row(frame), &mut pose);
                let missing = figure.tree.missing(file.motion.row(frame));
                feet.map(|joints| {
                    let lacks =
                        |j: usize| missing[j].rotation || figure.tree.lacks_position(j, &missing);
                    if joints.into_iter().any(lacks) {
                        FootFrame::MISSING
                    } else {
                        FootFrame::of(joints, &pose)
                    }
                })
            };
            range.map(&mut of_frame).collect::<Vec<_>>()
        });
        let unit = figure.centimeter();
        let standing = [0, 1].map(|side: usize| {
            let of_side: Vec<FootFrame> = frames.iter().flatten().map(|f| f[side]).collect();
            Standing::of(&of_side, rate, unit)
        });
        // Who stands on one leg holds the other up.
        let low = standing.iter().flatten().map(|s| s.height);
        let low = low.fold(f64::INFINITY, f64::min);
        standing.map(|own| own.filter(|s| s.height < low + HEIGHT * unit))
    }

    /// How a foot stands, `unit` being what counts as a centimeter; `None`: it never does.
    fn of(frames: &[FootFrame], rate: f64, unit: f64) -> Option<Standing> {
        let [ankle, ball]: [Vec<DVec3>; 2] = [|f: &FootFrame| f.ankle, |f: &FootFrame| f.ball]
            .map(|of| frames.iter().map(of).collect());
        let limits = ContactLimits {
            speed: SPEED * unit,
            height: HEIGHT * unit,
            seconds: LEAST,
        };
        let rests = |t: &usize| speed(&ball, *t, rate) < limits.speed;
        let standing: Vec<FootFrame> = (contacts(&ankle, rate, &limits).into_iter().flatten())
            .filter(rests)
            .map(|t| frames[t])
            .collect();
        let middle = |of: &dyn Fn(&FootFrame) -> f64| median(standing.iter().map(of).collect());
        let normal = |joint: usize| -> Option<DVec3> {
            let axis = |c: usize| middle(&|f| f.up[joint][c]);
            DVec3::new(axis(0)?, axis(1)?, axis(2)?).try_normalize()
        };
        Some(Standing {
            normals: [normal(0)?, normal(1)?],
            height: middle(&|f| f.ankle.y)?,
        })
    }
}

impl Sole {
    /// The sole of a side: as it stands in a motion, if that is near the rest pose's where that
    /// stands, else that of the rest pose; `None`: neither says it.
    fn of(figure: &Figure, side: usize, standing: Option<&Standing>) -> Option<Sole> {
        let joints = foot_joints(&figure.body.legs[side]);
        let pose = &figure.rest.pose;
        let at_rest = (figure.rest.kind == Rest::Zero)
            .then_some(figure.rest.up)
            .flatten();
        let at_rest = at_rest.map(|up| joints.map(|j| pose.rotations[j].transpose() * up));
        let normals = match (at_rest, standing.map(|s| s.normals)) {
            (Some(rest), Some(own)) if rest[0].dot(own[0]) > NEAR => own,
            (Some(rest), _) => rest,
            (None, own) => own?,
        };
        let end = figure.body.legs[side].end;
        let forward = figure.direction(joints[0], end)?;
        let axes = |(joint, normal): (usize, DVec3)| {
            let z = pose.rotations[joint].transpose() * forward;
            let across = normal.cross(z);
            (across.length() > STEEP)
                .then(|| frame_along(across, normal))
                .flatten()
        };
        let [foot, toes] = [0, 1].map(|n| axes((joints[n], normals[n])));
        let path = figure.tree.path(joints[0], joints[1]);
        let mut sole = Sole {
            axes: [foot?, toes?],
            ankle: None,
            // Joints between turn as the foot does.
            ball: path.iter().map(|j| figure.tree.offsets[*j]).sum(),
            points: joints.map(|joint| {
                let children = figure.tree.children(joint).map(|j| figure.tree.offsets[j]);
                children
                    .chain(figure.tree.tips[joint].iter().copied())
                    .collect()
            }),
        };
        let level = sole.axes.map(|axes| axes.transpose());
        let heights = sole.places(DVec3::ZERO, level).map(|place| place.y);
        sole.ankle = heights.reduce(f64::min).map(|low| -low);
        Some(sole)
    }

    /// Where its points are by an ankle and the global rotations of foot and toes.
    fn places(&self, ankle: DVec3, [foot, toes]: [DMat3; 2]) -> impl Iterator<Item = DVec3> + '_ {
        let of_foot = self.points[0].iter().map(move |at| ankle + foot * *at);
        let ball = ankle + foot * self.ball;
        of_foot.chain(self.points[1].iter().map(move |at| ball + toes * *at))
    }
}

impl Ground {
    /// What turns foot and toes up, so that no point of the sole is lower than where it is level on
    /// the ground; and by how much the ankle must rise besides. With `toes_rest` the toes turn with
    /// the foot.
    pub(super) fn clear(
        &self,
        ankle: DVec3,
        [foot, toes]: [DMat3; 2],
        toes_rest: bool,
    ) -> ([Option<DMat3>; 2], f64) {
        let sole = &self.sole;
        if !ankle.is_finite() || sole.ankle.is_none() {
            return ([None; 2], 0.0);
        }
        let at_foot = self.turn_up(0, ankle, foot);
        let by_foot = at_foot.unwrap_or(DMat3::IDENTITY);
        let foot = by_foot * foot;
        let toes = if toes_rest { by_foot * toes } else { toes };
        let ball = ankle + foot * sole.ball;
        let has_toes = sole.ball != DVec3::ZERO;
        let at_toes = has_toes.then(|| self.turn_up(1, ball, toes)).flatten();
        let toes = if has_toes {
            at_toes.map_or(toes, |turn| turn * toes)
        } else {
            foot
        };
        let low = sole.places(ankle, [foot, toes]).map(|place| place.y);
        let low = low.fold(f64::INFINITY, f64::min);
        ([at_foot, at_toes], (self.height - low).max(0.0))
    }

    /// What turns a joint (0 foot, 1 toes) up until none of its points is too low.
    fn turn_up(&self, joint: usize, from: DVec3, rotation: DMat3) -> Option<DMat3> {
        let sole = &self.sole;
        let level = sole.axes.map(|axes| axes.transpose());
        // Points of a level foot are above the ground by their own height; of a steep one less.
        let upright = (rotation * sole.axes[joint].y_axis).y.max(0.0);
        let stands = sole.ankle? + [0.0, (level[0] * sole.ball).y][joint];
        let turn = |point: &DVec3| {
            let clearance = upright * (stands + (level[joint] * *point).y);
            let (now, length) = (rotation * *point, point.length());
            let wanted = (self.height + clearance - from.y).min(length) / length;
            let angle = wanted.asin() - (now.y / length).asin();
            // What points straight down says not where up is.
            let flat = (1.0 - (now.y / length).powi(2)).max(0.0).sqrt();
            let share = ((flat - STEEP) / STEEP).clamp(0.0, 1.0);
            let axis = now.cross(DVec3::Y).try_normalize()?;
            (angle > 0.0).then_some((share * angle, axis))
        };
        let turns = sole.points[joint].iter().filter_map(turn);
        let (angle, axis) = turns.max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(DMat3::from_axis_angle(axis, angle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A foot that stands at a height, pitched a little forth and back, then swings.
    fn frames(height: f64, stands: bool) -> Vec<FootFrame> {
        let at = |t: usize| {
            let moves = if stands {
                (t as f64 - 60.0).max(0.0)
            } else {
                t as f64
            };
            let tilt = DMat3::from_rotation_x(0.3 + 0.05 * (t as f64).sin());
            let at = DVec3::new(0.0, height + 0.3 * moves, 2.0 * moves);
            FootFrame {
                ankle: at,
                ball: at + DVec3::Z,
                up: [tilt.transpose() * DVec3::Y; 2],
            }
        };
        (0..120).map(at).collect()
    }

    #[test]
    fn a_sole_is_level_where_the_foot_stands() {
        let found = Standing::of(&frames(9.0, true), 100.0, 1.0).unwrap();
        let tilt = DMat3::from_rotation_x(0.3).transpose() * DVec3::Y;
        assert!(found.normals[0].angle_between(tilt) <= 0.02);
        assert!((found.height - 9.0).abs() <= 0.01);
        assert!(Standing::of(&frames(9.0, false), 100.0, 1.0).is_none());
        assert!(Standing::of(&[FootFrame::MISSING; 50], 100.0, 1.0).is_none());
        assert!(Standing::of(&[], 100.0, 1.0).is_none());
    }
}
