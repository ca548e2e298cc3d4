//! Meshes that the tests of the commands read.

use posing::io::npy::header_of;
use posing::io::{Mesh, MeshFormat};
use std::io::Write;
use std::path::Path;

/// A closed mesh of eight triangles, 2 m high and in meters, turned by an angle (radians) about the
/// vertical.
pub fn octahedron(turned: f64) -> Mesh {
    let (sin, cos) = turned.sin_cos();
    let around = [[cos, sin], [-sin, cos], [-cos, -sin], [sin, -cos]];
    let mut vertices = vec![[0.0, 2.0, 0.0], [0.0, 0.0, 0.0]];
    vertices.extend(around.map(|[x, z]| [0.4 * x, 1.0, 0.4 * z]));
    let quarter = |i: u32| {
        let (a, b) = (2 + i, 2 + (i + 1) % 4);
        [[0, b, a], [1, a, b]]
    };
    Mesh {
        vertices,
        faces: (0..4).flat_map(quarter).collect(),
    }
}

/// A single triangle, as the text of an OBJ file.
pub const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// Writes an archive with the same sequence of meshes in each of some arrays, and their faces.
pub fn archive(path: &Path, arrays: &[&str], meshes: &[Mesh]) {
    let mut zip = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    let mut add = |name: &str, descr: &str, shape: &[usize], bytes: Vec<u8>| {
        let options = zip::write::SimpleFileOptions::default();
        zip.start_file(format!("{name}.npy"), options).unwrap();
        zip.write_all(&header_of(descr, shape)).unwrap();
        zip.write_all(&bytes).unwrap();
    };
    let values = meshes.iter().flat_map(|m| m.vertices.concat());
    let values: Vec<u8> = values.flat_map(|v| (v as f32).to_le_bytes()).collect();
    for name in arrays {
        let shape = [meshes.len(), meshes[0].vertices.len(), 3];
        add(name, "<f4", &shape, values.clone());
    }
    let corners = meshes[0].faces.concat();
    let bytes = corners.iter().flat_map(|v| v.to_le_bytes()).collect();
    add("faces", "<u4", &[corners.len() / 3, 3], bytes);
    zip.finish().unwrap();
}

/// Writes the meshes that the examples of the help texts name.
pub fn of_examples(folder: &Path) {
    let turned: Vec<Mesh> = (0..3).map(|i| octahedron(0.2 * f64::from(i))).collect();
    turned[0].save(folder.join("scan.obj")).unwrap();
    let body = turned[1].to_bytes(MeshFormat::Ply).unwrap();
    std::fs::write(folder.join("body.ply"), body).unwrap();
    std::fs::create_dir_all(folder.join("scans")).unwrap();
    for (i, mesh) in turned.iter().enumerate() {
        mesh.save(folder.join(format!("scans/{i}.obj"))).unwrap();
    }
    archive(&folder.join("bodies.npz"), &["vertices"], &turned);
    archive(
        &folder.join("fits.npz"),
        &["completed", "predicted"],
        &turned,
    );
}
