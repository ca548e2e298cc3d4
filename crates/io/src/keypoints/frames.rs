//! The frames of keypoints that were read so far, and the take that they are.

use super::frame::{Frame, PLANAR};
use super::layouts::Kind;
use crate::marker_rows::{MarkerRows, Stated};
use crate::marker_take::MarkerTake;
use crate::{Error, Place, Result};

/// What MediaPipe documents of landmarks in space.
const WORLD: &str = "takes MediaPipe's world landmarks as documented: in meters, y down, z away \
                     from the camera; their origin is the middle of the hips, so that the body \
                     stays in place";
const PICTURE: &str = "has landmarks whose x and y all lie between 0 and 1, as parts of a \
                       picture's width and height do (pose_landmarks): such are no positions in \
                       space (pose_world_landmarks)";

/// The frames that were read so far.
#[derive(Default)]
pub(super) struct Frames {
    pub name: String,
    rows: MarkerRows,
    pub count: usize,
    /// What the points are, and how many a person has.
    kind: Option<(Kind, usize)>,
    /// The people, by their numbers.
    people: Vec<Option<u64>>,
    /// The most people of a frame.
    most: usize,
    is_planar: bool,
    has_more: bool,
    /// Whether a coordinate cannot be a part of a picture's width or height.
    is_beyond: bool,
    pub notes: Vec<String>,
}

impl Frames {
    pub(super) fn new(name: &str) -> Frames {
        Frames {
            name: name.to_string(),
            ..Frames::default()
        }
    }

    /// Adds a frame with its number, if it has one.
    pub(super) fn push(&mut self, frame: Frame, number: Option<u64>) -> Result<()> {
        self.count += 1;
        self.is_planar |= frame.is_planar;
        self.has_more |= frame.has_more;
        self.most = self.most.max(frame.people.len());
        let is_alone = frame.people.len() == 1;
        let mut values = Vec::new();
        for person in &frame.people {
            let points = person.points.len();
            self.check((frame.kind, points))?;
            if !is_alone && person.id.is_none() {
                return Err(format!(
                    "has {} people without numbers that hold from frame to frame: estimate one \
                     person (OpenPose's number_people_max 1, MediaPipe's num_poses=1), or give \
                     each a person_id",
                    frame.people.len()
                )
                .into());
            }
            let at = self.people.iter().position(|id| *id == person.id);
            let at = at.unwrap_or(self.people.len());
            if at == self.people.len() {
                self.people.push(person.id);
            }
            let from = 3 * points * at;
            values.resize(values.len().max(from + 3 * points), f64::NAN);
            let to = &mut values[from..];
            if to.iter().take(3 * points).any(|v| !v.is_nan()) {
                return Err("has a person_id twice".into());
            }
            to.iter_mut()
                .zip(person.points.as_flattened())
                .for_each(|(to, v)| *to = *v);
            let mut plane = person.points.iter().flat_map(|p| &p[..2]);
            self.is_beyond |= plane.any(|v| *v < 0.0 || *v > 1.0);
        }
        self.rows.push_values(number, None, &values)
    }

    /// Fails where the keypoints of a person are no known ones, or not those of the people before.
    fn check(&mut self, (kind, points): (Kind, usize)) -> Result<()> {
        let (first, before) = *self.kind.get_or_insert((kind, points));
        let what = if kind.names(points).is_none() {
            format!("has {points} keypoints, expected {}", kind.sets())
        } else if points != before {
            format!("has {points} keypoints, those before {before}")
        } else if kind != first {
            "has keypoints of another kind than those before".to_string()
        } else {
            return Ok(());
        };
        Err(what.into())
    }

    /// Takes people of whom no frame has two for one person, whose number changed.
    fn join_people(&mut self, points: usize) {
        let (people, most) = (self.people.len(), self.most);
        if people == most.max(1) {
            return;
        }
        self.notes.push(if most > 1 {
            format!(
                "has {people} people by their numbers, and at most {most} in a frame: where a \
                 person's number changes, give each one person_id"
            )
        } else {
            self.rows.fold(3 * points);
            self.people.truncate(1);
            format!(
                "has {people} numbers for its person (person_id), and no frame with two people: \
                     takes them for one"
            )
        });
    }

    /// The take, of so many frames a second if the file says it.
    pub(super) fn take(mut self, rate: Option<f64>) -> Result<MarkerTake> {
        let Some((kind, points)) = self.kind else {
            let none = "has nobody's keypoints in any frame";
            let what = if self.is_planar { PLANAR } else { none };
            return Err(Error::data(Place::file(self.name), what));
        };
        self.join_people(points);
        let is_one = self.people.len() == 1;
        let label = |person: &Option<u64>, name: &str| match person {
            Some(id) if !is_one => format!("person{id}:{name}"),
            _ => name.to_string(),
        };
        let named = |person| {
            let names = kind.names(points).into_iter().flatten();
            names.map(move |name| label(person, name))
        };
        let said = [
            (
                self.has_more,
                "its keypoints of hands and faces are not converted",
            ),
            (kind == Kind::World, WORLD),
            (kind == Kind::Landmarks && !self.is_beyond, PICTURE),
        ];
        let said = said.into_iter().filter(|(holds, _)| *holds);
        self.notes.extend(said.map(|(_, what)| what.to_string()));
        let is_world = kind == Kind::World;
        let stated = Stated {
            labels: self.people.iter().flat_map(named).collect(),
            rate,
            units: is_world.then(|| "m".to_string()),
            from_zero: true,
            notes: self.notes,
            ..Stated::default()
        };
        let mut take = self.rows.take(&self.name, stated, true, false)?;
        take.up = is_world.then(|| "y down".to_string());
        take.up_is_inferred = is_world;
        Ok(take)
    }
}
