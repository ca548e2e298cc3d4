//! Atoms side by side: the layout that a scan reads.

use ndarray::ArrayView2;

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

/// Atoms in panels of [`WIDTH`]: of each panel one [`Row`] a coordinate. What is beyond the last atom is 0.
#[derive(Debug, Clone)]
pub struct Panels {
    rows: Vec<Row>,
    width: usize,
}

impl Panels {
    /// Of atoms (n, D).
    pub fn new(atoms: ArrayView2<'_, f32>) -> Panels {
        let (n, d) = atoms.dim();
        let mut rows = vec![Row::ZERO; n.div_ceil(WIDTH) * d];
        for (i, atom) in atoms.outer_iter().enumerate() {
            let panel = &mut rows[i / WIDTH * d..][..d];
            for (row, a) in panel.iter_mut().zip(atom) {
                row.0[i % WIDTH] = *a;
            }
        }
        Panels { rows, width: d }
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
