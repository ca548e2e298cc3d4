//! The command `plot` from outside, on meshes.

use crate::common::meshes::{TRIANGLE, archive, octahedron, of_examples};
use crate::common::{fails, run};
use serde_json::Value;
use std::path::Path;
use tempfile::TempDir;

/// A folder with meshes, and the paths of files in it.
struct Meshes(TempDir);

impl Meshes {
    fn new() -> Meshes {
        let folder = tempfile::tempdir().unwrap();
        of_examples(folder.path());
        Meshes(folder)
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    fn file(&self, name: &str, content: &[u8]) -> String {
        std::fs::write(self.0.path().join(name), content).unwrap();
        self.path(name)
    }

    /// What `plot` prints about files, after other arguments.
    fn plot(&self, args: &[&str], files: &[&str]) -> String {
        let files: Vec<String> = files.iter().map(|f| self.path(f)).collect();
        let mut all = args.to_vec();
        all.extend(files.iter().map(String::as_str));
        run("plot", &all, "")
    }
}

fn scene(page: &str) -> Value {
    let (_, after) = page
        .split_once("<script type=\"application/json\">")
        .unwrap();
    serde_json::from_str(after.split("</script").next().unwrap()).unwrap()
}

fn names(scene: &Value) -> Vec<&str> {
    let figures = scene["figures"].as_array().unwrap().iter();
    figures.map(|f| f["name"].as_str().unwrap()).collect()
}

#[test]
fn files_folders_and_archives_become_a_picture() {
    let meshes = Meshes::new();
    let svg = meshes.plot(&["--to", "svg"], &["scan.obj", "body.ply"]);
    assert!(
        svg.starts_with("<svg") && svg.contains(">scan</text>") && svg.contains(">body</text>")
    );
    // Two sides of each octahedron are toward the viewer and above, two below.
    assert_eq!(svg.matches("<g transform").count(), 2);
    assert!(
        !svg.contains(" cm<") && !svg.contains(" m<"),
        "no length without a unit"
    );
    let svg = meshes.plot(&["--to", "svg", "--units", "m"], &["scan.obj"]);
    assert!(svg.contains(">50 cm</text>"), "{svg}");
    let args = ["--to", "svg", "--frames", "0,2", "--fps", "10"];
    let svg = meshes.plot(&args, &["bodies.npz"]);
    assert!(svg.contains("frame 2 · 0.20 s") && !svg.contains("frame 1"));
    let svg = meshes.plot(&["--to", "svg"], &["scans", "fits.npz"]);
    assert_eq!(svg.matches("<g transform").count(), 6);
    assert!(svg.contains(">fits</text>"));
}

#[test]
fn meshes_of_several_topologies_stand_side_by_side() {
    let meshes = Meshes::new();
    meshes.file("triangle.obj", TRIANGLE.as_bytes());
    let svg = meshes.plot(&["--to", "svg"], &["scan.obj", "triangle.obj"]);
    assert_eq!(svg.matches("<g transform").count(), 2);
    let args = [
        "--to",
        "html",
        &meshes.path("scan.obj"),
        &meshes.path("triangle.obj"),
    ];
    let said = fails("plot", &args, b"", 1);
    assert!(
        said.contains("triangle.obj: has 3 vertices") && said.contains("scan.obj has 6"),
        "{said}"
    );
    // As figures of their own they are played together.
    let html = meshes.plot(&["--to", "html"], &["triangle.obj", "bodies.npz"]);
    assert_eq!(names(&scene(&html)), ["bodies", "triangle"]);
}

#[test]
fn sequences_become_a_page() {
    let meshes = Meshes::new();
    let html = meshes.plot(&["--to", "html", "--fps", "30"], &["scan.obj", "body.ply"]);
    let data = scene(&html);
    assert_eq!((&data["frames"], &data["rate"]), (&2.into(), &30.0.into()));
    assert_eq!(
        data["figures"][0]["labels"],
        serde_json::json!(["scan", "body"])
    );
    assert_eq!(names(&data), ["scan … body"]);
    let html = meshes.plot(
        &[
            "--to", "html", "--names", "a,b", "--title", "T <1>", "--every", "2",
        ],
        &["scans", "bodies.npz"],
    );
    let data = scene(&html);
    assert_eq!((names(&data), &data["frames"]), (vec!["a", "b"], &2.into()));
    assert_eq!(
        (&data["timed"], &data["inCm"]),
        (&false.into(), &false.into())
    );
    assert!(html.contains("T &lt;1&gt;") && html.contains("The frame rate is not known"));
}

#[test]
fn arrays_of_body_fit_are_in_centimeters() {
    let meshes = Meshes::new();
    let data = scene(&meshes.plot(&["--to", "html"], &["fits.npz"]));
    assert_eq!((names(&data), &data["inCm"]), (vec!["fits"], &true.into()));
    let args = ["--to", "html", "--array", "completed,predicted"];
    let data = scene(&meshes.plot(&args, &["fits.npz"]));
    assert_eq!(names(&data), ["fits completed", "fits predicted"]);
    // A unit that is typed holds: 2 m are 200 cm.
    let data = scene(&meshes.plot(&["--to", "html", "--units", "m"], &["bodies.npz"]));
    assert_eq!((&data["inCm"], &data["step"]), (&true.into(), &50.0.into()));
    let args = ["--to", "svg", "--array", "other", &meshes.path("fits.npz")];
    let said = fails("plot", &args, b"", 1);
    assert!(
        said.contains("other: the archive has no such array"),
        "{said}"
    );
}

#[test]
fn z_up_is_turned() {
    let meshes = Meshes::new();
    let mut lying = octahedron(0.0);
    for v in &mut lying.vertices {
        // The file's x, y, z are the page's x, -z, y.
        *v = [v[0], -v[2], v[1]];
    }
    archive(
        Path::new(&meshes.path("lying.npz")),
        &["vertices"],
        &[lying],
    );
    archive(
        Path::new(&meshes.path("standing.npz")),
        &["vertices"],
        &[octahedron(0.0)],
    );
    let drawn = |args: &[&str], file: &str| meshes.plot(args, &[file]);
    let turned = drawn(&["--to", "svg", "--up", "z"], "lying.npz");
    assert_eq!(turned, drawn(&["--to", "svg"], "standing.npz"));
    assert_ne!(turned, drawn(&["--to", "svg"], "lying.npz"));
}

#[test]
fn bad_meshes_are_named() {
    let meshes = Meshes::new();
    let bodies = meshes.path("bodies.npz");
    let mut nan = octahedron(0.0);
    nan.vertices[3][1] = f64::NAN;
    archive(Path::new(&meshes.path("nan.npz")), &["vertices"], &[nan]);
    let two = [octahedron(0.0), octahedron(0.1)];
    archive(Path::new(&meshes.path("two.npz")), &["vertices"], &two);
    for (content, name, said) in [
        (&b""[..], "empty.obj", "is empty"),
        (b"v 0 0 0\n", "points.obj", "points.obj: has no faces"),
        (
            b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
            "nan.obj",
            "nan.obj:1",
        ),
        (b"v 0 0 0\nf 1 2 3\n", "faces.obj", "faces.obj:2"),
    ] {
        let file = meshes.file(name, content);
        for to in ["svg", "html"] {
            let line = fails("plot", &["--to", to, &file], b"", 1);
            assert!(line.contains(said), "{line}");
        }
    }
    let line = fails("plot", &["--to", "svg", &meshes.path("nan.npz")], b"", 1);
    assert!(line.contains("mesh 0, vertex 3"), "{line}");
    let line = fails(
        "plot",
        &["--to", "html", &bodies, &meshes.path("two.npz")],
        b"",
        1,
    );
    assert!(line.contains("two: has 2 meshes, bodies has 3"), "{line}");
    std::fs::create_dir(meshes.path("nothing")).unwrap();
    let line = fails("plot", &["--to", "svg", &meshes.path("nothing")], b"", 1);
    assert!(line.contains("has no mesh files"), "{line}");
}

#[test]
fn flags_that_do_not_fit_are_refused() {
    let meshes = Meshes::new();
    let (scan, bodies) = (meshes.path("scan.obj"), meshes.path("bodies.npz"));
    let table = meshes.file("t.csv", b"a.x,a.y,a.z\n1,2,3\n");
    let refused = |args: &[&str], part: &str| {
        let mut all = vec!["--to", "svg"];
        all.extend(args);
        let line = fails("plot", &all, b"", 2);
        assert!(line.contains(part), "{line}");
    };
    refused(&["--bones", "a-b", &scan], "--bones is for tables only");
    refused(&["--overlaid", &scan], "--overlaid is for tables only");
    refused(&["--joints", "23", &scan], "--joints is for tables only");
    refused(&["--array", "x", &table], "--array is for meshes only");
    refused(&[&scan, &table], "cannot be drawn together");
    refused(&["--names", "a,b", &scan], "2 names for 1 figures");
    refused(&["--frames", "3", &bodies], "frame 3: there are 3");
    refused(&["--every", "0", &bodies], "at least 1");
    let line = fails("plot", &["--to", "html", "--azimuth", "3", &scan], b"", 2);
    assert!(line.contains("--azimuth is for an SVG only"), "{line}");
}
