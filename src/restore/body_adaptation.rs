//! Adapting a model to a captured body: bone lengths are measured, and the model is transformed.
//!
//! The log ratio of each bone to the model's is shrunk by its uncertainty: keep · log(ℓ / ℓ₀) with
//! keep = .1² / (.1² + s²), ℓ the measured length less the noise (cm), s² its relative variance.
//! Transforming the model ([`PoseTransform`], linear) rather than the poses works whatever points a
//! frame lacks, and needs no inverse.

use crate::pose::{Body, PoseTransform};
use ndarray::ArrayView2;

/// Standard deviation of the log ratio of bone lengths between people.
const PEOPLE_DIFFER: f64 = 0.1;

/// The transform from the model's body to the one that `xyz` (frames, 3 J; cm) shows; `noise` is
/// the standard deviation of a coordinate, cm. A noisy length is too long, as each end adds
/// variance. Bones that are never seen take the ratio of their left-right counterpart, else the
/// typical one.
pub fn map_to(
    model: &Body,
    xyz: ArrayView2<'_, f64>,
    noise: f64,
    mirror: &[Option<usize>],
) -> PoseTransform {
    let seen = Body::measure(&model.parents, xyz);
    let frames = xyz.nrows().max(1) as f64;
    let mut target = seen.clone();
    for k in 0..target.lengths.len() {
        let (length, reference) = (seen.lengths[k], model.lengths[k]);
        if !length.is_finite() || !(reference > 0.0) {
            target.lengths[k] = f64::NAN;
            continue;
        }
        let true_length = (length * length - 4.0 * noise * noise)
            .max(0.25 * reference * reference)
            .sqrt();
        let log = (true_length / reference).ln().clamp(-1.5, 1.5);
        let length_sd = 2.0 * noise * noise / (reference * reference) / frames.sqrt();
        let keep = PEOPLE_DIFFER.powi(2) / (PEOPLE_DIFFER.powi(2) + length_sd);
        target.lengths[k] = reference * (keep * log).exp();
    }
    for k in 0..target.lengths.len() {
        if target.lengths[k].is_nan()
            && let Some(m) =
                mirror[k].filter(|&m| target.lengths[m].is_finite() && model.lengths[m] > 0.0)
        {
            target.lengths[k] = model.lengths[k] * target.lengths[m] / model.lengths[m];
        }
    }
    PoseTransform::reshape(model, &target)
}

/// Standard deviation (cm) of a length measured in `frames` with `noise` (standard deviation of a
/// coordinate, cm). A length that was never seen differs as between people, less what the other
/// bones say.
pub fn length_sd(length: f64, noise: f64, frames: usize) -> f64 {
    if frames == 0 {
        return 0.3 * PEOPLE_DIFFER * length;
    }
    let measured = 2.0 * noise * noise / (length * length) / (frames as f64).sqrt();
    let people = PEOPLE_DIFFER * PEOPLE_DIFFER;
    length * (people * measured / (people + measured)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn a_longer_body_is_measured_and_noise_is_allowed_for() {
        let model = Body {
            parents: vec![None, Some(0), Some(1)],
            lengths: vec![f64::NAN, 20.0, 30.0],
        };
        let ratios = |map: &PoseTransform| match map {
            PoseTransform::Reshape { ratios, .. } => ratios.clone(),
            PoseTransform::Rotate(_) => vec![],
        };
        let mut xyz = Array2::zeros((50, 9));
        xyz.column_mut(3).fill(22.0);
        xyz.column_mut(6).fill(22.0);
        xyz.column_mut(7).fill(33.0);
        let mirror = vec![None; 3];
        let exact = ratios(&map_to(&model, xyz.view(), 0.0, &mirror));
        assert!(exact[1..].iter().all(|r| (r - 1.1).abs() <= 1e-9));
        // Under heavy noise in one frame the ratio stays near 1.
        let noisy = ratios(&map_to(
            &model,
            xyz.slice(ndarray::s![..1, ..]),
            8.0,
            &mirror,
        ));
        assert!(
            noisy[1..].iter().all(|r| (0.85..1.1).contains(r)),
            "{noisy:?}"
        );
        // The second bone is never seen: it takes the ratio of the first.
        xyz.column_mut(8).fill(f64::NAN);
        let usual = ratios(&map_to(&model, xyz.view(), 0.0, &mirror));
        assert!((usual[2] - 1.1).abs() <= 1e-9);
    }
}
