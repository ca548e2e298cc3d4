//! A library of motion: takes at 30 frames a second, by person, in a model file of kind `motion`.

use super::RATE;
use super::body_tree::{BodyTree, Frames};
use super::sampling::sampled;
use super::windows::{Clip, Origin};
use crate::io::Model;
use crate::pose::joints::{CMU, cmu_names};
use crate::pose::{PointNaming, Poses, point_at, ranges};
use crate::{Error, Place, Result};
use glam::DVec3;
use ndarray::{Array2, s};
use serde::{Deserialize, Serialize};

/// The kind of a model file that holds a library.
pub const KIND: &str = "motion";

/// Bones of one person's takes differ by no more than this share.
const ONE_PERSON: f64 = 0.005;

/// A take is in the library already if so many of its frames are within so many cm of some there.
const COMPARED: usize = 9;
const NEAR: f64 = 2.5;

/// Shorter bones do not tell people apart, cm.
const SHORT_BONE: f64 = 2.0;

/// Frames a second of a take that shows motion, at least.
const SLOWEST: f64 = 10.0;

/// A stretch of fewer frames has no window.
const FEWEST: usize = 21;

/// A stretch of a take of which every frame shows the body.
#[derive(Debug, Clone, PartialEq)]
pub struct LibraryClip {
    /// The position of its take among [`MotionLibrary::takes`].
    pub take: usize,
    /// The seconds of the take with which it begins.
    pub start: f64,
    /// (frames, 3 P), cm.
    pub(crate) xyz: Array2<f32>,
}

/// A take of a library.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LibraryTake {
    /// Its name.
    pub name: String,
    /// Whose it is: people count from 0.
    pub person: usize,
    /// The names of its points, those of CMU's joints.
    pub points: Vec<String>,
}

/// Motion that is known.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MotionLibrary {
    /// The takes.
    pub takes: Vec<LibraryTake>,
    /// What of them shows a whole body.
    pub clips: Vec<LibraryClip>,
}

/// What a file knows of a clip besides its frames.
#[derive(Serialize, Deserialize)]
struct ClipMeta {
    take: usize,
    start: f64,
    frames: usize,
}

impl MotionLibrary {
    /// Adds the takes of a table, with the rates of each; `naming` says how points are named, else
    /// the names tell. Takes of a rate below 10 or without .7 seconds of a whole body are left out:
    /// how many is returned. One whose name is known gets a number behind it.
    ///
    /// # Errors
    /// [`Error::Unfit`]: the table has no names of a body.
    pub fn add(
        &mut self,
        poses: &Poses,
        rates: &[Option<f64>],
        naming: Option<&PointNaming>,
        name: &str,
    ) -> Result<usize> {
        let (tree, columns) = BodyTree::of_table(poses, naming)?;
        let runs = poses.runs();
        let mut left_out = 0;
        for (take, rate) in poses.takes().into_iter().zip(rates) {
            let own = match &poses.take {
                Some(names) if !names[take.start].is_empty() => names[take.start].to_string(),
                _ => name.to_string(),
            };
            let frames = BodyTree::frames(poses.xyz.slice(s![take.clone(), ..]), &columns);
            let is_whole = |t: &usize| frames.row(*t).iter().all(|v| v.is_finite());
            let mut clips = Vec::new();
            if let Some(rate) = rate.filter(|rate| *rate >= SLOWEST) {
                let own_runs = runs.iter().filter(|r| take.contains(&r.start));
                for run in own_runs {
                    let run = run.start - take.start..run.end - take.start;
                    for whole in ranges(run.filter(is_whole)) {
                        let part = frames.slice(s![whole.clone(), ..]).to_owned();
                        let count = ((whole.len() - 1) as f64 * RATE / rate + 1e-6) as usize + 1;
                        let at = (0..count).map(|k| k as f64 * rate / RATE);
                        let part = sampled(&part, &at.collect::<Vec<_>>());
                        if part.nrows() >= FEWEST {
                            clips.push((whole.start as f64 / rate, part));
                        }
                    }
                }
            }
            if clips.is_empty() {
                left_out += 1;
                continue;
            }
            let others = (2..).map(|n| format!("{own} ({n})"));
            let mut names = std::iter::once(own.clone()).chain(others);
            let is_new = |name: &String| self.takes.iter().all(|t| t.name != *name);
            self.takes.push(LibraryTake {
                name: names.find(is_new).unwrap_or(own),
                person: self.person_of(&tree, &clips[0].1),
                points: tree.names.clone(),
            });
            for (start, frames) in clips {
                let xyz = Array2::from_shape_fn((frames.nrows(), 3 * frames.ncols()), |(t, i)| {
                    frames[[t, i / 3]][i % 3] as f32
                });
                self.clips.push(LibraryClip {
                    take: self.takes.len() - 1,
                    start,
                    xyz,
                });
            }
        }
        Ok(left_out)
    }

    /// Whose motion some frames are: a person's whose bones are the same, else a new one's.
    fn person_of(&self, tree: &BodyTree, frames: &Frames) -> usize {
        let lengths = tree.lengths(frames);
        let is_same = |person: &usize| {
            let mut clips = self.clips.iter();
            let first = clips.find(|c| self.takes[c.take].person == *person);
            first.is_some_and(|clip| {
                let known = tree.lengths(&clip.frames());
                let bones = lengths.iter().zip(&known).filter(|(a, _)| **a > SHORT_BONE);
                self.takes[clip.take].points == tree.names
                    && bones.clone().all(|(a, b)| (a - b).abs() <= ONE_PERSON * a)
            })
        };
        let people = self.people();
        (0..people).find(is_same).unwrap_or(people)
    }

    /// The number of people.
    pub fn people(&self) -> usize {
        self.takes.iter().map(|t| t.person + 1).max().unwrap_or(0)
    }

    /// The seconds of motion.
    pub fn seconds(&self) -> f64 {
        let frames: usize = self.clips.iter().map(|c| c.xyz.nrows()).sum();
        frames as f64 / RATE
    }

    /// The takes that are a body's own: of the same bones, and where it is in all of some frames.
    fn copies(&self, tree: &BodyTree, frames: &Frames, lengths: &[f64]) -> Vec<usize> {
        let is_whole = |t: &usize| frames.row(*t).iter().all(|v| v.is_finite());
        let whole: Vec<usize> = (0..frames.nrows()).filter(is_whole).collect();
        let step = whole.len().div_ceil(COMPARED).max(1);
        let some: Vec<usize> = whole.into_iter().step_by(step).collect();
        let mut met = vec![vec![false; some.len()]; self.takes.len()];
        for clip in &self.clips {
            let take = &self.takes[clip.take];
            if take.points != tree.names {
                continue;
            }
            let own = clip.frames();
            let is_other = |(a, b): (&f64, &f64)| *a > SHORT_BONE && (a - b).abs() > ONE_PERSON * a;
            if lengths.iter().zip(&tree.lengths(&own)).any(is_other) {
                continue;
            }
            for (t, met) in some.iter().zip(&mut met[clip.take]) {
                let near = |row: ndarray::ArrayView1<'_, DVec3>| {
                    let pairs = row.into_iter().zip(frames.row(*t));
                    let squares = pairs.map(|(a, b)| a.distance_squared(*b)).sum::<f64>();
                    squares < NEAR * NEAR * tree.points() as f64
                };
                *met |= own.rows().into_iter().any(near);
            }
        }
        let is_copy = |take: &usize| !met[*take].is_empty() && met[*take].iter().all(|m| *m);
        (0..met.len()).filter(is_copy).collect()
    }

    /// The clips as motion of a body with other bones, and their mirror images; takes that lack
    /// points of the body are left out, and so are copies of `own` frames, which would show what
    /// simulated gaps hide.
    pub(crate) fn clips_for(
        &self,
        tree: &BodyTree,
        own: Option<&Frames>,
        lengths: &[f64],
    ) -> Vec<Clip> {
        let copies = own.map_or(Vec::new(), |own| self.copies(tree, own, lengths));
        let mut out = Vec::new();
        for clip in self.clips.iter().filter(|c| !copies.contains(&c.take)) {
            let take = &self.takes[clip.take];
            let column = |name: &String| take.points.iter().position(|p| p == name);
            let Some(columns) = tree.names.iter().map(column).collect::<Option<Vec<_>>>() else {
                continue;
            };
            let frames = clip.frames().select(ndarray::Axis(1), &columns);
            let own = tree.legs(&tree.lengths(&frames));
            let scale = if own > 0.0 {
                tree.legs(lengths) / own
            } else {
                1.0
            };
            let frames = tree.with_lengths(&frames, scale, lengths);
            let origin = Origin {
                take: clip.take,
                person: take.person,
                start: (clip.start * RATE).round() as usize,
                seconds: clip.start,
            };
            out.extend(Clip::both(tree, frames, origin));
        }
        out
    }

    /// The library as a model, without a history.
    pub fn to_model(&self) -> Model {
        let mut model = Model::new(KIND, &cmu_names(), "world");
        let width = 3 * CMU.len();
        let rows: usize = self.clips.iter().map(|c| c.xyz.nrows()).sum();
        let mut all = Array2::from_elem((rows, width), f32::NAN);
        let mut row = 0;
        for clip in &self.clips {
            let names = &self.takes[clip.take].points;
            for (p, name) in names.iter().enumerate() {
                let at = CMU.iter().position(|c| c == name).unwrap_or(0);
                let rows = row..row + clip.xyz.nrows();
                all.slice_mut(s![rows, 3 * at..3 * at + 3])
                    .assign(&clip.xyz.slice(s![.., 3 * p..3 * p + 3]));
            }
            row += clip.xyz.nrows();
        }
        model.insert("motion", all);
        let clips: Vec<ClipMeta> = (self.clips.iter())
            .map(|c| ClipMeta {
                take: c.take,
                start: c.start,
                frames: c.xyz.nrows(),
            })
            .collect();
        let details = &mut model.meta.details;
        details.insert("rate".into(), RATE.into());
        // Names and numbers: cannot fail.
        details.insert(
            "takes".into(),
            serde_json::to_value(&self.takes).unwrap_or_default(),
        );
        details.insert(
            "clips".into(),
            serde_json::to_value(&clips).unwrap_or_default(),
        );
        model
    }

    /// The library of a model; `source` names it in errors.
    ///
    /// # Errors
    /// [`Error::Data`]: the model is of another kind, or damaged.
    pub fn from_model(model: &Model, source: &str) -> Result<MotionLibrary> {
        model.check_kind(
            KIND,
            "no library of motion; prior-train makes one, with its option `motion`",
            source,
        )?;
        let damaged = || Error::data(Place::file(source), "is a damaged library of motion");
        let read = |name: &str| model.meta.details.get(name).cloned().unwrap_or_default();
        let takes: Vec<LibraryTake> =
            serde_json::from_value(read("takes")).map_err(|_| damaged())?;
        let metas: Vec<ClipMeta> = serde_json::from_value(read("clips")).map_err(|_| damaged())?;
        let motion = model.array("motion", source)?;
        let mut clips = Vec::new();
        let mut row = 0usize;
        for meta in metas {
            let take = takes.get(meta.take).ok_or_else(damaged)?;
            let end = row.checked_add(meta.frames).ok_or_else(damaged)?;
            let is_sound = meta.frames >= 2
                && end <= motion.nrows()
                && motion.ncols() == 3 * CMU.len()
                && (0.0..=1e7).contains(&meta.start)
                && take.person < takes.len();
            if !is_sound {
                return Err(damaged());
            }
            let column = |name: &String| CMU.iter().position(|c| c == name);
            let columns: Option<Vec<usize>> = take.points.iter().map(column).collect();
            let columns = columns.ok_or_else(damaged)?;
            let columns: Vec<usize> = columns.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
            let xyz = (motion.slice(s![row..end, ..])).select(ndarray::Axis(1), &columns);
            if BodyTree::of(&take.points).is_none() || xyz.iter().any(|v| !v.is_finite()) {
                return Err(damaged());
            }
            row = end;
            clips.push(LibraryClip {
                take: meta.take,
                start: meta.start,
                xyz,
            });
        }
        if row != motion.nrows() {
            return Err(damaged());
        }
        Ok(MotionLibrary { takes, clips })
    }
}

impl LibraryClip {
    fn frames(&self) -> Frames {
        let wide = self.xyz.mapv(f64::from);
        let shape = (wide.nrows(), wide.ncols() / 3);
        Array2::from_shape_fn(shape, |(t, p)| -> DVec3 { point_at(wide.view(), t, p) })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::body_tree::tests::walk;

    /// A table of a walk at some rate.
    pub(crate) fn table(name: &str, frames: usize, rate: f64, pace: f64, scale: f64) -> Poses {
        let (tree, walk) = walk(frames, rate, pace);
        let flat = Array2::from_shape_fn((frames, 3 * tree.points()), |(t, i)| {
            scale * walk[[t, i / 3]][i % 3]
        });
        Poses {
            points: tree.names,
            xyz: flat,
            time: Some((0..frames).map(|t| t as f64 / rate).collect()),
            take: Some(vec![name.into(); frames]),
        }
    }

    fn library() -> MotionLibrary {
        let mut library = MotionLibrary::default();
        let mut gappy = table("b", 400, 120.0, 1.1, 1.0);
        gappy.xyz.slice_mut(s![200, 3..6]).fill(f64::NAN);
        for poses in [
            table("a", 90, 30.0, 1.0, 1.0),
            gappy,
            table("c", 90, 30.0, 1.0, 0.9),
        ] {
            let rates = poses.rates();
            assert_eq!(library.add(&poses, &rates, None, "t").unwrap(), 0);
        }
        library
    }

    #[test]
    fn takes_are_kept_at_one_rate_and_people_told_by_their_bones() {
        let library = library();
        let people: Vec<usize> = library.takes.iter().map(|t| t.person).collect();
        assert_eq!((people, library.people()), (vec![0, 0, 1], 2));
        let frames: Vec<usize> = library.clips.iter().map(|c| c.xyz.nrows()).collect();
        assert_eq!(frames, [90, 50, 50, 90]);
        assert!((library.clips[2].start - 201.0 / 120.0).abs() < 1e-9);
        let again = table("a", 90, 30.0, 1.0, 1.0);
        let mut more = library.clone();
        more.add(&again, &again.rates(), None, "t").unwrap();
        assert_eq!(more.takes[3].name, "a (2)");
        assert_eq!(more.add(&again, &[Some(0.001)], None, "t").unwrap(), 1);
    }

    #[test]
    fn a_library_is_the_same_after_writing_and_reading() {
        let library = library();
        let bytes = library.to_model().to_bytes().unwrap();
        let model = Model::from_bytes(bytes, "m").unwrap();
        assert_eq!(MotionLibrary::from_model(&model, "m").unwrap(), library);
        let mut cut = model.clone();
        cut.insert("motion", Array2::zeros((12, 69)));
        assert!(MotionLibrary::from_model(&cut, "m").is_err());
        cut.meta.kind = "sparse".into();
        let said = MotionLibrary::from_model(&cut, "m")
            .unwrap_err()
            .to_string();
        assert!(said.contains("prior-train"), "{said}");
    }
}
