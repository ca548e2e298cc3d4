//! The rigid parts of a mesh, found from poses of it.
//!
//! The neighborhood of each vertex turns in some way in each pose. Connected regions whose vertices
//! turn alike are grown from seeds over the mesh, the vertex that fits best first, as in
//! variational shape approximation (Cohen-Steiner, Alliez, Desbrun 2004): then each region takes
//! the mean of its rotations and grows again from the vertex that is nearest to it. New regions
//! start at the vertex that fits its own region worst.

use super::template::most;
use crate::Result;
use crate::numeric::parallel;
use crate::pose::similarity::nearest_rotation;
use glam::{DMat3, DVec3};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// How far a vertex's neighborhood reaches, in edges.
const RINGS: usize = 2;
/// Rounds of growing after all regions are there.
const ROUNDS: usize = 10;
/// A region of fewer triangles is no part.
const FEWEST_TRIANGLES: usize = 8;

/// The part of each vertex, from 0: `count` connected parts, or fewer where regions are too small
/// to be one.
///
/// `faces` must hold all vertices together (see [`super::Template::bridges`]).
///
/// # Errors
/// [`crate::Error::Unfit`]: there is no pose, or there are fewer vertices than parts.
pub fn find_parts(
    vertices: &[DVec3],
    faces: &[[usize; 3]],
    poses: &[Vec<DVec3>],
    count: usize,
) -> Result<Vec<usize>> {
    if poses.is_empty() {
        return Err("parts are found from poses; none is given".into());
    }
    if count == 0 || count > vertices.len() {
        return Err(format!("has {} vertices for {count} parts", vertices.len()).into());
    }
    let neighbors = vertex_neighbors(vertices.len(), faces);
    let turns = local_rotations(vertices, &neighbors, poses);
    let mut regions = Regions::new(&neighbors, &turns);
    while regions.means.len() < count && regions.add() {
        regions.grow();
    }
    for _ in 0..ROUNDS {
        regions.grow();
    }
    while regions.merge_small(faces) {}
    Ok(regions.of)
}

/// The vertices at the other end of each vertex's edges, in order.
fn vertex_neighbors(vertices: usize, faces: &[[usize; 3]]) -> Vec<Vec<usize>> {
    let mut neighbors = vec![Vec::new(); vertices];
    for face in faces {
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            neighbors[face[a]].push(face[b]);
            neighbors[face[b]].push(face[a]);
        }
    }
    for list in &mut neighbors {
        list.sort_unstable();
        list.dedup();
    }
    neighbors
}

/// A vertex and those at most [`RINGS`] edges away from it.
fn neighborhood(neighbors: &[Vec<usize>], vertex: usize) -> Vec<usize> {
    let mut near = vec![vertex];
    let mut from = 0;
    for _ in 0..RINGS {
        let to = near.len();
        for k in from..to {
            for next in &neighbors[near[k]] {
                if !near.contains(next) {
                    near.push(*next);
                }
            }
        }
        from = to;
    }
    near
}

/// How the neighborhood of each vertex turns: nine numbers per pose.
fn local_rotations(
    vertices: &[DVec3],
    neighbors: &[Vec<usize>],
    poses: &[Vec<DVec3>],
) -> Vec<Vec<f32>> {
    let of_vertex = |v: usize| {
        let near = neighborhood(neighbors, v);
        let rest = near.iter().map(|u| vertices[*u]).sum::<DVec3>() / near.len() as f64;
        let of_pose = |pose: &Vec<DVec3>| {
            let mut moment = DMat3::ZERO;
            for u in &near {
                let (x, y) = (vertices[*u] - rest, pose[*u]);
                moment += DMat3::from_cols(x * y.x, x * y.y, x * y.z);
            }
            let (rotation, ..) = nearest_rotation(&moment);
            rotation.to_cols_array().map(|v| v as f32)
        };
        poses.iter().flat_map(of_pose).collect::<Vec<f32>>()
    };
    let chunks = parallel::map_chunks(vertices.len(), 256, |range| {
        range.map(of_vertex).collect::<Vec<_>>()
    });
    chunks.concat()
}

struct Regions<'a> {
    neighbors: &'a [Vec<usize>],
    turns: &'a [Vec<f32>],
    /// The region of each vertex.
    of: Vec<usize>,
    /// The mean rotations of each region.
    means: Vec<Vec<f32>>,
    seeds: Vec<usize>,
}

impl<'a> Regions<'a> {
    /// One region.
    fn new(neighbors: &'a [Vec<usize>], turns: &'a [Vec<f32>]) -> Regions<'a> {
        let mut regions = Regions {
            of: vec![0; turns.len()],
            means: vec![turns[0].clone()],
            seeds: vec![0],
            neighbors,
            turns,
        };
        regions.update();
        regions
    }

    fn miss(&self, vertex: usize, region: usize) -> f32 {
        let pairs = self.turns[vertex].iter().zip(&self.means[region]);
        pairs.map(|(a, b)| (a - b) * (a - b)).sum()
    }

    /// Starts a region at the vertex that fits worst; `false` if all fit.
    fn add(&mut self) -> bool {
        let misses = (0..self.of.len()).map(|v| (self.miss(v, self.of[v]), Reverse(v)));
        match misses.max_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))) {
            Some((miss, Reverse(worst))) if miss > 0.0 && !self.seeds.contains(&worst) => {
                self.means.push(self.turns[worst].clone());
                self.seeds.push(worst);
                true
            }
            _ => false,
        }
    }

    /// Grows all regions from their seeds, then takes their means.
    fn grow(&mut self) {
        const FREE: usize = usize::MAX;
        self.of = vec![FREE; self.turns.len()];
        // Misses are not negative: their bits are in their order.
        let mut heap: BinaryHeap<Reverse<(u32, usize, usize)>> = BinaryHeap::new();
        for (region, seed) in self.seeds.iter().enumerate() {
            heap.push(Reverse((0, *seed, region)));
        }
        while let Some(Reverse((_, vertex, region))) = heap.pop() {
            if self.of[vertex] != FREE {
                continue;
            }
            self.of[vertex] = region;
            for next in self.neighbors[vertex]
                .iter()
                .filter(|n| self.of[**n] == FREE)
            {
                let miss = self.miss(*next, region);
                heap.push(Reverse((miss.to_bits(), *next, region)));
            }
        }
        // What hangs on nothing goes with the first region.
        self.of
            .iter_mut()
            .filter(|r| **r == FREE)
            .for_each(|r| *r = 0);
        self.update();
    }

    /// Joins the first region that has too few triangles to the one beside it that turns most
    /// alike; `false` if there is none.
    fn merge_small(&mut self, faces: &[[usize; 3]]) -> bool {
        let mut triangles = vec![0; self.means.len()];
        for face in faces {
            triangles[most(face.map(|v| self.of[v]))] += 1;
        }
        let Some(small) = triangles.iter().position(|t| *t < FEWEST_TRIANGLES) else {
            return false;
        };
        let beside = (0..self.of.len()).filter(|v| self.of[*v] == small);
        let beside = beside.flat_map(|v| self.neighbors[v].iter().map(|n| self.of[*n]));
        let apart = |r: &usize| {
            let pairs = self.means[*r].iter().zip(&self.means[small]);
            pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f32>()
        };
        let other = beside.filter(|r| *r != small);
        let Some(other) = other.min_by(|a, b| apart(a).total_cmp(&apart(b)).then(a.cmp(b))) else {
            return false;
        };
        for of in &mut self.of {
            let to = if *of == small { other } else { *of };
            *of = if to > small { to - 1 } else { to };
        }
        self.means.remove(small);
        self.seeds.remove(small);
        self.update();
        true
    }

    /// The mean rotations of each region, and the vertex nearest to them.
    fn update(&mut self) {
        let width = self.turns[0].len();
        let mut sums = vec![vec![0.0_f64; width]; self.means.len()];
        let mut counts = vec![0.0; self.means.len()];
        for (v, region) in self.of.iter().enumerate() {
            counts[*region] += 1.0;
            let pairs = sums[*region].iter_mut().zip(&self.turns[v]);
            pairs.for_each(|(sum, t)| *sum += f64::from(*t));
        }
        for ((mean, sum), count) in self.means.iter_mut().zip(&sums).zip(&counts) {
            *mean = sum.iter().map(|s| (s / count) as f32).collect();
        }
        let mut best = vec![f32::INFINITY; self.means.len()];
        for v in 0..self.of.len() {
            let (region, miss) = (self.of[v], self.miss(v, self.of[v]));
            if miss < best[region] {
                (best[region], self.seeds[region]) = (miss, v);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::rotation::from_rotation_vector;
    use crate::template::tests::column;

    #[test]
    fn a_column_that_bends_once_has_two_parts() {
        let template = column(16);
        let bent = |by: f64| -> Vec<DVec3> {
            let turn = from_rotation_vector(DVec3::new(0.0, 0.0, by));
            let pivot = DVec3::new(0.0, 6.5, 0.0);
            (template.vertices.iter())
                .map(|v| {
                    if v.y > 6.5 {
                        pivot + turn * (*v - pivot)
                    } else {
                        *v
                    }
                })
                .collect()
        };
        let poses = [bent(0.0), bent(0.7), bent(-0.5)];
        let parts = find_parts(&template.vertices, &template.faces, &poses, 2).unwrap();
        for (v, part) in template.vertices.iter().zip(&parts) {
            if (v.y - 6.5).abs() > 2.0 {
                assert_eq!(*part, parts[if v.y < 6.5 { 0 } else { 63 }], "{v}");
            }
        }
        assert_ne!(parts[0], parts[63]);
        assert!(find_parts(&template.vertices, &template.faces, &[], 2).is_err());
    }
}
