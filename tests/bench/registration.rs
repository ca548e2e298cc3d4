//! How well and how fast a template is laid on scans of other people and poses, on the shared
//! meshes: `make bench`.
//!
//! A scan is the true mesh with a vertex in the middle of each face, every edge of the mesh turned,
//! and 2 mm of noise a coordinate. So it shares no edge with the template, and its vertices hold
//! all of the true ones. Points are 5 mm off.

use glam::DVec3;
use posing::body::Template;
use posing::body::registration::register;
use posing::body::surface::Surface;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use std::collections::HashMap;
use std::time::Instant;

#[path = "../it/common/bodies.rs"]
mod bodies;
use bodies::mean;

/// Ten vertices far from each other: head, hands, feet, knees, shoulders, small of the back.
const FEW: [usize; 10] = [881, 6267, 9110, 3058, 4205, 11343, 1647, 8319, 4706, 13073];

fn main() {
    let path = std::path::Path::new("../shared/data/bodies/makehuman-40-people-40-poses.npz");
    if !path.exists() {
        return println!("no bodies at ../shared/data/bodies: nothing is measured");
    }
    let bodies = bodies::read(path);
    let parts = vec![0; bodies.parts.len()];
    let template = Template::new(bodies.poses[0].clone(), bodies.faces.clone(), parts).unwrap();
    let many = at_joints(&template, &bodies.parts);
    for k in [2, 8, 25] {
        report(&format!("person {k}"), &template, &bodies.people[k], &FEW);
    }
    for k in [1, 5, 22, 38] {
        report(&format!("pose {k}"), &template, &bodies.poses[k], &many);
    }
}

/// For each pair of neighboring parts the vertex of their border that is outermost, and the head,
/// hands and feet.
fn at_joints(template: &Template, parts: &[usize]) -> Vec<usize> {
    let mut borders: HashMap<[usize; 2], Vec<usize>> = HashMap::new();
    for face in template.surface() {
        for (a, b) in [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])] {
            let pair = [parts[a].min(parts[b]), parts[a].max(parts[b])];
            if pair[0] != pair[1] {
                borders.entry(pair).or_default().extend([a, b]);
            }
        }
    }
    let mut found: Vec<usize> = FEW[..4].iter().chain(&FEW[9..]).copied().collect();
    let mut borders: Vec<_> = borders.into_iter().filter(|(_, b)| b.len() > 50).collect();
    borders.sort();
    for (_, border) in borders {
        let at = |v: &usize| template.vertices[*v];
        let x = border.iter().map(|v| at(v).x).sum::<f64>() / border.len() as f64;
        let out = |v: &usize| {
            if x.abs() > 3.0 {
                at(v).x * x.signum()
            } else {
                at(v).z
            }
        };
        let outermost = border.iter().max_by(|a, b| out(a).total_cmp(&out(b)));
        found.extend(outermost.filter(|v| !found.contains(v)).copied());
    }
    found
}

fn report(name: &str, template: &Template, truth: &[DVec3], on: &[usize]) {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(0);
    let mut noise =
        |sd: f64| DVec3::from_array([0; 3].map(|_| sd * rng.sample::<f64, _>(StandardNormal)));
    let points: Vec<(usize, DVec3)> = (on.iter())
        .map(|v| (*v, truth[*v] + noise(0.5 / 3f64.sqrt())))
        .collect();
    let (vertices, faces) = turned(template, truth);
    let scan = Surface::new(vertices.iter().map(|v| *v + noise(0.2)).collect(), faces);
    let start = Instant::now();
    let found = register(template, &scan, &points, &mut || {}).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    let clean = Surface::new(truth.to_vec(), template.surface().to_vec());
    let off = |a: DVec3, b: DVec3| 10.0 * (a - b).length();
    let mut vertex: Vec<f64> = (found.vertices.iter().zip(truth))
        .map(|(a, b)| off(*a, *b))
        .collect();
    let surface: Vec<f64> = (found.vertices.iter())
        .map(|v| off(*v, clean.nearest(*v).unwrap().at))
        .collect();
    vertex.sort_by(f64::total_cmp);
    println!(
        "{name}, {} points: vertices {:.1} mm, median {:.1}, 95% {:.1}; surface {:.2} mm; {} folds; {seconds:.1} s",
        on.len(),
        mean(&vertex),
        vertex[vertex.len() / 2],
        vertex[vertex.len() * 95 / 100],
        mean(&surface),
        found.folds
    );
}

/// The mesh with a vertex in the middle of each face, and of each edge two triangles between its
/// ends and the two middles.
fn turned(template: &Template, truth: &[DVec3]) -> (Vec<DVec3>, Vec<[usize; 3]>) {
    let surface = template.surface();
    let middle = |f: &[usize; 3]| (truth[f[0]] + truth[f[1]] + truth[f[2]]) / 3.0;
    let vertices = truth.iter().copied().chain(surface.iter().map(middle));
    let mut beside = HashMap::new();
    for (k, f) in surface.iter().enumerate() {
        for c in 0..3 {
            beside.insert((f[c], f[(c + 1) % 3]), truth.len() + k);
        }
    }
    let mut edges: Vec<_> = beside.iter().filter(|((a, b), _)| a < b).collect();
    edges.sort();
    let faces = edges.into_iter().filter_map(|((a, b), p)| {
        let q = beside.get(&(*b, *a))?;
        Some([[*a, *q, *p], [*b, *p, *q]])
    });
    (vertices.collect(), faces.flatten().collect())
}
