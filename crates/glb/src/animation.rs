//! Animations of bones and morph targets.

use super::Bone;
use glam::{DMat3, DQuat, DVec3};

/// Keys of bones and morph targets, between which software interpolates: rotations along the
/// shortest arc, all else linearly.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Animation {
    /// The name that animation software shows.
    pub name: String,
    /// The time of each key (T), seconds, rising, from 0 or later.
    pub times: Vec<f32>,
    /// For each bone, at each key, the rotation relative to the parent as a quaternion x, y, z, w
    /// (B, T). Empty: bones keep the rest pose's.
    pub rotations: Vec<Vec<[f32; 4]>>,
    /// For each bone, at each key, its position in the axes of its parent, meters (B, T). Empty:
    /// bones keep the rest pose's.
    pub translations: Vec<Vec<[f32; 3]>>,
    /// At each key the weights of the morph targets (T, K). Empty: all are 0.
    pub weights: Vec<Vec<f32>>,
}

impl Animation {
    /// An animation from the rotation since the rest pose and the position (meters) of each bone in
    /// the world at each key, both (T, B). Morph targets are left at 0.
    ///
    /// With the axes A of the rest pose and G = R A, bone b has the rotation G_pᵀ G_b and the
    /// position G_pᵀ (x_b - x_p), relative to its parent p.
    ///
    /// # Panics
    /// A key has fewer rotations or positions than there are bones, or a bone names a parent that
    /// is not there.
    #[doc(hidden)]
    pub fn from_world(
        name: impl Into<String>,
        bones: &[Bone],
        times: Vec<f32>,
        rotations: &[Vec<DMat3>],
        positions: &[Vec<DVec3>],
    ) -> Animation {
        let axes: Vec<DMat3> = bones.iter().map(Bone::axes).collect();
        let turned = |b: usize, key: usize| rotations[key][b] * axes[b];
        let parent_of = |b: usize, key: usize| match bones[b].parent {
            Some(p) => (turned(p, key).transpose(), positions[key][p]),
            None => (DMat3::IDENTITY, DVec3::ZERO),
        };
        let rotation = |b: usize, key: usize| {
            let relative = parent_of(b, key).0 * turned(b, key);
            DQuat::from_mat3(&relative).normalize().as_quat().to_array()
        };
        let position = |b: usize, key: usize| {
            let (back, origin) = parent_of(b, key);
            (back * (positions[key][b] - origin)).as_vec3().to_array()
        };
        let bones = 0..bones.len();
        Animation {
            name: name.into(),
            rotations: bones
                .clone()
                .map(|b| (0..times.len()).map(|key| rotation(b, key)).collect())
                .collect(),
            translations: bones
                .map(|b| (0..times.len()).map(|key| position(b, key)).collect())
                .collect(),
            weights: Vec::new(),
            times,
        }
    }
}
