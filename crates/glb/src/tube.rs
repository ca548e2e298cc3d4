//! Tubes with round ends along chains of bones: elliptical cross-sections that follow the bones on
//! either side of a joint.

use super::SkinnedMesh;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Cross-sections between two of a profile.
const BETWEEN: usize = 3;
/// Tubes whose half widths are all below this, cm, are thin.
const THIN: f64 = 2.5;
/// The reach of a joint: a share of the shorter bone at it, and at most so many centimeters.
const REACH: (f64, f64) = (0.35, 6.0);

/// A position along a chain, in the rest pose, cm, and the bone that the piece after it turns with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Knot {
    pub at: DVec3,
    pub bone: u16,
}

/// The half widths of a cross-section at a share of a chain's length, cm: toward the side, and
/// across.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Width {
    pub share: f64,
    pub wide: f64,
    pub deep: f64,
}

/// An elliptical cross-section, cm.
#[derive(Debug, Clone, Copy)]
struct Ring {
    at: DVec3,
    /// The half axes; crossed, they point along the tube.
    wide: DVec3,
    deep: DVec3,
    weights: [(u16, f32); 4],
}

/// How finely a tube is divided: vertices around it, and cross-sections of each round end.
#[derive(Debug, Clone, Copy)]
struct Division {
    around: usize,
    cap: usize,
}

const FINE: Division = Division { around: 16, cap: 4 };
const COARSE: Division = Division { around: 8, cap: 2 };

/// Weights that follow one bone.
fn rigid(bone: u16) -> [(u16, f32); 4] {
    [(bone, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)]
}

/// Adds a tube along `knots` with the widths of `profile`, whose shares rise from 0 to 1; `side` is
/// the direction of the half widths `wide`. Chains without a length have none.
pub(crate) fn push_tube(mesh: &mut SkinnedMesh, knots: &[Knot], profile: &[Width], side: DVec3) {
    let Some(chain) = Chain::of(knots) else {
        return;
    };
    let is_thin = profile.iter().all(|w| w.wide < THIN && w.deep < THIN);
    let division = if is_thin { COARSE } else { FINE };
    let cap_rings = division.cap;
    let mut shares: Vec<f64> = Vec::new();
    for pair in profile.windows(2) {
        let step = (pair[1].share - pair[0].share) / BETWEEN as f64;
        shares.extend((0..BETWEEN).map(|k| pair[0].share + k as f64 * step));
    }
    shares.push(1.0);
    let middle = shares.iter().map(|s| chain.ring(*s, profile, side));
    let middle: Vec<Ring> = middle.collect();
    // Each end closes in a quarter of an ellipse.
    let cap = |ring: &Ring, outwards: f64, k: usize| {
        let (sin, cos) = (k as f64 / cap_rings as f64 * FRAC_PI_2).sin_cos();
        let along = ring.wide.cross(ring.deep).normalize_or_zero();
        let reach = outwards * ring.wide.length().min(ring.deep.length());
        Ring {
            at: ring.at + reach * sin * along,
            wide: ring.wide * cos,
            deep: ring.deep * cos,
            ..*ring
        }
    };
    let (first, last) = (&middle[0], &middle[middle.len() - 1]);
    let rings = (1..=cap_rings).rev().map(|k| cap(first, -1.0, k));
    let rings = rings.chain(middle.iter().copied());
    let rings: Vec<Ring> = rings
        .chain((1..=cap_rings).map(|k| cap(last, 1.0, k)))
        .collect();
    push_rings(mesh, &rings, division.around);
}

/// Adds an ellipsoid that follows one bone; the half axes, cm, are right-handed.
pub(crate) fn push_ellipsoid(mesh: &mut SkinnedMesh, center: DVec3, half: [DVec3; 3], bone: u16) {
    let ring = |k: usize| {
        let (sin, cos) = ((k as f64 / FINE.cap as f64 - 1.0) * FRAC_PI_2).sin_cos();
        Ring {
            at: center + sin * half[2],
            wide: cos * half[0],
            deep: cos * half[1],
            weights: rigid(bone),
        }
    };
    let rings: Vec<Ring> = (0..=2 * FINE.cap).map(ring).collect();
    push_rings(mesh, &rings, FINE.around);
}

/// Adds the surface of rings, of which the first and the last are points.
fn push_rings(mesh: &mut SkinnedMesh, rings: &[Ring], around: usize) {
    let mut push = |at: DVec3, weights| {
        mesh.vertices.push((at / 100.0).as_vec3().to_array());
        mesh.weights.push(weights);
        mesh.vertices.len() as u32 - 1
    };
    let (start, end) = (&rings[0], &rings[rings.len() - 1]);
    let start = push(start.at, start.weights);
    let open = &rings[1..rings.len() - 1];
    for ring in open {
        for i in 0..around {
            let (sin, cos) = (i as f64 / around as f64 * TAU).sin_cos();
            push(ring.at + cos * ring.wide + sin * ring.deep, ring.weights);
        }
    }
    let end = push(end.at, end.weights);
    let corner = |ring: usize, i: usize| start + 1 + (ring * around + i % around) as u32;
    for i in 0..around {
        mesh.faces.push([start, corner(0, i + 1), corner(0, i)]);
        for ring in 1..open.len() {
            let [a, b] = [corner(ring - 1, i), corner(ring - 1, i + 1)];
            let [c, d] = [corner(ring, i + 1), corner(ring, i)];
            mesh.faces.extend([[a, b, c], [a, c, d]]);
        }
        let last = open.len() - 1;
        mesh.faces.push([end, corner(last, i), corner(last, i + 1)]);
    }
}

/// A chain of straight pieces.
struct Chain {
    knots: Vec<Knot>,
    /// How far along the chain each knot is, cm.
    arcs: Vec<f64>,
}

impl Chain {
    /// The knots that are apart from the one before; `None` if fewer than two are.
    fn of(knots: &[Knot]) -> Option<Chain> {
        let mut chain = Chain {
            knots: Vec::new(),
            arcs: Vec::new(),
        };
        for knot in knots {
            let mut arc = 0.0;
            if let (Some(last), Some(before)) = (chain.knots.last_mut(), chain.arcs.last()) {
                let step = (knot.at - last.at).length();
                if step < 1e-6 {
                    last.bone = knot.bone;
                    continue;
                }
                arc = before + step;
            }
            chain.knots.push(*knot);
            chain.arcs.push(arc);
        }
        (chain.knots.len() > 1).then_some(chain)
    }

    /// How far a joint between two pieces reaches along them, cm.
    fn reach(&self, joint: usize) -> f64 {
        let before = self.arcs[joint] - self.arcs[joint - 1];
        let after = self.arcs[joint + 1] - self.arcs[joint];
        (REACH.0 * before.min(after)).min(REACH.1)
    }

    /// The two pieces that a position follows, and the weight of the second.
    fn pieces(&self, arc: f64) -> (usize, usize, f64) {
        for joint in 1..self.knots.len() - 1 {
            let reach = self.reach(joint);
            if arc <= self.arcs[joint] - reach {
                return (joint - 1, joint - 1, 0.0);
            }
            if arc < self.arcs[joint] + reach {
                let t = (arc - self.arcs[joint] + reach) / (2.0 * reach);
                return (joint - 1, joint, t * t * (3.0 - 2.0 * t));
            }
        }
        let last = self.knots.len() - 2;
        (last, last, 0.0)
    }

    fn ring(&self, share: f64, profile: &[Width], side: DVec3) -> Ring {
        let arc = share * self.arcs[self.arcs.len() - 1];
        let ends = self.arcs[1..self.arcs.len() - 1].iter();
        let piece = ends.take_while(|a| **a <= arc).count();
        let direction = |p: usize| (self.knots[p + 1].at - self.knots[p].at).normalize();
        let (a, b, t) = self.pieces(arc);
        let along = direction(a)
            .lerp(direction(b), t)
            .normalize_or(direction(a));
        let wide = (side - side.dot(along) * along).normalize_or(along.any_orthonormal_vector());
        let (wide_by, deep_by) = widths(profile, share);
        let (first, second) = (self.knots[a].bone, self.knots[b].bone);
        let mut weights = rigid(first);
        if first != second {
            weights[0].1 = (1.0 - t) as f32;
            weights[1] = (second, t as f32);
        }
        Ring {
            at: self.knots[piece].at + (arc - self.arcs[piece]) * direction(piece),
            wide: wide_by * wide,
            deep: deep_by * along.cross(wide),
            weights,
        }
    }
}

/// The half widths at a share of the length, linear between those of the profile.
fn widths(profile: &[Width], share: f64) -> (f64, f64) {
    let after = profile.iter().position(|w| w.share >= share);
    let after = after.unwrap_or(profile.len() - 1).max(1);
    let (a, b) = (profile[after - 1], profile[after]);
    let t = (share - a.share) / (b.share - a.share);
    let between = |a: f64, b: f64| a + t * (b - a);
    (between(a.wide, b.wide), between(a.deep, b.deep))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six times the volume inside a closed surface, which is positive if it faces outwards.
    fn volume(mesh: &SkinnedMesh) -> f64 {
        let at = |v: u32| DVec3::from(mesh.vertices[v as usize].map(f64::from));
        let of = |f: &[u32; 3]| at(f[0]).dot(at(f[1]).cross(at(f[2])));
        mesh.faces.iter().map(of).sum()
    }

    fn bent(second: DVec3) -> [Knot; 3] {
        let knot = |at, bone| Knot { at, bone };
        [
            knot(DVec3::ZERO, 4),
            knot(DVec3::Y * 30.0, 7),
            knot(second, 0),
        ]
    }

    const EVEN: [Width; 2] = [
        Width {
            share: 0.0,
            wide: 5.0,
            deep: 4.0,
        },
        Width {
            share: 1.0,
            wide: 5.0,
            deep: 4.0,
        },
    ];

    #[test]
    fn a_tube_is_closed_and_faces_outwards() {
        for second in [DVec3::Y * 60.0, DVec3::new(0.0, 50.0, 20.0)] {
            let mut mesh = SkinnedMesh::default();
            push_tube(&mut mesh, &bent(second), &EVEN, DVec3::X);
            // Euler: a sphere.
            assert_eq!(mesh.vertices.len() - mesh.faces.len() / 2, 2);
            assert!(volume(&mesh) > 0.0);
            let widest = mesh.vertices.iter().map(|v| v[0]).fold(0.0, f32::max);
            assert!((widest - 0.05).abs() < 1e-6);
        }
        let mut mesh = SkinnedMesh::default();
        let half = [DVec3::X, DVec3::Y, DVec3::Z * 2.0];
        push_ellipsoid(&mut mesh, DVec3::ZERO, half, 3);
        assert!(volume(&mesh) > 0.0);
    }

    #[test]
    fn vertices_near_a_joint_follow_both_bones() {
        let mut mesh = SkinnedMesh::default();
        push_tube(&mut mesh, &bent(DVec3::Y * 60.0), &EVEN, DVec3::X);
        for (vertex, weights) in mesh.vertices.iter().zip(&mesh.weights) {
            let y = 100.0 * vertex[1];
            match y {
                y if y < 23.9 => assert_eq!(weights[0], (4, 1.0)),
                y if y > 36.1 => assert_eq!(weights[0], (7, 1.0)),
                _ => {
                    assert_eq!((weights[0].0, weights[1].0), (4, 7));
                    assert!((weights[0].1 + weights[1].1 - 1.0).abs() < 1e-6);
                }
            }
        }
    }

    #[test]
    fn a_chain_without_a_length_has_no_tube() {
        let mut mesh = SkinnedMesh::default();
        let one = bent(DVec3::Y)[0];
        push_tube(&mut mesh, &[one, one], &EVEN, DVec3::X);
        push_tube(&mut mesh, &[], &EVEN, DVec3::X);
        assert!(mesh.vertices.is_empty());
        // A side along the tube is none.
        push_tube(&mut mesh, &bent(DVec3::Y * 60.0), &EVEN, DVec3::Y);
        assert!(mesh.vertices.iter().flatten().all(|v| v.is_finite()));
    }
}
