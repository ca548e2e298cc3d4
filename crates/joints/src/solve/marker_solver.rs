//! A take of markers solved: joints, how sure they are, and the skeleton's values.

use super::body::template;
use super::fitted::Fitted;
use super::landmarks::JointSet;
use super::marker_sets::{MarkerSet, NamedMarker};
use super::person::{Calibrated, calibrated};
use super::plug_in_gait::{BodyCenters, Centers, PlugInGait};
use super::solved_take::{SolvedTake, UsedMarker};
use super::tuning::*;
use super::unseen_limbs::SeenBones;
use crate::gait::GivenValues;
use crate::ik::sequence::key_stride;
use crate::io::Asf;
use crate::label::people::named_people;
use crate::label::unlabeled::is_unlabeled;
use crate::pose::zeros::Zeros;
use crate::pose::{Poses, Skeleton, point_at};
use crate::{Error, Result};
use ndarray::{Array2, s};
use std::ops::Range;

/// How a take is solved.
#[derive(Default)]
pub struct SolveSettings<'a> {
    /// The joints that are asked for.
    pub joints: JointSet,
    /// The marker set; `None`: the built-in one that knows most of the markers.
    pub set: Option<&'a MarkerSet>,
    /// The skeleton of the person, with CMU's bones, where it is known.
    pub skeleton: Option<&'a Skeleton>,
    /// A static take of the person, with the same markers and others.
    pub statics: Option<&'a Poses>,
    /// In every how many frames deviations are asked for; 0: in none.
    pub deviations_every: usize,
    /// What is given of the subject by Plug-in Gait's names, as a C3D file has it in its group
    /// PROCESSING: with it, anatomical joints under Plug-in Gait's markers are at its centers.
    pub subject: Option<&'a GivenValues>,
    /// Standard deviation of a coordinate of each point (frames, P), cm: of those that were filled.
    pub filled: Option<&'a Array2<f64>>,
}

impl<'a> SolveSettings<'a> {
    /// Whether the joints are those that Plug-in Gait has centers for, under its markers.
    fn has_plug_in_gait(&self, set: &MarkerSet) -> bool {
        self.joints == JointSet::Anatomical && MarkerSet::find("pig") == Some(set)
    }

    fn plug_in_gait(&self, poses: &'a Poses) -> PlugInGait<'a> {
        PlugInGait {
            poses,
            statics: self.statics,
            subject: self.subject,
            filled: self.filled,
        }
    }
}

/// Solves a take of labeled markers, y up.
///
/// ```
/// use posing_io::{MotionFile, motion_file::ReadOptions};
/// use posing_joints::solve::{SolveSettings, solve};
///
/// let path = "../../testdata/examples/biomechanist/gait.c3d";
/// let markers = MotionFile::open(path, &ReadOptions::default())?;
/// let take = markers.poses().slice(0..20);
/// let solved = solve(&take, &SolveSettings::default(), &mut |_| ())?;
/// assert_eq!(solved.set, "pig"); // Plug-in Gait, told by the markers' names
/// assert_eq!(solved.joints.xyz.dim(), (20, 69)); // CMU's 23 joints
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Errors
/// [`Error::Unfit`]: fewer than eight markers are known, or most of a body's tracks have no label.
/// [`Error::Usage`]: the skeleton has not CMU's bones, or the names tell several people.
pub fn solve(
    poses: &Poses,
    settings: &SolveSettings<'_>,
    watch: &mut dyn FnMut(usize),
) -> Result<SolvedTake> {
    let set = (settings.set.or_else(|| MarkerSet::of(&poses.points)))
        .ok_or_else(|| Error::usage("no marker set"))?;
    let all = AllMarkers::new(poses, settings.statics);
    let named = all.of_one_person(poses, set)?;
    let calibrated = calibrated(
        &named,
        (&all.take.view(), FRAMES),
        all.statics.as_ref(),
        settings.joints,
        settings.skeleton,
    )?;
    let (body, xyz) = (&calibrated.body, &calibrated.xyz);
    let fitted = Fitted {
        body,
        prior: &calibrated.prior,
        skeleton: body.skeleton(&calibrated.numbers)?,
        xyz,
        stride: key_stride(poses.rate()),
    };
    let mut sequence = fitted.sequence(watch)?;
    let seen = |t: usize| xyz.row(t).iter().filter(|v| v.is_finite()).count() / 3 >= 3;
    let solved: Vec<bool> = (0..poses.frames()).map(seen).collect();
    let (names, bones) = fitted.named_bones(settings.joints)?;
    let mut joints = fitted.ends(&sequence, &bones)?;
    let ends: Vec<(String, usize)> = names.iter().cloned().zip(bones).collect();
    let unsolved = (0..poses.frames()).filter(|t| !solved[*t]);
    unsolved.for_each(|t| joints.row_mut(t).fill(f64::NAN));
    let every = settings.deviations_every;
    let deviations =
        || fitted.deviations(&sequence, &calibrated.precision, (settings.joints, every));
    let mut sd = (every > 0).then(deviations).transpose()?;
    let markers: Vec<usize> = body.markers.iter().map(|m| m.bone).collect();
    let by_body = BodyCenters::new(&fitted.skeleton, &sequence.values, &ends);
    let centers = if settings.has_plug_in_gait(set) {
        settings
            .plug_in_gait(poses)
            .put(&by_body, &mut joints, &mut sd)?
    } else {
        Centers::Model
    };
    let by_markers = SeenBones {
        bones: body.template.bones(),
        marked: &markers,
        xyz,
        rate: poses.rate(),
    };
    let unseen = by_markers.unseen(&solved);
    empty(&mut joints, &mut sd, &ends, &unseen);
    rest(&mut sequence.values, &fitted.skeleton, &unseen);
    let of_markers: Vec<&String> = named.iter().map(|m| &all.points[m.point]).collect();
    let (used, of_static) = used(&calibrated, &sequence.by_target, &of_markers);
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
            skeleton: body.bare_skeleton(&calibrated.numbers)?,
            ..template()?
        },
        set: set.name.clone(),
        centers,
        used,
        of_static,
        left_out: left_out.map(|p| poses.points[p].clone()).collect(),
        unseen: by_markers.limbs(&ends, &unseen),
        unsolved: solved.iter().filter(|s| !**s).count(),
        unsettled: sequence.unconverged,
        values: sequence.values,
    })
}

/// Empties joints, which are at the `ends` of bones, and their deviations where these are unseen.
fn empty(
    joints: &mut Array2<f64>,
    sd: &mut Option<Array2<f64>>,
    ends: &[(String, usize)],
    unseen: &[Vec<Range<usize>>],
) {
    for (j, (_, bone)) in ends.iter().enumerate() {
        for run in &unseen[*bone] {
            let own = s![run.clone(), 3 * j..3 * j + 3];
            joints.slice_mut(own).fill(f64::NAN);
            if let Some(sd) = sd {
                sd.slice_mut(s![run.clone(), j]).fill(f64::NAN);
            }
        }
    }
}

/// Rests the bones that are never seen.
fn rest(values: &mut Array2<f64>, skeleton: &Skeleton, unseen: &[Vec<Range<usize>>]) {
    let frames = values.nrows();
    let never = |bone: &usize| unseen[*bone].iter().any(|run| run.len() == frames);
    for bone in (0..unseen.len()).filter(never) {
        values.slice_mut(s![.., skeleton.dofs_of(bone)]).fill(0.0);
    }
}

/// The markers that are used, by their names and the sums and numbers of their distances over the
/// take; and the names of those that are none of the take.
fn used(
    calibrated: &Calibrated,
    distances: &[(f64, usize)],
    names: &[&String],
) -> (Vec<UsedMarker>, Vec<String>) {
    let body = &calibrated.body;
    let (mut used, mut of_static) = (Vec::new(), Vec::new());
    for (m, &(sum, count)) in distances.iter().enumerate() {
        if count == 0 {
            of_static.push(names[m].clone());
            continue;
        }
        used.push(UsedMarker {
            name: names[m].clone(),
            bone: body.template.bones()[body.markers[m].bone].name.clone(),
            distance: sum / count as f64,
            deviations: calibrated.deviations(m),
            exchanged_with: calibrated.exchanged_with(m).map(|m| names[m].clone()),
        });
    }
    (used, of_static)
}

/// Why the labels of a take are no body that can be solved: a good part of the set's markers has no
/// track, and as many tracks have no label. Then labels may be of several people.
#[doc(hidden)]
pub fn doubt(poses: &Poses, set: &MarkerSet) -> Option<String> {
    let all = set.all().0.len();
    let of_points = |points: &[usize]| {
        let of_point = |&p: &usize| {
            let is_seen = |t: &usize| point_at(poses.xyz.view(), *t, p).is_finite();
            (0..poses.frames()).filter(is_seen).count()
        };
        points.iter().map(of_point).collect::<Vec<usize>>()
    };
    let known: Vec<usize> = set.markers(&poses.points).iter().map(|m| m.point).collect();
    let loose: Vec<usize> = (0..poses.points.len())
        .filter(|p| is_unlabeled(&poses.points[*p]))
        .collect();
    let (known, loose) = (of_points(&known), of_points(&loose));
    let named = known.iter().filter(|seen| **seen > 0).count();
    let are_few = (FEWEST_MARKERS as f64..SHARE_NAMED * all as f64).contains(&(named as f64));
    let are_many = loose.iter().sum::<usize>() >= known.iter().sum::<usize>();
    (are_few && are_many).then(|| {
        format!(
            "{named} of the {all} markers of the set {} have a track, and as many tracks have no \
             label: their names may be of several people; label them, or leave out what is not of \
             the person (the command `trim`, the option `points`)",
            set.name
        )
    })
}

/// The markers of a take, and of a static one, by the same points.
struct AllMarkers {
    points: Vec<String>,
    take: Array2<f64>,
    statics: Option<Array2<f64>>,
}

impl AllMarkers {
    fn new(poses: &Poses, statics: Option<&Poses>) -> AllMarkers {
        let mut points = poses.points.clone();
        let is_other = |p: &&String| !poses.points.contains(p);
        points.extend(
            statics
                .iter()
                .flat_map(|s| s.points.iter().filter(is_other))
                .cloned(),
        );
        let ordered = |own: &Poses| {
            let own = Zeros::emptied(own);
            let mut xyz = Array2::from_elem((own.frames(), 3 * points.len()), f64::NAN);
            for (p, name) in own.points.iter().enumerate() {
                if let Some(to) = points.iter().position(|n| n == name) {
                    let from = own.xyz.slice(s![.., 3 * p..3 * p + 3]);
                    xyz.slice_mut(s![.., 3 * to..3 * to + 3]).assign(&from);
                }
            }
            xyz
        };
        AllMarkers {
            take: ordered(poses),
            statics: statics.map(ordered),
            points,
        }
    }

    /// The markers of a set that are seen of the one person of a take.
    ///
    /// # Errors
    /// Those of [`solve`].
    fn of_one_person(&self, poses: &Poses, set: &MarkerSet) -> Result<Vec<NamedMarker>> {
        if named_people(&poses.points) > 1 {
            let what = "the points are of several people by their names; take one out with the \
                        command `trim` and its option `person`";
            return Err(Error::usage(what));
        }
        let named = self.named(set)?;
        match doubt(poses, set) {
            Some(doubt) => Err(Error::unfit(doubt)),
            None => Ok(named),
        }
    }

    /// The markers of a set that are seen.
    ///
    /// # Errors
    /// [`Error::Unfit`]: too few are in the take.
    fn named(&self, set: &MarkerSet) -> Result<Vec<NamedMarker>> {
        let is_seen = |m: &NamedMarker, xyz: &Array2<f64>| {
            (0..xyz.nrows()).any(|t| point_at(xyz.view(), t, m.point).is_finite())
        };
        let mut known = set.markers(&self.points);
        let in_take = known.iter().filter(|m| is_seen(m, &self.take)).count();
        if in_take < FEWEST_MARKERS {
            return Err(too_few(set, in_take));
        }
        let in_statics = |m: &NamedMarker| self.statics.as_ref().is_some_and(|s| is_seen(m, s));
        known.retain(|m| is_seen(m, &self.take) || in_statics(m));
        Ok(known)
    }
}

/// The error of a take that has so few markers of a set.
pub(super) fn too_few(set: &MarkerSet, known: usize) -> Error {
    if set.postures.is_some() {
        return Error::unfit(format!(
            "no skeleton: the set {} names labels, and says of none where on a body it is; give a \
             file of lines such as LKNE = \"KNL\"",
            set.name
        ));
    }
    Error::unfit(format!(
        "too few markers: the set {} knows {known} of its points, and {FEWEST_MARKERS} are needed; \
         give a set that knows them: a file of lines such as LKNE = \"KNL\"",
        set.name
    ))
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::body::{BONES, Body};
    use super::*;
    use crate::pose::joints::CMU;
    use crate::prior::rotations::RotationPrior;
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
            deviations_every: usize::from(deviations),
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
    fn exchanged_markers_are_told() {
        let (poses, _) = person(60);
        assert_eq!(solved(&poses, false).findings(), [""; 0]);
        for pair in [["LFWT", "RFWT"], ["LBWT", "RBWT"], ["LKNE", "RKNE"]] {
            let mut harmed = poses.clone();
            let [a, b] = pair.map(|name| poses.points.iter().position(|p| p == name).unwrap());
            harmed.points.swap(a, b);
            let found = solved(&harmed, false);
            let told: Vec<&str> = (found.used.iter())
                .filter(|m| m.is_suspect())
                .map(|m| m.name.as_str())
                .collect();
            assert!(
                pair.iter().all(|name| told.contains(name)),
                "{pair:?} {told:?}"
            );
            assert!(told.len() <= 3, "{pair:?} {told:?}");
        }
    }

    #[test]
    fn labels_beside_as_many_nameless_tracks_are_doubtful() {
        let (mut poses, _) = person(10);
        let set = MarkerSet::find("cmu41").unwrap();
        assert_eq!(doubt(&poses, set), None);
        // A few ghosts are none of a body; half of the body's tracks are.
        for p in 0..poses.points.len() {
            if p % 10 == 0 {
                poses.points[p] = format!("*{p}");
            }
        }
        assert_eq!(doubt(&poses, set), None);
        for p in 0..poses.points.len() {
            if p % 2 == 0 {
                poses.points[p] = format!("*{p}");
            }
        }
        assert!(doubt(&poses, set).unwrap().contains("several people"));
        assert!(solve(&poses, &SolveSettings::default(), &mut |_| ()).is_err());
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
