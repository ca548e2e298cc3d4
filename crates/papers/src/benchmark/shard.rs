//! Divides a benchmark among machines, and joins their results.

use super::result::{BenchmarkResult, Case};
use super::runner::{Benchmark, Results};
use crate::{Error, Place, Result};
use std::collections::BTreeMap;
use std::str::FromStr;

/// One of several shards of the cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// The number of this shard, 1 to `count`.
    index: usize,
    /// The number of shards.
    count: usize,
}

impl FromStr for Shard {
    type Err = Error;

    /// Parses `I/N`, I from 1 to N.
    fn from_str(text: &str) -> Result<Shard> {
        let numbers = text.split_once('/').and_then(|(index, count)| {
            let (index, count) = (index.parse().ok()?, count.parse().ok()?);
            (1..=count)
                .contains(&index)
                .then_some(Shard { index, count })
        });
        numbers.ok_or_else(|| "expected I/N, such as 3/8, I from 1 to N".into())
    }
}

impl Benchmark<'_> {
    /// The cases of a shard. Cases of one trained model stay together, and the trainings of each
    /// method are dealt out in turn, so that shards take about equally long. A shard is empty
    /// where there are more shards than trainings.
    pub fn cases_of(&self, shard: Shard) -> Vec<Case> {
        let mut trainings = BTreeMap::new();
        for method in &self.settings.methods {
            for &split in &self.settings.splits {
                for seed in self.settings.seeds() {
                    let next = trainings.len();
                    trainings
                        .entry((method.recipe(), split, seed))
                        .or_insert(next);
                }
            }
        }
        let training = |case: &Case| {
            let recipe = self.method_of(case)?.recipe();
            trainings.get(&(recipe, case.split, case.seed))
        };
        let mut cases = self.cases();
        cases.retain(|case| training(case).is_some_and(|t| t % shard.count == shard.index - 1));
        cases
    }

    /// Joins the results of several runs, each with the name of its file, and counts the results of
    /// other takes or settings, which are left out.
    ///
    /// # Errors
    /// [`Error::Data`] with the file: all its results are of other takes or settings, or one
    /// differs from that of another file.
    pub fn merge(&self, runs: Vec<(String, Results)>) -> Result<(Results, usize)> {
        let (mut merged, mut foreign) = (Results::new(), 0);
        for (name, mut results) in runs {
            let all = results.len();
            results.retain(|key, result| self.is_own(key, result));
            foreign += all - results.len();
            if results.is_empty() && all > 0 {
                let what = "has only results of other takes, other settings or another version; \
                            give the tables and flags of its run";
                return Err(Error::data(Place::file(name), what));
            }
            for (key, result) in results {
                let first = merged.get(&key);
                if first.is_some_and(|first: &BenchmarkResult| first.test != result.test) {
                    let what = format!(
                        "the result of {} has other numbers than in another folder; was it run by \
                         another build or processor?",
                        result.case.describe()
                    );
                    return Err(Error::data(Place::file(name), what));
                }
                merged.insert(key, result);
            }
        }
        Ok((merged, foreign))
    }
}
