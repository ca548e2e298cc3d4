//! An observed pose: values, and the variance of each value's noise.

use crate::{Error, Place, Result};
use glam::DVec3;

/// Whole points from which a pose can be placed; Lai et al. complete from as many.
const MIN_WHOLE_POINTS: usize = 6;

/// One observed pose of J points.
///
/// Dense noise, outliers and gaps are all variances: a missing coordinate has an infinite variance,
/// an exact one 0. The fields are public, so that code which has checked its numbers can build an
/// observation without [`Observation::new`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation<'a> {
    /// (3 J), cm. A value is not read where its variance is infinite.
    pub values: &'a [f64],
    /// The variance of the noise of each value (3 J), cm².
    pub variance: &'a [f64],
}

impl<'a> Observation<'a> {
    /// Checks the numbers of an observation.
    ///
    /// ```
    /// use posing_core::pose::Observation;
    ///
    /// let seen = Observation::new(&[1.0, 2.0, f64::NAN], &[0.0, 0.5, f64::INFINITY])?;
    /// assert_eq!(seen.dimension(), 3);
    /// assert!(Observation::new(&[1.0], &[-1.0]).is_err());
    /// # Ok::<(), posing_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// Data: `values` and `variance` have different lengths; a variance is negative or NaN; a value
    /// with a finite variance is not finite.
    pub fn new(values: &'a [f64], variance: &'a [f64]) -> Result<Observation<'a>> {
        let wrong = |what: String| Err(Error::data(Place::file("the observation"), what));
        if values.len() != variance.len() {
            let (n, m) = (values.len(), variance.len());
            return wrong(format!("has {n} values, but {m} variances"));
        }
        for (i, (value, variance)) in values.iter().zip(variance).enumerate() {
            if variance.is_nan() || *variance < 0.0 {
                return wrong(format!(
                    "variance {i} is {variance}: expected 0 or more, infinite where missing"
                ));
            }
            if variance.is_finite() && !value.is_finite() {
                return wrong(format!(
                    "value {i} is {value}: give a missing value an infinite variance"
                ));
            }
        }
        Ok(Observation { values, variance })
    }

    /// The number of coordinates, 3 J.
    pub fn dimension(&self) -> usize {
        self.values.len()
    }

    /// The points of which all three coordinates are observed: the index, the position (cm), and
    /// the precision of a coordinate (1/cm²) if the model leaves `residual_variance` (3 J, cm²)
    /// unexplained.
    pub fn points(
        &self,
        residual_variance: &'a [f64],
    ) -> impl Iterator<Item = (usize, DVec3, f64)> + Clone + 'a {
        let (values, noise) = (self.values, self.variance);
        (0..values.len() / 3).filter_map(move |j| {
            let variance: f64 = (3 * j..3 * j + 3)
                .map(|c| noise[c] + residual_variance[c])
                .sum();
            variance
                .is_finite()
                .then(|| (j, DVec3::from_slice(&values[3 * j..]), 3.0 / variance))
        })
    }

    /// Whether one or two coordinates of some point are observed: Lai et al.'s 2-D input.
    #[doc(hidden)]
    pub fn is_partial(&self) -> bool {
        (0..self.dimension() / 3).any(|p| self.is_point_partial(p))
    }

    /// The variances (3 J) if `points` were missing.
    #[doc(hidden)]
    pub fn variance_without(&self, points: &[usize]) -> Vec<f64> {
        let mut variance = self.variance.to_vec();
        for p in points {
            variance[3 * p..3 * p + 3].fill(f64::INFINITY);
        }
        variance
    }

    /// The partly observed points, if enough points are whole to place the pose by them: at least
    /// six, and no fewer than the partial ones. Empty otherwise, as for a picture.
    #[doc(hidden)]
    pub fn removable_partial_points(&self) -> Vec<usize> {
        let points = 0..self.dimension() / 3;
        let whole = points.clone().filter(|&p| self.count(p) == 3).count();
        let partial: Vec<usize> = points.filter(|&p| self.is_point_partial(p)).collect();
        if whole >= MIN_WHOLE_POINTS.max(partial.len()) {
            partial
        } else {
            Vec::new()
        }
    }

    /// The variances (3 J), each replaced by the mean of its point's three. A rotation mixes the
    /// coordinates of a point.
    #[doc(hidden)]
    pub fn pointwise_variance(&self) -> Vec<f64> {
        self.variance
            .chunks_exact(3)
            .flat_map(|n| [n.iter().sum::<f64>() / 3.0; 3])
            .collect()
    }

    /// The number of observed coordinates of a point.
    fn count(&self, p: usize) -> usize {
        let point = &self.variance[3 * p..3 * p + 3];
        point.iter().filter(|v| v.is_finite()).count()
    }

    fn is_point_partial(&self, p: usize) -> bool {
        matches!(self.count(p), 1 | 2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_numbers_are_refused_with_their_index() {
        let nan = f64::NAN;
        for (values, variance, index) in [
            (vec![1.0, 2.0], vec![0.0], "2 values, but 1"),
            (vec![1.0, 2.0], vec![0.0, nan], "variance 1"),
            (vec![1.0, 2.0], vec![-0.1, 0.0], "variance 0"),
            (vec![1.0, nan], vec![0.0, 1.0], "value 1"),
            (vec![f64::INFINITY], vec![1.0], "value 0"),
        ] {
            let e = Observation::new(&values, &variance).unwrap_err();
            assert!(e.to_string().contains(index), "{e}");
        }
        assert!(Observation::new(&[nan], &[f64::INFINITY]).is_ok());
    }

    #[test]
    fn partial_points_are_removable_among_six_whole_ones() {
        let values = [0.0; 24];
        let mut variance = [1.0; 24];
        variance[21..23].fill(f64::INFINITY);
        let seen = Observation::new(&values, &variance).unwrap();
        assert!(seen.is_partial());
        assert_eq!(seen.removable_partial_points(), [7]);
        assert!(seen.pointwise_variance()[23].is_infinite());
        variance[..6].fill(f64::INFINITY);
        let seen = Observation::new(&values, &variance).unwrap();
        assert!(seen.removable_partial_points().is_empty());
        let without = seen.variance_without(&[7]);
        let seen = Observation::new(&values, &without).unwrap();
        assert!(!seen.is_partial());
        assert_eq!(seen.points(&[1.0; 24]).count(), 5);
    }
}
