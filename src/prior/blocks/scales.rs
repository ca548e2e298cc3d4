//! A block seen through noise, at some scales of its covariance: evidence and what a residual is solved to.

use super::basis::Basis;
use super::fours::{Factors, Four};
use super::part::Active;
use crate::numeric::simd::{self, combine, combine_of, row_dots, row_dots_of, weighted_rows};
use crate::numeric::small_linalg::{dot, log_product};
use std::borrow::Cow;
use std::sync::Arc;

/// A lens at some scales of the covariance.
#[derive(Debug, Clone)]
pub struct Scales {
    /// a of each.
    pub scales: Arc<[f64]>,
    /// s of each, by rows: (scales, directions), padded.
    shares: Arc<[f32]>,
    stride: usize,
    normalisers: Vec<f64>,
    /// Nothing where no coordinate is.
    changed: Option<Changed>,
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
    basis: Arc<Basis>,
    /// c, and the noise there.
    changed: Arc<[(usize, f64)]>,
    factors: Vec<Factors>,
}

/// A block seen through noise that is everywhere the same, at some scales: what noise that is not starts from.
#[derive(Debug, Clone)]
pub struct Even {
    /// At all directions.
    pub scales: Scales,
    /// P = U diag(s) Uᵀ, (d, d), lower triangle by rows, of four scales at a time side by side.
    pub precisions: Vec<Vec<[f32; 4]>>,
}

/// One scale of a lens, with a weight.
pub type Weighed<'a> = (&'a Scales, usize, f64);

/// Room to work in, kept from one residual to the next.
#[derive(Debug, Default)]
pub struct Room {
    short: Vec<f32>,
    dots: Vec<f32>,
    fours: Vec<Four>,
    white: [Vec<f64>; 2],
}

/// Leaves are of so many scales at most.
pub const MOST_LEAVES: usize = 16;

impl Scales {
    /// Of what `of` tells of each scale: s by directions, added to what it is given, and the log evidence of a residual of
    /// nothing.
    pub fn new(scales: &[f64], stride: usize, of: impl Fn(f64, &mut Vec<f32>) -> f64) -> Scales {
        let mut shares = Vec::with_capacity(scales.len() * stride);
        let mut normalisers = Vec::with_capacity(scales.len());
        for (at, scale) in scales.iter().enumerate() {
            normalisers.push(of(*scale, &mut shares));
            shares.resize((at + 1) * stride, 0.0);
        }
        Scales {
            scales: scales.into(),
            shares: shares.into(),
            stride,
            normalisers,
            changed: None,
        }
    }

    /// The same where coordinates have more noise than `unit`, of which all have it; `constant` is added to the log
    /// evidence. `many` where more residuals than there are changed coordinates are to come.
    pub fn changed(
        even: &Even,
        basis: &Arc<Basis>,
        changed: &Arc<[(usize, f64)]>,
        unit: f64,
        constant: f64,
        many: bool,
    ) -> Scales {
        let (mut out, n) = (even.scales.clone(), changed.len());
        if n == 0 {
            return out;
        }
        let finite = changed.iter().filter(|(_, noise)| noise.is_finite());
        let constant = constant - 0.5 * log_product(finite.map(|(_, noise)| noise - unit));
        let mut all = Vec::with_capacity(out.scales.len().div_ceil(4));
        let fours = out.normalisers.chunks_mut(4).zip(&even.precisions);
        for (normalisers, precisions) in fours {
            let factors = factors(precisions, basis.len(), changed, unit);
            for (s, normaliser) in normalisers.iter_mut().enumerate() {
                *normaliser += constant - log_product(factors.pivots(s));
            }
            all.push(factors);
        }
        let mut rows = Rows::Plain(Plain {
            basis: basis.clone(),
            changed: changed.clone(),
            factors: all,
        });
        if many {
            let mut solved = Vec::with_capacity(out.scales.len() * n * out.stride);
            for at in 0..out.scales.len() {
                solved.extend_from_slice(&rows.solved(n, at, out.shares(at)));
            }
            rows = Rows::Solved(solved);
        }
        out.changed = Some(Changed { n, rows });
        out
    }

    /// s of one scale.
    pub fn shares(&self, at: usize) -> &[f32] {
        &self.shares[at * self.stride..(at + 1) * self.stride]
    }

    /// L⁻¹ U_c diag(s) of one scale by rows, where coordinates are changed.
    pub fn fix_at(&self, at: usize) -> Option<Cow<'_, [f32]>> {
        let changed = self.changed.as_ref()?;
        Some(changed.rows.solved(changed.n, at, self.shares(at)))
    }

    /// The log evidence of a residual at each scale, given its z; into `out`.
    pub fn logs(&self, z: &[f32], room: &mut Room, out: &mut Vec<f64>) {
        let mut plain = [0.0; 16];
        out.clear();
        for (at, shares) in self.shares.chunks(16 * self.stride.max(1)).enumerate() {
            weighted_rows(shares, z, z, &mut plain);
            let left = self.scales.len() - 16 * at;
            out.extend(plain[..left.min(16)].iter().map(|v| f64::from(*v)));
        }
        match &self.changed {
            None => {}
            Some(Changed {
                rows: Rows::Plain(plain),
                ..
            }) => {
                let fours = plain.factors.iter().enumerate();
                for ((of, factors), forms) in fours.zip(out.chunks_mut(4)) {
                    self.less_known(plain, (4 * of, factors), z, room, forms);
                }
            }
            Some(_) => {
                let white = &mut room.white[0];
                for (at, form) in out.iter_mut().enumerate() {
                    self.whiten(at, z, (&mut room.short, &mut room.dots), white);
                    *form -= dot(white, white);
                }
            }
        }
        for (out, normaliser) in out.iter_mut().zip(&self.normalisers) {
            *out = normaliser - 0.5 * *out;
        }
    }

    /// Takes qᵀ G⁻¹ q off the forms of up to four scales, the first of which is `first`.
    fn less_known(
        &self,
        plain: &Plain,
        (first, factors): (usize, &Factors),
        z: &[f32],
        room: &mut Room,
        forms: &mut [f64],
    ) {
        let n = plain.changed.len();
        room.fours.clear();
        room.fours.resize(n, [0.0; 4]);
        room.dots.resize(n, 0.0);
        for s in 0..forms.len() {
            products(self.shares(first + s), z, &mut room.short);
            plain.dots(&room.short, &mut room.dots);
            let both = room.fours.iter_mut().zip(&room.dots);
            both.for_each(|(q, dot)| q[s] = f64::from(*dot));
        }
        factors.forward(&mut room.fours);
        let mut known = [0.0; 4];
        for q in &room.fours {
            (0..4).for_each(|s| known[s] += q[s] * q[s]);
        }
        forms.iter_mut().zip(known).for_each(|(f, k)| *f -= k);
    }

    /// L⁻¹ q of a residual; nothing where no coordinate is changed.
    pub fn whitened(&self, at: usize, z: &[f32]) -> Vec<f64> {
        let (mut room, mut out) = (Room::default(), Vec::new());
        self.whiten(at, z, (&mut room.short, &mut room.dots), &mut out);
        out
    }

    /// The same into `out`.
    fn whiten(
        &self,
        at: usize,
        z: &[f32],
        (short, dots): (&mut Vec<f32>, &mut Vec<f32>),
        out: &mut Vec<f64>,
    ) {
        out.clear();
        let Some(Changed { n, rows }) = &self.changed else {
            return;
        };
        dots.resize(*n, 0.0);
        match rows {
            Rows::Solved(rows) => {
                row_dots(solved_at(rows, at, n * self.stride), self.stride, z, dots)
            }
            Rows::Plain(plain) => {
                products(self.shares(at), z, short);
                plain.dots(short, dots);
            }
        }
        out.extend(dots.iter().map(|v| f64::from(*v)));
        if let Rows::Plain(plain) = rows {
            plain.factors[at / 4].forward_one(at % 4, out);
        }
    }

    /// The log evidence of a residual at each of the leaves' levels, whose scales these are, given its z and that of the
    /// leaf's step; into `out`.
    pub fn logs_of_leaf(
        &self,
        (z, step): (&[f32], &[f32]),
        levels: &[Active],
        room: &mut Room,
        out: &mut Vec<f64>,
    ) {
        let mut forms = [[0.0f32; 3]; MOST_LEAVES];
        let forms = &mut forms[..self.scales.len()];
        let reaches = |at: usize| levels.iter().any(|l| l.at == at && l.along > 0.0);
        simd::weighted_forms(&self.shares, z, step, reaches, forms);
        let Room {
            short, dots, white, ..
        } = room;
        let [p, q] = white;
        out.clear();
        out.resize(levels.len(), 0.0);
        for (at, form) in forms.iter().enumerate() {
            let mut form = form.map(f64::from);
            if self.changed.is_some() {
                self.whiten(at, z, (short, dots), p);
                form[0] -= dot(p, p);
                if reaches(at) {
                    self.whiten(at, step, (short, dots), q);
                    form[1] -= dot(p, q);
                    form[2] -= dot(q, q);
                }
            }
            let plain = self.normalisers[at] - 0.5 * form[0];
            for (out, level) in out.iter_mut().zip(levels).filter(|(_, l)| l.at == at) {
                let vv = level.along * form[2];
                let gain = 0.5 * level.along * form[1] * form[1] / (1.0 + vv);
                *out = if level.along > 0.0 {
                    plain + gain - 0.5 * vv.ln_1p()
                } else {
                    plain
                };
            }
        }
    }

    /// Adds `weight` a w of a residual at a scale to `out`, given its z: w is the residual with the inverse of a C_oo + R
    /// applied to it.
    pub fn add_solved(&self, at: usize, z: &[f32], weight: f64, room: &mut Room, out: &mut [f32]) {
        let weight = (weight * self.scales[at]) as f32;
        let Some(Changed { rows, .. }) = &self.changed else {
            for ((o, s), z) in out.iter_mut().zip(self.shares(at)).zip(z) {
                *o += weight * s * z;
            }
            return;
        };
        let Room {
            short, dots, white, ..
        } = room;
        let q = &mut white[0];
        self.whiten(at, z, (short, dots), q);
        if let Rows::Plain(plain) = rows {
            plain.factors[at / 4].backward_one(at % 4, q);
        }
        dots.clear();
        dots.extend(q.iter().map(|v| *v as f32));
        short.clear();
        short.resize(self.stride, 0.0);
        let both = self.shares(at).iter().zip(z);
        match rows {
            Rows::Plain(plain) => {
                let (basis, which) = (&plain.basis, plain.which());
                combine_of(basis.vectors(), self.stride, which, dots, short);
                for ((o, c), (s, z)) in out.iter_mut().zip(short).zip(both) {
                    *o += weight * s * (z - *c);
                }
            }
            Rows::Solved(rows) => {
                combine(
                    solved_at(rows, at, q.len() * self.stride),
                    self.stride,
                    dots,
                    short,
                );
                for ((o, c), (s, z)) in out.iter_mut().zip(short).zip(both) {
                    *o += weight * (s * z - *c);
                }
            }
        }
    }
}

impl Rows {
    /// L⁻¹ U_c diag(s) of one scale, whose s are given; `n` coordinates are changed.
    fn solved(&self, n: usize, at: usize, shares: &[f32]) -> Cow<'_, [f32]> {
        let plain = match self {
            Rows::Plain(plain) => plain,
            Rows::Solved(rows) => return solved_at(rows, at, n * shares.len()).into(),
        };
        let mut wide = Vec::with_capacity(n * shares.len());
        for i in plain.which() {
            let row = plain.basis.row(i).iter().zip(shares);
            wide.extend(row.map(|(u, s)| f64::from(u * s)));
        }
        simd::forward(&plain.factors[at / 4].one(at % 4), &mut wide, shares.len());
        wide.iter().map(|v| *v as f32).collect()
    }
}

impl Plain {
    fn which(&self) -> impl Iterator<Item = usize> + Clone {
        self.changed.iter().map(|(i, _)| *i)
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
fn factors(precisions: &[[f32; 4]], d: usize, changed: &[(usize, f64)], unit: f64) -> Factors {
    let n = changed.len();
    let mut lower = vec![[0.0; 4]; n * n];
    for (a, (i, noise)) in changed.iter().enumerate() {
        let row = &precisions[i * d..(i + 1) * d];
        let own = &mut lower[a * n..=a * n + a];
        for (l, (j, _)) in own.iter_mut().zip(changed) {
            *l = row[*j].map(f64::from);
        }
        // 1 / ∞ is 0: a missing coordinate.
        own[a].iter_mut().for_each(|l| *l += 1.0 / (noise - unit));
    }
    Factors::of(lower, n)
}

/// s z.
fn products(shares: &[f32], z: &[f32], out: &mut Vec<f32>) {
    out.clear();
    out.extend(shares.iter().zip(z).map(|(s, z)| s * z));
}

/// The weight of each that is named, once.
pub fn merged<'a>(weights: &[Weighed<'a>]) -> Vec<Weighed<'a>> {
    let mut out: Vec<Weighed<'a>> = Vec::new();
    for &(scales, at, weight) in weights {
        let same = |o: &&mut Weighed<'a>| std::ptr::eq(o.0, scales) && o.1 == at;
        match out.iter_mut().find(same) {
            Some(o) => o.2 += weight,
            None => out.push((scales, at, weight)),
        }
    }
    out
}
