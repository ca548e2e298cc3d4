//! The Kalman smoother of a path.
//!
//! Each coordinate y_t (cm) is that of a point of constant velocity, but for white acceleration of
//! density q (cm²/s³), and of a noise n_t of variance r (cm²), each value of which keeps a share a
//! of the one before:
//!
//! ```text
//! [p v]_{t+1} = [1 h; 0 1] [p v]_t + N(0, q [h³/3 h²/2; h²/2 h]),     y_t = p_t + n_t
//!     n_{t+1} = a n_t + N(0, (1 − a²) r)                h seconds per frame
//! ```
//!
//! Where a is 0 the noise is white and no part of the state. A Kalman filter and the smoother of
//! de Jong (Biometrika 76, 1989), which inverts no matrix, solve it. For white noise the mean is a
//! cubic smoothing spline of strength r / q.

/// The noise of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PathNoise {
    /// The variance of a coordinate, cm².
    pub variance: f64,
    /// The correlation of the noise of one frame and the next; 0 is white.
    pub correlation: f64,
}

impl PathNoise {
    /// White noise of a variance, cm².
    pub(crate) fn white(variance: f64) -> PathNoise {
        PathNoise {
            variance,
            correlation: 0.0,
        }
    }
}

/// Some coordinates of a path smoothed, with values at every frame, measured or not.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Smoothed<const K: usize> {
    /// Means.
    pub mean: [Vec<f64>; K],
    /// Variances, of each coordinate.
    pub variance: Vec<f64>,
}

/// Smooths coordinates of a run that are seen in the same frames: `series` in cm, NaN where
/// missing; `step` seconds per frame; density `q` of white acceleration, cm²/s³.
pub(crate) fn smooth<const K: usize>(
    series: [&[f64]; K],
    noise: PathNoise,
    step: f64,
    q: f64,
) -> Smoothed<K> {
    let (h, r, a) = (step, noise.variance, noise.correlation);
    let [pp, pv, vv] = [q * h * h * h / 3.0, q * h * h / 2.0, q * h];
    if a > 0.0 {
        let motion = StateSpace {
            transition: [[1.0, h, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, a]],
            process: [[pp, pv, 0.0], [pv, vv, 0.0], [0.0, 0.0, (1.0 - a * a) * r]],
            seen: [1.0, 0.0, 1.0],
            noise: 1e-9 * r,
            first: [ANYWHERE, ANY_VELOCITY, r],
        };
        return motion.smooth(series);
    }
    let motion = StateSpace {
        transition: [[1.0, h], [0.0, 1.0]],
        process: [[pp, pv], [pv, vv]],
        seen: [1.0, 0.0],
        noise: r,
        first: [ANYWHERE, ANY_VELOCITY],
    };
    motion.smooth(series)
}

/// Variances of the first position about the first value (cm²) and of the first velocity (cm²/s²):
/// some meters a second.
const ANYWHERE: f64 = 1e4;
const ANY_VELOCITY: f64 = 1e5;

type Matrix<const N: usize> = [[f64; N]; N];

/// A state x of N numbers, the first of which is wanted: x_{t+1} = T x_t + N(0, Q), y_t = s · x_t +
/// N(0, r).
struct StateSpace<const N: usize> {
    transition: Matrix<N>,
    process: Matrix<N>,
    seen: [f64; N],
    noise: f64,
    /// The variances of the first state.
    first: [f64; N],
}

/// What is expected before a frame is seen, and how far it is from that.
struct Expected<const N: usize, const K: usize> {
    mean: [f64; K],
    /// The first row of the covariance P.
    covariance: [f64; N],
    /// P s.
    with_seen: [f64; N],
    /// The variance of the innovation; `None` where nothing is seen.
    variance: Option<f64>,
    innovation: [f64; K],
}

impl<const N: usize> StateSpace<N> {
    fn smooth<const K: usize>(&self, series: [&[f64]; K]) -> Smoothed<K> {
        self.backward(&self.filter(series))
    }

    fn filter<const K: usize>(&self, series: [&[f64]; K]) -> Vec<Expected<N, K>> {
        let frames = series[0].len();
        let first = (0..frames).find(|t| series[0][*t].is_finite());
        let mut mean = [[0.0; N]; K];
        for (mean, series) in mean.iter_mut().zip(&series) {
            mean[0] = first.map_or(0.0, |t| series[t]);
        }
        let mut p: Matrix<N> = std::array::from_fn(|i| {
            std::array::from_fn(|j| if i == j { self.first[i] } else { 0.0 })
        });
        let mut out = Vec::with_capacity(frames);
        for t in 0..frames {
            let with_seen: [f64; N] = std::array::from_fn(|i| dot(&p[i], &self.seen));
            let variance = series[0][t]
                .is_finite()
                .then(|| dot(&with_seen, &self.seen) + self.noise);
            let innovation = std::array::from_fn(|k| series[k][t] - dot(&mean[k], &self.seen));
            out.push(Expected {
                mean: std::array::from_fn(|k| mean[k][0]),
                covariance: p[0],
                with_seen,
                variance,
                innovation,
            });
            if let Some(variance) = variance {
                for (mean, off) in mean.iter_mut().zip(&innovation) {
                    (0..N).for_each(|i| mean[i] += with_seen[i] / variance * off);
                }
                for i in 0..N {
                    (0..N).for_each(|j| p[i][j] -= with_seen[i] * with_seen[j] / variance);
                }
            }
            mean = mean.map(|m| times(&self.transition, &m));
            p = self.predicted(&p);
        }
        out
    }

    /// T P Tᵀ + Q.
    fn predicted(&self, p: &Matrix<N>) -> Matrix<N> {
        let rows: Matrix<N> = std::array::from_fn(|i| times(p, &self.transition[i]));
        std::array::from_fn(|i| {
            std::array::from_fn(|j| dot(&rows[i], &self.transition[j]) + self.process[i][j])
        })
    }

    fn backward<const K: usize>(&self, expected: &[Expected<N, K>]) -> Smoothed<K> {
        let mut out = Smoothed {
            mean: std::array::from_fn(|_| vec![0.0; expected.len()]),
            variance: vec![0.0; expected.len()],
        };
        // What later frames say: the state moves by P · score, its covariance falls by P
        // information P.
        let (mut score, mut information) = ([[0.0; N]; K], [[0.0; N]; N]);
        for (t, at) in expected.iter().enumerate().rev() {
            score = score.map(|s| times_transposed(&self.transition, &s));
            information = self.before(&information);
            if let Some(variance) = at.variance {
                for (score, off) in score.iter_mut().zip(&at.innovation) {
                    let more = (off - dot(&at.with_seen, score)) / variance;
                    (0..N).for_each(|i| score[i] += self.seen[i] * more);
                }
                let along = times(&information, &at.with_seen).map(|v| v / variance);
                let both = (dot(&along, &at.with_seen) + 1.0) / variance;
                for i in 0..N {
                    for j in 0..N {
                        information[i][j] += both * self.seen[i] * self.seen[j]
                            - self.seen[i] * along[j]
                            - along[i] * self.seen[j];
                    }
                }
            }
            for (k, score) in score.iter().enumerate() {
                out.mean[k][t] = at.mean[k] + dot(&at.covariance, score);
            }
            let known = dot(&times(&information, &at.covariance), &at.covariance);
            out.variance[t] = (at.covariance[0] - known).max(0.0);
        }
        out
    }

    /// Tᵀ N T.
    fn before(&self, information: &Matrix<N>) -> Matrix<N> {
        let rows = information.map(|row| times_transposed(&self.transition, &row));
        std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..N).map(|k| self.transition[k][i] * rows[k][j]).sum())
        })
    }
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    (0..N).map(|i| a[i] * b[i]).sum()
}

fn times<const N: usize>(a: &Matrix<N>, b: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|i| dot(&a[i], b))
}

fn times_transposed<const N: usize>(a: &Matrix<N>, b: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|i| (0..N).map(|k| a[k][i] * b[k]).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array1, Array2};
    use rand_distr::{Distribution, StandardNormal};

    /// A swing, and the same with noise.
    fn noisy(noise: PathNoise, frames: usize) -> (Vec<f64>, Vec<f64>) {
        let mut rng = crate::numeric::parallel::rng(3, 0);
        let truth: Vec<f64> = (0..frames)
            .map(|i| 40.0 * (i as f64 / 120.0 * 4.0).sin())
            .collect();
        let a = noise.correlation;
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut n = draw();
        let mut seen = Vec::new();
        for x in &truth {
            seen.push(x + noise.variance.sqrt() * n);
            n = a * n + (1.0 - a * a).sqrt() * draw();
        }
        (truth, seen)
    }

    #[test]
    fn smoothing_takes_most_of_the_noise_and_knows_how_sure_it_is() {
        for (correlation, most) in [(0.0, 2.5), (0.7, 3.5)] {
            let noise = PathNoise {
                variance: 25.0,
                correlation,
            };
            let (truth, mut seen) = noisy(noise, 600);
            seen[200..230].fill(f64::NAN);
            let out = smooth([&seen], noise, 1.0 / 120.0, 1e4);
            let off = |i: usize| (out.mean[0][i] - truth[i]).powi(2);
            let error = ((0..600).map(off).sum::<f64>() / 600.0).sqrt();
            assert!(error <= most, "{correlation}: {error}");
            let z = (0..600).map(|i| off(i) / out.variance[i]).sum::<f64>() / 600.0;
            assert!((0.3..3.0).contains(&z), "{correlation}: {z}");
            assert!(out.variance[215] > out.variance[100]);
        }
    }

    /// The smoother is the conditional of the Gaussian that the module states.
    #[test]
    fn it_is_the_conditional_gaussian() {
        let (n, h, q, r, a) = (12, 0.01, 1e6, 2.0, 0.6);
        let (_, mut seen) = noisy(
            PathNoise {
                variance: r,
                correlation: a,
            },
            n,
        );
        seen[4] = f64::NAN;
        for correlation in [0.0, a] {
            // Covariances of positions: a random start, and integrated white acceleration.
            let k = Array2::from_shape_fn((n, n), |(s, t)| {
                let (s, t) = (h * s as f64, h * t as f64);
                let m = s.min(t);
                let motion = q * (m * m * m / 3.0 + m * m * (s - t).abs() / 2.0);
                ANYWHERE + ANY_VELOCITY * s * t + motion
            });
            let noise = Array2::from_shape_fn((n, n), |(s, t)| match s == t {
                true => r,
                false if correlation == 0.0 => 0.0,
                false => r * f64::powi(correlation, s.abs_diff(t) as i32),
            });
            let at: Vec<usize> = (0..n).filter(|t| *t != 4).collect();
            let pick = |m: &Array2<f64>, rows: &[usize]| {
                m.select(ndarray::Axis(0), rows)
                    .select(ndarray::Axis(1), &at)
            };
            let all: Vec<usize> = (0..n).collect();
            let cross = pick(&k, &all);
            let whole = pick(&(&k + &noise), &at);
            let factor = crate::numeric::linalg::Cholesky::new(whole).unwrap();
            let off = Array1::from_iter(at.iter().map(|t| seen[*t] - seen[0]));
            let solved = factor.solve(&off.insert_axis(ndarray::Axis(1))).unwrap();
            let want = cross.dot(&solved);
            let half = factor.half_solve(&cross.t().to_owned()).unwrap();
            let out = smooth(
                [&seen],
                PathNoise {
                    variance: r,
                    correlation,
                },
                h,
                q,
            );
            for t in 0..n {
                let mean = seen[0] + want[[t, 0]];
                assert!((out.mean[0][t] - mean).abs() <= 1e-5, "{correlation} {t}");
                let variance = k[[t, t]] - half.column(t).dot(&half.column(t));
                assert!(
                    (out.variance[t] - variance).abs() <= 1e-5,
                    "{correlation} {t}"
                );
            }
        }
    }

    #[test]
    fn short_and_empty_series() {
        let white = PathNoise::white;
        assert!(smooth([&[]], white(1.0), 0.01, 1e5).mean[0].is_empty());
        assert_eq!(
            smooth([&[f64::NAN; 3]], white(1.0), 0.01, 1e5).mean[0].len(),
            3
        );
        let one = smooth([&[5.0]], white(1e-9), 0.01, 1e5);
        assert!((one.mean[0][0] - 5.0).abs() <= 1e-6);
    }
}
