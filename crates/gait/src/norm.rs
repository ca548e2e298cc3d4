//! How far a walk is from a norm: GVS of nine angles, and GPS of all (Baker and others 2009).

use crate::cycles::{POINTS, mean_and_sd};
use crate::side::Side;
use glam::DVec3;
use serde::Serialize;

/// The nine angles: name, curve without the side, axis.
pub const GVS: [(&str, &str, usize); 9] = [
    ("pelvic_tilt", "PelvisAngles", 0),
    ("pelvic_obliquity", "PelvisAngles", 1),
    ("pelvic_rotation", "PelvisAngles", 2),
    ("hip_flexion", "HipAngles", 0),
    ("hip_adduction", "HipAngles", 1),
    ("hip_rotation", "HipAngles", 2),
    ("knee_flexion", "KneeAngles", 0),
    ("ankle_dorsiflexion", "AnkleAngles", 0),
    ("foot_progression", "FootProgressAngles", 2),
];

/// The mean course of the nine angles over a cycle, and their spread among the cycles it is made
/// of, degrees.
#[derive(Debug, Clone, PartialEq)]
pub struct Norm {
    /// The means, of each of [`GVS`] 101 points.
    pub mean: [Vec<f64>; 9],
    /// The standard deviations.
    pub sd: [Vec<f64>; 9],
    /// The number of cycles.
    pub cycles: usize,
}

/// A cycle's nine angles, 101 points each.
pub type NineAngles = [Vec<f64>; 9];

impl Norm {
    /// The norm of cycles of any side and person; those with an empty point do not count. `None`
    /// of none.
    pub fn of_cycles(cycles: &[NineAngles]) -> Option<Norm> {
        let is_whole = |cycle: &&NineAngles| {
            cycle
                .iter()
                .all(|c| c.len() == POINTS && c.iter().all(|v| v.is_finite()))
        };
        let cycles: Vec<&NineAngles> = cycles.iter().filter(is_whole).collect();
        if cycles.is_empty() {
            return None;
        }
        let of = |k: usize| {
            let columns = cycles
                .iter()
                .map(|c| c[k].iter().map(|v| DVec3::splat(*v)).collect());
            let columns: Vec<Vec<DVec3>> = columns.collect();
            mean_and_sd(&columns, true).map(|v| v.iter().map(|v| v.x).collect::<Vec<f64>>())
        };
        let both: [[Vec<f64>; 2]; 9] = std::array::from_fn(of);
        Some(Norm {
            mean: both.clone().map(|[mean, _]| mean),
            sd: both.map(|[_, sd]| sd),
            cycles: cycles.len(),
        })
    }

    /// The gait variable scores of a side's mean cycle: the root mean square of each angle's
    /// distance from the norm, degrees.
    pub fn variable_scores(&self, mean: &NineAngles) -> [f64; 9] {
        std::array::from_fn(|k| {
            let apart = mean[k].iter().zip(&self.mean[k]);
            let apart = apart.map(|(own, norm)| crate::axes::wrapped(own - norm).powi(2));
            (apart.sum::<f64>() / POINTS as f64).sqrt()
        })
    }
}

/// Gait profile scores, degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ProfileScores {
    /// Over the nine of the left side.
    pub left: f64,
    /// Over the nine of the right side.
    pub right: f64,
    /// Over fifteen: the pelvis counts once, by the left side's cycle.
    pub overall: f64,
}

impl ProfileScores {
    /// The scores of both sides' [`Norm::variable_scores`].
    pub fn new(scores: [[f64; 9]; 2]) -> ProfileScores {
        let rms = |all: &[f64]| (all.iter().map(|v| v * v).sum::<f64>() / all.len() as f64).sqrt();
        let [left, right] = Side::BOTH.map(|side| scores[side as usize]);
        ProfileScores {
            left: rms(&left),
            right: rms(&right),
            overall: rms(&[&left[..], &right[3..]].concat()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_are_those_by_hand() {
        let flat = |value: f64| -> NineAngles { std::array::from_fn(|_| vec![value; POINTS]) };
        let norm = Norm::of_cycles(&[flat(0.0), flat(2.0), flat(f64::NAN)]).unwrap();
        assert!(norm.cycles == 2 && (norm.mean[4][50] - 1.0).abs() < 1e-12);
        let scores = norm.variable_scores(&flat(4.0));
        assert!(scores.iter().all(|s| (s - 3.0).abs() < 1e-12));
        let profile = ProfileScores::new([scores, [0.0; 9]]);
        assert!((profile.left - 3.0).abs() < 1e-12 && profile.right == 0.0);
        assert!((profile.overall - 3.0 * (9.0f64 / 15.0).sqrt()).abs() < 1e-12);
        assert!(Norm::of_cycles(&[]).is_none());
    }
}
