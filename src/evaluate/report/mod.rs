//! The results as one page of HTML that needs nothing else: who is lowest, figures that can be turned, and for each split
//! tables with the best marked and charts. The same results give the same bytes; times are in no page.

mod charts;
mod curves;
mod examples;
mod findings;
pub mod paper;
pub mod reproduction;
pub mod tables;

use crate::Result;
use crate::evaluate::benchmark::result::BenchmarkResult;
use crate::evaluate::benchmark::splits::Split;
use crate::evaluate::benchmark::summary::SummaryRow;
use crate::evaluate::benchmark::task::Task;
use crate::evaluate::html::{escape, fill};
use crate::evaluate::player;
use charts::{Palette, title};
use std::fmt::Write;
use tables::{Results, short};

/// The page around the sections.
const PAGE: &str = include_str!("report.html");
/// Its look, and the players'.
const STYLE: &str = concat!(
    include_str!("../player/player.css"),
    include_str!("report.css")
);

/// The page. The same results give the same bytes.
///
/// # Errors
/// As the examples' scenes.
pub fn html(results: &Results<'_>) -> Result<String> {
    let (mut body, mut contents) = (String::new(), String::new());
    if results.rows.is_empty() {
        body.push_str("<p>Nothing was run.</p>");
    } else {
        lowest(&mut body, results.rows);
        let _ = write!(contents, "<a href=\"#lowest\">Lowest errors</a> ");
    }
    let figures = examples::section(results)?;
    if let Some(scenes) = results
        .examples
        .scenes
        .as_ref()
        .filter(|_| !figures.is_empty())
    {
        let _ = write!(
            body,
            "<section id=\"answers\"><h2>What the models answer</h2><p>Under the split {}, seed {}. {}</p>{figures}</section>",
            scenes.split.name(),
            scenes.seed,
            match scenes.split {
                Split::Frames => "About half of these frames were learnt from.",
                _ => "Nothing of these takes was learnt from.",
            }
        );
        contents.push_str("<a href=\"#answers\">What the models answer</a> ");
    }
    let palette = Palette::of(results.rows);
    let table = |r: &SummaryRow| (r.split, r.base_asf.to_bits());
    for rows in results.rows.chunk_by(|a, b| table(a) == table(b)) {
        let own =
            |c: &&BenchmarkResult| table(&rows[0]) == (c.case.split, c.case.base_asf.to_bits());
        let cells: Vec<BenchmarkResult> = results.cells.iter().filter(own).cloned().collect();
        let id = format!("s{}", contents.matches("<a ").count());
        let name = heading(&rows[0]);
        let _ = write!(contents, "<a href=\"#{id}\">{name}</a> ");
        let _ = write!(body, "<section id=\"{id}\"><h2>{name}</h2>");
        section(&mut body, rows, &cells, &palette, &results.data.points);
        body.push_str("</section>");
    }
    let values = [
        ("facts", escape(&facts(results))),
        ("twins", duplicate_takes(results)),
        ("contents", contents),
        ("body", body),
        ("keys", player::keys()),
        ("style", STYLE.to_string()),
        ("style-hash", player::policy_hash(STYLE)),
        ("script", player::SCRIPT.to_string()),
        ("script-hash", player::policy_hash(player::SCRIPT)),
        ("version", env!("CARGO_PKG_VERSION").to_string()),
    ];
    let values: Vec<(&str, &str)> = values.iter().map(|(k, v)| (*k, v.as_str())).collect();
    Ok(fill(PAGE, &values))
}

/// What was compared on, in a sentence.
fn facts(results: &Results<'_>) -> String {
    let (data, settings) = (results.data, results.settings);
    let several = |n: usize, one: &str| match n {
        1 => format!("1 {one}"),
        _ => format!("{n} {one}s"),
    };
    format!(
        "{} of {}, {}; {}, at most {} test frames each.",
        several(data.takes.len(), "take"),
        several(data.subjects().len(), "subject"),
        several(data.xyz.nrows(), "frame"),
        several(settings.seeds as usize, "seed"),
        settings.frames,
    )
}

fn duplicate_takes(results: &Results<'_>) -> String {
    let mut list = String::new();
    for twin in results.twins {
        let told = twin.describe(results.data);
        let _ = write!(list, "<li>{}</li>", escape(told.trim_end_matches(',')));
    }
    match list.is_empty() {
        true => list,
        false => format!(
            "<p>Found to be one, and kept on one side of every split by takes or subjects:</p><ul>{list}</ul>"
        ),
    }
}

/// A split with its base noise.
fn heading(row: &SummaryRow) -> String {
    let split = match row.split {
        Split::Frames => "Random frames",
        Split::Takes => "Takes held out",
        Split::Subjects => "Subjects held out",
    };
    match row.base_asf {
        0.0 => split.into(),
        b => format!("{split}, {b:.3} asf of noise on what is clean"),
    }
}

/// Who is lowest where, and by how much.
fn lowest(out: &mut String, rows: &[SummaryRow]) {
    out.push_str(
        "<section id=\"lowest\"><h2>Lowest errors</h2><div class=\"wide\"><table><thead><tr><th>split</th><th class=\"name\">task</th>\
         <th class=\"name\">model</th><th>MSE, asf²</th><th>95% interval</th><th>RMS, cm</th><th>over the next best</th>\
         <th>95% interval</th></tr></thead><tbody>",
    );
    let mut before = String::new();
    for row in rows.iter().filter(|r| r.best) {
        let name = heading(row);
        let shown = if name == before { "" } else { &name };
        let (ratio, between) = match &row.to_best_other {
            Some((ratio, [low, high])) => {
                (format!("× {ratio:.2}"), format!("{low:.2} to {high:.2}"))
            }
            None => ("–".into(), "–".into()),
        };
        let _ = write!(
            out,
            "<tr><th>{shown}</th><td class=\"name\">{}</td><td class=\"name\">{}</td><td>{}</td><td class=\"pale\">{} to {}</td><td>{}</td><td>{ratio}</td><td class=\"pale\">{between}</td></tr>",
            row.task.name(),
            escape(&row.model),
            short(row.mse),
            short(row.interval[0]),
            short(row.interval[1]),
            short(row.rms_cm),
        );
        before = name;
    }
    out.push_str(
        "</tbody></table></div><p>The error over that of the best of the others, on the same draws: below 1 is better, and an \
         interval that holds 1 leaves it open.</p></section>",
    );
}

/// A split with a base noise.
fn section(
    out: &mut String,
    rows: &[SummaryRow],
    cells: &[BenchmarkResult],
    palette: &Palette<'_>,
    points: &[String],
) {
    let what = match rows[0].split {
        Split::Frames => {
            "The paper's split: a test frame has its neighbours in time in the training half. Intervals over frames, which are \
             alike, are narrower than they ought to be."
        }
        Split::Takes => "Nothing of a tested take was learnt from.",
        Split::Subjects => "Nothing of a tested person was learnt from.",
    };
    let _ = write!(out, "<p>{what}</p>");
    errors(out, rows);
    let tasks: Vec<(Task, Vec<&SummaryRow>)> = Task::ALL
        .into_iter()
        .map(|t| (t, rows.iter().filter(|r| r.task == t).collect::<Vec<_>>()))
        .filter(|(_, own)| !own.is_empty())
        .collect();
    out.push_str(
        "<h3>Learnt from and unseen</h3><p>MSE in asf², logarithmic: full on unseen poses, with its 95% interval, hollow on \
         poses learnt from. A model that overfits has them far apart.</p><div class=\"charts\">",
    );
    for (task, own) in &tasks {
        charts::errors(out, palette, *task, own);
    }
    out.push_str("</div>");
    curves::sweeps(out, rows);
    out.push_str("<h3>Joints</h3><p>RMS error of a coordinate, cm, on unseen poses.</p><div class=\"charts\">");
    for (task, own) in &tasks {
        charts::by_joint(out, palette, *task, own, points);
    }
    out.push_str(
        "</div><h3>DuplicateEvidence sure the models are</h3><p>Upwards: the share of coordinates that lie within 0.25 to 3 of the \
         deviations that the model states; to the right: a Gaussian's share. On the dashed line what is stated is true, below \
         it the model is too sure, above it not sure enough. Beside each name: within one and two deviations, where 68% and \
         95% ought to be. Exact and constant coordinates do not count.</p><div class=\"charts\">",
    );
    for (task, own) in &tasks {
        charts::calibration(out, palette, *task, own);
    }
    out.push_str("</div>");
    curves::tuning(out, cells);
}

/// The table of errors.
fn errors(out: &mut String, rows: &[SummaryRow]) {
    let tasks: Vec<Task> = Task::ALL
        .into_iter()
        .filter(|t| rows.iter().any(|r| r.task == *t))
        .collect();
    out.push_str("<div class=\"wide\"><table><thead><tr><th>model</th>");
    for task in &tasks {
        let _ = write!(
            out,
            "<th colspan=\"3\" class=\"task\">{}</th>",
            title(*task)
        );
    }
    out.push_str("</tr><tr><th></th>");
    for _ in &tasks {
        out.push_str("<th>MSE, asf²</th><th>RMS, cm</th><th>learnt from</th>");
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
                    let learnt = row.training_mse.map_or("–".into(), short);
                    let _ = write!(
                        out,
                        "<td{class}>{}<br><small>{} to {}</small></td><td>{}</td><td class=\"pale\">{learnt}</td>",
                        short(row.mse),
                        short(row.interval[0]),
                        short(row.interval[1]),
                        short(row.rms_cm),
                    );
                }
                None => out.push_str("<td>–</td><td>–</td><td>–</td>"),
            }
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
    let seeds = rows.iter().map(|r| r.seeds.len()).max().unwrap_or(0);
    let frames = rows.iter().map(|r| r.frames).max().unwrap_or(0);
    let units = rows.iter().map(|r| r.units).max().unwrap_or(0);
    let unit = match rows[0].split {
        Split::Frames => "frames",
        _ => "takes",
    };
    let _ = write!(
        out,
        "<p>{seeds} seed{}, {frames} test poses in all, of {units} different {unit}, which the intervals (95%) are drawn over. \
         Learnt from: the same MSE on poses that were learnt from. The lowest of each task is marked.</p>",
        if seeds == 1 { "" } else { "s" },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::benchmark::config::Settings;
    use crate::evaluate::benchmark::dataset::tests::takes;
    use crate::evaluate::benchmark::examples::{
        ExampleKind, ExamplePoses, ExampleSet, MethodExamples,
    };
    use crate::evaluate::benchmark::splits::Partition;
    use crate::evaluate::benchmark::summary::{rows, tests::cell};

    /// A page of two models, with examples.
    fn page() -> String {
        let data = takes(&[("01_01", 40), ("01_02", 40)]);
        let settings = Settings::default();
        let mut cells = Vec::new();
        for task in Task::ALL {
            for (model, mse) in [("gauss", 1.0), ("<b>&mine", 0.5)] {
                cells.extend((0..2).map(|seed| cell(model, seed, task, mse, 30)));
            }
        }
        let rows = rows(&cells);
        let part = Partition::draw(&data, &[], Split::Takes, 0).unwrap();
        let scenes = ExamplePoses::choose(&data, &part);
        let all = ["gauss", "<b>&mine"].map(|model| MethodExamples {
            model: model.into(),
            answers: ExampleKind::of(&settings.tasks)
                .into_iter()
                .map(|s| {
                    let truth = data.rows(scenes.rows(s));
                    let rows = truth.rows().into_iter();
                    (s.name().to_string(), rows.map(|r| r.to_vec()).collect())
                })
                .collect(),
        });
        let examples = ExampleSet {
            scenes: Some(scenes),
            all: all.to_vec(),
        };
        html(&Results {
            data: &data,
            settings: &settings,
            twins: &[],
            cells: &cells,
            rows: &rows,
            examples: &examples,
        })
        .unwrap()
    }

    #[test]
    fn a_page_holds_every_model_and_nothing_from_outside() {
        let page = page();
        assert!(page.contains("&lt;b&gt;&amp;mine") && !page.contains("<b>&mine"));
        assert_eq!(page.matches("class=\"best\"").count(), 3);
        // Errors, joints and calibration of three tasks.
        assert_eq!(page.matches("<svg viewBox=\"0 0 420").count(), 9);
        // One pose in three tasks, two from two dimensions, a stretch.
        assert_eq!(page.matches("<div class=\"player\">").count(), 6);
        for loading in [
            "http:", "https:", "src=", "url(", "@import", "NaN<", "{{", "style=\"",
        ] {
            assert!(!page.contains(loading), "{loading}");
        }
        for tag in ["section", "table", "figure", "svg", "div", "p", "details"] {
            let body = &page[page.find("<body>").unwrap()..page.rfind("<script>").unwrap()];
            let open = body.matches(&format!("<{tag}>")).count()
                + body.matches(&format!("<{tag} ")).count();
            assert_eq!(open, body.matches(&format!("</{tag}>")).count(), "{tag}");
        }
        assert!(page == super::tests::page());
    }

    #[test]
    fn the_policy_knows_the_pages_own_sources() {
        let page = page();
        for source in [STYLE, player::SCRIPT] {
            assert!(page.contains(&player::policy_hash(source)) && page.contains(source));
            assert!(!source.to_lowercase().contains("</s"));
        }
    }

    #[test]
    fn nothing_makes_a_page() {
        let data = takes(&[("01_01", 4)]);
        let page = html(&Results {
            data: &data,
            settings: &Settings::default(),
            twins: &[],
            cells: &[],
            rows: &[],
            examples: &Default::default(),
        });
        assert!(page.unwrap().contains("Nothing was run."));
    }
}
