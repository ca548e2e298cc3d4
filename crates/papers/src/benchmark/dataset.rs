//! The poses that models are trained and tested on: complete frames in body space, by take and
//! subject.

use crate::pose::{Poses, Space};
use crate::prior::{
    provenance::{digest, hex},
    training_set::TrainingSet,
};
use crate::{Error, Place, Result};
use ndarray::{Array2, Axis, s};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Largest distance of a root from the origin along an axis, cm: the rounding of a table.
const MAX_ROOT_OFFSET: f64 = 0.01;

/// A take.
#[derive(Debug, Clone, PartialEq)]
pub struct Take {
    /// The name, unique in the dataset.
    pub name: String,
    /// The captured person.
    pub subject: String,
    /// The rows in [`Dataset::xyz`], in time order.
    pub rows: Range<usize>,
    /// Frames a second, if the table has times.
    pub rate: Option<f64>,
    /// The digest of the poses, as models store it in their history.
    pub digest: String,
}

/// Complete poses in body space, and their takes.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// The names of the J points.
    pub points: Vec<String>,
    /// (frames, 3 J), cm.
    pub xyz: Array2<f32>,
    /// The takes, in the order of their rows; together they cover all rows.
    pub takes: Vec<Take>,
    /// The number of frames left out because a point was missing.
    pub incomplete: usize,
}

impl Dataset {
    /// Joins tables, each with its name. A table without takes is one take with the table's name.
    /// The subject of a take is given by `subjects`, else by the part of its name before the
    /// first `_`.
    ///
    /// # Errors
    /// [`Error::Data`] for tables with different points, a take in two tables, poses that are not
    /// in body space, or no complete frame; [`Error::Usage`] without a table.
    pub fn new(tables: &[(String, Poses)], subjects: &BTreeMap<String, String>) -> Result<Dataset> {
        let points = match tables.first() {
            Some((_, first)) => first.points.clone(),
            None => return Err(Error::usage("no table of poses given")),
        };
        let mut data = Dataset {
            points,
            xyz: Array2::zeros((0, 0)),
            takes: Vec::new(),
            incomplete: 0,
        };
        let (mut rows, mut seen) = (Vec::new(), BTreeMap::new());
        for (table, poses) in tables {
            if poses.points != data.points {
                let what = format!("has points that differ from those of {}", tables[0].0);
                return Err(Error::data(Place::file(table), what));
            }
            for range in poses.takes() {
                let name = poses.take.as_ref().map(|takes| &*takes[range.start]);
                let name = name.unwrap_or(table).to_string();
                if let Some(before) = seen.insert(name.clone(), table) {
                    let what = format!(
                        "take {name} appears again, after {before}; rename one, or leave it out"
                    );
                    return Err(Error::data(Place::file(table), what));
                }
                data.add((table, poses), range, name, subjects, &mut rows)?;
            }
        }
        let width = 3 * data.points.len();
        let frames = rows.len() / width.max(1);
        if frames == 0 {
            return Err(Error::data(
                Place::file(&tables[0].0),
                "has no frame without missing points",
            ));
        }
        data.xyz = Array2::from_shape_vec((frames, width), rows)
            .map_err(|e| Error::usage(e.to_string()))?;
        for take in &mut data.takes {
            take.digest = digest(&data.points, data.xyz.slice(s![take.rows.clone(), ..]));
        }
        Ok(data)
    }

    /// Adds the complete frames of one take to `rows`.
    fn add(
        &mut self,
        (table, poses): (&str, &Poses),
        range: Range<usize>,
        name: String,
        subjects: &BTreeMap<String, String>,
        rows: &mut Vec<f32>,
    ) -> Result<()> {
        let width = 3 * self.points.len();
        let root = self.points.iter().position(|p| p == "root");
        let start = rows.len() / width.max(1);
        for t in range.clone() {
            let frame = poses.frame(t);
            if frame.iter().any(|v| !(*v as f32).is_finite()) {
                self.incomplete += 1;
                continue;
            }
            if let Some(root) = root
                && (0..3).any(|a| frame[3 * root + a].abs() > MAX_ROOT_OFFSET)
            {
                let what = "has a root away from the origin; evaluate needs body space, which \
                            amc2xyz makes with the option `space body`";
                let place = Place::file(table).part(format!("take {name}"));
                return Err(Error::data(place, what));
            }
            rows.extend(frame.iter().map(|v| *v as f32));
        }
        let end = rows.len() / width.max(1);
        if end > start {
            let before = name.split('_').next().unwrap_or(&name).to_string();
            self.takes.push(Take {
                subject: subjects.get(&name).cloned().unwrap_or(before),
                name,
                rows: start..end,
                rate: poses.rate_within(range),
                digest: String::new(),
            });
        }
        Ok(())
    }

    /// The index of the take that contains a row.
    pub(crate) fn take_of(&self, row: usize) -> usize {
        self.takes.partition_point(|t| t.rows.end <= row)
    }

    /// The subjects, sorted.
    pub(crate) fn subjects(&self) -> Vec<&str> {
        let mut all: Vec<&str> = self.takes.iter().map(|t| t.subject.as_str()).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Tells this data from any other: points, takes, subjects and poses.
    pub(crate) fn digest(&self) -> String {
        let mut hash = Sha256::new();
        for take in &self.takes {
            hash.update(format!(
                "{}\n{}\n{}\n",
                take.name, take.subject, take.digest
            ));
        }
        hex(&hash.finalize())
    }

    /// Rows as an array: (rows, 3 J), cm.
    pub(crate) fn rows(&self, rows: &[usize]) -> Array2<f64> {
        self.xyz.select(Axis(0), rows).mapv(f64::from)
    }

    /// Ascending rows as training poses; their takes stay apart.
    ///
    /// # Errors
    /// [`Error::Data`] if no row is given.
    pub(crate) fn training(&self, rows: &[usize]) -> Result<TrainingSet> {
        let names: Vec<Arc<str>> = self
            .takes
            .iter()
            .map(|t| Arc::from(t.name.as_str()))
            .collect();
        let poses = Poses {
            points: self.points.clone(),
            xyz: self.rows(rows),
            time: None,
            take: Some(
                rows.iter()
                    .map(|&r| names[self.take_of(r)].clone())
                    .collect(),
            ),
        };
        TrainingSet::from_poses(&poses, Space::Body, "the training part")
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::numeric::parallel;
    use crate::pose::joints;
    use rand::Rng;

    /// Takes of random walks near a body: (name, frames) each.
    pub(crate) fn takes(list: &[(&str, usize)]) -> Dataset {
        Dataset::new(&[source(list)], &BTreeMap::new()).unwrap()
    }

    pub(crate) fn source(list: &[(&str, usize)]) -> (String, Poses) {
        let frames = list.iter().map(|l| l.1).sum();
        let mut xyz = Array2::zeros((frames, 69));
        let (mut take, mut t) = (Vec::new(), 0);
        for (k, (name, count)) in list.iter().enumerate() {
            let mut random = parallel::rng(77, k as u64);
            let mut phase: Vec<f64> = (0..4).map(|_| random.random::<f64>() * 6.0).collect();
            for _ in 0..*count {
                for (p, step) in phase.iter_mut().zip([0.11, 0.07, 0.05, 0.13]) {
                    *p += step * (0.5 + random.random::<f64>());
                }
                for i in 3..69 {
                    // Left joints (2 to 5, 16 to 19) stand at positive x, right ones opposite.
                    let side = match (i / 3, i % 3) {
                        (1..=4 | 15..=18, 0) => 15.0,
                        (5..=8 | 19..=22, 0) => -15.0,
                        _ => 0.0,
                    };
                    let j = (i * 7 % 23) as f64;
                    let wave =
                        (phase[i % 4] + j).sin() + 0.3 * (phase[(i + 1) % 4] * 1.7 + j).cos();
                    xyz[[t, i]] = side + 6.0 * wave + 0.5 * (i as f64);
                }
                take.push(Arc::from(*name));
                t += 1;
            }
        }
        let poses = Poses {
            points: joints::cmu_names(),
            xyz,
            time: None,
            take: Some(take),
        };
        ("walks.csv".into(), poses)
    }

    #[test]
    fn takes_keep_their_names_subjects_and_rows() {
        let data = takes(&[("01_01", 5), ("01_02", 4), ("02_01", 3)]);
        assert_eq!(data.subjects(), ["01", "02"]);
        assert_eq!(data.takes[1].rows, 5..9);
        assert_eq!(
            (0..12).map(|r| data.take_of(r)).collect::<Vec<_>>(),
            [0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2]
        );
        let training = data.training(&[0, 2, 5, 6, 11]).unwrap();
        assert_eq!(training.takes, [0..2, 2..4, 4..5]);
    }

    #[test]
    fn a_mapping_names_subjects_and_incomplete_frames_are_left_out() {
        let mut source = source(&[("walk", 5), ("run", 5)]);
        source.1.xyz[[1, 30]] = f64::NAN;
        let map = BTreeMap::from([("run".to_string(), "anna".to_string())]);
        let data = Dataset::new(&[source], &map).unwrap();
        assert_eq!(data.subjects(), ["anna", "walk"]);
        assert_eq!((data.incomplete, data.takes[0].rows.clone()), (1, 0..4));
    }

    #[test]
    fn unusable_tables_are_refused_in_one_line() {
        let says = |tables: Vec<(String, Poses)>, part: &str| {
            let e = Dataset::new(&tables, &BTreeMap::new())
                .unwrap_err()
                .to_string();
            assert!(e.contains(part) && e.lines().count() == 1, "{e}");
        };
        says(vec![], "no table");
        says(vec![source(&[("a", 2)]), source(&[("a", 2)])], "again");
        let mut other = source(&[("b", 2)]);
        other.1.points[3] = "tail".into();
        says(vec![source(&[("a", 2)]), other], "points that differ");
        let mut world = source(&[("a", 2)]);
        world.1.xyz[[1, 1]] = 90.0;
        says(vec![world], "body space");
        let mut empty = source(&[("a", 2)]);
        empty.1.xyz.fill(f64::NAN);
        says(vec![empty], "no frame without missing points");
        says(vec![source(&[])], "no frame without missing points");
    }
}
