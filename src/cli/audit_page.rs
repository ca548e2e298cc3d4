//! The audit as a page: a take a section, its gaps and findings over time.

use super::audit::{FileAudit, kind_name};
use crate::audit::{Finding, TakeAudit};
use crate::evaluate::html::escape;
use crate::evaluate::plain_page::PlainPage;
use std::fmt::Write;

const STYLE: &str = include_str!("audit_page.css");
/// Points whose gaps are drawn.
const DRAWN: usize = 60;
/// The width of a take and the height of a point, in the picture's units.
const WIDTH: f64 = 800.0;
const ROW: f64 = 14.0;
/// Room for the names.
const NAMES: f64 = 180.0;

/// The page of some files.
pub fn page(files: &[FileAudit]) -> String {
    let found = files.iter().filter(|f| f.has_findings()).count();
    PlainPage {
        title: "Takes audited",
        lead: vec![format!(
            "Files: {}, with findings: {found}. Nothing was changed. In the pictures a take runs from left to right, a point a row: empty where it is missing, marked where something was found.",
            files.len()
        )],
        main: files.iter().map(section).collect(),
        style: STYLE,
        command: "audit",
        data: "",
    }
    .html()
}

fn section(file: &FileAudit) -> String {
    let mut out = String::new();
    if let Some(error) = &file.error {
        let _ = writeln!(
            out,
            "<section><h2>{}</h2><p class=\"failed\">not read: {}</p></section>",
            escape(&file.file),
            escape(error)
        );
    }
    for take in &file.takes {
        let name = match &take.take {
            Some(name) if file.takes.len() > 1 => format!("{}: {name}", file.file),
            _ => file.file.clone(),
        };
        let _ = writeln!(
            out,
            "<section><h2>{}</h2><p>{}</p>{}{}</section>",
            escape(&name),
            escape(&FileAudit::line(take)),
            picture(take),
            findings(take)
        );
    }
    out
}

fn findings(take: &TakeAudit) -> String {
    if take.findings.is_empty() {
        return "<p>Nothing found.</p>".to_string();
    }
    let item = |f: &Finding| format!("<li><b>{}</b> {}</li>", kind_name(f.kind), escape(&f.what));
    let items: String = take.findings.iter().map(item).collect();
    format!("<ul>{items}</ul>")
}

/// The gaps of each point over time, and marks where something was found; empty where there is nothing to draw.
fn picture(take: &TakeAudit) -> String {
    let gaps_of = |point: &str| take.gaps.by_point.iter().find(|g| g.point == point);
    let mut points: Vec<&str> = take
        .gaps
        .by_point
        .iter()
        .map(|g| g.point.as_str())
        .collect();
    for point in take.findings.iter().flat_map(|f| &f.points) {
        if !points.contains(&point.as_str()) {
            points.push(point);
        }
    }
    if points.is_empty() || take.frames == 0 {
        return String::new();
    }
    let left_out = points.len().saturating_sub(DRAWN);
    points.truncate(DRAWN);
    let x = |frame: usize| NAMES + WIDTH * frame as f64 / take.frames as f64;
    let bar = |out: &mut String, class: &str, row: usize, [start, end]: [usize; 2], what: &str| {
        let _ = write!(
            out,
            "<rect class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\"><title>{}</title></rect>",
            x(start),
            ROW * row as f64 + 2.0,
            (x(end) - x(start)).max(1.5),
            ROW - 4.0,
            escape(what)
        );
    };
    let mut rows = String::new();
    for (row, point) in points.iter().enumerate() {
        let _ = write!(
            rows,
            "<text x=\"{:.0}\" y=\"{:.1}\">{}</text>",
            NAMES - 6.0,
            ROW * (row as f64 + 0.75),
            escape(point)
        );
        bar(&mut rows, "seen", row, [0, take.frames], point);
        for gap in gaps_of(point).iter().flat_map(|g| &g.ranges) {
            let what = format!("{point}: missing in frames {} to {}", gap[0], gap[1] - 1);
            bar(&mut rows, "gap", row, *gap, &what);
        }
        let is_of_point = |f: &&Finding| f.points.iter().any(|p| p == point);
        for finding in take.findings.iter().filter(is_of_point) {
            if let Some(frames) = finding.frames {
                bar(&mut rows, "mark", row, frames, &finding.what);
            }
        }
    }
    let more = match left_out {
        0 => String::new(),
        n => format!("<p>{n} more points have gaps or findings.</p>"),
    };
    format!(
        "<div class=\"wide\"><svg class=\"takes\" viewBox=\"0 0 {:.0} {:.0}\" role=\"img\" aria-label=\"gaps and findings over time\">{rows}</svg></div>{more}",
        NAMES + WIDTH,
        ROW * points.len() as f64
    )
}
