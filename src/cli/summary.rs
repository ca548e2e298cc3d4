//! The report of `denoise` and `complete`: status columns of the table, and messages at the end.

use super::messages;
use crate::io::Columns;
use crate::io::csv::{AddedColumn, After};
use crate::io::text::{number_cell, significant};
use crate::pose::units::{LengthUnit, Units};
use crate::restore::{Restoration, RestorationCounts};

/// The columns that `--status` adds.
pub(crate) fn status_columns(status: bool, columns: &Columns) -> Vec<AddedColumn> {
    if !status {
        return Vec::new();
    }
    let names = columns.points.iter().enumerate();
    let of_points = names.flat_map(|(p, n)| {
        [
            AddedColumn::new(format!("{n}.status"), After::Point(p)),
            AddedColumn::new(format!("{n}.sd"), After::Point(p)),
            AddedColumn::new(format!("{n}.method"), After::Point(p)),
        ]
    });
    of_points
        .chain([AddedColumn::new("unlike", After::All)])
        .collect()
}

/// The cells of these columns for one frame of `points` points; none without the `units` of the
/// output.
pub(crate) fn status_cells(
    units: Option<Units>,
    restored: &Restoration<'_>,
    t: usize,
    points: usize,
) -> Vec<String> {
    let Some(units) = units else {
        return Vec::new();
    };
    let of_point = |p: usize| {
        let sd = (restored.sd(t, p) * 1e4).round() / 1e4;
        let method = restored.method(t, p).map_or("", |m| m.name());
        [
            restored.status(t, p).name().to_string(),
            match units.unit {
                LengthUnit::Cm => number_cell(sd),
                _ => significant(units.length(sd)),
            },
            method.to_string(),
        ]
    };
    // Rounded up, so that only 0 is 0.
    let novelty = (restored.novelty(t) * 10.0).ceil() / 10.0;
    (0..points)
        .flat_map(of_point)
        .chain([number_cell(novelty)])
        .collect()
}

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
