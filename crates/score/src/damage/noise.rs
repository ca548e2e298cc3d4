//! Seeded damage to single frames: noise and missing points.
//!
//! The tests of Lai et al. (section 4): Gaussian noise on every coordinate ("dense"), on a fifth of
//! the joints ("sparse"), all joints but six hidden (completion). [`super::GapInjection`] makes
//! gaps in time.

use crate::numeric::parallel;
use crate::{Error, Result};
use ndarray::{Array2, ArrayView1};
use rand::Rng;
use rand_distr::StandardNormal;

/// The largest standard deviation of noise, in centimeters: below it no sum with a finite number
/// overflows.
pub const MAX_NOISE: f64 = 1e6;

/// The random streams of one seed. Each kind of damage has its own, so that adding one kind does
/// not change the others.
#[derive(Debug, Clone, Copy)]
pub(super) enum Stream {
    Dense = 0,
    Sparse = 1,
    Gaps = 2,
}

impl Stream {
    /// The generator of frame (or take) `index`.
    pub(super) fn generator(self, seed: u64, index: u64) -> impl Rng + use<> {
        parallel::rng(seed, index.wrapping_mul(4).wrapping_add(self as u64))
    }
}

/// The damage to every frame, in this order: dense noise, sparse noise, missing points.
///
/// ```
/// use posing_score::damage::Corruption;
///
/// let points = ["hip", "knee"].map(String::from);
/// let damage = Corruption { dense: 2.0, drop: vec!["hip".into()], ..Corruption::default() };
/// let mut xyz = ndarray::Array2::zeros((1000, 6));
/// damage.check(&points)?.apply_frames(&mut xyz);
/// assert!(xyz[[0, 0]].is_nan());
/// let knee = xyz.column(3); // noise with a standard deviation of 2 cm
/// assert!((knee.std(0.0) - 2.0).abs() < 0.2);
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Corruption {
    /// Standard deviation of the noise on every observed coordinate, cm, 0 to [`MAX_NOISE`]; 0 is
    /// none.
    pub dense: f64,
    /// Standard deviation of the noise on the coordinates of randomly chosen points, cm, 0 to
    /// [`MAX_NOISE`]; 0 is none.
    pub sparse: f64,
    /// The probability, 0 to 1, that a point of a frame is chosen for the sparse noise,
    /// independently of all others (Bernoulli). Lai et al.'s 0.2 is the default.
    pub share: f64,
    /// The only points that stay observed; `None` for all of them.
    pub keep: Option<Vec<String>>,
    /// Points that become missing.
    pub drop: Vec<String>,
    /// The seed.
    pub seed: u64,
}

impl Default for Corruption {
    fn default() -> Self {
        Corruption {
            dense: 0.0,
            sparse: 0.0,
            share: 0.2,
            keep: None,
            drop: Vec::new(),
            seed: 0,
        }
    }
}

impl Corruption {
    /// Checks the limits, and the names against the table's points.
    ///
    /// # Errors
    /// [`Error::Usage`] for a number out of range or a name that is no point of the table.
    pub fn check(&self, points: &[String]) -> Result<Corruptor> {
        for (name, sd) in [("dense", self.dense), ("sparse", self.sparse)] {
            if !(0.0..=MAX_NOISE).contains(&sd) {
                return Err(Error::usage(format!(
                    "the option `{name} {sd}`: expected a standard deviation of 0 to {MAX_NOISE} \
                     cm"
                )));
            }
        }
        if !(0.0..=1.0).contains(&self.share) {
            let share = self.share;
            return Err(Error::usage(format!(
                "the option `share {share}`: expected 0 to 1"
            )));
        }
        let mut hidden = vec![self.keep.is_some(); points.len()];
        for name in self.keep.iter().flatten() {
            hidden[find(points, name, "keep")?] = false;
        }
        for name in &self.drop {
            hidden[find(points, name, "drop")?] = true;
        }
        Ok(Corruptor {
            dense: self.dense,
            sparse: self.sparse,
            share: self.share,
            seed: self.seed,
            hidden,
        })
    }
}

fn find(points: &[String], name: &str, option: &str) -> Result<usize> {
    points.iter().position(|p| p == name).ok_or_else(|| {
        let known = points.iter().take(4).cloned().collect::<Vec<_>>();
        let known = known.join(", ");
        let more = if points.len() > 4 { ", ..." } else { "" };
        Error::usage(format!(
            "the option `{option}`: the table has no point \"{name}\"; its points are \
             {known}{more}"
        ))
    })
}

/// A checked [`Corruption`].
#[derive(Debug, Clone, PartialEq)]
pub struct Corruptor {
    dense: f64,
    sparse: f64,
    share: f64,
    seed: u64,
    /// Whether a point is hidden, J of them.
    hidden: Vec<bool>,
}

impl Corruptor {
    /// Damages the frames of a table (frames, 3 J), counted from 0.
    pub fn apply_frames(&self, xyz: &mut Array2<f64>) {
        for (frame, mut row) in (0..).zip(xyz.rows_mut()) {
            let mut values = row.to_vec();
            self.apply(frame, &mut values);
            row.assign(&ArrayView1::from(&values));
        }
    }

    /// Damages frame `frame` (counted over the whole input), 3 J numbers in centimeters; NaN stays
    /// NaN.
    ///
    /// The noise of a coordinate depends on the seed, the frame number and the index of the
    /// coordinate only: frames may come in any order, and a missing value does not shift the
    /// noise of the others.
    pub fn apply(&self, frame: u64, xyz: &mut [f64]) {
        // No noise adds nothing: -0 + 0 would change the bits.
        if self.dense > 0.0 {
            let mut random = Stream::Dense.generator(self.seed, frame);
            for value in xyz.iter_mut() {
                *value += self.dense * random.sample::<f64, _>(StandardNormal);
            }
        }
        if self.sparse > 0.0 {
            let mut random = Stream::Sparse.generator(self.seed, frame);
            for point in xyz.chunks_exact_mut(3) {
                let chosen = random.random::<f64>() < self.share;
                for value in point {
                    let noise = self.sparse * random.sample::<f64, _>(StandardNormal);
                    if chosen {
                        *value += noise;
                    }
                }
            }
        }
        for (point, _) in xyz
            .chunks_exact_mut(3)
            .zip(&self.hidden)
            .filter(|(_, hidden)| **hidden)
        {
            point.fill(f64::NAN);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(count: usize) -> Vec<String> {
        (0..count).map(|i| format!("p{i}")).collect()
    }

    fn corruption(change: impl Fn(&mut Corruption)) -> Corruption {
        let mut what = Corruption::default();
        change(&mut what);
        what
    }

    fn damaged(what: &Corruption, frames: u64, points: usize) -> Vec<Vec<f64>> {
        let corruptor = what.check(&names(points)).unwrap();
        let frame = |f| {
            let mut xyz = vec![0.0; 3 * points];
            corruptor.apply(f, &mut xyz);
            xyz
        };
        (0..frames).map(frame).collect()
    }

    /// Mean and standard deviation.
    fn moments(values: &[f64]) -> (f64, f64) {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let var = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        (mean, var.sqrt())
    }

    #[test]
    fn dense_noise_has_the_standard_deviation_asked_for() {
        for sd in [0.5, 5.644] {
            let all = damaged(&corruption(|c| c.dense = sd), 2000, 23).concat();
            let n = all.len() as f64;
            let (mean, found) = moments(&all);
            // Six standard errors of each estimate.
            assert!(mean.abs() <= 6.0 * sd / n.sqrt(), "{mean}");
            assert!((found - sd).abs() <= 6.0 * sd / (2.0 * n).sqrt(), "{found}");
            // Neighboring coordinates and frames are uncorrelated.
            for lag in [1, 69] {
                let products = all.windows(lag + 1).map(|w| w[0] * w[lag]);
                let r = products.sum::<f64>() / (n * sd * sd);
                assert!(r.abs() <= 6.0 / n.sqrt(), "{r}");
            }
        }
    }

    #[test]
    fn sparse_noise_hits_its_share_of_whole_points() {
        for share in [0.0, 0.2, 0.7, 1.0] {
            let what = corruption(|c| (c.sparse, c.share) = (2.0, share));
            let all = damaged(&what, 1000, 23).concat();
            let (points, _) = all.as_chunks::<3>();
            let hit = points.iter().filter(|p| **p != [0.0; 3]);
            let hit: Vec<[f64; 3]> = hit.copied().collect();
            assert!(hit.iter().flatten().all(|v| *v != 0.0));
            let n = points.len() as f64;
            let off = (hit.len() as f64 / n - share).abs();
            assert!(off <= 6.0 * (share * (1.0 - share) / n).sqrt(), "{off}");
            if share > 0.0 {
                let (_, sd) = moments(hit.as_flattened());
                assert!((sd - 2.0).abs() <= 0.1, "{sd}");
            }
        }
    }

    #[test]
    fn noise_depends_on_seed_kind_frame_and_coordinate_only() {
        let dense = corruption(|c| c.dense = 1.0);
        let both = corruption(|c| (c.dense, c.sparse) = (1.0, 3.0));
        let all = damaged(&both, 50, 23);
        assert_eq!(all, damaged(&both, 50, 23));
        assert_ne!(
            all,
            damaged(&corruption(|c| (c.dense, c.seed) = (1.0, 8)), 50, 23)
        );
        // Sparse noise leaves the dense noise of the points that it spares.
        let (a, b) = (damaged(&dense, 50, 23).concat(), all.concat());
        let same = a.iter().zip(b).filter(|(x, y)| **x == *y).count();
        assert!(same as f64 >= 0.7 * 50.0 * 69.0, "{same}");
        // A missing value stays missing and shifts no noise.
        let corruptor = both.check(&names(3)).unwrap();
        let (mut whole, mut holed) = (vec![1.0; 9], vec![1.0; 9]);
        holed[4] = f64::NAN;
        corruptor.apply(3, &mut whole);
        corruptor.apply(3, &mut holed);
        assert!(holed[4].is_nan());
        (whole[4], holed[4]) = (0.0, 0.0);
        assert_eq!(whole, holed);
    }

    #[test]
    fn points_are_kept_and_dropped_by_name() {
        let seen = |keep: Option<&[&str]>, drop: &[&str]| -> Vec<bool> {
            let list = |l: &[&str]| l.iter().map(|s| s.to_string()).collect::<Vec<_>>();
            let what = corruption(|c| (c.keep, c.drop) = (keep.map(list), list(drop)));
            let frame = &damaged(&what, 1, 4)[0];
            frame.chunks_exact(3).map(|p| p[0] == 0.0).collect()
        };
        assert_eq!(seen(None, &[]), [true; 4]);
        assert_eq!(seen(Some(&["p1", "p3"]), &[]), [false, true, false, true]);
        assert_eq!(seen(None, &["p3"]), [true, true, true, false]);
        assert_eq!(
            seen(Some(&["p1", "p3"]), &["p3"]),
            [false, true, false, false]
        );
    }

    #[test]
    fn nothing_asked_changes_no_bit() {
        let corruptor = Corruption::default().check(&names(1)).unwrap();
        let mut xyz = [-0.0, f64::MAX, f64::NAN];
        let before = xyz.map(f64::to_bits);
        corruptor.apply(0, &mut xyz);
        assert_eq!(xyz.map(f64::to_bits), before);
        // The largest noise leaves the largest number finite.
        let most = corruption(|c| c.dense = MAX_NOISE).check(&names(1));
        most.unwrap().apply(0, &mut xyz);
        assert!(xyz[1].is_finite());
    }

    #[test]
    fn limits_are_named() {
        let says = |change: &dyn Fn(&mut Corruption), part: &str| {
            let e = corruption(change).check(&names(6)).unwrap_err();
            assert!(e.to_string().contains(part) && e.exit_code() == 2, "{e}");
        };
        says(&|c| c.dense = f64::NAN, "the option `dense NaN`");
        says(&|c| c.sparse = -1.0, "the option `sparse -1`");
        says(&|c| c.share = 1.5, "the option `share 1.5`");
        says(&|c| c.keep = Some(vec!["x".into()]), "no point \"x\"");
        says(&|c| c.drop = vec!["x".into()], "the option `drop`");
    }
}
