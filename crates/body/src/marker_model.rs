//! Where the markers on a body are, without its other vertices.
//!
//! A synthesized vertex is linear in the edges R_l S_k Q_k v̂, S_k is affine in the shape β and Q_k
//! in the numbers t of the joints. So the position of a marker is exactly
//!
//! ```text
//! Σ_l R_l Σ_b Σ_c A_lbc t̃_c β̃_b + R_m d_m,   with t̃ = (t, 1), β̃ = (1, β)
//! ```
//!
//! and the A are summed up over all triangles once. A fit then costs the same whatever the size of
//! the mesh.

use super::body_model::BodyModel;
use super::pose_model::{JointInputs, twists};
use crate::numeric::parallel;
use glam::{DMat3, DVec3};
use ndarray::{Array1, Array2, ArrayView1, s};
use std::collections::BTreeMap;

/// Triangles of one task.
const CHUNK: usize = 256;

/// A point on a body: a weighted mean of vertices, and an offset from it.
#[derive(Debug, Clone, PartialEq)]
pub struct Marker {
    /// Vertices and their weights, which sum to 1.
    pub vertices: Vec<(usize, f64)>,
    /// From there to the marker, centimeters, in the frame of the part: it turns with it.
    pub offset: DVec3,
}

impl Marker {
    /// A marker on a vertex.
    pub fn on(vertex: usize) -> Marker {
        Marker {
            vertices: vec![(vertex, 1.0)],
            offset: DVec3::ZERO,
        }
    }
}

/// The positions of markers as a function of rotations and shape.
#[derive(Debug, Clone)]
pub struct MarkerModel {
    /// The parts of the joints.
    joints: Vec<[usize; 2]>,
    /// What of a joint counts.
    inputs: JointInputs,
    parts: Vec<PartTerms>,
    /// The part that the offset of each marker turns with, and the offset.
    offsets: Vec<(usize, DVec3)>,
}

/// What one part adds to the markers.
#[derive(Debug, Clone)]
struct PartTerms {
    /// The joints whose twists count.
    joints: Vec<usize>,
    /// A for 1 and for each β (3 m, n J + 1): a row per coordinate of a marker, a column per number
    /// of a joint, the constant last.
    by_shape: Vec<Array2<f64>>,
}

/// The positions of the markers, and their derivatives.
#[derive(Debug, Clone)]
pub(crate) struct MarkerPositions {
    /// Centimeters, up to one shift of all.
    pub positions: Vec<DVec3>,
    /// The twist of each joint.
    pub twists: Vec<DVec3>,
    /// By part, what it adds to each marker: turning the part by a small δ adds δ × this.
    pub by_part: Vec<Vec<DVec3>>,
    /// By component of shape, the derivative.
    pub by_shape: Vec<Vec<DVec3>>,
    /// By component of twist (3 per joint), the derivative at fixed rotations.
    pub by_twist: Vec<Vec<DVec3>>,
}

impl MarkerModel {
    /// Sums up the terms of all triangles. About a second for 200 markers, 27,000 triangles and 20
    /// components on two cores.
    pub fn new(body: &BodyModel, markers: &[Marker]) -> MarkerModel {
        let template = &body.template;
        let mut points = Array2::zeros((template.vertices.len(), markers.len()));
        for (m, marker) in markers.iter().enumerate() {
            for (v, weight) in &marker.vertices {
                points[[*v, m]] += weight;
            }
        }
        // How all vertices give when one marker is pulled.
        let influence = template.solve(points.view());
        let offsets = markers.iter().map(|marker| {
            let largest = marker.vertices.iter().max_by(|a, b| a.1.total_cmp(&b.1));
            let part = largest.map_or(0, |(v, _)| template.vertex_parts[*v]);
            (part, marker.offset)
        });
        MarkerModel {
            joints: template.joint_parts(),
            inputs: body.pose.inputs,
            parts: terms_of_parts(body, &influence),
            offsets: offsets.collect(),
        }
    }

    /// The number of components of shape.
    pub(crate) fn components(&self) -> usize {
        self.parts.first().map_or(0, |p| p.by_shape.len() - 1)
    }

    /// The number of parts.
    pub fn parts(&self) -> usize {
        self.parts.len()
    }

    /// The part that marker `m` is on.
    pub fn part_of(&self, m: usize) -> usize {
        self.offsets[m].0
    }

    /// The parts of each joint.
    pub(crate) fn joints(&self) -> &[[usize; 2]] {
        &self.joints
    }

    /// The model of one shape: it has no components any more.
    #[must_use]
    pub fn with_shape(&self, shape: &[f64]) -> MarkerModel {
        let of_part = |part: &PartTerms| PartTerms {
            joints: part.joints.clone(),
            by_shape: vec![part.of_shape(shape)],
        };
        MarkerModel {
            parts: self.parts.iter().map(of_part).collect(),
            ..self.clone()
        }
    }

    /// The model of the same markers with other offsets.
    #[must_use]
    pub fn with_offsets(&self, offsets: &[DVec3]) -> MarkerModel {
        let moved = self.offsets.iter().zip(offsets);
        MarkerModel {
            offsets: moved.map(|((part, _), offset)| (*part, *offset)).collect(),
            ..self.clone()
        }
    }

    /// The offset of marker `m`.
    pub fn offset(&self, m: usize) -> DVec3 {
        self.offsets[m].1
    }

    /// The positions and their derivatives.
    pub(crate) fn evaluate(&self, rotations: &[DMat3], shape: &[f64]) -> MarkerPositions {
        let twists: Vec<DVec3> = twists(&self.joints, rotations);
        let count = self.offsets.len();
        let mut out = MarkerPositions {
            positions: vec![DVec3::ZERO; count],
            by_part: Vec::with_capacity(self.parts.len()),
            by_shape: vec![vec![DVec3::ZERO; count]; self.components()],
            by_twist: vec![vec![DVec3::ZERO; count]; 3 * twists.len()],
            twists,
        };
        for (part, rotation) in self.parts.iter().zip(rotations) {
            part.add(self.inputs, rotation, shape, &mut out);
        }
        for (m, (part, offset)) in self.offsets.iter().enumerate() {
            out.by_part[*part][m] += rotations[*part] * *offset;
        }
        for by_part in &out.by_part {
            for (to, v) in out.positions.iter_mut().zip(by_part) {
                *to += *v;
            }
        }
        out
    }
}

impl PartTerms {
    fn of_shape(&self, shape: &[f64]) -> Array2<f64> {
        let mut sum = self.by_shape[0].clone();
        for (terms, beta) in self.by_shape[1..].iter().zip(shape) {
            sum.scaled_add(*beta, terms);
        }
        sum
    }

    fn add(
        &self,
        of_joint: JointInputs,
        rotation: &DMat3,
        shape: &[f64],
        out: &mut MarkerPositions,
    ) {
        let mut inputs: Vec<f64> = (self.joints.iter())
            .flat_map(|j| of_joint.of(out.twists[*j]))
            .collect();
        inputs.push(1.0);
        let inputs = Array1::from(inputs);
        let terms = self.of_shape(shape);
        let turned = |v: ArrayView1<'_, f64>| -> Vec<DVec3> {
            (0..v.len() / 3)
                .map(|m| *rotation * DVec3::new(v[3 * m], v[3 * m + 1], v[3 * m + 2]))
                .collect()
        };
        let add = |to: &mut Vec<DVec3>, v: Vec<DVec3>| {
            to.iter_mut().zip(v).for_each(|(to, v)| *to += v);
        };
        out.by_part.push(turned(terms.dot(&inputs).view()));
        for (to, terms) in out.by_shape.iter_mut().zip(&self.by_shape[1..]) {
            add(to, turned(terms.dot(&inputs).view()));
        }
        for (k, joint) in self.joints.iter().enumerate() {
            let slopes = of_joint.slopes(out.twists[*joint]);
            for (e, slope) in slopes.iter().enumerate() {
                let column = turned(terms.column(slopes.len() * k + e));
                for axis in (0..3).filter(|axis| slope[*axis] != 0.0) {
                    let to = out.by_twist[3 * joint + axis].iter_mut();
                    to.zip(&column).for_each(|(to, v)| *to += slope[axis] * *v);
                }
            }
        }
    }
}

/// The terms of each part.
fn terms_of_parts(body: &BodyModel, influence: &Array2<f64>) -> Vec<PartTerms> {
    let template = &body.template;
    let markers = influence.ncols();
    // Triangles of one part that follow the same joints have terms of one form.
    let mut groups: BTreeMap<(usize, &[usize]), Vec<usize>> = BTreeMap::new();
    for (k, part) in template.face_parts.iter().enumerate() {
        let key = (*part, body.pose.joints[k].as_slice());
        groups.entry(key).or_default().push(k);
    }
    let mut parts: Vec<PartTerms> = (0..template.parts())
        .map(|part| {
            let of_part = groups.keys().filter(|(p, _)| *p == part);
            let mut joints: Vec<usize> = of_part.flat_map(|(_, j)| j.iter().copied()).collect();
            joints.sort_unstable();
            joints.dedup();
            let width = body.pose.inputs.width() * joints.len() + 1;
            PartTerms {
                by_shape: vec![Array2::zeros((3 * markers, width)); body.shape.len() + 1],
                joints,
            }
        })
        .collect();
    let tasks: Vec<(usize, &[usize], &[usize])> = (groups.iter())
        .flat_map(|((part, joints), faces)| faces.chunks(CHUNK).map(move |f| (*part, *joints, f)))
        .collect();
    let sums = parallel::map_chunks(tasks.len(), 1, |range| {
        let (_, _, faces) = tasks[range.start];
        terms_of_faces(body, influence, faces)
    });
    for ((part, joints, _), sum) in tasks.iter().zip(sums) {
        parts[*part].collect(body.pose.inputs.width(), joints, &sum);
    }
    parts
}

impl PartTerms {
    /// Adds the sums of triangles that follow `joints`: (m, b x t x 3) in this order.
    fn collect(&mut self, own: usize, joints: &[usize], sum: &Array2<f64>) {
        let width = own * joints.len() + 1;
        let mut columns: Vec<usize> = Vec::with_capacity(width);
        for joint in joints {
            let at = self.joints.iter().position(|j| j == joint).unwrap_or(0);
            columns.extend(own * at..own * (at + 1));
        }
        columns.push(own * self.joints.len());
        for (b, terms) in self.by_shape.iter_mut().enumerate() {
            for (t, column) in columns.iter().enumerate() {
                for axis in 0..3 {
                    let from = sum.column(3 * (b * width + t) + axis);
                    let mut to = terms.slice_mut(s![axis..;3, *column]);
                    to += &from;
                }
            }
        }
    }
}

/// What triangles of one form add, before their part is turned (m, b x t x 3).
fn terms_of_faces(body: &BodyModel, influence: &Array2<f64>, faces: &[usize]) -> Array2<f64> {
    let template = &body.template;
    let width = body.pose.inputs.width() * body.pose.joints[faces[0]].len() + 1;
    let columns = 3 * width * (body.shape.len() + 1);
    let mut pull = Array2::zeros((influence.ncols(), 2 * faces.len()));
    let mut edges = Array2::zeros((2 * faces.len(), columns));
    for (i, k) in faces.iter().enumerate() {
        let face = template.faces[*k];
        for e in 0..2 {
            let difference = &influence.row(face[e + 1]) - &influence.row(face[0]);
            pull.column_mut(2 * i + e).assign(&difference);
        }
        let bent: Vec<[DVec3; 2]> = (body.pose.terms(*k))
            .map(|q| template.edges[*k].map(|v| q * v))
            .collect();
        for (b, s) in body.shape.terms(*k).enumerate() {
            for (t, bent) in bent.iter().enumerate() {
                for e in 0..2 {
                    let v = s * bent[e];
                    for axis in 0..3 {
                        edges[[2 * i + e, 3 * (b * width + t) + axis]] = v[axis];
                    }
                }
            }
        }
    }
    pull.dot(&edges)
}
