//! How well and how fast bodies are learned, posed and completed, on the shared meshes: `make
//! bench`.

use glam::{DMat3, DVec3};
use posing::body::completion::complete;
use posing::body::decomposition::{fit_rotations, synthesize};
use posing::body::fit::FitProblem;
use posing::body::marker_model::{Marker, MarkerModel};
use posing::body::scan_fit::fit_scan;
use posing::body::surface::Surface;
use posing::body::train::{Settings, train};
use posing::body::{BodyModel, Decomposer, Template};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use std::collections::HashMap;
use std::time::Instant;

#[path = "../it/common/bodies.rs"]
mod bodies;
use bodies::{Bodies, errors, mean};

fn main() {
    let path = std::path::Path::new("../shared/data/bodies/makehuman-40-people-40-poses.npz");
    if !path.exists() {
        return println!("no bodies at ../shared/data/bodies: nothing is measured");
    }
    let smooth = bodies::read(path);
    for split in 0..3 {
        println!("smooth bodies, split {split}");
        Split::new(&smooth, split).report(true);
        println!("rough bodies, split {split}");
        Split::new(&rough(&smooth, split), split).report(false);
    }
}

/// The bodies made as hard as registered scans: to each is added a field of its own, smooth on the
/// skin, of three wavelengths with a deviation of 3 mm a coordinate each.
fn rough(smooth: &Bodies, seed: u64) -> Bodies {
    const WAVES: usize = 96;
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1000 + seed);
    let rest = &smooth.poses[0];
    let mut roughened = |mesh: &Vec<DVec3>| -> Vec<DVec3> {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let mut vector = || DVec3::new(normal(), normal(), normal());
        let mut waves = Vec::new();
        for length in [4.0, 8.0, 16.0] {
            for _ in 0..WAVES {
                let strength = 0.3 * (2.0 / WAVES as f64).sqrt();
                waves.push((vector() / length, vector().x * 20.0, vector() * strength));
            }
        }
        (mesh.iter().zip(rest))
            .map(|(v, at)| {
                let field = waves
                    .iter()
                    .map(|(w, phase, a)| *a * (w.dot(*at) + phase).cos());
                *v + field.sum::<DVec3>()
            })
            .collect()
    };
    Bodies {
        poses: smooth.poses.iter().map(&mut roughened).collect(),
        people: smooth.people.iter().map(&mut roughened).collect(),
        ..smooth.clone()
    }
}

struct Split<'a> {
    bodies: &'a Bodies,
    model: BodyModel,
    paper: BodyModel,
    poses: Vec<usize>,
    people: Vec<usize>,
    rng: rand_chacha::ChaCha8Rng,
    area: Vec<f64>,
}

fn ms(start: Instant) -> f64 {
    1e3 * start.elapsed().as_secs_f64()
}

impl<'a> Split<'a> {
    fn new(bodies: &'a Bodies, seed: u64) -> Split<'a> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut poses: Vec<usize> = (1..bodies.poses.len()).collect();
        let mut people: Vec<usize> = (0..bodies.people.len()).collect();
        poses.shuffle(&mut rng);
        people.shuffle(&mut rng);
        let training = |all: &[Vec<DVec3>], test: &[usize]| -> Vec<Vec<DVec3>> {
            (0..all.len())
                .filter(|k| !test.contains(k))
                .map(|k| all[k].clone())
                .collect()
        };
        let (poses, people) = (poses[..10].to_vec(), people[..10].to_vec());
        let (p, q) = (
            training(&bodies.poses, &poses),
            training(&bodies.people, &people),
        );
        let template = || {
            Template::new(
                bodies.poses[0].clone(),
                bodies.faces.clone(),
                bodies.parts.clone(),
            )
            .unwrap()
        };
        let start = Instant::now();
        let model = train(template(), &p, &q, &Settings::default(), &mut || ()).unwrap();
        println!("training {:.0} ms", ms(start));
        let paper = train(template(), &p, &q, &Settings::paper(), &mut || ()).unwrap();
        let mut area = vec![0.0; bodies.parts.len()];
        for f in &bodies.faces {
            let [a, b, c] = f.map(|v| bodies.poses[0][v]);
            f.iter()
                .for_each(|v| area[*v] += (b - a).cross(c - a).length());
        }
        Split {
            bodies,
            model,
            paper,
            poses,
            people,
            rng,
            area,
        }
    }

    fn means(&self, e: &[Vec<f64>]) -> String {
        let plain: Vec<f64> = e.iter().map(|e| mean(e)).collect();
        let total: f64 = self.area.iter().sum();
        let by_area: Vec<f64> = (e.iter())
            .map(|e| e.iter().zip(&self.area).map(|(e, a)| e * a).sum::<f64>() / total)
            .collect();
        format!(
            "{:.3} ({:.3}), worst {:.2}",
            mean(&plain),
            mean(&by_area),
            plain.iter().copied().fold(0.0, f64::max)
        )
    }

    fn report(&mut self, with_scans: bool) {
        let template = &self.model.template;
        let decomposer = Decomposer::new(template, 0.007).unwrap();
        let pose = |k: &usize| self.bodies.poses[*k].as_slice();
        let person = |k: &usize| self.bodies.people[*k].as_slice();
        let start = Instant::now();
        let rotations: Vec<Vec<DMat3>> =
            (self.poses.iter().map(|k| fit_rotations(template, pose(k)))).collect();
        let exact: Vec<Vec<f64>> = (self.poses.iter().zip(&rotations))
            .map(|(k, r)| {
                let q = decomposer.deformations(pose(k), r);
                errors(&synthesize(template, r, &q), pose(k))
            })
            .collect();
        println!(
            "decomposition {} mm, {:.1} ms",
            self.means(&exact),
            ms(start) / 10.0
        );
        for (name, model) in [("pose model", &self.model), ("paper", &self.paper)] {
            let start = Instant::now();
            let e: Vec<Vec<f64>> = (self.poses.iter().zip(&rotations))
                .map(|(k, r)| {
                    errors(
                        &synthesize(template, r, &model.pose.deformations(template, r)),
                        pose(k),
                    )
                })
                .collect();
            println!("{name} {} mm, {:.1} ms", self.means(&e), ms(start) / 20.0);
        }
        for (name, model) in [("shape", &self.model), ("paper's shape", &self.paper)] {
            for count in [5, 10, 20] {
                let e: Vec<Vec<f64>> = (self.people.iter())
                    .map(|k| {
                        let r = fit_rotations(template, person(k));
                        let beta = model.shape_of(person(k), &r, count);
                        errors(&model.synthesize(&r, &beta), person(k))
                    })
                    .collect();
                println!("{name}, {count} components {} mm", self.means(&e));
            }
        }
        self.markers();
        if with_scans {
            self.scans();
        }
    }

    fn markers(&mut self) {
        for count in [60, 200] {
            let on = self.chosen(count);
            let start = Instant::now();
            let markers: Vec<Marker> = on.iter().map(|v| Marker::on(*v)).collect();
            let reduced = MarkerModel::new(&self.model, &markers);
            println!("{count} markers: reduced in {:.0} ms", ms(start));
            for noise in [0.0, 0.2, 0.5] {
                let rng = &mut self.rng;
                let mut noisy = |mesh: &[DVec3]| -> Vec<Option<DVec3>> {
                    let mut draw = || noise * rng.sample::<f64, _>(StandardNormal);
                    (on.iter()
                        .map(|v| Some(mesh[*v] + DVec3::new(draw(), draw(), draw()))))
                    .collect()
                };
                let poses: Vec<_> = (self.poses.iter())
                    .map(|k| (noisy(&self.bodies.poses[*k]), &self.bodies.poses[*k]))
                    .collect();
                let people: Vec<_> = (self.people.iter())
                    .map(|k| (noisy(&self.bodies.people[*k]), &self.bodies.people[*k]))
                    .collect();
                let prior = self.model.fit_prior();
                for (name, set) in [("poses", &poses), ("people", &people)] {
                    let (mut completed, mut predicted) = (Vec::new(), Vec::new());
                    let start = Instant::now();
                    let mut steps = 0;
                    for (markers, truth) in set {
                        let problem = FitProblem::new(&reduced, &prior, markers).unwrap();
                        let fit = problem.solve(None);
                        steps += fit.energies.len() - 1;
                        let shape = self.model.shape.matrices(&fit.state.shape);
                        let found = complete(&self.model, &fit, &shape, None);
                        predicted.push(errors(&found.predicted, truth));
                        completed.push(errors(&found.completed, truth));
                    }
                    println!(
                        "{count} markers, {:.0} mm, {name}: completed {}, predicted {}, {:.1} ms, {:.1} steps",
                        10.0 * noise,
                        self.means(&completed),
                        self.means(&predicted),
                        ms(start) / set.len() as f64,
                        steps as f64 / set.len() as f64
                    );
                }
            }
        }
    }

    /// Scans from the front, points drawn on the triangles, 2 mm of noise, holes of 6 cm; eight
    /// points placed to half a centimeter.
    fn scans(&mut self) {
        for (name, of_poses) in [("poses", true), ("people", false)] {
            let test = if of_poses { &self.poses } else { &self.people }.clone();
            let all = if of_poses {
                &self.bodies.poses
            } else {
                &self.bodies.people
            };
            let (mut completed, mut predicted, mut seen) = (Vec::new(), Vec::new(), Vec::new());
            let start = Instant::now();
            for k in &test {
                let truth = &all[*k];
                let (scan, is_seen) = front(truth, &self.bodies.faces, &mut self.rng);
                let placed = placed(truth, &self.bodies.parts, &is_seen, &mut self.rng);
                let fit = fit_scan(&self.model, &scan, &placed).unwrap();
                let far = |mesh: &[DVec3], wanted: bool| {
                    let e: Vec<f64> = (0..truth.len())
                        .filter(|v| is_seen[*v] == wanted)
                        .map(|v| 10.0 * (mesh[v] - truth[v]).length())
                        .collect();
                    mean(&e)
                };
                completed.push(far(&fit.completed, false));
                predicted.push(far(&fit.predicted, false));
                seen.push(far(&fit.completed, true));
            }
            let worst = |e: &[f64]| e.iter().copied().fold(0.0, f64::max);
            println!(
                "scan, {name}: unseen completed {:.2} (worst {:.2}), predicted {:.2} ({:.2}); seen {:.2}; {:.0} ms",
                mean(&completed),
                worst(&completed),
                mean(&predicted),
                worst(&predicted),
                mean(&seen),
                ms(start) / test.len() as f64
            );
        }
    }

    /// Three vertices a part, and others anywhere.
    fn chosen(&mut self, count: usize) -> Vec<usize> {
        let mut on = Vec::new();
        for part in 0..self.model.template.parts() {
            let mut own: Vec<usize> = (0..self.bodies.parts.len())
                .filter(|v| self.bodies.parts[*v] == part)
                .collect();
            own.shuffle(&mut self.rng);
            on.extend(&own[..3]);
        }
        while on.len() < count {
            let v = self.rng.random_range(0..self.bodies.parts.len());
            if !on.contains(&v) {
                on.push(v);
            }
        }
        on
    }
}

/// Where the nearest triangle is along z, by place in x and y: what is more than half a
/// centimeter behind it is hidden.
struct DepthBuffer {
    nearest: HashMap<[i64; 2], f64>,
}

impl DepthBuffer {
    /// The width of a cell, cm.
    const CELL: f64 = 0.25;

    fn new(mesh: &[DVec3], faces: &[[usize; 3]]) -> DepthBuffer {
        let mut nearest = HashMap::new();
        for face in faces {
            let [a, b, c] = face.map(|v| mesh[v]);
            let longest = (b - a).length().max((c - b).length()).max((a - c).length());
            let steps = (2.0 * longest / Self::CELL).ceil().max(1.0) as usize;
            for i in 0..=steps {
                for j in 0..=steps - i {
                    let (s, t) = (i as f64 / steps as f64, j as f64 / steps as f64);
                    let p = a + (b - a) * s + (c - a) * t;
                    let z = nearest.entry(Self::cell(p)).or_insert(f64::NEG_INFINITY);
                    *z = z.max(p.z);
                }
            }
        }
        DepthBuffer { nearest }
    }

    fn cell(p: DVec3) -> [i64; 2] {
        [p.x, p.y].map(|x| (x / Self::CELL).floor() as i64)
    }

    fn shows(&self, p: DVec3) -> bool {
        let nearest = self.nearest.get(&Self::cell(p));
        nearest.is_none_or(|z| p.z > z - 0.5)
    }
}

/// What a scanner in front sees: points on triangles that face it and that no other hides, with
/// noise and holes; and which vertices they show.
fn front(
    mesh: &[DVec3],
    faces: &[[usize; 3]],
    rng: &mut rand_chacha::ChaCha8Rng,
) -> (Surface, Vec<bool>) {
    let holes: Vec<DVec3> = (0..6)
        .map(|_| mesh[rng.random_range(0..mesh.len())])
        .collect();
    let buffer = DepthBuffer::new(mesh, faces);
    let mut points = Vec::new();
    let mut is_seen = vec![false; mesh.len()];
    for face in faces {
        let [a, b, c] = face.map(|v| mesh[v]);
        let normal = (b - a).cross(c - a);
        let unit = normal.normalize_or_zero();
        let middle = (a + b + c) / 3.0;
        if unit.z < 0.2
            || !buffer.shows(middle)
            || holes.iter().any(|h| (*h - middle).length() < 3.0)
        {
            continue;
        }
        face.iter().for_each(|v| is_seen[*v] = true);
        // Two points a square centimeter.
        let count = normal.length() + rng.random::<f64>();
        for _ in 0..count as usize {
            let (mut s, mut t): (f64, f64) = (rng.random(), rng.random());
            if s + t > 1.0 {
                (s, t) = (1.0 - s, 1.0 - t);
            }
            let mut draw = || 0.2 * rng.sample::<f64, _>(StandardNormal);
            let noise = DVec3::new(draw(), draw(), draw());
            points.push(a + (b - a) * s + (c - a) * t + noise);
        }
    }
    // A cloud: it has no normals.
    (Surface::new(points, Vec::new()), is_seen)
}

/// One seen vertex in eight parts, placed to half a centimeter.
fn placed(
    mesh: &[DVec3],
    parts: &[usize],
    is_seen: &[bool],
    rng: &mut rand_chacha::ChaCha8Rng,
) -> Vec<(usize, DVec3)> {
    let mut draw = || 0.5 * rng.sample::<f64, _>(StandardNormal);
    [4, 11, 14, 0, 15, 7, 10, 8]
        .into_iter()
        .filter_map(|part| {
            let own = || (0..mesh.len()).filter(|v| parts[*v] == part);
            let middle = own().map(|v| mesh[v]).sum::<DVec3>() / own().count() as f64;
            let near = own().filter(|v| is_seen[*v]).min_by(|a, b| {
                (mesh[*a] - middle)
                    .length()
                    .total_cmp(&(mesh[*b] - middle).length())
            })?;
            Some((near, mesh[near] + DVec3::new(draw(), draw(), draw())))
        })
        .collect()
}
