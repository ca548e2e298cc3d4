use super::read;
use crate::{Input, MarkerTake, Result};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

fn take_of(text: &str, keep_whole: bool) -> Result<MarkerTake> {
    let bytes = std::io::Cursor::new(text.as_bytes().to_vec());
    read(Input::new("x.json", bytes)?, keep_whole)
}

fn take(value: &Value) -> Result<MarkerTake> {
    take_of(&value.to_string(), false)
}

fn read_folder(path: &Path) -> Result<MarkerTake> {
    read(Input::open(path)?, false)
}

fn fails(text: &str, part: &str) {
    let said = take_of(text, false).unwrap_err().to_string();
    assert!(said.contains(part), "{said}");
    assert!(!said.contains('\n'), "{said}");
}

/// A coordinate of a point in a frame.
fn at(t: usize, p: usize, c: usize) -> f64 {
    (t * 100 + p) as f64 * 0.125 - c as f64
}

/// MediaPipe's landmarks in a frame.
fn landmarks(t: usize) -> Value {
    let one = |p| json!({"x": at(t, p, 0), "y": at(t, p, 1), "z": at(t, p, 2), "visibility": 0.5});
    (0..33).map(one).collect()
}

/// A person of OpenPose's in a frame.
fn person(t: usize, points: usize, id: i64) -> Value {
    let numbers = (0..points).flat_map(|p| [at(t, p, 0), at(t, p, 1), at(t, p, 2), 1.0]);
    json!({"person_id": [id], "pose_keypoints_3d": numbers.collect::<Vec<_>>()})
}

#[test]
fn landmarks_are_the_same_in_every_layout() {
    let numbers = |t| -> Value {
        let one = |p| json!([at(t, p, 0), at(t, p, 1), at(t, p, 2), 0.5]);
        (0..33).map(one).collect()
    };
    let every: [&dyn Fn(usize) -> Value; 7] = [
        &landmarks,
        &numbers,
        &|t| json!([landmarks(t)]),
        &|t| json!({"landmark": landmarks(t)}),
        &|t| json!({"pose_world_landmarks": landmarks(t), "pose_landmarks": [[0.5]]}),
        &|t| json!({"frame": t, "poseWorldLandmarks": {"landmark": landmarks(t)}}),
        &|t| json!({"worldLandmarks": [landmarks(t)], "landmarks": [[{"x": 0.1}]]}),
    ];
    for (i, layout) in every.into_iter().enumerate() {
        let frames: Vec<Value> = (0..3).map(layout).collect();
        for value in [
            json!(frames),
            json!({"version": 1, "frames": frames, "fps": 25}),
        ] {
            let read = take(&value).unwrap();
            assert_eq!((read.points.len(), &*read.points[25]), (33, "left_knee"));
            let same = |((t, c), v): ((usize, usize), &f64)| *v == at(t, c / 3, c % 3);
            assert!(read.xyz.indexed_iter().all(same), "layout {i}");
            assert_eq!((read.xyz.nrows(), read.first_frame), (3, 1));
            assert_eq!(read.rate, value.is_object().then_some(25.0));
            let said = (read.units.as_deref(), read.up.as_deref());
            let is_world = i > 3;
            assert_eq!(
                said,
                if is_world {
                    (Some("m"), Some("y down"))
                } else {
                    (None, None)
                }
            );
            assert_eq!(read.up_axis().is_some(), is_world);
            assert_eq!(read.notes.len(), usize::from(is_world));
        }
        // A file that is one frame.
        if i > 2 {
            assert_eq!(
                take(&layout(2)).unwrap().xyz[[0, 3]],
                at(2, 1, 0),
                "layout {i}"
            );
        }
    }
}

#[test]
fn what_is_hidden_or_nobody_is_missing_and_no_frame_is_lost() {
    let mut hidden = landmarks(1);
    hidden[4]["visibility"] = json!(0);
    hidden[5] = Value::Null;
    hidden[6]["y"] = Value::Null;
    let read = take(&json!([landmarks(0), hidden, null, [], {"landmarks": null}, landmarks(5)]));
    let read = read.unwrap();
    assert_eq!(read.xyz.nrows(), 6);
    let missing = |t: usize| read.xyz.row(t).iter().filter(|v| v.is_nan()).count();
    assert_eq!([0, 1, 2, 3, 4, 5].map(missing), [0, 7, 99, 99, 99, 0]);
    // Frames that are left out by their numbers.
    let numbered = |t: usize| json!({"frame_idx": t, "pose_world_landmarks": landmarks(t)});
    let read = take(&json!([numbered(3), numbered(5)])).unwrap();
    assert_eq!((read.xyz.nrows(), read.first_frame), (3, 4));
    assert!(read.xyz.row(1).iter().all(|v| v.is_nan()));
    assert!(read.notes[1].contains("leaves out the number of 1 frame, which has"));
    fails(
        &json!([numbered(5), numbered(3)]).to_string(),
        "frame 2: frame 3 follows frame 5",
    );
    let far = json!([numbered(0), {"frame": 1_u64 << 60, "worldLandmarks": landmarks(0)}]);
    fails(&far.to_string(), "too large for the number of a frame");
    let far = json!([numbered(0), {"frame": 900_000, "worldLandmarks": landmarks(0)}]);
    fails(&far.to_string(), "only 66 points in all rows");
}

#[test]
fn what_is_no_number_is_an_error_with_its_frame_and_keypoint() {
    let with = |key: &str, value: Value| {
        let mut frame = landmarks(1);
        frame[4][key] = value;
        json!([landmarks(0), frame])
    };
    for (key, value, found) in [
        ("x", json!("0.12"), "\"0.12\""),
        ("z", json!(true), "true"),
        ("y", json!([1]), "[1]"),
        ("visibility", json!("0.9"), "\"0.9\""),
    ] {
        fails(
            &with(key, value).to_string(),
            &format!("frame 2: has {found} in keypoint 4, counted from 0: expected a number"),
        );
    }
    let mut numbers: Vec<Value> = (0..33).map(|p| json!([p, 2, 3])).collect();
    numbers[0] = json!(["1", 2, 3]);
    fails(
        &json!([numbers]).to_string(),
        "frame 1: has \"1\" in keypoint 0",
    );
    for c in 0..4 {
        let mut one = person(0, 25, -1);
        one["pose_keypoints_3d"][4 * 7 + c] = json!("0.5");
        let frames = json!([{"people": [one]}]).to_string();
        fails(&frames, "frame 1: has \"0.5\" in keypoint 7");
    }
    // A confidence that is not there hides nothing.
    let mut seen = landmarks(0);
    seen[4].as_object_mut().unwrap().remove("visibility");
    let read = take(&json!([seen])).unwrap();
    assert_eq!(read.xyz, take(&json!([landmarks(0)])).unwrap().xyz);
}

#[test]
fn the_first_landmarks_may_be_missing() {
    let numbers: Value = (0..33)
        .map(|p| json!([at(0, p, 0), at(0, p, 1), at(0, p, 2), 0.5]))
        .collect();
    let whole = take(&json!([numbers])).unwrap();
    let (none, three) = (Value::Null, json!([null, null, null]));
    let (four, named) = (
        json!([null, null, null, 0]),
        json!({"x": null, "y": null, "z": null}),
    );
    for missing in [none, three, four, named] {
        for layout in [&numbers, &landmarks(0)] {
            let mut frame = layout.clone();
            frame[0] = missing.clone();
            frame[1] = missing.clone();
            for value in [
                json!([frame]),
                json!([[frame]]),
                json!([{"landmarks": frame}]),
            ] {
                let read = take(&value).unwrap();
                assert!(read.xyz.row(0).iter().take(6).all(|v| v.is_nan()));
                let rest = [&read, &whole].map(|take| take.xyz.row(0).to_vec().split_off(6));
                assert_eq!(rest[0], rest[1], "{missing}");
            }
        }
    }
    // A frame that has one person's place but nobody in it.
    let nobody = take(&json!([numbers, [null], [null, null]])).unwrap();
    assert!(nobody.xyz.nrows() == 3 && nobody.xyz.row(2).iter().all(|v| v.is_nan()));
}

#[test]
fn one_frame_may_be_a_list_of_its_points_or_have_a_count() {
    let numbers: Value = (0..33)
        .map(|p| json!([at(1, p, 0), at(1, p, 1), at(1, p, 2)]))
        .collect();
    let mut hidden = landmarks(1);
    hidden[7] = Value::Null;
    let mut late = numbers.clone();
    late[0] = Value::Null;
    late[1] = json!([null, null, null]);
    let counted = json!({"frames": 1, "pose_world_landmarks": landmarks(1)});
    for (value, missing) in [
        (numbers, 0),
        (landmarks(1), 0),
        (counted, 0),
        (hidden, 3),
        (late, 6),
    ] {
        let read = take(&value).unwrap();
        assert_eq!((read.xyz.dim(), read.xyz[[0, 98]]), ((1, 99), at(1, 32, 2)));
        assert_eq!(read.xyz.iter().filter(|v| v.is_nan()).count(), missing);
    }
}

#[test]
fn numbers_of_frames_and_people_may_change_or_stand_in_quotes() {
    let frame = |t: usize, people: &[Value]| json!({"frame": format!(" {t}"), "people": people});
    let one = |t: usize, id: i64| frame(t, &[person(0, 25, id)]);
    let same = take(&json!([one(3, 4), one(4, 4), one(6, 4)])).unwrap();
    assert_eq!((same.xyz.dim(), same.first_frame), ((4, 75), 4));
    assert!(same.notes[0].contains("leaves out the number of 1 frame"));
    // No frame has two people: the tracker lost the one, or had no number for it.
    for ids in [[4, 7, 9], [-1, 0, -1], [0, -1, 1]] {
        let changed = take(&json!([one(3, ids[0]), one(4, ids[1]), one(6, ids[2])])).unwrap();
        assert_eq!(
            (&changed.points, &changed.notes[1]),
            (&same.points, &same.notes[0])
        );
        assert!(
            changed.notes[0].contains("takes them for one"),
            "{:?}",
            changed.notes
        );
        let is_same = changed
            .xyz
            .iter()
            .zip(&same.xyz)
            .all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(is_same);
    }
    // Somebody who is elsewhere, or who comes much later, is another.
    let elsewhere = frame(4, &[person(9, 25, 7)]);
    for second in [elsewhere, one(300, 7)] {
        let read = take(&json!([one(3, 4), second])).unwrap();
        assert_eq!((read.points.len(), &*read.points[25]), (50, "person7:Nose"));
        let said = "2 people by their numbers, and at most 1 in a frame";
        assert!(read.notes[0].contains(said), "{:?}", read.notes);
    }
    // Of two people nobody knows whose number changed.
    let key = "pose_keypoints_3d";
    let named = |id: &str| json!({"person_id": [id], key: person(0, 25, 0)[key]});
    let two = [[named("0"), named("1")], [named("0"), named("2")]];
    let read = take(&json!([frame(0, &two[0]), frame(1, &two[1])])).unwrap();
    assert_eq!((read.points.len(), &*read.points[50]), (75, "person2:Nose"));
    assert!(read.notes[0].contains("3 people by their numbers, and at most 2 in a frame"));
}

#[test]
fn people_are_told_apart_by_their_ids() {
    let frame = |people: &[Value]| json!({"version": 1.3, "people": people});
    for (points, name) in [(25, "RHeel"), (18, "LEar")] {
        let mut one = person(0, points, -1);
        one["pose_keypoints_3d"][3] = json!(0);
        let read = take(&json!([frame(&[one]), frame(&[])])).unwrap();
        assert_eq!(
            (read.points.len(), &**read.points.last().unwrap()),
            (points, name)
        );
        assert_eq!((read.units, read.up), (None, None));
        assert_eq!(
            read.xyz.iter().filter(|v| !v.is_nan()).count(),
            3 * (points - 1)
        );
    }
    let both = [person(0, 25, 4), person(9, 25, 7)];
    let second = frame(&[person(1, 25, 7)]);
    let read = take(&json!([frame(&both), second])).unwrap();
    assert_eq!((read.points.len(), &*read.points[25]), (50, "person7:Nose"));
    assert_eq!(
        (read.xyz[[0, 75]], read.xyz[[1, 75]]),
        (at(9, 0, 0), at(1, 0, 0))
    );
    assert!(read.xyz[[1, 0]].is_nan());
    let nameless = frame(&[person(0, 25, -1), person(1, 25, -1)]);
    fails(
        &json!([nameless]).to_string(),
        "frame 1: has 2 people without numbers",
    );
    fails(
        &json!([[landmarks(0), landmarks(1)]]).to_string(),
        "num_poses=1",
    );
    let twice = frame(&[person(0, 25, 1), person(1, 25, 1)]);
    fails(&json!([twice]).to_string(), "has a person_id twice");
    let other = json!([frame(&[person(0, 25, 0)]), frame(&[person(0, 18, 0)])]);
    fails(
        &other.to_string(),
        "frame 2: has 18 keypoints, those before 25",
    );
    fails(
        &frame(&[person(0, 15, 0)]).to_string(),
        "expected BODY_25 (25) or COCO (18)",
    );
    let other = json!([frame(&[person(0, 25, 0)]), landmarks(0)]);
    fails(&other.to_string(), "those before 25");
    let odd = json!({"people": [{"pose_keypoints_3d": [1, 2, 3]}]});
    fails(&odd.to_string(), "not four numbers a point");
    // Hands are told.
    let mut hands = person(0, 25, 0);
    hands["hand_left_keypoints_3d"] = json!([1, 2, 3, 1]);
    assert!(take(&frame(&[hands])).unwrap().notes[0].contains("hands and faces"));
}

#[test]
fn what_is_not_in_space_is_refused_or_told() {
    let flat = json!({"people": [{"pose_keypoints_2d": [1, 2, 0.5], "pose_keypoints_3d": []}]});
    fails(&flat.to_string(), "x.json: has keypoints in two dimensions");
    let flat: Value = (0..33)
        .map(|p| json!({"x": p, "y": p, "visibility": 1}))
        .collect();
    fails(
        &json!([{"frame_id": 0, "keypoints": flat}]).to_string(),
        "in two dimensions",
    );
    let picture = json!([{"pose_landmarks": landmarks(0)}]).to_string();
    fails(&picture, "frame 1: has pose_landmarks alone");
    let inside: Value = (0..33)
        .map(|p| json!([p as f64 / 40.0, 0.5, -0.1]))
        .collect();
    let read = take(&json!([inside])).unwrap();
    assert!(
        read.notes[0].contains("picture's width"),
        "{:?}",
        read.notes
    );
}

#[test]
fn hostile_texts_end_with_one_line() {
    fails("[]", "nobody's keypoints");
    fails("{\"a\": 1}", "no layout that is read");
    fails("[3]", "frame 1: has landmarks that are no list");
    fails("[[3, 4]]", "frame 1: has landmarks");
    fails("[{\"frame\": 3}]", "no layout that is read");
    fails(
        "[[{\"x\": 1, \"y\": 2, \"z\": 3}]]",
        "has 1 keypoints, expected MediaPipe's 33",
    );
    fails("[\n[{\"x\": NaN}]]", "x.json:2: is no JSON");
    fails(
        "{\"frames\": \"many\"}",
        "x.json: has \"many\" as its frames, which are to be a list",
    );
    let named = json!({"frames": 3, "data": [landmarks(0), landmarks(1)]}).to_string();
    fails(&named, "has 3 as its frames, which are to be a list");
    fails("{\"frames\": -1.5}", "expected frames of keypoints");
    fails("[null] [null]", "trailing characters");
    fails(&"[".repeat(100_000), "ends early");
    let deep = format!("[{}{}]", "[".repeat(9000), "]".repeat(9000));
    fails(&deep, "frame 1: is no frame: recursion limit");
    let large = format!("[[{}0]]", "0,".repeat(1 << 21));
    fails(&large, "bytes of a frame");
    let bytes = std::io::Cursor::new(b"[\n\"\xff\"]".to_vec());
    let said = read(Input::new("x.json", bytes).unwrap(), false).unwrap_err();
    assert!(said.to_string().starts_with("x.json: is no UTF-8"));
}

#[test]
fn a_file_that_ends_early_gives_its_whole_frames_where_asked() {
    let frames: Vec<Value> = (0..3).map(landmarks).collect();
    for whole in [
        json!(frames).to_string(),
        json!({"frames": frames}).to_string(),
    ] {
        let cut = &whole[..whole.len() - 300];
        fails(
            cut,
            "ends early, within its JSON; of a list of frames, the option `keep_whole`",
        );
        let read = take_of(cut, true).unwrap();
        assert_eq!((read.xyz.nrows(), read.notes.len()), (2, 1));
        assert_eq!(read.xyz, take(&json!(frames[..2])).unwrap().xyz);
        // What is whole is read alike.
        assert_eq!(
            take_of(&whole, true).unwrap(),
            take_of(&whole, false).unwrap()
        );
        // Any cut is one line, never a panic.
        for end in (0..whole.len()).step_by(97) {
            let _one_line = take_of(&whole[..end], true).map_err(|e| e.to_string());
        }
    }
}

#[test]
fn a_folder_has_a_frame_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let write = |name: &str, value: &Value| fs::write(path.join(name), value.to_string()).unwrap();
    assert!(
        read_folder(path)
            .unwrap_err()
            .to_string()
            .contains("is a directory")
    );
    let frame = |t| json!({"people": [person(t, 25, -1)]});
    for t in [9, 10, 12] {
        write(&format!("walk_{t:012}_keypoints.json"), &frame(t));
    }
    write("about.json", &json!({}));
    let read = read_folder(path).unwrap();
    assert_eq!((read.xyz.nrows(), read.first_frame), (4, 10));
    assert_eq!(
        [0, 1, 3].map(|t| read.xyz[[t, 0]]),
        [9, 10, 12].map(|t| at(t, 0, 0))
    );
    assert!(read.xyz.row(2).iter().all(|v| v.is_nan()));
    let said = "leaves out 1 JSON file that is no frame of it";
    assert!(read.notes[0].contains(said), "{:?}", read.notes);
    // Takes and other files beside the frames are none of them, be they numbered.
    let whole = json!([landmarks(0), landmarks(1)]);
    for (name, value) in [
        ("walk2.json", &whole),
        ("walk_14_keypoints.json", &json!({"frames": [landmarks(0)]})),
        ("camera1.json", &json!({"K": [[1, 0], [0, 1]]})),
    ] {
        write(name, value);
    }
    let same = read_folder(path).unwrap().xyz;
    assert_eq!((same.nrows(), same[[3, 74]]), (4, at(12, 24, 2)));
    let found = crate::motion_folder::MotionFolder::with_keypoints(path, None, |_| true);
    let names: Vec<_> = found.files.iter().map(|(file, _)| file.clone()).collect();
    let others = ["walk2.json", "walk_14_keypoints.json"].map(|name| path.join(name));
    assert_eq!(names, [&[path.to_path_buf()][..], &others].concat());
    assert_eq!(found.left_out, 2);
    // The bytes are those of the files, wherever the folder is.
    let bytes = crate::keypoint_files::bytes_of(path).unwrap();
    assert!(
        !String::from_utf8(bytes)
            .unwrap()
            .contains(&*path.to_string_lossy())
    );
    // A fault names the file, be it the first.
    for name in ["walk_11_keypoints.json", "walk_1_keypoints.json"] {
        let file = path.join(name);
        fs::write(&file, "{\"people\": [").unwrap();
        let said = read_folder(path).unwrap_err().to_string();
        let wanted = format!("{}:1: ends early, within its JSON", file.display());
        assert_eq!(said, wanted);
        let found = crate::motion_folder::MotionFolder::with_keypoints(path, None, |_| true);
        assert_eq!(
            (&found.files[0].0, found.files.len()),
            (&path.to_path_buf(), 3)
        );
        fs::remove_file(file).unwrap();
    }
    write(
        "walk_11_keypoints.json",
        &json!({"people": [{"pose_keypoints_3d": [1]}]}),
    );
    let said = read_folder(path).unwrap_err().to_string();
    let file = path.join("walk_11_keypoints.json");
    assert!(
        said.starts_with(&format!("{}: has", file.display())),
        "{said}"
    );
    fs::remove_file(file).unwrap();
    write("run_000000000001_keypoints.json", &frame(1));
    let said = read_folder(path).unwrap_err().to_string();
    assert!(
        said.contains("several takes, run_*_keypoints.json and walk_*_keypoints.json"),
        "{said}"
    );
}

#[test]
fn files_are_keypoints_where_their_first_people_are_read() {
    let is = |text: String| {
        let bytes = std::io::Cursor::new(text.into_bytes());
        super::is_keypoints(Input::new("x.json", bytes).unwrap())
    };
    let (meta, frames) = ("m".repeat(100_000), [landmarks(0), landmarks(1)]);
    let flat = json!({"people": [{"pose_keypoints_2d": [1, 2, 0.5]}]});
    for value in [
        json!(frames),
        json!({"about": meta, "frames": frames}),
        json!([null, {"landmarks": null}, frames[0]]),
        json!([null, [null, null, null], frames[0]]),
        frames[0].clone(),
        json!({"people": [person(0, 18, 0)]}),
        flat,
    ] {
        assert!(is(value.to_string()), "{value}");
        assert!(is(format!("\u{feff} {value}")));
    }
    // What is wrong after them is for the reader to tell.
    let whole = json!(frames).to_string();
    assert!(is(whole[..whole.len() - 300].into()));
    let matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    for value in [
        json!([matrix, matrix]),
        json!(matrix),
        json!({"frames": [matrix]}),
        json!({"annotations": [{"keypoints": [1, 2, 2]}]}),
        json!([{"keypoints": [1, 2, 2], "image_id": 1}]),
        json!({"keypoints": matrix}),
        json!([[{"x": 1, "y": 2, "z": 3}]]),
        json!([null]),
        json!({"people": "many"}),
        json!({"people": [{"name": "Ann"}]}),
        json!(3),
    ] {
        assert!(!is(value.to_string()), "{value}");
    }
    assert!(!is(String::new()) && !is("{\"a\": ".into()));
}
