//! The results as text, CSV, and one HTML page.

use super::{GapCell, NoiseCell, RESTORED};
use crate::draw::html::{escape, table};
use crate::draw::plain_page::PlainPage;
use crate::draw::text_table::{aligned, short};
use crate::error_stats::{ONE_AND_TWO_SD, SD_LEVELS};
use std::fmt::Write;

/// The results of a test.
#[derive(Debug, Clone)]
pub struct TakesReport {
    /// The subjects of the takes.
    pub subjects: Vec<String>,
    /// The number of takes.
    pub takes: usize,
    /// Gaps, by length and number of points.
    pub gaps: Vec<GapCell>,
    /// Noise, by level.
    pub noise: Vec<NoiseCell>,
}

/// A table with a heading.
struct Sheet {
    title: &'static str,
    rows: Vec<Vec<String>>,
}

impl TakesReport {
    /// Tables to read; `*` marks the lowest error of a row.
    pub fn text(&self) -> String {
        let mut out = String::new();
        for sheet in self.sheets() {
            let _ = writeln!(out, "{}", sheet.title);
            out += &aligned(&sheet.rows);
            out.push('\n');
        }
        out.pop();
        out
    }

    fn sheets(&self) -> Vec<Sheet> {
        let gaps = Sheet {
            title: "Gaps: RMS error of a coordinate, cm; beside the best rival, with a 95% \
                    interval",
            rows: self.gap_rows(),
        };
        let calibration = Sheet {
            title: "Share of the filled coordinates within one and two standard deviations (a \
                    Gaussian: 68% and 95%)",
            rows: self.calibration_rows(),
        };
        let noise = Sheet {
            title: "Noise: RMS error of a coordinate, cm; error of accelerations below 20 Hz, m/s²",
            rows: self.noise_rows(),
        };
        let sheets = [gaps, calibration, noise].into_iter();
        sheets.filter(|s| s.rows.len() > 1).collect()
    }

    fn gap_rows(&self) -> Vec<Vec<String>> {
        let Some(first) = self.gaps.iter().find(|c| c.mse.names().next().is_some()) else {
            return Vec::new();
        };
        let methods: Vec<&str> = first.mse.names().collect();
        let mut head: Vec<String> = ["gap", "points", "gaps", "left empty"]
            .map(String::from)
            .into();
        head.extend(methods.iter().map(|m| m.to_string()));
        head.extend(["to the best", "95% interval"].map(String::from));
        let mut rows = vec![head];
        for cell in &self.gaps {
            let errors: Vec<Option<f64>> = methods.iter().map(|m| cell.rms(m)).collect();
            let counts = [cell.mse.of(RESTORED).len(), cell.left_empty].map(|n| n.to_string());
            let mut row = vec![cell.length.to_string(), cell.points.to_string()];
            row.extend(counts);
            row.extend(marked(&errors));
            match cell.to_best_baseline() {
                Some((ratio, [low, high])) => {
                    row.extend([format!("{ratio:.2}"), format!("{low:.2} to {high:.2}")])
                }
                None => row.extend(["-", "-"].map(String::from)),
            }
            rows.push(row);
        }
        rows
    }

    fn calibration_rows(&self) -> Vec<Vec<String>> {
        let mut rows = vec![
            ["gap", "points", "coordinates", "one sd", "two sd"]
                .map(String::from)
                .to_vec(),
        ];
        let percent = |count: usize, of: usize| format!("{:.0}%", 100.0 * count as f64 / of as f64);
        let filled: Vec<&GapCell> = self.gaps.iter().filter(|c| c.filled > 0).collect();
        for cell in &filled {
            let mut row = vec![cell.length.to_string(), cell.points.to_string()];
            row.push(cell.filled.to_string());
            row.extend(ONE_AND_TWO_SD.map(|i| percent(cell.within[i], cell.filled)));
            rows.push(row);
        }
        if !filled.is_empty() {
            let (all, within) = self.calibration();
            let mut row: Vec<String> = ["all", "", &all.to_string()].map(String::from).into();
            row.extend(ONE_AND_TWO_SD.map(|i| percent(within[i], all)));
            rows.push(row);
        }
        rows
    }

    /// Filled coordinates of all cells, and those within each of the standard deviations.
    fn calibration(&self) -> (usize, Vec<usize>) {
        let all = self.gaps.iter().map(|c| c.filled).sum();
        let within = |i: usize| self.gaps.iter().map(|c| c.within[i]).sum();
        (all, (0..SD_LEVELS.len()).map(within).collect())
    }

    fn noise_rows(&self) -> Vec<Vec<String>> {
        let Some(first) = self.noise.iter().find(|c| c.mse.names().next().is_some()) else {
            return Vec::new();
        };
        let methods: Vec<&str> = first.mse.names().collect();
        let mut head: Vec<String> = ["noise, cm", "of points", "takes"].map(String::from).into();
        head.extend(methods.iter().map(|m| m.to_string()));
        head.extend(methods.iter().map(|m| format!("{m}, m/s²")));
        let mut rows = vec![head];
        for cell in &self.noise {
            let takes = cell.mse.of(RESTORED).len().to_string();
            let mut row = vec![
                cell.sd.to_string(),
                format!("{:.0}%", 100.0 * cell.share),
                takes,
            ];
            let errors = |of: &dyn Fn(&str) -> Option<f64>| -> Vec<Option<f64>> {
                methods.iter().map(|m| of(m)).collect()
            };
            row.extend(marked(&errors(&|m| cell.rms(m))));
            row.extend(marked(&errors(&|m| cell.acceleration_rms(m))));
            rows.push(row);
        }
        rows
    }

    /// A line per cell and method; errors in cm, of accelerations in m/s².
    pub fn csv(&self) -> String {
        let mut out = String::from(
            "task,seconds,points,sd,share,method,count,left_empty,rms,median,p99,acceleration,\
             within_1sd,within_2sd\n",
        );
        let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
        for cell in &self.gaps {
            for method in cell.mse.names() {
                let share = |i: usize| {
                    let own = method == RESTORED && cell.filled > 0;
                    number(own.then(|| cell.within[i] as f64 / cell.filled as f64))
                };
                let [one, two] = ONE_AND_TWO_SD.map(share);
                let seconds = cell.length.to_string().replace(" s", "");
                let _ = writeln!(
                    out,
                    "gaps,{seconds},{},,,{method},{},{},{},{},{},,{one},{two}",
                    cell.points,
                    cell.mse.of(method).len(),
                    cell.left_empty,
                    number(cell.rms(method)),
                    number(cell.distance(method, 0.5)),
                    number(cell.distance(method, 0.99)),
                );
            }
        }
        for cell in &self.noise {
            for method in cell.mse.names() {
                let _ = writeln!(
                    out,
                    "noise,,,{},{},{method},{},,{},,,{},,",
                    cell.sd,
                    cell.share,
                    cell.mse.of(method).len(),
                    number(cell.rms(method)),
                    number(cell.acceleration_rms(method)),
                );
            }
        }
        out
    }

    /// A page of the tables and of a plot of the calibration, which needs no other file; `model`
    /// says what restored the takes.
    pub fn html(&self, model: &str) -> String {
        let mut tables = String::new();
        for sheet in self.sheets() {
            let _ = write!(
                tables,
                "<section><h2>{}</h2>{}</section>",
                escape(sheet.title),
                table(&sheet.rows)
            );
        }
        let subjects = self.subjects.join(", ");
        let lead = format!(
            "{} takes of {}, restored by {}. Gaps are cut into copies of the takes and compared \
             with what was cut out; the lowest error of a row is marked. Gaussian: the \
             conditional mean under the covariance of the take's own poses and, where a model was \
             trained here, of its training poses, joined to both ends of the gap. Butterworth: of \
             second order, without lag, its cutoff chosen for each take with the truth at hand.",
            self.takes,
            escape(&subjects),
            escape(model)
        );
        let calibration = format!(
            "<section><h2>Calibration</h2><p>The share of the filled coordinates within as many \
             standard deviations as should hold the expected share: above the diagonal the stated \
             deviations are too large, below it too small. A line for each length of \
             gaps.</p><div class=\"charts\"><figure>{}</figure></div></section>",
            self.calibration_plot()
        );
        PlainPage {
            title: "Takes restored",
            lead: vec![lead],
            main: tables + &calibration,
            style: "",
            command: "evaluate takes",
            data: "All numbers are in takes.csv.",
        }
        .html()
    }

    /// Measured against expected shares, as SVG: a line for each length of gaps, and the diagonal.
    fn calibration_plot(&self) -> String {
        const SIDE: f64 = 300.0;
        let mut lengths: Vec<String> = self.gaps.iter().map(|c| c.length.to_string()).collect();
        lengths.dedup();
        let mut out = format!(
            "<svg viewBox=\"-40 -10 {} {}\" role=\"img\" aria-label=\"Calibration\">",
            SIDE + 150.0,
            SIDE + 50.0
        );
        for percent in [0, 25, 50, 75, 100] {
            let at = SIDE * f64::from(percent) / 100.0;
            let _ = write!(
                out,
                "<line class=\"grid\" x1=\"0\" y1=\"{0}\" x2=\"{SIDE}\" y2=\"{0}\"/><text \
                 x=\"-6\" y=\"{1}\" text-anchor=\"end\">{percent}%</text><text x=\"{at}\" \
                 y=\"{2}\" text-anchor=\"middle\">{percent}%</text>",
                SIDE - at,
                SIDE - at + 4.0,
                SIDE + 16.0
            );
        }
        let _ = write!(
            out,
            "<line class=\"ideal\" x1=\"0\" y1=\"{SIDE}\" x2=\"{SIDE}\" y2=\"0\"/><text x=\"{}\" \
             y=\"{}\" text-anchor=\"middle\">expected</text>",
            SIDE / 2.0,
            SIDE + 32.0
        );
        for (k, length) in lengths.iter().enumerate() {
            let cells: Vec<&GapCell> = self
                .gaps
                .iter()
                .filter(|c| c.length.to_string() == *length)
                .collect();
            let all: usize = cells.iter().map(|c| c.filled).sum();
            if all == 0 {
                continue;
            }
            let mut points = format!("0,{SIDE}");
            for (i, (_, expected)) in SD_LEVELS.iter().enumerate() {
                let within: usize = cells.iter().map(|c| c.within[i]).sum();
                let measured = within as f64 / all as f64;
                let _ = write!(
                    points,
                    " {:.1},{:.1}",
                    SIDE * expected,
                    SIDE * (1.0 - measured)
                );
            }
            let (color, y) = (k % 6, 14.0 + 16.0 * k as f64);
            let _ = write!(
                out,
                "<polyline points=\"{points}\" stroke=\"var(--k{color})\"/><line x1=\"{0}\" \
                 x2=\"{1}\" y1=\"{y}\" y2=\"{y}\" stroke=\"var(--k{color})\" \
                 stroke-width=\"2\"/><text x=\"{2}\" y=\"{3}\">{4}</text>",
                SIDE + 12.0,
                SIDE + 30.0,
                SIDE + 36.0,
                y + 4.0,
                escape(length)
            );
        }
        out + "</svg>"
    }
}

/// Errors as cells; the lowest is marked.
fn marked(errors: &[Option<f64>]) -> Vec<String> {
    let lowest = errors
        .iter()
        .flatten()
        .copied()
        .fold(f64::INFINITY, f64::min);
    let cell = |error: &Option<f64>| match error {
        Some(0.0) => "0*".into(),
        Some(e) if *e == lowest => short(*e) + "*",
        Some(e) => short(*e) + " ",
        None => "- ".into(),
    };
    errors.iter().map(cell).collect()
}
