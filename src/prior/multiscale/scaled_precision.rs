//! A block seen through noise, at some scales of its covariance: evidence and what a residual is solved to.

use super::batched_cholesky::{BatchedCholesky, Four};
use super::eigen_covariance::EigenCovariance;
use super::part_mixture::ActiveSubMixture;
use crate::numeric::simd::{self, combine, combine_of, row_dots, row_dots_of, weighted_rows};
use crate::numeric::small_linalg::{dot, log_product};
use std::borrow::Cow;
use std::sync::Arc;

/// A lens at some scales of the covariance.
#[derive(Debug, Clone)]
pub struct ScaledPrecisions {
    /// a of each.
    pub scales: Arc<[f64]>,
    /// s of each, by rows: (scales, directions), padded.
    precisions: Arc<[f32]>,
    stride: usize,
    log_normalizers: Vec<f64>,
    /// Nothing where no coordinate is.
    exceptions: Option<Changed>,
}

/// What coordinates that are changed make of a block.
#[derive(Debug, Clone)]
struct Changed {
    /// How many coordinates.
    n: usize,
    rows: Rows,
}

#[derive(Debug, Clone)]
enum Rows {
    /// For few residuals: they are U's own.
    Plain(Plain),
    /// For many: L⁻¹ U_c diag(s) of each scale: (scales × changed, directions), padded.
    Solved(Vec<f32>),
}

/// U_c, and L of all scales, L Lᵀ = G, four at a time.
#[derive(Debug, Clone)]
struct Plain {
    basis: Arc<EigenCovariance>,
    /// c, and the noise there.
    exceptions: Arc<[(usize, f64)]>,
    factors: Vec<BatchedCholesky>,
}

/// A block seen through noise that is everywhere the same, at some scales: what noise that is not starts from.
#[derive(Debug, Clone)]
pub struct IsotropicPrecisions {
    /// At all directions.
    pub scales: ScaledPrecisions,
    /// P = U diag(s) Uᵀ, (d, d), lower triangle by rows, of four scales at a time side by side.
    pub precisions: Vec<Vec<[f32; 4]>>,
}

/// One scale of a lens, with a weight.
pub type WeightedScale<'a> = (&'a ScaledPrecisions, usize, f64);

/// Room to work in, kept from one residual to the next.
#[derive(Debug, Default)]
pub struct Scratch {
    single: Vec<f32>,
    dots: Vec<f32>,
    fours: Vec<Four>,
    white: [Vec<f64>; 2],
}

/// Leaves are of so many scales at most.
pub const MAX_EXEMPLAR_SCALES: usize = 16;

impl ScaledPrecisions {
    /// Of what `of` tells of each scale: s by directions, added to what it is given, and the log evidence of a residual of
    /// nothing.
    pub fn new(
        scales: &[f64],
        stride: usize,
        of: impl Fn(f64, &mut Vec<f32>) -> f64,
    ) -> ScaledPrecisions {
        let mut precisions = Vec::with_capacity(scales.len() * stride);
        let mut log_normalizers = Vec::with_capacity(scales.len());
        for (at, scale) in scales.iter().enumerate() {
            log_normalizers.push(of(*scale, &mut precisions));
            precisions.resize((at + 1) * stride, 0.0);
        }
        ScaledPrecisions {
            scales: scales.into(),
            precisions: precisions.into(),
            stride,
            log_normalizers,
            exceptions: None,
        }
    }

    /// The same where coordinates have more noise than `unit`, of which all have it; `constant` is added to the log
    /// evidence. `many` where more residuals than there are changed coordinates are to come.
    pub fn exceptions(
        even: &IsotropicPrecisions,
        basis: &Arc<EigenCovariance>,
        exceptions: &Arc<[(usize, f64)]>,
        base_variance: f64,
        constant: f64,
        many: bool,
    ) -> ScaledPrecisions {
        let (mut out, n) = (even.scales.clone(), exceptions.len());
        if n == 0 {
            return out;
        }
        let finite = exceptions.iter().filter(|(_, noise)| noise.is_finite());
        let constant = constant - 0.5 * log_product(finite.map(|(_, noise)| noise - base_variance));
        let mut all = Vec::with_capacity(out.scales.len().div_ceil(4));
        let fours = out.log_normalizers.chunks_mut(4).zip(&even.precisions);
        for (log_normalizers, precisions) in fours {
            let factors = factors(precisions, basis.len(), exceptions, base_variance);
            for (s, normaliser) in log_normalizers.iter_mut().enumerate() {
                *normaliser += constant - log_product(factors.pivots(s));
            }
            all.push(factors);
        }
        let mut rows = Rows::Plain(Plain {
            basis: basis.clone(),
            exceptions: exceptions.clone(),
            factors: all,
        });
        if many {
            let mut solved = Vec::with_capacity(out.scales.len() * n * out.stride);
            for at in 0..out.scales.len() {
                solved.extend_from_slice(&rows.solved(n, at, out.precisions(at)));
            }
            rows = Rows::Solved(solved);
        }
        out.exceptions = Some(Changed { n, rows });
        out
    }

    /// s of one scale.
    pub fn precisions(&self, at: usize) -> &[f32] {
        &self.precisions[at * self.stride..(at + 1) * self.stride]
    }

    /// L⁻¹ U_c diag(s) of one scale by rows, where coordinates are changed.
    pub fn correction_at(&self, at: usize) -> Option<Cow<'_, [f32]>> {
        let exceptions = self.exceptions.as_ref()?;
        Some(
            exceptions
                .rows
                .solved(exceptions.n, at, self.precisions(at)),
        )
    }

    /// The log evidence of a residual at each scale, given its z; into `out`.
    pub fn log_evidences(&self, z: &[f32], scratch: &mut Scratch, out: &mut Vec<f64>) {
        let mut plain = [0.0; 16];
        out.clear();
        for (at, precisions) in self.precisions.chunks(16 * self.stride.max(1)).enumerate() {
            weighted_rows(precisions, z, z, &mut plain);
            let left = self.scales.len() - 16 * at;
            out.extend(plain[..left.min(16)].iter().map(|v| f64::from(*v)));
        }
        match &self.exceptions {
            None => {}
            Some(Changed {
                rows: Rows::Plain(plain),
                ..
            }) => {
                let fours = plain.factors.iter().enumerate();
                for ((of, factors), forms) in fours.zip(out.chunks_mut(4)) {
                    self.less_known(plain, (4 * of, factors), z, scratch, forms);
                }
            }
            Some(_) => {
                let white = &mut scratch.white[0];
                for (at, form) in out.iter_mut().enumerate() {
                    self.whiten(at, z, (&mut scratch.single, &mut scratch.dots), white);
                    *form -= dot(white, white);
                }
            }
        }
        for (out, normaliser) in out.iter_mut().zip(&self.log_normalizers) {
            *out = normaliser - 0.5 * *out;
        }
    }

    /// Takes qᵀ G⁻¹ q off the forms of up to four scales, the first of which is `first`.
    fn less_known(
        &self,
        plain: &Plain,
        (first, factors): (usize, &BatchedCholesky),
        z: &[f32],
        scratch: &mut Scratch,
        forms: &mut [f64],
    ) {
        let n = plain.exceptions.len();
        scratch.fours.clear();
        scratch.fours.resize(n, [0.0; 4]);
        scratch.dots.resize(n, 0.0);
        for s in 0..forms.len() {
            products(self.precisions(first + s), z, &mut scratch.single);
            plain.dots(&scratch.single, &mut scratch.dots);
            let both = scratch.fours.iter_mut().zip(&scratch.dots);
            both.for_each(|(q, dot)| q[s] = f64::from(*dot));
        }
        factors.forward(&mut scratch.fours);
        let mut known = [0.0; 4];
        for q in &scratch.fours {
            (0..4).for_each(|s| known[s] += q[s] * q[s]);
        }
        forms.iter_mut().zip(known).for_each(|(f, k)| *f -= k);
    }

    /// L⁻¹ q of a residual; nothing where no coordinate is changed.
    pub fn whitened(&self, at: usize, z: &[f32]) -> Vec<f64> {
        let (mut scratch, mut out) = (Scratch::default(), Vec::new());
        self.whiten(at, z, (&mut scratch.single, &mut scratch.dots), &mut out);
        out
    }

    /// The same into `out`.
    fn whiten(
        &self,
        at: usize,
        z: &[f32],
        (single, dots): (&mut Vec<f32>, &mut Vec<f32>),
        out: &mut Vec<f64>,
    ) {
        out.clear();
        let Some(Changed { n, rows }) = &self.exceptions else {
            return;
        };
        dots.resize(*n, 0.0);
        match rows {
            Rows::Solved(rows) => {
                row_dots(solved_at(rows, at, n * self.stride), self.stride, z, dots)
            }
            Rows::Plain(plain) => {
                products(self.precisions(at), z, single);
                plain.dots(single, dots);
            }
        }
        out.extend(dots.iter().map(|v| f64::from(*v)));
        if let Rows::Plain(plain) = rows {
            plain.factors[at / 4].forward_one(at % 4, out);
        }
    }

    /// The log evidence of a residual at each of the leaves' levels, whose scales these are, given its z and that of the
    /// leaf's step; into `out`.
    pub fn exemplar_log_evidences(
        &self,
        (z, step): (&[f32], &[f32]),
        levels: &[ActiveSubMixture],
        scratch: &mut Scratch,
        out: &mut Vec<f64>,
    ) {
        let mut forms = [[0.0f32; 3]; MAX_EXEMPLAR_SCALES];
        let forms = &mut forms[..self.scales.len()];
        let reaches = |at: usize| levels.iter().any(|l| l.at == at && l.step_scale > 0.0);
        simd::weighted_forms(&self.precisions, z, step, reaches, forms);
        let Scratch {
            single,
            dots,
            white,
            ..
        } = scratch;
        let [p, q] = white;
        out.clear();
        out.resize(levels.len(), 0.0);
        for (at, form) in forms.iter().enumerate() {
            let mut form = form.map(f64::from);
            if self.exceptions.is_some() {
                self.whiten(at, z, (single, dots), p);
                form[0] -= dot(p, p);
                if reaches(at) {
                    self.whiten(at, step, (single, dots), q);
                    form[1] -= dot(p, q);
                    form[2] -= dot(q, q);
                }
            }
            let plain = self.log_normalizers[at] - 0.5 * form[0];
            for (out, level) in out.iter_mut().zip(levels).filter(|(_, l)| l.at == at) {
                let vv = level.step_scale * form[2];
                let gain = 0.5 * level.step_scale * form[1] * form[1] / (1.0 + vv);
                *out = if level.step_scale > 0.0 {
                    plain + gain - 0.5 * vv.ln_1p()
                } else {
                    plain
                };
            }
        }
    }

    /// Adds `weight` a w of a residual at a scale to `out`, given its z: w is the residual with the inverse of a C_oo + R
    /// applied to it.
    pub fn add_precision_product(
        &self,
        at: usize,
        z: &[f32],
        weight: f64,
        scratch: &mut Scratch,
        out: &mut [f32],
    ) {
        let weight = (weight * self.scales[at]) as f32;
        let Some(Changed { rows, .. }) = &self.exceptions else {
            for ((o, s), z) in out.iter_mut().zip(self.precisions(at)).zip(z) {
                *o += weight * s * z;
            }
            return;
        };
        let Scratch {
            single,
            dots,
            white,
            ..
        } = scratch;
        let q = &mut white[0];
        self.whiten(at, z, (single, dots), q);
        if let Rows::Plain(plain) = rows {
            plain.factors[at / 4].backward_one(at % 4, q);
        }
        dots.clear();
        dots.extend(q.iter().map(|v| *v as f32));
        single.clear();
        single.resize(self.stride, 0.0);
        let both = self.precisions(at).iter().zip(z);
        match rows {
            Rows::Plain(plain) => {
                let (basis, which) = (&plain.basis, plain.which());
                combine_of(basis.vectors(), self.stride, which, dots, single);
                for ((o, c), (s, z)) in out.iter_mut().zip(single).zip(both) {
                    *o += weight * s * (z - *c);
                }
            }
            Rows::Solved(rows) => {
                combine(
                    solved_at(rows, at, q.len() * self.stride),
                    self.stride,
                    dots,
                    single,
                );
                for ((o, c), (s, z)) in out.iter_mut().zip(single).zip(both) {
                    *o += weight * (s * z - *c);
                }
            }
        }
    }
}

impl Rows {
    /// L⁻¹ U_c diag(s) of one scale, whose s are given; `n` coordinates are changed.
    fn solved(&self, n: usize, at: usize, precisions: &[f32]) -> Cow<'_, [f32]> {
        let plain = match self {
            Rows::Plain(plain) => plain,
            Rows::Solved(rows) => return solved_at(rows, at, n * precisions.len()).into(),
        };
        let mut wide = Vec::with_capacity(n * precisions.len());
        for i in plain.which() {
            let row = plain.basis.row(i).iter().zip(precisions);
            wide.extend(row.map(|(u, s)| f64::from(u * s)));
        }
        simd::forward(
            &plain.factors[at / 4].one(at % 4),
            &mut wide,
            precisions.len(),
        );
        wide.iter().map(|v| *v as f32).collect()
    }
}

impl Plain {
    fn which(&self) -> impl Iterator<Item = usize> + Clone {
        self.exceptions.iter().map(|(i, _)| *i)
    }

    /// U_c x.
    fn dots(&self, x: &[f32], out: &mut [f32]) {
        let basis = &self.basis;
        row_dots_of(basis.vectors(), basis.stride(), self.which(), x, out);
    }
}

/// Those of one scale, of which there are `size` numbers.
fn solved_at(rows: &[f32], at: usize, size: usize) -> &[f32] {
    &rows[at * size..(at + 1) * size]
}

/// L Lᵀ = G of up to four scales, by their P (d, d).
fn factors(
    precisions: &[[f32; 4]],
    d: usize,
    exceptions: &[(usize, f64)],
    base_variance: f64,
) -> BatchedCholesky {
    let n = exceptions.len();
    let mut lower = vec![[0.0; 4]; n * n];
    for (a, (i, noise)) in exceptions.iter().enumerate() {
        let row = &precisions[i * d..(i + 1) * d];
        let own = &mut lower[a * n..=a * n + a];
        for (l, (j, _)) in own.iter_mut().zip(exceptions) {
            *l = row[*j].map(f64::from);
        }
        // 1 / ∞ is 0: a missing coordinate.
        own[a]
            .iter_mut()
            .for_each(|l| *l += 1.0 / (noise - base_variance));
    }
    BatchedCholesky::of(lower, n)
}

/// s z.
fn products(precisions: &[f32], z: &[f32], out: &mut Vec<f32>) {
    out.clear();
    out.extend(precisions.iter().zip(z).map(|(s, z)| s * z));
}

/// The weight of each that is named, once.
pub fn merged<'a>(weights: &[WeightedScale<'a>]) -> Vec<WeightedScale<'a>> {
    let mut out: Vec<WeightedScale<'a>> = Vec::new();
    for &(scales, at, weight) in weights {
        let same = |o: &&mut WeightedScale<'a>| std::ptr::eq(o.0, scales) && o.1 == at;
        match out.iter_mut().find(same) {
            Some(o) => o.2 += weight,
            None => out.push((scales, at, weight)),
        }
    }
    out
}
