//! Gait of any marker set, by the bones under its markers: what is not Plug-in Gait.
//!
//! Angles are those of the joint coordinate system of Grood and Suntay (1983): flexion about the
//! mediolateral axis of the proximal bone, rotation about the long axis of the distal one, and
//! adduction about the axis square to both; flexion, adduction and internal rotation are positive,
//! as in Plug-in Gait. The knee of the body model is a hinge: it has flexion alone.

use super::landmarks::landmark;
use super::marker_sets::MarkerSet;
use super::solved_take::SolvedTake;
use crate::gait::{ANGLES, Curves, Direction, Markers, Side, lower_angles};
use crate::pose::{Poses, point_at};
use glam::{DMat3, DVec3};

/// Plug-in Gait's markers, without their side, and the landmarks that are taken for them, the best
/// first.
const LANDMARKS: [(&str, &[&str]); 6] = [
    ("ASI", &["ASI"]),
    ("PSI", &["PSI"]),
    ("KNE", &["KNL"]),
    ("ANK", &["ANL"]),
    ("HEE", &["HEE"]),
    ("TOE", &["TOE", "MT5", "MT1", "HAL"]),
];
/// The angles whose zero the static take tells: those of hip, knee and ankle.
const OF_STATIC: std::ops::Range<usize> = 1..4;
/// The bones of a leg: thigh, shank, foot.
const BONES: [&str; 3] = ["femur", "tibia", "foot"];

impl SolvedTake {
    /// The markers of the take, `poses`, on Plug-in Gait's landmarks and by its names, for events
    /// and distances; those of pelvis, knees and feet.
    pub fn gait_markers(&self, poses: &Poses, set: &MarkerSet) -> Markers {
        let known = set.markers(&poses.points);
        let find = |names: &[&str], right: Option<bool>| {
            let is_of = |name: &str| {
                let own = landmark(name)?;
                let is_it = |m: &&super::marker_sets::NamedMarker| {
                    m.landmark == *own && right.is_none_or(|right| m.is_right == right)
                };
                known.iter().find(is_it).map(|m| m.point)
            };
            names.iter().find_map(|name| is_of(name))
        };
        let sided = Side::BOTH.into_iter().flat_map(|side| {
            LANDMARKS.map(|(name, names)| {
                let point = find(names, Some(side == Side::Right));
                (format!("{}{name}", side.letter()), point)
            })
        });
        let all = sided.chain([("SACR".to_string(), find(&["SACR"], None))]);
        let (points, columns): (Vec<String>, Vec<usize>) =
            all.filter_map(|(name, point)| Some((name, point?))).unzip();
        let columns: Vec<usize> = columns.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        Markers::from_poses(&Poses {
            points,
            xyz: poses.xyz.select(ndarray::Axis(1), &columns),
            ..Poses::default()
        })
    }

    /// The angles of pelvis, hip, knee and ankle, and where the feet point, by Plug-in Gait's
    /// names, degrees: not Plug-in Gait's angles. `markers` are those of
    /// [`SolvedTake::gait_markers`], which tell where the person walks; in `statics` hip, knee and
    /// ankle are at zero. NaN where a joint is not known, of the knee's adduction and rotation, and
    /// of the tilt of the feet.
    ///
    /// In 12 walks of six children, with the static taken, flexions of hip and knee follow Vicon's
    /// with correlations of .99 and more, up to 1.5 degrees besides an offset of 1.5 (8.5 at most);
    /// dorsiflexion as a rule too (.95 at least); rotations of the hip do not (.2 to .8).
    pub fn gait_curves(&self, markers: &Markers, statics: Option<&SolvedTake>) -> Curves {
        let lab = Direction::of(markers).axes();
        let mut curves = Curves::new();
        for side in Side::BOTH {
            let zero = statics.map(|own| mean(&own.lower_angles(side, lab)));
            let mut all = self.lower_angles(side, lab);
            for angles in &mut all {
                for i in OF_STATIC {
                    let zero = zero.map_or(DVec3::ZERO, |zero| zero[i]);
                    angles[i] = (angles[i] - zero).map(wrapped);
                }
                (angles[2].y, angles[2].z) = (f64::NAN, f64::NAN);
                (angles[4].x, angles[4].y) = (f64::NAN, f64::NAN);
            }
            for (i, name) in ANGLES.into_iter().take(5).enumerate() {
                let curve = all.iter().map(|angles| angles[i]).collect();
                curves.insert(format!("{}{name}", side.letter()), curve);
            }
        }
        curves
    }

    /// The angles of a side in every frame, their zero as the skeleton rests.
    fn lower_angles(&self, side: Side, lab: DMat3) -> Vec<[DVec3; 5]> {
        let skeleton = &self.skeleton.skeleton;
        let letter = side.letter().to_lowercase();
        let bones = BONES.map(|bone| skeleton.find(&format!("{letter}{bone}")));
        let ends = self.ends_known(side);
        let of = |t: usize| {
            let posture = skeleton.posture(&self.values.row(t).to_vec());
            let axes = |bone: Option<usize>, rest: &dyn Fn(DVec3) -> DMat3, is_known: bool| {
                let known = bone.filter(|_| is_known);
                known.map_or(DMat3::NAN, |b| {
                    to_lab() * posture.rotations[b] * rest(skeleton.bones()[b].offset)
                })
            };
            let [thigh, shank, foot] = bones;
            let [knee, ankle, toes] = ends(t);
            let root = axes(Some(0), &|_| REST, ends(t).contains(&true));
            let axes = [
                root,
                axes(thigh, &long_axes, knee),
                axes(shank, &long_axes, ankle),
                axes(foot, &foot_axes, toes),
            ];
            lower_angles(lab, axes, side)
        };
        (0..self.values.nrows()).map(of).collect()
    }

    /// Whether the ends of thigh, shank and foot are known in a frame; that of the foot as its
    /// ankle is, where the joints that were asked for have none.
    fn ends_known(&self, side: Side) -> impl Fn(usize) -> [bool; 3] {
        let letter = side.letter();
        let find = |name: String| self.joints.points.iter().position(|p| *p == name);
        let joint = |bone: &str, center: &str| {
            let own = find(format!("{}{bone}", letter.to_lowercase()));
            own.or_else(|| find(format!("{letter}{center}")))
        };
        let joints =
            [("femur", "KJC"), ("tibia", "AJC"), ("foot", "AJC")].map(|(b, c)| joint(b, c));
        move |t| {
            let is_known = |j: usize| point_at(self.joints.xyz.view(), t, j).is_finite();
            joints.map(|j| j.is_some_and(is_known))
        }
    }
}

/// Forwards, left and up in the rest pose, in its own axes: z forwards, x left, y up.
const REST: DMat3 = DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y);

/// Centimeters with y up to the laboratory's axes with z up.
fn to_lab() -> DMat3 {
    DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y)
}

/// The axes at rest of a bone that points down: z along it upwards, x as near forwards as it gets.
fn long_axes(offset: DVec3) -> DMat3 {
    let z = -offset.normalize();
    let y = z.cross(DVec3::Z).normalize();
    DMat3::from_cols(y.cross(z), y, z)
}

/// The axes at rest of a foot on the floor: z backwards along it, x up.
fn foot_axes(offset: DVec3) -> DMat3 {
    let z = -offset.with_y(0.0).normalize();
    let x = DVec3::X.cross(z).normalize();
    DMat3::from_cols(x, z.cross(x), z)
}

/// The means over the frames that have all; NaN of none.
fn mean(all: &[[DVec3; 5]]) -> [DVec3; 5] {
    let known = all
        .iter()
        .filter(|angles| angles.iter().all(|a| a.is_finite()));
    let known: Vec<&[DVec3; 5]> = known.collect();
    let count = known.len() as f64;
    std::array::from_fn(|i| known.iter().map(|angles| angles[i]).sum::<DVec3>() / count)
}

/// An angle in degrees, less whole turns: in [-180, 180).
fn wrapped(degrees: f64) -> f64 {
    (degrees + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::super::landmarks::JointSet;
    use super::super::marker_solver::{SolveSettings, solve};
    use super::*;
    use crate::gait::{GaitSettings, GaitTrial, Trial};
    use crate::io::motion_file::{MotionFile, ReadOptions};

    fn solved(poses: &Poses) -> SolvedTake {
        let settings = SolveSettings {
            joints: JointSet::Anatomical,
            ..SolveSettings::default()
        };
        solve(poses, &settings, &mut |_| ()).unwrap()
    }

    fn correlation(own: &[f64], other: &[f64]) -> f64 {
        let both = || own.iter().zip(other).filter(|(a, b)| (*a - *b).is_finite());
        let n = both().count() as f64;
        let mean = |of: &dyn Fn(f64, f64) -> f64| both().map(|(a, b)| of(*a, *b)).sum::<f64>() / n;
        let (a, b) = (mean(&|a, _| a), mean(&|_, b| b));
        let [aa, bb] = [mean(&|v, _| (v - a).powi(2)), mean(&|_, v| (v - b).powi(2))];
        mean(&|x, y| (x - a) * (y - b)) / (aa * bb).sqrt()
    }

    #[test]
    fn angles_follow_plug_in_gaits() {
        let path = "../../testdata/examples/biomechanist/gait.c3d";
        let file = MotionFile::open(path, &ReadOptions::default()).unwrap();
        let take = solved(file.poses());
        let markers = take.gait_markers(file.poses(), MarkerSet::find("pig").unwrap());
        assert!(
            ["LASI", "RPSI", "LKNE", "RANK", "LHEE", "RTOE"]
                .iter()
                .all(|name| {
                    let whole = Markers::from_poses(file.poses());
                    let all = markers
                        .get(name)
                        .unwrap()
                        .iter()
                        .zip(whole.get(name).unwrap());
                    all.into_iter().all(|(a, b)| !(a.distance(*b) > 1e-9))
                })
        );
        let curves = take.gait_curves(&markers, None);
        let trial = Trial::new(Markers::from_poses(file.poses()), 60.0);
        let gait = GaitTrial::new(&trial, None, &GaitSettings::default()).unwrap();
        // A run, whose wands shake; walks are closer.
        for name in ["LKneeAngles", "RKneeAngles", "LHipAngles", "RHipAngles"] {
            let of = |curves: &Curves| curves[name].iter().map(|v| v.x).collect::<Vec<f64>>();
            let r = correlation(&of(&curves), &of(&gait.curves));
            assert!(r > 0.9, "{name} {r}");
        }
        assert!(curves["LKneeAngles"][5].y.is_nan());
        // The take as its own static is at zero in the mean.
        let zeroed = take.gait_curves(&markers, Some(&take));
        let sum: f64 = zeroed["RHipAngles"].iter().map(|v| v.z).sum();
        assert!(sum.abs() < 1e-6, "{sum}");
    }

    #[test]
    fn axes_at_rest_are_square_and_face_forwards() {
        for axes in [
            long_axes(DVec3::new(0.3, -0.9, 0.1)),
            foot_axes(DVec3::new(1.0, -2.0, 9.0)),
        ] {
            assert!(crate::pose::rotation::is_rotation(axes, 1e-12));
        }
        assert!(long_axes(DVec3::NEG_Y).abs_diff_eq(REST, 1e-12));
        let lab = to_lab() * REST;
        assert!((lab.z_axis - DVec3::Z).length() < 1e-12);
        assert!(foot_axes(DVec3::Z).x_axis.abs_diff_eq(DVec3::Y, 1e-12));
    }
}
