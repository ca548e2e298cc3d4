//! A tile of poses coded together: each takes one atom after another, and all of them scan the atoms at once.

use super::fit::Fit;
use super::pursuit::Rule;
use super::scan::{Panels, Scan, Step};
use super::{Dictionary, Stop};

/// How often a pose may find that the atom it took depends on the others before it gives up: only rounding lets such an
/// atom win, and only where nothing of use is left.
const RETRIES: usize = 4;

/// How many poses to code together: the two or three numbers kept for each pair of pose and atom should stay in the
/// cache, but the more poses there are the seldomer the atoms are read.
pub(super) fn poses_at_once(n: usize) -> usize {
    match n {
        0..=65_536 => 60,
        _ => 30,
    }
}

/// The state of a tile. Made once for many tiles.
pub(super) struct Tile<'a> {
    dictionary: &'a Dictionary,
    rule: Rule,
    scan: Scan<'a>,
}

impl<'a> Tile<'a> {
    /// Room for `poses` poses.
    pub fn new(dictionary: &'a Dictionary, panels: &'a Panels, rule: Rule, poses: usize) -> Self {
        Tile {
            dictionary,
            rule,
            scan: Scan::new(panels, poses),
        }
    }

    /// Codes the poses that `fits` were started on, with at most `sparsity` atoms each.
    pub fn code(&mut self, fits: &mut [Fit], sparsity: usize) {
        self.load(fits);
        let most = sparsity
            .min(self.dictionary.len())
            .min(self.dictionary.width());
        for step in 0..most + RETRIES {
            if fits.iter().all(|f| f.stop.is_some()) {
                break;
            }
            self.scan.step(match (step, self.rule) {
                (0, _) => Step::First,
                (_, Rule::Plain) => Step::Plain,
                (_, Rule::Optimised) => Step::Optimised,
            });
            self.take(fits);
            for fit in fits
                .iter_mut()
                .filter(|f| f.stop.is_none() && f.support.len() == most)
            {
                fit.stop = Some(if most == sparsity {
                    Stop::Sparsity
                } else {
                    Stop::Dependent
                });
            }
        }
        fits.iter_mut()
            .for_each(|f| f.stop = f.stop.or(Some(Stop::Dependent)));
    }

    /// Puts the residuals in place of the directions, and |a|^2 in place of what is left of the atoms.
    fn load(&mut self, fits: &[Fit]) {
        let d = self.dictionary.width();
        self.scan.directions.fill(0.0);
        for (fit, row) in fits.iter().zip(self.scan.directions.chunks_exact_mut(d)) {
            if fit.stop.is_none() {
                weigh(&fit.residual, fit.root.as_deref(), row);
            }
        }
        if fits.iter().all(|f| f.root.is_none()) {
            return self.scan.begin();
        }
        let mut weights = vec![1.0; self.scan.directions.len()];
        for (fit, row) in fits.iter().zip(weights.chunks_exact_mut(d)) {
            if let Some(root) = &fit.root {
                row.iter_mut()
                    .zip(root)
                    .for_each(|(w, r)| *w = (r * r) as f32);
            }
        }
        self.scan.begin_weighted(&weights);
    }

    /// Gives each pose its best atom, and makes the direction that this adds ready for the next scan.
    fn take(&mut self, fits: &mut [Fit]) {
        let d = self.dictionary.width();
        for (i, fit) in fits.iter_mut().enumerate() {
            let row = i * d..(i + 1) * d;
            self.scan.parts[i] = 0.0;
            if fit.stop.is_none() {
                match self.scan.best(i) {
                    None => fit.stop = Some(Stop::Dependent),
                    Some(atom) => {
                        // Taken, or found in f64 to depend on those taken: not to be looked at again either way.
                        self.scan.leave_out(i, atom);
                        if fit.push(atom, super::code::row(self.dictionary, atom)) {
                            let (q, z) = fit.newest();
                            weigh(q, fit.root.as_deref(), &mut self.scan.directions[row]);
                            self.scan.parts[i] = -z as f32;
                            continue;
                        }
                    }
                }
            }
            self.scan.directions[row].fill(0.0);
        }
    }
}

/// √w∘v in f32: an unweighted atom's product with it is the weighted atom's with v.
fn weigh(v: &[f64], root: Option<&[f64]>, out: &mut [f32]) {
    match root {
        Some(root) => {
            out.iter_mut()
                .zip(v)
                .zip(root)
                .for_each(|((o, v), w)| *o = (v * w) as f32);
        }
        None => out.iter_mut().zip(v).for_each(|(o, v)| *o = *v as f32),
    }
}
