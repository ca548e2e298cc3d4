//! The frames of keypoints that were read so far, and the take that they are.

use super::frame::{Frame, PLANAR, Person};
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

/// The most frames in which a person may be lost and found with another number.
const LOST: u64 = 30;

/// Where somebody was seen alone: the number, the frame, and the least and largest coordinates.
struct Seen(Option<u64>, u64, [[f64; 2]; 3]);

impl Seen {
    /// `None`: no point is seen.
    fn new(person: &Person, frame: u64) -> Option<Seen> {
        let range = |c: usize| {
            let all = person.points.iter().map(|point| point[c]);
            let ends = [
                all.clone().fold(f64::NAN, f64::min),
                all.fold(f64::NAN, f64::max),
            ];
            (!ends[0].is_nan()).then_some(ends)
        };
        Some(Seen(person.id, frame, [range(0)?, range(1)?, range(2)?]))
    }

    /// Whether this may be the same person soon after `before`, who is no body's size away.
    fn may_follow(&self, before: &Seen) -> bool {
        let size = |seen: &Seen| seen.2.map(|[low, high]| high - low).map(|v| v * v);
        let size = [size(self), size(before)].map(|axes| axes.iter().sum::<f64>());
        let middle = |seen: &Seen, c: usize| (seen.2[c][0] + seen.2[c][1]) / 2.0;
        let far = (0..3).map(|c| (middle(self, c) - middle(before, c)).powi(2));
        let is_near = far.sum::<f64>() <= size[0].max(size[1]);
        self.0 == before.0 || is_near && self.1.saturating_sub(before.1) <= LOST
    }
}

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
    /// Where the person of a frame was last, and whether another number was elsewhere or later.
    last: Option<Seen>,
    has_others: bool,
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

    /// Whether there are people, if only in the plane.
    pub(super) fn is_told(&self) -> bool {
        self.kind.is_some() || self.is_planar
    }

    /// Adds a frame with its number, if it has one.
    pub(super) fn push(&mut self, frame: Frame, number: Option<u64>) -> Result<()> {
        self.count += 1;
        self.is_planar |= frame.is_planar;
        self.has_more |= frame.has_more;
        self.most = self.most.max(frame.people.len());
        let is_alone = frame.people.len() == 1;
        let at = number.unwrap_or(self.count as u64);
        if let Some(now) = frame.people.first().and_then(|one| Seen::new(one, at)) {
            let last = self.last.as_ref();
            self.has_others |= last.is_some_and(|last| !now.may_follow(last));
            self.last = Some(now);
        }
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

    /// Takes people of whom no frame has two for one person, whose number changed, where each was
    /// near the last.
    fn join_people(&mut self, points: usize) {
        let (people, most) = (self.people.len(), self.most);
        if people == most.max(1) {
            return;
        }
        self.notes.push(if most > 1 || self.has_others {
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
