//! Training part and test part: three ways to divide the poses without leakage.

use super::dataset::Dataset;
use super::leakage::DuplicateTake;
use crate::numeric::parallel;
use crate::{Error, Result};
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

/// How poses are divided into a training and a test part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// A random half of the frames, as in Lai et al. A test frame has its neighbors in time in the
    /// training half.
    Frames,
    /// Whole takes held out: of each subject a third, at least two.
    Takes,
    /// Whole subjects held out: a fifth of them, at least one; other seeds hold out others.
    Subjects,
}

names!(Split {
    Frames = "frames",
    Takes = "takes",
    Subjects = "subjects",
});

impl Split {
    /// Parses a name.
    ///
    /// # Errors
    /// [`Error::Usage`] for an unknown name.
    pub fn parse(name: &str) -> Result<Split> {
        Split::of_name(name).ok_or_else(|| {
            Error::usage(format!(
                "the option `splits {name}`: expected frames, takes or subjects"
            ))
        })
    }

    /// The reason why the dataset cannot be divided this way; `None` if it can.
    pub(crate) fn impossible(self, data: &Dataset, twins: &[DuplicateTake]) -> Option<String> {
        let groups = groups(data, twins);
        let units = match self {
            Split::Frames => data.xyz.nrows(),
            Split::Takes => distinct(&groups).len(),
            Split::Subjects => distinct(&by_subject(data, &groups)).len(),
        };
        // The split by takes needs a subject with two takes.
        let lone = self == Split::Takes && held_takes(data, &groups, 0).is_empty();
        (units < 2 || lone).then(|| match self {
            Split::Frames => "needs at least 2 complete frames".into(),
            Split::Takes => "needs a subject with at least 2 different takes".into(),
            Split::Subjects => "needs takes of at least 2 subjects that share none".into(),
        })
    }
}

/// Training rows and test rows of a split: no row is on both sides; under `takes` and `subjects`
/// also no take and no duplicate of a take, under `subjects` also no subject.
#[derive(Debug, Clone, PartialEq)]
pub struct Partition {
    /// The split.
    pub split: Split,
    /// The seed.
    pub seed: u64,
    /// Training rows, ascending.
    pub train: Vec<usize>,
    /// Test rows, ascending.
    pub test: Vec<usize>,
}

impl Partition {
    /// Divides the dataset; takes that share poses stay on one side.
    ///
    /// # Errors
    /// [`Error::Usage`] if the dataset is too small for the split.
    pub(crate) fn draw(
        data: &Dataset,
        twins: &[DuplicateTake],
        split: Split,
        seed: u64,
    ) -> Result<Partition> {
        if let Some(why) = split.impossible(data, twins) {
            return Err(Error::usage(format!(
                "the option `splits {}`: {why}",
                split.name()
            )));
        }
        let frames = data.xyz.nrows();
        let mut tested = vec![false; frames];
        let groups = groups(data, twins);
        match split {
            Split::Frames => {
                let mut order: Vec<usize> = (0..frames).collect();
                order.shuffle(&mut parallel::rng(seed, 1));
                order[..frames / 2].iter().for_each(|&r| tested[r] = true);
            }
            Split::Takes => {
                let held = held_takes(data, &groups, seed);
                mark(data, &groups, &held, &mut tested);
            }
            Split::Subjects => {
                let groups = by_subject(data, &groups);
                let held = held_subjects(&groups, seed);
                mark(data, &groups, &held, &mut tested);
            }
        }
        let (test, train) = (0..frames).partition(|&r| tested[r]);
        Ok(Partition {
            split,
            seed,
            train,
            test,
        })
    }

    /// At most `count` of the test rows, chosen at random, ascending.
    pub(crate) fn some_test(&self, count: usize) -> Vec<usize> {
        some(&self.test, count, self.seed, 3)
    }
    /// At most `count` of the training rows, chosen at random, ascending.
    pub(crate) fn some_train(&self, count: usize) -> Vec<usize> {
        some(&self.train, count, self.seed, 4)
    }
}

fn some(rows: &[usize], count: usize, seed: u64, stream: u64) -> Vec<usize> {
    let mut random = parallel::rng(seed, stream);
    let amount = count.min(rows.len());
    let mut chosen = rand::seq::index::sample(&mut random, rows.len(), amount).into_vec();
    chosen.sort_unstable();
    chosen.into_iter().map(|i| rows[i]).collect()
}

/// The group of each take: takes that share poses have the same group, named by its first take.
fn groups(data: &Dataset, twins: &[DuplicateTake]) -> Vec<usize> {
    let mut group: Vec<usize> = (0..data.takes.len()).collect();
    for twin in twins {
        join(&mut group, twin.a, twin.b);
    }
    group
}

/// Joins the groups of two takes.
fn join(group: &mut [usize], a: usize, b: usize) {
    let (keep, lose) = (group[a].min(group[b]), group[a].max(group[b]));
    group
        .iter_mut()
        .filter(|g| **g == lose)
        .for_each(|g| *g = keep);
}

/// Groups in which all takes of a subject are joined.
fn by_subject(data: &Dataset, groups: &[usize]) -> Vec<usize> {
    let mut group = groups.to_vec();
    for subject in data.subjects() {
        let own: Vec<usize> = (0..group.len())
            .filter(|&k| data.takes[k].subject == subject)
            .collect();
        own.windows(2).for_each(|w| join(&mut group, w[0], w[1]));
    }
    group
}

fn distinct(groups: &[usize]) -> Vec<usize> {
    let mut all = groups.to_vec();
    all.sort_unstable();
    all.dedup();
    all
}

/// The groups held out under `takes`: of each subject a third, at least two, but never all.
fn held_takes(data: &Dataset, groups: &[usize], seed: u64) -> Vec<usize> {
    let mut held = Vec::new();
    for (k, subject) in data.subjects().into_iter().enumerate() {
        // A group belongs to the subject of its first take.
        let mut own: Vec<usize> = distinct(groups)
            .into_iter()
            .filter(|&g| data.takes[g].subject == subject)
            .collect();
        let count = (own.len() / 3).max(2).min(own.len().saturating_sub(1));
        own.shuffle(&mut parallel::rng(seed, 1000 + k as u64));
        held.extend(&own[..count]);
    }
    held
}

/// The groups held out under `subjects`. All seeds share one random order, and each seed starts
/// where the previous one ended, so that consecutive seeds hold out every subject once.
fn held_subjects(groups: &[usize], seed: u64) -> Vec<usize> {
    let mut all = distinct(groups);
    all.shuffle(&mut parallel::rng(0, 2));
    let count = (all.len() / 5).max(1);
    let from = (seed % all.len() as u64) as usize * count;
    (0..count).map(|i| all[(from + i) % all.len()]).collect()
}

fn mark(data: &Dataset, groups: &[usize], held: &[usize], tested: &mut [bool]) {
    for (take, group) in data.takes.iter().zip(groups) {
        if held.contains(group) {
            tested[take.rows.clone()].fill(true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::dataset::tests::takes;
    use super::super::leakage::DuplicateEvidence;
    use super::*;
    use std::collections::BTreeSet;

    fn data() -> Dataset {
        let mut list = Vec::new();
        for (subject, count) in [("01", 7), ("02", 3), ("05", 1), ("07", 2)] {
            for k in 0..count {
                list.push((format!("{subject}_{k:02}"), 6 + k));
            }
        }
        let list: Vec<(&str, usize)> = list.iter().map(|(n, c)| (n.as_str(), *c)).collect();
        takes(&list)
    }

    #[test]
    fn parts_are_disjoint_cover_everything_and_are_seeded() {
        let data = data();
        for split in Split::ALL {
            let draw = |seed| Partition::draw(&data, &[], split, seed).unwrap();
            for seed in 0..8 {
                let part = draw(seed);
                let mut all = [&part.train[..], &part.test].concat();
                all.sort_unstable();
                assert_eq!(all, (0..data.xyz.nrows()).collect::<Vec<_>>());
                assert_eq!(part, draw(seed));
                let some = part.some_test(5);
                assert!(some.len() == 5 && some.iter().all(|r| part.test.contains(r)));
                assert_eq!(part.some_test(10_000), part.test);
            }
            assert_ne!(draw(0), draw(1), "{split:?}");
        }
        let half = Partition::draw(&data, &[], Split::Frames, 3).unwrap();
        assert_eq!(half.test.len(), data.xyz.nrows() / 2);
    }

    /// Whether each take has a row among these.
    fn sides(data: &Dataset, rows: &[usize]) -> Vec<bool> {
        let mut side = vec![false; data.takes.len()];
        rows.iter().for_each(|&r| side[data.take_of(r)] = true);
        side
    }

    #[test]
    fn takes_and_subjects_are_held_out_whole() {
        let data = data();
        let mut held = Vec::new();
        for seed in 0..8 {
            let part = Partition::draw(&data, &[], Split::Takes, seed).unwrap();
            let [learned, tested] = [&part.train, &part.test].map(|rows| sides(&data, rows));
            assert!(learned.iter().zip(&tested).all(|(l, t)| l != t));
            let count = |subject: &str| {
                let both = data.takes.iter().zip(&tested);
                both.filter(|(t, s)| t.subject == subject && **s).count()
            };
            assert_eq!(["01", "02", "05", "07"].map(count), [2, 2, 0, 1]);
            let part = Partition::draw(&data, &[], Split::Subjects, seed).unwrap();
            let subjects = |rows| -> BTreeSet<&str> {
                let takes = data.takes.iter().zip(sides(&data, rows));
                takes
                    .filter_map(|(t, s)| s.then_some(&*t.subject))
                    .collect()
            };
            let (learned, tested) = (subjects(&part.train), subjects(&part.test));
            assert!(learned.is_disjoint(&tested) && tested.len() == 1);
            held.extend(tested.into_iter().filter(|_| seed < 4));
        }
        // Consecutive seeds hold out every subject once.
        held.sort_unstable();
        assert_eq!(held, data.subjects());
    }

    #[test]
    fn duplicates_stay_on_one_side() {
        let data = data();
        let twin = |a, b| DuplicateTake {
            a,
            b,
            evidence: DuplicateEvidence::Poses,
            share: 1.0,
        };
        // A take of 01 equals one of 02 and one of 07.
        let twins = [twin(0, 8), twin(8, 12)];
        for (seed, split) in (0..10).flat_map(|s| [(s, Split::Takes), (s, Split::Subjects)]) {
            let part = Partition::draw(&data, &twins, split, seed).unwrap();
            let [learned, tested] = [&part.train, &part.test].map(|rows| sides(&data, rows));
            assert!(learned.iter().zip(&tested).all(|(l, t)| l != t));
            assert!(tested[0] == tested[8] && tested[8] == tested[12]);
        }
    }

    #[test]
    fn too_small_datasets_are_refused() {
        let one = takes(&[("01_01", 5)]);
        for split in [Split::Takes, Split::Subjects] {
            let e = Partition::draw(&one, &[], split, 0).unwrap_err();
            assert!(e.to_string().contains("needs") && e.exit_code() == 2, "{e}");
        }
        let lone = takes(&[("01_01", 5), ("02_01", 5)]);
        assert!(Split::Takes.impossible(&lone, &[]).is_some());
        assert!(Split::Subjects.impossible(&lone, &[]).is_none());
        assert!(Split::parse("halves").is_err());
    }
}
