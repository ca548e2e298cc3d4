//! The report of `denoise` and `complete`: status columns of the table, and messages at the end.

use super::messages;
use crate::io::csv::{AddedColumn, After};
use crate::io::text::{number_cell, significant};
use crate::io::{Cells, Columns};
use crate::pose::units::{LengthUnit, Units};
use crate::pose::{FillMethod, Status};
use crate::restore::{Restoration, RestorationCounts};

/// What a column of a point says of a restoration.
#[derive(Debug, Clone, Copy)]
enum Told {
    Status,
    Sd,
    Method,
}

impl Told {
    /// Whether a cell may be one of such a column: a word of ours, a number, or nothing.
    fn reads(self, cell: Option<&[u8]>) -> bool {
        let text = cell.and_then(|cell| std::str::from_utf8(cell).ok());
        let text = text.unwrap_or_default().trim();
        text.is_empty()
            || match self {
                Told::Status => Status::of_name(text).is_some(),
                Told::Sd => text.parse::<f64>().is_ok(),
                Told::Method => FillMethod::of_name(text).is_some(),
            }
    }

    const ALL: [(Told, &'static str); 3] = [
        (Told::Status, "status"),
        (Told::Sd, "sd"),
        (Told::Method, "method"),
    ];
}

/// The columns that tell what became of the points of a table.
pub(crate) struct StatusColumns {
    /// The columns.
    pub added: Vec<AddedColumn>,
    /// What each says, of which point; that of a frame is last, and not among them.
    told: Vec<(usize, Told)>,
    units: Units,
}

impl StatusColumns {
    /// Those that `--status` adds; without it, those that the table has and that are ours, which
    /// would be false of what is restored. `units` are those of the output, `cells` the table's.
    pub(crate) fn new(
        status: bool,
        columns: &Columns,
        cells: &[Cells],
        units: Units,
    ) -> StatusColumns {
        let has = Told::ALL.map(|(told, ending)| {
            let mut found = columns.of_points(ending);
            let is_ours = |column: &usize| cells.iter().all(|row| told.reads(row.get(*column)));
            found
                .iter_mut()
                .for_each(|column| *column = column.filter(is_ours));
            found
        });
        let names = columns.points.iter().enumerate();
        let of_points = names.flat_map(|(p, name)| {
            let all = Told::ALL.iter().zip(&has);
            let wanted = all.filter(move |(_, has)| status || has[p].is_some());
            wanted.map(move |((told, ending), _)| {
                let column = AddedColumn::new(format!("{name}.{ending}"), After::Point(p));
                ((p, *told), column)
            })
        });
        let (told, mut added): (Vec<_>, Vec<_>) = of_points.unzip();
        if status || columns.names.iter().any(|name| name == UNLIKE) && !told.is_empty() {
            added.push(AddedColumn::new(UNLIKE, After::All));
        }
        StatusColumns { added, told, units }
    }

    /// Their cells for one frame.
    pub(crate) fn cells(&self, restored: &Restoration<'_>, t: usize) -> Vec<String> {
        let cell = |(p, told): &(usize, Told)| match told {
            Told::Status => restored.status(t, *p).name().to_string(),
            Told::Method => restored.method(t, *p).map_or("", |m| m.name()).to_string(),
            Told::Sd => {
                let sd = (restored.sd(t, *p) * 1e4).round() / 1e4;
                match self.units.unit {
                    LengthUnit::Cm => number_cell(sd),
                    _ => significant(self.units.length(sd)),
                }
            }
        };
        let mut cells: Vec<String> = self.told.iter().map(cell).collect();
        if self.added.len() > cells.len() {
            // Rounded up, so that only 0 is 0.
            cells.push(number_cell((restored.novelty(t) * 10.0).ceil() / 10.0));
        }
        cells
    }
}

/// The column of how unlike the training poses a frame is.
const UNLIKE: &str = "unlike";

/// Reports the counts of a restoration. `too_little`: the fate of frames in which too few points
/// are visible; `status`: whether the table has status columns; `max_gap`: whether long gaps are
/// left empty.
pub(crate) fn report(counts: &RestorationCounts, too_little: &str, status: bool, max_gap: bool) {
    if counts.too_little > 0 {
        messages::info(&format!(
            "{} of {} frames {too_little}",
            counts.too_little, counts.frames
        ));
    }
    outliers(counts.rejected, counts.replaced)
        .iter()
        .for_each(|line| messages::info(line));
    if counts.exchanged > 0 {
        messages::info(&format!(
            "left and right were exchanged in {} places (pairs of points, frame by frame): put \
             back",
            counts.exchanged
        ));
    }
    match counts.cuts {
        0 => {}
        1 => messages::info("the whole body jumps once: taken as a cut, nothing is joined across"),
        n => messages::info(&format!(
            "the whole body jumps {n} times: taken as cuts, nothing is joined across"
        )),
    }
    match counts.takes_unknown {
        0 => {}
        1 => messages::info(
            "the model knows no poses like most of the take's: restored from its own frames, with \
             what the model's add in simulated gaps",
        ),
        n => messages::info(&format!(
            "the model knows no poses like most of those of {n} takes: restored from their own \
             frames, with what the model's add in simulated gaps"
        )),
    }
    if let Some(noise) = counts.doubtful_noise() {
        messages::info(&format!(
            "noise of at most {noise:.2} cm is taken out, which cannot be told from motion"
        ));
    }
    if counts.novel > 0 {
        let which = if status {
            "the column unlike"
        } else {
            "--status"
        };
        messages::info(&format!(
            "{} of {} frames have a pose unlike all training poses ({which} shows by how much)",
            counts.novel, counts.frames
        ));
    }
    if max_gap && counts.unfilled > 0 {
        messages::info(&format!("{} points left empty", counts.unfilled));
    }
    messages::debug(&format!(
        "{} frames, {} points filled",
        counts.frames, counts.filled
    ));
    if counts.mean_noise() > 0.0 {
        messages::debug(&format!(
            "noise {:.3} cm per coordinate",
            counts.mean_noise()
        ));
    }
}

/// What became of outliers, of which some were `replaced`; the others count for nothing, and stay.
fn outliers(all: usize, replaced: usize) -> Option<String> {
    let noun = if all == 1 { "outlier" } else { "outliers" };
    match (all, replaced) {
        (0, _) => None,
        (_, 0) => Some(format!("ignored {all} {noun}")),
        _ if replaced == all => Some(format!("replaced {all} {noun}")),
        _ => Some(format!(
            "replaced {replaced} of {all} {noun}; too little is known where the others are, which \
             stay"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_are_said_to_be_replaced_where_they_are() {
        assert_eq!(outliers(0, 0), None);
        assert_eq!(outliers(2, 0).as_deref(), Some("ignored 2 outliers"));
        assert_eq!(outliers(1, 1).as_deref(), Some("replaced 1 outlier"));
        let some = outliers(3, 1).unwrap_or_default();
        assert!(some.starts_with("replaced 1 of 3 outliers"));
    }
}
