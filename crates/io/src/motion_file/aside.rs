//! Computed points, which are read and written back, and which no stage between sees.

use super::MotionFile;
use crate::Table;
use crate::marker_take::MarkerTake;
use crate::pose::Poses;
use crate::pose::computed::{computed_note, computed_points};
use ndarray::{Array2, ArrayView2, Axis, s};

/// The points of a file, computed ones among them.
pub(super) struct AllPoints {
    table: Table,
    /// The indices of those that are not computed.
    measured: Vec<usize>,
}

impl MotionFile {
    /// The names of its computed points, which are no points of its table: those that the file
    /// lists as such, and centers of pressure, axes of segments and the like by their positions.
    pub fn computed(&self) -> Vec<&str> {
        let Some(all) = &self.all else {
            return Vec::new();
        };
        let points = all.table.poses.points.iter().enumerate();
        let computed = points.filter(|(p, _)| all.measured.binary_search(p).is_err());
        computed.map(|(_, name)| name.as_str()).collect()
    }

    /// The file with its computed points aside: those that it lists, and those that show it.
    pub(super) fn without_computed(mut self, listed: &[usize]) -> MotionFile {
        let mut computed = computed_points(&self.table.poses);
        computed.extend(listed);
        computed.sort_unstable();
        let is_measured = |p: &usize| computed.binary_search(p).is_err();
        let all = 0..self.table.poses.points.len();
        self.set_aside(all.filter(is_measured).collect());
        self.notes.extend(self.computed_note());
        self
    }

    /// What to say of its computed points; `None` if there are none.
    pub fn computed_note(&self) -> Option<String> {
        computed_note(&self.computed())
    }

    /// Sets aside the points that an `other` file of the same points has aside.
    pub(super) fn without_computed_of(mut self, other: &MotionFile) -> MotionFile {
        if let Some(all) = &other.all {
            self.set_aside(all.measured.clone());
        }
        self
    }

    /// Sets all points aside but those that are measured; where none is, it is a file of joints.
    fn set_aside(&mut self, measured: Vec<usize>) {
        let table = &self.table;
        if measured.len() == table.poses.points.len() || measured.is_empty() {
            return;
        }
        let columns: Vec<usize> = measured.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        let names = |all: &[String]| measured.iter().map(|p| all[*p].clone()).collect();
        let mut own = Table {
            name: table.name.clone(),
            columns: table.columns.clone(),
            poses: Poses {
                points: names(&table.poses.points),
                xyz: table.poses.xyz.select(Axis(1), &columns),
                time: table.poses.time.clone(),
                take: table.poses.take.clone(),
            },
            cells: Vec::new(),
            sd: (table.sd.as_ref()).map(|sd| sd.select(Axis(1), &measured)),
        };
        own.columns.points = names(&table.columns.points);
        let table = std::mem::replace(&mut self.table, own);
        self.all = Some(Box::new(AllPoints { table, measured }));
    }

    /// The table of all its points.
    #[doc(hidden)]
    pub fn whole_table(&self) -> &Table {
        self.all.as_ref().map_or(&self.table, |all| &all.table)
    }

    /// The positions of all its points (frames, 3 P), those of its table at `xyz`.
    #[doc(hidden)]
    pub fn whole(&self, xyz: ArrayView2<'_, f64>) -> Array2<f64> {
        let mut out = self.whole_table().poses.xyz.clone();
        for (own, p) in self.point_indices().into_iter().enumerate() {
            let from = xyz.slice(s![.., 3 * own..3 * own + 3]);
            out.slice_mut(s![.., 3 * p..3 * p + 3]).assign(&from);
        }
        out
    }

    /// The indices of the points of its table among all its points.
    pub(super) fn point_indices(&self) -> Vec<usize> {
        match &self.all {
            Some(all) => all.measured.clone(),
            None => (0..self.table.poses.points.len()).collect(),
        }
    }

    /// The indices of the points of its table among those of its take, some of which are no
    /// positions.
    pub(super) fn point_indices_in(&self, take: &MarkerTake) -> Vec<usize> {
        let positions = take.positions();
        self.point_indices()
            .into_iter()
            .map(|p| positions[p])
            .collect()
    }
}
