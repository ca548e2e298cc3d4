//! Small files as text, each for one thing that a file does not say outright.

use crate::{FbxChoice, FbxFile, FbxMotion};
use glam::DVec3;
use std::fmt::Write;

/// Units of time in a second.
const SECOND: f64 = 46_186_158_000.0;

/// An FBX file of version 7.4 as text.
struct Text {
    settings: String,
    objects: String,
    connections: String,
    next: usize,
}

impl Text {
    /// With a TimeMode: 6 is 30 frames a second.
    fn new(mode: usize) -> Text {
        Text {
            settings: format!("P: \"TimeMode\", \"enum\", \"\", \"\",{mode}\n"),
            objects: String::new(),
            connections: String::new(),
            next: 10,
        }
    }

    fn set(&mut self, name: &str, kind: &str, value: &str) {
        let _ = writeln!(
            self.settings,
            "P: \"{name}\", \"{kind}\", \"\", \"\",{value}"
        );
    }

    fn object(&mut self, kind: &str, class: &str, name: &str, of: &str, body: &str) -> usize {
        self.next += 1;
        let (id, of) = (self.next, format!("\"{of}\""));
        let _ = writeln!(
            self.objects,
            "{kind}: {id}, \"{class}::{name}\", {of} {{\n{body}\n}}"
        );
        id
    }

    fn join(&mut self, child: usize, parent: usize) {
        let _ = writeln!(self.connections, "C: \"OO\",{child},{parent}");
    }

    /// A node at `at` cm from its parent; 0 is the scene.
    fn node(&mut self, name: &str, parent: usize, kind: &str, at: [f64; 3]) -> usize {
        let [x, y, z] = at;
        let body = format!(
            "Properties70: {{\nP: \"Lcl Translation\", \"Lcl Translation\", \"\", \"A\",{x},{y},\
             {z}\n}}"
        );
        let id = self.object("Model", "Model", name, kind, &body);
        self.join(id, parent);
        if !kind.is_empty() {
            let attribute = self.object("NodeAttribute", "NodeAttribute", name, kind, "");
            self.join(attribute, id);
        }
        id
    }

    /// `count` bones, each 10 cm above the one before.
    fn bones(&mut self, name: &str, parent: usize, count: usize) -> Vec<usize> {
        let mut out = vec![parent];
        for i in 0..count {
            let name = if i == 0 {
                name.to_string()
            } else {
                format!("{name}{i}")
            };
            let above = out[out.len() - 1];
            out.push(self.node(&name, above, "LimbNode", [0.0, 10.0, 0.0]));
        }
        out.split_off(1)
    }

    /// The layer of a stack from 0 to `stop` seconds.
    fn stack(&mut self, name: &str, stop: f64) -> usize {
        let stop = (stop * SECOND).round();
        let body = format!(
            "Properties70: {{\nP: \"LocalStart\", \"KTime\", \"Time\", \"\",0\n\
             P: \"LocalStop\", \"KTime\", \"Time\", \"\",{stop}\n}}"
        );
        let stack = self.object("AnimationStack", "AnimStack", name, "", &body);
        let layer = self.object("AnimationLayer", "AnimLayer", "base", "", "");
        self.join(layer, stack);
        layer
    }

    /// Keys of the rotation of a node about z, degrees; held until the next where `is_held`.
    fn turns(&mut self, layer: usize, node: usize, keys: &[(f64, &str)], is_held: bool) {
        let list =
            |values: Vec<String>| format!("*{} {{\na: {}\n}}", values.len(), values.join(","));
        let times = list(
            keys.iter()
                .map(|k| format!("{}", (k.0 * SECOND).round()))
                .collect(),
        );
        let values = list(keys.iter().map(|k| k.1.to_string()).collect());
        let (flags, count) = (if is_held { 2 } else { 260 }, keys.len());
        let body = format!(
            "Default: 0\nKeyVer: 4008\nKeyTime: {times}\nKeyValueFloat: {values}\n\
             KeyAttrFlags: *1 {{\na: {flags}\n}}\nKeyAttrDataFloat: *4 {{\na: 0,0,0,0\n}}\n\
             KeyAttrRefCount: *1 {{\na: {count}\n}}"
        );
        let curve = self.object("AnimationCurve", "AnimCurve", "", "", &body);
        let own = self.object("AnimationCurveNode", "AnimCurveNode", "R", "", "");
        self.join(own, layer);
        let _ = writeln!(self.connections, "C: \"OP\",{own},{node}, \"Lcl Rotation\"");
        let _ = writeln!(self.connections, "C: \"OP\",{curve},{own}, \"d|Z\"");
    }

    /// A bind pose: where nodes are in the world.
    fn bind(&mut self, nodes: &[(usize, [f64; 3])]) {
        let mut body = format!("Type: \"BindPose\"\nNbPoseNodes: {}\n", nodes.len());
        for (node, [x, y, z]) in nodes {
            let _ = writeln!(
                body,
                "PoseNode: {{\nNode: {node}\nMatrix: *16 {{\n\
                 a: 1,0,0,0,0,1,0,0,0,0,1,0,{x},{y},{z},1\n}}\n}}"
            );
        }
        self.object("Pose", "Pose", "bind", "BindPose", &body);
    }

    fn bytes(&self) -> Vec<u8> {
        let Text {
            settings,
            objects,
            connections,
            ..
        } = self;
        format!(
            "; FBX 7.4.0 project file\nFBXHeaderExtension: {{\nFBXVersion: 7400\n}}\n\
             GlobalSettings: {{\nProperties70: {{\n{settings}}}\n}}\nObjects: {{\n{objects}}}\n\
             Connections: {{\n{connections}}}\n"
        )
        .into_bytes()
    }

    fn read(&self) -> FbxFile {
        FbxFile::read("t.fbx", &self.bytes()).unwrap()
    }

    fn motion(&self, fps: Option<f64>) -> FbxMotion {
        let file = self.read();
        let take = file.take(&FbxChoice::default()).unwrap();
        file.motion(&take, fps).unwrap()
    }
}

/// A quarter turn of the first of three bones within a second, a key each frame of 30.
fn quarter(mode: usize) -> Text {
    let mut text = Text::new(mode);
    let bones = text.bones("hips", 0, 3);
    let layer = text.stack("walk", 1.0);
    let key = |k: u32| (f64::from(k) / 30.0, format!("{}", 3 * k));
    let keys: Vec<(f64, String)> = (0..=30).map(key).collect();
    let keys: Vec<(f64, &str)> = keys.iter().map(|(t, v)| (*t, v.as_str())).collect();
    text.turns(layer, bones[0], &keys, false);
    text
}

fn at(motion: &FbxMotion, frame: usize, joint: usize) -> DVec3 {
    crate::pose::poses::point_at(motion.positions.view(), frame, joint)
}

fn fault(result: crate::Result<impl Sized>) -> String {
    result.err().unwrap().to_string()
}

#[test]
fn a_turn_moves_what_hangs_on_it() {
    let motion = quarter(6).motion(None);
    assert_eq!((motion.rate, motion.positions.nrows()), (30.0, 31));
    assert_eq!(motion.notes, Vec::<String>::new());
    let end = at(&motion, 30, 2);
    assert!(
        (end - DVec3::new(-20.0, 10.0, 0.0)).length() < 1e-4,
        "{end}"
    );
    assert!((motion.turns[[30, 1]].to_axis_angle().1 - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
    assert_eq!(motion.joints[2].rest, DVec3::new(0.0, 30.0, 0.0));
    let parents: Vec<_> = motion.joints.iter().map(|joint| joint.parent).collect();
    assert_eq!(parents, [None, Some(0), Some(1)]);
}

#[test]
fn units_and_axes_are_the_files() {
    let mut text = quarter(6);
    text.set("UnitScaleFactor", "double", "2.54");
    assert!((at(&text.motion(None), 0, 0).y - 25.4).abs() < 1e-9);
    let mut text = quarter(6);
    for (axis, value) in [("UpAxis", 2), ("FrontAxis", 1), ("CoordAxis", 0)] {
        text.set(axis, "int", &value.to_string());
        let sign = if axis == "FrontAxis" { "-1" } else { "1" };
        text.set(&format!("{axis}Sign"), "int", sign);
    }
    // What lies along y in a file whose z axis is up lies along -z.
    assert!((at(&text.motion(None), 0, 0) - DVec3::new(0.0, 0.0, -10.0)).length() < 1e-9);
    for unit in ["0", "-1", "1e12"] {
        let mut text = quarter(6);
        text.set("UnitScaleFactor", "double", unit);
        let motion = text.motion(None);
        assert!((at(&motion, 0, 0).y - 10.0).abs() < 1e-9, "{unit}");
        assert!(
            motion.notes[0].contains("taken for 1"),
            "{:?}",
            motion.notes
        );
    }
}

#[test]
fn keys_that_are_closer_than_the_rate_are_all_taken() {
    // TimeMode 11: 24 frames a second.
    let text = quarter(11);
    let motion = text.motion(None);
    assert_eq!((motion.rate, motion.positions.nrows()), (30.0, 31));
    let note = &motion.notes[0];
    assert!(note.contains("24") && note.contains("30"), "{note}");
    let fewer = text.motion(Some(10.0));
    assert_eq!((fewer.rate, fewer.positions.nrows()), (10.0, 11));
    assert!(fewer.notes.is_empty());
    // Keys that are farther apart, as of an animator, say nothing of the rate. 3: 60 a second.
    assert_eq!(quarter(3).motion(None).rate, 60.0);
}

#[test]
fn a_rate_that_none_can_mean_is_that_of_the_keys_or_asked_for() {
    for rate in ["0", "1e9", "-5"] {
        let mut text = quarter(14);
        text.set("CustomFrameRate", "double", rate);
        let motion = text.motion(None);
        assert_eq!(motion.rate, 30.0, "{rate}");
        assert!(motion.notes[0].contains("keys"), "{:?}", motion.notes);
    }
    let mut text = Text::new(14);
    text.set("CustomFrameRate", "double", "0");
    let bones = text.bones("hips", 0, 3);
    let layer = text.stack("walk", 9.0);
    text.turns(layer, bones[0], &[(0.0, "0"), (9.0, "90")], false);
    let file = text.read();
    let take = file.take(&FbxChoice::default()).unwrap();
    let said = fault(file.motion(&take, None));
    assert!(said.contains("the option `fps F`"), "{said}");
    assert_eq!(file.motion(&take, Some(2.0)).unwrap().positions.nrows(), 19);
    let said = fault(file.motion(&take, Some(1e9)));
    assert!(
        said.contains("too long") && said.contains("the option `fps"),
        "{said}"
    );
}

#[test]
fn a_take_lasts_from_key_to_key_within_its_own_range() {
    let keys = [(1.0, "0"), (1.5, "10"), (2.0, "20"), (9.0, "90")];
    for (stop, frames) in [(2.0, 31), (100.0, 241), (0.0, 241), (0.5, 241)] {
        let mut text = Text::new(6);
        let bones = text.bones("hips", 0, 3);
        let layer = text.stack("walk", stop);
        text.turns(layer, bones[0], &keys, false);
        assert_eq!(text.motion(None).positions.nrows(), frames, "{stop}");
    }
}

#[test]
fn what_is_held_changes_at_its_key() {
    // 30000/1001 frames a second: no time of a frame is a round number.
    let mut text = Text::new(9);
    let bones = text.bones("hips", 0, 3);
    let layer = text.stack("walk", 10.0);
    let key = |k: u32| (f64::from(k) * 1.001 / 30.0, format!("{}", 10 * k));
    let keys: Vec<(f64, String)> = (0..200).map(key).collect();
    let keys: Vec<(f64, &str)> = keys.iter().map(|(t, v)| (*t, v.as_str())).collect();
    text.turns(layer, bones[0], &keys, true);
    let motion = text.motion(None);
    assert_eq!(motion.positions.nrows(), 200);
    for frame in 0..200 {
        let (sin, cos) = f64::from(10 * frame as u32).to_radians().sin_cos();
        let wanted = DVec3::new(-10.0 * sin, 10.0 + 10.0 * cos, 0.0);
        assert!((at(&motion, frame, 1) - wanted).length() < 1e-3, "{frame}");
    }
}

#[test]
fn nodes_between_bones_are_joints_and_those_above_move_the_root() {
    let mut text = Text::new(6);
    let top = text.node("armature", 0, "Null", [5.0, 0.0, 0.0]);
    let hips = text.node("hips", top, "LimbNode", [0.0, 90.0, 0.0]);
    let between = text.node("between", hips, "Null", [0.0, 10.0, 0.0]);
    let chest = text.node("chest", between, "LimbNode", [0.0, 10.0, 0.0]);
    text.node("hat", chest, "Null", [0.0, 10.0, 0.0]);
    let limb = text.node("hand", chest, "", [10.0, 0.0, 0.0]); // its attribute is lost
    text.node("chest_end", chest, "LimbNode", [0.0, 20.0, 0.0]);
    let layer = text.stack("walk", 1.0);
    text.turns(layer, top, &[(0.0, "0"), (1.0, "90")], false);
    text.turns(layer, limb, &[(0.0, "0"), (1.0, "90")], false);
    let motion = text.motion(None);
    let names: Vec<&str> = motion
        .joints
        .iter()
        .map(|joint| joint.name.as_str())
        .collect();
    assert_eq!(names, ["hips", "between", "chest", "hand", "chest_end"]);
    assert_eq!(motion.joints[4].parent, Some(2));
    let ends: Vec<bool> = motion.joints.iter().map(|joint| joint.is_end).collect();
    assert_eq!(ends, [false, false, false, false, true]);
    assert!((at(&motion, 0, 0) - DVec3::new(5.0, 90.0, 0.0)).length() < 1e-9);
    assert!((at(&motion, 30, 0) - DVec3::new(-85.0, 0.0, 0.0)).length() < 1e-4);
}

#[test]
fn without_bones_the_largest_moving_tree_of_nulls_is_the_skeleton() {
    let mut text = Text::new(6);
    let still = text.node("stage", 0, "Null", [0.0; 3]);
    for i in 0..9 {
        text.node(&format!("prop{i}"), still, "Null", [0.0; 3]);
    }
    let above = text.node("group", 0, "Null", [0.0; 3]);
    let hips = text.node("hips", above, "Null", [0.0, 90.0, 0.0]);
    text.node("head", hips, "Null", [0.0, 70.0, 0.0]);
    let layer = text.stack("walk", 1.0);
    text.turns(layer, hips, &[(0.0, "0"), (1.0, "90")], false);
    let names: Vec<String> = text
        .motion(None)
        .joints
        .into_iter()
        .map(|j| j.name)
        .collect();
    assert_eq!(names, ["hips", "head"]);
}

#[test]
fn several_skeletons_and_takes_are_listed_and_chosen() {
    let mut text = Text::new(6);
    let people = ["Anna", "Bert"].map(|name| text.node(name, 0, "Null", [0.0; 3]));
    let bones = people.map(|person| text.bones("Hips", person, 6));
    let control = text.bones("control", 0, 1);
    let layers = ["walk", "run", "empty"].map(|name| text.stack(name, 1.0));
    for (layer, who) in [(0, 0), (0, 1), (1, 0)] {
        text.turns(
            layers[layer],
            bones[who][0],
            &[(0.0, "0"), (1.0, "90")],
            false,
        );
    }
    text.turns(layers[0], control[0], &[(0.0, "0"), (1.0, "90")], false);
    let file = text.read();
    let choice = |take: Option<&str>, skeleton: Option<&str>| FbxChoice {
        take: take.map(String::from),
        skeleton: skeleton.map(String::from),
    };
    assert_eq!(file.takes_of(&FbxChoice::default()).unwrap().len(), 3);
    let said = fault(file.take(&FbxChoice::default()));
    assert!(
        said.starts_with("t.fbx: has several skeletons: Anna, Bert; "),
        "{said}"
    );
    assert!(file.take(&choice(None, Some("Bert"))).is_ok());
    let said = fault(file.take(&choice(None, Some("Anna"))));
    assert!(
        said.starts_with("t.fbx: has several takes: walk, run; "),
        "{said}"
    );
    let run = file.take(&choice(Some("run"), None)).unwrap();
    assert_eq!((run.name.as_str(), run.skeleton.as_str()), ("run", "Anna"));
    let said = fault(file.take(&choice(Some("jump"), None)));
    assert!(
        said.contains("no take \"jump\"; it has walk, run"),
        "{said}"
    );
    let said = fault(file.take(&choice(None, Some("Carl"))));
    assert!(
        said.contains("no skeleton \"Carl\"; it has Anna, Bert, control"),
        "{said}"
    );
    let said = fault(file.take(&choice(Some("empty"), None)));
    assert!(said.contains("no take \"empty\""), "{said}");
    assert!(fault(file.rest(None)).contains("several skeletons"));
    assert_eq!(file.rest(Some("Bert")).unwrap().joints.len(), 6);
    // What is small is told of, and may be chosen.
    let notes = file.motion(&run, None).unwrap().notes;
    assert!(
        notes[0].contains("left out") && notes[0].contains("control"),
        "{notes:?}"
    );
    assert!(file.take(&choice(None, Some("control"))).is_ok());
}

#[test]
fn a_small_tree_in_the_armature_stands_beside_its_skeleton() {
    let mut text = Text::new(6);
    let armature = text.node("armature", 0, "Null", [0.0; 3]);
    let hips = text.bones("hips", armature, 6);
    let camera = text.bones("camera", armature, 1);
    let layer = text.stack("walk", 1.0);
    for node in [hips[0], camera[0]] {
        text.turns(layer, node, &[(0.0, "0"), (1.0, "90")], false);
    }
    let motion = text.motion(None);
    assert_eq!((motion.joints.len(), motion.tree_len()), (7, 6));
    assert_eq!(motion.joints[6].parent, None);
    assert!(motion.notes.is_empty(), "{:?}", motion.notes);
}

#[test]
fn the_bind_pose_is_the_rest_pose_and_the_file_s_own_where_it_has_none() {
    let mut text = quarter(6);
    let ids: Vec<usize> = vec![11, 13]; // of hips and hips1
    text.bind(&[(ids[0], [0.0, 90.0, 0.0]), (ids[1], [30.0, 90.0, 0.0])]);
    let rest = text.read().rest(None).unwrap();
    assert_eq!(rest.joints[0].rest, DVec3::new(0.0, 90.0, 0.0));
    assert_eq!(rest.joints[1].rest, DVec3::new(30.0, 90.0, 0.0));
    assert!((rest.joints[2].rest - DVec3::new(30.0, 100.0, 0.0)).length() < 1e-9);
    assert_eq!(rest.positions.nrows(), 1);
}

#[test]
fn a_key_that_is_no_number_leaves_its_frame_missing() {
    let mut text = Text::new(6);
    let bones = text.bones("hips", 0, 3);
    let layer = text.stack("walk", 1.0);
    let keys = [
        (0.0, "0"),
        (1.0 / 30.0, "nan"),
        (2.0 / 30.0, "6"),
        (1.0, "90"),
    ];
    text.turns(layer, bones[1], &keys, true);
    let motion = text.motion(None);
    assert!(at(&motion, 1, 1).is_finite() && at(&motion, 1, 2).is_nan());
    assert!(motion.turns[[1, 1]].is_nan() && motion.turns[[1, 0]].is_finite());
    assert!(at(&motion, 0, 2).is_finite() && at(&motion, 2, 2).is_finite());
}

#[test]
fn what_cannot_be_read_says_why() {
    let read = |bytes: &[u8]| fault(FbxFile::read("t.fbx", bytes));
    let mut text = Text::new(6);
    text.node("stage", 0, "Null", [0.0; 3]);
    assert!(read(&text.bytes()).contains("no skeleton"));
    let mut text = Text::new(6);
    text.bones("hips", 0, 3);
    text.stack("empty", 1.0);
    assert!(fault(text.read().take(&FbxChoice::default())).contains("no take"));
    let whole = quarter(6).bytes();
    for end in (40..whole.len() - 2).step_by(97) {
        // Cut text may read as less; it never takes long, and says one line.
        if let Err(e) = FbxFile::read("t.fbx", &whole[..end]) {
            assert!(!e.to_string().contains('\n'));
        }
    }
    let header = read(b"Kaydara FBX Binary  \0\x1a\0\xe8\x1c\0\0");
    assert!(header.contains("is an empty FBX file"), "{header}");
}
