//! Least squares of one pose on a growing set of atoms.
//!
//! With weights w and chosen atoms a_1..a_k, the coefficients x minimize
//!
//! ```text
//! sum_i w_i (y_i - sum_j x_j a_ji)^2 = |√w∘y - [√w∘a_1 ... √w∘a_k] x|^2
//! ```
//!
//! by a QR factorization that grows by one column per atom: q_j (D) orthonormal, R (k, k) upper
//! triangular, z = Qᵀ(√w∘y), R x = z. Double precision, O(k D) per atom. The signal is scaled to
//! unit norm, so that the limits below have no unit; results are scaled back.

use super::incremental_qr::{QrColumn, dot};
use super::{StopReason, Tolerance};
use crate::Result;
use crate::numeric::simd::{self, dispatch_widest, padded};
use ndarray::ArrayView1;

/// A pose counts as reached when at most this share of its squared norm is left: 3e-7 of its
/// length, which is what rounding the atoms to f32 leaves of a pose that they describe exactly.
const REACHED: f64 = 1e-13;

/// The largest squared norm of a pose: squares and sums of squares of such numbers are finite in
/// f32 too.
const LARGEST: f64 = 1e30;

/// One pose and the atoms chosen for it so far.
pub(super) struct ActiveSet {
    /// D.
    d: usize,
    capacity: usize,
    /// √(w / max w), (D); `None` if all weights are equal, or the pose is zero.
    pub root: Option<Vec<f64>>,
    /// The residual of the weighted, unit-norm signal (D), padded.
    residual: Vec<f64>,
    /// |residual|^2, from 1 downwards.
    left: f64,
    /// The residual at which to stop, on the same scale.
    enough: f64,
    /// |√w∘y|^2, which scales results back.
    energy: f64,
    /// max w, by which the weights are divided.
    heaviest: f64,
    q: Vec<f64>, // (capacity, D), rows padded
    r: Vec<f64>, // (capacity, capacity), column j at j * capacity
    z: Vec<f64>,
    /// The atoms chosen, in that order.
    pub support: Vec<u32>,
    /// Why the pose takes no more atoms; `None` while it does.
    pub stop: Option<StopReason>,
}

impl ActiveSet {
    /// An active set of up to `capacity` atoms of `d` coordinates.
    pub(crate) fn new(capacity: usize, d: usize) -> Self {
        ActiveSet {
            d,
            capacity,
            root: None,
            residual: vec![0.0; padded(d)],
            left: 0.0,
            enough: 0.0,
            energy: 0.0,
            heaviest: 1.0,
            q: vec![0.0; capacity * padded(d)],
            r: vec![0.0; capacity * capacity],
            z: vec![0.0; capacity],
            support: Vec::with_capacity(capacity),
            stop: Some(StopReason::Nothing),
        }
    }

    /// Starts on a pose (D) with weights (D). Where a weight is 0 the pose may be NaN.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: an observed number or a weight is not finite, or a weight is
    /// negative.
    pub(crate) fn start<T, W>(
        &mut self,
        pose: ArrayView1<T>,
        weights: Option<ArrayView1<W>>,
        tolerance: Tolerance,
    ) -> Result<()>
    where
        T: Into<f64> + Copy,
        W: Into<f64> + Copy,
    {
        let d = self.d;
        let mut total = d as f64;
        self.heaviest = 1.0;
        match weights {
            Some(weights) => {
                let root = self.root.get_or_insert_with(|| vec![0.0; d]);
                (total, self.heaviest) = roots(weights, root)?;
                for ((r, &y), &w) in self.residual.iter_mut().zip(pose).zip(&*root) {
                    *r = if w > 0.0 { y.into() * w } else { 0.0 };
                }
                if root.iter().all(|w| *w == 1.0) {
                    self.root = None;
                }
            }
            None => {
                self.root = None;
                match pose.as_slice() {
                    // A slice can be converted with SIMD, a strided array cannot.
                    Some(pose) => simd::dispatch8(
                        #[inline(always)]
                        || (self.residual.iter_mut().zip(pose)).for_each(|(r, y)| *r = (*y).into()),
                    ),
                    None => (self.residual.iter_mut().zip(pose)).for_each(|(r, &y)| *r = y.into()),
                }
            }
        }
        self.energy = dot(&self.residual, &self.residual);
        if !self.energy.is_finite()
            && let Some(i) = self.residual.iter().position(|r| !r.is_finite())
        {
            return Err(
                format!("coordinate {i} is missing or not finite; give it the weight 0").into(),
            );
        }
        if self.energy > LARGEST {
            return Err("its numbers are too large: a pose may be at most 1e15 long".into());
        }
        if self.energy == 0.0 {
            self.root = None;
        }
        self.support.clear();
        self.left = 0.0;
        self.stop = Some(StopReason::Nothing);
        if self.energy > 0.0 {
            let scale = 1.0 / self.energy.sqrt();
            simd::dispatch8(
                #[inline(always)]
                || self.residual.iter_mut().for_each(|r| *r *= scale),
            );
            self.left = 1.0;
            self.enough = tolerance.squared(total) / (self.energy * self.heaviest);
            self.stop = (self.left <= self.enough).then_some(StopReason::Tolerance);
        }
        Ok(())
    }

    /// Adds an atom; `false`, with nothing changed, if it depends on those chosen where the pose is
    /// observed.
    pub(crate) fn push(&mut self, index: u32, atom: &[f32]) -> bool {
        let (stride, k, cap) = (self.residual.len(), self.support.len(), self.capacity);
        if k == cap {
            return false;
        }
        let (done, rest) = self.q.split_at_mut(k * stride);
        let v = &mut rest[..stride];
        let column = &mut self.r[k * cap..(k + 1) * cap];
        column.fill(0.0);
        let Some((z, left)) = dispatch_widest(QrColumn {
            done,
            atom,
            root: self.root.as_deref(),
            v,
            column: &mut column[..=k],
            residual: &mut self.residual,
        }) else {
            return false;
        };
        self.z[k] = z;
        self.left = left;
        self.support.push(index);
        if self.left <= self.enough.max(REACHED) {
            self.stop = Some(StopReason::Tolerance);
        }
        true
    }

    /// The residual of the weighted, unit-norm signal (D).
    pub(crate) fn residual(&self) -> &[f64] {
        &self.residual[..self.d]
    }

    /// |residual|^2, from 1 downwards.
    pub(crate) fn left(&self) -> f64 {
        self.left
    }

    /// The direction q_i (D) of the i-th atom taken.
    pub(crate) fn direction(&self, i: usize) -> &[f64] {
        &self.q[i * self.residual.len()..][..self.d]
    }

    /// The newest direction q_k (D) and the signal's part along it.
    pub(crate) fn newest(&self) -> (&[f64], f64) {
        let (stride, k) = (self.residual.len(), self.support.len() - 1);
        (&self.q[k * stride..][..self.d], self.z[k])
    }

    /// The newest direction as a combination of the chosen atoms, in their order: R w = e_k.
    pub(crate) fn newest_weights(&self, w: &mut Vec<f64>) {
        let (k, cap) = (self.support.len(), self.capacity);
        w.clear();
        w.resize(k, 0.0);
        for i in (0..k).rev() {
            let known: f64 = (i + 1..k).map(|j| self.r[j * cap + i] * w[j]).sum();
            w[i] = (f64::from(u8::from(i + 1 == k)) - known) / self.r[i * cap + i];
        }
    }

    /// The coefficients of the chosen atoms, in their order: back substitution in R x = z.
    pub(crate) fn coefficients(&self, x: &mut [f64]) {
        let (k, cap) = (self.support.len(), self.capacity);
        let scale = self.energy.sqrt();
        for i in (0..k).rev() {
            let known: f64 = (i + 1..k).map(|j| self.r[j * cap + i] * x[j]).sum();
            x[i] = (self.z[i] - known) / self.r[i * cap + i];
        }
        x[..k].iter_mut().for_each(|x| *x *= scale);
    }

    /// sum_i w_i (y_i - (Ax)_i)^2.
    pub(crate) fn squared_residual(&self) -> f64 {
        self.left * self.energy * self.heaviest
    }
}

/// Writes √(w / max w) to `root`. Returns the sum and the maximum of the weights.
fn roots<W: Into<f64> + Copy>(weights: ArrayView1<W>, root: &mut [f64]) -> Result<(f64, f64)> {
    let (mut total, mut heaviest) = (0f64, 0f64);
    for (i, &w) in weights.iter().enumerate() {
        let w: f64 = w.into();
        if !(0.0..=1e100).contains(&w) {
            return Err(
                format!("the weight {w} of number {i}: it must be between 0 and 1e100").into(),
            );
        }
        total += w;
        heaviest = heaviest.max(w);
    }
    let scale = if heaviest > 0.0 { heaviest } else { 1.0 };
    for (r, &w) in root.iter_mut().zip(weights) {
        *r = (w.into() / scale).sqrt();
    }
    Ok((total, scale))
}
