//! Atoms side by side: the layout that a scan reads.

use ndarray::ArrayView2;
use pulp::Simd;

/// Atoms in a panel: four registers of sixteen f32, eight of eight, sixteen of four.
pub const WIDTH: usize = 64;

/// One number of each atom of a panel, or of one pose for each. Aligned, or every load would touch two lines of the cache:
/// measured, that costs a third of the speed.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct Row(pub [f32; WIDTH]);

impl Row {
    pub const ZERO: Row = Row([0.0; WIDTH]);
}

/// The places of a panel's atoms, in order.
pub const PLACES: Row = {
    let mut places = Row::ZERO;
    let mut i = 0;
    while i < WIDTH {
        places.0[i] = i as f32;
        i += 1;
    }
    places
};

/// Lanes of the widest vectors.
pub const MOST: usize = 16;
/// A number in each lane of the widest vectors.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct Wide(pub [f32; MOST]);

impl Wide {
    pub const ZERO: Wide = Wide([0.0; MOST]);

    /// The first vector.
    #[inline(always)]
    pub fn first<S: Simd>(&self) -> S::f32s {
        S::as_simd_f32s(&self.0).0[0]
    }

    /// The same, to be written.
    #[inline(always)]
    pub fn first_mut<S: Simd>(&mut self) -> &mut S::f32s {
        &mut S::as_mut_simd_f32s(&mut self.0).0[0]
    }
}

/// Atoms in panels of [`WIDTH`]: of each panel one [`Row`] a coordinate. What is beyond the last atom is 0.
#[derive(Debug, Clone)]
pub struct PackedAtoms {
    rows: Vec<Row>,
    width: usize,
}

impl PackedAtoms {
    /// Of atoms (n, D).
    pub fn new(atoms: ArrayView2<'_, f32>) -> PackedAtoms {
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

    /// How many numbers an atom has, D.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The panels, each of D rows.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[Row]> {
        self.rows.chunks_exact(self.width)
    }
}
