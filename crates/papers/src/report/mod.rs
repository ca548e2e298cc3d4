//! Results of a benchmark as text, CSV, JSON, and one HTML page that needs no other file.
//!
//! The page carries the summary as JSON; its script draws the tables and charts. Equal results give
//! equal bytes. Run times differ between runs and stand in a file of their own.

mod examples;
pub mod paper;
mod tables;

use super::benchmark::dataset::Dataset;
use super::benchmark::leakage::DuplicateTake;
use super::benchmark::result::BenchmarkResult;
use super::benchmark::runner::Benchmark;
use super::benchmark::splits::Split;
use super::benchmark::summary::{SummaryRow, summarize};
use crate::Result;
use crate::draw::html::{page, script_json};
use crate::draw::plain_page::STYLE;
use crate::draw::player;
use crate::pose::ASF_UNIT_CM;
use crate::score::error_stats::SD_LEVELS;
use serde_json::json;
pub(super) use tables::quoted;

/// The page around tables, charts and figures.
const PAGE: &str = include_str!("report.html");
/// Elements and tables, for the scripts of both pages.
const HELPERS: &str = include_str!("helpers.js");
/// The script that draws tables and charts, after that of the players.
const CHARTS: &str = include_str!("report.js");

/// All results of a benchmark, to be written in several formats.
pub struct BenchmarkReport<'a> {
    benchmark: &'a Benchmark<'a>,
    /// One result a case: method, split, seed, task and base noise.
    results: Vec<BenchmarkResult>,
    /// Means over the seeds, with intervals.
    summary: Vec<SummaryRow>,
}

impl<'a> BenchmarkReport<'a> {
    /// A report of the results that a benchmark returned.
    pub fn new(benchmark: &'a Benchmark<'a>, results: Vec<BenchmarkResult>) -> Self {
        BenchmarkReport {
            benchmark,
            summary: summarize(&results),
            results,
        }
    }

    fn dataset(&self) -> &Dataset {
        self.benchmark.dataset
    }

    /// The HTML page.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage) if the example poses cannot be damaged or drawn.
    pub fn html(&self) -> Result<String> {
        let script = format!("{}\n{HELPERS}\n{CHARTS}", *player::SCRIPT);
        let values = [
            ("examples", &*self.examples_section()?),
            ("results", &script_json(&self.page_data())),
            ("keys", &player::keys()),
        ];
        Ok(page(PAGE, STYLE, &script, &values))
    }

    /// What the page's script draws: the size of the run, the summary, and the tuning curves of the
    /// first seed.
    fn page_data(&self) -> serde_json::Value {
        let (data, settings) = (self.dataset(), &self.benchmark.settings);
        let tuning: Vec<serde_json::Value> = self
            .results
            .iter()
            .filter(|r| r.case.seed == settings.first_seed)
            .filter_map(|r| {
                let case = &r.case;
                Some(json!({
                    "split": case.split, "base_asf": case.base_asf, "model": case.model,
                    "task": case.task, "seed": case.seed, "tuning": r.tuning.as_ref()?,
                }))
            })
            .collect();
        let describe = |twin: &DuplicateTake| twin.describe(data).trim_end_matches(',').to_string();
        let duplicates = self.benchmark.duplicates.iter().map(describe);
        json!({
            "takes": data.takes.len(), "subjects": data.subjects().len(),
            "frames": data.xyz.nrows(),
            "seeds": settings.seeds, "test_frames": settings.frames,
            "duplicates": duplicates.collect::<Vec<_>>(),
            "asf_cm": ASF_UNIT_CM, "points": data.points, "gaussian_within": SD_LEVELS,
            "summary": self.summary, "tuning": tuning,
        })
    }

    /// The figures of restored poses; empty without examples.
    fn examples_section(&self) -> Result<String> {
        let Some(poses) = &self.benchmark.example_poses else {
            return Ok(String::new());
        };
        let figures = examples::figures(self, poses)?;
        let trained = match poses.split {
            Split::Frames => "The models were trained on about half of these frames.",
            Split::Takes | Split::Subjects => "The models were not trained on these takes.",
        };
        Ok(format!(
            "<section id=\"examples\"><h2>Restored poses</h2><p>Split {}, seed {}. \
             {trained}</p>{figures}</section>",
            poses.split.name(),
            poses.seed
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::dataset::tests::takes;
    use crate::benchmark::examples::ExampleKind;
    use crate::benchmark::method::Method;
    use crate::benchmark::settings::Settings;
    use crate::benchmark::summary::tests::cell;
    use crate::benchmark::task::Task;

    /// Calls `check` with a report of models with falling errors, two seeds each; the first seed
    /// has examples.
    pub(crate) fn with_report(models: &[&str], check: impl Fn(&BenchmarkReport<'_>)) {
        crate::published::register();
        let dataset = takes(&[("01_01", 40), ("01_02", 40)]);
        let settings = Settings {
            methods: vec![Method::parse("gaussian").unwrap()],
            splits: vec![Split::Frames],
            seeds: 2,
            examples: true,
            ..Settings::default()
        };
        let observe = settings.observe.clone();
        let benchmark = Benchmark::new(&dataset, settings).unwrap();
        let poses = benchmark.example_poses.as_ref().unwrap();
        let mut results = Vec::new();
        for task in Task::ALL {
            let example = |kind: ExampleKind| {
                let truth = poses.damaged(&dataset, &observe, kind).unwrap().truth;
                let rows = truth.rows().into_iter().map(|r| r.to_vec()).collect();
                (kind.name().to_string(), rows)
            };
            for (k, model) in models.iter().enumerate() {
                let mut cells =
                    [0, 1].map(|seed| cell(model, seed, task, 0.5_f64.powi(k as i32), 30));
                let kinds = ExampleKind::of(task).into_iter();
                cells[0].examples = Some(kinds.map(example).collect());
                results.extend(cells);
            }
        }
        check(&BenchmarkReport::new(&benchmark, results));
    }

    /// A page of two models, with examples.
    fn with_page(check: impl Fn(&str)) {
        with_report(&["gauss", "<b>&mine</script>"], |report| {
            check(&report.html().unwrap())
        });
    }

    #[test]
    fn the_page_loads_nothing_and_model_names_cannot_break_it() {
        with_page(|page| {
            assert!(!page.contains("<b>") && !page.contains("mine</script"));
            // One pose in three tasks, two from two dimensions, one take.
            assert_eq!(page.matches("<div class=\"player\">").count(), 6);
            for loading in [
                "http:", "https:", "src=", "url(", "@import", "{{", "style=\"",
            ] {
                assert!(!page.contains(loading), "{loading}");
            }
            let body = &page[page.find("<body>").unwrap()..page.rfind("<script>").unwrap()];
            for tag in ["section", "figure", "div", "p", "header", "main"] {
                let open = body.matches(&format!("<{tag}>")).count()
                    + body.matches(&format!("<{tag} ")).count();
                assert_eq!(open, body.matches(&format!("</{tag}>")).count(), "{tag}");
            }
            with_page(|again| assert!(page == again));
        });
    }

    #[test]
    fn the_page_carries_the_summary_as_json() {
        with_page(|page| {
            let (_, json) = page.split_once("id=\"results\">").unwrap();
            let json = json.split("</script").next().unwrap();
            let data: serde_json::Value = serde_json::from_str(json).unwrap();
            let summary = data["summary"].as_array().unwrap();
            let best = summary.iter().filter(|r| r["best"] == true).count();
            assert_eq!((summary.len(), best), (6, 3));
            assert_eq!(summary[1]["model"], "<b>&mine</script>");
            assert_eq!(data["points"].as_array().unwrap().len(), 23);
            let levels = data["gaussian_within"].as_array().unwrap();
            assert_eq!(levels.len(), SD_LEVELS.len());
        });
    }

    #[test]
    fn the_content_policy_names_the_page_sources() {
        let script = format!("{}\n{HELPERS}\n{CHARTS}", *player::SCRIPT);
        with_page(|page| {
            for source in [STYLE, &script] {
                assert!(
                    page.contains(&crate::draw::html::policy_hash(source)) && page.contains(source)
                );
                assert!(!source.to_lowercase().contains("</s"));
            }
        });
    }

    #[test]
    fn an_empty_report_makes_a_page() {
        with_report(&[], |report| {
            assert!(report.html().unwrap().contains("\"summary\":[]"));
            assert_eq!(report.text(), "");
        });
    }
}
