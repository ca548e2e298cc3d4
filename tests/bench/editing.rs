//! How well, how smoothly and how fast a pose is edited by hand: `make bench`, or `cargo bench
//! --bench editing -- PART...` with the parts `points`, `drags`, `jumps`.
//!
//! People of `../shared/data/cmu` in two groups: a model of each group poses the skeletons of the
//! other's people.

mod shared;

use glam::{DMat3, DVec3};
use ndarray::{Array2, Axis};
use posing::edit::in_betweens::in_betweens;
use posing::edit::keys::Key;
use posing::edit::photograph::{Marks, PhotographFit, fit_photograph};
use posing::edit::pose_solver::{Constraints, Pose, PoseSolver};
use posing::edit::{Rig, for_rig, open_model, session::DRAG_SD};
use posing::ik::solver::{IkSettings, IkSolver, Regularization};
use posing::io::{Amc, Asf, Model};
use posing::numeric::parallel;
use posing::pose::similarity::{TransformKind, fit_similarity};
use posing::pose::{Poses, Space, joints};
use posing::prior::{Kind, TrainOptions, TrainingSet, published};
use rand::Rng;
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::time::Instant;

/// Frames a second that a model learns from.
const TRAINING_RATE: usize = 30;
/// Poses of a person that are tested.
const POSES: usize = 40;
/// Steps of each drag, 1 cm each.
const STEPS: usize = 40;
/// The five points of the literature, and six.
const FIVE: [&str; 5] = ["thorax", "lwrist", "rwrist", "lfoot", "rfoot"];
const SIX: [&str; 6] = ["root", "upperneck", "lwrist", "rwrist", "lfoot", "rfoot"];
/// Whether a joint is pinned after its drag, and how far the others may go from where they were,
/// cm.
const DRAGS: [(bool, f64); 5] = [
    (true, 10.0),
    (true, 30.0),
    (true, 100.0),
    (false, 10.0),
    (false, 30.0),
];
/// One of these is among some random points: a joint of each limb, and of the trunk.
const LIMBS: [&[&str]; 5] = [
    &["root", "lowerback", "thorax", "head"],
    &["lhumerus", "lradius", "lwrist"],
    &["rhumerus", "rradius", "rwrist"],
    &["lfemur", "ltibia", "lfoot"],
    &["rfemur", "rtibia", "rfoot"],
];

struct Person {
    asf: Asf,
    takes: Vec<Poses>,
}

fn main() {
    let parts: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with('-'))
        .collect();
    let wants = |part: &str| parts.is_empty() || parts.iter().any(|p| p == part);
    let people = people();
    if people.len() < 2 {
        return println!("no people at ../shared/data/cmu: nothing is edited");
    }
    published::register();
    let kinds: Vec<Kind> = if wants("points") {
        Kind::all()
    } else {
        vec![Kind::Multiscale]
    };
    let groups = [0, 1].map(|g| {
        let of = |other: bool| -> Vec<&Person> {
            let chosen = people
                .iter()
                .enumerate()
                .filter(|(i, _)| (i % 2 == g) != other);
            chosen.map(|(_, p)| p).collect()
        };
        (of(true), of(false))
    });
    let mut points = Vec::new();
    let (mut drags, mut jumps) = (Vec::new(), Jumps::default());
    let (mut betweens, mut photographs) = (Vec::new(), Vec::new());
    let mut lowered = Vec::new();
    for (learned, tested) in &groups {
        for &kind in &kinds {
            let model = train(learned, kind);
            for person in tested {
                let solver = solver(&model, person);
                let poses = some_poses(person, &solver.rig);
                if wants("points") {
                    add_points(
                        &mut points,
                        kind.name(),
                        &solver,
                        &poses,
                        kind == Kind::Multiscale,
                    );
                }
                if kind == Kind::Multiscale && wants("drags") {
                    drags.extend(poses.iter().step_by(10).map(|p| drag_to(&solver, p)));
                }
                if kind == Kind::Multiscale && wants("jumps") {
                    jumps.add(&solver, &poses);
                }
                if kind == Kind::Multiscale && wants("betweens") {
                    add_betweens(&mut betweens, &solver, person);
                }
                if kind == Kind::Multiscale && wants("lowered") {
                    add_lowered(&mut lowered, &solver, person);
                }
                if kind == Kind::Multiscale && wants("photographs") {
                    add_photographs(&mut photographs, &solver, &poses);
                }
            }
        }
    }
    report_points(&points);
    report_drags(&drags);
    jumps.report();
    report_betweens(&betweens);
    report_photographs(&photographs);
    report_lowered(&lowered);
}

fn people() -> Vec<Person> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/cmu");
    let entries = std::fs::read_dir(root).into_iter().flatten().flatten();
    let mut folders: Vec<_> = entries.map(|e| e.path()).filter(|p| p.is_dir()).collect();
    folders.sort();
    let person = |folder: &std::path::PathBuf| {
        let asf = Asf::open(shared::files(folder, "asf").first()?).expect("an ASF file");
        let takes = shared::files(folder, "amc");
        let takes = takes.iter().map(|amc| {
            let amc = Amc::open(amc, &asf).expect("an AMC file");
            amc.to_poses(120.0).expect("a take")
        });
        Some(Person {
            takes: takes.collect(),
            asf,
        })
    };
    folders.iter().filter_map(person).collect()
}

fn train(people: &[&Person], kind: Kind) -> Model {
    let names = joints::cmu_names();
    let (mut rows, mut time, mut take) = (Vec::new(), Vec::new(), Vec::new());
    for (i, poses) in people.iter().flat_map(|p| &p.takes).enumerate() {
        let of_model = columns(poses, &names);
        for t in (0..poses.frames()).step_by(120 / TRAINING_RATE) {
            rows.push(of_model.row(t).to_owned());
            time.push(t as f64 / 120.0);
            take.push(i.to_string().into());
        }
    }
    let views: Vec<_> = rows.iter().map(|r| r.view()).collect();
    let poses = Poses {
        points: names,
        xyz: ndarray::stack(Axis(0), &views).expect("rows of one length"),
        time: Some(time),
        take: Some(take),
    };
    let set = TrainingSet::from_poses(&poses, Space::World, "the bench").expect("poses");
    kind.train(&set, &TrainOptions::default()).expect("a model")
}

/// The columns of these points.
fn columns(poses: &Poses, names: &[String]) -> Array2<f64> {
    let at = |n: &String| poses.points.iter().position(|p| p == n).expect("a point");
    let columns: Vec<usize> = names
        .iter()
        .flat_map(|n| (0..3).map(move |c| 3 * at(n) + c))
        .collect();
    poses.xyz.select(Axis(1), &columns)
}

fn solver(model: &Model, person: &Person) -> PoseSolver {
    let skeleton = &person.asf.skeleton;
    let joints: Vec<_> = joints::CMU
        .iter()
        .map(|n| (n.to_string(), skeleton.find(n).expect("a bone")))
        .collect();
    let rig = Rig::with_joints(
        skeleton.clone(),
        &joints,
        &model.meta.points,
        &Default::default(),
    );
    let rig = rig.expect("a rig");
    let model = open_model(model, "the bench").expect("a model");
    let model = for_rig(model, &rig);
    PoseSolver { rig, model }
}

/// Evenly spread poses of a person's takes: (3 K) each.
fn some_poses(person: &Person, rig: &Rig) -> Vec<Vec<f64>> {
    let frames: usize = person.takes.iter().map(Poses::frames).sum();
    let step = frames.div_ceil(POSES).max(1);
    let all = person.takes.iter().flat_map(|take| {
        let xyz = columns(take, &rig.names);
        (0..xyz.nrows())
            .map(move |t| xyz.row(t).to_vec())
            .collect::<Vec<_>>()
    });
    all.step_by(step).collect()
}

fn place(xyz: &[f64], k: usize) -> DVec3 {
    DVec3::from_slice(&xyz[3 * k..])
}

fn start(solver: &PoseSolver) -> Pose {
    let rest = vec![0.0; solver.rig.skeleton.dof_count()];
    let typical = solver.model.prior.representative_poses();
    solver.placed(
        &typical.row(0).to_vec(),
        posing::pose::Similarity::IDENTITY,
        &rest,
    )
}

// ---- points ----

struct PointsRow {
    method: String,
    set: &'static str,
    squared: f64,
    turned: f64,
    missed: f64,
}

fn add_points(
    rows: &mut Vec<PointsRow>,
    method: &str,
    solver: &PoseSolver,
    poses: &[Vec<f64>],
    with_ik: bool,
) {
    let before = start(solver);
    let mut random = parallel::rng(1, 7);
    for truth in poses {
        let Some(whole) = solver.pose_at(truth, &before) else {
            continue;
        };
        for set in ["5 points", "6 points", "6-12 random"] {
            let shown = shown(set, &solver.rig, &mut random);
            let mut asked = Constraints::none(solver.rig.joints());
            asked.forgotten.fill(true);
            for &k in &shown {
                asked.pins[k] = place(truth, k).to_array().map(Some);
            }
            let mut add = |method: &str, pose: Option<Pose>| {
                let pose = pose.unwrap_or_else(|| before.clone());
                rows.push(PointsRow {
                    method: method.to_string(),
                    set,
                    squared: mean_square(&pose.xyz, truth),
                    turned: turned(solver, &pose, &whole),
                    missed: shown
                        .iter()
                        .map(|&k| (place(&pose.xyz, k) - place(truth, k)).length())
                        .fold(0.0, f64::max),
                });
            };
            add(method, solver.restart(&asked, truth, &before));
            if with_ik {
                add(
                    "IK from the mean",
                    Some(ik_alone(solver, truth, &shown, &before)),
                );
            }
        }
    }
}

fn shown(set: &str, rig: &Rig, random: &mut ChaCha8Rng) -> Vec<usize> {
    let find = |n: &&str| rig.find(n).expect("a joint");
    match set {
        "5 points" => FIVE.iter().map(find).collect(),
        "6 points" => SIX.iter().map(find).collect(),
        _ => {
            let mut some: Vec<usize> = LIMBS
                .iter()
                .map(|limb| find(&limb[random.random_range(0..limb.len())]))
                .collect();
            let wanted = random.random_range(6..=12);
            let others: Vec<usize> = (0..rig.joints()).filter(|k| !some.contains(k)).collect();
            some.extend(
                sample(random, others.len(), wanted - some.len())
                    .iter()
                    .map(|i| others[i]),
            );
            some
        }
    }
}

/// The mean of the squares of all coordinates, cm².
fn mean_square(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64
}

/// The mean angle between the rotations of the bones relative to their parents, degrees.
fn turned(solver: &PoseSolver, a: &Pose, b: &Pose) -> f64 {
    let skeleton = &solver.rig.skeleton;
    let local = |q: &[f64]| -> Vec<DMat3> {
        let posture = skeleton.posture(q);
        let bones = skeleton.bones().iter().enumerate();
        bones
            .map(|(i, b)| {
                b.parent
                    .map_or(DMat3::IDENTITY, |p| posture.rotations[p])
                    .transpose()
                    * posture.rotations[i]
            })
            .collect()
    };
    let (a, b) = (local(&a.q), local(&b.q));
    let turning: Vec<usize> = (0..a.len())
        .filter(|&i| !skeleton.dofs_of(i).is_empty() && solver.rig.bones.contains(&i))
        .collect();
    let sum: f64 = turning
        .iter()
        .map(|&i| posing::pose::rotation::angle_between(&a[i], &b[i]))
        .sum();
    (sum / turning.len() as f64).to_degrees()
}

/// The start pose laid on the points, then inverse kinematics for these alone.
fn ik_alone(solver: &PoseSolver, truth: &[f64], shown: &[usize], start: &Pose) -> Pose {
    let pairs = shown
        .iter()
        .map(|&k| (place(&start.xyz, k), place(truth, k), 1.0));
    let placed = fit_similarity(pairs, TransformKind::Rigid)
        .expect("points")
        .similarity;
    let model = solver.rig.to_model(&start.xyz, solver.model.points.len());
    let mut pose = solver.placed(&model, placed, &start.q);
    let mut targets = vec![f64::NAN; truth.len()];
    shown
        .iter()
        .for_each(|&k| targets[3 * k..3 * k + 3].copy_from_slice(&truth[3 * k..3 * k + 3]));
    let settings = IkSettings {
        iterations: 200,
        ..IkSettings::default()
    };
    let before = pose.q.clone();
    let regularization = Regularization {
        previous: &before,
        previous_weight: 1e-2,
        rest: &before,
        rest_weight: 0.0,
    };
    let mut ik = IkSolver::new(&solver.rig.skeleton, &solver.rig.bones, settings);
    ik.solve(
        &targets,
        &vec![false; before.len()],
        &regularization,
        &mut pose.q,
    );
    pose.xyz = solver.rig.positions(&pose.q);
    pose
}

fn report_points(rows: &[PointsRow]) {
    if rows.is_empty() {
        return;
    }
    println!(
        "poses of people that the model has not seen, from some joints   RMS, cm   median pose   rotations, degrees   pins, cm"
    );
    for set in ["5 points", "6 points", "6-12 random"] {
        let mut methods: Vec<&str> = rows.iter().map(|r| r.method.as_str()).collect();
        methods.dedup();
        methods.sort();
        methods.dedup();
        for method in methods {
            let of: Vec<&PointsRow> = rows
                .iter()
                .filter(|r| r.set == set && r.method == method)
                .collect();
            let n = of.len() as f64;
            let mut each: Vec<f64> = of.iter().map(|r| r.squared.sqrt()).collect();
            println!(
                "{set:<14} {method:<20} {n:>6} {:>22.2} {:>13.2} {:>20.1} {:>10.4}",
                (of.iter().map(|r| r.squared).sum::<f64>() / n).sqrt(),
                quantile(&mut each, 0.5),
                of.iter().map(|r| r.turned).sum::<f64>() / n,
                of.iter().map(|r| r.missed).fold(0.0, f64::max),
            );
        }
    }
}

// ---- drags ----

/// RMS (cm) of a coordinate after 0 to 10 drags, each of the joint that is farthest off to its
/// place: kept as a pin, or let go.
fn drag_to(solver: &PoseSolver, truth: &[f64]) -> Vec<[f64; 11]> {
    let drag = |&(pinned, rest): &(bool, f64)| {
        let n = solver.rig.joints();
        let mut pose = at_root_of(solver, truth);
        let mut asked = Constraints {
            rest,
            ..Constraints::none(n)
        };
        let mut errors = [0.0; 11];
        errors[0] = mean_square(&pose.xyz, truth);
        for k in 1..11 {
            let far = |k: &usize| (place(&pose.xyz, *k) - place(truth, *k)).length();
            let free = (0..n).filter(|&k| asked.pins[k][0].is_none());
            let worst = free
                .max_by(|a, b| far(a).total_cmp(&far(b)))
                .expect("a joint");
            let (from, to) = (place(&pose.xyz, worst), place(truth, worst));
            let way = (to - from).length();
            let steps = (way / 2.0).ceil().max(1.0) as usize;
            let reference = {
                asked.drags[worst] = Some((from, DRAG_SD));
                solver.reference(&asked, &pose)
            };
            for i in 1..=steps {
                asked.drags[worst] = Some((from.lerp(to, i as f64 / steps as f64), DRAG_SD));
                pose = solver.follow(&asked, &reference, &pose, way / steps as f64);
            }
            for _ in 0..30 {
                if pose.is_moving {
                    pose = solver.follow(&asked, &reference, &pose, 0.0);
                }
            }
            asked.drags[worst] = None;
            if pinned {
                asked.pins[worst] = place(&pose.xyz, worst).to_array().map(Some);
            }
            errors[k] = mean_square(&pose.xyz, truth);
        }
        errors
    };
    DRAGS.iter().map(drag).collect()
}

/// The start pose, its root and heading those of `truth`.
fn at_root_of(solver: &PoseSolver, truth: &[f64]) -> Pose {
    let pose = start(solver);
    let hips = ["root", "lhipjoint", "rhipjoint", "lowerback"]
        .map(|n| solver.rig.find(n).expect("a joint"));
    let pairs = hips
        .iter()
        .map(|&k| (place(&pose.xyz, k), place(truth, k), 1.0));
    let placed = fit_similarity(pairs, TransformKind::Rigid)
        .expect("points")
        .similarity;
    let model = solver.rig.to_model(&pose.xyz, solver.model.points.len());
    solver.placed(&model, placed, &pose.q)
}

fn report_drags(drags: &[Vec<[f64; 11]>]) {
    if drags.is_empty() {
        return;
    }
    println!(
        "the worst joint dragged to its place, {} poses: RMS of a coordinate, cm",
        drags.len()
    );
    println!(
        "{:<26} {}",
        "drags",
        (0..11).map(|k| format!("{k:>6}")).collect::<String>()
    );
    for (i, (pinned, rest)) in DRAGS.iter().enumerate() {
        let what = if *pinned { "pinned" } else { "let go" };
        let what = format!("each is {what}, rest {rest} cm");
        let rms =
            |k: usize| (drags.iter().map(|d| d[i][k]).sum::<f64>() / drags.len() as f64).sqrt();
        println!(
            "{what:<26} {}",
            (0..11)
                .map(|k| format!("{:>6.2}", rms(k)))
                .collect::<String>()
        );
    }
}

// ---- jumps ----

#[derive(Default)]
struct Jumps {
    ratios: Vec<f64>,
    ms: Vec<f64>,
    off: Vec<f64>,
    pins: Vec<f64>,
}

impl Jumps {
    /// Straight drags of random joints in steps of 1 cm, with both feet pinned every other time.
    fn add(&mut self, solver: &PoseSolver, poses: &[Vec<f64>]) {
        let mut random = parallel::rng(2, self.ms.len() as u64);
        let before = start(solver);
        for (i, truth) in poses.iter().enumerate() {
            let Some(mut pose) = solver.pose_at(truth, &before) else {
                continue;
            };
            let k = random.random_range(0..solver.rig.joints());
            let toward = DVec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
            let toward = toward.try_normalize().unwrap_or(DVec3::X);
            let from = place(&pose.xyz, k);
            let mut asked = Constraints::none(solver.rig.joints());
            if i % 2 == 0 {
                for foot in ["lfoot", "rfoot"].map(|n| solver.rig.find(n).expect("a joint")) {
                    if foot != k {
                        asked.pins[foot] = place(&pose.xyz, foot).to_array().map(Some);
                    }
                }
            }
            asked.drags[k] = Some((from, DRAG_SD));
            let reference = solver.reference(&asked, &pose);
            for step in 1..=STEPS {
                let to = from + toward * step as f64;
                asked.drags[k] = Some((to, DRAG_SD));
                let began = Instant::now();
                let next = solver.follow(&asked, &reference, &pose, 1.0);
                self.ms.push(began.elapsed().as_secs_f64() * 1e3);
                let joints = 0..solver.rig.joints();
                let far = joints
                    .clone()
                    .map(|k| (place(&next.xyz, k) - place(&pose.xyz, k)).length());
                self.ratios.push(far.fold(0.0, f64::max));
                self.off.push((place(&next.xyz, k) - to).length());
                let pinned = joints.filter(|&k| asked.pins[k][0].is_some());
                let missed = pinned.map(|k| next.missed[k]);
                self.pins.push(missed.fold(0.0, f64::max));
                pose = next;
            }
        }
    }

    fn report(mut self) {
        if self.ms.is_empty() {
            return;
        }
        println!(
            "straight drags in steps of 1 cm, {:>22} {:>8} {:>8} {:>8} {:>8}",
            "steps", "median", "99%", "99.9%", "most"
        );
        let n = self.ms.len();
        for (what, values) in [
            ("largest step of a joint, cm", &mut self.ratios),
            ("dragged joint off its target, cm", &mut self.off),
            ("pins off, cm", &mut self.pins),
            ("time, ms", &mut self.ms),
        ] {
            let at = [0.5, 0.99, 0.999, 1.0].map(|share| quantile(values, share));
            println!(
                "{what:<36} {n:>17} {:>8.2} {:>8.2} {:>8.2} {:>8.2}",
                at[0], at[1], at[2], at[3]
            );
        }
        let over = self.ratios.iter().filter(|r| **r > 4.0).count();
        println!("steps over 4 cm: {over} of {n}");
    }
}

// ---- in-betweens ----

/// Seconds between keys, the squared errors of a coordinate, ours and with straight ways of the
/// joints, and ours over the standard deviation.
type Betweens = (f64, [f64; 3]);

fn add_betweens(rows: &mut Vec<Betweens>, solver: &PoseSolver, person: &Person) {
    let before = start(solver);
    for take in &person.takes {
        let xyz = columns(take, &solver.rig.names);
        for apart in [0.2, 0.5, 1.0] {
            let step = (apart * 120.0) as usize;
            let mut keys = Vec::new();
            let mut pose = before.clone();
            for (i, t) in (0..xyz.nrows()).step_by(step).take(9).enumerate() {
                let Some(next) = solver.pose_at(&xyz.row(t).to_vec(), &pose) else {
                    return;
                };
                pose = next;
                let pins = vec![[None; 3]; solver.rig.joints()];
                keys.push(Key {
                    time: i as f64 * apart,
                    pose: pose.clone(),
                    pins,
                });
            }
            if keys.len() < 2 {
                continue;
            }
            let with = in_betweens(solver, &keys, 30.0, false).expect("a motion");
            for t in 0..with.xyz.nrows() {
                let share = t as f64 / 30.0 / apart;
                let (i, share) = (share.floor() as usize, share.fract());
                if share < 1e-6 || i + 1 >= keys.len() {
                    continue;
                }
                let truth = xyz.row(4 * t).to_vec();
                let straight: Vec<f64> = keys[i]
                    .pose
                    .xyz
                    .iter()
                    .zip(&keys[i + 1].pose.xyz)
                    .map(|(a, b)| a + share * (b - a))
                    .collect();
                let ours = with.xyz.row(t).to_vec();
                let known = (0..solver.rig.joints()).map(|k| {
                    ((place(&ours, k) - place(&truth, k)) / with.sd[[t, k]].max(0.1))
                        .length_squared()
                        / 3.0
                });
                let known = known.sum::<f64>() / solver.rig.joints() as f64;
                rows.push((
                    apart,
                    [
                        mean_square(&ours, &truth),
                        mean_square(&straight, &truth),
                        known,
                    ],
                ));
            }
        }
    }
}

fn report_betweens(rows: &[Betweens]) {
    if rows.is_empty() {
        return;
    }
    println!(
        "between keys of takes of people not seen, RMS of a coordinate, cm {:>10} {:>8} {:>8} {:>8}",
        "frames", "ours", "straight", "over sd"
    );
    for apart in [0.2, 0.5, 1.0] {
        let of: Vec<&Betweens> = rows.iter().filter(|r| r.0 == apart).collect();
        let rms = |i: usize| (of.iter().map(|r| r.1[i]).sum::<f64>() / of.len() as f64).sqrt();
        println!(
            "keys {apart:>4} s apart {:>57} {:>8.3} {:>8.3} {:>8.3}",
            of.len(),
            rms(0),
            rms(1),
            rms(2)
        );
    }
}

// ---- the pelvis lowered ----

/// The pelvis goes down this far at least, cm, over feet that move no farther than this.
const LOWERED: f64 = 12.0;
const FEET_STAND: f64 = 4.0;

/// The squared errors of a coordinate: of the pose before, and of what dragging the pelvis to its
/// place made of it.
fn add_lowered(rows: &mut Vec<(f64, Vec<f64>)>, solver: &PoseSolver, person: &Person) {
    let find = |n: &str| solver.rig.find(n).expect("a joint");
    let (root, feet) = (find("root"), ["lfoot", "rfoot"].map(find));
    for take in &person.takes {
        let xyz = columns(take, &solver.rig.names);
        let frames: Vec<Vec<f64>> = xyz
            .rows()
            .into_iter()
            .step_by(24)
            .map(|r| r.to_vec())
            .collect();
        let mut from = 0;
        for to in 1..frames.len() {
            let stands = |a: usize| {
                feet.iter()
                    .all(|&k| (place(&frames[a], k) - place(&frames[to], k)).length() < FEET_STAND)
            };
            while from < to && !stands(from) {
                from += 1;
            }
            let way = place(&frames[to], root) - place(&frames[from], root);
            if from == to || way.y > -LOWERED {
                continue;
            }
            let before = start(solver);
            let Some(mut pose) = solver.pose_at(&frames[from], &before) else {
                continue;
            };
            let mut asked = Constraints {
                floor: Some(posing::edit::pose_solver::floor_under(&pose.xyz)),
                ..Constraints::none(solver.rig.joints())
            };
            for &k in &feet {
                asked.pins[k] = place(&pose.xyz, k).to_array().map(Some);
            }
            asked.drags[root] = Some((place(&pose.xyz, root), DRAG_SD));
            let reference = solver.reference(&asked, &pose);
            let (start, steps) = (place(&pose.xyz, root), way.length().ceil() as usize);
            let still = mean_square(&pose.xyz, &frames[to]);
            for i in 1..=steps {
                let at = start + way * (i as f64 / steps as f64);
                asked.drags[root] = Some((at, DRAG_SD));
                pose = solver.follow(&asked, &reference, &pose, way.length() / steps as f64);
            }
            for _ in 0..30 {
                if pose.is_moving {
                    pose = solver.follow(&asked, &reference, &pose, 0.0);
                }
            }
            let each = (0..solver.rig.joints())
                .map(|k| (place(&pose.xyz, k) - place(&frames[to], k)).length());
            rows.push((still, each.collect()));
            from = to;
        }
    }
}

fn report_lowered(rows: &[(f64, Vec<f64>)]) {
    if rows.is_empty() {
        return;
    }
    let n = rows.len() as f64;
    let joints = rows[0].1.len();
    let square = |r: &Vec<f64>| r.iter().map(|d| d * d).sum::<f64>() / (3 * joints) as f64;
    let mut each: Vec<f64> = rows.iter().map(|r| square(&r.1).sqrt()).collect();
    println!(
        "the pelvis lowered over standing feet, {n} times: RMS of a coordinate, cm: before {:.2}, after {:.2}, median of a pose {:.2}",
        (rows.iter().map(|r| r.0).sum::<f64>() / n).sqrt(),
        (rows.iter().map(|r| square(&r.1)).sum::<f64>() / n).sqrt(),
        quantile(&mut each, 0.5)
    );
    for k in 0..joints {
        print!(
            "{} {:.1}  ",
            joints::CMU[k],
            (rows.iter().map(|r| r.1[k].powi(2)).sum::<f64>() / n).sqrt()
        );
    }
    println!();
}

// ---- photographs ----

/// Marks; the squared errors of a coordinate: weak perspective, with the focal length, the typical
/// pose; milliseconds of a first fit and of one after another.
type Photograph = (usize, [f64; 3], [f64; 2]);

fn add_photographs(rows: &mut Vec<Photograph>, solver: &PoseSolver, poses: &[Vec<f64>]) {
    let before = start(solver);
    let mut random = parallel::rng(3, 1);
    for truth in poses.iter().step_by(20) {
        let turn = DMat3::from_rotation_x(random.random_range(-0.2..0.3))
            * DMat3::from_rotation_y(random.random_range(-3.1..3.1));
        let root = place(truth, 0);
        let joints = 0..solver.rig.joints();
        let seen: Vec<DVec3> = joints.map(|k| turn * (place(truth, k) - root)).collect();
        let error = |xyz: &[f64]| {
            let off = |k: usize| (place(xyz, k) - place(xyz, 0) - seen[k]).length_squared();
            (0..seen.len()).map(off).sum::<f64>() / (3 * seen.len()) as f64
        };
        // 50 mm on a picture 36 mm and 1,500 pixels high, 450 cm away; marks are 4 pixels off, at
        // most.
        let (focal, distance) = (50.0 / 36.0 * 1500.0, 450.0);
        let order = sample(&mut random, seen.len(), seen.len()).into_vec();
        let mut previous: Option<PhotographFit> = None;
        for count in [8, 12, 16] {
            let at = order[..count].iter().map(|&k| {
                let noise = [(); 2].map(|()| random.random_range(-4.0..4.0));
                let at = seen[k].truncate() * focal / (distance - seen[k].z);
                (k, at + glam::DVec2::from_array(noise))
            });
            let weak = Marks {
                at: at.collect(),
                ..Marks::default()
            };
            let marks = Marks {
                focal: Some(focal),
                ..weak.clone()
            };
            let began = Instant::now();
            let first = fit_photograph(solver, &weak, &before, None);
            let of_first = began.elapsed().as_secs_f64() * 1e3;
            let began = Instant::now();
            let with_focal = fit_photograph(solver, &marks, &before, previous.as_ref());
            let of_next = began.elapsed().as_secs_f64() * 1e3;
            let (Ok(first), Ok(with_focal)) = (first, with_focal) else {
                continue;
            };
            let errors = [&first.pose.xyz, &with_focal.pose.xyz, &before.xyz].map(|xyz| error(xyz));
            rows.push((count, errors, [of_first, of_next]));
            previous = Some(with_focal);
        }
    }
}

fn report_photographs(rows: &[Photograph]) {
    if rows.is_empty() {
        return;
    }
    println!(
        "photographs of people not seen, RMS of a coordinate from the root, cm: fits, weak perspective, focal length, median of a pose, typical pose; ms of a first fit, of the next"
    );
    for count in [8, 12, 16] {
        let of: Vec<&Photograph> = rows.iter().filter(|r| r.0 == count).collect();
        let rms = |i: usize| (of.iter().map(|r| r.1[i]).sum::<f64>() / of.len() as f64).sqrt();
        let mut each: Vec<f64> = of.iter().map(|r| r.1[1].sqrt()).collect();
        let ms = [0, 1].map(|i| quantile(&mut of.iter().map(|r| r.2[i]).collect::<Vec<_>>(), 0.5));
        println!(
            "{count:>2} marks {:>6} {:>8.2} {:>8.2} {:>8.2} {:>8.2} {:>8.0} {:>8.0}",
            of.len(),
            rms(0),
            rms(1),
            quantile(&mut each, 0.5),
            rms(2),
            ms[0],
            ms[1]
        );
    }
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((share * values.len() as f64) as usize).min(values.len() - 1)]
}
