//! Weights of morph targets between 0 and 1, for software that clamps them.
//!
//! With a ≤ 0 and b the least and the largest weight c of a target s in all animations,
//!
//! ```text
//! c s = a s + (c - a) / (b - a) · (b - a) s
//! ```
//!
//! so the target becomes (b - a) s, and one more target, which all animations hold at 1, carries
//! the sum of all a s.

use super::{Shape, SkinnedMesh};
use glam::DVec3;

/// The name of the target that is added.
const OFFSET: &str = "offset";

impl SkinnedMesh {
    /// Scales and shifts morph targets so that all animations keep weights from 0 to 1 and look as
    /// before; the rest pose stays. Where weights fall below 0, one target with the name
    /// `offset` is added.
    ///
    /// Blender's importer clamps weights that are negative or above 1 (glTF-Blender-IO, issue
    /// 1364), Unity may. Targets whose weights lie from 0 to 1 are left as they are, so a
    /// second call changes nothing.
    pub fn unit_weights(&mut self) {
        let ranges: Vec<(f64, f64)> = (0..self.shapes.len()).map(|k| self.range(k)).collect();
        let mut offset = vec![DVec3::ZERO; self.vertices.len()];
        for (shape, (least, largest)) in self.shapes.iter_mut().zip(&ranges) {
            for (at, sum) in shape.offsets.iter_mut().zip(&mut offset) {
                let s = DVec3::from(at.map(f64::from));
                *sum += *least * s;
                *at = ((largest - least) * s).as_vec3().to_array();
            }
        }
        let shifted = ranges.iter().any(|(least, _)| *least < 0.0);
        if shifted {
            self.shapes.push(Shape {
                name: OFFSET.into(),
                offsets: offset.iter().map(|s| s.as_vec3().to_array()).collect(),
            });
        }
        for weights in self.animations.iter_mut().flat_map(|a| &mut a.weights) {
            for (weight, (least, largest)) in weights.iter_mut().zip(&ranges) {
                let unit = (f64::from(*weight) - least) / (largest - least);
                *weight = unit as f32;
            }
            weights.extend(shifted.then_some(1.0));
        }
    }

    /// The least weight of a target in all animations, or 0, and the largest; (0, 1) where that
    /// range holds them all.
    fn range(&self, k: usize) -> (f64, f64) {
        let weights = self.animations.iter().flat_map(|a| &a.weights);
        let (least, largest) = (weights.filter_map(|w| w.get(k))).fold((0.0, 0.0), |(a, b), w| {
            (f64::min(a, f64::from(*w)), f64::max(b, f64::from(*w)))
        });
        if least >= 0.0 && largest <= 1.0 {
            (0.0, 1.0)
        } else {
            (least, largest)
        }
    }
}
