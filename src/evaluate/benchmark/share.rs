//! Parts a benchmark for several machines, and joins the results of the parts.

use super::result::Case;
use super::runner::{Benchmark, Results};
use crate::{Error, Place, Result};
use std::collections::BTreeMap;
use std::str::FromStr;

/// One of several shares of the cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Share {
    /// Which share, 1 to `count`.
    index: usize,
    /// The number of shares.
    count: usize,
}

impl FromStr for Share {
    type Err = String;

    /// Parses `I/N`, I from 1 to N.
    fn from_str(text: &str) -> std::result::Result<Share, String> {
        let numbers = text.split_once('/').and_then(|(index, count)| {
            let (index, count) = (index.parse().ok()?, count.parse().ok()?);
            (1..=count)
                .contains(&index)
                .then_some(Share { index, count })
        });
        numbers.ok_or_else(|| "expected I/N, such as 3/8, I from 1 to N".into())
    }
}

impl Benchmark<'_> {
    /// The cases of a share. Cases of one trained model stay together, and the trainings of each method are dealt out in
    /// turn, so that shares take about equally long. A share is empty where there are more shares than trainings.
    pub fn cases_of(&self, share: Share) -> Vec<Case> {
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
        cases.retain(|case| training(case).is_some_and(|t| t % share.count == share.index - 1));
        cases
    }

    /// Joins the results of several runs, each with the name of its file. Results of more seeds or splits do no harm.
    ///
    /// # Errors
    /// [`Error::Data`] with the file: a result is of other takes or settings, or two results of a case differ.
    pub fn merge(&self, runs: Vec<(String, Results)>) -> Result<Results> {
        let mut merged = Results::new();
        for (name, results) in runs {
            for (key, result) in results {
                let wrong = match merged.get(&key) {
                    _ if !self.is_own(&key, &result) => {
                        "is of other takes, other settings or another version; give the tables and flags of its run"
                    }
                    Some(first) if first.test != result.test => {
                        "has other numbers in another folder; was it run by another build or processor?"
                    }
                    _ => {
                        merged.insert(key, result);
                        continue;
                    }
                };
                let what = format!("the result of {} {wrong}", result.case.describe());
                return Err(Error::data(Place::file(name), what));
            }
        }
        Ok(merged)
    }
}
