//! A take of markers solved: joints, how sure they are, and the skeleton's values.

use super::body::{BONES, Body, template};
use super::calibration::{Calibration, Calibrator, frame_solver};
use super::deviations::Deviations;
use super::landmarks::{JointSet, landmark};
use super::marker_sets::{MarkerSet, NamedMarker};
use super::solved_take::{SolvedTake, UsedMarker};
use super::tuning::*;
use crate::ik::frame_solver::Scratch;
use crate::ik::sequence::{SequenceFit, Targets, fit_frames};
use crate::io::Asf;
use crate::numeric::linalg::Cholesky;
use crate::numeric::parallel::map_chunks;
use crate::numeric::statistics::median;
use crate::pose::joints::CMU;
use crate::pose::kinematics::Posture;
use crate::pose::{Poses, Skeleton, point_at};
use crate::prior::rotations::{JointPrior, RotationPrior};
use crate::{Error, Result};
use ndarray::{Array2, ArrayView2, Axis, s};

/// How a take is solved.
#[derive(Default)]
pub struct SolveSettings<'a> {
    /// The joints that are asked for.
    pub joints: JointSet,
    /// The marker set; `None`: the built-in one that knows most of the markers.
    pub set: Option<&'a MarkerSet>,
    /// The skeleton of the person, with CMU's bones, where it is known.
    pub skeleton: Option<&'a Skeleton>,
    /// Whether deviations are asked for.
    pub deviations: bool,
}

/// Solves a take of labeled markers, y up.
///
/// # Errors
/// [`Error::Usage`]: fewer than eight markers are known, or the skeleton has not CMU's bones.
pub fn solve(
    poses: &Poses,
    settings: &SolveSettings<'_>,
    watch: &mut dyn FnMut(usize),
) -> Result<SolvedTake> {
    let set = (settings.set.or_else(|| MarkerSet::of(&poses.points)))
        .ok_or_else(|| Error::usage("no marker set"))?;
    let named = set.markers(&poses.points);
    let is_seen = |m: &NamedMarker| {
        let mut frames = 0..poses.frames();
        frames.any(|t| point_at(poses.xyz.view(), t, m.point).is_finite())
    };
    let named: Vec<NamedMarker> = named.into_iter().filter(is_seen).collect();
    if named.len() < FEWEST_MARKERS {
        return Err(too_few(set, named.len()));
    }
    let xyz = poses.xyz.view();
    let calibrated = calibrated(&named, &xyz, settings.joints, settings.skeleton)?;
    let Calibrated {
        body,
        prior,
        xyz,
        numbers,
        precision,
    } = &calibrated;
    let fitted = Fitted {
        body,
        prior,
        skeleton: body.skeleton(numbers)?,
        xyz,
        rate: poses.rate(),
    };
    let sequence = fitted.sequence(watch)?;
    let seen = |t: usize| xyz.row(t).iter().filter(|v| v.is_finite()).count() / 3 >= 3;
    let solved: Vec<bool> = (0..poses.frames()).map(seen).collect();
    let (names, bones) = fitted.named_bones(settings.joints)?;
    let mut joints = fitted.ends(&sequence, &bones)?;
    for (t, _) in solved.iter().enumerate().filter(|(_, is)| !**is) {
        joints.row_mut(t).fill(f64::NAN);
    }
    let sd = match settings.deviations {
        true => Some(fitted.deviations(&sequence, precision, settings.joints)?),
        false => None,
    };
    let used = named.iter().enumerate().map(|(m, marker)| {
        let (sum, count) = sequence.by_target[m];
        UsedMarker {
            name: poses.points[marker.point].clone(),
            distance: sum / count.max(1) as f64,
            deviations: calibrated.deviations(m),
        }
    });
    let is_used = |p: &usize| named.iter().any(|m| m.point == *p);
    let left_out = (0..poses.points.len()).filter(|p| !is_used(p));
    Ok(SolvedTake {
        joints: Poses {
            points: names,
            xyz: joints,
            time: poses.time.clone(),
            take: poses.take.clone(),
        },
        sd,
        skeleton: Asf {
            skeleton: body.bare_skeleton(numbers)?,
            ..template()?
        },
        set: set.name.clone(),
        used: used.collect(),
        left_out: left_out.map(|p| poses.points[p].clone()).collect(),
        unsolved: solved.iter().filter(|s| !**s).count(),
        values: sequence.values,
    })
}

/// The error of a take that has so few markers of a set.
pub(super) fn too_few(set: &MarkerSet, known: usize) -> Error {
    Error::usage(format!(
        "the set {} knows {known} of its points, and {FEWEST_MARKERS} are needed; give a set that \
         knows them: a file of lines such as LKNE = \"KNL\"",
        set.name
    ))
}

/// A person whose bones and markers were fitted.
pub(super) struct Calibrated {
    pub body: Body,
    pub prior: JointPrior,
    /// The markers (frames, 3 M), cm.
    pub xyz: Array2<f64>,
    /// The numbers of bones and markers, and one over their covariance.
    pub numbers: Vec<f64>,
    pub precision: Array2<f64>,
}

/// Fits bones and markers to a take of points at `xyz` (frames, 3 P); bones are those of `given`,
/// if it is.
pub(super) fn calibrated(
    named: &[NamedMarker],
    xyz: &ArrayView2<'_, f64>,
    joints: JointSet,
    given: Option<&Skeleton>,
) -> Result<Calibrated> {
    let prior = RotationPrior::builtin()?;
    let bones = prior
        .bones()
        .ok_or_else(|| Error::usage("the prior of rotations has no bones"))?;
    let mut body = Body::new(named, joints, bones, given)?;
    let columns = named.iter().flat_map(|m| 3 * m.point..3 * m.point + 3);
    let xyz = xyz.select(Axis(1), &columns.collect::<Vec<usize>>());
    if given.is_none()
        && let Some(width) = pelvis_width(named, &xyz, joints)
    {
        body.scale_pelvis(width);
    }
    let frames = frames_to_fit(&xyz);
    let prior = pose_prior(&body, &prior, joints)?;
    let calibrator = Calibrator {
        body: &body,
        prior: &prior,
        frames: &frames,
    };
    let Calibration { numbers, precision } = calibrator.calibrate()?;
    Ok(Calibrated {
        body,
        prior,
        xyz,
        numbers,
        precision,
    })
}

impl Calibrated {
    /// How far a marker is from where such markers are mostly, standard deviations.
    pub(super) fn deviations(&self, marker: usize) -> f64 {
        let own = BONES + 3 * marker..BONES + 3 * marker + 3;
        let off = |n: usize| self.numbers[n] - self.body.mean[n];
        let squares = own.map(|n| off(n).powi(2) * self.body.precision[[n, n]]);
        squares.sum::<f64>().sqrt()
    }

    /// Standard deviation of the place of each marker on its bone, cm.
    ///
    /// # Errors
    /// [`Error::Usage`]: bones and markers are not known.
    pub(super) fn place_deviations(&self) -> Result<Vec<f64>> {
        let singular = || Error::usage("bones and markers are not known: singular equations");
        let factor = Cholesky::new(self.precision.clone()).ok_or_else(singular)?;
        let covariance = factor
            .solve(&Array2::eye(self.numbers.len()))
            .ok_or_else(singular)?;
        let of = |m: usize| {
            let own = BONES + 3 * m..BONES + 3 * m + 3;
            own.map(|n| covariance[[n, n]]).sum::<f64>().sqrt()
        };
        Ok((0..self.body.markers.len()).map(of).collect())
    }

    /// Where each marker is in every frame (frames, 3 M), cm.
    ///
    /// # Errors
    /// [`Error::Usage`]: the equations of the prior are singular.
    pub(super) fn places(&self) -> Result<Array2<f64>> {
        let fitted = self.fitted(&self.xyz)?;
        let sequence = fitted.sequence(&mut |_| ())?;
        fitted.ends(&sequence, &self.body.marker_bones())
    }

    /// How the body stands in some frames.
    ///
    /// # Errors
    /// [`Error::Usage`]: the equations of the prior are singular.
    pub(super) fn postures(&self, frames: &[usize]) -> Result<Vec<Posture>> {
        let xyz = self.xyz.select(Axis(0), frames);
        let fitted = self.fitted(&xyz)?;
        let sequence = fitted.sequence(&mut |_| ())?;
        let rows = sequence.values.rows().into_iter();
        Ok(rows
            .map(|row| fitted.skeleton.posture(&row.to_vec()))
            .collect())
    }

    fn fitted<'a>(&'a self, xyz: &'a Array2<f64>) -> Result<Fitted<'a>> {
        Ok(Fitted {
            body: &self.body,
            prior: &self.prior,
            skeleton: self.body.skeleton(&self.numbers)?,
            xyz,
            rate: None,
        })
    }
}

/// The width between the front hips, of that which the landmarks have; `None` where it is not seen.
fn pelvis_width(named: &[NamedMarker], xyz: &Array2<f64>, joints: JointSet) -> Option<f64> {
    let front = landmark("ASI")?;
    let of = |right: bool| {
        named
            .iter()
            .position(|m| m.landmark == *front && m.is_right == right)
    };
    let (left, right) = (of(false)?, of(true)?);
    let widths = (0..xyz.nrows())
        .map(|t| point_at(xyz.view(), t, left).distance(point_at(xyz.view(), t, right)));
    let expected = 2.0 * front.place(joints, false)[0].x;
    Some(median(widths.filter(|w| w.is_finite()).collect())? / expected)
}

/// The frames that bones and markers are fitted on: of equal stretches those with most markers.
fn frames_to_fit(xyz: &Array2<f64>) -> Vec<Vec<f64>> {
    let count = xyz.nrows();
    let seen = |t: usize| xyz.row(t).iter().filter(|v| v.is_finite()).count();
    let of_stretch = |n: usize| {
        let stretch = n * count / FRAMES..((n + 1) * count / FRAMES);
        let middle = (stretch.start + stretch.end) / 2;
        stretch.max_by_key(|t| (seen(*t), usize::MAX - t.abs_diff(middle)))
    };
    let frames = (0..FRAMES).filter_map(of_stretch).filter(|t| seen(*t) >= 9);
    frames.map(|t| xyz.row(t).to_vec()).collect()
}

/// What is known of the poses of people, for the joints of the body.
pub(super) fn pose_prior(
    body: &Body,
    prior: &RotationPrior,
    joints: JointSet,
) -> Result<JointPrior> {
    let skeleton = body.bare_skeleton(&body.mean)?;
    let points: Vec<(usize, usize)> = (CMU.iter().enumerate())
        .filter_map(|(n, name)| Some((skeleton.find(name)?, n)))
        .collect();
    let mut own = JointPrior::new(prior, &skeleton, 0, &points);
    if joints == JointSet::Anatomical {
        own.covariance *= FREER * FREER;
        for (n, &bone) in own.bones.iter().enumerate() {
            if skeleton.bones()[bone].name.ends_with("clavicle") {
                let mut diagonal = own.covariance.diag_mut();
                let mut block = diagonal.slice_mut(s![3 * n..3 * n + 3]);
                block += COLLAR.to_radians().powi(2);
            }
        }
    }
    Ok(own)
}

/// A body that was fitted, and the take.
struct Fitted<'a> {
    body: &'a Body,
    prior: &'a JointPrior,
    /// With markers.
    skeleton: Skeleton,
    /// The markers (frames, 3 M), cm.
    xyz: &'a Array2<f64>,
    /// Frames a second, where they are known.
    rate: Option<f64>,
}

impl Fitted<'_> {
    fn sequence(&self, watch: &mut dyn FnMut(usize)) -> Result<SequenceFit> {
        let joints = self.body.marker_bones();
        let solver = frame_solver(&self.skeleton, &joints, self.prior)?;
        let shape = (self.xyz.nrows(), joints.len());
        let sd = Array2::from_shape_fn(shape, |(_, m)| self.body.markers[m].sd);
        let targets = Targets {
            joints: &joints,
            cmu: &vec![None; joints.len()],
            xyz: self.xyz.view(),
            sd: Some(sd.view()),
            rate: self.rate,
        };
        Ok(fit_frames(
            &self.skeleton,
            &targets,
            0,
            solver,
            false,
            watch,
        ))
    }

    /// Where some bones end in every frame (frames, 3 B), cm.
    fn ends(&self, sequence: &SequenceFit, bones: &[usize]) -> Result<Array2<f64>> {
        let count = sequence.values.nrows();
        let rows = map_chunks(count, 64, |range| {
            let of = |t: usize| {
                let posture = self.skeleton.posture(&sequence.values.row(t).to_vec());
                let ends = bones.iter().flat_map(|b| posture.ends[*b].to_array());
                ends.collect::<Vec<f64>>()
            };
            range.flat_map(of).collect::<Vec<f64>>()
        });
        Array2::from_shape_vec((count, 3 * bones.len()), rows.concat())
            .map_err(|e| Error::usage(e.to_string()))
    }

    /// The names of joints and the bones that end there.
    fn named_bones(&self, set: JointSet) -> Result<(Vec<String>, Vec<usize>)> {
        let missing = |bone: &str| Error::usage(format!("the body has no bone {bone}"));
        let all = set.joints().into_iter().map(|(name, bone)| {
            let found = self.skeleton.find(&bone).ok_or_else(|| missing(&bone))?;
            Ok((name, found))
        });
        Ok(all.collect::<Result<Vec<_>>>()?.into_iter().unzip())
    }

    fn deviations(
        &self,
        sequence: &SequenceFit,
        precision: &Array2<f64>,
        set: JointSet,
    ) -> Result<Array2<f64>> {
        let (names, bones) = self.named_bones(set)?;
        let joints = self.body.marker_bones();
        let solver = frame_solver(&self.skeleton, &joints, self.prior)?;
        let singular = || Error::usage("bones and markers are not known: singular equations");
        let numbers = Cholesky::new(precision.clone()).ok_or_else(singular)?;
        let deviations = Deviations {
            body: self.body,
            solver: &solver,
            numbers: &numbers,
            bones: &bones,
        };
        let weights = self.body.weights();
        let count = sequence.values.nrows();
        let rows = map_chunks(count, 8, |range| {
            let mut scratch = Scratch::default();
            let mut of = |t: usize| {
                let state = solver.state_of(&sequence.values.row(t).to_vec());
                let frame = self.xyz.row(t).to_vec();
                let at = solver.linearized(&state, &frame, &weights, &mut scratch);
                let own = deviations.of(&at, &scratch);
                own.unwrap_or_else(|| vec![f64::NAN; bones.len()])
            };
            range.flat_map(&mut of).collect::<Vec<f64>>()
        });
        let mut sd = Array2::from_shape_vec((count, bones.len()), rows.concat())
            .map_err(|e| Error::usage(e.to_string()))?;
        for (j, name) in names.iter().enumerate() {
            sd.column_mut(j)
                .mapv_inplace(|v| v * Deviations::factor_of(name));
        }
        Ok(sd)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    const NAMES: &str = "LFHD RFHD LBHD RBHD C7 T10 CLAV STRN LSHO RSHO LUPA RUPA LELB RELB LFRM \
                         RFRM LWRA RWRA LWRB RWRB LFIN RFIN LFWT RFWT LBWT RBWT LTHI RTHI LKNE \
                         RKNE LSHN RSHN LANK RANK LHEE RHEE LMT5 RMT5 LTOE RTOE";

    /// A person's markers, who moves, and the joints.
    pub(in crate::solve) fn person(frames: usize) -> (Poses, Array2<f64>) {
        let points: Vec<String> = NAMES.split_whitespace().map(String::from).collect();
        let named = MarkerSet::find("cmu41").unwrap().markers(&points);
        let prior = RotationPrior::builtin().unwrap();
        let body = Body::new(&named, JointSet::Cmu, prior.bones().unwrap(), None).unwrap();
        let mut numbers = body.mean.clone();
        for (n, v) in numbers.iter_mut().enumerate() {
            // A tall person; markers are off by some.
            *v *= if n < BONES { 1.04 } else { 1.0 };
            *v += if n < BONES {
                0.0
            } else {
                0.6 * (1.3 * n as f64).sin()
            };
        }
        let skeleton = body.skeleton(&numbers).unwrap();
        let (mut xyz, mut joints) = (Vec::new(), Vec::new());
        for t in 0..frames {
            let time = t as f64 / 60.0;
            let mut q = vec![0.0; skeleton.dof_count()];
            for (b, bone) in skeleton.bones().iter().enumerate() {
                // As people move: collar bones of CMU's do not.
                let size = match &bone.name[..] {
                    "lclavicle" | "rclavicle" | "ltoes" | "rtoes" | "lhand" | "rhand" => 0.0,
                    name if name.ends_with("back") || name.ends_with("neck") => 0.05,
                    _ => 0.25,
                };
                for i in skeleton.dofs_of(b) {
                    q[i] = size * (2.0 * time + i as f64).sin();
                }
            }
            (q[0], q[1], q[4]) = (40.0 * time, 95.0, 1.5 + time);
            let posture = skeleton.posture(&q);
            let markers = body.marker_bones();
            xyz.extend(markers.iter().flat_map(|b| posture.ends[*b].to_array()));
            let ends = CMU.map(|n| posture.ends[skeleton.find(n).unwrap()]);
            joints.extend(ends.iter().flat_map(|e| e.to_array()));
        }
        let shaped = |v: Vec<f64>| Array2::from_shape_vec((frames, v.len() / frames), v).unwrap();
        let poses = Poses {
            points,
            xyz: shaped(xyz),
            time: Some((0..frames).map(|t| t as f64 / 60.0).collect()),
            ..Poses::default()
        };
        (poses, shaped(joints))
    }

    /// The mean distance of joints, cm.
    fn apart(a: &Array2<f64>, b: &Array2<f64>) -> f64 {
        let far = |(a, b): (ndarray::ArrayView1<'_, f64>, ndarray::ArrayView1<'_, f64>)| {
            (0..a.len() / 3)
                .map(|j| {
                    (0..3)
                        .map(|c| (a[3 * j + c] - b[3 * j + c]).powi(2))
                        .sum::<f64>()
                })
                .map(f64::sqrt)
                .collect::<Vec<f64>>()
        };
        let all: Vec<f64> = a.rows().into_iter().zip(b.rows()).flat_map(far).collect();
        all.iter().sum::<f64>() / all.len() as f64
    }

    fn solved(poses: &Poses, deviations: bool) -> SolvedTake {
        let settings = SolveSettings {
            deviations,
            ..SolveSettings::default()
        };
        solve(poses, &settings, &mut |_| ()).unwrap()
    }

    #[test]
    fn joints_come_from_markers_missing_and_exchanged_ones_too() {
        let (poses, joints) = person(90);
        let found = solved(&poses, true);
        assert_eq!((found.set.as_str(), found.used.len()), ("cmu41", 40));
        assert_eq!(found.joints.points, CMU);
        let off = apart(&found.joints.xyz, &joints);
        assert!(off <= 2.0, "{off}");
        let sd = found.sd.unwrap();
        assert!(sd.iter().all(|sd| *sd > 0.05 && *sd < 5.0), "{sd:?}");
        // The values are those of the joints.
        let skeleton = &found.skeleton.skeleton;
        let posture = skeleton.posture(&found.values.row(40).to_vec());
        let knee = posture.ends[skeleton.find("lfemur").unwrap()];
        assert!(knee.abs_diff_eq(point_at(found.joints.xyz.view(), 40, 2), 1e-9));
        let mut harmed = poses.clone();
        for t in 0..90 {
            let drawn = |p: usize| (31 * t + 17 * p + 1).wrapping_mul(2_654_435_761) >> 13;
            for p in (0..40).filter(|p| drawn(*p) % 4 == 0) {
                (0..3).for_each(|c| harmed.xyz[[t, 3 * p + c]] = f64::NAN);
            }
            let (a, b) = (t % 40, (3 * t + 11) % 40);
            (0..3).for_each(|c| harmed.xyz.swap([t, 3 * a + c], [t, 3 * b + c]));
        }
        let worse = apart(&solved(&harmed, false).joints.xyz, &joints);
        assert!(worse <= off + 0.6, "{off} {worse}");
    }

    #[test]
    fn a_learned_set_knows_where_the_markers_are() {
        let (poses, xyz) = person(60);
        let joints = Poses {
            points: CMU.map(String::from).to_vec(),
            xyz: xyz.clone(),
            ..Poses::default()
        };
        let both = [(&poses, Some(&joints)), (&poses, Some(&joints))];
        let learned = MarkerSet::learn("mine", &both, None).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), learned.to_json().unwrap()).unwrap();
        let again = MarkerSet::open(file.path()).unwrap();
        let with = |set: Option<&MarkerSet>| {
            let settings = SolveSettings {
                set,
                ..SolveSettings::default()
            };
            let found = solve(&poses, &settings, &mut |_| ()).unwrap();
            apart(&found.joints.xyz, &xyz)
        };
        let (plain, own) = (with(None), with(Some(&again)));
        assert!(own < 0.95 * plain, "{plain} {own}");
        assert!(MarkerSet::learn("mine", &[(&poses, Some(&poses))], None).is_err());
        std::fs::write(file.path(), "{}").unwrap();
        let error = MarkerSet::open(file.path()).unwrap_err().to_string();
        assert!(error.contains("marker set"), "{error}");
    }

    #[test]
    fn frames_without_markers_stay_empty() {
        let (mut poses, _) = person(60);
        poses.xyz.row_mut(20).fill(f64::NAN);
        let found = solved(&poses, false);
        assert_eq!(found.unsolved, 1);
        assert!(found.joints.xyz.row(20).iter().all(|v| v.is_nan()));
        assert!(found.joints.xyz.row(21).iter().all(|v| v.is_finite()));
        assert!(found.values.iter().all(|v| v.is_finite()));
        poses.points.truncate(7);
        poses.xyz = poses.xyz.slice(s![.., ..21]).to_owned();
        let error = solve(&poses, &SolveSettings::default(), &mut |_| ()).unwrap_err();
        assert!(
            error.to_string().contains("knows 7 of its points"),
            "{error}"
        );
    }
}
