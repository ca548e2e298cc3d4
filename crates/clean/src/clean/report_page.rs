//! One page for a run: what was done to each take, what somebody should look at, and where.

use super::finding_groups::{FindingGroup, groups};
use super::outcome::FileOutcome;
use super::person::TakePerson;
use super::places::PlaceToSee;
use super::record::Summary;
use super::report::{CleanReport, TITLE, fate, noise};
use super::row::Row;
use crate::audit::count;
use crate::draw::href::{encoded, href};
use crate::draw::html::escape;
use crate::draw::plain_page::PlainPage;
use crate::draw::stick_picture::BOX;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const STYLE: &str = include_str!("clean.css");
/// The columns after that of the take, in which a card names its lines too.
const TITLES: [&str; 7] = [
    "Named by",
    "Labels put right",
    "Filled",
    "Replaced",
    "Noise",
    "Solved",
    "Result",
];
/// Takes that have pictures: those with findings come first.
const PICTURED: usize = 200;
/// Findings of a group that are named after the first one.
const LISTED: usize = 6;

impl CleanReport {
    /// The page, which stands in `folder`.
    pub(crate) fn html(&self, folder: &Path) -> String {
        let titles: String = (TITLES.iter())
            .map(|t| format!("<th scope=\"col\">{t}</th>"))
            .collect();
        let mut rows = String::new();
        let found = self.rows.iter().filter(|r| has_findings(r)).count();
        let (mut of_found, mut of_sound) = (PICTURED, PICTURED.saturating_sub(found));
        for row in &self.rows {
            let left = if has_findings(row) {
                &mut of_found
            } else {
                &mut of_sound
            };
            let is_pictured = *left > 0;
            *left = left.saturating_sub(1);
            PageRow::new(row, folder).push(&mut rows, is_pictured);
        }
        let look = if found == 0 && !self.has_failures() {
            "There are no findings."
        } else {
            "Each finding leads to its place in the page that plays the take."
        };
        PlainPage {
            title: TITLE,
            lead: vec![
                format!("{}. {look}", escape(&self.counts())),
                "Filled are missing positions (points times frames), replaced are outliers. The \
                 word in the last column leads to the record, which has every change."
                    .to_string(),
            ],
            main: format!(
                "<section><table class=\"files\">\n<thead><tr><th scope=\"col\">Take</th>{titles}\
                 </tr></thead>\n{rows}</table></section>"
            ),
            style: STYLE,
            command: "clean",
            data: "",
        }
        .html()
    }
}

/// Whether somebody should look at a file.
fn has_findings(row: &Row) -> bool {
    (row.outcome.summary()).is_none_or(|summary| !summary.findings.is_empty())
}

/// A file on the page.
struct PageRow<'a> {
    row: &'a Row,
    /// The folder of the page.
    folder: &'a Path,
    /// The address of the page that plays the take.
    page: Option<String>,
}

impl<'a> PageRow<'a> {
    fn new(row: &'a Row, folder: &'a Path) -> PageRow<'a> {
        let page = row.page().map(|path| href(folder, &path));
        PageRow { row, folder, page }
    }

    fn push(&self, out: &mut String, is_pictured: bool) {
        let summary = self.row.outcome.summary();
        let class = match summary {
            None => "failed",
            Some(s) if !s.findings.is_empty() => "found",
            Some(_) => "fine",
        };
        let people = summary.map_or(&[][..], |s| &s.people);
        let pictures: String = if is_pictured {
            people.iter().map(picture).collect()
        } else {
            String::new()
        };
        let name = link(self.page.as_deref(), &self.row.name);
        let size = summary.map_or(String::new(), |s| format!("<small>{}</small>", size(s)));
        // Writing to memory cannot fail.
        let findings = self.findings();
        let folded = summary.map_or(String::new(), |s| self.folded(s));
        // A take without findings has one row.
        let (beside, below) = if findings.is_empty() {
            (folded, String::new())
        } else {
            (String::new(), folded)
        };
        let _ = write!(
            out,
            "<tbody class=\"{class}\"><tr><th scope=\"row\"><div>{pictures}<div>{name}{size}\
             {beside}</div></div></th>"
        );
        for (title, cell) in TITLES.iter().zip(self.cells()) {
            let _ = write!(out, "<td data-t=\"{title}\">{cell}</td>");
        }
        *out += "</tr>";
        if !findings.is_empty() {
            let columns = TITLES.len() + 1;
            let _ = write!(
                out,
                "\n<tr class=\"more\"><td colspan=\"{columns}\"><ul>{findings}</ul>{below}</td>\
                 </tr>"
            );
        }
        *out += "</tbody>\n";
    }

    /// The cells below [`TITLES`], as HTML.
    fn cells(&self) -> [String; 7] {
        let mut out: [String; 7] = Default::default();
        let record = self.row.record().map(|path| href(self.folder, &path));
        out[6] = link(record.as_deref(), fate(self.row));
        let Some(s) = self.row.outcome.summary() else {
            return out;
        };
        out[0] = match (&s.named_by, s.names_fit) {
            (Some(by), fit) => {
                let fit = 100.0 * fit.unwrap_or_default();
                format!("{}<small>{fit:.0}% agree</small>", escape(by))
            }
            (None, Some(_)) => "nothing fits".to_string(),
            (None, None) => String::new(),
        };
        out[1] = escape(&put_right(s));
        if s.missing > 0 {
            out[2] = format!("{}<small>of {}</small>", s.filled, s.missing);
        }
        if s.outliers > 0 {
            out[3] = s.outliers.to_string();
        }
        out[4] = noise(s, " cm");
        out[5] = s.people.iter().map(|person| self.solved(person)).collect();
        if matches!(self.row.outcome, FileOutcome::Unchanged(_)) {
            out[6] += &format!("<small>{}</small>", escape(&done(s)));
        }
        out
    }

    /// The file of a person, or that there is none.
    fn solved(&self, person: &TakePerson) -> String {
        let name = person.person.as_deref();
        let shown = match (&person.file, &person.none) {
            (Some(file), _) => {
                let beside = self.row.result().map(|result| result.with_file_name(file));
                let address = beside.map(|path: PathBuf| href(self.folder, &path));
                let kind = if file.ends_with(".bvh") {
                    "BVH"
                } else {
                    "centers"
                };
                link(address.as_deref(), name.unwrap_or(kind))
            }
            (None, Some(_)) => escape(&format!("{} none", name.unwrap_or_default())),
            (None, None) => return String::new(),
        };
        format!("<div>{shown}</div>")
    }

    /// The findings, or why the file failed, as items of a list.
    fn findings(&self) -> String {
        match &self.row.outcome {
            FileOutcome::Failed { error, .. } => {
                format!("<li>{}</li>", escape(&error.to_string()))
            }
            FileOutcome::Cleaned(s) | FileOutcome::Unchanged(s) => {
                groups(s).iter().map(|group| self.item(s, group)).collect()
            }
        }
    }

    /// What else is to be known, folded.
    fn folded(&self, s: &Summary) -> String {
        let others: Vec<String> = (s.places.iter())
            .filter(|place| place.finding.is_none() && self.page.is_some())
            .map(|place| self.place(s, place, &named(place, &place.what)))
            .collect();
        let notes: String = (s.notes.iter())
            .map(|note| format!("<li>{}</li>", escape(note)))
            .collect();
        let (places, lines) = (others.len(), s.notes.len());
        let told = [(places, "other place"), (lines, "note")];
        let told = told.iter().filter(|(n, _)| *n > 0);
        let told: Vec<String> = told.map(|(n, what)| count(*n, what)).collect();
        if told.is_empty() {
            return String::new();
        }
        let others = match &others[..] {
            [] => String::new(),
            others => format!("<li>{}</li>", others.join("; ")),
        };
        let summary = told.join(", ");
        format!("<details><summary>{summary}</summary><ul>{others}{notes}</ul></details>")
    }

    /// Findings that say the same: the first, and where the others are.
    fn item(&self, s: &Summary, group: &FindingGroup<'_>) -> String {
        let mut out = match group.kind {
            "" => "<li>".to_string(),
            kind => format!("<li><b>{}</b> ", escape(kind)),
        };
        out += &escape(group.line);
        let is_framed = says_frames(group.line);
        for (k, place) in group.places.iter().enumerate() {
            let alone = group.places.len() == 1;
            let mut text = when(s, place, !is_framed);
            if let (Some(point), false) = (&place.point, alone) {
                text = format!("{point} {text}");
            }
            let stop = if k == 0 { "" } else { ";" };
            let _ = write!(out, "{stop} <span>{}</span>", self.place(s, place, &text));
        }
        if !group.others.is_empty() {
            let one = |(subject, place): &(&str, Option<&PlaceToSee>)| match place {
                Some(place) => {
                    let text = format!("{subject} {}", when(s, place, true));
                    self.place(s, place, text.trim())
                }
                None => escape(subject),
            };
            let (count, shown) = (group.others.len(), group.others.iter().take(LISTED));
            let shown: Vec<String> = shown.map(one).filter(|text| !text.is_empty()).collect();
            let _ = write!(out, " <span class=\"others\">{count} more like it");
            if !shown.is_empty() {
                let _ = write!(out, ": {}", shown.join("; "));
            }
            if count > LISTED {
                let _ = write!(out, "; and {} more", count - LISTED);
            }
            out += "</span>";
        }
        out + "</li>"
    }

    /// A text that leads to a place of the take on its page.
    fn place(&self, s: &Summary, place: &PlaceToSee, text: &str) -> String {
        let Some(page) = &self.page else {
            return escape(text);
        };
        let point = place.point.as_deref();
        let trail = point.map_or(String::new(), |p| format!("&amp;trail={}", encoded(p)));
        let frame = place.frame.min(s.frames.saturating_sub(1));
        format!(
            "<a href=\"{page}#frame={frame}{trail}\">{}</a>",
            escape(text)
        )
    }
}

/// A place by its point.
fn named(place: &PlaceToSee, what: &str) -> String {
    match &place.point {
        Some(point) => format!("{point}, frame {}: {what}", place.frame),
        None => format!("frame {}: {what}", place.frame),
    }
}

/// When a place is: in seconds, and in frames where that is asked for or there are no seconds.
fn when(s: &Summary, place: &PlaceToSee, with_frames: bool) -> String {
    let [_, end] = place.frames();
    let last = end.saturating_sub(1);
    let of = |from: String, to: String| {
        if from == to {
            from
        } else {
            format!("{from}\u{2013}{to}")
        }
    };
    let frames = || {
        let range = of(place.frame.to_string(), last.to_string());
        let is_one = last == place.frame;
        format!("frame{} {range}", if is_one { "" } else { "s" })
    };
    let Some([from, to]) = place.seconds(s.rate) else {
        return frames();
    };
    let to = if last == place.frame { from } else { to };
    let seconds = of(format!("{from:.2}"), format!("{to:.2}")) + " s";
    if with_frames {
        format!("{seconds}, {}", frames())
    } else {
        seconds
    }
}

/// Whether a line says which frames it is of.
fn says_frames(line: &str) -> bool {
    let mut rests = line.split("frame").skip(1);
    rests.any(|rest| {
        rest.trim_start_matches('s')
            .trim_start()
            .starts_with(|c: char| c.is_ascii_digit())
    })
}

/// A text with a link where there is an address.
fn link(address: Option<&str>, text: &str) -> String {
    match address {
        Some(address) => format!("<a href=\"{address}\">{}</a>", escape(text)),
        None => escape(text),
    }
}

/// What a take is, in short.
fn size(s: &Summary) -> String {
    let seconds = s.rate.filter(|rate| *rate > 0.0);
    let seconds = seconds.map_or(String::new(), |rate| {
        format!(", {:.1} s", s.frames as f64 / rate)
    });
    let (points, frames) = (count(s.points, "point"), count(s.frames, "frame"));
    escape(&format!("{}, {points}, {frames}{seconds}", s.format))
}

/// How many changes of each kind put labels right.
fn put_right(s: &Summary) -> String {
    let kinds = s.put_right.iter();
    let of = |(kind, n): (&String, &usize)| match &kind[..] {
        "swap" | "ring" => count(*n, kind),
        "whole take" => format!("{n} exchanged throughout"),
        _ => format!("{n} {kind}"),
    };
    kinds.map(of).collect::<Vec<_>>().join(", ")
}

/// What was done to a take in a run before, in short.
fn done(s: &Summary) -> String {
    let mut out = Vec::new();
    out.extend(s.named_by.is_some().then(|| "named".to_string()));
    let labels: usize = s.put_right.values().sum();
    out.extend((labels > 0).then(|| count(labels, "label change")));
    out.extend((s.filled > 0).then(|| format!("{} filled", s.filled)));
    out.extend((s.outliers > 0).then(|| format!("{} replaced", s.outliers)));
    out.extend(s.denoised.then(|| "noise removed".to_string()));
    let solved = s.people.iter().filter(|p| p.file.is_some()).count();
    out.extend((solved > 0).then(|| format!("{solved} solved")));
    let what = if s.copied { "copied" } else { "cleaned" };
    match &out[..] {
        [] => format!("then {what}"),
        out => format!("then {what}: {}", out.join(", ")),
    }
}

/// A person as a small picture.
fn picture(person: &TakePerson) -> String {
    let Some(paths) = &person.picture else {
        return String::new();
    };
    let name = escape(person.person.as_deref().unwrap_or("the person"));
    let mut out = format!(
        "<svg viewBox=\"0 0 {BOX} {BOX}\" role=\"img\" aria-label=\"{name}\"><title>{name}</title>"
    );
    let is_of_dots = paths.iter().any(|path| path.contains("h0"));
    let sides = if is_of_dots {
        ["m dot", "l dot", "r dot"]
    } else {
        ["m", "l", "r"]
    };
    for (side, path) in sides.iter().zip(paths) {
        if !path.is_empty() {
            let _ = write!(out, "<path class=\"{side}\" d=\"{}\"/>", escape(path));
        }
    }
    out + "</svg>"
}
