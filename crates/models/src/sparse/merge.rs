//! Joining dictionaries that were learned separately ("Combining dictionaries", section 5 of Lai
//! et al.).
//!
//! The atoms of all parts follow one another. Optionally the coherence |<a, b>| of the parts is
//! measured, and atoms too close to an earlier one are dropped.
//!
//! Cost: O(n D) to join; O(n^2 D) time by blocks and O(n D) memory to measure and to drop.

use super::{Dictionary, coherence};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// The parameters of joining.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DictionaryMerge {
    /// Whether to measure how close the parts are to each other. Default: yes.
    pub compare: bool,
    /// Drop each atom that is closer than this to an earlier one that is kept: above 0 and at most
    /// 1; 1 drops copies alone (to single precision). Default: keep all.
    pub prune: Option<f64>,
}

impl Default for DictionaryMerge {
    fn default() -> Self {
        DictionaryMerge {
            compare: true,
            prune: None,
        }
    }
}

/// How close two parts are: each atom of the second is compared with the nearest of the first.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CoherenceStats {
    /// The earlier part, counted from 0.
    pub first: usize,
    /// The later part.
    pub second: usize,
    /// Half of the second part's atoms are at most this close.
    pub median: f32,
    /// 90% of them are.
    pub p90: f32,
    /// 99% of them are.
    pub p99: f32,
    /// The closest pair.
    pub max: f32,
}

/// What joining gives.
#[derive(Debug, Clone, PartialEq)]
pub struct MergedDictionary {
    /// The atoms kept, in the order of the parts and of the atoms in each.
    pub dictionary: Dictionary,
    /// How many atoms were exact copies (up to sign) of an earlier one, before any were dropped.
    pub copies: usize,
    /// Each pair of parts; empty if they were not to be compared.
    pub closeness: Vec<CoherenceStats>,
    /// The atoms dropped, by their number among the atoms of all parts.
    pub dropped: Vec<usize>,
}

impl DictionaryMerge {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`Error::Usage`] if a parameter is out of its range.
    pub(crate) fn check(&self) -> Result<()> {
        match self.prune {
            Some(c) if !(c > 0.0 && c <= 1.0) => Err(Error::usage(format!(
                "the option `prune {c}`: expected above 0 to 1"
            ))),
            _ => Ok(()),
        }
    }

    /// Joins the parts.
    ///
    /// ```
    /// use ndarray::array;
    /// use posing_models::sparse::{Dictionary, DictionaryMerge};
    ///
    /// let one = Dictionary::from_rows(array![[1.0, 0.0], [0.0, 1.0]].view())?;
    /// let other = Dictionary::from_rows(array![[0.0, -1.0], [0.6, 0.8]].view())?;
    /// let merge = DictionaryMerge { prune: Some(1.0), ..DictionaryMerge::default() };
    /// let merged = merge.join(&[one, other])?;
    /// assert_eq!(merged.dropped, [2]); // an atom of the first, turned round
    /// assert_eq!(merged.dictionary.len(), 3);
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// A parameter out of range, no parts, or parts of different widths.
    pub fn join(&self, parts: &[Dictionary]) -> Result<MergedDictionary> {
        self.check()?;
        let Some(width) = parts.first().map(Dictionary::width) else {
            return Err(Error::usage("no dictionaries to join; give at least one"));
        };
        if let Some((i, part)) = parts.iter().enumerate().find(|(_, p)| p.width() != width) {
            let other = part.width();
            return Err(Error::usage(format!(
                "dictionary {} has {other} coordinates, dictionary 1 has {width}; they cannot be \
                 joined",
                i + 1
            )));
        }
        let closeness = if self.compare {
            compare(parts)?
        } else {
            Vec::new()
        };
        let mut dictionary = Dictionary::stack(parts)?;
        let copies = dictionary.copies().len();
        let mut dropped = Vec::new();
        if let Some(limit) = self.prune {
            let order: Vec<usize> = (0..dictionary.len()).collect();
            let keep = coherence::spread(dictionary.atoms(), &order, limit);
            let (kept, out): (Vec<usize>, Vec<usize>) = order.into_iter().partition(|&i| keep[i]);
            dictionary = dictionary.select(&kept);
            dropped = out;
        }
        Ok(MergedDictionary {
            dictionary,
            copies,
            closeness,
            dropped,
        })
    }
}

fn compare(parts: &[Dictionary]) -> Result<Vec<CoherenceStats>> {
    let mut all = Vec::new();
    for second in 0..parts.len() {
        for first in 0..second {
            let mut nearest = parts[second].nearest(&parts[first])?;
            nearest.sort_by(f32::total_cmp);
            // The smallest value that at least this share is not above.
            let at = |share: f64| {
                let rank = (share * nearest.len() as f64).ceil() as usize;
                nearest[rank.clamp(1, nearest.len()) - 1]
            };
            let (median, p90, p99, max) = (at(0.5), at(0.9), at(0.99), at(1.0));
            all.push(CoherenceStats {
                first,
                second,
                median,
                p90,
                p99,
                max,
            });
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::super::testdata;
    use super::*;
    use ndarray::{array, s};

    fn random(n: usize, d: usize, seed: u64) -> Dictionary {
        Dictionary::from_rows(testdata::random(n, d, seed).view()).unwrap()
    }

    #[test]
    fn the_atoms_of_the_parts_follow_one_another() {
        let (a, b) = (random(3, 5, 1), random(4, 5, 2));
        let joined = DictionaryMerge::default()
            .join(&[a.clone(), b.clone()])
            .unwrap();
        assert_eq!(joined.dictionary.atoms().slice(s![..3, ..]), a.atoms());
        assert_eq!(joined.dictionary.atoms().slice(s![3.., ..]), b.atoms());
        assert_eq!((joined.copies, joined.dropped.len()), (0, 0));
        assert!(joined.closeness[0].max < 1.0);
        assert_eq!(
            DictionaryMerge::default()
                .join(std::slice::from_ref(&a))
                .unwrap()
                .dictionary,
            a
        );
    }

    #[test]
    fn a_part_joined_to_itself_and_turned_about_is_found_and_pruned() {
        let a = random(700, 6, 3);
        let turned = Dictionary::from_rows(a.atoms().mapv(|v| -v).view()).unwrap();
        let wanted = DictionaryMerge {
            prune: Some(1.0),
            ..DictionaryMerge::default()
        };
        let joined = wanted.join(&[a.clone(), turned, a.clone()]).unwrap();
        assert_eq!((joined.copies, joined.closeness.len()), (1400, 3));
        assert!(
            joined
                .closeness
                .iter()
                .all(|c| c.median > 0.999_999 && c.max >= c.p99)
        );
        assert_eq!(joined.dictionary, a);
        assert_eq!(joined.dropped, (700..2100).collect::<Vec<_>>());
    }

    #[test]
    fn after_pruning_no_two_are_closer_and_each_dropped_one_was() {
        for n in [1, 2, 127, 129, 900] {
            let a = random(n, 3, 4);
            let joined = DictionaryMerge {
                prune: Some(0.95),
                compare: false,
            }
            .join(std::slice::from_ref(&a))
            .unwrap();
            let kept = &joined.dictionary;
            assert!(kept.coherence() <= 0.95);
            let out = a.select(&joined.dropped.clone());
            if !joined.dropped.is_empty() {
                assert!(out.nearest(kept).unwrap().iter().all(|&c| c > 0.95));
            }
            assert_eq!(kept.len() + joined.dropped.len(), n);
        }
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let parts = [random(400, 4, 5), random(300, 4, 6)];
        let of = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            let wanted = DictionaryMerge {
                prune: Some(0.98),
                ..DictionaryMerge::default()
            };
            pool.install(|| wanted.join(&parts).unwrap())
        };
        let one = of(1);
        assert!([2, 7].iter().all(|&t| of(t) == one));
    }

    #[test]
    fn quantiles_are_of_the_nearest_atoms() {
        let a = Dictionary::from_rows(array![[1.0, 0.0]].view()).unwrap();
        let b = Dictionary::from_rows(array![[0.0, 1.0], [3.0, 4.0], [1.0, 0.0]].view()).unwrap();
        let c = DictionaryMerge::default().join(&[a, b]).unwrap().closeness[0];
        assert_eq!((c.first, c.second, c.median, c.max), (0, 1, 0.6, 1.0));
    }

    #[test]
    fn parts_that_do_not_fit_are_refused() {
        assert!(DictionaryMerge::default().join(&[]).is_err());
        assert!(
            DictionaryMerge::default()
                .join(&[random(2, 3, 1), random(2, 4, 1)])
                .is_err()
        );
        for prune in [0.0, -1.0, 1.1, f64::NAN] {
            assert!(
                DictionaryMerge {
                    prune: Some(prune),
                    compare: true
                }
                .join(&[random(2, 3, 1)])
                .is_err()
            );
        }
    }
}
