//! The atoms that may reach a bar, whatever is beyond their heads.

use super::branch_and_bound::Query;
use super::filter_pass::Reach;
use super::filter_score::{Reaches, under, vectors};
use super::packed_atoms::WIDTH;
use super::panel_kernel::{self, any};
use super::single_search::BELOW;
use super::warm_start::Weighed;
use pulp::{Simd, WithSimd};

/// What an atom has to reach.
pub struct Bar {
    key: f32,
    reach: Reach,
    /// What is left of an atom counts.
    is_optimised: bool,
}

impl Bar {
    /// A key, for what is sought; `unit` is what 1 counts in products that were kept.
    pub fn of(sought: &Query<'_>, key: f32, unit: f32) -> Bar {
        // Ratios are compared by products, which round too.
        Bar {
            key: key * BELOW * BELOW / unit / unit,
            reach: Reach::of(sought.path, unit),
            is_optimised: sought.is_optimised(),
        }
    }
}

/// Finds the atoms that may reach a bar; whether they are few.
pub struct Sifting<'a> {
    pub bar: Bar,
    pub weighed: Weighed<'a>,
    /// So many atoms are few.
    pub few: usize,
    pub left: &'a mut Vec<u32>,
}

impl WithSimd for Sifting<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let key = simd.splat_f32s(self.bar.key);
        let reach = Reaches::of(simd, self.bar.reach);
        let weighed = self.weighed;
        let n = weighed.sieve.atoms.len() as u32;
        for (panel, most) in weighed.most.iter().enumerate() {
            if !any::<S>(simd.greater_than_or_equal_f32s(most.first::<S>(), key)) {
                continue;
            }
            let row = panel * weighed.poses;
            let tails = vectors::<S>(&weighed.sieve.tails[panel]);
            let c = vectors::<S>(&weighed.correlations[row]);
            let e = vectors::<S>(&weighed.remainders[row]);
            let mut mask = 0;
            for v in 0..WIDTH / S::F32_LANES {
                let over = reach.over(simd, c[v], tails[v]);
                let bar = match self.bar.is_optimised {
                    true => simd.mul_f32s(key, under(simd, e[v])),
                    false => key,
                };
                let some = panel_kernel::bits(simd, simd.greater_than_or_equal_f32s(over, bar));
                mask |= u64::from(some) << (v * S::F32_LANES);
            }
            while mask != 0 {
                let place = (panel * WIDTH) as u32 + mask.trailing_zeros();
                mask &= mask - 1;
                if place < n {
                    self.left.push(place);
                }
            }
            if self.left.len() > self.few {
                return false;
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::active_set::ActiveSet;
    use super::super::super::code;
    use super::super::super::testdata::random;
    use super::super::super::{Dictionary, SelectionRule, Tolerance};
    use super::super::filter_pass::{Look, Scale, State, Step, Weighing};
    use super::super::packed_atoms::{Row, Wide};
    use super::super::quantized_table::QuantizedTable;
    use super::super::query::OmpQuery;
    use super::super::warm_start::Lead;
    use super::*;
    use ndarray::{ArrayView1, aview1};
    use pulp::{Scalar, Scalar128b, Scalar256b, Scalar512b};

    /// Poses that are sought for.
    const POSES: usize = 7;

    /// Two steps: of each pose the atoms that may be the best, with it among them.
    struct On<'a>(&'a QuantizedTable, &'a Dictionary);

    impl WithSimd for On<'_> {
        type Output = Vec<Vec<u32>>;

        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let On(sieve, dictionary) = self;
            let (rows, mut all) = (sieve.tails.len() * POSES, Vec::new());
            let mut kept = [(); 2].map(|()| vec![Row::ZERO; rows]);
            let mut most = vec![Wide::ZERO; rows];
            let poses = random(POSES, 8, 3).dot(&random(8, 50, 2));
            let mut poses: Vec<(ActiveSet, OmpQuery)> = (poses.outer_iter())
                .map(|pose| {
                    let (mut fit, mut path) = (ActiveSet::new(2, 50), OmpQuery::new(50));
                    let weights = None::<ArrayView1<'_, f32>>;
                    fit.start(pose, weights, Tolerance::Never).unwrap();
                    path.begin(&sieve.basis, &fit);
                    (fit, path)
                })
                .collect();
            let mut scales = [Scale::NONE; POSES];
            for step in [Step::Alone, Step::Second] {
                let looks: Vec<Look> = (poses.iter().zip(&mut scales).enumerate())
                    .map(|(slot, ((_, path), scale))| Look::at(path, slot, true, scale))
                    .collect();
                let mut leads = vec![Lead::NONE; POSES];
                let [correlations, remainders] = &mut kept;
                let state = State {
                    correlations,
                    remainders,
                    most: &mut most,
                    poses: POSES,
                };
                let weighing = Weighing {
                    step,
                    sieve,
                    looks: &looks,
                    state,
                    leads: &mut leads,
                };
                weighing.with_simd(simd);
                for (slot, (fit, path)) in poses.iter_mut().enumerate() {
                    let weighed = Weighed {
                        sieve,
                        correlations: &kept[0][slot..],
                        remainders: &kept[1][slot..],
                        most: &most[slot * sieve.tails.len()..][..sieve.tails.len()],
                        poses: POSES,
                    };
                    let keys = keys(sieve, dictionary, fit);
                    let best = (0..keys.len()).max_by(|a, b| keys[*a].total_cmp(&keys[*b]));
                    let best = best.unwrap();
                    let sought = Query {
                        slot,
                        path,
                        rule: SelectionRule::Oomp,
                        taken: &[],
                    };
                    let mut left = Vec::new();
                    let sifting = Sifting {
                        bar: Bar::of(&sought, keys[best] as f32, scales[slot].unit),
                        weighed,
                        few: usize::MAX,
                        left: &mut left,
                    };
                    assert!(sifting.with_simd(simd) && left.contains(&(best as u32)));
                    assert!(left.len() < keys.len() / 2, "{}", left.len());
                    let is_optimised = matches!(step, Step::Second);
                    // A guess: only of the first step is it known to be good.
                    let likely = weighed.likely(&leads[slot], &sought);
                    let mut likely = likely.map(|place| keys[place as usize]).into_iter();
                    assert!(is_optimised || likely.any(|key| key > 0.9 * keys[best]));
                    all.push(left);
                    if !is_optimised {
                        let atom = sieve.atoms[best];
                        assert!(fit.push(atom, code::row(dictionary, atom)));
                        path.take(&sieve.basis, fit);
                    }
                }
            }
            all
        }
    }

    /// Of each place, by all numbers in f64.
    fn keys(sieve: &QuantizedTable, dictionary: &Dictionary, fit: &ActiveSet) -> Vec<f64> {
        let of = |atom: &u32| {
            let atom = dictionary.atom(*atom as usize).mapv(f64::from);
            let left = match fit.support.is_empty() {
                true => 1.0,
                false => 1.0 - atom.dot(&aview1(fit.newest().0)).powi(2),
            };
            atom.dot(&aview1(fit.residual())).powi(2) / left.max(1e-6)
        };
        sieve.atoms.iter().map(of).collect()
    }

    #[test]
    fn what_may_be_the_best_is_left_on_vectors_of_any_width() {
        // Few hidden dimensions and a little of all; a last panel that is not full.
        let atoms = random(333, 8, 1).dot(&random(8, 50, 2)) + random(333, 50, 4) * 0.05;
        let dictionary = Dictionary::from_rows(atoms.view()).unwrap();
        let sieve = QuantizedTable::new(dictionary.atoms());
        let on = || On(&sieve, &dictionary);
        let want = crate::numeric::simd::dispatch_widest(on());
        assert_eq!(crate::numeric::simd::dispatch8_job(on()), want);
        assert_eq!(on().with_simd(Scalar), want);
        assert_eq!(on().with_simd(Scalar128b), want);
        assert_eq!(on().with_simd(Scalar256b), want);
        assert_eq!(on().with_simd(Scalar512b), want);
    }
}
