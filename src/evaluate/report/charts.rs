//! The report's charts: SVG in the page's own colours, light and dark. Each says in its caption what is seen, and in what.

use crate::evaluate::benchmark::result::SD_LEVELS;
use crate::evaluate::benchmark::summary::SummaryRow;
use crate::evaluate::benchmark::task::Task;
use crate::evaluate::html::escape;
use std::fmt::Write;

/// Models with a colour of their own: more cannot be told apart.
const COLOURS: usize = 6;
/// A logarithmic axis shows no smaller share of its largest value.
const DECADES: f64 = 1e-5;

/// Which models have which colour, the same all over the page: those with the lowest errors.
pub(super) struct Palette<'a>(Vec<&'a str>);

impl<'a> Palette<'a> {
    /// From all rows: the models whose errors are lowest on (geometric) average; those of a named size or sparsity, which
    /// have charts of their own, only where no others are.
    pub fn of(rows: &'a [SummaryRow]) -> Palette<'a> {
        let mut models: Vec<(&str, f64, f64)> = Vec::new();
        for row in rows {
            let log = row.mse.max(1e-12).ln();
            match models.iter_mut().find(|m| m.0 == row.model) {
                Some(m) => (m.1, m.2) = (m.1 + log, m.2 + 1.0),
                None => models.push((&row.model, log, 1.0)),
            }
        }
        let sweeps = |m: &(&str, f64, f64)| m.0.contains(':');
        if !models.iter().all(sweeps) {
            models.retain(|m| !sweeps(m));
        }
        models.sort_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)));
        models.truncate(COLOURS);
        Palette(models.iter().map(|m| m.0).collect())
    }

    /// The class of a model's colour; `kx` is everybody else's.
    fn class(&self, model: &str) -> String {
        match self.0.iter().position(|m| *m == model) {
            Some(i) => format!("k{i}"),
            None => "kx".into(),
        }
    }

    /// The rows of the coloured models, in the order of the colours.
    fn leading<'r>(&self, rows: &[&'r SummaryRow]) -> Vec<&'r SummaryRow> {
        let find = |m: &&str| rows.iter().find(|r| r.model == **m).copied();
        self.0.iter().filter_map(find).collect()
    }
}

/// The names of the lines, each with what `more` says of it.
fn legend(
    out: &mut String,
    palette: &Palette<'_>,
    rows: &[&SummaryRow],
    more: &dyn Fn(&SummaryRow) -> String,
) {
    out.push_str("<p class=\"legend\">");
    for row in rows {
        let _ = write!(
            out,
            "<span><i class=\"{}\"></i>{}{}</span> ",
            palette.class(&row.model),
            escape(&row.model),
            more(row)
        );
    }
    out.push_str("</p>");
}

/// Opens a figure with its caption and the SVG.
fn open(out: &mut String, caption: &str, label: &str, width: f64, height: f64) {
    let _ = write!(
        out,
        "<figure><figcaption>{caption}</figcaption><svg viewBox=\"0 0 {width} {height:.0}\" role=\"img\" aria-label=\"{}\">",
        escape(label)
    );
}

/// A logarithmic axis.
pub(super) struct Log {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Log {
    /// Around values above 0, between two places of the picture; `None` where there is no such value.
    pub fn over(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Option<Log> {
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        for v in values.filter(|v| v.is_finite() && *v > 0.0) {
            (low, high) = (low.min(v), high.max(v));
        }
        (high > 0.0).then(|| {
            let low = low.max(high * DECADES);
            // Never a single point: a factor of 2 at least.
            let spare = (2.0 / (high / low)).max(1.0).sqrt() * 1.08;
            Log {
                low: low / spare,
                high: high * spare,
                from,
                to,
            }
        })
    }

    /// Where a value stands; what is too small stands at the end.
    pub fn at(&self, v: f64) -> f64 {
        let share = (v.max(self.low) / self.low).ln() / (self.high / self.low).ln();
        self.from + share.clamp(0.0, 1.0) * (self.to - self.from)
    }

    /// 1, 2 and 5 times powers of ten; fewer where they are many.
    pub fn ticks(&self) -> Vec<f64> {
        let (from, to) = (
            self.low.log10().floor() as i32,
            self.high.log10().ceil() as i32,
        );
        let with = |digits: &[u32]| -> Vec<f64> {
            let all = (from..=to).flat_map(|p| digits.iter().map(move |d| (d, p)));
            // Read from text, so that 0.3 is 0.3.
            let all = all.filter_map(|(d, p)| format!("{d}e{p}").parse().ok());
            all.filter(|v| (self.low..=self.high).contains(v)).collect()
        };
        let sets: [&[u32]; 4] = [
            &[1, 2, 3, 4, 5, 6, 7, 8, 9],
            &[1, 2, 3, 5],
            &[1, 2, 5],
            &[1],
        ];
        let found = sets.into_iter().map(with).find(|t| t.len() <= 6);
        found.unwrap_or_default()
    }
}

/// Training error against test error: a line a model, on a logarithmic axis, hollow on poses learnt from, full on unseen
/// ones, with the interval.
pub(super) fn errors(out: &mut String, palette: &Palette<'_>, task: Task, rows: &[&SummaryRow]) {
    let mut rows = rows.to_vec();
    rows.sort_by(|a, b| a.mse.total_cmp(&b.mse));
    let (left, right, step, top) = (112.0, 410.0, 17.0, 20.0);
    let values = rows
        .iter()
        .flat_map(|r| [Some(r.mse), r.training_mse, Some(r.interval[1])]);
    let Some(axis) = Log::over(values.flatten(), left, right) else {
        return;
    };
    let height = top + step * rows.len() as f64 + 4.0;
    let label = format!(
        "{}: errors on unseen poses and on poses learnt from",
        title(task)
    );
    open(out, title(task), &label, 420.0, height);
    for tick in axis.ticks() {
        let x = axis.at(tick);
        let _ = write!(
            out,
            "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"14\" y2=\"{height:.0}\"/><text x=\"{x:.1}\" y=\"10\" text-anchor=\"middle\">{tick}</text>"
        );
    }
    for (i, row) in rows.iter().enumerate() {
        let (y, class) = (top + step * (i as f64 + 0.5), palette.class(&row.model));
        let [low, high] = row.interval.map(|v| axis.at(v));
        let x = axis.at(row.mse);
        let _ = write!(
            out,
            "<text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            left - 8.0,
            y + 3.5,
            shortened(&row.model)
        );
        if let Some(learnt) = row.training_mse {
            let at = axis.at(learnt);
            let _ = write!(
                out,
                "<line class=\"between\" x1=\"{at:.1}\" x2=\"{x:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/><circle class=\"hollow {class}\" cx=\"{at:.1}\" cy=\"{y:.1}\" r=\"3.4\"/>"
            );
        }
        let _ = write!(
            out,
            "<line class=\"spread {class}\" x1=\"{low:.1}\" x2=\"{high:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/><circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"><title>{}: {} ({} to {})</title></circle>",
            escape(&row.model),
            short(row.mse),
            short(row.interval[0]),
            short(row.interval[1]),
        );
    }
    out.push_str("</svg></figure>");
}

/// RMS by joint as dots on lines, a line a joint.
pub(super) fn by_joint(
    out: &mut String,
    palette: &Palette<'_>,
    task: Task,
    rows: &[&SummaryRow],
    points: &[String],
) {
    let rows = palette.leading(rows);
    let rms = |v: f64| v.max(0.0).sqrt() * crate::pose::ASF_UNIT_CM;
    let all = rows.iter().flat_map(|r| r.by_joint.iter().map(|v| rms(*v)));
    let most = all.fold(0.1_f64, f64::max);
    let (left, width, step) = (112.0, 298.0, 15.0);
    let height = 20.0 + step * points.len() as f64;
    let x = |v: f64| left + v / most * width;
    let label = format!("{}: RMS error of a coordinate by joint, cm", title(task));
    open(out, title(task), &label, 420.0, height);
    for tick in ticks(most) {
        let at = x(tick);
        let _ = write!(
            out,
            "<line class=\"grid\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"14\" y2=\"{height}\"/><text x=\"{at:.1}\" y=\"10\" text-anchor=\"middle\">{tick}</text>"
        );
    }
    for (j, point) in points.iter().enumerate() {
        let y = 20.0 + step * (j as f64 + 0.4);
        let _ = write!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            left - 8.0,
            y + 3.5,
            shortened(point)
        );
        // The best is drawn last, on top.
        for row in rows.iter().rev() {
            let value = row.by_joint.get(j).map(|v| rms(*v));
            if let Some(v) = value.filter(|v| v.is_finite()) {
                let _ = write!(
                    out,
                    "<circle class=\"{}\" cx=\"{:.1}\" cy=\"{y:.1}\" r=\"3.2\"/>",
                    palette.class(&row.model),
                    x(v)
                );
            }
        }
    }
    out.push_str("</svg>");
    legend(out, palette, &rows, &|_| String::new());
    out.push_str("</figure>");
}

/// The share of coordinates within each multiple of the stated deviation, against a Gaussian's.
pub(super) fn calibration(
    out: &mut String,
    palette: &Palette<'_>,
    task: Task,
    rows: &[&SummaryRow],
) {
    let rows: Vec<&SummaryRow> = palette
        .leading(rows)
        .into_iter()
        .filter(|r| !r.within.is_empty())
        .collect();
    if rows.is_empty() {
        return;
    }
    let (left, top, size) = (48.0, 10.0, 300.0);
    let at = |x: f64, y: f64| (left + size * x, top + size * (1.0 - y));
    let label = format!("{}: calibration", title(task));
    open(out, title(task), &label, 420.0, 336.0);
    for tick in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let (x, y) = at(tick, tick);
        let (right, bottom) = (left + size, top + size);
        let _ = write!(
            out,
            "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{y}\" y2=\"{y}\"/><line class=\"grid\" x1=\"{x}\" x2=\"{x}\" y1=\"{top}\" y2=\"{bottom}\"/><text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{:.0}%</text><text x=\"{}\" y=\"{}\" text-anchor=\"end\">{:.0}%</text>",
            bottom + 16.0,
            tick * 100.0,
            left - 5.0,
            y + 3.5,
            tick * 100.0,
        );
    }
    let ((x1, y1), (x2, y2)) = (at(0.0, 0.0), at(1.0, 1.0));
    let _ = write!(
        out,
        "<line class=\"ideal\" x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\"/>"
    );
    for row in rows.iter().rev() {
        let pairs = SD_LEVELS
            .iter()
            .zip(&row.within)
            .map(|((_, ought), is)| at(*ought, *is));
        let line = joined(std::iter::once(at(0.0, 0.0)).chain(pairs));
        let _ = write!(
            out,
            "<polyline class=\"{}\" points=\"{line}\"/>",
            palette.class(&row.model),
        );
    }
    out.push_str("</svg>");
    legend(out, palette, &rows, &|row| {
        let [one, two] = row.within_one_two().map(|s| 100.0 * s.unwrap_or(f64::NAN));
        format!(" {one:.0}% / {two:.0}%")
    });
    out.push_str(
        "<p class=\"legend\">Within one and two deviations; 68% and 95% ought to be.</p></figure>",
    );
}

/// A line of a chart: its name, and its points x, y with an interval, and the error on poses learnt from.
pub(super) struct Line {
    pub name: String,
    pub points: Vec<(f64, f64, [f64; 2], Option<f64>)>,
}

/// Lines over a logarithmic axis of whole numbers; dashed on poses learnt from.
pub(super) fn lines(out: &mut String, caption: &str, label: &str, lines: &[Line]) {
    let (left, right, top, bottom) = (52.0, 408.0, 12.0, 240.0);
    let points = || lines.iter().flat_map(|l| &l.points);
    let values = points().flat_map(|p| [Some(p.1), Some(p.2[1]), p.3]);
    let (Some(across), Some(up)) = (
        Log::over(points().map(|p| p.0), left, right),
        Log::over(values.flatten(), bottom, top),
    ) else {
        return;
    };
    open(out, caption, label, 420.0, 262.0);
    for tick in up.ticks() {
        let y = up.at(tick);
        let _ = write!(
            out,
            "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{tick}</text>",
            left - 6.0,
            y + 3.5
        );
    }
    let mut marks: Vec<f64> = points().map(|p| p.0).collect();
    marks.sort_by(f64::total_cmp);
    marks.dedup();
    let mut last = f64::NEG_INFINITY;
    for mark in marks {
        let x = across.at(mark);
        let _ = write!(
            out,
            "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{top}\" y2=\"{bottom}\"/>"
        );
        if x - last > 28.0 {
            last = x;
            let y = bottom + 15.0;
            let _ = write!(
                out,
                "<text x=\"{x:.1}\" y=\"{y}\" text-anchor=\"middle\">{mark}</text>"
            );
        }
    }
    for (i, line) in lines.iter().enumerate() {
        let class = format!("k{}", i % COLOURS);
        let learnt = line.points.iter();
        let learnt = learnt.filter_map(|p| p.3.map(|v| (across.at(p.0), up.at(v))));
        let unseen = line.points.iter().map(|p| (across.at(p.0), up.at(p.1)));
        let _ = write!(
            out,
            "<polyline class=\"dashed {class}\" points=\"{}\"/><polyline class=\"{class}\" points=\"{}\"/>",
            joined(learnt),
            joined(unseen)
        );
        for (x, y, [low, high], _) in &line.points {
            let (x, y, low, high) = (across.at(*x), up.at(*y), up.at(*low), up.at(*high));
            let _ = write!(
                out,
                "<line class=\"spread {class}\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{low:.1}\" y2=\"{high:.1}\"/><circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.4\"/>"
            );
        }
    }
    out.push_str("</svg><p class=\"legend\">");
    for (i, line) in lines.iter().enumerate() {
        let _ = write!(
            out,
            "<span><i class=\"k{}\"></i>{}</span> ",
            i % COLOURS,
            escape(&line.name)
        );
    }
    out.push_str("</p></figure>");
}

/// Points of a polyline.
pub(super) fn joined(points: impl Iterator<Item = (f64, f64)>) -> String {
    let texts: Vec<String> = points.map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    texts.join(" ")
}

/// A task at the start of a caption.
pub(super) fn title(task: Task) -> &'static str {
    match task {
        Task::Dense => "Dense noise",
        Task::Sparse => "Sparse noise",
        Task::Complete => "Completion",
    }
}

/// A name that fits beside a chart.
fn shortened(name: &str) -> String {
    match name.chars().count() {
        0..=19 => escape(name),
        _ => escape(&(name.chars().take(18).collect::<String>() + "…")),
    }
}

/// Round values from 0 to a little above the largest.
fn ticks(most: f64) -> Vec<f64> {
    let power = 10_f64.powf(most.log10().floor());
    let step = [0.2, 0.5, 1.0, 2.0]
        .into_iter()
        .map(|s| s * power)
        .find(|s| most / s <= 5.0)
        .unwrap_or(5.0 * power);
    // Rounded to what the step can say, so that 0.6000000000000001 is 0.6.
    let digits = (1.0 - step.log10()).ceil().max(0.0) as usize;
    (0..=5)
        .map(|i| f64::from(i) * step)
        .take_while(|v| *v <= most)
        .filter_map(|v| format!("{v:.digits$}").parse().ok())
        .collect()
}

fn short(v: f64) -> String {
    super::tables::short(v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::benchmark::summary::{rows, tests::cell};

    #[test]
    fn ticks_are_round() {
        assert_eq!(ticks(3.4), [0.0, 1.0, 2.0, 3.0]);
        assert_eq!(ticks(0.9), [0.0, 0.2, 0.4, 0.6, 0.8]);
        assert_eq!(ticks(12.0), [0.0, 5.0, 10.0]);
        let log = |v: &[f64]| Log::over(v.iter().copied(), 0.0, 100.0).unwrap();
        assert_eq!(log(&[0.02, 0.7]).ticks(), [0.02, 0.05, 0.1, 0.2, 0.5]);
        assert_eq!(log(&[1e-3, 40.0]).ticks(), [1e-3, 1e-2, 0.1, 1.0, 10.0]);
        assert_eq!(log(&[2.5]).ticks(), [2.0, 3.0]);
    }

    #[test]
    fn a_logarithmic_axis_bears_nothing_zero_and_infinity() {
        let over = |v: &[f64]| Log::over(v.iter().copied(), 0.0, 100.0);
        for none in [&[][..], &[0.0], &[f64::NAN, f64::INFINITY, -1.0]] {
            assert!(over(none).is_none());
        }
        let axis = over(&[0.0, 1.0, 10.0]).unwrap();
        for v in [0.0, -1.0, 1.0, 10.0, f64::INFINITY] {
            assert!((0.0..=100.0).contains(&axis.at(v)), "{v}");
        }
        assert!(axis.at(1.0) < axis.at(10.0));
        assert!(over(&[1e-300, 1.0]).unwrap().ticks().len() <= 6);
    }

    #[test]
    fn the_best_have_colours_of_their_own() {
        let cells: Vec<_> = (0..9)
            .map(|m| cell(&format!("m{m}"), 0, Task::Dense, 1.0 + f64::from(9 - m), 30))
            .chain([cell("ksvd:k=1", 0, Task::Dense, 0.1, 30)])
            .collect();
        let rows = rows(&cells);
        let palette = Palette::of(&rows);
        assert_eq!(palette.class("m8"), "k0");
        assert_eq!(palette.class("ksvd:k=1"), "kx");
        assert_eq!(palette.class("m0"), "kx");
        let all: Vec<&SummaryRow> = rows.iter().collect();
        let mut out = String::new();
        errors(&mut out, &palette, Task::Dense, &all);
        assert_eq!(out.matches("class=\"hollow").count(), 10);
        assert!(!out.contains("NaN") && !out.contains("inf"), "{out}");
    }
}
