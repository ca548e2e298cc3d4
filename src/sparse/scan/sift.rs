//! The best atoms of a few poses, sought among all atoms by their heads.
//!
//! 1. [`weigh`](super::weigh): of all atoms c and e, but for what is beyond the first numbers of their heads; c, and e at least, are kept
//!    for the next step.
//! 2. Of a few that are [likely](super::lead) the best the key, as a scan finds it, is what the best atom has at least: the bar.
//! 3. [`bar`](super::bar): which atoms may reach it, whatever is beyond?
//! 4. [`closer`](super::closer): longer heads leave few of those. They are met as a scan meets them: the same sums in the same order, the
//!    same key.
//!
//! Every bound allows for the rounding of the scan, so the atom is the one that the scan finds, always.

use super::super::Rule;
use super::bar::{Bar, Sifting};
use super::closer::Closer;
use super::heads::HEAD;
use super::lead::{Lead, Weighed};
use super::leaves::{LEAF, Lanes};
use super::panels::{Row, WIDTH, Wide};
use super::path::Path;
use super::pruned::{Found, Sought};
use super::sieve::Sieve;
use super::weigh::{Look, State, Step, Weighing};
use crate::simd;

/// Poses that are weighed together: as many as the kernel has in registers, and what is kept of them stays in the cache.
pub const POSES: usize = 6;
/// So many atoms may reach the bar, at most, and this share of all; then a scan costs less.
const LEAST_LEFT: usize = 64;
const SHARE_LEFT: usize = 4;
/// Of smaller keys products of bounds may round to nothing.
const LEAST_KEY: f32 = 1e-12;
/// In place of what is left of an atom that is taken: it makes its key small.
const TAKEN: f32 = 1e6;

/// Searches by one sieve: room that is made once.
pub struct Sift<'a> {
    sieve: &'a Sieve,
    /// (n, D)
    atoms: &'a [f32],
    /// By panels, then poses: c.
    correlations: Vec<Row>,
    /// The same: e at least.
    remainders: Vec<Row>,
    /// The same, by lanes: the largest key that any atom of a panel may have.
    most: Vec<Wide>,
    slots: Vec<Slot>,
    /// Room.
    looks: Vec<Look>,
    leads: Vec<Lead>,
    left: Vec<u32>,
}

/// A pose on its way.
#[derive(Default)]
struct Slot {
    /// So many of its vectors were weighed.
    weighed: usize,
    /// Its vectors side by side: their heads, and as they are.
    heads: Vec<Lanes>,
    whole: Vec<Lanes>,
}

impl<'a> Sift<'a> {
    /// Room for searches of `poses` poses.
    pub fn new(sieve: &'a Sieve, atoms: &'a [f32], poses: usize) -> Self {
        let rows = sieve.tails.len() * poses;
        Sift {
            sieve,
            atoms,
            correlations: vec![Row::ZERO; rows],
            remainders: vec![Row::ZERO; rows],
            most: vec![Wide::ZERO; rows],
            slots: std::iter::repeat_with(Slot::default).take(poses).collect(),
            looks: Vec::new(),
            leads: Vec::new(),
            left: Vec::new(),
        }
    }

    /// A pose begins in a slot.
    pub fn begin(&mut self, slot: usize) {
        self.slots[slot].weighed = 0;
    }

    /// The best atoms of poses that have taken equally many.
    pub fn best(&mut self, sought: &[Sought<'_>], found: &mut Vec<Found>) {
        found.clear();
        let is_new = |s: &Sought<'_>| self.slots[s.slot].weighed < s.path.heads.len();
        if sought.iter().all(is_new) {
            self.together(sought, true, found);
        } else {
            for one in sought.chunks(1) {
                // Where the atom taken last depends on those before nothing is new to be weighed, but the atom is out.
                let is_new = self.slots[one[0].slot].weighed < one[0].path.heads.len();
                self.together(one, is_new, found);
            }
        }
    }

    fn together(&mut self, sought: &[Sought<'_>], is_new: bool, found: &mut Vec<Found>) {
        for sought in sought {
            self.leave_out(sought);
            self.slots[sought.slot].take(sought.path);
        }
        self.weigh(sought, is_new);
        for (i, sought) in sought.iter().enumerate() {
            let lead = self.leads[i];
            found.push(self.one(sought, &lead));
        }
    }

    /// Atoms that are taken are not likely any more. (That they are not taken again [`Closer`] sees to.)
    fn leave_out(&mut self, sought: &Sought<'_>) {
        for taken in sought.taken {
            let place = self.sieve.place(*taken);
            let row = place / WIDTH * self.slots.len() + sought.slot;
            self.remainders[row].0[place % WIDTH] = TAKEN;
        }
    }

    /// Weighs all atoms for some poses.
    fn weigh(&mut self, sought: &[Sought<'_>], is_new: bool) {
        let Some(first) = sought.first() else {
            return;
        };
        let directions = first.path.heads.len();
        self.looks.clear();
        let looks = sought.iter().map(|s| Look::at(s.path, s.slot, is_new));
        self.looks.extend(looks);
        self.leads.clear();
        self.leads.resize(sought.len(), Lead::NONE);
        let step = match (is_new && directions == 1, first.rule) {
            (true, _) => Step::First,
            (false, Rule::Plain) => Step::Plain,
            (false, Rule::Optimised) => Step::Optimised,
        };
        simd::widest(Weighing {
            step,
            sieve: self.sieve,
            looks: &self.looks,
            state: State {
                correlations: &mut self.correlations,
                remainders: &mut self.remainders,
                most: &mut self.most,
                poses: self.slots.len(),
            },
            leads: &mut self.leads,
        });
    }

    /// The best atom of one pose that was weighed.
    fn one(&mut self, sought: &Sought<'_>, lead: &Lead) -> Found {
        let slot = &self.slots[sought.slot];
        let vectors = (&slot.heads[..], &slot.whole[..]);
        let mut closer = Closer::new(self.sieve, self.atoms, sought, vectors);
        let n = self.sieve.heads.len();
        let scan = n.div_ceil(LEAF) * sought.path.width();
        let tally = &self.sieve.tally;
        tally.search(self.sieve.spent(), scan);
        let weighed = Weighed {
            sieve: self.sieve,
            correlations: &self.correlations[sought.slot..],
            remainders: &self.remainders[sought.slot..],
            most: &self.most[sought.slot..],
            poses: self.slots.len(),
        };
        let likely = weighed.likely(lead, sought.path, closer.is_optimised);
        let Some(key) = closer.start(likely).filter(|key| *key > LEAST_KEY) else {
            return Found::Unpruned;
        };
        self.left.clear();
        let is_known = simd::widest(Sifting {
            bar: Bar::of(sought, key),
            weighed,
            few: n / SHARE_LEFT + LEAST_LEFT,
            left: &mut self.left,
        });
        match is_known {
            true => Found::Atom(closer.best(&self.left)),
            false => Found::Unpruned,
        }
    }
}

impl Slot {
    /// Lays the newest of a path's vectors beside the others; the residual's head is new.
    fn take(&mut self, path: &Path) {
        self.heads.resize(HEAD, Lanes::ZERO);
        self.whole.resize(path.width(), Lanes::ZERO);
        let count = path.heads.len();
        for n in self.weighed..count {
            let vector = &path.vectors[n * path.width()..][..path.width()];
            (self.whole.iter_mut().zip(vector)).for_each(|(row, v)| row.0[n] = *v);
            let head = path.heads[n].along.as_flattened();
            (self.heads.iter_mut().zip(head)).for_each(|(row, h)| row.0[n] = *h);
        }
        let head = path.heads[0].along.as_flattened();
        (self.heads.iter_mut().zip(head)).for_each(|(row, h)| row.0[0] = *h);
        self.weighed = count;
    }
}
