//! The joints of a pose table as points on a body.

use super::marker_model::Marker;
use super::template::Template;
use glam::DVec3;

/// Where each of the points named by `joints` (part, point) is on the body: the first point of a
/// part where the part begins, at its border toward the root; a second one at its far end, the
/// vertex farthest from there. The root's first point is its middle.
pub fn joint_markers(template: &Template, joints: &[(usize, String)]) -> Vec<Marker> {
    let is_second = |k: usize| joints[..k].iter().any(|(part, _)| *part == joints[k].0);
    let marker = |k: usize| {
        let part = joints[k].0;
        let vertices = if is_second(k) {
            vec![(far_end(template, part), 1.0)]
        } else {
            mean_of(start(template, part))
        };
        Marker {
            vertices,
            offset: DVec3::ZERO,
        }
    };
    (0..joints.len()).map(marker).collect()
}

/// The vertices of the border between a part and the one that it hangs on; of the root all of its
/// own.
fn start(template: &Template, part: usize) -> Vec<usize> {
    let parent = (template.joints.iter()).find(|j| j.parts[1] == part);
    let of_part = |k: &usize, p: usize| template.face_parts[*k] == p;
    let mut border: Vec<usize> = match parent {
        Some(joint) => (template.neighbors.iter())
            .filter(|[a, b]| {
                let [p, q] = joint.parts;
                of_part(a, p) && of_part(b, q) || of_part(a, q) && of_part(b, p)
            })
            .flat_map(|[a, b]| {
                let shared = template.faces[*a].into_iter();
                shared.filter(|v| template.faces[*b].contains(v))
            })
            .collect(),
        None => (0..template.vertices.len())
            .filter(|v| template.vertex_parts[*v] == part)
            .collect(),
    };
    border.sort_unstable();
    border.dedup();
    border
}

fn mean_of(vertices: Vec<usize>) -> Vec<(usize, f64)> {
    let weight = 1.0 / vertices.len().max(1) as f64;
    vertices.into_iter().map(|v| (v, weight)).collect()
}

fn far_end(template: &Template, part: usize) -> usize {
    let start = start(template, part);
    let middle = start.iter().map(|v| template.vertices[*v]).sum::<DVec3>() / start.len() as f64;
    let own = (0..template.vertices.len()).filter(|v| template.vertex_parts[*v] == part);
    let far = |v: &usize| (template.vertices[*v] - middle).length_squared();
    own.max_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::template::tests::column;

    #[test]
    fn a_part_begins_at_its_border_and_ends_far_from_it() {
        let template = column(8);
        let root = template.root();
        let top = 1 - root;
        let joints = [(root, "hip"), (top, "neck"), (top, "head")];
        let joints = joints.map(|(part, name)| (part, name.to_string()));
        let markers = joint_markers(&template, &joints);
        let at = |m: &Marker| -> DVec3 {
            m.vertices
                .iter()
                .map(|(v, w)| template.vertices[*v] * *w)
                .sum()
        };
        assert!((at(&markers[1]).y - template.joints[0].at.y).abs() < 0.51);
        let end = if top == 1 { 7.0 } else { 0.0 };
        assert_eq!(at(&markers[2]).y, end);
        assert!(markers[0].vertices.len() > 8);
    }
}
