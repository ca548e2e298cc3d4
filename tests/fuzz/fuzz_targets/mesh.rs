//! Meshes of each extension: checked, written, and read again.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::{Mesh, MeshFormat};
use posing_fuzz::{accepted, input};

fuzz_target!(|bytes: &[u8]| {
    for name in ["t.obj", "t.ply", "t.stl", "t"] {
        let mesh = input(name, bytes).and_then(Mesh::read);
        let Some(mesh) = accepted(mesh) else {
            continue;
        };
        let _ = mesh.check();
        for format in [MeshFormat::Obj, MeshFormat::Ply, MeshFormat::Stl] {
            let Some(written) = accepted(mesh.to_bytes(format)) else {
                continue;
            };
            let name = format!("t.{}", format.extension());
            let again = input(&name, &written).and_then(Mesh::read);
            // STL has triangles alone, of which a mesh may have none.
            if let (Some(again), false) = (accepted(again), format == MeshFormat::Stl) {
                assert_eq!(again.faces, mesh.faces);
                assert_eq!(again.vertices.len(), mesh.vertices.len());
            }
        }
    }
});
