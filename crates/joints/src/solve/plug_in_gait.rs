//! Plug-in Gait's joint centers in the place of the body model's, where the markers are its, and
//! the subject's parameters are known.

use crate::gait::{GivenValues, JointCenters, Markers};
use crate::pose::{Poses, Skeleton, point_at};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// The rate of a take that says none, for which gaps of markers are short or long.
const RATE: f64 = 100.0;
/// How long the distance of Plug-in Gait's center from the body model's keeps its deviation from
/// its mean, seconds: that falls to 1/e.
const MEMORY: f64 = 0.15;

/// Whose the joint centers of a take are.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Centers {
    /// The body model's.
    #[default]
    Model,
    /// The body model's, though the markers are Plug-in Gait's; what its own lack.
    Without(&'static str),
    /// Plug-in Gait's.
    PlugInGait {
        /// The joints that are at its centers.
        joints: Vec<String>,
        /// Frames with a center of which a marker is missing: it is the body model's there, moved
        /// as far as both are apart in other frames.
        estimated: usize,
        /// Whether nothing says how large the markers are.
        diameter_is_assumed: bool,
    },
}

impl Centers {
    /// `plug-in gait` or `model`.
    pub fn name(&self) -> &'static str {
        match self {
            Centers::PlugInGait { .. } => "plug-in gait",
            _ => "model",
        }
    }

    /// What is to be known of them.
    pub(super) fn line(&self) -> Option<String> {
        let (joints, estimated, is_assumed) = match self {
            Centers::Model => return None,
            Centers::Without(what) => {
                return Some(format!(
                    "centers are the body model's, which differ from Plug-in Gait's by 2 cm at \
                     the hip: it needs {what}"
                ));
            }
            Centers::PlugInGait {
                joints,
                estimated,
                diameter_is_assumed,
            } => (joints, *estimated, *diameter_is_assumed),
        };
        let mut line = format!(
            "{} are Plug-in Gait's centers, by the parameters of PROCESSING",
            joints.join(", ")
        );
        if is_assumed {
            line += " (without MarkerDiameter: 14 mm)";
        }
        if estimated > 0 {
            line += &format!(
                "; in {estimated} frames markers of some are missing: these are the body model's \
                 there, moved as far as both are apart in other frames"
            );
        }
        Some(line)
    }
}

/// A body in every frame, and the bones that end at the joints that are asked for, by name.
pub(super) struct BodyCenters<'a> {
    skeleton: &'a Skeleton,
    values: &'a Array2<f64>,
    ends: &'a [(String, usize)],
}

impl<'a> BodyCenters<'a> {
    pub(super) fn new(
        skeleton: &'a Skeleton,
        values: &'a Array2<f64>,
        ends: &'a [(String, usize)],
    ) -> BodyCenters<'a> {
        BodyCenters {
            skeleton,
            values,
            ends,
        }
    }

    /// The axes of the bones that end at the joints, in every frame.
    fn axes(&self) -> Vec<Vec<DMat3>> {
        let of = |row: ndarray::ArrayView1<'_, f64>| {
            let posture = self.skeleton.posture(&row.to_vec());
            let ends = self.ends.iter().map(|(_, bone)| posture.rotations[*bone]);
            ends.collect()
        };
        self.values.rows().into_iter().map(of).collect()
    }
}

/// A take whose markers are Plug-in Gait's.
pub(super) struct PlugInGait<'a> {
    pub poses: &'a Poses,
    pub statics: Option<&'a Poses>,
    /// What is given of the subject.
    pub subject: Option<&'a GivenValues>,
    /// The deviations of points that were filled (frames, P), cm.
    pub filled: Option<&'a Array2<f64>>,
}

impl PlugInGait<'_> {
    /// Puts joints (frames, 3 J; cm), of which NaN ones stay, and their deviations at Plug-in
    /// Gait's centers, where it has any.
    ///
    /// # Errors
    /// None for deviations of the take's points.
    pub(super) fn put(
        &self,
        body: &BodyCenters<'_>,
        joints: &mut Array2<f64>,
        sd: &mut Option<Array2<f64>>,
    ) -> Result<Centers> {
        let found = match self.centers()? {
            Ok(found) => found,
            Err(missing) => return Ok(Centers::Without(missing)),
        };
        let rate = self.poses.rate().unwrap_or(RATE);
        let axes = body.axes();
        let mut is_estimated = vec![false; joints.nrows()];
        let mut put = Vec::new();
        for (j, (name, _)) in body.ends.iter().enumerate() {
            let Some(places) = found.places.get(name) else {
                continue;
            };
            let own = |t: usize| of_lab(places[t]);
            let both = (0..joints.nrows()).map(|t| {
                let apart = own(t) - point_at(joints.view(), t, j);
                (axes[t][j].transpose() * apart, sd_of(sd, t, j))
            });
            let shift = Shift::of(both.collect(), rate);
            if shift.mean.is_nan() {
                continue;
            }
            put.push(name.clone());
            for t in 0..joints.nrows() {
                let by_model = point_at(joints.view(), t, j);
                if !by_model.is_finite() {
                    continue;
                }
                let is_known = own(t).is_finite();
                is_estimated[t] |= !is_known;
                let (moved, doubt) = shift.at(t);
                let at = if is_known {
                    own(t)
                } else {
                    by_model + axes[t][j] * moved
                };
                (0..3).for_each(|c| joints[[t, 3 * j + c]] = at[c]);
                if let Some(sd) = sd {
                    let of_markers = found.deviations.get(name).map(|doubts| doubts[t]);
                    sd[[t, j]] = if is_known {
                        of_markers.map_or(0.0, |d| (d.length_squared() / 3.0).sqrt() / 10.0)
                    } else {
                        shift.deviation(doubt, sd[[t, j]])
                    };
                }
            }
        }
        Ok(Centers::PlugInGait {
            joints: put,
            estimated: is_estimated.iter().filter(|is| **is).count(),
            diameter_is_assumed: found.diameter_is_assumed,
        })
    }

    /// Plug-in Gait's centers, or what they lack.
    fn centers(&self) -> Result<std::result::Result<JointCenters, &'static str>> {
        let poses = self.poses;
        if self
            .filled
            .is_some_and(|sd| sd.dim() != (poses.frames(), poses.points.len()))
        {
            return Err(Error::usage(
                "the deviations are not one a frame and a point",
            ));
        }
        let in_mm = |sd: &Array2<f64>| {
            JointCenters::marker_deviations(&poses.points, sd).mapv_into(|sd| 10.0 * sd)
        };
        let statics = self.statics.map(Markers::from_poses);
        Ok(JointCenters::new(
            &Markers::from_poses(poses),
            self.filled.map(in_mm).as_ref(),
            self.subject.unwrap_or(&Default::default()),
            statics.as_ref(),
        ))
    }
}

/// A point of the laboratory, millimeters with z up, in centimeters with y up.
fn of_lab(p: DVec3) -> DVec3 {
    DVec3::new(p.x, p.z, -p.y) / 10.0
}

fn sd_of(sd: &Option<Array2<f64>>, frame: usize, joint: usize) -> f64 {
    sd.as_ref().map_or(f64::NAN, |sd| sd[[frame, joint]])
}

/// How far Plug-in Gait's center of a joint is from the body model's, in the axes of its bone, cm.
struct Shift {
    /// In every frame; NaN where it is not known.
    apart: Vec<DVec3>,
    mean: DVec3,
    /// The standard deviation along an axis; NaN of a single frame.
    sd: f64,
    /// The mean variance of the model's center in the frames that have both.
    variance: f64,
    /// [`MEMORY`] in frames.
    memory: f64,
}

impl Shift {
    /// That of frames, of which each has a shift and the deviation of the model's center.
    fn of(frames: Vec<(DVec3, f64)>, rate: f64) -> Shift {
        let known: Vec<&(DVec3, f64)> = frames.iter().filter(|(d, _)| d.is_finite()).collect();
        let count = known.len() as f64;
        let mean = known.iter().map(|(apart, _)| *apart).sum::<DVec3>() / count;
        let square = |(apart, _): &&(DVec3, f64)| (*apart - mean).length_squared() / 3.0;
        Shift {
            mean,
            sd: (known.iter().map(square).sum::<f64>() / (count - 1.0)).sqrt(),
            variance: known.iter().map(|(_, sd)| sd * sd).sum::<f64>() / count,
            memory: MEMORY * rate,
            apart: frames.into_iter().map(|(apart, _)| apart).collect(),
        }
    }

    /// The shift in a frame by the mean and the frames nearest before and behind that know it, and
    /// the share of its variance that these leave: of a random walk that is drawn to its mean.
    fn at(&self, frame: usize) -> (DVec3, f64) {
        let reach = (5.0 * self.memory).ceil() as usize;
        let is_known = |t: &usize| self.apart[*t].is_finite();
        let before = (frame.saturating_sub(reach)..frame).rev().find(is_known);
        let last = (frame + reach + 1).min(self.apart.len());
        let behind = (frame + 1..last).find(is_known);
        let from = |near: Option<usize>| match near {
            Some(t) => {
                let kept = (-(t.abs_diff(frame) as f64) / self.memory).exp();
                (kept, self.apart[t] - self.mean)
            }
            None => (0.0, DVec3::ZERO),
        };
        let ((a, before), (b, behind)) = (from(before), from(behind));
        let (both, left) = (a * b, 1.0 - (a * b).powi(2));
        let [wa, wb] = [(a - b * both) / left, (b - a * both) / left];
        let at = self.mean + wa * before + wb * behind;
        (at, (1.0 - wa * a - wb * b).max(0.0))
    }

    /// The deviation of a center that was moved, of whose variance the share `left` is open, in a
    /// frame in which that of the model's is `own`: what the person's bones are is known by the
    /// other frames, what more is unsure of the pose is not.
    fn deviation(&self, left: f64, own: f64) -> f64 {
        if self.sd.is_nan() {
            return own;
        }
        let more = (own * own - self.variance).max(0.0);
        (self.sd * self.sd * left + more).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::super::landmarks::JointSet;
    use super::super::marker_solver::{SolveSettings, solve};
    use super::*;
    use crate::io::motion_file::{MotionFile, ReadOptions};

    fn subject() -> GivenValues {
        let mut given = GivenValues::default();
        let lengths = [
            ("LegLength", 900.0),
            ("KneeWidth", 105.0),
            ("AnkleWidth", 72.0),
        ];
        for (name, value) in lengths {
            ["L", "R"]
                .iter()
                .for_each(|side| given.set(&format!("{side}{name}"), value));
        }
        given
    }

    fn gait() -> Poses {
        let path = "../../testdata/examples/biomechanist/gait.c3d";
        let file = MotionFile::open(path, &ReadOptions::default()).unwrap();
        file.poses().slice(0..40)
    }

    fn solved(
        poses: &Poses,
        joints: JointSet,
        subject: Option<&GivenValues>,
    ) -> crate::solve::SolvedTake {
        let settings = SolveSettings {
            joints,
            subject,
            deviations_every: 1,
            ..SolveSettings::default()
        };
        solve(poses, &settings, &mut |_| ()).unwrap()
    }

    fn hidden(poses: &Poses, marker: &str, frames: std::ops::Range<usize>) -> Poses {
        let mut less = poses.clone();
        let p = poses.points.iter().position(|n| n == marker).unwrap();
        less.xyz
            .slice_mut(ndarray::s![frames, 3 * p..3 * p + 3])
            .fill(f64::NAN);
        less
    }

    #[test]
    fn centers_are_plug_in_gaits_and_the_models_beside_them() {
        let (poses, subject) = (gait(), subject());
        let whole = solved(&poses, JointSet::Anatomical, Some(&subject));
        let own = JointCenters::new(&Markers::from_poses(&poses), None, &subject, None);
        let own = own.unwrap().places;
        let at = |take: &crate::solve::SolvedTake, name: &str, t: usize| {
            let j = take.joints.points.iter().position(|n| n == name).unwrap();
            let sd = take.sd.as_ref().unwrap()[[t, j]];
            (point_at(take.joints.xyz.view(), t, j), sd)
        };
        let Centers::PlugInGait {
            joints,
            estimated: 0,
            diameter_is_assumed: true,
        } = &whole.centers
        else {
            panic!("{:?}", whole.centers);
        };
        assert_eq!(joints.len(), 6);
        for name in joints {
            let (place, sd) = at(&whole, name, 7);
            assert!(
                place.distance(of_lab(own[name][7])) < 1e-9 && sd == 0.0,
                "{name}"
            );
        }
        assert!(whole.report()["centers"] == "plug-in gait" && at(&whole, "LWJC", 7).1 > 0.0);
        // Where a marker is missing: near, as the deviation says, and told.
        let less = solved(
            &hidden(&poses, "LTHI", 10..20),
            JointSet::Anatomical,
            Some(&subject),
        );
        for t in 10..20 {
            let ((place, sd), (truth, _)) = (at(&less, "LKJC", t), at(&whole, "LKJC", t));
            assert!(place.distance(truth) < 1.5, "{} cm", place.distance(truth));
            assert!(sd > 0.0 && place.distance(truth) < 6.0 * sd, "{sd}");
            assert_eq!(at(&less, "RKJC", t), at(&whole, "RKJC", t));
        }
        assert!(less.lines().last().unwrap().contains("in 10 frames"));
    }

    #[test]
    fn without_parameters_or_markers_nothing_changes() {
        let (poses, subject) = (gait(), subject());
        let before = solved(&poses, JointSet::Anatomical, None);
        let line = before.lines().pop().unwrap();
        assert!(
            line.contains("it needs LegLength, KneeWidth, AnkleWidth"),
            "{line}"
        );
        assert_eq!(before.report()["centers"], "model");
        // The joints of CMU know no Plug-in Gait.
        let [with, without] =
            [Some(&subject), None].map(|subject| solved(&poses, JointSet::Cmu, subject));
        assert_eq!(with.joints.xyz, without.joints.xyz);
        assert!(with.centers == Centers::Model && with.report().get("centers").is_none());
        let no_thigh = hidden(&poses, "RTHI", 0..40);
        let lame = solved(&no_thigh, JointSet::Anatomical, Some(&subject));
        assert!(lame.lines().pop().unwrap().contains("it needs LASI"));
        assert_eq!(
            lame.joints.xyz,
            solved(&no_thigh, JointSet::Anatomical, None).joints.xyz
        );
    }

    #[test]
    fn a_shift_is_as_sure_as_it_is_even() {
        let of = |shifts: &[f64]| {
            let all = shifts.iter().map(|x| (DVec3::splat(*x), 0.5));
            Shift::of(all.collect(), 20.0)
        };
        let nan = f64::NAN;
        let shift = of(&[1.0, nan, nan, nan, 3.0, nan]);
        assert_eq!((shift.mean, shift.variance), (DVec3::splat(2.0), 0.25));
        assert!((shift.sd - 2f64.sqrt()).abs() < 1e-12);
        assert_eq!(shift.deviation(1.0, 0.4), shift.sd);
        assert!((shift.deviation(1.0, 1.5) - 2.0).abs() < 1e-12);
        // Half way it is the mean, and near a frame that of this frame.
        let at: Vec<(DVec3, f64)> = (1..6).map(|t| shift.at(t)).collect();
        assert!(at[1].0.abs_diff_eq(shift.mean, 1e-12));
        assert!(1.0 < at[0].0.x && at[0].0.x < at[1].0.x && at[1].0.x < at[2].0.x);
        assert!(at[0].1 < at[1].1 && at[1].1 < 1.0 && at[0].1 < at[4].1);
        let kept = (-1.0f64 / 3.0).exp();
        assert!((at[4].0.x - 2.0 - kept).abs() < 1e-12);
        assert!((at[4].1 - 1.0 + kept * kept).abs() < 1e-12);
        assert_eq!(of(&[1.0, nan]).deviation(1.0, 0.7), 0.7);
    }
}
