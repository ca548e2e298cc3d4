//! Meshes as compressed text, as the script of the page reads them.
//!
//! Coordinates are whole numbers of steps, 16 bits each: those of a frame count from the frame's
//! own origin. Smooth motion of smooth surfaces is compressed well when each coordinate is
//! predicted: from the two frames before (as if its speed stayed the same), and the error of that
//! from the errors of its neighbors with smaller numbers. What is left is written as unsigned
//! numbers (0, -1, 1, -2, ...), for each frame and axis all low bytes and then all high bytes, and
//! deflated. Faces are differences of one corner to the next, in the same form with four bytes.

use crate::mesh_scene::MeshFigure;
use base64::prelude::{BASE64_STANDARD, Engine};
use flate2::{Compression, write::DeflateEncoder};
use std::io::Write;

/// Steps along the largest side of any frame's box, so that a body of 2 m has steps of 0.08 mm.
/// Less than 2^16.
const STEPS: f64 = 25_000.0;

/// The meshes of a figure, packed.
pub(crate) struct Packed {
    /// The length of a step, in the unit of the vertices. No coordinate is wrong by more than half
    /// of it.
    pub step: f64,
    /// The smallest x, y, z of each frame, in steps.
    pub origins: Vec<[i64; 3]>,
    /// Coordinates, base64 of deflated bytes.
    pub positions: String,
    /// Faces, base64 of deflated bytes.
    pub faces: String,
}

/// Packs some frames of a figure.
pub(crate) fn packed(figure: &MeshFigure<'_>, kept: &[usize]) -> Packed {
    let step = match figure.largest_side() / STEPS {
        // All vertices at one position.
        0.0 => 1.0,
        step => step,
    };
    let lower = LowerNeighbors::of(figure.faces, figure.vertices.dim().1);
    let mut bytes = Deflated::default();
    let mut origins = Vec::with_capacity(kept.len());
    // The last frame and the one before.
    let mut before: [Option<Vec<[u16; 3]>>; 2] = [None, None];
    for &frame in kept {
        let (origin, positions) = whole(figure, frame, step);
        origins.push(origin);
        for axis in 0..3 {
            let errors: Vec<i16> = (0..positions.len())
                .map(|v| {
                    let guess = match &before {
                        [None, _] => 0,
                        [Some(one), None] => one[v][axis],
                        [Some(one), Some(two)] => {
                            one[v][axis].wrapping_mul(2).wrapping_sub(two[v][axis])
                        }
                    };
                    positions[v][axis].wrapping_sub(guess) as i16
                })
                .collect();
            let rest = (0..errors.len()).map(|v| {
                let rest = errors[v].wrapping_sub(lower.mean(v, &errors));
                ((rest << 1) ^ (rest >> 15)) as u16
            });
            bytes.planes::<2>(&rest.map(u32::from).collect::<Vec<_>>());
        }
        before = [Some(positions), before[0].take()];
    }
    Packed {
        step,
        origins,
        positions: bytes.finish(),
        faces: faces(figure.faces),
    }
}

/// The origin of a frame, and its vertices counted from there, in steps.
fn whole(figure: &MeshFigure<'_>, frame: usize, step: f64) -> ([i64; 3], Vec<[u16; 3]>) {
    let steps = |v: f32| (f64::from(v) / step).round() as i64;
    let origin = figure.extent(frame).map(|[low, _]| steps(low));
    let position = |v: ndarray::ArrayView1<'_, f32>| {
        // At most STEPS and one, by rounding.
        [0, 1, 2].map(|axis| (steps(v[axis]) - origin[axis]) as u16)
    };
    let positions = figure.frame(frame).outer_iter().map(position).collect();
    (origin, positions)
}

fn faces(faces: &[[u32; 3]]) -> String {
    let mut last = 0;
    let rest = faces.iter().flatten().map(|corner| {
        let rest = corner.wrapping_sub(last) as i32;
        last = *corner;
        ((rest << 1) ^ (rest >> 31)) as u32
    });
    let mut bytes = Deflated::default();
    bytes.planes::<4>(&rest.collect::<Vec<_>>());
    bytes.finish()
}

/// The neighbors of each vertex that have smaller numbers, once for each face of the edge.
struct LowerNeighbors {
    /// Where the neighbors of each vertex begin in `all`, and at last its length.
    starts: Vec<usize>,
    all: Vec<u32>,
}

impl LowerNeighbors {
    fn of(faces: &[[u32; 3]], vertices: usize) -> LowerNeighbors {
        let edges = || {
            faces
                .iter()
                .flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)])
        };
        let mut starts = vec![0; vertices + 1];
        for (a, b) in edges().filter(|(a, b)| a != b) {
            starts[a.max(b) as usize + 1] += 1;
        }
        for v in 0..vertices {
            starts[v + 1] += starts[v];
        }
        let (mut next, mut all) = (starts.clone(), vec![0; starts[vertices]]);
        for (a, b) in edges().filter(|(a, b)| a != b) {
            let end = &mut next[a.max(b) as usize];
            all[*end] = a.min(b);
            *end += 1;
        }
        LowerNeighbors { starts, all }
    }

    /// The mean error of a vertex's lower neighbors, rounded down; without any, the error of the
    /// vertex before.
    fn mean(&self, vertex: usize, errors: &[i16]) -> i16 {
        let lower = &self.all[self.starts[vertex]..self.starts[vertex + 1]];
        match (lower.len() as i64, vertex) {
            (0, 0) => 0,
            (0, _) => errors[vertex - 1],
            (n, _) => {
                let sum: i64 = lower.iter().map(|v| i64::from(errors[*v as usize])).sum();
                sum.div_euclid(n) as i16
            }
        }
    }
}

/// Bytes that are deflated while they are written.
struct Deflated(DeflateEncoder<Vec<u8>>);

impl Default for Deflated {
    fn default() -> Deflated {
        Deflated(DeflateEncoder::new(Vec::new(), Compression::default()))
    }
}

impl Deflated {
    /// Writes the lowest byte of every number, then the next, and so on.
    fn planes<const BYTES: usize>(&mut self, numbers: &[u32]) {
        for byte in 0..BYTES {
            let plane: Vec<u8> = numbers.iter().map(|n| (n >> (8 * byte)) as u8).collect();
            // Writing to memory cannot fail.
            let _ = self.0.write_all(&plane);
        }
    }

    fn finish(self) -> String {
        BASE64_STANDARD.encode(self.0.finish().unwrap_or_default())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::mesh_scene::tests::{cube, scene};
    use ndarray::Array3;
    use std::io::Read;

    fn inflated(text: &str) -> Vec<u8> {
        let bytes = BASE64_STANDARD.decode(text).unwrap();
        let mut out = Vec::new();
        let mut reader = flate2::read::DeflateDecoder::new(bytes.as_slice());
        reader.read_to_end(&mut out).unwrap();
        out
    }

    /// The faces, as the script finds them.
    pub(crate) fn unpacked_faces(text: &str) -> Vec<[u32; 3]> {
        let bytes = inflated(text);
        let n = bytes.len() / 4;
        let mut last = 0u32;
        let corner = |i: usize| {
            let z = u32::from_le_bytes([0, 1, 2, 3].map(|plane| bytes[plane * n + i]));
            last = last.wrapping_add((z >> 1) ^ (z & 1).wrapping_neg());
            last
        };
        let corners: Vec<u32> = (0..n).map(corner).collect();
        corners.as_chunks().0.to_vec()
    }

    /// The vertices, frames x vertices x 3, as the script finds them.
    pub(crate) fn unpacked(packed: &Packed, vertices: usize) -> Array3<f64> {
        let bytes = inflated(&packed.positions);
        let frames = packed.origins.len();
        assert_eq!(bytes.len(), frames * vertices * 6);
        let lower = LowerNeighbors::of(&unpacked_faces(&packed.faces), vertices);
        let mut positions = Array3::<u16>::zeros((frames, vertices, 3));
        for t in 0..frames {
            for axis in 0..3 {
                let at = (t * 3 + axis) * vertices * 2;
                let mut errors = vec![0i16; vertices];
                for v in 0..vertices {
                    let z = u16::from_le_bytes([bytes[at + v], bytes[at + vertices + v]]);
                    let rest = ((z >> 1) ^ (z & 1).wrapping_neg()) as i16;
                    errors[v] = rest.wrapping_add(lower.mean(v, &errors));
                    let one = if t > 0 {
                        positions[[t - 1, v, axis]]
                    } else {
                        0
                    };
                    let two = if t > 1 {
                        positions[[t - 2, v, axis]]
                    } else {
                        one
                    };
                    let guess = one.wrapping_mul(2).wrapping_sub(two);
                    positions[[t, v, axis]] = guess.wrapping_add(errors[v] as u16);
                }
            }
        }
        Array3::from_shape_fn(positions.dim(), |(t, v, axis)| {
            (packed.origins[t][axis] + i64::from(positions[[t, v, axis]])) as f64 * packed.step
        })
    }

    #[test]
    fn vertices_and_faces_come_back_within_half_a_step() {
        let (one, faces) = cube();
        for (size, travel) in [(1.0, 0.0), (90.0, 1e4), (1e-3, -5.0), (0.0, 0.0)] {
            // It grows, turns over and travels further than 2^16 steps.
            let moved = Array3::from_shape_fn((30, 8, 3), |(t, v, a)| {
                let t = t as f32;
                size * one[[0, v, a]] * (0.3 * t + a as f32).sin() + travel * t * (a as f32 - 0.5)
            });
            let scene = scene(&moved, &faces);
            let kept: Vec<usize> = (0..30).step_by(3).collect();
            let packed = packed(&scene.figures[0], &kept);
            assert_eq!(unpacked_faces(&packed.faces), faces);
            let back = unpacked(&packed, 8);
            for ((t, v, a), found) in back.indexed_iter() {
                let error = (found - f64::from(moved[[kept[t], v, a]])).abs();
                assert!(error <= 0.501 * packed.step, "{size}: {error}");
            }
            assert!(packed.step <= 2.1 * f64::from(size.max(1e-3)) / STEPS || size == 0.0);
        }
    }

    #[test]
    fn vertices_without_neighbors_are_kept() {
        let (vertices, _) = cube();
        let scene = scene(&vertices, &[[7, 7, 2]]);
        let back = unpacked(&packed(&scene.figures[0], &[0]), 8);
        for (found, v) in back.iter().zip(&vertices) {
            assert!((found - f64::from(*v)).abs() <= 1e-4);
        }
    }
}
