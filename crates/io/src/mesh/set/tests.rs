use super::super::tests::testdata::cube;
use super::*;
use crate::npy::header_of;
use std::io::Write;
use tempfile::TempDir;

/// An archive of arrays, each the type, the shape and the bytes.
fn npz(folder: &TempDir, arrays: &[(&str, &str, &[usize], Vec<u8>)]) -> PathBuf {
    let path = folder.path().join("bodies.npz");
    let mut zip = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
    for (name, descr, shape, values) in arrays {
        let options = zip::write::SimpleFileOptions::default();
        zip.start_file(format!("{name}.npy"), options).unwrap();
        zip.write_all(&header_of(descr, shape)).unwrap();
        zip.write_all(values).unwrap();
    }
    zip.finish().unwrap();
    path
}

fn floats(copies: usize) -> Vec<u8> {
    let one = cube().vertices.concat();
    let all = one.repeat(copies);
    all.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect()
}

fn wide_faces() -> Vec<u8> {
    let all = cube().faces.concat();
    all.iter()
        .flat_map(|v| i64::from(*v).to_le_bytes())
        .collect()
}

fn message(paths: &[PathBuf]) -> String {
    let text = MeshSet::open(paths).unwrap_err().to_string();
    assert!(!text.contains('\n'), "{text}");
    text
}

#[test]
fn folders_files_and_archives_make_one_set() {
    let folder = tempfile::tempdir().unwrap();
    let scans = folder.path().join("scans");
    std::fs::create_dir(&scans).unwrap();
    let mut tall = cube();
    tall.vertices.iter_mut().for_each(|v| v[1] *= 1.5);
    tall.save(scans.join("b.obj")).unwrap();
    cube().save(scans.join("a.ply")).unwrap();
    std::fs::write(scans.join("notes.txt"), "x").unwrap();
    let archive = npz(
        &folder,
        &[
            ("vertices", "<f4", &[2, 8, 3], floats(2)),
            ("faces", "<i8", &[12, 3], wide_faces()),
            ("other", "<i8", &[1], vec![0; 8]),
        ],
    );
    let file = scans.join("b.obj");
    let set = MeshSet::open(&[scans.clone(), archive.clone(), file.clone()]).unwrap();
    let names = [
        scans.join("a.ply").display().to_string(),
        file.display().to_string(),
        format!("{}[0]", archive.display()),
        format!("{}[1]", archive.display()),
        file.display().to_string(),
    ];
    assert_eq!(set.names, names);
    assert_eq!(set.vertices.dim(), (5, 8, 3));
    assert_eq!((set.mesh(0), set.mesh(4)), (cube(), tall));
    assert_eq!(set.mesh(3), cube());
}

#[test]
fn another_topology_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    cube().save(path("a.obj")).unwrap();
    let mut mesh = cube();
    mesh.faces[5].rotate_left(1);
    mesh.save(path("turned.obj")).unwrap();
    mesh.faces.pop();
    mesh.save(path("fewer.obj")).unwrap();
    mesh.vertices.push([0.0; 3]);
    mesh.save(path("more.obj")).unwrap();
    for (name, expected) in [
        ("turned.obj", "face 5 is ["),
        ("fewer.obj", "has 11 faces, "),
        ("more.obj", "has 9 vertices, "),
    ] {
        let text = message(&[path("a.obj"), path(name)]);
        let both = text.contains("a.obj") && text.contains(name);
        assert!(both && text.contains(expected), "{text}");
    }
}

#[test]
fn the_first_array_that_an_archive_has_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let shape = &[1, 8, 3][..];
    let archive = npz(
        &folder,
        &[
            ("predicted", "<f4", shape, floats(1)),
            ("faces", "<i8", &[12, 3], wide_faces()),
        ],
    );
    let (set, chosen) = MeshSet::open_array(&archive, &["vertices", "predicted"]).unwrap();
    assert_eq!((set.mesh(0), chosen), (cube(), 1));
    let error = MeshSet::open_array(&archive, &["vertices", "completed"]).unwrap_err();
    let expected = "vertices or completed: the archive has no such array";
    assert!(error.to_string().contains(expected), "{error}");
    let file = folder.path().join("a.obj");
    cube().save(&file).unwrap();
    let error = MeshSet::open_array(&file, &["vertices"]).unwrap_err();
    assert!(error.to_string().contains("is no NPZ archive"), "{error}");
}

#[test]
fn bad_archives_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let vertices = ("vertices", "<f4", &[1, 8, 3][..], floats(1));
    let faces = ("faces", "<i8", &[12, 3][..], wide_faces());
    let case = |arrays: &[_], expected: &str| {
        let text = message(&[npz(&folder, arrays)]);
        assert!(text.contains(expected), "{text}");
    };
    case(std::slice::from_ref(&vertices), "faces: the archive has no");
    case(std::slice::from_ref(&faces), "vertices: the archive has no");
    let bad = |shape, bytes| [("vertices", "<f4", shape, bytes), faces.clone()];
    case(&bad(&[24], floats(1)), "has the shape [24]");
    case(&bad(&[2, 8, 3], floats(1)), "vertices: ends before");
    case(&bad(&[1, 8, 3], floats(2)), "has more bytes");
    case(&bad(&[1 << 40, 1 << 40, 3], vec![]), "larger than 8 GiB");
    case(&bad(&[1, 7, 3], floats(1)[..84].to_vec()), "names vertex 7");
    let mut nan = f32::NAN.to_le_bytes().repeat(24);
    case(&bad(&[1, 8, 3], nan.clone()), "has no meshes");
    // A frame in which nothing is known is left out, and numbers go on.
    let [absent, present] = [nan.clone(), floats(1)];
    let frames = (
        "vertices",
        "<f4",
        &[2, 8, 3][..],
        [absent, present].concat(),
    );
    let set = MeshSet::open(&[npz(&folder, &[frames, faces.clone()])]).unwrap();
    assert_eq!(set.mesh(0), cube());
    assert!(set.names[0].ends_with("[1]"), "{:?}", set.names);
    nan[..4].copy_from_slice(&1f32.to_le_bytes());
    case(&bad(&[1, 8, 3], nan), "mesh 0, vertex 0");
    let text = ("faces", "<f8", &[12, 3][..], wide_faces());
    case(&[vertices.clone(), text], "faces: has values of type <f8");
    let flat = ("faces", "<i8", &[36][..], wide_faces());
    case(&[vertices, flat], "faces: has the shape [36]");
}

#[test]
fn nothing_to_read() {
    let folder = tempfile::tempdir().unwrap();
    assert!(message(&[folder.path().into()]).contains("has no mesh files"));
    assert!(matches!(MeshSet::open::<&str>(&[]), Err(Error::Usage(_))));
    let path = folder.path().join("bodies.npz");
    std::fs::write(&path, b"PK\x03\x04 not an archive").unwrap();
    assert!(message(&[path]).contains("damaged NPZ"));
}
