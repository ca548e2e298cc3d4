//! Sums of products at all shifts, by Fourier transforms.

use realfft::num_complex::Complex64;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::sync::Arc;

/// The transform of sequences for their sums of products.
pub(super) struct Correlator {
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
}

impl Correlator {
    /// For two sequences that have `values` numbers together.
    pub(super) fn new(values: usize) -> Correlator {
        let size = values.max(2).next_power_of_two();
        let mut planner = RealFftPlanner::new();
        Correlator {
            forward: planner.plan_fft_forward(size),
            inverse: planner.plan_fft_inverse(size),
        }
    }

    /// How many shifts there are; those below zero are counted from the end on.
    pub(super) fn shifts(&self) -> usize {
        self.forward.len()
    }

    /// The spectrum of a sequence, with zeros behind it.
    pub(super) fn spectrum(&self, values: impl Iterator<Item = f64>) -> Vec<Complex64> {
        let mut padded = self.forward.make_input_vec();
        padded.iter_mut().zip(values).for_each(|(own, v)| *own = v);
        let mut out = self.forward.make_output_vec();
        let done = self.forward.process(&mut padded, &mut out);
        done.expect("the lengths are those of the transform");
        out
    }

    /// Σ_j a(j + s) b(j) for each shift s, by the spectra of both.
    pub(super) fn correlation(&self, a: &[Complex64], b: &[Complex64]) -> Vec<f64> {
        let mut product: Vec<Complex64> = a.iter().zip(b).map(|(a, b)| a * b.conj()).collect();
        // These two are real but for rounding.
        for real in [0, self.shifts() / 2] {
            product[real].im = 0.0;
        }
        let mut out = self.inverse.make_output_vec();
        let done = self.inverse.process(&mut product, &mut out);
        done.expect("the lengths are those of the transform");
        let size = self.shifts() as f64;
        out.iter_mut().for_each(|v| *v /= size);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_products_are_those_of_the_definition() {
        let a: Vec<f64> = (0..37).map(|k| f64::from(k * k % 11) - 4.0).collect();
        let b: Vec<f64> = (0..20).map(|k| f64::from(k * 7 % 5) - 2.0).collect();
        let all = Correlator::new(a.len() + b.len());
        let [x, y] = [&a, &b].map(|v| all.spectrum(v.iter().copied()));
        let found = all.correlation(&x, &y);
        for shift in -19..37_isize {
            let at = |j: usize| a.get((j as isize + shift) as usize).copied().unwrap_or(0.0);
            let want: f64 = b.iter().enumerate().map(|(j, b)| at(j) * b).sum();
            let own = found[shift.rem_euclid(found.len() as isize) as usize];
            assert!((own - want).abs() < 1e-9, "{shift}: {own} {want}");
        }
    }

    #[test]
    fn few_values_are_transformed_too() {
        let least = Correlator::new(0);
        let none = least.spectrum(std::iter::empty());
        assert_eq!(least.correlation(&none, &none), [0.0; 2]);
        let one = least.spectrum(std::iter::once(3.0));
        assert_eq!(least.correlation(&one, &one), [9.0, 0.0]);
    }
}
