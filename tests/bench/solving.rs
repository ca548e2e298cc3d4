//! How near joints from markers are to known ones, and to those of the rules and functional
//! methods of the field: `cargo bench --bench solving`.
//!
//! Takes with truth at `../shared/data/markers`; errors are distances in the take's world, without
//! any alignment, cm.

mod shared;

use glam::{DMat3, DVec3};
use ndarray::{Array2, Axis, s};
use posing::io::MotionFile;
use posing::io::motion_file::ReadOptions;
use posing::io::{Asf, Input};
use posing::numeric::parallel;
use posing::pose::similarity::{TransformKind, fit_similarity};
use posing::pose::{Poses, UpAxis};
use posing::solve::{JointSet, MarkerSet, SolveSettings, SolvedTake, solve};
use rand::Rng;
use rand::seq::index::sample;
use std::path::Path;
use std::time::Instant;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data");
/// Takes, the axis that points up where the file does not say, and their joints.
const TAKES: [(&str, &str, Option<UpAxis>, &str); 6] = [
    ("CMU 06_01", "markers/cmu-06_01.c3d", None, "cmu-06_01"),
    (
        "HDM05 dg",
        "formats/hdm05/HDM_dg_06-03_03_120.c3d",
        Some(UpAxis::Z),
        "hdm-dg",
    ),
    (
        "Arnold 01",
        "markers/arnold-01.trc.gz",
        Some(UpAxis::Y),
        "arnold-01",
    ),
    (
        "Arnold 02",
        "markers/arnold-02.trc.gz",
        Some(UpAxis::Y),
        "arnold-02",
    ),
    (
        "Arnold 04",
        "markers/arnold-04.trc.gz",
        Some(UpAxis::Y),
        "arnold-04",
    ),
    ("Plug-in Gait", "markers/pig-full.csv.gz", None, "pig-full"),
];
/// Joints by CMU's names and by those of biomechanists, a column each.
const COLUMNS: [(&str, &[&str]); 9] = [
    ("hip", &["hipjoint", "HJC"]),
    ("knee", &["femur", "KJC"]),
    ("ankle", &["tibia", "AJC"]),
    ("ball", &["foot"]),
    ("shoulder", &["clavicle", "SJC"]),
    ("elbow", &["humerus", "EJC"]),
    ("forearm", &["radius"]),
    ("wrist", &["wrist", "WJC"]),
    ("trunk", &[]),
];

struct Take {
    name: &'static str,
    markers: Poses,
    truth: Poses,
}

fn main() {
    let takes: Vec<Take> = TAKES.iter().filter_map(take).collect();
    if takes.is_empty() {
        return println!("no takes at {DATA}/markers: nothing is solved");
    }
    let solved: Vec<SolvedTake> = takes.iter().map(of_markers_alone).collect();
    worst_frames(&takes, &solved);
    hips(&takes, &solved);
    println!("\nmean with damage, cm");
    takes.iter().for_each(damaged);
    statics(&takes[2..5]);
    learned(&takes[2..5]);
    given_skeleton(&takes[0]);
}

fn take(of: &(&'static str, &str, Option<UpAxis>, &str)) -> Option<Take> {
    let (name, file, up, joints) = *of;
    let options = ReadOptions {
        up,
        ..ReadOptions::default()
    };
    let path = Path::new(DATA).join(file);
    let truth = Path::new(DATA).join(format!("markers/{joints}.joints.csv.gz"));
    let file = MotionFile::open(path, &options).ok()?;
    let truth = MotionFile::open(truth, &ReadOptions::default()).ok()?;
    Some(Take {
        name,
        markers: file.poses().clone(),
        truth: truth.poses().clone(),
    })
}

fn settings(take: &Take) -> SolveSettings<'static> {
    let is_cmu = take.truth.points.iter().any(|p| p == "root");
    SolveSettings {
        joints: if is_cmu {
            JointSet::Cmu
        } else {
            JointSet::Anatomical
        },
        ..SolveSettings::default()
    }
}

fn solved(markers: &Poses, settings: &SolveSettings<'_>) -> SolvedTake {
    solve(markers, settings, &mut |_| ()).expect("the take is solved")
}

/// Distances of joints from the truth (frames, joints of the truth), cm; NaN where there is none.
fn errors(joints: &Poses, truth: &Poses) -> Array2<f64> {
    let column = |name: &String| {
        joints
            .points
            .iter()
            .position(|p| p.eq_ignore_ascii_case(name))
    };
    let columns: Vec<Option<usize>> = truth.points.iter().map(column).collect();
    Array2::from_shape_fn((truth.frames(), truth.points.len()), |(t, j)| {
        columns[j].map_or(f64::NAN, |c| at(joints, t, c).distance(at(truth, t, j)))
    })
}

fn at(poses: &Poses, frame: usize, point: usize) -> DVec3 {
    let place = s![frame, 3 * point..3 * point + 3];
    DVec3::from_slice(&poses.xyz.slice(place).to_vec())
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let finite: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    finite.iter().sum::<f64>() / finite.len() as f64
}

fn error(markers: &Poses, truth: &Poses, settings: &SolveSettings<'_>) -> f64 {
    mean(errors(&solved(markers, settings).joints, truth).into_iter())
}

/// The column of a joint; those of no limb are the trunk's.
fn column_of(joint: &str) -> usize {
    let limb = joint.strip_prefix(['l', 'r', 'L', 'R']).unwrap_or("");
    let found = COLUMNS.iter().position(|(_, names)| names.contains(&limb));
    found.unwrap_or(COLUMNS.len() - 1)
}

fn of_markers_alone(take: &Take) -> SolvedTake {
    if take.name == TAKES[0].0 {
        print!("{:14}{:>6}{:>6}{:>7}", "cm", "mean", "95%", "z");
        COLUMNS.iter().for_each(|(name, _)| print!("{name:>9}"));
        println!("{:>8}{:>10}", "frames", "seconds");
    }
    let began = Instant::now();
    let settings = SolveSettings {
        deviations_every: 1,
        ..settings(take)
    };
    let solved = solved(&take.markers, &settings);
    let seconds = began.elapsed().as_secs_f64();
    let errors = errors(&solved.joints, &take.truth);
    let mut all: Vec<f64> = errors.iter().copied().filter(|e| e.is_finite()).collect();
    all.sort_by(f64::total_cmp);
    print!(
        "{:14}{:6.2}{:6.1}{:7.2}",
        take.name,
        mean(all.iter().copied()),
        all[all.len() * 95 / 100],
        deviations_off(&solved, &take.truth)
    );
    for column in 0..COLUMNS.len() {
        let own = |j: &usize| column_of(&take.truth.points[*j]) == column;
        let own = (0..take.truth.points.len()).filter(own);
        let off = mean(own.flat_map(|j| errors.column(j).to_vec()));
        print!(
            "{:>9}",
            if off.is_finite() {
                format!("{off:.1}")
            } else {
                "-".into()
            }
        );
    }
    println!("{:>8}{seconds:10.2}", take.markers.frames());
    solved
}

/// Root of the mean square of a coordinate's error in its deviations: 1 where these are right.
fn deviations_off(solved: &SolvedTake, truth: &Poses) -> f64 {
    let sd = solved.sd.as_ref().expect("deviations");
    let column = |j: usize| {
        let name = &solved.joints.points[j];
        truth
            .points
            .iter()
            .position(|p| p.eq_ignore_ascii_case(name))
    };
    let pairs = (0..solved.joints.points.len()).filter_map(|j| Some((j, column(j)?)));
    let of = |(j, k): (usize, usize)| {
        (0..truth.frames()).map(move |t| {
            let off = at(&solved.joints, t, j).distance_squared(at(truth, t, k));
            off / (3.0 * sd[[t, j]].powi(2))
        })
    };
    mean(pairs.flat_map(of)).sqrt()
}

/// The ten worst frames of all takes, no two within half a second.
fn worst_frames(takes: &[Take], solved: &[SolvedTake]) {
    println!("\nten worst frames: mean of the joints, and the worst of them, cm");
    let mut all: Vec<(f64, usize, usize, String)> = Vec::new();
    for (n, (take, solved)) in takes.iter().zip(solved).enumerate() {
        let errors = errors(&solved.joints, &take.truth);
        for (t, row) in errors.axis_iter(Axis(0)).enumerate() {
            let known = row.iter().enumerate().filter(|(_, e)| e.is_finite());
            if let Some((j, e)) = known.max_by(|a, b| a.1.total_cmp(b.1)) {
                let worst = format!("{} {e:.1}", take.truth.points[j]);
                all.push((mean(row.iter().copied()), n, t, worst));
            }
        }
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut told: Vec<(usize, usize)> = Vec::new();
    for (off, n, t, worst) in all {
        if told.len() < 10 && !told.iter().any(|&(m, u)| m == n && u.abs_diff(t) < 60) {
            println!("{:14} frame {t:4} {off:5.1}  {worst}", takes[n].name);
            told.push((n, t));
        }
    }
}

/// The markers of a pelvis, and of a side's thigh, by the names of any of the sets.
struct HipMarkers {
    pelvis: [usize; 4],
    thigh: Vec<usize>,
}

impl HipMarkers {
    fn of(points: &[String], side: &str) -> Option<HipMarkers> {
        let own = |name: &String| name.rsplit(':').next().unwrap_or("").to_string();
        let find = |names: [&str; 2]| points.iter().position(|p| names.contains(&&*own(p)));
        let thigh = ["THI", "KNE", "TH1", "TH2", "TH3", "LFC", "MFC"].map(|n| format!("{side}{n}"));
        Some(HipMarkers {
            pelvis: [
                find(["LASI", "LFWT"])?,
                find(["RASI", "RFWT"])?,
                find(["LPSI", "LBWT"])?,
                find(["RPSI", "RBWT"])?,
            ],
            thigh: (0..points.len())
                .filter(|p| thigh.contains(&own(&points[*p])))
                .collect(),
        })
    }

    /// The pelvis' frame (x forward, y up, z to the right) and the middle between its front.
    fn frame(&self, markers: &Poses, t: usize) -> (DMat3, DVec3) {
        let [left, right, back_left, back_right] = self.pelvis.map(|p| at(markers, t, p));
        let middle = (left + right) / 2.0;
        let z = (right - left).normalize();
        let ahead = middle - (back_left + back_right) / 2.0;
        let x = (ahead - z * ahead.dot(z)).normalize();
        (DMat3::from_cols(x, z.cross(x), z), middle)
    }
}

/// The hip by the width and depth of the pelvis (Harrington et al., J. Biomech. 40, 2007), in its
/// frame, cm.
fn harrington(hip: &HipMarkers, markers: &Poses, side: &str) -> DVec3 {
    let size = |t: usize| {
        let [left, right, back_left, back_right] = hip.pelvis.map(|p| at(markers, t, p));
        let depth = (left + right - back_left - back_right).length() / 2.0;
        DVec3::new(left.distance(right), depth, 0.0)
    };
    let frames = 0..markers.frames();
    let width = mean(frames.clone().map(|t| size(t).x));
    let depth = mean(frames.map(|t| size(t).y));
    let right = if side == "R" { 1.0 } else { -1.0 };
    DVec3::new(
        -0.24 * depth - 0.99,
        -0.30 * width - 1.09,
        right * (0.33 * width + 0.73),
    )
}

/// The hip as the point that keeps still in pelvis and thigh (SCoRE; Ehrig et al., J. Biomech. 39,
/// 2006), in the pelvis' frame, cm. `None` where the thigh has fewer than three markers.
fn score(hip: &HipMarkers, markers: &Poses) -> Option<DVec3> {
    let is_seen = |t: &usize| {
        let mut all = hip.pelvis.iter().chain(&hip.thigh);
        all.all(|p| at(markers, *t, *p).is_finite())
    };
    let frames: Vec<usize> = (0..markers.frames()).filter(is_seen).collect();
    if hip.thigh.len() < 3 || frames.is_empty() {
        return None;
    }
    let first = frames[0];
    let (mut turn, mut of_pelvis, mut of_thigh) = (DMat3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for t in &frames {
        let (pelvis, middle) = hip.frame(markers, *t);
        let pairs = hip.thigh.iter();
        let pairs = pairs.map(|p| (at(markers, first, *p), at(markers, *t, *p), 1.0));
        let thigh = fit_similarity(pairs, TransformKind::Rigid)?.similarity;
        let apart = thigh.shift - middle;
        turn += pelvis.transpose() * thigh.rotation;
        of_pelvis += pelvis.transpose() * apart;
        of_thigh += thigh.rotation.transpose() * apart;
    }
    let count = frames.len() as f64;
    let (turn, of_pelvis, of_thigh) = (turn / count, of_pelvis / count, of_thigh / count);
    let singular = DMat3::IDENTITY - turn * turn.transpose();
    Some(singular.inverse() * (of_pelvis - turn * of_thigh))
}

/// The hip as the middle of the spheres on which the thigh's markers move about the pelvis (Gamage
/// and Lasenby, J. Biomech. 35, 2002), in its frame, cm.
fn sphere(hip: &HipMarkers, markers: &Poses) -> DVec3 {
    let (mut left, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for p in &hip.thigh {
        let own = |t: usize| {
            let (pelvis, middle) = hip.frame(markers, t);
            pelvis.transpose() * (at(markers, t, *p) - middle)
        };
        let own: Vec<DVec3> = (0..markers.frames())
            .map(own)
            .filter(|v| v.is_finite())
            .collect();
        let count = own.len() as f64;
        let middle = own.iter().sum::<DVec3>() / count;
        let square = own.iter().map(|v| v.length_squared()).sum::<f64>() / count;
        for v in &own {
            let off = *v - middle;
            left += DMat3::from_cols(off * off.x, off * off.y, off * off.z) / count;
            right += off * (v.length_squared() - square) / (2.0 * count);
        }
    }
    left.inverse() * right
}

fn hips(takes: &[Take], solved: &[SolvedTake]) {
    println!("\nhips, mean of both, cm");
    println!(
        "{:14}{:>8}{:>12}{:>8}{:>8}",
        "", "solve", "Harrington", "SCoRE", "sphere"
    );
    for (take, solved) in takes.iter().zip(solved) {
        let mut off = [Vec::new(), Vec::new(), Vec::new(), Vec::new()];
        for side in ["L", "R"] {
            let name = [
                format!("{side}HJC"),
                format!("{}hipjoint", side.to_lowercase()),
            ];
            let joint = |poses: &Poses| poses.points.iter().position(|p| name.contains(p));
            let truth = joint(&take.truth).expect("a hip");
            let own = joint(&solved.joints).expect("a hip");
            let Some(hip) = HipMarkers::of(&take.markers.points, side) else {
                continue;
            };
            let rules = [
                Some(harrington(&hip, &take.markers, side)),
                score(&hip, &take.markers),
                Some(sphere(&hip, &take.markers)),
            ];
            for t in 0..take.truth.frames() {
                let right = at(&take.truth, t, truth);
                let (pelvis, middle) = hip.frame(&take.markers, t);
                off[0].push(at(&solved.joints, t, own).distance(right));
                for (off, rule) in off[1..].iter_mut().zip(&rules) {
                    off.extend(rule.map(|at| (pelvis * at + middle).distance(right)));
                }
            }
        }
        let [solve, harrington, score, sphere] = off.map(|off| mean(off.into_iter()));
        println!(
            "{:14}{solve:8.2}{harrington:12.2}{score:8.2}{sphere:8.2}",
            take.name
        );
    }
}

/// Markers of a limb or of a side that are hidden for a part of the take.
const HIDDEN: [(&str, [&str; 2], f64); 3] = [
    ("wrist half the take", ["LWRA", "LWRB"], 0.5),
    ("knee, ankle a third", ["LKNE", "LANK"], 1.0 / 3.0),
    ("front hips a third", ["LFWT", "RFWT"], 1.0 / 3.0),
];

fn damaged(take: &Take) {
    let mut chance = parallel::rng(3, 0);
    let (frames, count) = (take.markers.frames(), take.markers.points.len());
    let hide = |poses: &mut Poses, t: usize, p: usize| {
        let place = s![t, 3 * p..3 * p + 3];
        poses.xyz.slice_mut(place).fill(f64::NAN);
    };
    let [mut missing, mut swapped, mut six] = [(); 3].map(|()| take.markers.clone());
    for t in 0..frames {
        (0..count)
            .filter(|_| chance.random_bool(0.3))
            .for_each(|p| hide(&mut missing, t, p));
        let pair = sample(&mut chance, count, 2).into_vec();
        for c in 0..3 {
            swapped.xyz.swap([t, 3 * pair[0] + c], [t, 3 * pair[1] + c]);
        }
    }
    for p in sample(&mut chance, count, 6) {
        (0..frames).for_each(|t| hide(&mut six, t, p));
    }
    let error = |markers: &Poses| error(markers, &take.truth, &settings(take));
    print!(
        "{:14}whole {:.2}, 30% missing {:.2}, a swap a frame {:.2}, six markers never {:.2}",
        take.name,
        error(&take.markers),
        error(&missing),
        error(&swapped),
        error(&six)
    );
    for (what, names, share) in HIDDEN {
        let ends = |p: &String| names.iter().any(|n| p.ends_with(n));
        let own: Vec<usize> = (0..count)
            .filter(|p| ends(&take.markers.points[*p]))
            .collect();
        if own.len() == 2 {
            let mut hidden = take.markers.clone();
            let from = (frames as f64 * (1.0 - share) / 2.0) as usize;
            for t in from..from + (frames as f64 * share) as usize {
                own.iter().for_each(|p| hide(&mut hidden, t, *p));
            }
            print!(", {what} {:.2}", error(&hidden));
        }
    }
    println!();
}

/// Without the markers inside of knee, ankle and elbow; and with a static take that has them.
fn statics(takes: &[Take]) {
    println!("\nmarkers inside of knee, ankle and elbow in no frame, or in a static take; cm");
    for take in takes {
        let mut markers = take.markers.clone();
        for (p, name) in take.markers.points.iter().enumerate() {
            if ["MFC", "MMAL", "MEL"].contains(&&name[1..]) {
                markers
                    .xyz
                    .slice_mut(s![.., 3 * p..3 * p + 3])
                    .fill(f64::NAN);
            }
        }
        let statics = take.markers.slice(0..40);
        let with = SolveSettings {
            statics: Some(&statics),
            ..settings(take)
        };
        println!(
            "{:14}without {:.2}, static {:.2}, all {:.2}",
            take.name,
            error(&markers, &take.truth, &settings(take)),
            error(&markers, &take.truth, &with),
            error(&take.markers, &take.truth, &settings(take))
        );
    }
}

/// A set learned from the others of a laboratory.
fn learned(takes: &[Take]) {
    println!("\na set learned from the two others, cm");
    for take in takes {
        let others = takes.iter().filter(|t| t.name != take.name);
        let others: Vec<_> = others.map(|t| (&t.markers, Some(&t.truth))).collect();
        let set = MarkerSet::learn("others", &others, None).expect("a set");
        let with = SolveSettings {
            set: Some(&set),
            ..settings(take)
        };
        println!(
            "{:14}{:.2}",
            take.name,
            error(&take.markers, &take.truth, &with)
        );
    }
}

/// The person's own skeleton known.
fn given_skeleton(take: &Take) {
    let path = Path::new(DATA).join("cmu/06/06.asf");
    let Ok(input) = Input::open(path) else { return };
    let asf = Asf::read(input, None).expect("a skeleton");
    let with = SolveSettings {
        skeleton: Some(&asf.skeleton),
        ..settings(take)
    };
    let off = error(&take.markers, &take.truth, &with);
    println!("\n{}, the skeleton given: {off:.2}", take.name);
}
