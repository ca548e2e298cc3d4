//! Inner loops at the machine's vector width, chosen when the program runs.
//!
//! Every sum here is taken in eight lanes, in an order that the machine has no say in, and nothing
//! is fused: the bytes are the same whatever the vectors are. Rows are as long as a multiple of
//! [`LANES`]; what is beyond the data is 0.

use ndarray::Array2;
use pulp::WithSimd;
use std::sync::OnceLock;

/// Numbers that are summed side by side.
pub const LANES: usize = 8;

/// The length of a row that holds `n` numbers.
pub fn padded(n: usize) -> usize {
    n.next_multiple_of(LANES)
}

/// A matrix in single precision by rows, each padded.
pub fn rows(all: &Array2<f64>) -> Vec<f32> {
    let stride = padded(all.ncols());
    let mut out = Vec::with_capacity(all.nrows() * stride);
    for (i, row) in all.rows().into_iter().enumerate() {
        out.extend(row.iter().map(|v| *v as f32));
        out.resize((i + 1) * stride, 0.0);
    }
    out
}

/// Runs `f`, into which all is inlined, with the widest vectors that serve [`LANES`] numbers side
/// by side.
#[inline]
pub fn dispatch8<R>(f: impl FnOnce() -> R) -> R {
    of_eight().dispatch(f)
}

/// Runs a job on the widest vectors there are.
pub fn dispatch_widest<J: WithSimd>(job: J) -> J::Output {
    static ARCH: OnceLock<pulp::Arch> = OnceLock::new();
    ARCH.get_or_init(pulp::Arch::new).dispatch(job)
}

/// e^x by 12 terms of its series beside the nearest power of two, so that loops of it run side by
/// side: within 1e-14 of it from −700 to 700; beyond, that of these.
#[inline(always)]
fn exp(x: f64) -> f64 {
    // Added to a number it leaves the nearest whole one in the lowest bits.
    const WHOLE: f64 = 6_755_399_441_055_744.0;
    // log 2 in two parts: the first has so few bits that its multiples are exact.
    const LOG_2: (f64, f64) = (6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10);
    let x = x.clamp(-700.0, 700.0);
    let shifted = x * std::f64::consts::LOG2_E + WHOLE;
    let power = shifted - WHOLE;
    let rest = (x - power * LOG_2.0) - power * LOG_2.1;
    let mut sum = 1.0;
    for term in (1..12).rev() {
        sum = 1.0 + sum * rest * (1.0 / f64::from(term));
    }
    // The power goes to the exponent's bits.
    f64::from_bits(sum.to_bits().wrapping_add(shifted.to_bits() << 52))
}

/// Adds height e^(−rate x) of each to `out`.
pub fn add_decays(heights: &[f64], rates: &[f64], x: &[f64], out: &mut [f64]) {
    // Each by itself: the same on the widest vectors.
    dispatch_widest(
        #[inline(always)]
        || {
            let all = out.iter_mut().zip(heights).zip(rates.iter().zip(x));
            all.for_each(|((out, height), (rate, x))| *out += height * exp(-rate * x));
        },
    );
}

/// Not AVX-512: eight lanes are half of its vectors, and code that is made for it runs a tenth
/// slower.
fn of_eight() -> pulp::Arch {
    static ARCH: OnceLock<pulp::Arch> = OnceLock::new();
    *ARCH.get_or_init(|| match pulp::Arch::new() {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        pulp::Arch::V4(_) => pulp::x86::V3::try_new().map_or_else(pulp::Arch::new, pulp::Arch::V3),
        arch => arch,
    })
}

#[inline(always)]
fn sum(lanes: [f32; LANES]) -> f32 {
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}

#[inline(always)]
fn dot_here(a: &[f32], b: &[f32]) -> f32 {
    let (a, _) = a.as_chunks::<LANES>();
    let (b, _) = b.as_chunks::<LANES>();
    let mut sums = [0.0f32; LANES];
    for (a, b) in a.iter().zip(b) {
        for l in 0..LANES {
            sums[l] += a[l] * b[l];
        }
    }
    sum(sums)
}

/// Σ aᵢ bᵢ.
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    dispatch8(
        #[inline(always)]
        || dot_here(a, b),
    )
}

#[inline(always)]
fn weighted_here(s: &[f32], a: &[f32], b: &[f32]) -> f32 {
    let (s, _) = s.as_chunks::<LANES>();
    let (a, _) = a.as_chunks::<LANES>();
    let (b, _) = b.as_chunks::<LANES>();
    let mut sums = [0.0f32; LANES];
    for ((s, a), b) in s.iter().zip(a).zip(b) {
        for l in 0..LANES {
            sums[l] += s[l] * a[l] * b[l];
        }
    }
    sum(sums)
}

/// Σ sᵢ aᵢ bᵢ for each row s of `scales`, into `out`.
pub fn weighted_rows(scales: &[f32], a: &[f32], b: &[f32], out: &mut [f32]) {
    dispatch8(
        #[inline(always)]
        || {
            for (s, out) in scales.chunks_exact(a.len()).zip(out) {
                *out = weighted_here(s, a, b);
            }
        },
    )
}

/// Σ s z z, Σ s v z and Σ s v v for each row s of `scales`, into `out`; the last two only of the
/// rows that `both` says.
pub fn weighted_forms(
    scales: &[f32],
    z: &[f32],
    v: &[f32],
    both: impl Fn(usize) -> bool,
    out: &mut [[f32; 3]],
) {
    dispatch8(
        #[inline(always)]
        || {
            let of_rows = scales.chunks_exact(z.len().max(1)).zip(out);
            for (row, (s, out)) in of_rows.enumerate() {
                let (z, _) = z.as_chunks::<LANES>();
                let (s, _) = s.as_chunks::<LANES>();
                let mut sums = [[0.0f32; LANES]; 3];
                if both(row) {
                    let (v, _) = v.as_chunks::<LANES>();
                    for ((s, z), v) in s.iter().zip(z).zip(v) {
                        for l in 0..LANES {
                            let (sz, sv) = (s[l] * z[l], s[l] * v[l]);
                            sums[0][l] += sz * z[l];
                            sums[1][l] += sv * z[l];
                            sums[2][l] += sv * v[l];
                        }
                    }
                } else {
                    for (s, z) in s.iter().zip(z) {
                        for l in 0..LANES {
                            sums[0][l] += s[l] * z[l] * z[l];
                        }
                    }
                }
                *out = sums.map(sum);
            }
        },
    )
}

/// The product of each row of a matrix with `x`, into `out`; rows are `stride` apart and read as
/// far as `x` goes.
pub fn row_dots(rows: &[f32], stride: usize, x: &[f32], out: &mut [f32]) {
    dispatch8(
        #[inline(always)]
        || {
            for (row, out) in rows.chunks_exact(stride.max(1)).zip(out) {
                *out = dot_here(&row[..x.len()], x);
            }
        },
    )
}

/// Σ wₖ aₖ bₖ of rows with each other: the lower triangle, (n, n) by rows. Rows are `stride` apart
/// and read as far as the weights (padded) go.
pub fn weighted_products(rows: &[f32], stride: usize, weights: &[f32], out: &mut [f32]) {
    /// Rows that share what is read of another.
    const AT_ONCE: usize = 4;
    let (n, w) = (rows.len() / stride.max(1), weights.len());
    let mut scaled = vec![0.0; AT_ONCE * w];
    dispatch8(
        #[inline(always)]
        || {
            for first in (0..n).step_by(AT_ONCE) {
                let some = AT_ONCE.min(n - first);
                for (k, scaled) in scaled.chunks_exact_mut(w.max(1)).enumerate() {
                    let row = &rows[(first + k.min(some - 1)) * stride..][..w];
                    let both = scaled.iter_mut().zip(row.iter().zip(weights));
                    both.for_each(|(s, (r, w))| *s = r * w);
                }
                let scaled: [&[[f32; LANES]]; AT_ONCE] =
                    std::array::from_fn(|k| scaled[k * w..(k + 1) * w].as_chunks().0);
                for j in 0..first + some {
                    let (row, _) = rows[j * stride..][..w].as_chunks::<LANES>();
                    let mut sums = [[0.0f32; LANES]; AT_ONCE];
                    for (i, row) in row.iter().enumerate() {
                        for k in 0..AT_ONCE {
                            for l in 0..LANES {
                                sums[k][l] += scaled[k][i][l] * row[l];
                            }
                        }
                    }
                    for k in j.saturating_sub(first)..some {
                        out[(first + k) * n + j] = sum(sums[k]);
                    }
                }
            }
        },
    );
}

/// L⁻¹ of `rows`, in place; L is a lower triangle, (n, n) by rows.
pub fn forward(factor: &[f64], rows: &mut [f64], stride: usize) {
    let n = rows.len() / stride.max(1);
    dispatch8(
        #[inline(always)]
        || {
            for i in 0..n {
                let (before, row) = rows.split_at_mut(i * stride);
                let row = &mut row[..stride];
                for (j, other) in before.chunks_exact(stride).enumerate() {
                    let by = factor[i * n + j];
                    row.iter_mut().zip(other).for_each(|(v, o)| *v -= by * o);
                }
                let by = 1.0 / factor[i * n + i];
                row.iter_mut().for_each(|v| *v *= by);
            }
        },
    )
}

/// Lanes that a pass over the rows keeps in registers.
const TILE: usize = 4;

/// `out` = Σᵢ wᵢ rowᵢ; rows are `stride` apart and read as far as `out` goes.
pub fn combine(rows: &[f32], stride: usize, weights: &[f32], out: &mut [f32]) {
    combine_each(rows.chunks_exact(stride).zip(weights), out);
}

fn combine_each<'a>(rows: impl Iterator<Item = (&'a [f32], &'a f32)> + Clone, out: &mut [f32]) {
    #[inline(always)]
    fn tile<'a, const T: usize>(
        rows: impl Iterator<Item = (&'a [f32], &'a f32)>,
        at: usize,
        out: &mut [f32],
    ) {
        let mut sums = [[0.0f32; LANES]; T];
        for (row, w) in rows {
            let (lanes, _) = row[at..at + T * LANES].as_chunks::<LANES>();
            for t in 0..T {
                for l in 0..LANES {
                    sums[t][l] += w * lanes[t][l];
                }
            }
        }
        out[at..at + T * LANES].copy_from_slice(sums.as_flattened());
    }
    let n = out.len();
    dispatch8(
        #[inline(always)]
        || {
            let mut at = 0;
            while at + TILE * LANES <= n {
                tile::<TILE>(rows.clone(), at, out);
                at += TILE * LANES;
            }
            while at < n {
                tile::<1>(rows.clone(), at, out);
                at += LANES;
            }
        },
    )
}

/// Σ w (y − row)² of each row.
pub fn distances(rows: &[f32], y: &[f32], w: &[f32], out: &mut Vec<f32>) {
    out.clear();
    out.reserve(rows.len() / y.len().max(1));
    dispatch8(
        #[inline(always)]
        || {
            let (y, _) = y.as_chunks::<LANES>();
            let (w, _) = w.as_chunks::<LANES>();
            for row in rows.chunks_exact((LANES * y.len()).max(1)) {
                let (row, _) = row.as_chunks::<LANES>();
                let mut sums = [0.0f32; LANES];
                for ((r, y), w) in row.iter().zip(y).zip(w) {
                    for l in 0..LANES {
                        let off = y[l] - r[l];
                        sums[l] += w[l] * off * off;
                    }
                }
                out.push(sum(sums));
            }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(n: usize, salt: u32) -> Vec<f32> {
        let of = |i: usize| {
            let bits = (i as u32 + 1).wrapping_mul(2_654_435_761) ^ salt.wrapping_mul(40_503);
            (bits >> 8) as f32 / 8_388_608.0 - 1.0
        };
        (0..n).map(of).collect()
    }

    #[test]
    fn an_exponential_is_that_of_the_library() {
        for i in -70_000..=70_000 {
            let x = f64::from(i) * 0.01 + 1e-3;
            let want = x.clamp(-700.0, 700.0).exp();
            assert!((exp(x) - want).abs() <= 1e-14 * want, "{x}");
        }
        assert_eq!([exp(0.0), exp(-1e300)], [1.0, exp(-700.0)]);
        assert!(exp(f64::NAN).is_nan());
        let mut sum = [1.0; 5];
        add_decays(&[2.0; 5], &[0.5; 5], &[0.0, 1.0, 2.0, 3.0, 1e9], &mut sum);
        for (x, sum) in [0.0f64, 1.0, 2.0, 3.0].iter().zip(sum) {
            assert!((sum - 1.0 - 2.0 * (-0.5 * x).exp()).abs() <= 1e-14);
        }
        assert_eq!(sum[4], 1.0);
    }

    #[test]
    fn a_triangle_is_taken_off_again() {
        let rows: Vec<f64> = numbers(3 * 16, 5).into_iter().map(f64::from).collect();
        let factor = [2.0, 0.0, 0.0, 0.5, 1.0, 0.0, -1.0, 3.0, 4.0];
        let mut solved = rows.clone();
        forward(&factor, &mut solved, 16);
        for k in 0..16 {
            let back = -solved[k] + 3.0 * solved[16 + k] + 4.0 * solved[32 + k];
            assert!((back - rows[32 + k]).abs() <= 1e-12);
        }
    }

    #[test]
    fn products_are_those_of_plain_loops() {
        for n in [8, 40, 72, 104] {
            let rows = numbers(5 * n, 1);
            let (x, y, w) = (numbers(n, 2), numbers(n, 3), numbers(n, 4));
            let near = |a: f32, b: f64| (f64::from(a) - b).abs() <= 1e-5 * n as f64;
            let wide = |v: &[f32], i: usize| f64::from(v[i]);
            let plain: f64 = (0..n).map(|i| wide(&x, i) * wide(&y, i)).sum();
            assert!(near(dot(&x, &y), plain));
            let plain: f64 = (0..n)
                .map(|i| wide(&w, i) * wide(&x, i) * wide(&y, i))
                .sum();
            let mut all = vec![0.0; 5];
            weighted_rows(&w, &x, &y, &mut all);
            assert!(near(all[0], plain));
            weighted_rows(&rows, &x, &y, &mut all);
            let plain: f64 = (0..n)
                .map(|i| wide(&rows, 3 * n + i) * wide(&x, i) * wide(&y, i))
                .sum();
            assert!(near(all[3], plain));
            row_dots(&rows, n, &x, &mut all);
            assert_eq!(all[2], dot(&rows[2 * n..3 * n], &x));
            let mut out = vec![0.0; n];
            combine(&rows, n, &w[..5], &mut out);
            let mut short = vec![0.0; 8];
            combine(&rows, n, &w[..5], &mut short);
            assert_eq!(short, out[..8]);
            for k in 0..n {
                let plain: f64 = (0..5).map(|i| wide(&w, i) * wide(&rows, i * n + k)).sum();
                assert!(near(out[k], plain));
            }
            let mut all = vec![0.0; 25];
            weighted_products(&rows, n, &w[..n - 8], &mut all);
            for (i, j) in [(0, 0), (3, 1), (4, 3), (4, 4)] {
                let of = |k| wide(&w, k) * wide(&rows, i * n + k) * wide(&rows, j * n + k);
                assert!(near(all[5 * i + j], (0..n - 8).map(of).sum()));
            }
            assert_eq!(all[3 * 5 + 4], 0.0);
            let mut far = Vec::new();
            distances(&rows, &x, &w, &mut far);
            let plain: f64 = (0..n)
                .map(|i| wide(&w, i) * (wide(&x, i) - wide(&rows, 4 * n + i)).powi(2))
                .sum();
            assert!(far.len() == 5 && near(far[4], plain));
        }
    }
}
