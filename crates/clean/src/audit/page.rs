//! The audit as a page: a take a section, its gaps and findings over time.

use super::file::{FileAudit, kind_name};
use super::{Finding, PointGaps, TakeAudit};
use crate::draw::href::encoded;
use crate::draw::html::escape;
use crate::draw::plain_page::PlainPage;
use std::cmp::Reverse;
use std::collections::HashMap;
use std::fmt::Write;

const STYLE: &str = include_str!("page.css");
/// Points whose gaps are drawn.
const DRAWN: usize = 60;
/// Bars of a picture, and of the whole page.
const BARS_OF_TAKE: usize = 3000;
const BARS: usize = 12_000;
/// Gaps with links, and findings, that are listed of a take.
const GAPS: usize = 8;
const FINDINGS: usize = 100;
/// The width of a take and the height of a point, in the picture's units.
const WIDTH: f64 = 800.0;
const ROW: f64 = 14.0;
/// Room for the names.
const NAMES: f64 = 180.0;

/// The page of some files.
pub fn page(files: &[FileAudit]) -> String {
    let found = files.iter().filter(|f| f.has_findings()).count();
    let failed = files.iter().filter(|f| f.error.is_some()).count();
    let takes: usize = files.iter().map(|f| f.takes.len()).sum();
    let bars = (BARS / takes.max(1)).clamp(DRAWN, BARS_OF_TAKE);
    PlainPage {
        title: "Takes audited",
        lead: vec![format!(
            "Files: {}, with findings: {found}, not read: {failed}. Nothing was changed. In the \
             pictures a take runs from left to right, a point a row: empty where it is missing, \
             marked where something was found. A file's name leads to a page that plays it.",
            files.len()
        )],
        main: files.iter().map(|file| section(file, bars)).collect(),
        style: STYLE,
        command: "audit",
        data: "",
    }
    .html()
}

fn section(file: &FileAudit, bars: usize) -> String {
    let mut out = String::new();
    if let Some(error) = &file.error {
        let _ = writeln!(
            out,
            "<section><h2>{}</h2><p class=\"failed\">not read: {}</p></section>",
            escape(&file.file),
            escape(error)
        );
    }
    let mut first = 0;
    for take in &file.takes {
        let name = match &take.take {
            Some(name) if file.takes.len() > 1 => format!("{}: {name}", file.file),
            _ => file.file.clone(),
        };
        let name = match &file.page {
            Some(page) => format!("<a href=\"{page}#frame={first}\">{}</a>", escape(&name)),
            None => escape(&name),
        };
        let link = Link {
            page: file.page.as_deref(),
            first,
        };
        let _ = writeln!(
            out,
            "<section><h2>{name}</h2><p>{}</p>{}{}{}</section>",
            escape(&FileAudit::line(take)),
            longest_gaps(take, &link),
            picture(take, bars),
            findings(take, &link)
        );
        first += take.frames;
    }
    out
}

/// Links to the page of a file, where it has one, for a take that begins at its frame `first`.
struct Link<'a> {
    page: Option<&'a str>,
    first: usize,
}

impl Link<'_> {
    /// A link to a frame of the take and the curves of a point; the text alone without a page.
    fn to(&self, frame: usize, point: Option<&String>, text: &str) -> String {
        let text = escape(text);
        let Some(page) = self.page else { return text };
        let trail = point.map_or(String::new(), |p| format!("&amp;trail={}", encoded(p)));
        let frame = self.first + frame;
        format!("<a href=\"{page}#frame={frame}{trail}\">{text}</a>")
    }
}

/// The longest gaps, with links to them.
fn longest_gaps(take: &TakeAudit, link: &Link<'_>) -> String {
    let mut gaps: Vec<&PointGaps> = take.gaps.by_point.iter().collect();
    gaps.sort_by_key(|g| Reverse(g.longest[1] - g.longest[0]));
    let one = |g: &&PointGaps| {
        let [start, end] = g.longest;
        let text = format!("{}, frames {start} to {}", g.point, end - 1);
        link.to(start, Some(&g.point), &text)
    };
    let some: Vec<String> = gaps.iter().take(GAPS).map(one).collect();
    match (some.is_empty(), link.page) {
        (false, Some(_)) => format!("<p>Longest gaps: {}.</p>", some.join("; ")),
        _ => String::new(),
    }
}

fn findings(take: &TakeAudit, link: &Link<'_>) -> String {
    if take.findings.is_empty() {
        return "<p>Nothing found.</p>".to_string();
    }
    let item = |f: &Finding| {
        let kind = match f.frames {
            Some([start, _]) => link.to(start, f.points.first(), kind_name(f.kind)),
            None => kind_name(f.kind).to_string(),
        };
        format!("<li><b>{kind}</b> {}</li>", escape(&f.what))
    };
    let items: String = take.findings.iter().take(FINDINGS).map(item).collect();
    let more = match take.findings.len().saturating_sub(FINDINGS) {
        0 => String::new(),
        n => format!("<p>{n} more findings; as JSON the audit has all.</p>"),
    };
    format!("<ul>{items}</ul>{more}")
}

/// The gaps of each point over time, and marks where something was found; empty where there is
/// nothing to draw. It has about as many bars as `bars`: gaps that are near each other are drawn as
/// one where there are more.
fn picture(take: &TakeAudit, bars: usize) -> String {
    let gaps = take.gaps.by_point.iter();
    let gaps_of: HashMap<&str, &PointGaps> = gaps.map(|g| (g.point.as_str(), g)).collect();
    let mut marks: HashMap<&str, Vec<&Finding>> = HashMap::new();
    let mut points: Vec<&str> = take
        .gaps
        .by_point
        .iter()
        .map(|g| g.point.as_str())
        .collect();
    for finding in &take.findings {
        for point in &finding.points {
            let of_point = marks.entry(point).or_default();
            if of_point.is_empty() && !gaps_of.contains_key(point.as_str()) {
                points.push(point);
            }
            of_point.push(finding);
        }
    }
    if points.is_empty() || take.frames == 0 {
        return String::new();
    }
    let left_out = points.len().saturating_sub(DRAWN);
    points.truncate(DRAWN);
    let most = (bars / points.len()).max(1);
    let mut rows = String::new();
    for (row, point) in points.iter().enumerate() {
        let _ = write!(
            rows,
            "<text x=\"{:.0}\" y=\"{:.1}\">{}</text>",
            NAMES - 6.0,
            ROW * (row as f64 + 0.75),
            escape(point)
        );
        push_bar(&mut rows, take, "seen", row, [0, take.frames], point);
        let ranges = gaps_of.get(point).map_or(&[][..], |g| &g.ranges);
        for (gap, count) in drawn(ranges, take.frames, most) {
            let frames = format!("frames {} to {}", gap[0], gap[1] - 1);
            let what = match count {
                1 => format!("{point}: missing in {frames}"),
                n => format!("{point}: {n} gaps in {frames}"),
            };
            push_bar(&mut rows, take, "gap", row, gap, &what);
        }
        let found = marks.get(point).map_or(&[][..], Vec::as_slice);
        for finding in found.iter().take(most) {
            if let Some(frames) = finding.frames {
                push_bar(&mut rows, take, "mark", row, frames, &finding.what);
            }
        }
    }
    let more = match left_out {
        0 => String::new(),
        n => format!("<p>{n} more points have gaps or findings.</p>"),
    };
    format!(
        "<div class=\"wide\"><svg class=\"takes\" viewBox=\"0 0 {:.0} {:.0}\" role=\"img\" \
         aria-label=\"gaps and findings over time\">{rows}</svg></div>{more}",
        NAMES + WIDTH,
        ROW * points.len() as f64
    )
}

/// At most `most` ranges of frames that hold all gaps of a point, and how many gaps each holds:
/// those that are nearest to each other go together.
fn drawn(gaps: &[[usize; 2]], frames: usize, most: usize) -> Vec<([usize; 2], usize)> {
    let mut near = 0;
    loop {
        let mut out: Vec<([usize; 2], usize)> = Vec::new();
        for &[start, end] in gaps {
            match out.last_mut() {
                Some((last, count)) if start <= last[1] + near => {
                    (last[1], *count) = (end, *count + 1);
                }
                _ => out.push(([start, end], 1)),
            }
        }
        if out.len() <= most.max(1) || near >= frames {
            return out;
        }
        near = 2 * near + 1;
    }
}

fn push_bar(
    out: &mut String,
    take: &TakeAudit,
    class: &str,
    row: usize,
    [start, end]: [usize; 2],
    what: &str,
) {
    let x = |frame: usize| NAMES + WIDTH * frame as f64 / take.frames as f64;
    let _ = write!(
        out,
        "<rect class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" \
         height=\"{:.1}\"><title>{}</title></rect>",
        x(start),
        ROW * row as f64 + 2.0,
        (x(end) - x(start)).max(1.5),
        ROW - 4.0,
        escape(what)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_that_are_near_each_other_are_drawn_together() {
        let gaps: Vec<[usize; 2]> = (0..500).map(|i| [2 * i, 2 * i + 1]).collect();
        assert_eq!(drawn(&gaps, 1000, 40), [([0, 999], 500)]);
        let two = [[0, 3], [4, 6], [900, 905]];
        assert_eq!(drawn(&two, 1000, 3).len(), 3);
        assert_eq!(drawn(&two, 1000, 2), [([0, 6], 2), ([900, 905], 1)]);
        assert_eq!(drawn(&two, 1000, 0).len(), 1);
        assert_eq!(drawn(&[], 0, 2), []);
    }
}
