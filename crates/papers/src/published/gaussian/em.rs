//! Expectation maximization for mixtures of Gaussians (Dempster, Laird and Rubin 1977).
//!
//! ```text
//! E:  r_ij = w_j N(x_i; m_j, C_j) / Σ_l w_l N(x_i; m_l, C_l), in logarithms
//! M:  n_j = Σ_i r_ij,  w_j = n_j / n,  m_j = Σ_i r_ij x_i / n_j,
//!     S_j = Σ_i r_ij (x_i − m_j)(x_i − m_j)ᵀ / n_j
//! ```
//!
//! x_i (D) are n poses, cm; K components. The caller turns the moments S_j (D, D) into covariances:
//! full ones, or factors and a diagonal. The likelihood cannot fall as long as that raises the
//! expected one, except by rounding and by floors under variances. Cost of a round: n K D² for E,
//! and about n D² for M, as nearly every pose belongs to one component.

use crate::numeric::linalg::symmetric_eigen;
use crate::numeric::parallel;
use crate::{Result, cluster};
use ndarray::{Array1, Array2, ArrayView2, Axis, s};
use std::f64::consts::PI;

/// Largest number of parallel chunks; each has sums of its own.
const CHUNKS: usize = 32;
/// Fewest poses of a chunk.
const CHUNK: usize = 2048;
/// A responsibility below this is taken for 0.
const MIN_RESPONSIBILITY: f64 = 1e-10;
/// Smallest variance, cm²: smaller ones are rounding.
const FLOOR: f64 = 1e-9;

/// A Gaussian of a mixture.
#[derive(Debug, Clone, PartialEq)]
pub struct Gaussian {
    /// w_j, above 0.
    pub weight: f64,
    /// m_j (D), cm.
    pub mean: Array1<f64>,
    /// C_j (D, D), cm², positive definite.
    pub covariance: Array2<f64>,
}

/// The moments of a component, from which the M step makes its Gaussian.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    /// n_j: the sum of its responsibilities.
    pub count: f64,
    /// m_j (D).
    pub mean: Array1<f64>,
    /// S_j (D, D).
    pub covariance: Array2<f64>,
}

/// When EM stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// Largest number of rounds.
    pub rounds: usize,
    /// Smallest gain of the mean log likelihood per pose, nats: a round that gains less is the
    /// last.
    pub gain: f64,
}

impl Default for Stop {
    fn default() -> Self {
        Stop {
            rounds: 60,
            gain: 1e-2,
        }
    }
}

/// A fitted mixture.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The components.
    pub mixture: Vec<Gaussian>,
    /// The mean log likelihood of a pose *before* each round, nats (cm).
    pub likelihood: Vec<f64>,
    /// Whether the gain fell below the wanted one.
    pub converged: bool,
}

/// Fits a mixture to poses `x` (n, D) from a start; `update` makes the components of their moments.
pub fn fit(
    x: ArrayView2<'_, f32>,
    start: Vec<Gaussian>,
    stop: Stop,
    update: &mut dyn FnMut(&[Moments]) -> Vec<Gaussian>,
) -> Fitted {
    let mut fitted = Fitted {
        mixture: start,
        likelihood: Vec::new(),
        converged: false,
    };
    for _ in 0..stop.rounds {
        let (moments, likelihood) = round(x, &fitted.mixture);
        let before = fitted.likelihood.last().copied();
        fitted.likelihood.push(likelihood);
        if before.is_some_and(|b| !(likelihood - b >= stop.gain)) {
            fitted.converged = true;
            break;
        }
        fitted.mixture = update(&moments);
    }
    fitted
}

/// The mean log likelihood of poses (n, D) under a mixture, nats.
pub fn likelihood(x: ArrayView2<'_, f32>, mixture: &[Gaussian]) -> f64 {
    round(x, mixture).1
}

/// The moments of poses by their labels (n), each below `k`: a start from k-means.
pub fn moments_of(x: ArrayView2<'_, f32>, labels: &[u32], k: usize) -> Vec<Moments> {
    let mut rows = vec![Vec::new(); k];
    for (i, &label) in labels.iter().enumerate() {
        rows[label as usize].push(i);
    }
    let one = |rows: &Vec<usize>| {
        let own = x.select(Axis(0), rows).mapv(f64::from);
        let count = (rows.len() as f64).max(1.0);
        let mean = own.sum_axis(Axis(0)) / count;
        let away = own - &mean;
        Moments {
            count: rows.len() as f64,
            mean,
            covariance: away.t().dot(&away) / count,
        }
    };
    rows.iter().map(one).collect()
}

/// Clusters poses (n, D) into at most `k`, fewer where a cluster would have less than `least` poses
/// or poses are equal.
///
/// # Errors
/// Those of [`cluster::KMeans::fit`].
pub(crate) fn clusters(
    x: ArrayView2<'_, f32>,
    k: usize,
    least: usize,
    seed: u64,
) -> Result<Vec<Moments>> {
    let mut k = k.min(x.nrows() / least.max(1)).max(1);
    loop {
        let kmeans = cluster::KMeans {
            k,
            seed,
            ..Default::default()
        };
        match kmeans.fit(x) {
            Ok(found) => return Ok(moments_of(x, &found.labels, k)),
            Err(_) if k > 1 => k /= 2,
            Err(e) => return Err(e),
        }
    }
}

/// The shares of each component among all, none of them 0.
pub(crate) fn weights(moments: &[Moments]) -> Vec<f64> {
    let counts = moments.iter().map(|m| m.count.max(1e-3));
    let sum: f64 = counts.clone().sum();
    counts.map(|c| c / sum).collect()
}

/// A component made ready for E: z = (x − m) Wᵀ has |z|² = (x − m)ᵀ C⁻¹ (x − m).
struct Ready {
    mean: Array1<f64>,
    whitening: Array2<f64>,
    log: f64,
}

impl Ready {
    fn new(g: &Gaussian) -> Ready {
        let d = g.mean.len();
        // LAPACK gives up on no symmetric matrix of finite numbers.
        let (values, mut vectors) =
            symmetric_eigen(&g.covariance).unwrap_or((Array1::ones(d), Array2::eye(d)));
        let values = values.mapv(|v| v.max(FLOOR));
        for (mut column, value) in vectors.columns_mut().into_iter().zip(&values) {
            column /= value.sqrt();
        }
        let log = g.weight.ln() - 0.5 * values.iter().map(|v| (2.0 * PI * v).ln()).sum::<f64>();
        Ready {
            mean: g.mean.clone(),
            whitening: vectors,
            log,
        }
    }
}

/// One pass over the poses: the moments of the E step, and the mean log likelihood.
fn round(x: ArrayView2<'_, f32>, mixture: &[Gaussian]) -> (Vec<Moments>, f64) {
    let (n, d) = x.dim();
    let ready: Vec<Ready> = mixture.iter().map(Ready::new).collect();
    let chunk = n.div_ceil(CHUNKS).max(CHUNK);
    let sums = parallel::map_chunks(n, chunk, |rows| {
        let x = x.slice(s![rows, ..]).mapv(f64::from);
        let (shares, log) = shares(&x, &ready);
        let own = |j: usize| share_of(&x, &shares, j, &ready[j].mean);
        let sums: Vec<_> = (0..ready.len()).map(own).collect();
        (sums, log)
    });
    let mut total = 0.0;
    let zero = || (0.0, Array1::<f64>::zeros(d), Array2::<f64>::zeros((d, d)));
    let mut all: Vec<_> = ready.iter().map(|_| zero()).collect();
    for (part, log) in sums {
        total += log;
        for (sum, one) in all.iter_mut().zip(part) {
            sum.0 += one.0;
            sum.1 += &one.1;
            sum.2 += &one.2;
        }
    }
    let moments = all.into_iter().zip(mixture);
    let moments = moments.map(|((count, first, second), old)| {
        // Nobody's component stays where it was.
        if !(count > 1e-6) {
            let (mean, covariance) = (old.mean.clone(), old.covariance.clone());
            return Moments {
                count: 0.0,
                mean,
                covariance,
            };
        }
        let shift = first / count;
        let mut covariance = second / count;
        for i in 0..d {
            for j in 0..d {
                covariance[[i, j]] -= shift[i] * shift[j];
            }
        }
        Moments {
            count,
            mean: &old.mean + &shift,
            covariance,
        }
    });
    (moments.collect(), total / n.max(1) as f64)
}

/// r (rows, K), and the sum of the log likelihoods.
fn shares(x: &Array2<f64>, ready: &[Ready]) -> (Array2<f64>, f64) {
    let mut shares = Array2::zeros((x.nrows(), ready.len()));
    for (g, mut column) in ready.iter().zip(shares.columns_mut()) {
        let white = (x - &g.mean).dot(&g.whitening);
        for (share, z) in column.iter_mut().zip(white.rows()) {
            *share = g.log - 0.5 * z.dot(&z);
        }
    }
    let mut total = 0.0;
    for mut row in shares.rows_mut() {
        let best = row.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = row.iter().map(|l| (l - best).exp()).sum();
        total += best + sum.ln();
        row.mapv_inplace(|l| (l - best).exp() / sum);
    }
    (shares, total)
}

/// Σ r, Σ r (x − m), Σ r (x − m)(x − m)ᵀ about the old mean, over the poses with a share in
/// component `j`.
fn share_of(
    x: &Array2<f64>,
    shares: &Array2<f64>,
    j: usize,
    mean: &Array1<f64>,
) -> (f64, Array1<f64>, Array2<f64>) {
    let own: Vec<usize> = (0..x.nrows())
        .filter(|&i| shares[[i, j]] > MIN_RESPONSIBILITY)
        .collect();
    let away = x.select(Axis(0), &own) - mean;
    let mut shared = away.clone();
    let mut count = 0.0;
    for (mut row, &i) in shared.rows_mut().into_iter().zip(&own) {
        row *= shares[[i, j]];
        count += shares[[i, j]];
    }
    (count, shared.sum_axis(Axis(0)), shared.t().dot(&away))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published::gaussian::mixture::full;
    use crate::testdata::blobs;

    /// Without a ridge: the M step of the book.
    fn plain(moments: &[Moments]) -> Vec<Gaussian> {
        let each = moments.iter().zip(weights(moments));
        each.map(|(m, weight)| Gaussian {
            weight,
            mean: m.mean.clone(),
            covariance: m.covariance.clone(),
        })
        .collect()
    }

    const LONG: Stop = Stop {
        rounds: 300,
        gain: 1e-9,
    };

    #[test]
    fn the_likelihood_never_falls_and_planted_gaussians_are_found() {
        let x = blobs();
        // A poor start: the first, the second and the last third, each of which has poses of all
        // three.
        let labels: Vec<u32> = (0..900).map(|i| i / 300).collect();
        let start = plain(&moments_of(x.view(), &labels, 3));
        let fitted = fit(x.view(), start, LONG, &mut plain);
        let likelihood = &fitted.likelihood;
        assert!(fitted.converged && likelihood.len() > 5);
        assert!(likelihood.windows(2).all(|w| w[1] >= w[0] - 1e-12));
        assert!(likelihood[likelihood.len() - 1] > likelihood[0] + 1.0);
        for j in 0..3 {
            let mut mean: Array1<f64> = (0..6)
                .map(|c| 12.0 * (3.0 * j as f64 + f64::from(c)).sin())
                .collect();
            mean[1] += 0.8 * mean[0];
            let off = |g: &Gaussian| (&g.mean - &mean).mapv(f64::abs).sum() / 6.0;
            let near = fitted.mixture.iter().find(|g| off(g) <= 0.3);
            let near = near.expect("each of the three is found");
            assert!((near.weight - 1.0 / 3.0).abs() <= 0.01);
            let sd = 1.0 + j as f64;
            assert!((near.covariance[[0, 0]] / (sd * sd) - 1.0).abs() <= 0.2);
        }
    }

    #[test]
    fn a_round_from_anywhere_gives_the_moments_about_the_new_mean() {
        let x = blobs();
        let want = moments_of(x.view(), &[0; 900], 1).remove(0);
        let away = Gaussian {
            weight: 1.0,
            mean: &want.mean + 7.0,
            covariance: Array2::eye(6) * 400.0,
        };
        let found = round(x.view(), &[away]).0.remove(0);
        assert!((found.count - 900.0).abs() <= 1e-9);
        assert!((found.mean - want.mean).iter().all(|d| d.abs() <= 1e-9));
        let off = found.covariance - want.covariance;
        assert!(off.iter().all(|d| d.abs() <= 1e-9));
    }

    #[test]
    fn one_gaussian_has_the_likelihood_of_the_book() {
        let x = blobs();
        let one = plain(&moments_of(x.view(), &[0; 900], 1));
        let (values, _) = symmetric_eigen(&one[0].covariance).unwrap();
        let log_det: f64 = values.iter().map(|v| v.ln()).sum();
        let want = -0.5 * (6.0 * (2.0 * PI).ln() + log_det + 6.0);
        assert!((likelihood(x.view(), &one) - want).abs() <= 1e-9);
    }

    #[test]
    fn fewer_poses_make_fewer_clusters_and_equal_ones_one() {
        let x = blobs();
        let few = x.slice(s![..120, ..]);
        assert_eq!(clusters(few, 20, 50, 0).unwrap().len(), 2);
        let equal = Array2::from_elem((300, 6), 2.0f32);
        let found = clusters(equal.view(), 4, 50, 0).unwrap();
        assert!(found.len() == 1 && found[0].count == 300.0);
        assert!(found[0].mean.iter().all(|m| *m == 2.0));
    }

    #[test]
    fn a_component_that_nobody_wants_stays_where_it_was() {
        let x = blobs();
        let mut start = full(&moments_of(x.view(), &[0; 900], 1));
        let far = Gaussian {
            mean: Array1::from_elem(6, 1e6),
            ..start[0].clone()
        };
        start.push(far);
        let fitted = fit(x.view(), start, Stop::default(), &mut full);
        assert_eq!(fitted.mixture[1].mean, Array1::from_elem(6, 1e6));
        assert!(fitted.mixture[1].weight > 0.0 && fitted.mixture[1].weight < 1e-3);
    }
}
