//! The best rank-one approximation of a small matrix, by power steps from a good start.

/// Steps end when one lowers the squared error by at most this share of it.
const SMALL: f64 = 1e-6;

/// At most this many steps. Where more are needed the two largest singular values are so close that
/// either direction will do: after s steps the squared error is above the best by at most sigma_1^2
/// / (2 s), and in practice by far less.
const STEPS: usize = 100;

/// Improves `atom` (D, of unit norm) and sets `x` (u) so that E ≈ x atomᵀ, for E (u, D) in rows.
///
/// Minimizes |E - x atomᵀ|_F, whose answer is the largest singular value and its vectors. Started
/// from the atom in use, each power step can only lower the error, so that stopping early is safe;
/// the sign stays that of the start. A step reads E once: x_i = <e_i, atom>, then atom <- sum_i x_i
/// e_i. Gives the number of steps.
pub(super) fn refine(e: &[f32], atom: &mut [f32], x: &mut [f32]) -> usize {
    let d = atom.len();
    let total: f64 = e.chunks_exact(d).map(|row| f64::from(dot(row, row))).sum();
    let mut next = vec![0f32; d];
    let mut energy = -1f64;
    for step in 0..STEPS {
        next.fill(0.0);
        let mut now = 0f64;
        for (row, x) in e.chunks_exact(d).zip(x.iter_mut()) {
            *x = dot(row, atom);
            now += f64::from(*x).powi(2);
            add(&mut next, *x, row);
        }
        let gain = now - energy;
        energy = now;
        if step > 0 && gain <= SMALL * (total - now).max(0.0) {
            return step;
        }
        // E atom = 0: the atom tells nothing of these rows, and any of them makes a better start.
        if norm(&next) <= 1e-6 * total {
            let Some(row) = e
                .chunks_exact(d)
                .max_by(|a, b| dot(a, a).total_cmp(&dot(b, b)))
            else {
                return step;
            };
            next.copy_from_slice(row);
        }
        let norm = norm(&next);
        if !(norm > 0.0 && norm.is_finite()) {
            return step;
        }
        atom.iter_mut()
            .zip(&next)
            .for_each(|(a, v)| *a = (f64::from(*v) / norm) as f32);
    }
    for (row, x) in e.chunks_exact(d).zip(x.iter_mut()) {
        *x = dot(row, atom);
    }
    STEPS
}

/// <a, b> with eight running sums, so that the compiler may use vector registers.
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0f32; 8];
    let ((a8, a1), (b8, b1)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a8.iter().zip(b8) {
        for l in 0..8 {
            sums[l] += a[l] * b[l];
        }
    }
    let rest: f32 = a1.iter().zip(b1).map(|(a, b)| a * b).sum();
    let pairs = [
        sums[0] + sums[4],
        sums[1] + sums[5],
        sums[2] + sums[6],
        sums[3] + sums[7],
    ];
    (pairs[0] + pairs[2]) + (pairs[1] + pairs[3]) + rest
}

fn norm(v: &[f32]) -> f64 {
    v.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt()
}

/// v += c u.
pub(super) fn add(v: &mut [f32], c: f32, u: &[f32]) {
    v.iter_mut().zip(u).for_each(|(v, u)| *v += c * u);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::parallel;
    use rand::Rng;

    /// The largest singular value squared of E (u, d), by one-sided Jacobi rotations in f64.
    fn exact(e: &[f32], d: usize) -> f64 {
        let u = e.len() / d;
        let mut columns: Vec<Vec<f64>> = (0..d)
            .map(|j| (0..u).map(|i| f64::from(e[i * d + j])).collect())
            .collect();
        for _ in 0..40 {
            for p in 0..d {
                for q in p + 1..d {
                    let of =
                        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                    let (a, b) = (of(&columns[p], &columns[p]), of(&columns[q], &columns[q]));
                    let c = of(&columns[p], &columns[q]);
                    let angle = 0.5 * (2.0 * c).atan2(a - b);
                    let (sin, cos) = angle.sin_cos();
                    let (left, right) = columns.split_at_mut(q);
                    for (x, y) in left[p].iter_mut().zip(&mut right[0]) {
                        (*x, *y) = (cos * *x + sin * *y, cos * *y - sin * *x);
                    }
                }
            }
        }
        columns
            .iter()
            .map(|c| c.iter().map(|v| v * v).sum::<f64>())
            .fold(0.0, f64::max)
    }

    fn left(e: &[f32], atom: &[f32], x: &[f32]) -> f64 {
        let rows = e.chunks_exact(atom.len()).zip(x);
        rows.flat_map(|(row, x)| {
            row.iter()
                .zip(atom)
                .map(move |(e, a)| f64::from(e - x * a).powi(2))
        })
        .sum()
    }

    fn unit(g: &mut impl Rng, d: usize) -> Vec<f32> {
        let v: Vec<f64> = (0..d).map(|_| g.random::<f64>() - 0.5).collect();
        let norm = v.iter().map(|v| v * v).sum::<f64>().sqrt();
        v.iter().map(|v| (v / norm) as f32).collect()
    }

    /// The claim of the file's head, on rows with one strong direction (as residuals in learning
    /// have) and on pure noise, where the singular values lie closest and power steps do worst.
    #[test]
    fn the_error_is_that_of_the_singular_value_decomposition() {
        let mut g = parallel::rng(1, 0);
        for (strength, allowed) in [(3.0, 1e-5), (1.0, 1e-4), (0.0, 3e-3)] {
            for u in [1, 2, 5, 40, 200] {
                let d = 24;
                let (strong, mut atom) = (unit(&mut g, d), unit(&mut g, d));
                let mut e = Vec::new();
                for _ in 0..u {
                    let s = strength * (g.random::<f32>() + 0.2);
                    e.extend(
                        strong
                            .iter()
                            .map(|a| s * a + 0.3 * (g.random::<f32>() - 0.5)),
                    );
                }
                let mut x = vec![0.0; u];
                refine(&e, &mut atom, &mut x);
                let total: f64 = e.iter().map(|&v| f64::from(v).powi(2)).sum();
                let best = total - exact(&e, d);
                let now = left(&e, &atom, &x);
                assert!(
                    now <= best * (1.0 + allowed) + 1e-6 * total,
                    "{strength} {u}: {now} {best}"
                );
                let norm: f64 = atom.iter().map(|&a| f64::from(a).powi(2)).sum();
                assert!((norm - 1.0).abs() <= 1e-6);
            }
        }
    }

    #[test]
    fn the_error_never_rises_and_the_sign_stays() {
        let mut g = parallel::rng(2, 0);
        for _ in 0..50 {
            let start = unit(&mut g, 10);
            let e: Vec<f32> = (0..300).map(|_| g.random::<f32>() - 0.4).collect();
            let (mut atom, mut x) = (start.clone(), vec![0.0; 30]);
            let before: Vec<f32> = e.chunks_exact(10).map(|row| dot(row, &start)).collect();
            refine(&e, &mut atom, &mut x);
            assert!(left(&e, &atom, &x) <= left(&e, &start, &before) * (1.0 + 1e-6));
            assert!(dot(&atom, &start) >= 0.0);
        }
    }

    #[test]
    fn rows_that_are_zero_or_orthogonal_to_the_start() {
        let (mut atom, mut x) = ([1.0f32, 0.0], [5.0f32; 2]);
        refine(&[0.0; 4], &mut atom, &mut x);
        assert_eq!((atom, x), ([1.0, 0.0], [0.0; 2]));
        refine(&[0.0, 2.0, 0.0, -1.0], &mut atom, &mut x);
        assert_eq!((atom, x), ([0.0, 1.0], [2.0, -1.0]));
    }
}
