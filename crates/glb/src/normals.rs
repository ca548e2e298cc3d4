//! Normals of a smooth surface.

use glam::DVec3;

/// The unit normal of each vertex: the sum of the normals of its triangles, by area. Upwards where
/// there is none.
pub(crate) fn smooth(vertices: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let at = |v: u32| DVec3::from(vertices[v as usize].map(f64::from));
    let mut sums = vec![DVec3::ZERO; vertices.len()];
    for face in faces {
        let [a, b, c] = face.map(at);
        // Twice the area long.
        let normal = (b - a).cross(c - a);
        face.iter().for_each(|v| sums[*v as usize] += normal);
    }
    let unit = |n: &DVec3| n.try_normalize().unwrap_or(DVec3::Y);
    sums.iter().map(|n| unit(n).as_vec3().to_array()).collect()
}
