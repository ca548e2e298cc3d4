//! Which cells there are, and the keys by which finished ones are known again.

use super::super::cell::{Cell, Id};
use super::super::examples::Example;
use super::super::methods::Method;
use super::super::splits::Split;
use super::super::tasks::Task;
use super::Bench;
use crate::pose::ASF_UNIT_CM;
use crate::prior::provenance::hex;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

/// What is finished, by its keys.
#[derive(Debug, Clone, Default)]
pub struct Finished {
    /// Cells.
    pub cells: BTreeMap<String, Cell>,
    /// Examples.
    pub examples: BTreeMap<String, Example>,
}

impl Bench<'_> {
    /// All cells in the order of the tables.
    pub fn cells(&self) -> Vec<Id> {
        let mut all = Vec::new();
        for &split in &self.settings.splits {
            for &base in &self.settings.base {
                for task in self.settings.tasks_at(base) {
                    for method in &self.settings.methods {
                        let seeds = self.settings.seeds();
                        all.extend(seeds.map(|s| Id::of(&method.name, split, s, task, base)));
                    }
                }
            }
        }
        all
    }

    /// How many cells are not among the finished ones.
    pub fn missing(&self, finished: &Finished) -> usize {
        let digest = self.data.digest();
        let cells = self.cells();
        let missing = |id: &&Id| self.known(finished, id, &digest).is_none();
        cells.iter().filter(missing).count()
    }

    /// A finished cell; one that was read from a file is what its key says, or it is not used.
    pub(super) fn known<'f>(
        &self,
        finished: &'f Finished,
        id: &Id,
        data_digest: &str,
    ) -> Option<&'f Cell> {
        let cell = finished.cells.get(&self.key(id, data_digest))?;
        (cell.id == *id && cell.is_sound(self.data.points.len())).then_some(cell)
    }

    /// Tells a cell of these data and settings from any other.
    pub fn key(&self, id: &Id, data_digest: &str) -> String {
        let method = self.settings.methods.iter().find(|m| m.name == id.model);
        let recipe = method.map(|m| format!("{} {:?} {}", m.recipe(), m.choice, m.treated));
        let told = (
            env!("CARGO_PKG_VERSION"),
            data_digest,
            id,
            recipe,
            self.settings.frames,
            &self.settings.observe,
        );
        hex(&Sha256::digest(format!("{told:?}").as_bytes()))
    }

    /// Tells a method's examples of these data and settings from any other.
    pub(super) fn example_key(&self, method: &Method, split: Split, data_digest: &str) -> String {
        let recipe = format!("{} {:?} {}", method.recipe(), method.choice, method.treated);
        let told = (
            (env!("CARGO_PKG_VERSION"), "example", data_digest),
            (&method.name, recipe, split, self.settings.first_seed),
            (&self.settings.observe, &self.settings.tasks),
        );
        hex(&Sha256::digest(format!("{told:?}").as_bytes()))
    }
}

impl Id {
    /// A cell; the base noise in centimetres.
    pub fn of(model: &str, split: Split, seed: u64, task: Task, base: f64) -> Id {
        Id {
            model: model.into(),
            split,
            seed,
            task,
            base_asf: base / ASF_UNIT_CM,
        }
    }
}
