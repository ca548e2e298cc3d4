//! The memory layout of a dense scan: atoms side by side.

use ndarray::ArrayView2;
use pulp::Simd;

/// The number of atoms in a panel: four registers of 16 lanes, eight of 8, or sixteen of 4.
pub(crate) const WIDTH: usize = 64;

/// One number for each atom of a panel. Aligned, because loads across two cache lines cost a third
/// of the speed.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct Row(pub [f32; WIDTH]);

impl Row {
    pub(crate) const ZERO: Row = Row([0.0; WIDTH]);
}

/// The indices of a panel's atoms, in order.
pub(crate) const INDICES: Row = {
    let mut indices = Row::ZERO;
    let mut i = 0;
    while i < WIDTH {
        indices.0[i] = i as f32;
        i += 1;
    }
    indices
};

/// The number of lanes of the widest SIMD vectors.
const MOST: usize = 16;
/// One number for each lane of the widest SIMD vectors.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Wide(pub [f32; MOST]);

impl Wide {
    /// One number in all lanes.
    pub(crate) const fn of(value: f32) -> Wide {
        Wide([value; MOST])
    }

    /// The first SIMD vector.
    #[inline(always)]
    pub(crate) fn first<S: Simd>(&self) -> S::f32s {
        S::as_simd_f32s(&self.0).0[0]
    }

    /// The first SIMD vector, mutable.
    #[inline(always)]
    pub(crate) fn first_mut<S: Simd>(&mut self) -> &mut S::f32s {
        &mut S::as_mut_simd_f32s(&mut self.0).0[0]
    }
}

/// Atoms in panels of [`WIDTH`], one [`Row`] per coordinate, (panels, D); 0 after the last atom.
#[derive(Debug, Clone)]
pub(crate) struct PackedAtoms {
    rows: Vec<Row>,
    width: usize,
}

impl PackedAtoms {
    /// Packs atoms (n, D).
    pub(crate) fn new(atoms: ArrayView2<'_, f32>) -> PackedAtoms {
        let (n, d) = atoms.dim();
        let mut rows = vec![Row::ZERO; n.div_ceil(WIDTH) * d];
        for (i, atom) in atoms.outer_iter().enumerate() {
            let panel = &mut rows[i / WIDTH * d..][..d];
            for (row, a) in panel.iter_mut().zip(atom) {
                row.0[i % WIDTH] = *a;
            }
        }
        PackedAtoms { rows, width: d }
    }

    /// The number of coordinates of an atom, D.
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// The panels, each of D rows.
    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &[Row]> {
        self.rows.chunks_exact(self.width)
    }
}
