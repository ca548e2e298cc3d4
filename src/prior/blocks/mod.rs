//! The default model: a sparse code in blocks at many scales, averaged over its supports.
//!
//! A block is a mean and a covariance; the scaled eigenvectors of the covariance are a sub-dictionary whose coefficients
//! are unit Gaussians, so a pose is a code with one active block. Blocks are the cells of k-means at many levels, at
//! several scales, and every training pose with the covariance of its cell at small scales (the paper's "poses as
//! atoms", with a width and a direction). Unseen poses combine known legs with known arms, so the same is learnt for
//! parts of the body, and several ways to make a body of parts compete:
//!
//! ```text
//! p(x) = Σ_F φ_F Π_{p in F} Σ_l w_pl Σ_{j in l} (n_j / N) N(x_p; m_j, C_j)
//! ```
//!
//! The answer is the posterior mean over all blocks and ways, not the single best: in that it parts from the paper.
//! Level and way weights are learnt by EM on takes held back from the training.

mod answer;
mod basis;
mod cells;
mod explained;
mod file;
mod fours;
mod kinds;
mod learn;
mod leaves;
mod lens;
mod limit;
mod near;
mod part;
mod parts;
mod scales;
mod search;
mod slope;
mod ways;

use super::met::Met;
use super::{Belief, Enough, Fit, Posterior, Prior, Slope};
use crate::numeric::small_linalg::log_sum;
use crate::pose::{ASF_UNIT_CM, PoseMap};
use answer::Told;
use kinds::{ANSWERED, PLACED};
use learn::variance_of;
use leaves::Poses;
use lens::Pattern;
use limit::Limit;
use ndarray::{Array2, ArrayView2};
use part::{Part, View};
use std::sync::Arc;

pub use learn::{Settings, model, train};

/// No coordinate is taken for more exact than this variance, cm² (1e-3 asf²): blocks are no truer than that.
const FLOOR: f64 = 1e-3 * ASF_UNIT_CM * ASF_UNIT_CM;
/// So many noise patterns of the whole body are remembered; of parts more, as they are smaller.
const MOST_MET: usize = 16;
/// So many kinds of noise that is everywhere the same are.
const MOST_EVEN: usize = 16;

/// The blocks of all parts of a body.
#[derive(Debug, Clone)]
pub struct Blocks {
    width: usize,
    parts: Vec<Part>,
    /// Which parts make a whole body: each lists parts that cover every coordinate once.
    ways: Vec<Vec<usize>>,
    /// The log weight of each way.
    log_ways: Vec<f64>,
    /// What the log evidences of ways are multiplied by where they are averaged.
    temperature: f64,
    variance: Vec<f64>,
    typical: Array2<f64>,
    /// The training poses: what leaves are made of.
    poses: Arc<Poses>,
    /// Each part's views met before.
    met: Arc<Vec<Met<View>>>,
    /// Those through noise that is everywhere the same: what the others are made from.
    even: Arc<Vec<Met<View>>>,
    /// What is unlike all that was seen.
    limit: Limit,
}

/// No view of any part is made yet.
fn unmet(parts: usize) -> Arc<Vec<Met<View>>> {
    Arc::new((0..parts).map(|_| Met::default()).collect())
}

impl Blocks {
    /// How each part is seen through the noise (3 J). A limb is often seen as it was before where the body is not.
    fn views(&self, noise: &[f64]) -> Vec<Arc<View>> {
        let noise = kinds::few(noise, ANSWERED);
        (0..self.parts.len())
            .map(|p| self.view(p, &noise))
            .collect()
    }

    fn view(&self, p: usize, noise: &[f64]) -> Arc<View> {
        let part = &self.parts[p];
        let noise: Vec<f64> = part.coordinates.iter().map(|&i| noise[i]).collect();
        if let Pattern::Changed { unit, changed } = Pattern::of(&noise)
            && changed.is_empty()
        {
            return self.even(p, unit);
        }
        let smaller = self.width / noise.len().max(1);
        let most = MOST_MET * smaller * smaller;
        self.met[p].get(&noise, most, || {
            View::new(part, noise.clone(), |unit| self.even(p, unit))
        })
    }

    /// How a part is seen through noise that is everywhere the same.
    fn even(&self, p: usize, unit: f64) -> Arc<View> {
        let make = || View::even(&self.parts[p], unit);
        self.even[p].get(&[unit], MOST_EVEN, make)
    }
}

impl Prior for Blocks {
    fn width(&self) -> usize {
        self.width
    }

    fn variance(&self) -> &[f64] {
        &self.variance
    }

    fn believe(&self, y: &[f64], noise: &[f64]) -> Belief {
        let seen = self.consider(y, noise);
        self.join(&seen, Told::Covariance).belief(&seen)
    }

    fn believe_enough(
        &self,
        y: ArrayView2<'_, f64>,
        noise: ArrayView2<'_, f64>,
        enough: &[f64],
    ) -> Vec<Enough> {
        let rows = y.rows().into_iter().zip(noise.rows()).zip(enough);
        rows.map(|((y, noise), enough)| {
            let seen = self.consider(&y.to_vec(), &noise.to_vec());
            if enough.is_finite() {
                let posterior = self.join(&seen, Told::Variances).posterior();
                if posterior.variance.iter().sum::<f64>() >= *enough {
                    return Enough::Apart(posterior);
                }
            }
            Enough::Whole(self.join(&seen, Told::Covariance).belief(&seen))
        })
        .collect()
    }

    fn mean(&self, y: &[f64], noise: &[f64]) -> Vec<f64> {
        self.join(&self.consider(y, noise), Told::Mean).mean
    }

    /// By the cells of the whole body alone: what a placement of 2-D input is searched with, many times a frame.
    fn fit(&self, y: &[f64], noise: &[f64], _before: Option<&Fit>) -> Fit {
        let (part, view) = (&self.parts[0], &self.view(0, &kinds::few(noise, PLACED)));
        let found = part.explain_by_cells(view, y);
        let pose = part.answer(view, y, &found, Told::Mean).mean;
        Fit {
            objective: super::misfit(self, y, noise, &pose),
            support: Vec::new(),
            pose,
        }
    }

    fn slope(&self, y: &[f64], noise: &[f64], moves: &[Vec<f64>]) -> Option<Slope> {
        Some(self.parts[0].slope(&self.view(0, &kinds::few(noise, PLACED)), y, moves))
    }

    fn posterior(&self, y: &[f64], noise: &[f64], _fit: &Fit) -> Posterior {
        let seen = self.consider(y, noise);
        self.join(&seen, Told::Variances).posterior()
    }

    fn posteriors(&self, y: ArrayView2<'_, f64>, noise: ArrayView2<'_, f64>) -> Vec<Posterior> {
        let rows = y.rows().into_iter().zip(noise.rows());
        rows.map(|(y, noise)| self.posterior(&y.to_vec(), &noise.to_vec(), &Fit::default()))
            .collect()
    }

    fn evidence(&self, y: &[f64], noise: &[f64]) -> f64 {
        log_sum(&self.consider(y, noise).ways)
    }

    /// By the cells of the whole body alone, and measured on takes that were held back from the training.
    fn unlike(&self, pose: &[f64]) -> Option<f64> {
        self.limit.unlike(&self.parts[0], pose)
    }

    fn typical(&self) -> ArrayView2<'_, f64> {
        self.typical.view()
    }

    fn mapped(&self, map: &PoseMap) -> Box<dyn Prior> {
        if map.is_identity() {
            return Box::new(self.clone());
        }
        let map = &Arc::new(map.clone());
        let poses = Arc::new(self.poses.mapped(map));
        let parts = self.parts.iter().map(|p| p.mapped(map, &poses));
        let parts: Vec<Part> = parts.collect();
        Box::new(Blocks {
            variance: variance_of(&parts[0]),
            parts,
            typical: map.apply_rows(self.typical.view()),
            poses,
            met: unmet(self.parts.len()),
            even: unmet(self.parts.len()),
            limit: self.limit.mapped(&self.parts[0], map),
            ..self.clone()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use crate::pose::joints;
    use crate::prior::train::Training;
    use crate::prior::training::TrainingPoses;
    use rand::Rng;

    pub(super) fn poses() -> TrainingPoses {
        let mut generator = parallel::rng(3, 0);
        let ways: Vec<f32> = (0..4 * 69)
            .map(|_| generator.random::<f32>() - 0.5)
            .collect();
        let xyz = Array2::from_shape_fn((400, 69), |(t, c)| {
            let phase = t as f32 * 0.05;
            let waves = [
                phase.sin(),
                phase.cos(),
                (2.3 * phase).sin(),
                (0.7 * phase).cos(),
            ];
            let sum: f32 = (0..4).map(|k| ways[69 * k + c] * waves[k]).sum();
            20.0 * sum + c as f32
        });
        TrainingPoses {
            points: joints::cmu_names(),
            xyz,
            takes: vec![0..150, 150..280, 280..400],
            body: None,
            anchor: None,
            incomplete: 0,
            unplaced: 0,
        }
    }

    pub(super) fn learnt(poses: &TrainingPoses) -> (Blocks, crate::io::Model) {
        let settings = Settings {
            cells: vec![1, 4, 10],
            tested: 30,
            ..Settings::default()
        };
        let training = Training {
            poses,
            world: false,
            seed: 1,
            hold_back: Default::default(),
        };
        let model = model(&training, &settings, &mut |_| ()).unwrap();
        (Blocks::from_model(&model, "test").unwrap(), model)
    }

    #[test]
    fn a_known_pose_is_found_under_noise_and_from_a_few_points() {
        let poses = poses();
        let (blocks, _) = learnt(&poses);
        let pose: Vec<f64> = poses.xyz.row(77).iter().map(|v| f64::from(*v)).collect();
        let mut generator = parallel::rng(5, 0);
        let y: Vec<f64> = pose
            .iter()
            .map(|v| v + generator.random_range(-5.0..5.0))
            .collect();
        let off = |b: &Belief| {
            let sum: f64 = b
                .mean
                .iter()
                .zip(&pose)
                .map(|(a, b)| (a - b) * (a - b))
                .sum();
            (sum / 69.0).sqrt()
        };
        let dense = blocks.believe(&y, &[25.0 / 3.0; 69]);
        assert!(off(&dense) <= 1.5, "{}", off(&dense));
        let noise: Vec<f64> = (0..69)
            .map(|c| if c < 18 { 0.0 } else { f64::INFINITY })
            .collect();
        let filled = blocks.believe(&pose, &noise);
        assert!(off(&filled) <= 0.5, "{}", off(&filled));
        // The further from all that was learnt, the less evidence; nothing seen says nothing.
        let far: Vec<f64> = y.iter().map(|v| v + 60.0).collect();
        assert!(blocks.believe(&far, &[25.0 / 3.0; 69]).evidence < dense.evidence - 50.0);
        let none = blocks.believe(&y, &[f64::INFINITY; 69]);
        assert!(
            none.mean
                .iter()
                .chain(none.covariance.diag())
                .all(|v| v.is_finite())
        );
    }

    #[test]
    fn the_slope_is_that_of_the_evidence() {
        let poses = poses();
        let (blocks, _) = learnt(&poses);
        let y: Vec<f64> = poses
            .xyz
            .row(40)
            .iter()
            .map(|v| f64::from(*v) + 0.4)
            .collect();
        let moves: Vec<Vec<f64>> = (0..3)
            .map(|k| (0..69).map(|c| f64::from(u8::from(c % 3 == k))).collect())
            .collect();
        // Much noise, where directions share one; little; and of many kinds, with gaps.
        let mixed = (0..69).map(|c| match c {
            0..30 => f64::INFINITY,
            c => 0.5 + c as f64,
        });
        // And few gaps, and a point worse than the others.
        let changed = (0..69).map(|c| match c {
            0..12 => f64::INFINITY,
            30..33 => 30.0,
            _ => 4.0,
        });
        let noises = [
            vec![400.0; 69],
            vec![4.0; 69],
            mixed.collect(),
            changed.collect(),
        ];
        for noise in noises {
            let at = |k: usize, by: f64| -> f64 {
                let moved: Vec<f64> = y.iter().zip(&moves[k]).map(|(y, m)| y + by * m).collect();
                blocks.slope(&moved, &noise, &[]).unwrap().evidence
            };
            let slope = blocks.slope(&y, &noise, &moves).unwrap();
            for k in 0..3 {
                let told = 0.5 * (at(k, 1.0) - at(k, -1.0));
                let scale = 0.05 * told.abs().max(0.2);
                assert!(
                    (slope.gradient[k] - told).abs() <= scale,
                    "{} {told}",
                    slope.gradient[k]
                );
                assert!(slope.curvature[4 * k] > 0.0);
            }
        }
    }

    #[test]
    fn a_file_gives_the_same_answers_and_damage_is_told() {
        let poses = poses();
        let (blocks, model) = learnt(&poses);
        let bytes = model.to_bytes().unwrap();
        let again = crate::io::Model::from_bytes(bytes, "m").unwrap();
        let again = Blocks::from_model(&again, "m").unwrap();
        let y: Vec<f64> = poses
            .xyz
            .row(9)
            .iter()
            .map(|v| f64::from(*v) + 0.3)
            .collect();
        assert_eq!(
            blocks.believe(&y, &[1.0; 69]),
            again.believe(&y, &[1.0; 69])
        );
        // What is left out because it follows is found again.
        let mut short = model.clone();
        for (p, l) in (0..again.parts.len()).flat_map(|p| (0..3).map(move |l| (p, l))) {
            assert!(short.get(&format!("within.{p}.{l}")).is_some());
            short.remove(&format!("within.{p}.{l}"));
        }
        let short = Blocks::from_model(&short, "m").unwrap();
        let (all, short) = (again.believe(&y, &[1.0; 69]), short.believe(&y, &[1.0; 69]));
        let both = all.mean.iter().zip(&short.mean);
        assert!(both.clone().all(|(a, b)| (a - b).abs() <= 1e-3));
        for name in [
            "poses",
            "takes",
            "labels",
            "weights",
            "ways",
            "directions.0.1",
        ] {
            let mut broken = model.clone();
            broken.remove(name);
            let told = Blocks::from_model(&broken, "m").unwrap_err().to_string();
            assert!(told.contains(name), "{told}");
        }
    }

    #[test]
    fn a_covariance_is_told_unless_the_variances_are_enough() {
        let poses = poses();
        let (blocks, _) = learnt(&poses);
        let y = poses
            .xyz
            .slice(ndarray::s![40..42, ..])
            .mapv(|v| f64::from(v) + 0.5);
        let noise = Array2::from_elem((2, 69), 4.0);
        let told = blocks.posteriors(y.view(), noise.view());
        let whole = blocks.believe_all(y.view(), noise.view());
        let sum: f64 = told[1].variance.iter().sum();
        let some = blocks.believe_enough(y.view(), noise.view(), &[f64::INFINITY, sum]);
        assert_eq!(
            some,
            [
                Enough::Whole(whole[0].clone()),
                Enough::Apart(told[1].clone())
            ]
        );
        let none = blocks.believe_enough(y.view(), noise.view(), &[0.0, sum * 1.01]);
        assert_eq!(
            none,
            [
                Enough::Apart(told[0].clone()),
                Enough::Whole(whole[1].clone())
            ]
        );
    }

    #[test]
    fn what_is_no_number_has_no_answer() {
        let (blocks, _) = learnt(&poses());
        let broken = blocks.posterior(&[f64::NAN; 69], &[1.0; 69], &Fit::default());
        assert!(
            broken
                .mean
                .iter()
                .chain(&broken.variance)
                .all(|v| v.is_nan())
        );
    }

    #[test]
    fn a_turned_model_gives_turned_answers() {
        let poses = poses();
        let (blocks, _) = learnt(&poses);
        let turn = PoseMap::Turn(crate::pose::rotation::exponential(glam::DVec3::new(
            0.3, 1.0, -0.2,
        )));
        let y: Vec<f64> = poses
            .xyz
            .row(200)
            .iter()
            .map(|v| f64::from(*v) + 1.0)
            .collect();
        let mut turned = y.clone();
        turn.apply(&y, &mut turned);
        let mut want = y.clone();
        turn.apply(&blocks.believe(&y, &[9.0; 69]).mean, &mut want);
        let got = blocks.mapped(&turn).believe(&turned, &[9.0; 69]).mean;
        assert!(got.iter().zip(&want).all(|(a, b)| (a - b).abs() <= 1e-2));
    }
}
