//! Whether a mesh is the template's, vertex by vertex.

use super::template::Template;
use glam::DVec3;

/// An edge is torn where it is so many times as long as the template's, or as short; a mesh is
/// another where this share of its edges is.
const TORN: f64 = 4.0;
const MOST_TORN: f64 = 0.05;
/// The least share of a ball's volume, of the same surface, that says which side is inside.
const LEAST_VOLUME: f64 = 0.02;

/// What is wrong with a template's faces; `None` where nothing is.
pub fn wrong_template(template: &Template) -> Option<String> {
    (volume(template, &template.vertices) < -LEAST_VOLUME).then(|| {
        "has its faces inside out: their corners must run anticlockwise as seen from outside; or \
         the mesh is mirrored"
            .to_string()
    })
}

/// Why the vertices of a mesh, as many as the template's, are not the template's; `None` where they
/// may be.
///
/// ```
/// use glam::DVec3;
/// use posing_body::{Template, correspondence::mismatch};
///
/// let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
/// let template = Template::new(vertices, vec![[0, 1, 2]], vec![0; 3])?;
/// assert_eq!(mismatch(&template, &template.vertices), None);
/// // Edges are a hundred times as long: another vertex stands there.
/// let other = [DVec3::ZERO, 100.0 * DVec3::X, DVec3::Y];
/// assert!(mismatch(&template, &other).is_some());
/// # Ok::<(), posing_core::Error>(())
/// ```
///
/// # Panics
/// The mesh has fewer vertices than the template.
pub fn mismatch(template: &Template, mesh: &[DVec3]) -> Option<String> {
    let torn = (template.surface().iter())
        .flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)])
        .filter(|(a, b)| {
            let ratio =
                mesh[*a].distance(mesh[*b]) / template.vertices[*a].distance(template.vertices[*b]);
            !(ratio < TORN && ratio > TORN.recip())
        });
    let share = torn.count() as f64 / (3 * template.surface().len()) as f64;
    if share > MOST_TORN {
        return Some(format!(
            "does not correspond to the first pose: {:.0}% of its edges are over {TORN} times as \
             long, or as short; are its vertices in another order?",
            100.0 * share
        ));
    }
    let [own, other] = [&template.vertices[..], mesh].map(|m| volume(template, m));
    (own > LEAST_VOLUME && other < -LEAST_VOLUME).then(|| {
        "is mirrored against the first pose: the volume inside of it is negative".to_string()
    })
}

/// The signed volume inside of a mesh with the template's faces, in volumes of a ball with its
/// surface.
fn volume(template: &Template, mesh: &[DVec3]) -> f64 {
    let middle = mesh.iter().sum::<DVec3>() / mesh.len() as f64;
    let (mut volume, mut area) = (0.0, 0.0);
    for face in template.surface() {
        let [a, b, c] = face.map(|v| mesh[v] - middle);
        volume += a.dot(b.cross(c)) / 6.0;
        area += (b - a).cross(c - a).length() / 2.0;
    }
    volume / (area.powf(1.5) / (6.0 * std::f64::consts::PI.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testdata::bending_body;

    #[test]
    fn permuted_mirrored_and_inside_out_meshes_are_told() {
        let template = bending_body().template;
        let own = template.vertices.clone();
        assert_eq!(mismatch(&template, &own), None);
        let mirrored: Vec<DVec3> = own.iter().map(|v| DVec3::new(-v.x, v.y, v.z)).collect();
        let permuted: Vec<DVec3> = (0..own.len()).map(|v| own[v * 29 % own.len()]).collect();
        assert!(mismatch(&template, &permuted).unwrap().contains("edges"));
        let says = [wrong_template(&template), mismatch(&template, &mirrored)];
        assert_eq!(says.iter().flatten().count(), 1, "{says:?}");
    }
}
