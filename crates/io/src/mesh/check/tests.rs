use super::super::tests::testdata::cube;
use super::*;

/// The finding of a cube that `damage` changes.
fn finding(damage: impl Fn(&mut Mesh)) -> Vec<Finding> {
    let mut mesh = cube();
    damage(&mut mesh);
    let found = mesh.check();
    for finding in &found {
        assert!(!finding.to_string().contains('\n'));
    }
    found
}

#[test]
fn a_cube_has_no_findings() {
    assert_eq!(finding(|_| {}), []);
}

#[test]
fn each_damage_is_found() {
    let empty = Mesh::default().check();
    assert_eq!(empty, [Finding::NoVertices, Finding::NoFaces]);
    assert_eq!(finding(|m| m.faces.clear()), [Finding::NoFaces]);
    let (count, first) = (1, 3);
    let nan = finding(|m| m.vertices[3][1] = f64::NAN);
    assert_eq!(nan, [Finding::NotFinite { count, first }]);
    let missing = finding(|m| m.faces[3][0] = 99);
    let expected = Finding::MissingVertex {
        face: 3,
        vertex: 99,
        vertices: 8,
    };
    assert_eq!(missing[0], expected);
    let equal = finding(|m| m.faces.push([1, 2, 1]));
    let first = 12;
    assert_eq!(equal, [Finding::EqualCorners { count, first }]);
    let flat = finding(|m| m.vertices[1] = m.vertices[0]);
    let flat_faces = flat
        .iter()
        .filter(|f| matches!(f, Finding::ZeroArea { .. }));
    assert_eq!(flat_faces.count(), 1);
}

#[test]
fn damaged_edges_are_found() {
    let hole = finding(|m| m.faces.truncate(11));
    let (count, open_edges) = (1, 3);
    assert_eq!(hole, [Finding::Holes { count, open_edges }]);
    let holes = finding(|m| {
        // Triangles of opposite sides: no common vertex.
        let at = m
            .faces
            .iter()
            .position(|f| f.contains(&7) && !f.contains(&0));
        let far = m.faces.remove(at.unwrap());
        let apart = |f: &[u32; 3]| f.iter().all(|v| !far.contains(v));
        let at = m.faces.iter().position(apart).unwrap();
        m.faces.remove(at);
    });
    let (count, open_edges) = (2, 6);
    assert_eq!(holes, [Finding::Holes { count, open_edges }]);
    let flipped = finding(|m| m.faces[4].reverse());
    assert!(
        matches!(flipped[..], [Finding::Flipped { count: 3, .. }]),
        "{flipped:?}"
    );
    let doubled = finding(|m| {
        m.vertices.push([2.0; 3]);
        m.faces.push([0, 1, 8]);
    });
    let expected = Finding::NonManifold {
        count: 1,
        first: [0, 1],
    };
    let (count, open_edges) = (1, 2);
    let holes = Finding::Holes { count, open_edges };
    assert_eq!(doubled, [expected, holes]);
}

#[test]
fn the_size_of_a_body() {
    let mut mesh = cube();
    mesh.vertices.iter_mut().for_each(|v| v[2] *= 1.75);
    assert!(mesh.plausible_height(1.0).is_ok());
    let text = mesh.plausible_height(0.01).unwrap_err().to_string();
    let expected = "the largest extent is 0.02 m, expected 0.5 to 2.6 m for a body; with the \
                    option `units m` it is 1.75 m";
    assert_eq!(text, expected);
    mesh.vertices.iter_mut().for_each(|v| v[2] *= 1e9);
    let text = mesh.plausible_height(1.0).unwrap_err().to_string();
    assert!(
        text.contains("1.75e9 m") && text.ends_with("the option `units`"),
        "{text}"
    );
    assert!(Mesh::default().plausible_height(1.0).is_err());
    mesh.vertices[0][0] = f64::NAN;
    assert!(mesh.plausible_height(1.0).is_err());
}
