//! A frame of keypoints in any of the layouts.

use super::layouts::Kind;
use crate::Result;
use crate::text::excerpt;
use serde_json::Value;

const WORLD: [&str; 2] = ["poseworldlandmarks", "worldlandmarks"];
const IN_PICTURES: [&str; 1] = ["poselandmarks"];
const LANDMARKS: [&str; 3] = ["landmarks", "landmark", "keypoints"];
const NUMBER: [&str; 5] = ["frame", "frameid", "frameidx", "frameindex", "framenumber"];
const VISIBILITY: [&str; 3] = ["visibility", "score", "confidence"];

/// What is said of points in the plane alone.
pub(super) const PLANAR: &str = "has keypoints in two dimensions (x and y without z): positions in \
                                 space are expected, as OpenPose's 3d and MediaPipe's \
                                 pose_world_landmarks have them";

/// A frame.
#[derive(Debug, Default)]
pub(crate) struct Frame {
    /// The number that it says.
    pub(super) number: Option<u64>,
    /// The people that have points.
    pub(super) people: Vec<Person>,
    /// What the points are.
    pub(super) kind: Kind,
    /// Whether there are points in the plane alone.
    pub(super) is_planar: bool,
    /// Whether there are hands or faces too.
    pub(super) has_more: bool,
}

/// A person in a frame.
#[derive(Debug)]
pub(super) struct Person {
    /// The number by which it is known from frame to frame.
    pub id: Option<u64>,
    /// The positions, NaN where missing.
    pub points: Vec<[f64; 3]>,
}

impl Frame {
    /// Reads a frame: null, a list of landmarks or of people's, or an object that has them.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: it is of no layout that is known, or only in the plane.
    pub(super) fn read(value: &Value) -> Result<Frame> {
        let landmarks = match value {
            Value::Null => return Ok(Frame::default()),
            Value::Object(_) => {
                if let Some(people) = value.get("people").and_then(Value::as_array) {
                    return Frame::of_openpose(value, people);
                }
                Frame::landmarks_in(value)?
            }
            list => Some((Kind::Landmarks, list)),
        };
        let mut frame = Frame {
            number: number(value),
            ..Frame::default()
        };
        if let Some((kind, list)) = landmarks {
            frame.people = people(list)?;
            frame.kind = kind;
        }
        Ok(frame)
    }

    /// Whether a value is a frame with people whose points have names, or are in the plane.
    pub(crate) fn is_of(value: &Value) -> bool {
        let is_named = |frame: &Frame| {
            let mut people = frame.people.iter();
            people.all(|person| frame.kind.names(person.points.len()).is_some())
        };
        let has_any = |frame: &Frame| frame.is_planar || !frame.people.is_empty();
        Frame::read(value).is_ok_and(|frame| has_any(&frame) && is_named(&frame))
    }

    /// The landmarks of an object; `None`: nobody was found in the frame.
    fn landmarks_in(value: &Value) -> Result<Option<(Kind, &Value)>> {
        let found = |keys: &[&str]| field(value, keys).map(|list| (list, !is_empty(list)));
        match (found(&WORLD), found(&LANDMARKS), found(&IN_PICTURES)) {
            (Some((world, true)), ..) => Ok(Some((Kind::World, world))),
            (_, Some((list, true)), _) => Ok(Some((Kind::Landmarks, list))),
            (None, None, Some((_, true))) => Err(
                "has pose_landmarks alone, whose x and y are parts of the picture's width and \
                 height: dump pose_world_landmarks, which are positions in space"
                    .into(),
            ),
            (None, None, None) => Err(
                "has keypoints of no layout that is read (OpenPose's people, \
                                       MediaPipe's pose_world_landmarks or lists of 33 landmarks): \
                                       save its positions as CSV, which csv2xyz reads"
                    .into(),
            ),
            _ => Ok(None),
        }
    }

    fn of_openpose(value: &Value, people: &[Value]) -> Result<Frame> {
        let mut frame = Frame {
            number: number(value),
            kind: Kind::OpenPose,
            ..Frame::default()
        };
        let is_filled = |list: Option<&Value>| list.is_some_and(|list| !is_empty(list));
        for person in people {
            let flat = ["pose_keypoints_2d", "pose_keypoints"];
            frame.is_planar |= flat.iter().any(|key| is_filled(person.get(key)));
            let others = ["face", "hand_left", "hand_right"];
            let others = others.map(|part| person.get(format!("{part}_keypoints_3d")));
            frame.has_more |= others.into_iter().any(is_filled);
            let numbers = person.get("pose_keypoints_3d").and_then(Value::as_array);
            let Some(numbers) = numbers.filter(|numbers| !numbers.is_empty()) else {
                continue;
            };
            let (points, rest) = numbers.as_chunks::<4>();
            let point = |(p, four): (usize, &[Value; 4])| {
                let [x, y, z, c] = four.each_ref().map(|value| coordinate(p, Some(value)));
                let (position, c) = ([x?, y?, z?], c?);
                let is_seen = !c.is_nan() && c != 0.0;
                Ok(position.map(|v| if is_seen { v } else { f64::NAN }))
            };
            if !rest.is_empty() {
                return Err("has pose_keypoints_3d that are not four numbers a point".into());
            }
            // An id is a list of one number, -1 where people are not tracked.
            let id = person.get("person_id").map(|id| id.get(0).unwrap_or(id));
            frame.people.push(Person {
                id: id.and_then(whole),
                points: points
                    .iter()
                    .enumerate()
                    .map(point)
                    .collect::<Result<_>>()?,
            });
        }
        Ok(frame)
    }
}

/// Whether this is a point: an object with x, or a list of numbers, some of which may be missing.
fn is_point(value: &Value) -> bool {
    match value {
        Value::Array(list) => {
            let is_flat = !list.iter().any(|v| v.is_array() || v.is_object());
            // A longer list that begins with null is a person's, whose first points are missing.
            let begins = list.first().is_some_and(Value::is_number);
            is_flat && (begins || (1..=5).contains(&list.len()))
        }
        _ => field(value, &["x"]).is_some(),
    }
}

/// Whether this is a point in space that is not missing: no frame is one.
pub(super) fn is_seen_point(value: &Value) -> bool {
    match value {
        Value::Array(list) => list.len() > 2 && list[0].is_number() && is_point(value),
        _ => field(value, &["x"]).is_some_and(Value::is_number),
    }
}

/// Whether this may be a point that is missing.
pub(super) fn is_missing_point(value: &Value) -> bool {
    landmark((0, value)).is_ok_and(|point| point.iter().all(|v| v.is_nan()))
}

/// The number in a keypoint, NaN where it is missing.
fn coordinate(point: usize, value: Option<&Value>) -> Result<f64> {
    match value {
        None | Some(Value::Null) => Ok(f64::NAN),
        Some(value) => value.as_f64().ok_or_else(|| {
            let found = excerpt(&value.to_string());
            format!("has {found} in keypoint {point}, counted from 0: expected a number or null")
                .into()
        }),
    }
}

/// The people of a list of landmarks, or of a list of such lists.
fn people(list: &Value) -> Result<Vec<Person>> {
    let each = unwrapped(list).as_array().map_or(&[][..], Vec::as_slice);
    let mut seen = each.iter().filter(|value| !value.is_null());
    let is_one = each.is_empty() || seen.next().is_some_and(is_point);
    let each = if is_one {
        std::slice::from_ref(list)
    } else {
        each
    };
    let person = |list: &Value| {
        let points = unwrapped(list)
            .as_array()
            .ok_or("has landmarks that are no list")?;
        let points = points.iter().enumerate().map(landmark);
        let points = points.collect::<Result<_>>()?;
        Ok(Person { id: None, points })
    };
    let each = each.iter().filter(|list| !is_empty(unwrapped(list)));
    each.map(person).collect()
}

/// The list of landmarks in an object that only holds it.
fn unwrapped(list: &Value) -> &Value {
    field(list, &["landmark", "landmarks"]).unwrap_or(list)
}

/// The position of a landmark.
fn landmark((point, value): (usize, &Value)) -> Result<[f64; 3]> {
    let part = |at: usize, keys: &[&str]| match value {
        Value::Array(list) => list.get(at),
        _ => field(value, keys),
    };
    let [x, y, z] = [(0, "x"), (1, "y"), (2, "z")].map(|(at, key)| part(at, &[key]));
    if value.is_null() {
        return Ok([f64::NAN; 3]);
    }
    if x.is_some() && z.is_none() {
        return Err(PLANAR.into());
    }
    if x.is_none() && !is_point(value) {
        return Err("has landmarks without x, y, z".into());
    }
    let [x, y, z, c] = [x, y, z, part(3, &VISIBILITY)].map(|value| coordinate(point, value));
    let (position, is_hidden) = ([x?, y?, z?], c? == 0.0);
    Ok(position.map(|v| if is_hidden { f64::NAN } else { v }))
}

/// The number of a frame.
fn number(value: &Value) -> Option<u64> {
    field(value, &NUMBER).and_then(whole)
}

/// A whole number, which may stand in quotes.
fn whole(value: &Value) -> Option<u64> {
    let quoted = || value.as_str()?.trim().parse().ok();
    value.as_u64().or_else(quoted)
}

fn is_empty(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::Array(list) => list.is_empty(),
        Value::Object(fields) => fields.is_empty(),
        _ => false,
    }
}

/// The field of one of these names; theirs are in small letters, without what parts words.
pub(super) fn field<'a>(value: &'a Value, keys: &[&str]) -> Option<&'a Value> {
    let fields = value.as_object()?;
    let is_it = |name: &str| {
        let letters = name.chars().filter(char::is_ascii_alphanumeric);
        let plain: String = letters.map(|c| c.to_ascii_lowercase()).collect();
        keys.contains(&plain.as_str())
    };
    fields.iter().find(|(name, _)| is_it(name)).map(|(_, v)| v)
}
