//! The results as one page of HTML that needs nothing else: tables with the best marked, error by joint, training error
//! against test error, calibration. Charts are SVG in the page's own colours, light and dark.

use super::cell::WITHIN;
use super::splits::Split;
use super::summary::Row;
use super::tables::Results;
use super::tasks::Task;
use crate::evaluate::markup::{escape, fill};
use std::fmt::Write;

/// The page around the sections.
const PAGE: &str = include_str!("report.html");
/// Models drawn in a chart of lines at most: more cannot be told apart.
const MOST_LINES: usize = 6;

/// The page. The same results give the same bytes.
pub fn html(results: &Results<'_>) -> String {
    let mut body = String::new();
    let table = |r: &Row| (r.split, r.base_asf.to_bits());
    for rows in results.rows.chunk_by(|a, b| table(a) == table(b)) {
        section(&mut body, rows, &results.data.points);
    }
    if body.is_empty() {
        body.push_str("<p>Nothing was run.</p>");
    }
    let data = results.data;
    let facts = format!(
        "{} takes of {} subjects, {} frames; {} seeds, at most {} test frames each.",
        data.takes.len(),
        data.subjects().len(),
        data.xyz.nrows(),
        results.settings.seeds,
        results.settings.frames,
    );
    let mut twins = String::new();
    for twin in results.twins {
        let _ = write!(
            twins,
            "<li>{}</li>",
            escape(twin.tell(data).trim_end_matches(','))
        );
    }
    if !twins.is_empty() {
        twins = format!(
            "<p>Found to be one, and kept on one side of every split by takes or subjects:</p><ul>{twins}</ul>"
        );
    }
    let version = env!("CARGO_PKG_VERSION");
    let values = [
        ("facts", escape(&facts)),
        ("twins", twins),
        ("body", body),
        ("version", version.to_string()),
    ];
    let values: Vec<(&str, &str)> = values.iter().map(|(k, v)| (*k, v.as_str())).collect();
    fill(PAGE, &values)
}

/// A split with a base noise.
fn section(out: &mut String, rows: &[Row], points: &[String]) {
    let first = &rows[0];
    let (title, what) = match first.split {
        Split::Frames => (
            "Random frames",
            "The paper's split: a test frame has its neighbours in time in the training half.",
        ),
        Split::Takes => (
            "Takes held out",
            "Nothing of a tested take was learnt from.",
        ),
        Split::Subjects => (
            "Subjects held out",
            "Nothing of a tested person was learnt from.",
        ),
    };
    let base = match first.base_asf {
        0.0 => String::new(),
        b => format!(", {b:.3} asf of noise on what is clean"),
    };
    let _ = write!(out, "<section><h2>{title}{base}</h2><p>{what}</p>");
    errors(out, rows);
    out.push_str("<div class=\"charts\">");
    for task in Task::ALL {
        let own: Vec<&Row> = rows.iter().filter(|r| r.task == task).collect();
        if own.is_empty() {
            continue;
        }
        by_joint(out, task, &own, points);
        calibration(out, task, &own);
    }
    out.push_str("</div></section>");
}

/// The table of errors.
fn errors(out: &mut String, rows: &[Row]) {
    let tasks: Vec<Task> = Task::ALL
        .into_iter()
        .filter(|t| rows.iter().any(|r| r.task == *t))
        .collect();
    out.push_str("<div class=\"wide\"><table><thead><tr><th>model</th>");
    for task in &tasks {
        let _ = write!(out, "<th colspan=\"2\">{}</th>", task.name());
    }
    out.push_str("</tr><tr><th></th>");
    for _ in &tasks {
        out.push_str("<th>unseen</th><th>learnt from</th>");
    }
    out.push_str("</tr></thead><tbody>");
    let mut models: Vec<&str> = Vec::new();
    for row in rows {
        if !models.contains(&row.model.as_str()) {
            models.push(&row.model);
        }
    }
    for model in models {
        let _ = write!(out, "<tr><th>{}</th>", escape(model));
        for task in &tasks {
            match rows.iter().find(|r| r.model == model && r.task == *task) {
                Some(row) => {
                    let class = if row.best { " class=\"best\"" } else { "" };
                    let learnt = row.training_mse.map_or("–".into(), number);
                    let _ = write!(
                        out,
                        "<td{class}>{} <small>{} to {}</small></td><td class=\"pale\">{learnt}</td>",
                        number(row.mse),
                        number(row.interval[0]),
                        number(row.interval[1]),
                    );
                }
                None => out.push_str("<td>–</td><td>–</td>"),
            }
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
}

/// The rows with the lowest errors, lowest first.
fn leading<'r>(rows: &[&'r Row]) -> Vec<&'r Row> {
    let mut rows = rows.to_vec();
    rows.sort_by(|a, b| a.mse.total_cmp(&b.mse));
    rows.truncate(MOST_LINES);
    rows
}

/// The names of the lines.
fn legend(out: &mut String, rows: &[&Row]) {
    out.push_str("<p class=\"legend\">");
    for (i, row) in rows.iter().enumerate() {
        let _ = write!(
            out,
            "<span><i class=\"k{i}\"></i>{}</span> ",
            escape(&row.model)
        );
    }
    out.push_str("</p>");
}

/// RMS by joint as dots on lines, a line a joint.
fn by_joint(out: &mut String, task: Task, rows: &[&Row], points: &[String]) {
    let rows = leading(rows);
    let rms = |v: f64| v.max(0.0).sqrt() * crate::pose::ASF_UNIT_CM;
    let all = rows.iter().flat_map(|r| r.by_joint.iter().map(|v| rms(*v)));
    let most = all.fold(0.1_f64, f64::max);
    let (left, width, step) = (96.0, 250.0, 15.0);
    let height = 20.0 + step * points.len() as f64;
    let x = |v: f64| left + v / most * width;
    let _ = write!(
        out,
        "<figure><figcaption>{}: RMS error by joint, cm</figcaption><svg viewBox=\"0 0 360 {height}\" role=\"img\">",
        task.name()
    );
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
            left - 6.0,
            y + 3.5,
            escape(point)
        );
        // The best is drawn last, on top.
        for (i, row) in rows.iter().enumerate().rev() {
            if let Some(v) = row
                .by_joint
                .get(j)
                .map(|v| rms(*v))
                .filter(|v| v.is_finite())
            {
                let _ = write!(
                    out,
                    "<circle class=\"k{i}\" cx=\"{:.1}\" cy=\"{y:.1}\" r=\"3.2\"/>",
                    x(v)
                );
            }
        }
    }
    out.push_str("</svg>");
    legend(out, &rows);
    out.push_str("</figure>");
}

/// The share of coordinates within each multiple of the stated deviation, against a Gaussian's.
fn calibration(out: &mut String, task: Task, rows: &[&Row]) {
    let rows: Vec<&Row> = leading(rows)
        .into_iter()
        .filter(|r| !r.within.is_empty())
        .collect();
    if rows.is_empty() {
        return;
    }
    let (left, top, size) = (40.0, 10.0, 280.0);
    let at = |x: f64, y: f64| (left + size * x, top + size * (1.0 - y));
    let _ = write!(
        out,
        "<figure><figcaption>{}: share of coordinates within the stated deviations, against what ought to be</figcaption><svg viewBox=\"0 0 360 330\" role=\"img\">",
        task.name()
    );
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
    for (i, row) in rows.iter().enumerate().rev() {
        let pairs = WITHIN
            .iter()
            .zip(&row.within)
            .map(|((_, ought), is)| at(*ought, *is));
        let line: Vec<String> = std::iter::once(at(0.0, 0.0))
            .chain(pairs)
            .map(|(x, y)| format!("{x:.1},{y:.1}"))
            .collect();
        let _ = write!(
            out,
            "<polyline class=\"k{i}\" points=\"{}\"/>",
            line.join(" ")
        );
    }
    out.push_str("</svg>");
    legend(out, &rows);
    out.push_str("</figure>");
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

fn number(v: f64) -> String {
    super::tables::short(v)
}

#[cfg(test)]
mod tests {
    use super::super::data::tests::takes;
    use super::super::settings::Settings;
    use super::super::summary::{rows, tests::cell};
    use super::*;

    #[test]
    fn a_page_holds_every_model_and_nothing_from_outside() {
        let data = takes(&[("01_01", 4), ("01_02", 4)]);
        let settings = Settings::default();
        let mut cells = Vec::new();
        for task in Task::ALL {
            for (model, mse) in [("gauss", 1.0), ("<b>&mine", 0.5)] {
                cells.extend((0..2).map(|seed| cell(model, seed, task, mse, 30)));
            }
        }
        let rows = rows(&cells);
        let page = html(&Results {
            data: &data,
            settings: &settings,
            twins: &[],
            cells: &cells,
            rows: &rows,
        });
        assert!(page.contains("&lt;b&gt;&amp;mine") && !page.contains("<b>&mine"));
        assert_eq!(page.matches("class=\"best\"").count(), 3);
        assert_eq!(page.matches("<svg").count(), 6);
        assert!(!page.contains("http") && !page.contains("NaN") && !page.contains("{{"));
        for tag in ["section", "table", "figure", "svg", "div", "p"] {
            let open = page.matches(&format!("<{tag}>")).count()
                + page.matches(&format!("<{tag} ")).count();
            assert_eq!(open, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(ticks(3.4), [0.0, 1.0, 2.0, 3.0]);
        assert_eq!(ticks(0.9), [0.0, 0.2, 0.4, 0.6, 0.8]);
        assert_eq!(ticks(12.0), [0.0, 5.0, 10.0]);
    }
}
