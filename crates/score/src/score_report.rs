//! A score as text in aligned columns.

use super::error_stats::ErrorStats;
use super::score::ScoreReport;
use crate::draw::text_table::aligned;
use std::fmt::{self, Write};

/// The cells of a line of errors.
fn line(name: impl Into<String>, errors: &ErrorStats) -> Vec<String> {
    let mut row = vec![name.into(), errors.coordinates.to_string()];
    let numbers = [errors.mse, errors.rms, errors.mean_distance, errors.max];
    row.extend(numbers.map(number));
    row.push(match errors.still_missing {
        0 => String::new(),
        n => n.to_string(),
    });
    row
}

/// Four decimals, four significant digits below 0.001 and from a million on, `-` for no value.
fn number(value: Option<f64>) -> String {
    match value {
        None => "-".into(),
        Some(v) if v == 0.0 || (1e-3..1e6).contains(&v.abs()) => format!("{v:.4}"),
        Some(v) => format!("{v:.3e}"),
    }
}

/// Rates that are printed; the others are counted.
const PRINTED_RATES: usize = 5;

impl fmt::Display for ScoreReport {
    /// Aligned columns of text, in several lines.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&text(self))
    }
}

fn text(report: &ScoreReport) -> String {
    let unit = &report.units;
    let rates: Vec<String> = report.rates.iter().map(f64::to_string).collect();
    let rate = if rates.is_empty() {
        "no frame rate: gap lengths in frames, no accelerations (give the option `fps`)".into()
    } else {
        let (some, rest) = rates.split_at(rates.len().min(PRINTED_RATES));
        let more = match rest.len() {
            0 => String::new(),
            more => format!(" and {more} other rates"),
        };
        format!("{} frames/s{more}", some.join(" and "))
    };
    let mut out = format!(
        "{} frames, {} points, {rate}\n",
        report.frames, report.points
    );
    if report.all.still_missing > 0 {
        let (missing, of) = (report.all.still_missing, report.all.coordinates);
        let _ = writeln!(
            out,
            "still missing: {missing} of {} coordinates, not counted in the errors below",
            missing + of
        );
    }
    out.push('\n');
    let heads = [
        "",
        "coordinates",
        "MSE",
        "RMS",
        "distance",
        "max",
        "still missing",
    ];
    let mut heads = heads.map(String::from);
    heads[2] = format!("MSE {unit}^2");
    for head in &mut heads[3..6] {
        *head = format!("{head} {unit}");
    }
    let mut rows = vec![heads.to_vec(), line("all", &report.all)];
    damage(&mut rows, report);
    rows.push(vec![String::new()]);
    let by_point = report.by_point.iter();
    rows.extend(by_point.map(|p| line(&p.point, &p.errors)));
    out.push_str(&aligned(&rows));
    bones(&mut out, report);
    accelerations(&mut out, report);
    out
}

fn damage(rows: &mut Vec<Vec<String>>, report: &ScoreReport) {
    let Some(damage) = &report.damaged else {
        return;
    };
    let unit = if report.rates.is_empty() {
        "frames"
    } else {
        "s"
    };
    rows.push(line("the damaged table", &damage.before));
    rows.push(line("was missing", &damage.missing));
    for bin in damage.by_gap.iter().filter(|b| b.gaps > 0) {
        let limit = match bin.up_to {
            Some(up_to) => format!("<= {up_to} {unit}"),
            None => format!("> {} {unit}", bin.longer_than),
        };
        let word = if bin.gaps == 1 { "gap" } else { "gaps" };
        rows.push(line(format!("  {} {word} {limit}", bin.gaps), &bin.errors));
    }
    rows.push(line("was observed", &damage.observed));
    rows.push(line("  was off the truth", &damage.corrupted));
    rows.push(line("  was right", &damage.intact));
    rows.push(line("  is changed", &damage.changed));
}

fn bones(out: &mut String, report: &ScoreReport) {
    let Some(bones) = &report.bones else {
        return;
    };
    let worst = bones.by_bone.iter().filter(|b| b.rms_difference.is_some());
    let worst = worst.max_by(|a, b| {
        let [a, b] = [a, b].map(|bone| bone.rms_difference.unwrap_or(0.0));
        a.total_cmp(&b)
    });
    let _ = writeln!(
        out,
        "\nbone lengths, {}: RMS difference {}, standard deviation {} (truth {})",
        report.units,
        number(bones.rms_difference),
        number(bones.result_sd),
        number(bones.truth_sd)
    );
    if let Some(worst) = worst {
        let _ = writeln!(
            out,
            "  worst: {} - {}, RMS difference {}",
            worst.parent,
            worst.point,
            number(worst.rms_difference)
        );
    }
}

fn accelerations(out: &mut String, report: &ScoreReport) {
    if let Some(a) = &report.accelerations {
        let _ = writeln!(
            out,
            "\naccelerations, {}/s^2: RMS {} (truth {}), RMS difference {}",
            report.units,
            number(a.result),
            number(a.truth),
            number(a.difference)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::score::{Score, tests::table};
    use super::*;
    use ndarray::{Array2, array};

    #[test]
    fn columns_line_up_and_missing_values_are_counted() {
        let nan = f64::NAN;
        let mut truth = table(Array2::zeros((2, 6)), Some(120.0));
        truth.points = ["root", "lhipjoint"].map(String::from).to_vec();
        let mut result = truth.clone();
        result
            .xyz
            .row_mut(1)
            .assign(&array![1.0, 1.0, 1.0, 0.0, 0.0, nan]);
        let mut damaged = truth.clone();
        damaged
            .xyz
            .row_mut(1)
            .assign(&array![0.0, 0.0, 0.0, nan, nan, nan]);
        let score = Score::new(&truth, &result)
            .unwrap()
            .by_gap(&damaged)
            .unwrap();
        let text = text(&score.finish());
        assert!(text.starts_with("2 frames, 2 points, 120 frames/s\nstill missing: 1 of 12"));
        let ends: Vec<usize> = text
            .lines()
            .filter(|l| l.starts_with("all") || l.starts_with("was missing"))
            .map(|l| l.find('.').unwrap())
            .collect();
        assert_eq!(ends.len(), 2);
        assert!(ends[0] == ends[1], "{text}");
        assert!(text.contains("1 gap <= 0.1 s"), "{text}");
    }

    #[test]
    fn small_numbers_keep_their_digits() {
        assert_eq!(number(Some(0.0)), "0.0000");
        assert_eq!(number(Some(1e-9)), "1.000e-9");
        assert_eq!(number(Some(12.5)), "12.5000");
        assert_eq!(number(None), "-");
    }
}
