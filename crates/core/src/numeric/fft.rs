//! The fast Fourier transform of a power of two of numbers (Cooley and Tukey 1965), and by it sums
//! of products at all shifts.

use std::f64::consts::TAU;

/// A complex number: its real part, and its imaginary one.
type Complex = [f64; 2];

fn times(a: Complex, b: Complex) -> Complex {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

/// The transform for one number of values.
#[derive(Debug, Clone)]
pub struct Fft {
    /// The roots of unity exp(-i τ k / n), k below n / 2.
    roots: Vec<Complex>,
    size: usize,
}

impl Fft {
    /// The transform of the least power of two that is not below `values`.
    pub fn new(values: usize) -> Fft {
        let size = values.max(2).next_power_of_two();
        let root = |k: usize| {
            let (sin, cos) = (-TAU * k as f64 / size as f64).sin_cos();
            [cos, sin]
        };
        Fft {
            roots: (0..size / 2).map(root).collect(),
            size,
        }
    }

    /// How many values are transformed, a power of two.
    pub fn size(&self) -> usize {
        self.size
    }

    /// The spectrum of real values, with zeros behind them.
    pub fn spectrum(&self, values: impl Iterator<Item = f64>) -> Vec<Complex> {
        let mut out: Vec<Complex> = values.map(|v| [v, 0.0]).collect();
        out.resize(self.size, [0.0; 2]);
        self.transform(&mut out);
        out
    }

    /// Σ_j a(j + s) b(j) for each shift s, of negative ones from the end on, by the spectra of
    /// both.
    pub fn correlation(&self, a: &[Complex], b: &[Complex]) -> Vec<f64> {
        // The inverse is the conjugate of the transform of the conjugate.
        let product = |(a, b): (&Complex, &Complex)| times([a[0], -a[1]], *b);
        let mut out: Vec<Complex> = a.iter().zip(b).map(product).collect();
        self.transform(&mut out);
        out.iter().map(|v| v[0] / self.size as f64).collect()
    }

    /// Transforms in place.
    fn transform(&self, values: &mut [Complex]) {
        let n = self.size;
        let bits = n.trailing_zeros();
        for i in 0..n {
            let j = i.reverse_bits() >> (usize::BITS - bits);
            if i < j {
                values.swap(i, j);
            }
        }
        let mut half = 1;
        while half < n {
            let step = n / (2 * half);
            for block in values.chunks_exact_mut(2 * half) {
                let (low, high) = block.split_at_mut(half);
                for (k, (x, y)) in low.iter_mut().zip(high).enumerate() {
                    let turned = times(*y, self.roots[k * step]);
                    *y = [x[0] - turned[0], x[1] - turned[1]];
                    *x = [x[0] + turned[0], x[1] + turned[1]];
                }
            }
            half *= 2;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_products_are_those_of_the_definition() {
        let a: Vec<f64> = (0..37).map(|k| f64::from(k * k % 11) - 4.0).collect();
        let b: Vec<f64> = (0..20).map(|k| f64::from(k * 7 % 5) - 2.0).collect();
        let fft = Fft::new(a.len() + b.len());
        let [x, y] = [&a, &b].map(|v| fft.spectrum(v.iter().copied()));
        let found = fft.correlation(&x, &y);
        for shift in -19..37_isize {
            let at = |j: usize| a.get((j as isize + shift) as usize).copied().unwrap_or(0.0);
            let want: f64 = b.iter().enumerate().map(|(j, b)| at(j) * b).sum();
            let own = found[shift.rem_euclid(found.len() as isize) as usize];
            assert!((own - want).abs() < 1e-9, "{shift}: {own} {want}");
        }
    }

    #[test]
    fn few_values_are_transformed_too() {
        let fft = Fft::new(0);
        let none = fft.spectrum(std::iter::empty());
        assert_eq!(fft.correlation(&none, &none), [0.0; 2]);
        let one = fft.spectrum(std::iter::once(3.0));
        assert_eq!(fft.correlation(&one, &one), [9.0, 0.0]);
    }
}
