//! Tables of text with aligned columns.

use std::fmt::Write;

/// Rows as lines: the first column to the left, the others to the right, two spaces between. A row
/// of one cell is a line of text that takes part in no column.
pub fn aligned(rows: &[Vec<String>]) -> String {
    let full = || rows.iter().filter(|r| r.len() > 1);
    let columns = full().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| full().map(|r| r[c].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut out = String::new();
    for row in rows {
        let mut line = String::new();
        for (c, cell) in row.iter().enumerate() {
            // Writing to memory cannot fail.
            let _ = match (c, row.len()) {
                (0, 1) => write!(line, "{cell}"),
                (0, _) => write!(line, "{cell:<0$}", widths[0]),
                _ => write!(line, "  {cell:>0$}", widths[c]),
            };
        }
        let _ = writeln!(out, "{}", line.trim_end());
    }
    out
}

/// Three digits that count, never an exponent above 1e-5.
pub fn short(v: f64) -> String {
    let digits = (2 - v.abs().max(1e-5).log10().floor() as i32).clamp(0, 6) as usize;
    format!("{v:.digits$}")
}
