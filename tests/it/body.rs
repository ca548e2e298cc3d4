//! The commands of bodies, end to end on small meshes: body-train, body-synth, body-fit,
//! body-animate, body-scan.

use crate::common::{command, fails, run};
use posing::io::MeshSet;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

fn data(name: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/bodies");
    root.join(name).display().to_string()
}

/// A folder, and the body that is learned from the small meshes.
struct Setup {
    folder: tempfile::TempDir,
}

/// Three vertices a part.
fn marker_vertices() -> Vec<usize> {
    let text = fs::read_to_string(data("parts.csv")).unwrap();
    let mut parts: Vec<Vec<usize>> = vec![Vec::new(); 16];
    for line in text.lines().skip(1) {
        let (vertex, part) = line.split_once(',').unwrap();
        parts[part.parse::<usize>().unwrap()].push(vertex.parse().unwrap());
    }
    (parts.iter())
        .flat_map(|own| (0..4).map(|k| own[(2 * k + 1) * own.len() / 8]))
        .collect()
}

/// A marker table of some meshes of a set; each row is a take.
fn marker_table(set: &MeshSet, rows: &[usize]) -> String {
    let on = marker_vertices();
    let mut text = String::from("take,time");
    for k in 0..on.len() {
        write!(text, ",m{k}.x,m{k}.y,m{k}.z").unwrap();
    }
    text.push('\n');
    for row in rows {
        write!(text, "mesh{row},0").unwrap();
        for v in &on {
            for axis in 0..3 {
                write!(text, ",{}", set.vertices[[*row, *v, axis]]).unwrap();
            }
        }
        text.push('\n');
    }
    text
}

impl Setup {
    fn new() -> Setup {
        let setup = Setup {
            folder: tempfile::tempdir().unwrap(),
        };
        static BODY: OnceLock<Vec<u8>> = OnceLock::new();
        let body = BODY.get_or_init(|| {
            setup.train(&["-q"]);
            fs::read(setup.path("body.npz")).unwrap()
        });
        fs::write(setup.path("body.npz"), body).unwrap();
        let mut on = String::from("point,vertex\n");
        for (k, v) in marker_vertices().iter().enumerate() {
            writeln!(on, "m{k},{v}").unwrap();
        }
        fs::write(setup.path("on.csv"), on).unwrap();
        setup
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn file(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    fn write(&self, name: &str, text: &str) -> String {
        fs::write(self.path(name), text).unwrap();
        self.file(name)
    }

    fn train(&self, more: &[&str]) {
        let (poses, people) = (data("poses.npz"), data("people.npz"));
        let (parts, joints, out) = (data("parts.csv"), data("joints.csv"), self.file("body.npz"));
        let mut args = vec!["--units", "cm", "--poses", &poses, "--shapes", &people];
        args.extend(["--parts", &parts, "--joints", &joints, "-o", &out]);
        args.extend(more);
        run("body-train", &args, "");
    }
}

/// The mean distance of the vertices of two meshes of sets, centimeters.
fn apart(a: &MeshSet, i: usize, b: &MeshSet, j: usize) -> f64 {
    let count = a.vertices.dim().1;
    let distance = |v: usize| {
        let square = |axis: usize| {
            let d = f64::from(a.vertices[[i, v, axis]] - b.vertices[[j, v, axis]]);
            d * d
        };
        (0..3).map(square).sum::<f64>().sqrt()
    };
    (0..count).map(distance).sum::<f64>() / count as f64
}

fn poses() -> MeshSet {
    MeshSet::open(&[data("poses.npz")]).unwrap()
}

#[test]
fn a_body_at_rest_is_the_template_and_its_shape_can_change() {
    let setup = Setup::new();
    let (model, rest, other) = (
        setup.file("body.npz"),
        setup.file("rest.obj"),
        setup.file("o.ply"),
    );
    run(
        "body-synth",
        &["-q", "-m", &model, "--shape", "0", "-o", &rest],
        "",
    );
    run(
        "body-synth",
        &["-q", "-m", &model, "--shape", "-2,1", "-o", &other],
        "",
    );
    let (rest, other) = (
        MeshSet::open(&[rest]).unwrap(),
        MeshSet::open(&[other]).unwrap(),
    );
    assert_eq!(rest.faces, poses().faces);
    assert!(apart(&rest, 0, &other, 0) > 2.0);
    let said = run("model", &["info", &model], "");
    assert!(said.contains("body"), "{said}");
}

#[test]
fn markers_are_completed_and_the_tables_give_the_meshes_again() {
    let setup = Setup::new();
    let truth = poses();
    let table = setup.write("markers.csv", &marker_table(&truth, &[0, 3, 7]));
    let (model, on, fits) = (
        setup.file("body.npz"),
        setup.file("on.csv"),
        setup.file("f.npz"),
    );
    let (rotations, shapes) = (setup.file("r.csv"), setup.file("s.csv"));
    let args = [
        "-q",
        "-m",
        &model,
        "--on",
        &on,
        "-o",
        &fits,
        "--rotations",
        &rotations,
    ];
    run(
        "body-fit",
        &[&args[..], &["--shapes", &shapes, &table]].concat(),
        "",
    );
    let completed = MeshSet::open_array(&fits, &["completed"]).unwrap().0;
    for (k, row) in [0, 3, 7].into_iter().enumerate() {
        let far = apart(&completed, k, &truth, row);
        assert!(far < 1.2, "{far} cm");
    }
    let again = setup.file("again.npz");
    let args = [
        "-q",
        "-m",
        &model,
        "--rotations",
        &rotations,
        "--shape",
        &shapes,
    ];
    run("body-synth", &[&args[..], &["-o", &again]].concat(), "");
    let predicted = MeshSet::open_array(&fits, &["predicted"]).unwrap().0;
    let again = MeshSet::open(&[again]).unwrap();
    assert!((0..3).all(|k| apart(&predicted, k, &again, k) < 1e-3));
}

/// What a command says that ends with findings.
fn findings(name: &str, args: &[&str]) -> String {
    let done = command(name).args(args).assert().code(3);
    String::from_utf8_lossy(&done.get_output().stderr).into_owned()
}

#[test]
fn markers_that_do_not_fit_are_named_and_left_out() {
    let setup = Setup::new();
    let truth = poses();
    let table = marker_table(&truth, &[3, 7]);
    // The names of two markers are exchanged.
    let swapped = table.replacen("m3.", "m_.", 3).replacen("m40.", "m3.", 3);
    let swapped = setup.write("swapped.csv", &swapped.replacen("m_.", "m40.", 3));
    let (model, on, fits) = (
        setup.file("body.npz"),
        setup.file("on.csv"),
        setup.file("f.npz"),
    );
    let args = ["-m", &model, "--on", &on, "-o", &fits];
    let said = findings("body-fit", &[&args[..], &[&*swapped]].concat());
    assert!(
        said.contains("m3 does not fit") && said.contains("m40 does not fit"),
        "{said}"
    );
    let completed = MeshSet::open_array(&fits, &["completed"]).unwrap().0;
    for (k, row) in [3, 7].into_iter().enumerate() {
        let far = apart(&completed, k, &truth, row);
        assert!(far < 1.2, "{far} cm");
    }
    let said = findings("body-animate", &[&args[..], &[&*swapped]].concat());
    assert!(said.contains("m3 does not fit"), "{said}");
    let mut mirrored = poses();
    mirrored
        .vertices
        .slice_mut(ndarray::s![.., .., 0])
        .mapv_inplace(|x| -x);
    let mirrored = setup.write("mirrored.csv", &marker_table(&mirrored, &[3]));
    let said = findings("body-fit", &[&args[..], &[&*mirrored]].concat());
    assert!(said.contains("mirror"), "{said}");
}

#[test]
fn parts_without_markers_are_named() {
    let setup = Setup::new();
    let table = setup.write("markers.csv", &marker_table(&poses(), &[3]));
    let on = fs::read_to_string(setup.path("on.csv")).unwrap();
    // Four markers a part, in their order.
    let on: Vec<&str> = on
        .lines()
        .enumerate()
        .filter(|(k, _)| k.div_ceil(4) != 6)
        .map(|l| l.1)
        .collect();
    let on = setup.write("few.csv", &(on.join("\n") + "\n"));
    let (model, fits) = (setup.file("body.npz"), setup.file("f.npz"));
    let args = ["-m", &model, "--on", &on, "-o", &fits, &table];
    let done = command("body-fit").args(args).assert().success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(said.contains("no marker is seen on part5:"), "{said}");
}

#[test]
fn one_person_has_one_shape_in_all_frames() {
    let setup = Setup::new();
    let truth = poses();
    let table = setup.write("markers.csv", &marker_table(&truth, &[0, 3, 7]));
    let (model, on, fits, shapes) = (
        setup.file("body.npz"),
        setup.file("on.csv"),
        setup.file("f.npz"),
        setup.file("s.csv"),
    );
    let args = ["-q", "-m", &model, "--on", &on, "-o", &fits, "--one-person"];
    run(
        "body-fit",
        &[&args[..], &["--shapes", &shapes, &table]].concat(),
        "",
    );
    let shapes = fs::read_to_string(shapes).unwrap();
    let rows: Vec<&str> = (shapes.lines().skip(1))
        .map(|line| line.splitn(3, ',').nth(2).unwrap())
        .collect();
    assert!(
        rows.len() == 3 && rows.iter().all(|row| *row == rows[0]),
        "{shapes}"
    );
    let completed = MeshSet::open_array(&fits, &["completed"]).unwrap().0;
    for (k, row) in [0, 3, 7].into_iter().enumerate() {
        let far = apart(&completed, k, &truth, row);
        assert!(far < 1.2, "{far} cm");
    }
}

/// A mesh of a set as OBJ, its vertices in another order, its x times `side`.
fn obj(set: &MeshSet, row: usize, order: impl Fn(usize) -> usize, side: f32) -> String {
    let mut text = String::new();
    for v in 0..set.vertices.dim().1 {
        let at = |axis: usize| set.vertices[[row, order(v), axis]];
        writeln!(text, "v {} {} {}", side * at(0), at(1), at(2)).unwrap();
    }
    for face in &set.faces {
        let [a, b, c] = face.map(|v| v + 1);
        writeln!(text, "f {a} {b} {c}").unwrap();
    }
    text
}

#[test]
fn meshes_of_other_order_or_side_are_not_learned_from() {
    let setup = Setup::new();
    let set = poses();
    let count = set.vertices.dim().1;
    let first = setup.write("first.obj", &obj(&set, 0, |v| v, 1.0));
    let good = setup.write("good.obj", &obj(&set, 3, |v| v, 1.0));
    let order = setup.write("order.obj", &obj(&set, 3, |v| (v + 97) % count, 1.0));
    let side = setup.write("side.obj", &obj(&set, 3, |v| v, -1.0));
    let (parts, out) = (data("parts.csv"), setup.file("x.npz"));
    let train = |mesh: &str, units: &[&str]| -> (bool, String) {
        let args = ["--parts", &parts, "-o", &out, "--poses", &first, mesh];
        let args = [&args[..], &["--units", "cm"], units].concat();
        let done = command("body-train").args(args).output().unwrap();
        (
            done.status.success(),
            String::from_utf8_lossy(&done.stderr).into_owned(),
        )
    };
    let (is_done, said) = train(&good, &[]);
    assert!(is_done && said.contains("poses left out unknown"), "{said}");
    let (is_done, said) = train(&order, &[]);
    assert!(!is_done && said.contains("order.obj"), "{said}");
    let (is_done, said) = train(&side, &[]);
    assert!(
        !is_done && said.contains("side.obj") && said.contains("mirror"),
        "{said}"
    );
    // People in meters.
    let mut meters = poses();
    meters.vertices.mapv_inplace(|x| x / 100.0);
    let meters = setup.write("meters.obj", &obj(&meters, 3, |v| v, 1.0));
    let (is_done, said) = train(&good, &["--shapes", &meters]);
    assert!(!is_done && said.contains("meters.obj"), "{said}");
    let (is_done, said) = train(&good, &["--shapes", &meters, "--shape-units", "m"]);
    assert!(is_done, "{said}");
}

#[test]
fn a_frame_with_too_few_markers_stays_and_is_told() {
    let setup = Setup::new();
    let table = marker_table(&poses(), &[0, 3]);
    let mut lines: Vec<String> = table.lines().map(String::from).collect();
    // The last frame keeps three markers.
    let cells: Vec<&str> = lines[2].split(',').collect();
    let kept = cells
        .iter()
        .enumerate()
        .map(|(k, c)| if k < 11 { *c } else { "" });
    lines[2] = kept.collect::<Vec<_>>().join(",");
    let table = setup.write("markers.csv", &(lines.join("\n") + "\n"));
    let (model, on, fits) = (
        setup.file("body.npz"),
        setup.file("on.csv"),
        setup.file("f.npz"),
    );
    let meshes = setup.file("meshes");
    let rotations = setup.file("r.csv");
    let args = [
        "-m",
        &model,
        "--on",
        &on,
        "-o",
        &fits,
        "--meshes",
        &meshes,
        "--rotations",
    ];
    let done = crate::common::command("body-fit")
        .args(args)
        .args([&rotations, &table])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(said.contains("no body in 1 frames"), "{said}");
    assert_eq!(fs::read_dir(&meshes).unwrap().count(), 1);
    // The commands take what the others have written.
    let again = setup.file("again.npz");
    run(
        "body-synth",
        &["-q", "-m", &model, "--rotations", &rotations, "-o", &again],
        "",
    );
    let still = setup.file("still.svg");
    run("plot", &["-o", &still, &again], "");
    let text = fs::read_to_string(&rotations).unwrap();
    assert_eq!(text.lines().count(), 3);
    assert!(text.lines().last().unwrap().ends_with(",,,"), "{text}");
}

#[test]
fn a_take_has_one_shape_and_moves_to_another_body() {
    let setup = Setup::new();
    let truth = poses();
    // A take: the template that turns in two seconds; all rows are one take.
    let mut table = marker_table(&truth, &[0; 20]);
    table = table.replace("mesh0,0,", "spin,TIME,");
    let mut lines: Vec<String> = table.lines().map(String::from).collect();
    for (k, line) in lines[1..].iter_mut().enumerate() {
        let angle = 0.15 * k as f64;
        let cells: Vec<f64> = line
            .split(',')
            .skip(2)
            .map(|c| c.parse().unwrap())
            .collect();
        *line = format!("spin,{}", k as f64 / 30.0);
        for p in cells.chunks_exact(3) {
            let (x, z) = (
                p[0] * angle.cos() + p[2] * angle.sin(),
                p[2] * angle.cos() - p[0] * angle.sin(),
            );
            write!(line, ",{x},{},{z}", p[1]).unwrap();
        }
    }
    let table = setup.write("spin.csv", &(lines.join("\n") + "\n"));
    let (model, on, out) = (
        setup.file("body.npz"),
        setup.file("on.csv"),
        setup.file("spin.npz"),
    );
    run(
        "body-animate",
        &["-q", "-m", &model, "--on", &on, "-o", &out, &table],
        "",
    );
    let own = MeshSet::open(&[&out]).unwrap();
    assert_eq!(own.names.len(), 20);
    assert!(apart(&own, 0, &truth, 0) < 1.5);
    let wide = setup.file("wide.npz");
    run(
        "body-animate",
        &[
            "-q", "-m", &model, "--on", &on, "--shape", "3", "-o", &wide, &table,
        ],
        "",
    );
    let other = MeshSet::open(&[wide]).unwrap();
    let lowest = |set: &MeshSet, k: usize| {
        let rows = set.vertices.index_axis(ndarray::Axis(0), k);
        rows.column(1).iter().copied().fold(f32::INFINITY, f32::min)
    };
    assert!(apart(&own, 5, &other, 5) > 2.0);
    assert!((lowest(&own, 5) - lowest(&other, 5)).abs() < 1e-3);
    // The same from a scan of the person at the first frame: no map is needed.
    let first = setup.file("first.obj");
    truth.mesh(0).save(&first).unwrap();
    let scanned = setup.file("scanned.npz");
    let args = [
        "-q",
        "-m",
        &model,
        "--scan",
        &first,
        "--scan-frame",
        "0",
        "--scan-units",
        "cm",
    ];
    run(
        "body-animate",
        &[&args[..], &["-o", &scanned, &table]].concat(),
        "",
    );
    let scanned = MeshSet::open(&[scanned]).unwrap();
    assert!(apart(&scanned, 7, &own, 7) < 0.5);
    let glb = setup.file("spin.glb");
    run(
        "body-animate",
        &["-q", "-m", &model, "--on", &on, "-o", &glb, &table],
        "",
    );
    assert!(fs::read(glb).unwrap().starts_with(b"glTF"));
}

#[test]
fn a_pose_table_moves_the_body() {
    let setup = Setup::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/cmu/07");
    let file = |name: &str| root.join(name).display().to_string();
    let table = run(
        "amc2xyz",
        &["--asf", &file("07.asf"), "--fps", "120", &file("07_01.amc")],
        "",
    );
    let short: Vec<&str> = table.lines().take(61).collect();
    let (model, out) = (setup.file("body.npz"), setup.file("walk.npz"));
    run(
        "body-synth",
        &["-q", "-m", &model, "--pose", "-", "-o", &out],
        &(short.join("\n") + "\n"),
    );
    let walk = MeshSet::open(&[out]).unwrap();
    assert_eq!(walk.names.len(), 60);
    let rows = |k: usize| {
        walk.vertices
            .index_axis(ndarray::Axis(0), k)
            .mean_axis(ndarray::Axis(0))
            .unwrap()
    };
    // The walk goes on, upright, and nothing jumps.
    let gone = &rows(59) - &rows(0);
    assert!(gone[0].hypot(gone[2]) > 30.0, "{gone}");
    assert!((1..60).all(|k| apart(&walk, k, &walk, k - 1) < 4.0));
}

#[test]
fn a_scan_from_the_front_is_completed() {
    let setup = Setup::new();
    let truth = poses();
    let mut scan = truth.mesh(0);
    let xyz = scan.vertices.clone();
    scan.faces.retain(|f| {
        let [a, b, c] = f.map(|v| xyz[v as usize]);
        let (u, w) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        u[0] * w[1] - u[1] * w[0] > 0.0
    });
    let mut used: Vec<u32> = scan.faces.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let place = |v: u32| used.binary_search(&v).unwrap() as u32;
    scan.faces.iter_mut().for_each(|f| *f = f.map(place));
    scan.vertices = used.iter().map(|v| xyz[*v as usize]).collect();
    scan.save(setup.path("front.ply")).unwrap();
    let mut points = String::from("vertex,x,y,z\n");
    for v in used.iter().step_by(used.len() / 9) {
        let [x, y, z] = xyz[*v as usize];
        writeln!(points, "{v},{x},{y},{z}").unwrap();
    }
    let points = setup.write("points.csv", &points);
    let (model, scan, out) = (
        setup.file("body.npz"),
        setup.file("front.ply"),
        setup.file("whole.ply"),
    );
    let args = [
        "-q", "-m", &model, "--units", "cm", "--points", &points, "-o", &out, &scan,
    ];
    run("body-scan", &args, "");
    let whole = MeshSet::open(&[out]).unwrap();
    let far = apart(&whole, 0, &truth, 0);
    assert!(far < 1.5, "{far} cm");
}

#[test]
fn results_do_not_depend_on_threads() {
    let setup = Setup::new();
    let table = setup.write("markers.csv", &marker_table(&poses(), &[2, 5]));
    let (model, on) = (setup.file("body.npz"), setup.file("on.csv"));
    let trained = fs::read(&model).unwrap();
    setup.train(&["-q", "--threads", "3"]);
    assert!(fs::read(&model).unwrap() == trained);
    let bytes = |threads: &str| {
        let (fits, glb) = (setup.file("f.npz"), setup.file("a.glb"));
        let args = ["-q", "-m", &model, "--on", &on, "--threads", threads, "-o"];
        run("body-fit", &[&args[..], &[&fits, &table]].concat(), "");
        run("body-animate", &[&args[..], &[&glb, &table]].concat(), "");
        (fs::read(fits).unwrap(), fs::read(glb).unwrap())
    };
    assert!(bytes("1") == bytes("3"));
}

#[test]
fn parts_are_found_where_none_are_given() {
    let setup = Setup::new();
    let (poses, out) = (data("poses.npz"), setup.file("found.npz"));
    for count in ["2", "7", "15", "16", "17", "24", "32", "64"] {
        let args = [
            "-q",
            "--units",
            "cm",
            "--poses",
            &poses,
            "--part-count",
            count,
            "-o",
            &out,
        ];
        run("body-train", &args, "");
        let rest = setup.file("rest.ply");
        run("body-synth", &["-q", "-m", &out, "-o", &rest], "");
        let rest = MeshSet::open(&[rest]).unwrap();
        // A few parts hardly follow a body.
        let far = apart(&rest, 0, &self::poses(), 0);
        assert!(far < 1.0 || count.len() < 2, "{count}: {far} cm");
    }
    // One shape: takes are fitted all the same.
    let (on, table) = (
        setup.file("on.csv"),
        setup.write("m.csv", &marker_table(&self::poses(), &[0, 1])),
    );
    let take = setup.file("take.npz");
    run(
        "body-animate",
        &["-q", "-m", &out, "--on", &on, "-o", &take, &table],
        "",
    );
}

#[test]
fn one_frame_keeps_its_pose_in_a_glb() {
    let setup = Setup::new();
    let (model, on) = (setup.file("body.npz"), setup.file("on.csv"));
    let table = setup.write("m.csv", &marker_table(&poses(), &[3]));
    let animations = |args: &[&str], command: &str| {
        let glb = setup.file("a.glb");
        run(
            command,
            &[&["-q", "-m", &model, "-o", &glb], args].concat(),
            "",
        );
        let bytes = fs::read(glb).unwrap();
        let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        json["animations"].as_array().map_or(0, Vec::len)
    };
    assert_eq!(animations(&["--on", &on, &table], "body-animate"), 1);
    assert_eq!(animations(&["--shape", "1"], "body-synth"), 0);
}

#[test]
fn what_is_no_body_is_told_in_a_line() {
    let setup = Setup::new();
    let (meshes, model, out) = (
        data("poses.npz"),
        setup.file("body.npz"),
        setup.file("x.npz"),
    );
    let train =
        |args: &[&str], code: i32| fails("body-train", &[&["-o", &out], args].concat(), b"", code);
    assert!(train(&["--units", "m", "--poses", &meshes], 1).contains("--units"));
    let parts = setup.write("p.csv", "vertex,part\n0,0\n9999,1\n");
    let said = train(&["--units", "cm", "--poses", &meshes, "--parts", &parts], 1);
    assert!(said.contains("p.csv:3") && said.contains("9999"), "{said}");
    let parts = setup.write("p.csv", "vertex,part\n0,0\n");
    let said = train(&["--units", "cm", "--poses", &meshes, "--parts", &parts], 1);
    assert!(said.contains("no part for vertex 1"), "{said}");
    let other = setup.write(
        "t.obj",
        "v 0 0 0\nv 0 170 0\nv 30 0 0\nv 0 0 20\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n",
    );
    let said = train(
        &["--units", "cm", "--poses", &meshes, "--shapes", &other],
        1,
    );
    assert!(
        said.contains("t.obj") && said.contains("same vertices"),
        "{said}"
    );
    let none = setup.write("n.obj", "v 0 0 0\nv 0 170 0\nv 30 0 0\n");
    assert!(train(&["--units", "cm", "--poses", &none], 1).contains("no faces"));

    let table = marker_table(&poses(), &[0]);
    let file = setup.write("markers.csv", &table);
    let fit = |on: &str, table: &str| {
        let args = ["-m", &model, "--on", on, "-o", &out, table];
        fails("body-fit", &args, b"", 1)
    };
    let on = setup.file("on.csv");
    let mut millimeters = poses();
    millimeters.vertices.mapv_inplace(|v| 10.0 * v);
    let large = setup.write("mm.csv", &marker_table(&millimeters, &[0]));
    assert!(fit(&on, &large).contains("--units"));
    let wrong = setup.write("w.csv", "point,vertex\nm0,5\nm1,99999\n");
    let said = fit(&wrong, &file);
    assert!(said.contains("w.csv:3") && said.contains("99999"), "{said}");
    let wrong = setup.write("w.csv", "point,vertex\nm0,5\nm0,6\n");
    assert!(fit(&wrong, &file).contains("second vertex"));
    let wrong = setup.write("w.csv", "point,vertex\nm0,5\nankle,6\n");
    assert!(fit(&wrong, &file).contains("ankle"));
    let few = setup.write("few.csv", "point,vertex\nm0,5\nm1,6\nm2,90\n");
    assert!(fit(&few, &file).contains("four markers"));
    let synth = |args: &[&str], code: i32| {
        fails("body-synth", &[&["-m", &model], args].concat(), b"", code)
    };
    assert!(synth(&["-o", &setup.file("x.txt")], 2).contains(".obj"));
    assert!(synth(&["--shape", "1,2,x", "-o", &out], 1).contains("1,2,x"));
    let said = synth(&["--shape", &["1"; 60].join(","), "-o", &out], 2);
    assert!(said.contains("60 numbers"), "{said}");
    let rotations = setup.write("r.csv", "time,part0.rx,part0.ry,part0.rz\n0,1,2,3\n");
    assert!(synth(&["--rotations", &rotations, "-o", &out], 1).contains("part1.rx"));
}
