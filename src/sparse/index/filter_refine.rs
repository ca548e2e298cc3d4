//! The best atoms of a few poses, sought among all atoms by their heads.
//!
//! 1. [`weigh`](super::filter_pass): of all atoms c and e, but for what is beyond the first numbers of their heads, and for what rounding those to
//!    sixteen bits changes; they are kept for the next step.
//! 2. Of a few that are [likely](super::warm_start) the best, what the [closer](super::rerank) look tells of their keys is what the best atom
//!    has at least: the bar.
//! 3. [`bar`](super::candidate_filter): which atoms may reach it, whatever is beyond?
//! 4. Those are looked at [closer](super::rerank): the best is left, or a few as good but for rounding, which are met as a scan
//!    meets them.
//!
//! Every bound allows for the rounding of the scan, so the atom is the one that the scan finds, always.

use super::super::SelectionRule;
use super::branch_and_bound::{Query, SearchResult};
use super::candidate_filter::{Bar, Sifting};
use super::filter_pass::{Look, Scale, State, Step, Weighing};
use super::packed_atoms::{Row, WIDTH, Wide};
use super::quantized_table::QuantizedTable;
use super::rerank::{Closer, Room};
use super::warm_start::{Lead, Weighed};
use crate::numeric::simd;

/// Poses that are weighed together: as many as the kernel has in registers, and what is kept of them stays in the cache.
pub const POSES: usize = 6;
/// So many atoms may reach the bar, at most, and this share of all; then a scan costs less.
const LEAST_LEFT: usize = 64;
const SHARE_LEFT: usize = 4;
/// Smaller keys are less than what products round: bounds tell nothing of them.
const LEAST_KEY: f32 = 1e-12;
/// In place of what is left of an atom that is taken: it makes its key small.
const TAKEN: f32 = 1e6;

/// Searches by one sieve: room that is made once.
pub struct FilterRefine<'a> {
    sieve: &'a QuantizedTable,
    /// (n, D)
    atoms: &'a [f32],
    /// By panels, then poses: c.
    correlations: Vec<Row>,
    /// The same: e, whatever is beyond heads; rounding may have made it larger.
    remainders: Vec<Row>,
    /// By poses, then panels, by lanes: the largest key that any atom of a panel may have.
    most: Vec<Wide>,
    /// Of the pose in each slot so many vectors were weighed,
    weighed: Vec<usize>,
    /// in these.
    scales: Vec<Scale>,
    /// Room.
    looks: Vec<Look>,
    leads: Vec<Lead>,
    left: Vec<u32>,
    room: Room,
}

impl<'a> FilterRefine<'a> {
    /// Room for searches of `poses` poses.
    pub fn new(sieve: &'a QuantizedTable, atoms: &'a [f32], poses: usize) -> Self {
        let rows = sieve.tails.len() * poses;
        FilterRefine {
            sieve,
            atoms,
            correlations: vec![Row::ZERO; rows],
            remainders: vec![Row::ZERO; rows],
            most: vec![Wide::ZERO; rows],
            weighed: vec![0; poses],
            scales: vec![Scale::NONE; poses],
            looks: Vec::new(),
            leads: Vec::new(),
            left: Vec::new(),
            room: Room::default(),
        }
    }

    /// A pose begins in a slot.
    pub fn begin(&mut self, slot: usize) {
        self.weighed[slot] = 0;
        self.scales[slot] = Scale::NONE;
    }

    /// The best atoms of poses that have taken equally many.
    pub fn best(&mut self, sought: &[Query<'_>], found: &mut Vec<SearchResult>) {
        found.clear();
        let is_new = |s: &Query<'_>| self.weighed[s.slot] < s.path.heads.len();
        if sought.iter().all(is_new) {
            self.together(sought, true, found);
        } else {
            for one in sought.chunks(1) {
                // Where the atom taken last depends on those before nothing is new to be weighed, but the atom is out.
                let is_new = self.weighed[one[0].slot] < one[0].path.heads.len();
                self.together(one, is_new, found);
            }
        }
    }

    fn together(&mut self, sought: &[Query<'_>], is_new: bool, found: &mut Vec<SearchResult>) {
        for sought in sought {
            self.leave_out(sought);
            self.weighed[sought.slot] = sought.path.heads.len();
        }
        self.weigh(sought, is_new);
        for (i, sought) in sought.iter().enumerate() {
            let lead = self.leads[i];
            found.push(self.one(sought, &lead));
        }
        let (sieve, count) = (self.sieve, sought.len());
        let scan = sought.first().map_or(0, |s| sieve.scan(s.path.width()));
        (sieve.tally).searches(count, count * sieve.spent(), count * scan);
    }

    /// Atoms that are taken are not likely any more, once e is kept. (That they are not taken again [`Closer`] sees to.)
    fn leave_out(&mut self, sought: &Query<'_>) {
        for taken in sought.taken {
            let place = self.sieve.place(*taken);
            let row = place / WIDTH * self.weighed.len() + sought.slot;
            self.remainders[row].0[place % WIDTH] = TAKEN;
        }
    }

    /// Weighs all atoms for some poses.
    fn weigh(&mut self, sought: &[Query<'_>], is_new: bool) {
        let Some(first) = sought.first() else {
            return;
        };
        let directions = first.path.heads.len();
        self.looks.clear();
        for Query { path, slot, .. } in sought {
            let look = Look::at(path, *slot, is_new, &mut self.scales[*slot]);
            self.looks.push(look);
        }
        self.leads.clear();
        self.leads.resize(sought.len(), Lead::NONE);
        let step = match (first.rule, directions) {
            (SelectionRule::Omp, _) | (_, 1) => Step::Alone,
            (_, 2) if is_new => Step::Second,
            _ => Step::Later,
        };
        simd::dispatch_widest(Weighing {
            step,
            sieve: self.sieve,
            looks: &self.looks,
            state: State {
                correlations: &mut self.correlations,
                remainders: &mut self.remainders,
                most: &mut self.most,
                poses: self.weighed.len(),
            },
            leads: &mut self.leads,
        });
    }

    /// The best atom of one pose that was weighed.
    fn one(&mut self, sought: &Query<'_>, lead: &Lead) -> SearchResult {
        let sieve = self.sieve;
        let mut closer = Closer::new(sieve, self.atoms, sought, &mut self.room);
        let (n, panels) = (sieve.atoms.len(), sieve.tails.len());
        let weighed = Weighed {
            sieve,
            correlations: &self.correlations[sought.slot..],
            remainders: &self.remainders[sought.slot..],
            most: &self.most[sought.slot * panels..][..panels],
            poses: self.weighed.len(),
        };
        let key = closer.least(&weighed.likely(lead, sought));
        if key <= LEAST_KEY {
            return SearchResult::Unpruned;
        }
        self.left.clear();
        let is_known = simd::dispatch_widest(Sifting {
            bar: Bar::of(sought, key, self.scales[sought.slot].unit),
            weighed,
            few: n / SHARE_LEFT + LEAST_LEFT,
            left: &mut self.left,
        });
        match is_known {
            true => closer
                .best(&self.left)
                .map_or(SearchResult::Unpruned, SearchResult::Atom),
            false => SearchResult::Unpruned,
        }
    }
}
