//! Force plates of C3D files to tables and to OpenSim's loads.

use crate::common::{command, fails, run, text};
use glam::DVec3;
use posing::io::C3d;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Samples a frame, frames, and channels: six of a plate of type 2, six of one of type 1.
const PER_FRAME: usize = 2;
const FRAMES: usize = 3;
const CHANNELS: usize = 12;
/// On the foot, in the plates' axes (x as the laboratory's, z down): N, mm, N mm.
const FORCE: DVec3 = DVec3::new(30.0, -45.0, -700.0);
const ARM: DVec3 = DVec3::new(60.0, -110.0, 0.0);
const FREE: DVec3 = DVec3::new(0.0, 0.0, -4000.0);
const ORIGIN: DVec3 = DVec3::new(3.0, -2.0, -40.0);

/// A file of two plates, each under the same force, which grows by a half each sample.
struct Made {
    up: &'static str,
    /// The unit of points and its millimeters.
    unit: (&'static str, f64),
    kinds: [i16; 2],
}

const MADE: Made = Made {
    up: "+Z",
    unit: ("mm", 1.0),
    kinds: [2, 1],
};

/// A parameter: its group, name, type (-1 text, 2 integers, 4 reals), dimensions, and bytes.
fn parameter(group: u8, name: &str, kind: i8, sizes: &[u8], data: Vec<u8>) -> Vec<u8> {
    let offset = (2 + 2 + sizes.len() + data.len() + 1) as u16;
    let mut out = vec![name.len() as u8, group];
    out.extend(name.bytes());
    out.extend(offset.to_le_bytes());
    out.extend([kind as u8, sizes.len() as u8]);
    out.extend(sizes);
    out.extend(data);
    out.push(0);
    out
}

fn integers(group: u8, name: &str, values: &[i16]) -> Vec<u8> {
    let data = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    parameter(group, name, 2, &[values.len() as u8], data)
}

fn reals(group: u8, name: &str, values: &[f64]) -> Vec<u8> {
    let data = values.iter().flat_map(|v| (*v as f32).to_le_bytes());
    parameter(group, name, 4, &[values.len() as u8], data.collect())
}

fn word(group: u8, name: &str, word: &str) -> Vec<u8> {
    parameter(group, name, -1, &[word.len() as u8], word.into())
}

impl Made {
    /// The channels of both plates under the force.
    fn channels(&self) -> Vec<f64> {
        let about = ARM.cross(FORCE) + FREE - FORCE.cross(ORIGIN);
        let first = [FORCE.to_array(), (about / self.unit.1).to_array()].concat();
        let arm = ARM / self.unit.1;
        let center = [arm.x, arm.y, FREE.z / self.unit.1];
        [&first[..], &FORCE.to_array(), &center].concat()
    }

    fn corners(&self) -> Vec<f64> {
        let corners = [(1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
        let of = |middle: f64| {
            corners.map(|(x, y)| {
                let (x, y, z) = (middle + 232.0 * x, 400.0 + 254.0 * y, 10.0);
                let lab = if self.up == "+Y" {
                    [x, z, -y]
                } else {
                    [x, y, z]
                };
                lab.map(|v| v / self.unit.1)
            })
        };
        [of(300.0), of(950.0)]
            .as_flattened()
            .as_flattened()
            .to_vec()
    }

    fn parameters(&self, start: i16) -> Vec<u8> {
        let groups = [(1_u8, "POINT"), (2, "ANALOG"), (3, "FORCE_PLATFORM")];
        let groups = groups.map(|(number, name)| {
            let head = [name.len() as u8, number.wrapping_neg()];
            [&head[..], name.as_bytes(), &[3, 0, 0]].concat()
        });
        let mut out = [1, 80, 2, 84].to_vec();
        out.extend(groups.concat());
        let origins = [ORIGIN, DVec3::new(0.0, 0.0, -10.0)].map(|o| (o / self.unit.1).to_array());
        let used: Vec<i16> = (1..=CHANNELS as i16).collect();
        let all = [
            integers(1, "USED", &[1]),
            integers(1, "FRAMES", &[FRAMES as i16]),
            integers(1, "DATA_START", &[start]),
            reals(1, "SCALE", &[-0.1]),
            reals(1, "RATE", &[100.0]),
            word(1, "UNITS", self.unit.0),
            word(1, "X_SCREEN", "+X"),
            word(1, "Y_SCREEN", self.up),
            word(1, "LABELS", "SACR"),
            integers(2, "USED", &[CHANNELS as i16]),
            reals(2, "RATE", &[100.0 * PER_FRAME as f64]),
            reals(2, "GEN_SCALE", &[2.0]),
            reals(2, "SCALE", &[0.25; CHANNELS]),
            integers(2, "OFFSET", &[-3; CHANNELS]),
            integers(3, "USED", &[2]),
            integers(3, "ZERO", &[1, 2]),
            integers(3, "TYPE", &self.kinds),
            reals(3, "CORNERS", &self.corners()),
            reals(3, "ORIGIN", origins.as_flattened()),
            integers(3, "CHANNEL", &used),
        ];
        out.extend(all.concat());
        out.extend([0; 2]);
        out
    }

    fn write(&self, path: &Path) -> PathBuf {
        let section = self.parameters(4);
        assert!(section.len() <= 2 * 512);
        let mut head = vec![2, 80];
        let last = 286 + FRAMES - 1;
        let words = [1, CHANNELS * PER_FRAME, 286, last, 10];
        head.extend(words.iter().flat_map(|w| (*w as u16).to_le_bytes()));
        head.extend((-0.1_f32).to_le_bytes());
        head.extend(
            [4_u16, PER_FRAME as u16]
                .iter()
                .flat_map(|w| w.to_le_bytes()),
        );
        head.extend(100_f32.to_le_bytes());
        head.resize(512, 0);
        let mut out = [head, section].concat();
        out.resize(3 * 512, 0);
        let channels = self.channels();
        for frame in 0..FRAMES {
            let point = [500.0, 500.0, 900.0, 0.0].map(|v| v / self.unit.1);
            let samples = (0..PER_FRAME).map(|s| 1.0 + 0.5 * (frame * PER_FRAME + s) as f64);
            let values = samples.flat_map(|load| {
                // The point stays where it is, whatever the load.
                let value = move |(c, v): (usize, &f64)| {
                    let load = if self.kinds[1] == 1 && [9, 10].contains(&c) {
                        1.0
                    } else {
                        load
                    };
                    load * v / 0.5 - 3.0
                };
                channels.iter().enumerate().map(value).collect::<Vec<f64>>()
            });
            let all = point.into_iter().chain(values);
            out.extend(all.flat_map(|v| (v as f32).to_le_bytes()));
        }
        out.resize(out.len().div_ceil(512) * 512, 0);
        fs::write(path, out).unwrap();
        path.to_path_buf()
    }
}

/// The columns of a table; NaN in empty cells.
fn columns(table: &str, separator: char) -> BTreeMap<String, Vec<f64>> {
    let mut lines = table.lines().map(|line| line.split(separator));
    let names: Vec<&str> = lines.next().unwrap().collect();
    let mut all: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for line in lines {
        for (name, cell) in names.iter().zip(line) {
            let value = cell.parse().unwrap_or(f64::NAN);
            all.entry(name.to_string()).or_default().push(value);
        }
    }
    all
}

fn vector(of: &BTreeMap<String, Vec<f64>>, name: &str, row: usize) -> DVec3 {
    DVec3::from_array(["x", "y", "z"].map(|axis| of[&format!("{name}{axis}")][row]))
}

fn walk() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/examples/gait/walk.c3d")
}

#[test]
fn planted_forces_are_found_in_any_axes_and_units() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("made.c3d");
    for (up, unit) in [("+Z", ("mm", 1.0)), ("+Y", ("mm", 1.0)), ("+Z", ("m", 1e3))] {
        Made { up, unit, ..MADE }.write(&path);
        let found = columns(&run("c3d2forces", &["-q", text(&path)], ""), ',');
        assert_eq!(found["time"], [2.85, 2.855, 2.86, 2.865, 2.87, 2.875]);
        assert_eq!(found.len(), 25);
        // The plates' z points down, their y toward the viewer: (x, -z, y) is y up.
        let lab = |v: DVec3| DVec3::new(v.x, -v.z, v.y);
        let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-3, "{up} {unit:?} {a} {b}");
        for (n, middle) in [(1, 300.0), (2, 950.0)] {
            for row in 0..6 {
                let load = 1.0 + 0.5 * row as f64;
                let vector = |what: &str| vector(&found, &format!("FP{n}.{what}"), row);
                near(vector("f"), lab(FORCE) * load);
                let point = DVec3::new(middle, 10.0, -400.0) + lab(ARM);
                near(vector("p"), point / 10.0);
                near(vector("m"), lab(ARM.cross(FORCE) + FREE) * load / 1e3);
                near(vector("t"), lab(FREE) * load / 1e3);
            }
        }
    }
}

#[test]
fn a_walk_has_its_centers_of_pressure_on_the_plates() {
    let table = run("c3d2forces", &["-q", text(&walk())], "");
    let found = columns(&table, ',');
    let markers = run("c3d2xyz", &["-q", text(&walk())], "");
    let first = |table: &str, c: usize| {
        let row = table.lines().nth(1).unwrap();
        row.split(',').nth(c).unwrap().to_string()
    };
    assert_eq!(first(&table, 0), first(&markers, 1), "the same time");
    let mut loaded = 0;
    for (i, plate) in C3d::open(walk()).unwrap().force_plates().iter().enumerate() {
        let corners = plate.corners.map(|c| DVec3::new(c.x, c.z, -c.y) / 10.0);
        let least = corners.into_iter().reduce(DVec3::min).unwrap();
        let most = corners.into_iter().reduce(DVec3::max).unwrap();
        for row in 0..found["time"].len() {
            let vector = |what: &str| vector(&found, &format!("FP{}.{what}", i + 1), row);
            let [f, p, t] = ["f", "p", "t"].map(vector);
            assert_eq!(f.y.abs() < 10.0, p.is_nan());
            assert_eq!(p.is_nan(), t.is_nan());
            if f.y > 50.0 {
                loaded += 1;
                assert!(
                    p.cmpge(least - 0.1).all() && p.cmple(most + 0.1).all(),
                    "{p}"
                );
                assert!(t.y.abs() < 20.0 && t.x.abs() + t.z.abs() < 0.1, "{t}");
            }
        }
    }
    assert!(loaded > 500, "{loaded}");
}

#[test]
fn loads_for_opensim_are_those_of_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let [csv, mot, sto] = ["f.csv", "f.mot", "f.STO"].map(|name| folder.path().join(name));
    for path in [&csv, &mot, &sto] {
        run("c3d2forces", &["-q", text(&walk()), "-o", text(path)], "");
    }
    let [csv, mot, sto] = [csv, mot, sto].map(|path| fs::read_to_string(path).unwrap());
    assert!(mot == sto && csv == run("c3d2forces", &["-q", text(&walk())], ""));
    let (head, rows) = mot.split_once("endheader\n").unwrap();
    let (table, found) = (columns(&csv, ','), columns(rows, '\t'));
    let count = table["time"].len();
    let wanted = format!("walk\nversion=1\nnRows={count}\nnColumns=19\ninDegrees=yes\n");
    assert_eq!(head, wanted);
    assert_eq!(found["time"], table["time"]);
    for n in [1, 2] {
        let mut held = DVec3::ZERO;
        for row in 0..count {
            let [f, p, t] = ["f", "p", "t"].map(|w| vector(&table, &format!("FP{n}.{w}"), row));
            let is_loaded = f.y.abs() >= 10.0;
            held = if is_loaded { p / 100.0 } else { held };
            let shown = |v: DVec3| if is_loaded { v } else { DVec3::ZERO };
            let titles = ["ground_force_N_v", "ground_force_N_p", "ground_torque_N_"];
            for (title, right) in titles.iter().zip([shown(f), held, shown(t)]) {
                let value = vector(&found, &title.replace('N', &n.to_string()), row);
                assert!((value - right).length() < 1e-8, "{title} {row}");
            }
        }
    }
}

#[test]
fn what_has_no_forces_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.csv");
    let made = folder.path().join("made.c3d");
    let other = Made {
        kinds: [2, 21],
        ..MADE
    }
    .write(&made);
    let gait = walk().with_file_name("../biomechanist/gait.c3d");
    for (path, part) in [
        (&gait, "has no force plates"),
        (
            &other,
            "force plate 2: is of type 21; types 1, 2, 3 and 4 are read",
        ),
    ] {
        let said = fails("c3d2forces", &[text(path), "-o", text(&out)], b"", 1);
        assert!(said.contains(part), "{said}");
    }
    // A plate that is not whole keeps the numbers of those behind it.
    let bytes = fs::read(&other).unwrap();
    let at = bytes.windows(7).position(|w| w == b"CHANNEL").unwrap() + 7 + 4;
    let mut broken = bytes.clone();
    (at..at + 2 * CHANNELS)
        .skip(1)
        .take(12)
        .for_each(|i| broken[i] = 0);
    fs::write(&made, broken).unwrap();
    let said = fails("c3d2forces", &[text(&made), "-o", text(&out)], b"", 1);
    assert!(
        said.contains("has 2 force plates, but 1 with type"),
        "{said}"
    );
    let said = fails("c3d2forces", &[text(&walk()), "-o", "forces.npz"], b"", 2);
    assert!(said.contains(".csv, .mot or .sto"), "{said}");
    assert!(!out.exists());
}

#[test]
fn a_result_never_replaces_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = MADE.write(&folder.path().join("made.c3d"));
    let before = fs::read(&path).unwrap();
    let link = folder.path().join("link.mot");
    std::os::unix::fs::symlink(&path, &link).unwrap();
    let hard = folder.path().join("hard.csv");
    fs::hard_link(&path, &hard).unwrap();
    for out in [&path, &link, &hard] {
        fails("c3d2forces", &[text(&path), "-o", text(out)], b"", 2);
        assert_eq!(fs::read(&path).unwrap(), before);
    }
    let piped = command("c3d2forces").write_stdin(before).output().unwrap();
    assert!(piped.status.success());
    assert_eq!(
        piped.stdout,
        run("c3d2forces", &["-q", text(&path)], "").into_bytes()
    );
}
