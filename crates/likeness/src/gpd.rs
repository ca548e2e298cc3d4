//! The geometric pose descriptor (Chen et al., section 3): 1,683 named numbers that say how a body
//! is folded and how it moves.
//!
//! | family | what | how many |
//! |---|---|---|
//! | `J_c` | coordinates of a joint; of the hip its height above the ground | 46 |
//! | `JJ_d` | distance of two joints | 120 |
//! | `JJ_o` | direction from one joint to another, a unit vector | 360 |
//! | `JL_d` | distance of a joint from a line | 420 |
//! | `LL_a` | angle between two lines | 435 |
//! | `JP_d` | signed distance of a joint from a plane | 65 |
//! | `LP_a` | angle between a line and a plane's normal | 135 |
//! | `PP_a` | angle between two planes' normals | 10 |
//! | `J_k` | velocity and acceleration of the coordinates of `J_c` | 92 |
//!
//! Lengths are in body heights, angles in radians, 0 to π. (Chen et al.'s Table 1 has the counts of
//! `LL_a` and `JP_d` exchanged.) The lines are the 15 limbs, the 5 lines from an end of the body to
//! the joint two before it, and the 10 lines between two ends; the planes are those of trunk, arms
//! and legs.
//!
//! Where a line has no length its direction is 0: angles with it are π/2, and the distance from it
//! is that from its point. A straight limb has no plane, and a nearly straight one has a plane that
//! rounding turns: below a sine of .01 the normal's length falls from 1 to 0 as the limb
//! straightens, so that angles with it go to π/2, and distances from the plane to 0, without a
//! jump. What a missing joint determines is NaN.

use super::body_frame::BodyFramePoses;
use super::joint_map::{JOINTS, PARENTS, joint};
use crate::numeric::parallel;
use glam::DVec3;
use ndarray::Array2;
use std::ops::Range;
use std::sync::LazyLock;

/// Frames of one parallel task.
const CHUNK: usize = 64;

/// A family of features.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Family {
    /// `J_c`.
    JointCoordinate,
    /// `JJ_d`.
    JointJointDistance,
    /// `JJ_o`.
    JointJointOrientation,
    /// `JL_d`.
    JointLineDistance,
    /// `LL_a`.
    LineLineAngle,
    /// `JP_d`.
    JointPlaneDistance,
    /// `LP_a`.
    LinePlaneAngle,
    /// `PP_a`.
    PlanePlaneAngle,
    /// `J_k`.
    JointKinetics,
}

names!(Family {
    JointCoordinate = "J_c",
    JointJointDistance = "JJ_d",
    JointJointOrientation = "JJ_o",
    JointLineDistance = "JL_d",
    LineLineAngle = "LL_a",
    JointPlaneDistance = "JP_d",
    LinePlaneAngle = "LP_a",
    PlanePlaneAngle = "PP_a",
    JointKinetics = "J_k",
});

impl Family {
    /// The names of its features.
    fn features(self) -> Vec<String> {
        let shapes = &*SHAPES;
        let pair = |(a, b): &(usize, usize)| format!("{}:{}", JOINTS[*a], JOINTS[*b]);
        let line = |k: usize| {
            format!(
                "{}-{}",
                JOINTS[shapes.lines[k].0], JOINTS[shapes.lines[k].1]
            )
        };
        let plane = |k: usize| PLANES[k].map(|j| JOINTS[j]).join("-");
        let of = |what: String| format!("{}({what})", self.name());
        match self {
            Family::JointCoordinate => coordinates("J_c", &[""]),
            Family::JointKinetics => coordinates("J_k", &["v", "a"]),
            Family::JointJointDistance => shapes.pairs.iter().map(|p| of(pair(p))).collect(),
            Family::JointJointOrientation => {
                let axes = |p| AXES.map(|axis| format!("{}_{axis}", of(pair(p))));
                shapes.pairs.iter().flat_map(axes).collect()
            }
            Family::JointLineDistance => (shapes.joint_lines.iter())
                .map(|(j, l)| of(format!("{}:{}", JOINTS[*j], line(*l))))
                .collect(),
            Family::LineLineAngle => (shapes.line_lines.iter())
                .map(|(a, b)| of(format!("{}:{}", line(*a), line(*b))))
                .collect(),
            Family::JointPlaneDistance => (shapes.joint_planes.iter())
                .map(|(j, p)| of(format!("{}:{}", JOINTS[*j], plane(*p))))
                .collect(),
            Family::LinePlaneAngle => (shapes.line_planes.iter())
                .map(|(l, p)| of(format!("{}:{}", line(*l), plane(*p))))
                .collect(),
            Family::PlanePlaneAngle => (shapes.plane_planes.iter())
                .map(|(a, b)| of(format!("{}:{}", plane(*a), plane(*b))))
                .collect(),
        }
    }
}

const AXES: [char; 3] = ['x', 'y', 'z'];

/// The names of coordinates, or of their `derivatives`: of all joints but the hip, then of the
/// hip's height.
fn coordinates(family: &str, derivatives: &[&str]) -> Vec<String> {
    let mut names = Vec::new();
    for derivative in derivatives {
        for joint in &JOINTS[1..] {
            names.extend(AXES.map(|axis| format!("{family}({joint})_{derivative}{axis}")));
        }
        names.push(format!("{family}({})_{derivative}y", JOINTS[joint::HIP]));
    }
    names
}

/// The ends of the body.
const ENDS: [usize; 5] = [
    joint::HEAD,
    joint::LHAND,
    joint::RHAND,
    joint::LFOOT,
    joint::RFOOT,
];
/// The corners of the planes.
const PLANES: [[usize; 3]; 5] = [
    [joint::CHEST, joint::NECK, joint::HEAD],
    [joint::LSHOULDER, joint::LELBOW, joint::LHAND],
    [joint::RSHOULDER, joint::RELBOW, joint::RHAND],
    [joint::LHIP, joint::LKNEE, joint::LFOOT],
    [joint::RHIP, joint::RKNEE, joint::RFOOT],
];

/// What the features are made of.
struct Shapes {
    /// Two joints, the later one first.
    pairs: Vec<(usize, usize)>,
    lines: Vec<(usize, usize)>,
    /// A joint and a line that does not end there.
    joint_lines: Vec<(usize, usize)>,
    line_lines: Vec<(usize, usize)>,
    /// A joint and a plane that has no corner there.
    joint_planes: Vec<(usize, usize)>,
    /// A line and a plane that it does not lie in.
    line_planes: Vec<(usize, usize)>,
    plane_planes: Vec<(usize, usize)>,
}

static SHAPES: LazyLock<Shapes> = LazyLock::new(|| {
    let limbs = (1..16).map(|j| (PARENTS[j], j));
    let reaches = ENDS.map(|end| (PARENTS[PARENTS[end]], end));
    let between = (0..5).flat_map(|a| (a + 1..5).map(move |b| (ENDS[a], ENDS[b])));
    let lines: Vec<(usize, usize)> = limbs.chain(reaches).chain(between).collect();
    let is_in = |(a, b): (usize, usize), plane: usize| {
        PLANES[plane].contains(&a) && PLANES[plane].contains(&b)
    };
    let each = |n: usize, m: usize| (0..n).flat_map(move |a| (0..m).map(move |b| (a, b)));
    let rising = |n: usize| each(n, n).filter(|(a, b)| a < b).collect();
    Shapes {
        pairs: each(16, 16).filter(|(a, b)| a > b).collect(),
        joint_lines: each(30, 16)
            .map(|(l, j)| (j, l))
            .filter(|(j, l)| lines[*l].0 != *j && lines[*l].1 != *j)
            .collect(),
        line_lines: rising(30),
        joint_planes: each(5, 16)
            .map(|(p, j)| (j, p))
            .filter(|(j, p)| !PLANES[*p].contains(j))
            .collect(),
        line_planes: each(5, 30)
            .map(|(p, l)| (l, p))
            .filter(|(l, p)| !is_in(lines[*l], *p))
            .collect(),
        plane_planes: rising(5),
        lines,
    }
});

/// Features of some families.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Gpd {
    families: Vec<Family>,
    /// The orders of the derivatives in [`Family::JointKinetics`]: 1 velocity, 2 acceleration.
    orders: &'static [usize],
}

impl Default for Gpd {
    fn default() -> Self {
        Gpd::new(&Family::ALL)
    }
}

impl Gpd {
    /// Features of `families`, in the order of [`Family::ALL`].
    pub fn new(families: &[Family]) -> Gpd {
        let families = Family::ALL.into_iter().filter(|f| families.contains(f));
        Gpd {
            families: families.collect(),
            orders: &[1, 2],
        }
    }

    /// Coordinates of the joints and their velocities.
    pub(crate) fn coordinates() -> Gpd {
        let families = [Family::JointCoordinate, Family::JointKinetics];
        Gpd::new(&families).without_accelerations()
    }

    /// The same families, without accelerations.
    #[must_use]
    pub fn without_accelerations(self) -> Gpd {
        Gpd {
            orders: &[1],
            ..self
        }
    }

    /// The family of each feature.
    pub(crate) fn feature_families(&self) -> Vec<Family> {
        let of = |f: &Family| vec![*f; self.features(*f).len()];
        self.families.iter().flat_map(of).collect()
    }

    /// Whether a frame's neighbors in time are needed.
    pub fn needs_rate(&self) -> bool {
        self.families.contains(&Family::JointKinetics)
    }

    /// The names of the features, in order: without commas, such as
    /// `LL_a(LShoulder-LElbow:LElbow-LHand)` and `JJ_o(LHand:Head)_x`.
    ///
    /// ```
    /// use posing_likeness::{Family, Gpd};
    ///
    /// let names = Gpd::new(&[Family::LineLineAngle]).names();
    /// assert!(names.iter().all(|name| name.starts_with("LL_a(")));
    /// ```
    pub fn names(&self) -> Vec<String> {
        (self.families.iter().flat_map(|f| self.features(*f))).collect()
    }

    /// The names of a family's features.
    fn features(&self, family: Family) -> Vec<String> {
        let mut names = family.features();
        names.truncate(match family {
            Family::JointKinetics => names.len() / 2 * self.orders.len(),
            _ => names.len(),
        });
        names
    }

    /// The features of each frame (frames, features). Without a rate the kinetics are NaN;
    /// velocities are central differences, one-sided at the ends of a run, and a run of one
    /// frame has none: 0.
    pub fn describe(&self, poses: &BodyFramePoses) -> Array2<f32> {
        let width = self.names().len();
        let rows = parallel::map_chunks(poses.frames(), CHUNK, |frames| {
            let mut rows = Vec::with_capacity(frames.len() * width);
            frames.for_each(|t| self.describe_frame(poses, t, &mut rows));
            rows
        });
        // Each frame has as many features as names.
        Array2::from_shape_vec((poses.frames(), width), rows.concat()).unwrap_or_default()
    }

    /// Appends the features of frame `t`, as [`Gpd::describe`] does.
    pub(super) fn describe_frame(&self, poses: &BodyFramePoses, t: usize, out: &mut Vec<f32>) {
        let shapes = &*SHAPES;
        let joints = poses.frame(t);
        let frame = Frame::new(joints);
        for family in &self.families {
            match family {
                Family::JointCoordinate => push_coordinates(out, &joints, poses.hip_height[t]),
                Family::JointJointDistance => out.extend(
                    (shapes.pairs.iter()).map(|(a, b)| (joints[*b] - joints[*a]).length() as f32),
                ),
                Family::JointJointOrientation => {
                    for (a, b) in &shapes.pairs {
                        let to = (joints[*b] - joints[*a]).normalize_or_zero_nan();
                        out.extend([to.x as f32, to.y as f32, to.z as f32]);
                    }
                }
                Family::JointLineDistance => {
                    for (j, l) in &shapes.joint_lines {
                        let from = joints[*j] - joints[shapes.lines[*l].0];
                        let along = frame.lines[*l];
                        let off = if along == DVec3::ZERO {
                            from
                        } else {
                            from.cross(along)
                        };
                        out.push(off.length() as f32);
                    }
                }
                Family::LineLineAngle => out.extend(
                    (shapes.line_lines.iter())
                        .map(|(a, b)| angle(frame.lines[*a], frame.lines[*b])),
                ),
                Family::JointPlaneDistance => {
                    out.extend(shapes.joint_planes.iter().map(|(j, p)| {
                        (joints[*j] - joints[PLANES[*p][0]]).dot(frame.normals[*p]) as f32
                    }))
                }
                Family::LinePlaneAngle => out.extend(
                    (shapes.line_planes.iter())
                        .map(|(l, p)| angle(frame.lines[*l], frame.normals[*p])),
                ),
                Family::PlanePlaneAngle => out.extend(
                    (shapes.plane_planes.iter())
                        .map(|(a, b)| angle(frame.normals[*a], frame.normals[*b])),
                ),
                Family::JointKinetics => {
                    for order in self.orders {
                        let (joints, height) = derivative(poses, t, *order);
                        push_coordinates(out, &joints, height);
                    }
                }
            }
        }
    }
}

fn push_coordinates(out: &mut Vec<f32>, joints: &[DVec3; 16], hip_height: f64) {
    for joint in &joints[1..] {
        out.extend([joint.x as f32, joint.y as f32, joint.z as f32]);
    }
    out.push(hip_height as f32);
}

/// Directions of lines and normals of planes.
struct Frame {
    lines: [DVec3; 30],
    normals: [DVec3; 5],
}

impl Frame {
    fn new(joints: [DVec3; 16]) -> Frame {
        let lines = &SHAPES.lines;
        let to = |a: usize, b: usize| (joints[b] - joints[a]).normalize_or_zero_nan();
        Frame {
            lines: std::array::from_fn(|k| to(lines[k].0, lines[k].1)),
            normals: PLANES.map(|[a, b, c]| {
                let normal = to(a, b).cross(to(a, c));
                normal
                    / if normal.is_nan() {
                        f64::NAN
                    } else {
                        normal.length().max(STRAIGHT)
                    }
            }),
        }
    }
}

/// A line that is shorter, body heights, has no direction.
const POINT: f64 = 1e-9;
/// The sine of the angle at a plane's first corner below which its normal fades.
const STRAIGHT: f64 = 0.01;

trait Normalized {
    /// The vector at unit length; 0 for one that is hardly any; NaN for NaN.
    fn normalize_or_zero_nan(self) -> Self;
}

impl Normalized for DVec3 {
    fn normalize_or_zero_nan(self) -> DVec3 {
        let length = self.length();
        if length < POINT {
            DVec3::ZERO
        } else {
            self / length
        }
    }
}

/// The angle between two unit vectors, radians.
fn angle(a: DVec3, b: DVec3) -> f32 {
    a.dot(b).clamp(-1.0, 1.0).acos() as f32
}

/// The first or second derivative of a frame's joints and of the hip's height, body heights a
/// second (squared).
fn derivative(poses: &BodyFramePoses, t: usize, order: usize) -> ([DVec3; 16], f64) {
    let Some(rate) = poses.rate else {
        return ([DVec3::NAN; 16], f64::NAN);
    };
    let weights = stencil(t, &poses.run_of(t), order);
    let mut joints = [DVec3::ZERO; 16];
    let mut height = 0.0;
    let scale = rate.powi(order as i32);
    for (at, weight) in weights {
        let frame = poses.frame(at);
        (joints.iter_mut().zip(frame)).for_each(|(sum, joint)| *sum += joint * (weight * scale));
        height += poses.hip_height[at] * weight * scale;
    }
    (joints, height)
}

/// Frames and weights of a difference of first or second `order` at `t` within a run: central,
/// one-sided at its ends; none where the run is too short.
pub(super) fn stencil(t: usize, run: &Range<usize>, order: usize) -> Vec<(usize, f64)> {
    let last = run.end - 1;
    match (order, run.len()) {
        (_, 1) | (2, 2) => Vec::new(),
        (1, _) => {
            let (a, b) = (t.saturating_sub(1).max(run.start), (t + 1).min(last));
            let weight = 1.0 / (b - a) as f64;
            vec![(a, -weight), (b, weight)]
        }
        _ => {
            let middle = t.clamp(run.start + 1, last - 1);
            vec![(middle - 1, 1.0), (middle, -2.0), (middle + 1, 1.0)]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::{own_names, standing, take_of};
    use std::f64::consts::{FRAC_PI_2, PI};

    fn of(frames: &[[DVec3; 16]]) -> (Vec<String>, Array2<f32>) {
        let poses = BodyFramePoses::new(&take_of(frames), Some(10.0), &own_names()).unwrap();
        let gpd = Gpd::default();
        (gpd.names(), gpd.describe(&poses))
    }

    /// A feature by its name.
    fn value(found: &(Vec<String>, Array2<f32>), t: usize, name: &str) -> f64 {
        let at = found.0.iter().position(|n| n == name);
        f64::from(found.1[[t, at.unwrap_or_else(|| panic!("{name}"))]])
    }

    #[test]
    fn there_are_1683_features_with_names_of_their_own() {
        let counts = Family::ALL.map(|f| f.features().len());
        assert_eq!(counts, [46, 120, 360, 420, 435, 65, 135, 10, 92]);
        let mut names = Gpd::default().names();
        assert_eq!(names.len(), 1683);
        assert!(names.iter().all(|n| !n.contains(',')));
        assert!(names.contains(&"LL_a(LShoulder-LElbow:LElbow-LHand)".to_string()));
        assert!(names.contains(&"JJ_o(LHand:Head)_x".to_string()));
        names.sort();
        names.dedup();
        assert_eq!(names.len(), 1683);
        assert_eq!(Gpd::new(&Family::ALL[..8]).names().len(), 1591);
    }

    #[test]
    fn each_family_is_what_its_formula_says() {
        let mut pose = standing();
        // The left forearm points forward, the right knee is bent back.
        pose[joint::LHAND] = pose[joint::LELBOW] + DVec3::new(0.0, 0.0, 25.0);
        pose[joint::RFOOT] = pose[joint::RKNEE] + DVec3::new(0.0, 0.0, -50.0);
        let found = of(&[pose]);
        let h = 160.0;
        for (name, expected) in [
            ("J_c(Head)_y", 70.0 / h),
            ("J_c(Hip)_y", 90.0 / h),
            ("JJ_d(LElbow:LShoulder)", 30.0 / h),
            ("JJ_o(LHand:LElbow)_z", -1.0),
            ("JL_d(LHand:LShoulder-LElbow)", 25.0 / h),
            (
                "JL_d(LHand:Hip-Chest)",
                (50.0_f64.powi(2) + 25.0_f64.powi(2)).sqrt() / h,
            ),
            ("LL_a(LShoulder-LElbow:LElbow-LHand)", FRAC_PI_2),
            ("LL_a(Chest-Neck:LHip-LKnee)", PI),
            // The left arm lies in the plane y = 140; its normal is x × z, which points down.
            ("JP_d(Head:LShoulder-LElbow-LHand)", -20.0 / h),
            ("LP_a(Chest-Neck:LShoulder-LElbow-LHand)", PI),
            ("PP_a(LShoulder-LElbow-LHand:RHip-RKnee-RFoot)", FRAC_PI_2),
        ] {
            assert!(
                (value(&found, 0, name) - expected).abs() < 1e-6,
                "{name}: {}",
                value(&found, 0, name)
            );
        }
    }

    #[test]
    fn what_does_not_determine_a_feature_is_finite() {
        // Arms, legs and trunk are straight; and a body all of whose joints but two are in one
        // position.
        let mut folded = standing();
        for j in [joint::LKNEE, joint::LFOOT] {
            folded[j] = folded[joint::LHIP];
        }
        let (_, features) = of(&[standing(), folded]);
        assert!(features.iter().all(|v| v.is_finite()));
        let found = of(&[standing()]);
        assert_eq!(value(&found, 0, "JP_d(Head:LShoulder-LElbow-LHand)"), 0.0);
        assert!(
            (value(&found, 0, "PP_a(Chest-Neck-Head:LHip-LKnee-LFoot)") - FRAC_PI_2).abs() < 1e-6
        );
    }

    #[test]
    fn turning_and_moving_a_body_changes_no_feature_but_leaning_does() {
        let mut pose = standing();
        pose[joint::LHAND] = DVec3::new(40.0, 150.0, 30.0);
        pose[joint::RFOOT] = DVec3::new(-12.0, 20.0, -30.0);
        let turn = glam::DQuat::from_rotation_y(2.0);
        let lean = glam::DQuat::from_rotation_x(0.2);
        let (_, same) = of(&[pose, pose]);
        let (_, turned) = of(&[pose.map(|p| turn * p + DVec3::new(9.0, 0.0, 5.0)); 2]);
        let (_, leant) = of(&[pose.map(|p| lean * p); 2]);
        let difference =
            |a: &Array2<f32>, b: &Array2<f32>| (a - b).iter().fold(0.0_f32, |m, d| m.max(d.abs()));
        assert!(difference(&same, &turned) < 1e-5);
        assert!(difference(&same, &leant) > 0.1);
    }

    #[test]
    fn velocities_and_accelerations_are_those_of_a_parabola() {
        let frame = |t: f64| {
            let mut pose = standing();
            pose[joint::HEAD].y += 16.0 * t * t;
            pose
        };
        // Ten frames a second; the height is the median's.
        let frames: Vec<[DVec3; 16]> = (0..4).map(|t| frame(f64::from(t) / 10.0)).collect();
        let found = of(&frames);
        let height = BodyFramePoses::new(&take_of(&frames), None, &own_names())
            .unwrap()
            .height;
        for t in 0..4 {
            let acceleration = value(&found, t, "J_k(Head)_ay");
            assert!(
                (acceleration - 32.0 / height).abs() < 1e-4,
                "{acceleration}"
            );
        }
        let velocity = value(&found, 2, "J_k(Head)_vy");
        assert!((velocity - 32.0 * 0.2 / height).abs() < 1e-5);
        // A single frame has no velocity.
        assert_eq!(value(&of(&frames[..1]), 0, "J_k(Head)_vy"), 0.0);
    }
}
