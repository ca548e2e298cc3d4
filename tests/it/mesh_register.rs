//! The command `mesh-register` from outside.

use crate::common::{command, fails};
use glam::{DMat3, DVec3};
use posing::io::Mesh;
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// An oval column, 156 cm high, of so many rings and vertices a ring, open at both ends; then
/// `place`.
fn column(rings: u32, ring: u32, place: impl Fn(DVec3) -> DVec3) -> Mesh {
    let vertex = |v: u32| {
        let angle = std::f64::consts::TAU * f64::from(v % ring) / f64::from(ring);
        let height = 156.0 * f64::from(v / ring) / f64::from(rings - 1);
        place(DVec3::new(15.0 * angle.cos(), height, 11.0 * angle.sin())).to_array()
    };
    let quad = |v: u32| {
        let (a, b) = (v, v / ring * ring + (v + 1) % ring);
        [[a, a + ring, b], [b, a + ring, b + ring]]
    };
    Mesh {
        vertices: (0..rings * ring).map(vertex).collect(),
        faces: (0..(rings - 1) * ring).flat_map(quad).collect(),
    }
}

/// Where the scan has a point of the template, both in centimeters, y up: its axis is an arc, its
/// sections are turned and squeezed.
fn bent(v: DVec3) -> DVec3 {
    let curvature = 0.004;
    let angle = curvature * v.y;
    let axis = DVec3::new(0.0, angle.sin(), 1.0 - angle.cos()) / curvature;
    let section = DMat3::from_rotation_x(angle) * DVec3::new(1.05 * v.x, 0.0, 0.95 * v.z);
    DMat3::from_rotation_y(1.0) * (axis + section) + DVec3::new(30.0, 5.0, -8.0)
}

/// Centimeters, y up, to meters, z up.
fn meters(v: DVec3) -> DVec3 {
    DVec3::new(v.x, -v.z, v.y) / 100.0
}

const ON: [usize; 9] = [0, 8, 16, 365, 374, 480, 700, 940, 952];

/// Writes template.ply, scan.ply (meters, z up) and points.csv to a folder.
fn write_files(folder: &Path) {
    let template = column(40, 24, |v| v);
    template.save(folder.join("template.ply")).unwrap();
    let mut scan = column(97, 41, |v| meters(bent(v)));
    // A hole, and a loose piece far away.
    let shown = |f: &[u32; 3]| f.iter().all(|v| !(1000..1015).contains(v));
    scan.faces.retain(shown);
    let n = scan.vertices.len() as u32;
    scan.vertices
        .extend([[9.0, 0.0, 0.0], [9.1, 0.0, 0.0], [9.0, 0.1, 0.0]]);
    scan.faces.push([n, n + 1, n + 2]);
    scan.save(folder.join("scan.ply")).unwrap();
    let mut points = String::from("vertex,x,y,z\n");
    for v in ON {
        let [x, y, z] = meters(bent(DVec3::from_array(template.vertices[v]))).to_array();
        writeln!(points, "{v},{x},{y},{z}").unwrap();
    }
    fs::write(folder.join("points.csv"), points).unwrap();
}

fn args(folder: &Path, scan: &str) -> Vec<String> {
    let at = |name: &str| folder.join(name).display().to_string();
    let flags = [
        ("--template", at("template.ply")),
        ("--points", at("points.csv")),
        ("--units", "m".into()),
        ("--template-units", "cm".into()),
        ("--up", "z".into()),
        ("-o", at("out.ply")),
    ];
    let flags = flags.into_iter().flat_map(|(f, v)| [f.to_string(), v]);
    flags.chain([at(scan)]).collect()
}

fn refused(folder: &Path, scan: &str) -> String {
    let args = args(folder, scan);
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    fails("mesh-register", &args, b"", 1)
}

#[test]
fn the_template_is_laid_on_scans_and_clouds() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_files(folder);
    let mut cloud = Mesh::open(folder.join("scan.ply")).unwrap();
    cloud.faces.clear();
    cloud.save(folder.join("cloud.ply")).unwrap();
    let template = Mesh::open(folder.join("template.ply")).unwrap();
    for (scan, most) in [("scan.ply", 1.0), ("cloud.ply", 1.5)] {
        let done = command("mesh-register")
            .args(args(folder, scan))
            .assert()
            .success();
        let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
        assert!(said.contains("mean distance to the scan 0."), "{said}");
        assert!(
            said.contains("% of 960 vertices without scan data"),
            "{said}"
        );
        let found = Mesh::open(folder.join("out.ply")).unwrap();
        assert_eq!(found.faces, template.faces);
        let off = (found.vertices.iter().zip(&template.vertices)).map(|(found, v)| {
            let truth = meters(bent(DVec3::from_array(*v)));
            100.0 * (DVec3::from_array(*found) - truth).length()
        });
        let off = off.sum::<f64>() / 960.0;
        assert!(off <= most, "{scan}: {off} cm");
    }
}

/// Meshes in left-handed axes: their vertices by `carry`, their triangles the other way round.
fn mirrored(path: &Path, carry: impl Fn([f64; 3]) -> [f64; 3]) {
    let mut mesh = Mesh::open(path).unwrap();
    mesh.vertices.iter_mut().for_each(|v| *v = carry(*v));
    mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
    mesh.save(path).unwrap();
}

#[test]
fn left_handed_scans_are_registered_as_right_handed_ones() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_files(folder);
    let register = |flags: &[&str]| {
        let mut register = command("mesh-register");
        register.args(args(folder, "scan.ply")).args(flags);
        register.assert().success();
        Mesh::open(folder.join("out.ply")).unwrap()
    };
    let right = register(&[]);
    // The template's y and the scan's z are up.
    mirrored(&folder.join("template.ply"), |[x, y, z]| [-x, y, z]);
    mirrored(&folder.join("scan.ply"), |[x, y, z]| [x, -y, z]);
    let points = fs::read_to_string(folder.join("points.csv")).unwrap();
    let flipped = points.lines().map(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        let y = cells[2].parse::<f64>().map(|y| (-y).to_string());
        let y = y.unwrap_or_else(|_| cells[2].to_string());
        format!("{},{},{y},{}\n", cells[0], cells[1], cells[3])
    });
    fs::write(folder.join("points.csv"), flipped.collect::<String>()).unwrap();
    let left = register(&["--left-handed"]);
    let template = Mesh::open(folder.join("template.ply")).unwrap();
    assert!(left.faces == template.faces && left.faces != right.faces);
    for (own, wanted) in left.vertices.iter().zip(&right.vertices) {
        let shown = DVec3::new(own[0], -own[1], own[2]);
        assert!(shown.distance(DVec3::from_array(*wanted)) < 1e-6);
    }
}

#[test]
fn bad_input_is_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_files(folder);
    let good = fs::read_to_string(folder.join("points.csv")).unwrap();
    let with = |points: &str| {
        fs::write(folder.join("points.csv"), points).unwrap();
        refused(folder, "scan.ply")
    };
    let lines: Vec<&str> = good.lines().collect();
    let said = with(&lines[..4].join("\n"));
    assert!(
        said.contains("points.csv: has 3 points, expected 4 or more"),
        "{said}"
    );
    let said = with(&format!("{good}960,0,0,0\n"));
    assert!(
        said.contains("points.csv:11: names vertex 960, there are 960"),
        "{said}"
    );
    let said = with(&format!("{good}8,0,0,0\n"));
    assert!(
        said.contains("points.csv:11: places vertex 8 a second time"),
        "{said}"
    );
    let said = with(&format!("{good}9,0,nan,0\n"));
    assert!(
        said.contains("points.csv:11: expected a coordinate, found \"nan\""),
        "{said}"
    );
    let said = with(&format!("{good}9,0.3,0.5,0.9\n"));
    assert!(said.contains("points.csv:11: the point is"), "{said}");
    let hundredfold = |line: &&str| {
        let cells = line.split(',').enumerate();
        let cell = |(k, c): (usize, &str)| match (k, c.parse::<f64>()) {
            (1.., Ok(v)) => (100.0 * v).to_string(),
            _ => c.to_string(),
        };
        cells.map(cell).collect::<Vec<_>>().join(",")
    };
    let large: Vec<String> = lines.iter().map(hundredfold).collect();
    let said = with(&large.join("\n"));
    assert!(
        said.contains("check --units and --template-units"),
        "{said}"
    );
    fs::write(folder.join("points.csv"), &good).unwrap();
    fs::write(folder.join("empty.ply"), "").unwrap();
    assert!(refused(folder, "empty.ply").contains("empty.ply: is empty"));
    fs::write(folder.join("nan.obj"), "v 0 0 nan\n").unwrap();
    assert!(refused(folder, "nan.obj").contains("nan.obj:1"));
    // The template in meters would be 156 m high.
    let args = args(folder, "scan.ply");
    let args: Vec<&str> = (args.iter().map(String::as_str))
        .map(|a| if a == "cm" { "m" } else { a })
        .collect();
    let said = fails("mesh-register", &args, b"", 1);
    assert!(
        said.contains("template.ply: the largest extent is"),
        "{said}"
    );
}
