//! Training part and test part: three ways to divide the poses, each checked for leakage.

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
    /// A random half of the frames, as in the paper. A test frame has its neighbours in time in the training half.
    Frames,
    /// Whole takes held out: of each subject a third, at least two.
    Takes,
    /// Whole subjects held out: a fifth of them, at least one; other seeds hold out others.
    Subjects,
}

impl Split {
    /// All splits.
    pub const ALL: [Split; 3] = [Split::Frames, Split::Takes, Split::Subjects];

    /// The name a user types.
    pub fn name(self) -> &'static str {
        match self {
            Split::Frames => "frames",
            Split::Takes => "takes",
            Split::Subjects => "subjects",
        }
    }

    /// Parses a name.
    ///
    /// # Errors
    /// [`Error::Usage`] for an unknown name.
    pub fn parse(name: &str) -> Result<Split> {
        let found = Split::ALL.into_iter().find(|s| s.name() == name);
        found.ok_or_else(|| {
            Error::usage(format!(
                "--splits {name}: expected frames, takes or subjects"
            ))
        })
    }

    /// The reason why the dataset cannot be divided this way; `None` if it can.
    pub fn impossible(self, data: &Dataset, twins: &[DuplicateTake]) -> Option<String> {
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

/// Training rows and test rows of a split.
///
/// [`Partition::verified`] is the only constructor, so that every partition is checked for leakage.
#[derive(Debug, Clone, PartialEq)]
pub struct Partition {
    split: Split,
    seed: u64,
    train: Vec<usize>,
    test: Vec<usize>,
}

impl Partition {
    /// Divides the dataset; takes that share poses stay on one side.
    ///
    /// # Errors
    /// [`Error::Usage`] if the dataset is too small for the split.
    pub fn draw(
        data: &Dataset,
        twins: &[DuplicateTake],
        split: Split,
        seed: u64,
    ) -> Result<Partition> {
        if let Some(why) = split.impossible(data, twins) {
            return Err(Error::usage(format!("--splits {}: {why}", split.name())));
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
        Partition::verified(data, twins, split, seed, train, test)
    }

    /// Checks that no row is on both sides, under `takes` and `subjects` also no take and no duplicate of a take, under
    /// `subjects` also no subject. Rows must ascend.
    ///
    /// # Errors
    /// [`Error::Usage`] that names the row, take or subject on both sides.
    pub fn verified(
        data: &Dataset,
        twins: &[DuplicateTake],
        split: Split,
        seed: u64,
        train: Vec<usize>,
        test: Vec<usize>,
    ) -> Result<Partition> {
        let ascends = |rows: &[usize]| rows.windows(2).all(|w| w[0] < w[1]);
        let inside = |rows: &[usize]| rows.last().is_none_or(|&r| r < data.xyz.nrows());
        if ![&train, &test].iter().all(|r| ascends(r) && inside(r)) {
            return Err(Error::usage("the rows of a split must ascend"));
        }
        if train.is_empty() || test.is_empty() {
            return Err(Error::usage("a split needs training poses and test poses"));
        }
        let leak = |what: String| {
            let split = split.name();
            Err(Error::usage(format!(
                "{what} is in both the training and the test part, which the split {split} forbids"
            )))
        };
        if let Some(row) = test.iter().find(|r| train.binary_search(r).is_ok()) {
            let take = &data.takes[data.take_of(*row)];
            let frame = row - take.rows.start + 1;
            return leak(format!("frame {frame} of take {}", take.name));
        }
        if split != Split::Frames {
            let learnt = sides(data, &train);
            let tested = sides(data, &test);
            for (k, take) in data.takes.iter().enumerate() {
                if learnt[k] && tested[k] {
                    return leak(format!("take {}", take.name));
                }
            }
            for twin in twins {
                let apart = |a: usize, b: usize| learnt[a] && tested[b];
                if apart(twin.a, twin.b) || apart(twin.b, twin.a) {
                    return leak(twin.describe(data));
                }
            }
            if split == Split::Subjects {
                let of = |side: &[bool]| -> Vec<&str> {
                    let takes = data.takes.iter().zip(side).filter(|(_, s)| **s);
                    takes.map(|(t, _)| t.subject.as_str()).collect()
                };
                let learnt = of(&learnt);
                if let Some(both) = of(&tested).into_iter().find(|s| learnt.contains(s)) {
                    return leak(format!("subject {both}"));
                }
            }
        }
        Ok(Partition {
            split,
            seed,
            train,
            test,
        })
    }

    /// The split.
    pub fn split(&self) -> Split {
        self.split
    }
    /// The seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }
    /// Training rows, ascending.
    pub fn train(&self) -> &[usize] {
        &self.train
    }
    /// Test rows, ascending.
    pub fn test(&self) -> &[usize] {
        &self.test
    }
    /// At most `count` of the test rows, chosen at random, ascending.
    pub fn some_test(&self, count: usize) -> Vec<usize> {
        some(&self.test, count, self.seed, 3)
    }
    /// At most `count` of the training rows, chosen at random, ascending.
    pub fn some_train(&self, count: usize) -> Vec<usize> {
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

/// Whether each take has a row among these.
fn sides(data: &Dataset, rows: &[usize]) -> Vec<bool> {
    let mut side = vec![false; data.takes.len()];
    rows.iter().for_each(|&r| side[data.take_of(r)] = true);
    side
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

/// The groups held out under `subjects`. All seeds share one random order, and each seed starts where the previous one
/// ended, so that consecutive seeds hold out every subject once.
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
                let mut all = [part.train(), part.test()].concat();
                all.sort_unstable();
                assert_eq!(all, (0..data.xyz.nrows()).collect::<Vec<_>>());
                assert_eq!(part, draw(seed));
                let some = part.some_test(5);
                assert!(some.len() == 5 && some.iter().all(|r| part.test().contains(r)));
                assert_eq!(part.some_test(10_000), part.test());
            }
            assert_ne!(draw(0), draw(1), "{split:?}");
        }
        let half = Partition::draw(&data, &[], Split::Frames, 3).unwrap();
        assert_eq!(half.test().len(), data.xyz.nrows() / 2);
    }

    #[test]
    fn takes_and_subjects_are_held_out_whole() {
        let data = data();
        for seed in 0..8 {
            let part = Partition::draw(&data, &[], Split::Takes, seed).unwrap();
            let tested = sides(&data, part.test());
            let count = |subject: &str| {
                let both = data.takes.iter().zip(&tested);
                both.filter(|(t, s)| t.subject == subject && **s).count()
            };
            assert_eq!(["01", "02", "05", "07"].map(count), [2, 2, 0, 1]);
        }
        let held = |seed| {
            let part = Partition::draw(&data, &[], Split::Subjects, seed).unwrap();
            let tested = sides(&data, part.test());
            let at = tested.iter().position(|t| *t).unwrap();
            data.takes[at].subject.clone()
        };
        let mut all: Vec<String> = (0..4).map(held).collect();
        all.sort();
        assert_eq!(all, data.subjects());
    }

    #[test]
    fn a_training_take_in_the_test_part_is_refused() {
        let data = data();
        let says =
            |split, train: Vec<usize>, test: Vec<usize>, twins: &[DuplicateTake], part: &str| {
                let e = Partition::verified(&data, twins, split, 0, train, test).unwrap_err();
                assert!(e.to_string().contains(part), "{e}");
                assert_eq!(e.to_string().lines().count(), 1);
            };
        // The first take has rows 0 to 5, the second 6 to 12.
        says(
            Split::Takes,
            vec![0, 1, 2],
            vec![3, 4, 7],
            &[],
            "take 01_00",
        );
        says(Split::Subjects, vec![0, 1], vec![7, 8], &[], "subject 01");
        says(
            Split::Frames,
            vec![0, 1],
            vec![1, 2],
            &[],
            "frame 2 of take",
        );
        let twin = DuplicateTake {
            a: 0,
            b: 1,
            evidence: DuplicateEvidence::Mirrored,
            share: 1.0,
        };
        says(Split::Takes, vec![0, 1], vec![7, 8], &[twin], "01_00");
        says(Split::Takes, vec![], vec![7], &[], "needs training poses");
        says(Split::Takes, vec![2, 1], vec![7], &[], "ascend");
        says(Split::Takes, vec![1], vec![70_000], &[], "ascend");
        Partition::verified(&data, &[], Split::Frames, 0, vec![0, 2], vec![1]).unwrap();
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
        for seed in 0..10 {
            let part = Partition::draw(&data, &twins, Split::Takes, seed).unwrap();
            let tested = sides(&data, part.test());
            assert!(tested[0] == tested[8] && tested[8] == tested[12]);
            // Drawing verifies subjects: 01, 02 and 07 are joined here.
            Partition::draw(&data, &twins, Split::Subjects, seed).unwrap();
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
