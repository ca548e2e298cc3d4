//! Registration: the template's mesh laid on a scan.
//!
//! Non-rigid ICP (B. Amberg, S. Romdhani, T. Vetter: Optimal Step Nonrigid ICP Algorithms for
//! Surface Registration, CVPR 2007) with the smoothness of deformation gradients
//! (`gradient_energy`) in place of that of the vertices' transforms,
//! which depends on where the origin is. Hand-placed points give the start: a similarity, then the
//! smoothest deformation that meets them. Then vertices are drawn to the nearest points of the
//! scan, while the stiffness and the distance limit fall. Where the scan shows nothing, vertices
//! follow their neighbors.
//!
//! Each triangle is drawn a little to the rotation nearest to its gradient, times one scale for
//! all: bodies bend, but hardly shear. Nearest points are found again several times for one factor,
//! with the weights of the first time: this takes a fifth of the time of a new factor, and vertices
//! slide along the surface only by many such steps.
//!
//! All lengths are parts of the template's size (the root of its area) or of its mean edge, so the
//! unit does not matter. Cost: 17 factors of a (V + P, V + P) matrix; 10 s of processor time for
//! 13,380 vertices.

use super::deformation_gradient::rotations;
use super::gradient_energy::{Factored, GradientEnergy, Stiffness, Targets};
use super::scan_match::ScanMatcher;
use super::surface::Surface;
use super::template::Template;
use crate::Result;
use crate::pose::similarity::{Similarity, TransformKind, eigen_symmetric, fit_similarity};
use glam::DVec3;

/// The fewest points that a registration starts from.
pub(crate) const FEWEST_POINTS: usize = 4;

/// The rounds of a registration, of which its observer hears.
pub const ROUNDS: usize = 1 + LEVELS * ROUNDS_OF_LEVEL;

/// Points whose spread across their longest line is less than this part of that along it do not fix
/// a rotation.
const COLLINEAR: f64 = 0.02;

/// The stiffness of the start: b as a part of the template's size, and s as a part of b. It hardly
/// matters.
const START: [f64; 2] = [0.1, 0.3];

/// Steps of the start, each with new rotations.
const START_STEPS: usize = 20;

/// Levels of stiffness, rounds of each (a factor a round), and steps of a round.
const LEVELS: usize = 8;
const ROUNDS_OF_LEVEL: usize = 2;
const STEPS: usize = 8;

/// b of the first level, as a part of the template's size, and of the last, in mean edges. A softer
/// end follows the scan's noise.
const BEND: [f64; 2] = [0.03, 2.0];

/// s as a part of b: with 0.1 limbs twist and slide, with 1 people of other proportions are not
/// met.
const STRETCH: f64 = 0.5;

/// The distance limit of the first level, as a part of the template's size, and of the last, in
/// mean edges.
const LIMIT: [f64; 2] = [0.04, 2.0];

/// A template's mesh on a scan.
#[derive(Debug, Clone)]
pub struct Registration {
    /// The vertices, cm (V).
    pub vertices: Vec<DVec3>,
    /// The distance of each vertex to the scan, cm; `None` where the scan shows nothing of it (V).
    pub distances: Vec<Option<f64>>,
    /// Triangles that point against their neighbors, and did not in the template.
    pub folds: usize,
}

/// The similarity of points of the template (vertex, position on the scan in cm) to those of the
/// scan.
///
/// # Errors
/// [`crate::Error::Unfit`]: fewer than [`FEWEST_POINTS`] points, or all on a line.
#[doc(hidden)]
pub fn start(template: &[DVec3], points: &[(usize, DVec3)]) -> Result<Similarity> {
    if points.len() < FEWEST_POINTS {
        return Err(format!(
            "has {} points, expected {FEWEST_POINTS} or more",
            points.len()
        )
        .into());
    }
    let pairs = points.iter().map(|(v, at)| (template[*v], *at, 1.0));
    let on_line = is_line(pairs.clone().map(|p| p.0)) || is_line(pairs.clone().map(|p| p.1));
    match fit_similarity(pairs, TransformKind::Similarity) {
        Some(fit) if fit.determined && !on_line => Ok(fit.similarity),
        _ => Err("has points on one line, which leave a turn about it open".into()),
    }
}

/// Whether points lie on a line, nearly.
fn is_line(points: impl Iterator<Item = DVec3> + Clone) -> bool {
    let mean = points.clone().sum::<DVec3>() / points.clone().count() as f64;
    let mut moment = [[0.0; 3]; 3];
    for p in points.map(|p| p - mean) {
        for i in 0..3 {
            (0..3).for_each(|j| moment[i][j] += p[i] * p[j]);
        }
    }
    let (mut values, _) = eigen_symmetric(moment);
    values.sort_by(f64::total_cmp);
    !(values[1] > COLLINEAR.powi(2) * values[2])
}

/// Lays a template on a scan, given some of its vertices and where they are on the scan, cm.
/// `observer` is called after each of [`ROUNDS`] rounds.
///
/// # Errors
/// [`crate::Error::Unfit`]: fewer than 4 points, or all on a line; or only
/// triangles without area hold a vertex.
pub fn register(
    template: &Template,
    scan: &Surface,
    points: &[(usize, DVec3)],
    observer: &mut dyn FnMut(),
) -> Result<Registration> {
    let similarity = start(&template.vertices, points)?;
    let rest: Vec<DVec3> = (template.vertices.iter())
        .map(|v| similarity.apply(*v))
        .collect();
    let energy = GradientEnergy::new(template, &rest);
    let areas = energy.vertex_areas();
    let size = areas.iter().sum::<f64>().sqrt();
    let edge = template.resolution() * similarity.scale;
    let mut fit = Fit {
        unknowns: energy.unknowns(&rest),
        energy: &energy,
        areas,
        points,
    };
    fit.meet_points(size)
        .ok_or("has a vertex that only triangles without area hold")?;
    observer();
    let matcher = ScanMatcher::new(scan, template.surface(), fit.vertices());
    for level in 0..LEVELS {
        let share = level as f64 / (LEVELS - 1) as f64;
        let between = |[first, last]: [f64; 2]| {
            let (first, last) = (first * size, last * edge);
            first * (last / first).powf(share)
        };
        for _ in 0..ROUNDS_OF_LEVEL {
            fit.approach(&matcher, between(BEND), between(LIMIT))
                .ok_or("has a vertex that only triangles without area hold")?;
            observer();
        }
    }
    let vertices = fit.vertices().to_vec();
    Ok(Registration {
        distances: matcher.distances(&vertices, LIMIT[1] * edge),
        folds: folds(template, &vertices),
        vertices,
    })
}

/// A registration on its way.
struct Fit<'a> {
    energy: &'a GradientEnergy,
    /// The vertices, then what the energy adds to them, cm.
    unknowns: Vec<DVec3>,
    /// The areas of the vertices, cm² (V).
    areas: Vec<f64>,
    points: &'a [(usize, DVec3)],
}

impl Fit<'_> {
    fn vertices(&self) -> &[DVec3] {
        &self.unknowns[..self.areas.len()]
    }

    /// The smoothest deformation that meets the points; together they weigh as much as the surface.
    /// `None`: the matrix is singular.
    fn meet_points(&mut self, size: f64) -> Option<()> {
        let bend = START[0] * size;
        let stretch = START[1] * bend;
        let mut targets = self.no_targets();
        self.add_points(&mut targets, size * size / self.points.len() as f64);
        let factored = (self.energy).factor(Stiffness { bend, stretch }, &targets.weights)?;
        (0..START_STEPS).for_each(|_| self.step(&factored, &targets));
        Some(())
    }

    /// One factor of a level, and the steps that it serves. `None`: the matrix is singular.
    fn approach(&mut self, matcher: &ScanMatcher<'_>, bend: f64, limit: f64) -> Option<()> {
        let stretch = STRETCH * bend;
        let mut found = matcher.matches(self.vertices(), limit);
        let is_drawn: Vec<bool> = found.iter().map(Option::is_some).collect();
        let mut targets = self.no_targets();
        let mut factored = None;
        for step in 0..STEPS {
            if step > 0 {
                found = matcher.matches(self.vertices(), limit);
            }
            for (v, at) in found.iter().enumerate() {
                // The factor knows the weights of the first step. A vertex that has lost its point
                // keeps that of the step before.
                if let (true, Some(at)) = (is_drawn[v], at) {
                    (targets.targets[v], targets.weights[v]) = (*at, self.areas[v]);
                }
            }
            // A point weighs as much as the surface over which bending is resisted: much at first,
            // little at the end.
            let mut all = targets.clone();
            self.add_points(&mut all, bend * bend);
            if factored.is_none() {
                let stiffness = Stiffness { bend, stretch };
                factored = self.energy.factor(stiffness, &all.weights);
            }
            self.step(factored.as_ref()?, &all);
        }
        Some(())
    }

    fn no_targets(&self) -> Targets {
        Targets {
            targets: vec![DVec3::ZERO; self.areas.len()],
            weights: vec![0.0; self.areas.len()],
        }
    }

    /// Adds the points, of weight `weight` cm² each.
    fn add_points(&self, targets: &mut Targets, weight: f64) {
        for (v, at) in self.points {
            let (target, own) = (&mut targets.targets[*v], &mut targets.weights[*v]);
            *target = (*target * *own + *at * weight) / (*own + weight);
            *own += weight;
        }
    }

    fn step(&mut self, factored: &Factored<'_>, targets: &Targets) {
        let rotations = rotations(&self.energy.gradients(&self.unknowns));
        self.unknowns = factored.step(targets, &rotations, &self.unknowns);
    }
}

/// The number of triangles that point against the mean of their neighbors, and did not in the
/// template.
fn folds(template: &Template, vertices: &[DVec3]) -> usize {
    let now = against_neighbors(template, vertices);
    let before = against_neighbors(template, &template.vertices);
    now.iter().zip(before).filter(|(n, b)| **n && !b).count()
}

/// Whether each triangle points against the mean of its neighbors.
fn against_neighbors(template: &Template, vertices: &[DVec3]) -> Vec<bool> {
    let faces = template.surface();
    let normal = |f: &[usize; 3]| {
        let [a, b, c] = f.map(|v| vertices[v]);
        (b - a).cross(c - a)
    };
    let normals: Vec<DVec3> = faces.iter().map(normal).collect();
    let mut around = vec![DVec3::ZERO; faces.len()];
    for [a, b] in &template.neighbors {
        if *a.max(b) < faces.len() {
            around[*a] += normals[*b];
            around[*b] += normals[*a];
        }
    }
    (normals.iter().zip(around))
        .map(|(n, m)| n.dot(m) < 0.0)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;

    /// An oval column of `rings` rings of 24 vertices, 2 cm apart, closed at both ends.
    fn column(rings: usize) -> Template {
        let mut vertices = Vec::new();
        for k in 0..rings {
            for c in 0..24 {
                let angle = std::f64::consts::TAU * c as f64 / 24.0;
                vertices.push(DVec3::new(
                    8.0 * angle.cos(),
                    2.0 * k as f64,
                    6.0 * angle.sin(),
                ));
            }
        }
        let mut faces = Vec::new();
        for k in 0..rings - 1 {
            for c in 0..24 {
                let (a, b) = (24 * k + c, 24 * k + (c + 1) % 24);
                faces.extend([[a, a + 24, b], [b, a + 24, b + 24]]);
            }
        }
        let (top, bottom) = (24 * (rings - 1), vertices.len());
        let height = 2.0 * (rings - 1) as f64;
        vertices.extend([DVec3::ZERO, DVec3::Y * height]);
        for c in 0..24 {
            let next = (c + 1) % 24;
            faces.extend([[bottom, c, next], [bottom + 1, top + next, top + c]]);
        }
        let parts = vec![0; vertices.len()];
        Template::new(vertices, faces, parts).unwrap()
    }

    /// The axis is an arc, the sections are turned, squeezed and waved.
    fn bent(template: &Template) -> Vec<DVec3> {
        let bend = |v: &DVec3| {
            let angle = 0.008 * v.y;
            let axis = DVec3::new(angle.cos() - 1.0, angle.sin(), 0.0) / 0.008;
            let section = DVec3::new(1.1 * v.x, 0.0, v.z + (v.y / 20.0).sin());
            axis + from_rotation_vector(DVec3::Z * angle) * section
        };
        template.vertices.iter().map(bend).collect()
    }

    fn points(truth: &[DVec3]) -> Vec<(usize, DVec3)> {
        let on = [0, 12, 200, 485, 498, 720, 936, 950];
        on.iter().map(|v| (*v, truth[*v])).collect()
    }

    fn error(found: &[DVec3], truth: &[DVec3]) -> f64 {
        let all = found.iter().zip(truth).map(|(a, b)| (*a - *b).length());
        all.sum::<f64>() / truth.len() as f64
    }

    fn on(template: &Template, truth: &[DVec3]) -> Registration {
        let scan = Surface::new(truth.to_vec(), template.surface().to_vec());
        register(template, &scan, &points(truth), &mut || {}).unwrap()
    }

    #[test]
    fn a_bent_column_is_found_in_every_unit_and_turn() {
        let template = column(40);
        let truth = bent(&template);
        let found = on(&template, &truth);
        let off = error(&found.vertices, &truth);
        let similarity = start(&template.vertices, &points(&truth)).unwrap();
        let before = template.vertices.iter().map(|v| similarity.apply(*v));
        let before = error(&before.collect::<Vec<_>>(), &truth);

        assert!(off <= before / 5.0, "{off} of {before} cm");
        assert_eq!(found.folds, 0);
        let seen: Vec<f64> = found.distances.iter().flatten().copied().collect();
        assert_eq!(seen.len(), truth.len());
        let off = seen.iter().sum::<f64>() / seen.len() as f64;

        assert!(off <= 0.15, "{off} cm from the surface");
        let turn = from_rotation_vector(DVec3::new(2.0, -0.5, 1.0));
        let carry = |v: &DVec3| 0.25 * (turn * *v) + DVec3::new(300.0, -20.0, 5.0);
        let moved: Vec<DVec3> = truth.iter().map(carry).collect();
        let again = on(&template, &moved);
        let expected: Vec<DVec3> = found.vertices.iter().map(carry).collect();
        let off = error(&again.vertices, &expected);
        assert!(off <= 1e-5, "{off}");
    }

    #[test]
    fn an_affine_image_is_found_exactly() {
        let template = column(40);
        let affine = |v: &DVec3| DVec3::new(1.1 * v.x + 0.05 * v.y, v.y, 0.95 * v.z + 3.0);
        let truth: Vec<DVec3> = template.vertices.iter().map(affine).collect();
        let off = error(&on(&template, &truth).vertices, &truth);
        assert!(off <= 0.3, "{off}");
    }

    #[test]
    fn what_a_scan_does_not_show_follows() {
        let template = column(40);
        let truth = bent(&template);
        let shown = |f: &&[usize; 3]| f.iter().all(|v| !(480..600).contains(v));
        let faces = template.surface().iter().filter(shown).copied().collect();
        let scan = Surface::new(truth.clone(), faces);
        let found = register(&template, &scan, &points(&truth), &mut || {}).unwrap();
        let off = error(&found.vertices, &truth);

        assert!(off <= 0.6, "{off}");
        assert!(found.distances[540..550].iter().all(Option::is_none));
    }

    #[test]
    fn bad_points_are_told() {
        let template = column(40);
        let start = |on: &[usize]| {
            let points: Vec<_> = on.iter().map(|v| (*v, template.vertices[*v])).collect();
            start(&template.vertices, &points).map_err(|e| e.to_string())
        };
        assert!(start(&[0, 12, 200]).unwrap_err().contains("has 3 points"));
        assert!(start(&[0, 24, 48, 240]).unwrap_err().contains("one line"));
        assert!(start(&[0, 24, 48, 252]).is_ok());
    }

    #[test]
    fn a_triangle_turned_over_is_a_fold() {
        let template = column(6);
        let mut vertices = template.vertices.clone();
        assert_eq!(folds(&template, &vertices), 0);
        vertices[60].y += 9.0;
        assert!(folds(&template, &vertices) > 0);
    }
}
