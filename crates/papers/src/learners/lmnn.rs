//! Large margin nearest neighbors (Weinberger, Saul: Distance Metric Learning for Large Margin
//! Nearest Neighbor Classification. JMLR 10, 2009), for labels of pairs.
//!
//! With z = Wᵀ x and the squared distances D_ij = |z_i − z_j|², W (d, r) minimizes the mean over
//! (i, j) of
//!
//! (1 − μ) D_ij + μ Σ_l max(0, 1 + D_ij − D_il), μ = ½
//!
//! (the paper's equation 13), where
//! - (i, j) are alike pairs, in both orders: j is a target of i;
//! - l are the impostors of i: the labeled poses that no chain of alike pairs links to i, and those
//!   of unlike pairs with i. The 100 nearest count;
//! - a pose in unlike pairs only is its own target, at distance 0, and its impostors are those of
//!   its pairs. So these pairs are kept a unit apart.
//!
//! The paper projects gradients of M = W Wᵀ; it names the factor W as the way to low ranks. W is
//! used here, as a projection costs O(d³) each step. The start is the first r principal directions,
//! in which alike poses are 1 apart: that sets the scale of the margin. Impostors are looked for in
//! rounds, as are the paper's active constraints; L-BFGS falls in each round. The objective is not
//! convex in W, so the result depends on the start. Cost: O(m² r) a round for m labeled poses and
//! O(100 m r + m d r) a step.

use super::components::components;
use super::hinge::{Anchor, objective};
use super::scatter::centered;
use super::start::principal_start;
use super::{LearnedMap, Needs, Settings, check, labeled_rows};
use crate::Result;
use crate::metric::train::TrainingPairs;
use crate::numeric::lbfgs::minimize;
use crate::numeric::parallel::map_chunks;
use crate::numeric::product::product;
use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis, s};

/// Impostors of a pose that count, in the margin or not: a smaller W brings in those beyond it.
const IMPOSTORS: usize = 100;
/// Steps of a round.
const STEPS: usize = 10;
/// A round that gains at most this share is the last.
const TOLERANCE: f64 = 1e-4;
/// Poses whose distances to all others are held at one time.
const ROWS: usize = 128;

/// Learns W (d, at most rank). It converged when a round gained too little, before the largest
/// number of rounds.
///
/// # Errors
/// [`crate::Error::Unfit`]: no pairs of one label, or pairs, poses or settings that cannot be used.
pub(crate) fn fit(pairs: &TrainingPairs<'_>, settings: &Settings) -> Result<LearnedMap> {
    check(pairs, "lmnn", Needs::Both, settings.rank)?;
    let start = principal_start(pairs, settings.rank)?;
    let labeled = Labeled::new(pairs);
    let x = centered(pairs.x.select(Axis(0), &labeled.rows).view()) * start.scale;
    let (d, r) = start.directions.dim();
    let (mut w, mut converged) = (start.directions, false);
    for _ in 0..settings.rounds {
        let anchors = labeled.anchors(&product(x.view(), w.view()));
        let before = objective(x.view(), &anchors, w.view()).0;
        let first = w.iter().copied().collect();
        let end = minimize(first, STEPS, TOLERANCE / STEPS as f64, &mut |w| {
            let w = ArrayView2::from_shape((d, r), w).expect("d by r");
            let (value, gradient) = objective(x.view(), &anchors, w);
            (value, gradient.iter().copied().collect())
        });
        w = Array2::from_shape_vec((d, r), end.at).expect("as many as at the start");
        if before - end.value <= TOLERANCE * before {
            converged = true;
            break;
        }
    }
    Ok(LearnedMap {
        w: w * start.scale,
        converged,
    })
}

/// The poses that pairs name, by their index among them.
struct Labeled {
    /// The row of each among all poses (m).
    rows: Vec<usize>,
    /// The component of alike poses of each (m).
    class: Vec<usize>,
    /// The poses alike to each: its targets (m).
    alike: Vec<Vec<usize>>,
    /// The poses unlike to each, in rising order (m).
    unlike: Vec<Vec<usize>>,
}

impl Labeled {
    fn new(pairs: &TrainingPairs<'_>) -> Labeled {
        let rows = labeled_rows(pairs);
        let of = components(pairs.x.nrows(), pairs.alike).of;
        let partners = |pairs: &[[usize; 2]]| {
            let mut partners = vec![Vec::new(); rows.len()];
            let indices = pairs
                .iter()
                .map(|p| p.map(|row| rows.partition_point(|&r| r < row)));
            for [a, b] in indices.filter(|[a, b]| a != b) {
                partners[a].push(b);
                partners[b].push(a);
            }
            for list in &mut partners {
                list.sort_unstable();
                list.dedup();
            }
            partners
        };
        Labeled {
            class: rows.iter().map(|&row| of[row]).collect(),
            alike: partners(pairs.alike),
            unlike: partners(pairs.unlike),
            rows,
        }
    }

    /// Each pose with its targets, and its nearest impostors at z (m, r).
    fn anchors(&self, z: &Array2<f64>) -> Vec<Anchor> {
        let squares: Array1<f64> = z.rows().into_iter().map(|row| row.dot(&row)).collect();
        map_chunks(self.rows.len(), ROWS, |chunk| {
            let products = z.slice(s![chunk.clone(), ..]).dot(&z.t());
            let of = |(i, products): (usize, ArrayView1<'_, f64>)| {
                let apart = (&squares - &(&products * 2.0)) + squares[i];
                self.anchor(i, &apart)
            };
            chunk.zip(products.rows()).map(of).collect::<Vec<_>>()
        })
        .concat()
    }

    /// The anchor of pose `i`, given its squared distances to all.
    fn anchor(&self, i: usize, apart: &Array1<f64>) -> Anchor {
        if self.alike[i].is_empty() {
            return Anchor {
                pose: i,
                targets: vec![i],
                impostors: self.unlike[i].clone(),
            };
        }
        let counts = |&l: &usize| {
            self.class[l] != self.class[i] || (l != i && self.unlike[i].binary_search(&l).is_ok())
        };
        let mut impostors: Vec<usize> = (0..apart.len()).filter(counts).collect();
        if impostors.len() > IMPOSTORS {
            // Where distances are equal the lower row is nearer: only one result is possible.
            let by = |a: &usize, b: &usize| apart[*a].total_cmp(&apart[*b]).then(a.cmp(b));
            impostors.select_nth_unstable_by(IMPOSTORS, by);
            impostors.truncate(IMPOSTORS);
            impostors.sort_unstable();
        }
        Anchor {
            pose: i,
            targets: self.alike[i].clone(),
            impostors,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::hinge::apart;
    use super::super::testdata::Planted;
    use super::*;

    #[test]
    fn impostors_are_of_other_chains_or_said_to_be_unlike() {
        let x = ndarray::array![[0.0], [1.0], [0.5], [1.5], [2.5], [50.0], [0.1]];
        let pairs = TrainingPairs {
            x: x.view(),
            alike: &[[0, 1], [2, 3], [3, 4]],
            unlike: &[[2, 4], [5, 0]],
        };
        let labeled = Labeled::new(&pairs);
        assert_eq!(labeled.rows, [0, 1, 2, 3, 4, 5]);
        let anchors = labeled.anchors(&x.slice(s![..6, ..]).to_owned());
        // Not 1 (alike) nor 6 (no label).
        assert_eq!(anchors[0].impostors, [2, 3, 4, 5]);
        assert_eq!(anchors[0].targets, [1]);
        // 4 is of the chain of 2, but said to be unlike.
        assert_eq!(anchors[2].impostors, [0, 1, 4, 5]);
        assert_eq!(anchors[3].targets, [2, 4]);
        assert_eq!(
            (&anchors[5].targets[..], &anchors[5].impostors[..]),
            (&[5][..], &[0][..])
        );
    }

    #[test]
    fn rounds_lower_the_objective_and_clear_the_margin() {
        let data = Planted::new(3, 3);
        let pairs = data.pairs();
        let labeled = Labeled::new(&pairs);
        let x = centered(data.x.select(Axis(0), &labeled.rows).view());
        let after = |rounds| {
            let w = fit(
                &pairs,
                &Settings {
                    rank: 3,
                    rounds,
                    ..Settings::default()
                },
            )
            .unwrap()
            .w;
            let anchors = labeled.anchors(&x.dot(&w));
            objective(x.view(), &anchors, w.view()).0
        };
        let (start, few, many) = (after(0), after(1), after(10));
        assert!(
            many <= few && few < start && many < 0.5 * start,
            "{start} {few} {many}"
        );
    }

    #[test]
    fn a_pair_that_is_only_unlike_is_kept_a_unit_apart() {
        // Dimension 0 tells the unlike pair apart; alike poses differ in it little, in dimension 1
        // much.
        let x = ndarray::array![
            [0.0, 5.0],
            [0.05, -5.0],
            [3.0, 4.0],
            [4.0, 4.0],
            [9.0, 0.0],
            [9.05, 9.0]
        ];
        let pairs = TrainingPairs {
            x: x.view(),
            alike: &[[0, 1], [4, 5]],
            unlike: &[[2, 3]],
        };
        let learned = fit(
            &pairs,
            &Settings {
                rank: 2,
                rounds: 50,
                ..Settings::default()
            },
        )
        .unwrap();
        let z = x.dot(&learned.w);
        assert!(learned.converged);
        assert!(
            apart(&z, 2, 3) >= 0.9 && apart(&z, 2, 3) > apart(&z, 0, 1),
            "{z}"
        );
    }
}
