use super::hierarchy::{Hierarchy, Pose};
use super::*;
use crate::io::bvh::{EndSite, Joint};
use crate::pose::rotation::angle_between;

/// Joints of a body in a T-pose that faces z: name, parent, offset.
const BODY: &[(&str, Option<usize>, [f64; 3])] = &[
    ("Hips", None, [0.0, 0.0, 0.0]),
    ("Spine", Some(0), [0.0, 10.0, 0.0]),
    ("Spine1", Some(1), [0.0, 20.0, 0.0]),
    ("Neck", Some(2), [0.0, 15.0, 0.0]),
    ("Head", Some(3), [0.0, 10.0, 0.0]),
    ("LeftShoulder", Some(2), [3.0, 12.0, 0.0]),
    ("LeftArm", Some(5), [12.0, 0.0, 0.0]),
    ("LeftForeArm", Some(6), [28.0, 0.0, 0.0]),
    ("LeftHand", Some(7), [25.0, 0.0, 0.0]),
    ("RightShoulder", Some(2), [-3.0, 12.0, 0.0]),
    ("RightArm", Some(9), [-12.0, 0.0, 0.0]),
    ("RightForeArm", Some(10), [-28.0, 0.0, 0.0]),
    ("RightHand", Some(11), [-25.0, 0.0, 0.0]),
    ("LeftUpLeg", Some(0), [9.0, -5.0, 0.0]),
    ("LeftLeg", Some(13), [0.0, -42.0, 0.0]),
    ("LeftFoot", Some(14), [0.0, -40.0, 0.0]),
    ("LeftToeBase", Some(15), [0.0, -6.0, 14.0]),
    ("RightUpLeg", Some(0), [-9.0, -5.0, 0.0]),
    ("RightLeg", Some(17), [0.0, -42.0, 0.0]),
    ("RightFoot", Some(18), [0.0, -40.0, 0.0]),
    ("RightToeBase", Some(19), [0.0, -6.0, 14.0]),
];
/// The bones of limbs: a joint and that at its end.
const LIMBS: [(usize, usize); 10] = [
    (6, 7),
    (7, 8),
    (10, 11),
    (11, 12),
    (13, 14),
    (14, 15),
    (15, 16),
    (17, 18),
    (18, 19),
    (19, 20),
];

fn channels(root: bool) -> Vec<Channel> {
    let slides = [Axis::X, Axis::Y, Axis::Z].map(Channel::Translate);
    let turns = [Axis::Z, Axis::X, Axis::Y].map(Channel::Rotate);
    let slides = slides.into_iter().filter(|_| root);
    slides.chain(turns).collect()
}

/// A body whose rotations are `C_parentᵀ R C` for R of the T-pose's axes, its offsets `change`d.
fn body(
    frames: usize,
    change: impl Fn(usize, DVec3) -> DVec3,
    axes: impl Fn(usize) -> DMat3,
    turns: impl Fn(usize, usize) -> [f64; 3],
) -> Bvh {
    let axes = |j: Option<usize>| j.map_or(DMat3::IDENTITY, &axes);
    let joint = |(j, (name, parent, offset)): (usize, &(&str, Option<usize>, [f64; 3]))| Joint {
        name: name.to_string(),
        parent: *parent,
        offset: axes(*parent).transpose() * change(j, DVec3::from_array(*offset)),
        channels: channels(j == 0),
        ends: if BODY.iter().any(|b| b.1 == Some(j)) {
            Vec::new()
        } else {
            vec![EndSite {
                offset: axes(Some(j)).transpose() * change(j, DVec3::from_array(*offset) * 0.4),
                after: 0,
            }]
        },
    };
    let mut motion = Array2::zeros((frames, 3 * BODY.len() + 3));
    for (t, mut row) in motion.rows_mut().into_iter().enumerate() {
        (row[0], row[1], row[2]) = (2.0 * t as f64, 90.0, -(t as f64));
        for (j, (_, parent, _)) in BODY.iter().enumerate() {
            let order = [Axis::Z, Axis::X, Axis::Y];
            let turn = order.iter().zip(turns(t, j));
            let turn = turn.fold(DMat3::IDENTITY, |r, (axis, a)| r * axis.rotation(a));
            let local = axes(*parent).transpose() * turn * axes(Some(j));
            let angles = decompose(&local, order, [0.0; 3]);
            (0..3).for_each(|c| row[3 * j + 3 + c] = angles[c]);
        }
    }
    Bvh {
        joints: BODY.iter().enumerate().map(joint).collect(),
        frame_time: 0.01,
        motion,
        notes: Vec::new(),
    }
}

fn none(_: usize) -> DMat3 {
    DMat3::IDENTITY
}

fn same(_: usize, offset: DVec3) -> DVec3 {
    offset
}

/// A motion that turns all joints; frame 0 is the T-pose.
fn moving(t: usize, j: usize) -> [f64; 3] {
    [0.9, 2.3, 3.1].map(|c| 0.7 * ((t as f64 * 0.13 * c) * (1.0 + j as f64 * 0.21)).sin())
}

/// Arms that hang down, legs apart, thick and thin.
fn other(j: usize, offset: DVec3) -> DVec3 {
    let turn = match j {
        6..=8 => DMat3::from_rotation_z(-1.1),
        10..=12 => DMat3::from_rotation_z(1.1),
        14 => DMat3::from_rotation_z(0.1),
        18 => DMat3::from_rotation_z(-0.1),
        _ => DMat3::IDENTITY,
    };
    // Left and right alike.
    let bone = if (9..=12).contains(&j) || j > 16 {
        j - 4
    } else {
        j
    };
    turn * offset * (0.5 + 0.01 * bone as f64)
}

/// Zero rotations lay all bones along x.
fn along_x(j: usize) -> DMat3 {
    let bone = BODY.iter().find(|b| b.1 == Some(j)).unwrap_or(&BODY[j]);
    let bone = if j == 0 {
        DVec3::Y
    } else {
        DVec3::from_array(bone.2)
    };
    crate::pose::rotation::shortest_arc(DVec3::X, bone).unwrap()
}

fn by(plants_feet: bool) -> RetargetOptions<'static> {
    RetargetOptions {
        rate: Some(100.0),
        plants_feet,
        ..RetargetOptions::default()
    }
}

fn carried(rig: &Bvh, source: &Bvh, feet: bool) -> Retargeted {
    let rig = Retargeter::new(rig.clone(), UpAxis::Y, None).unwrap();
    rig.retarget(source, &by(feet)).unwrap()
}

fn pose(bvh: &Bvh, frame: usize) -> Pose {
    let mut pose = Pose::default();
    Hierarchy::new(bvh, DMat3::IDENTITY).pose(bvh.motion.row(frame), &mut pose);
    pose
}

/// The largest angle between the directions of limbs, radians.
fn farthest(a: &Bvh, b: &Bvh) -> f64 {
    let mut far = 0.0f64;
    for t in 0..a.motion.nrows() {
        let (a, b) = (pose(a, t).positions, pose(b, t).positions);
        for (from, to) in LIMBS {
            far = far.max((a[to] - a[from]).angle_between(b[to] - b[from]));
        }
    }
    far
}

#[test]
fn limbs_have_the_sources_directions_and_come_back() {
    let source = body(30, same, none, moving);
    let rig = body(1, other, none, moving);
    let there = carried(&rig, &source, false);
    assert!(farthest(&source, &there.bvh) <= 1e-7);
    assert_eq!(there.resting, 0);
    let back = carried(&source, &there.bvh, false).bvh;
    for t in 0..30 {
        let (a, b) = (pose(&source, t), pose(&back, t));
        for j in 0..BODY.len() {
            assert!(
                angle_between(&a.rotations[j], &b.rotations[j]) <= 1e-7,
                "{t} {j}"
            );
        }
        assert!((hips_of(&a) - hips_of(&b)).length() <= 1e-9);
    }
}

fn hips_of(pose: &Pose) -> DVec3 {
    (pose.positions[13] + pose.positions[17]) / 2.0
}

#[test]
fn the_hips_move_by_the_ratio_of_the_legs() {
    let source = body(5, same, none, moving);
    let rig = body(1, |_, offset| 0.5 * offset, none, moving);
    let there = carried(&rig, &source, false);
    assert!((there.scale - 0.5).abs() <= 1e-12 && there.moves);
    for t in 0..5 {
        let (a, b) = (pose(&source, t), pose(&there.bvh, t));
        assert!((0.5 * hips_of(&a) - hips_of(&b)).length() <= 1e-9);
    }
}

#[test]
fn a_body_keeps_its_own_motion() {
    let source = body(40, same, none, moving);
    for feet in [false, true] {
        let own = carried(&source, &source, feet).bvh;
        let far = (&own.motion - &source.motion)
            .iter()
            .fold(0.0, |m, d| f64::max(m, d.abs()));
        assert!(far <= 1e-6, "{far}");
    }
    // So do joints that no map knows.
    let mut odd = source.clone();
    for (j, joint) in odd.joints.iter_mut().enumerate().take(5).skip(1) {
        joint.name = format!("odd{j}");
    }
    let own = carried(&odd, &odd, false);
    let far = (&own.bvh.motion - &odd.motion)
        .iter()
        .fold(0.0, |m, d| f64::max(m, d.abs()));
    assert!(far <= 1e-6 && own.resting == 0, "{far}");
}

#[test]
fn a_zero_pose_that_is_no_body_is_replaced_by_an_upright_frame() {
    let source = body(20, same, none, moving);
    let rig = body(3, other, along_x, |t, j| moving(2 * t, j));
    let there = carried(&rig, &source, false);
    assert_eq!(there.rests, [Rest::Zero, Rest::Frame(0)]);
    assert!(farthest(&source, &there.bvh) <= 1e-7);
    for t in 0..20 {
        let (a, b) = (pose(&source, t), pose(&there.bvh, t));
        for joint in [0, 1, 2, 3, 4] {
            // The T-pose of frame 0 is both rests: the trunk turns as the source's.
            let own = b.rotations[joint] * along_x(joint).transpose();
            assert!(
                angle_between(&a.rotations[joint], &own) <= 1e-7,
                "{t} {joint}"
            );
        }
    }
    // Two bodies of one convention need no frame.
    let longer = body(20, |j, o| other(j, o) * 1.1, along_x, moving);
    assert_eq!(carried(&rig, &longer, false).rests, [Rest::Zero; 2]);
}

/// A body that stands on its soles, squats a little, and walks on its toes for a while.
fn standing(frames: usize, change: impl Fn(usize, DVec3) -> DVec3) -> Bvh {
    let bend = |t: usize| 0.4 * (t as f64 * 0.02).sin().powi(2);
    let tiptoe = |t: usize| if t > frames / 2 { 0.5 } else { 0.0 };
    let mut body = body(frames, change, none, |t, j| match j {
        13 | 17 => [0.0, -bend(t), 0.0],
        14 | 18 => [0.0, 2.0 * bend(t), 0.0],
        15 | 19 => [0.0, -bend(t) + tiptoe(t), 0.0],
        16 | 20 => [0.0, -tiptoe(t), 0.0],
        _ => [0.0; 3],
    });
    for t in 0..frames {
        body.motion[[t, 1]] = 0.0;
        let low = pose(&body, t).positions[16].y - 2.4;
        (
            body.motion[[t, 0]],
            body.motion[[t, 1]],
            body.motion[[t, 2]],
        ) = (0.0, -low, 0.0);
    }
    body
}

/// Feet that slope by half as much and are longer, and ankles that are as high as that.
fn flat_feet(j: usize, offset: DVec3) -> DVec3 {
    match j {
        16 | 20 => DVec3::new(0.0, -3.0, 19.0),
        _ => offset,
    }
}

#[test]
fn feet_stand_level_on_their_own_soles() {
    let source = standing(200, same);
    let rig = body(1, flat_feet, none, |_, _| [0.0; 3]);
    let there = carried(&rig, &source, true);
    // Ankles are 3 over the ball and 6 over the tip, the source's 6 and 8.4.
    assert!((there.raised - (6.0 - 8.4)).abs() <= 0.1);
    assert_eq!(there.ground, Some(0.0));
    for t in 0..200 {
        let (a, b) = (pose(&source, t), pose(&there.bvh, t));
        for (ankle, ball) in [(15, 16), (19, 20)] {
            let tip = b.positions[ball] + b.rotations[ball] * DVec3::new(0.0, -3.0, 19.0);
            assert!(tip.y >= -1e-6 && b.positions[ball].y >= -1e-6, "{t}");
            if t < 100 {
                assert!(angle_between(&a.rotations[ankle], &b.rotations[ankle]) <= 0.02);
                assert!((b.positions[ankle].y - 6.0).abs() <= 0.2, "{t}");
            }
        }
    }
    // Without feet, limbs have the source's directions to the digit.
    let free = carried(&rig, &source, false);
    assert_eq!((free.raised, free.ground), (0.0, None));
    assert!(farthest(&source, &free.bvh) <= 1e-7);
}

#[test]
fn a_rig_that_nothing_moves_keeps_its_legs() {
    let source = standing(60, same);
    let mut rig = body(1, flat_feet, none, |_, _| [0.0; 3]);
    rig.joints[0].channels.drain(..3);
    rig.motion = Array2::zeros((1, Bvh::channels(&rig.joints)));
    let there = carried(&rig, &source, true);
    assert_eq!((there.raised, there.ground), (0.0, None));
    for t in 0..60 {
        let (a, b) = (pose(&source, t), pose(&there.bvh, t));
        for (hip, knee) in [(13, 14), (17, 18)] {
            let thigh = |pose: &Pose| pose.positions[knee] - pose.positions[hip];
            // Its hips do not sink: legs bend less, and are not folded.
            assert!(thigh(&a).angle_between(thigh(&b)) <= 0.5, "{t}");
        }
    }
}

#[test]
fn toes_of_a_rig_that_the_source_lacks_stay_on_the_ground() {
    let mut source = standing(200, same);
    // Feet end where toes began.
    for (j, at) in [(15, 16), (19, 20)] {
        source.joints[j].ends = vec![EndSite {
            offset: source.joints[at].offset,
            after: 0,
        }];
    }
    let kept: Vec<usize> = (0..source.joints.len())
        .filter(|j| ![16, 20].contains(j))
        .collect();
    let mut columns: Vec<usize> = (0..3).collect();
    columns.extend(kept.iter().flat_map(|j| 3 * j + 3..3 * j + 6));
    source.motion = source.motion.select(ndarray::Axis(1), &columns);
    source.joints = kept.iter().map(|j| source.joints[*j].clone()).collect();
    for joint in &mut source.joints {
        joint.parent = joint.parent.map(|p| if p > 16 { p - 1 } else { p });
    }
    let rig = body(1, flat_feet, none, |_, _| [0.0; 3]);
    let there = carried(&rig, &source, true);
    assert!(there.ground.is_some());
    for t in 0..200 {
        let b = pose(&there.bvh, t);
        for ball in [16, 20] {
            let tip = b.positions[ball] + b.rotations[ball] * DVec3::new(0.0, -3.0, 19.0);
            assert!(tip.y >= -1e-6, "{t}: {}", tip.y);
        }
    }
}

#[test]
fn who_never_stands_is_not_put_on_the_ground() {
    let mut source = body(60, same, none, moving);
    (0..60).for_each(|t| source.motion[[t, 1]] = 300.0 + 8.0 * t as f64);
    let there = carried(&body(1, flat_feet, none, moving), &source, true);
    assert_eq!(
        (there.raised, there.ground, there.contacts),
        (0.0, None, Some(0))
    );
}

#[test]
fn a_body_that_never_stands_is_told() {
    let source = body(5, same, none, moving);
    // Frames in which all bones lie along x, as at zero rotations, or that are not whole.
    let mut lying = body(3, other, along_x, moving);
    lying.motion.fill(0.0);
    for fill in [0.0, f64::NAN] {
        lying.motion.row_mut(0).fill(fill);
        let there = carried(&lying, &source, false);
        assert_eq!(there.rests, [Rest::Zero, Rest::Assumed]);
        assert!(there.bvh.motion.iter().all(|v| v.is_finite()));
        let back = carried(&source, &lying, false);
        assert_eq!(back.rests, [Rest::Assumed, Rest::Zero]);
    }
}

#[test]
fn fingers_follow_by_names_whatever_their_prefixes_are() {
    let named = |prefix: &str, parts: fn(&str) -> String| {
        let mut bvh = body(4, same, none, moving);
        let fingers = [("LeftHandThumb1", 8), ("RightHandIndex1", 12)];
        for (name, parent) in fingers {
            bvh.joints.push(Joint {
                name: name.into(),
                parent: Some(parent),
                offset: DVec3::new(3.0, 0.0, 1.0),
                channels: channels(false),
                ends: Vec::new(),
            });
        }
        for joint in &mut bvh.joints {
            joint.name = format!("{prefix}{}", parts(&joint.name));
        }
        let turns = Array2::from_elem((4, 6), 0.2);
        bvh.motion = ndarray::concatenate![ndarray::Axis(1), bvh.motion, turns];
        bvh
    };
    let plain = |name: &str| name.to_string();
    let source = named("", plain);
    for prefix in ["", "rig:", "mixamorig_", "Group/rig "] {
        let there = carried(&named(prefix, plain), &source, false);
        assert_eq!(there.resting, 0, "{prefix}");
        let back = carried(&source, &named(prefix, plain), false);
        assert_eq!(back.resting, 0, "{prefix}");
    }
}

#[test]
fn a_body_without_names_is_found_by_its_shape() {
    let source = body(10, same, none, moving);
    let rig = body(1, other, none, moving);
    let named = carried(&rig, &source, true);
    let mut nameless = rig.clone();
    for (j, joint) in nameless.joints.iter_mut().enumerate() {
        joint.name = format!("bone{j}");
    }
    let by_shape = carried(&nameless, &source, true);
    assert_eq!(by_shape.maps[1], "shape");
    assert_eq!(by_shape.bvh.motion, named.bvh.motion);
    // Without toes nothing tells left from right, and no body is no body.
    let mut footless = nameless.clone();
    footless
        .joints
        .retain(|joint| !["bone16", "bone20"].contains(&joint.name.as_str()));
    for joint in &mut footless.joints {
        joint.parent = joint.parent.map(|p| if p > 16 { p - 1 } else { p });
        joint.ends.clear();
    }
    let refused = |rig: Bvh| match Retargeter::new(rig, UpAxis::Y, None) {
        Ok(_) => panic!("taken for a body"),
        Err(e) => e.to_string(),
    };
    let why = refused(footless);
    assert!(
        why.contains("left from its right") && why.contains("map_to"),
        "{why}"
    );
    let mut chain = nameless;
    chain.joints.truncate(5);
    assert!(refused(chain).contains("no two limbs"));
}

#[test]
fn what_is_missing_is_missing_in_what_depends_on_it_alone() {
    let mut source = body(30, same, none, moving);
    let rig = body(1, other, none, moving);
    let whole = carried(&rig, &source, true).bvh.motion;
    // A thigh in frame 4, the root's position in frame 7, its rotation in frame 9.
    source.motion[[4, 3 * 13 + 4]] = f64::NAN;
    source.motion[[7, 1]] = f64::NAN;
    (0..3).for_each(|c| source.motion[[9, 3 + c]] = f64::NAN);
    let done = carried(&rig, &source, true);
    let missing: Vec<(usize, usize)> = done.bvh.missing();
    let columns = |t: usize| -> Vec<usize> {
        let of_frame = missing.iter().filter(|at| at.0 == t);
        of_frame.map(|at| at.1).collect()
    };
    assert_eq!(columns(4), [42, 43, 44]);
    assert_eq!(columns(7), [0, 1, 2]);
    assert_eq!(columns(9), [0, 1, 2, 3, 4, 5]);
    assert_eq!((missing.len(), done.missing), (12, 12));
    for ((t, c), value) in done.bvh.motion.indexed_iter() {
        // Without feet nothing else changes; with them, what is held around it does.
        let is_leg = (42..=65).contains(&c);
        assert!(
            value.is_nan() || is_leg || (value - whole[[t, c]]).abs() <= 1e-9,
            "{t} {c}"
        );
    }
}

#[test]
fn angles_do_not_jump_by_half_a_turn() {
    let spin = |t: usize, j: usize| match j {
        0 => [0.0, 0.0, t as f64 * 0.2],
        _ => moving(t, j),
    };
    let source = body(200, same, none, spin);
    let done = carried(&body(1, other, none, moving), &source, false).bvh;
    for t in 1..200 {
        let step = &done.motion.row(t) - &done.motion.row(t - 1);
        assert!(step.iter().all(|s| s.abs() < std::f64::consts::PI), "{t}");
    }
    assert!(done.motion[[199, 5]].abs() > 30.0);
}

#[test]
fn no_frames_one_frame_and_few_channels_are_no_fault() {
    let rig = body(0, other, none, moving);
    for frames in [0, 1, 2] {
        let done = carried(&rig, &body(frames, same, none, moving), true);
        assert_eq!(done.bvh.motion.nrows(), frames);
        assert!(done.bvh.motion.iter().all(|v| v.is_finite()));
    }
    // A knee that is a hinge, a neck that is stiff, a root that stands still.
    let mut stiff = rig.clone();
    stiff.joints[14].channels = vec![Channel::Rotate(Axis::X)];
    stiff.joints[3].channels = Vec::new();
    stiff.joints[0].channels.drain(..3);
    stiff.motion = Array2::zeros((0, Bvh::channels(&stiff.joints)));
    let source = body(20, same, none, moving);
    let done = carried(&stiff, &source, false);
    assert!(!done.moves && done.bvh.motion.iter().all(|v| v.is_finite()));
    // What hangs on a stiff joint turns all the same.
    for t in 0..20 {
        let (a, b) = (pose(&source, t), pose(&done.bvh, t));
        assert!(angle_between(&a.rotations[4], &b.rotations[4]) <= 1e-7);
    }
}

#[test]
fn a_rig_whose_z_axis_points_up_gets_the_same_motion() {
    let source = body(20, same, none, moving);
    let rig = body(1, other, none, moving);
    let turn = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let mut turned = rig.clone();
    for joint in &mut turned.joints {
        joint.offset = turn * joint.offset;
        joint
            .ends
            .iter_mut()
            .for_each(|end| end.offset = turn * end.offset);
    }
    // The axis of a motion is that along which its figure stands, also at rest.
    assert_eq!(up_axis(&rig, None), Some(UpAxis::Y));
    assert_eq!(up_axis(&turned, None), Some(UpAxis::Z));
    // Who lies is not turned.
    let prone = |_, j| {
        [
            0.0,
            if j == 0 {
                std::f64::consts::FRAC_PI_2
            } else {
                0.0
            },
            0.0,
        ]
    };
    assert_eq!(up_axis(&body(20, same, none, prone), None), None);
    let there = carried(&rig, &source, false).bvh;
    let by_z = Retargeter::new(turned, UpAxis::Z, None).unwrap();
    let by_z = by_z.retarget(&source, &by(false)).unwrap().bvh;
    for t in 0..20 {
        let (a, b) = (pose(&there, t).positions, pose(&by_z, t).positions);
        for (a, b) in a.iter().zip(&b) {
            assert!((turn * *a - *b).length() <= 1e-9);
        }
    }
}
