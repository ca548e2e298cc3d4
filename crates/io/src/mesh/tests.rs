pub(super) mod testdata;

use self::testdata::{cube, message, read};
use super::*;
use std::io::Write;

#[test]
fn each_format_round_trips() {
    for format in [MeshFormat::Obj, MeshFormat::Ply, MeshFormat::Stl] {
        let bytes = cube().to_bytes(format).unwrap();
        let name = format!("cube.{format:?}");
        let back = read(&name, &bytes).unwrap();
        assert_eq!(back, read("unnamed", &bytes).unwrap());
        assert_eq!(back.to_bytes(format).unwrap(), bytes);
        if format == MeshFormat::Stl {
            // The vertices are in another order; the triangles are where they were.
            assert_eq!((back.vertices.len(), back.faces.len()), (8, 12));
            let positions = |m: &Mesh| -> Vec<_> {
                let position = |f: &[u32; 3]| f.map(|v| m.vertices[v as usize]);
                m.faces.iter().map(position).collect()
            };
            assert_eq!(positions(&back), positions(&cube()));
        } else {
            assert_eq!(back, cube());
        }
    }
}

#[test]
fn files_are_saved_by_extension_and_read_compressed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cube.OBJ");
    cube().save(&path).unwrap();
    assert_eq!(Mesh::open(&path).unwrap(), cube());
    let error = cube().save(folder.path().join("cube.dae")).unwrap_err();
    assert!(matches!(error, Error::Usage(_)), "{error}");
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(&cube().to_bytes(MeshFormat::Stl).unwrap())
        .unwrap();
    let gz = gz.finish().unwrap();
    assert_eq!(read("a.stl.gz", &gz).unwrap().vertices.len(), 8);
    assert_eq!(read("no extension", &gz).unwrap().vertices.len(), 8);
}

#[test]
fn content_that_is_no_mesh() {
    assert_eq!(message("a.obj", ""), "a.obj: is empty, expected a mesh");
    assert!(message("a.obj", "hello\n").ends_with("has no vertices"));
    assert!(message("a.ply", "v 1 2 3\n").ends_with("as PLY files do"));
    assert!(message("a.obj", b"PK\x03\x04xxxxxxxxxxxx").contains("is a NumPy file"));
    // Content goes before the extension.
    let ply = cube().to_bytes(MeshFormat::Ply).unwrap();
    assert_eq!(read("a.obj", ply).unwrap(), cube());
}

#[test]
fn a_mesh_with_a_missing_vertex_is_not_written() {
    let mut mesh = cube();
    mesh.faces[3][1] = 8;
    for format in [MeshFormat::Obj, MeshFormat::Ply, MeshFormat::Stl] {
        let error = mesh.to_bytes(format).unwrap_err().to_string();
        assert!(error.contains("vertex 8"), "{error}");
    }
}

#[test]
fn random_bytes_are_refused_or_read() {
    use rand::{Rng, SeedableRng};
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    for format in [MeshFormat::Obj, MeshFormat::Ply, MeshFormat::Stl] {
        let sound = cube().to_bytes(format).unwrap();
        for _ in 0..2000 {
            let mut bytes = sound.clone();
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(0..bytes.len());
                bytes[at] = random.random();
            }
            bytes.truncate(random.random_range(0..=bytes.len()));
            if let Ok(mesh) = read(&format!("x.{format:?}"), bytes) {
                assert_eq!(check::missing_vertex(&mesh), None);
            }
        }
    }
}
