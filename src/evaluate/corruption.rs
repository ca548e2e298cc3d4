//! Seeded damage to single frames: noise and missing points.
//!
//! The paper's tests (section 4): Gaussian noise on every coordinate ("dense"), Gaussian noise on a fifth of the joints
//! ("sparse"), all joints but six hidden (completion). [`super::gap_injection`] makes gaps in time.

use crate::numeric::parallel;
use crate::{Error, Result};
use rand::Rng;
use rand_distr::StandardNormal;

/// The largest standard deviation of noise, in centimetres: below it no sum with a finite number overflows.
pub const MAX_NOISE: f64 = 1e6;

/// The random streams of one seed. Each kind of damage has its own, so that adding one kind does not change the others.
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
#[derive(Debug, Clone, PartialEq)]
pub struct Corruption {
    /// Standard deviation of the noise on every observed coordinate, cm, 0 to [`MAX_NOISE`]; 0 is none.
    pub dense: f64,
    /// Standard deviation of the noise on the coordinates of randomly chosen points, cm, 0 to [`MAX_NOISE`]; 0 is none.
    pub sparse: f64,
    /// The probability, 0 to 1, that a point of a frame is chosen for the sparse noise, independently of all others
    /// (Bernoulli). The paper's 0.2 is the default.
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
                    "--{name} {sd}: expected a standard deviation of 0 to {MAX_NOISE} cm"
                )));
            }
        }
        if !(0.0..=1.0).contains(&self.share) {
            let share = self.share;
            return Err(Error::usage(format!("--share {share}: expected 0 to 1")));
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

fn find(points: &[String], name: &str, flag: &str) -> Result<usize> {
    points.iter().position(|p| p == name).ok_or_else(|| {
        let known = points.iter().take(4).cloned().collect::<Vec<_>>();
        let known = known.join(", ");
        let more = if points.len() > 4 { ", ..." } else { "" };
        Error::usage(format!(
            "--{flag}: the table has no point \"{name}\"; its points are {known}{more}"
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
    /// Damages frame `frame` (counted over the whole input), 3 J numbers in centimetres; NaN stays NaN.
    ///
    /// The noise of a coordinate depends on the seed, the frame number and the index of the coordinate only: frames may come
    /// in any order, and a missing value does not shift the noise of the others.
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

    fn damaged(what: &Corruption, frames: u64, points: usize) -> Vec<Vec<f64>> {
        let corruptor = what.check(&names(points)).unwrap();
        (0..frames)
            .map(|f| {
                let mut xyz = vec![0.0; 3 * points];
                corruptor.apply(f, &mut xyz);
                xyz
            })
            .collect()
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
            let what = Corruption {
                dense: sd,
                ..Corruption::default()
            };
            let all = damaged(&what, 2000, 23).concat();
            let n = all.len() as f64;
            let (mean, found) = moments(&all);
            // Six standard errors of each estimate.
            assert!(mean.abs() <= 6.0 * sd / n.sqrt(), "{mean}");
            assert!((found - sd).abs() <= 6.0 * sd / (2.0 * n).sqrt(), "{found}");
            // Neighbouring frames and coordinates are not alike.
            let r = all.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / (n * sd * sd);
            let s = all.windows(70).map(|w| w[0] * w[69]).sum::<f64>() / (n * sd * sd);
            assert!(
                r.abs() <= 6.0 / n.sqrt() && s.abs() <= 6.0 / n.sqrt(),
                "{r} {s}"
            );
        }
    }

    #[test]
    fn sparse_noise_hits_its_share_of_whole_points() {
        for share in [0.0, 0.2, 0.7, 1.0] {
            let what = Corruption {
                sparse: 2.0,
                share,
                ..Corruption::default()
            };
            let all = damaged(&what, 1000, 23);
            let points: Vec<&[f64]> = all.iter().flat_map(|f| f.chunks_exact(3)).collect();
            let hit: Vec<&[f64]> = points
                .iter()
                .copied()
                .filter(|p| p.iter().any(|v| *v != 0.0))
                .collect();
            assert!(hit.iter().all(|p| p.iter().all(|v| *v != 0.0)));
            let n = points.len() as f64;
            let off = (hit.len() as f64 / n - share).abs();
            assert!(off <= 6.0 * (share * (1.0 - share) / n).sqrt(), "{off}");
            if share > 0.0 {
                let (_, sd) = moments(&hit.concat());
                assert!((sd - 2.0).abs() <= 0.1, "{sd}");
            }
        }
    }

    #[test]
    fn a_seed_repeats_and_another_does_not() {
        let what = |seed| Corruption {
            dense: 1.0,
            sparse: 3.0,
            seed,
            ..Corruption::default()
        };
        assert_eq!(damaged(&what(7), 20, 5), damaged(&what(7), 20, 5));
        assert_ne!(damaged(&what(7), 20, 5), damaged(&what(8), 20, 5));
    }

    #[test]
    fn kinds_of_damage_do_not_shift_each_other() {
        let dense = Corruption {
            dense: 1.0,
            ..Corruption::default()
        };
        let both = Corruption {
            sparse: 3.0,
            ..dense.clone()
        };
        let (a, b) = (damaged(&dense, 50, 23), damaged(&both, 50, 23));
        let same = a
            .concat()
            .iter()
            .zip(b.concat())
            .filter(|(x, y)| **x == *y)
            .count();
        assert!(same as f64 >= 0.7 * 50.0 * 69.0, "{same}");
    }

    #[test]
    fn missing_stays_missing_and_shifts_nothing() {
        let what = Corruption {
            dense: 1.0,
            sparse: 1.0,
            ..Corruption::default()
        };
        let corruptor = what.check(&names(3)).unwrap();
        let (mut whole, mut holed) = (vec![1.0; 9], vec![1.0; 9]);
        holed[4] = f64::NAN;
        corruptor.apply(3, &mut whole);
        corruptor.apply(3, &mut holed);
        for i in 0..9 {
            assert!(if i == 4 {
                holed[i].is_nan()
            } else {
                holed[i] == whole[i]
            });
        }
    }

    #[test]
    fn points_are_kept_and_dropped_by_name() {
        let seen = |what: Corruption| -> Vec<bool> {
            let frame = &damaged(&what, 1, 4)[0];
            frame.chunks_exact(3).map(|p| p[0] == 0.0).collect()
        };
        let list = |l: &[&str]| l.iter().map(|s| s.to_string()).collect::<Vec<_>>();
        let keep = Some(list(&["p1", "p3"]));
        let drop = list(&["p3"]);
        let base = Corruption::default;
        assert_eq!(seen(base()), [true; 4]);
        assert_eq!(
            seen(Corruption {
                keep: keep.clone(),
                ..base()
            }),
            [false, true, false, true]
        );
        assert_eq!(
            seen(Corruption {
                drop: drop.clone(),
                ..base()
            }),
            [true, true, true, false]
        );
        assert_eq!(
            seen(Corruption {
                keep,
                drop,
                ..base()
            }),
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
        let what = Corruption {
            dense: MAX_NOISE,
            ..Corruption::default()
        };
        what.check(&names(1)).unwrap().apply(0, &mut xyz);
        assert!(xyz[1].is_finite());
    }

    #[test]
    fn limits_are_named() {
        let says = |what: Corruption, part: &str| {
            let e = what.check(&names(6)).unwrap_err();
            assert_eq!(e.exit_code(), 2);
            assert!(e.to_string().contains(part), "{e}");
        };
        let base = Corruption::default;
        says(
            Corruption {
                dense: f64::NAN,
                ..base()
            },
            "--dense",
        );
        says(
            Corruption {
                sparse: -1.0,
                ..base()
            },
            "--sparse",
        );
        says(
            Corruption {
                share: 1.5,
                ..base()
            },
            "--share",
        );
        says(
            Corruption {
                keep: Some(vec!["x".into()]),
                ..base()
            },
            "no point \"x\"",
        );
        says(
            Corruption {
                drop: vec!["x".into()],
                ..base()
            },
            "--drop",
        );
    }
}
