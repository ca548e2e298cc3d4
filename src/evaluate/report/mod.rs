//! Results of a benchmark as text, CSV, JSON, and one HTML page that needs no other file.
//!
//! The page carries the summary as JSON; its script draws the tables and charts. Equal results give equal bytes. Run
//! times differ between runs and stand in a file of their own.

mod examples;
pub mod paper;
mod tables;

use super::benchmark::config::Settings;
use super::benchmark::dataset::Dataset;
use super::benchmark::examples::ExampleSet;
use super::benchmark::leakage::DuplicateTake;
use super::benchmark::result::{BenchmarkResult, SD_LEVELS};
use super::benchmark::splits::Split;
use super::benchmark::summary::SummaryRow;
use super::html::{escape, fill, script_json};
use super::player;
use crate::pose::ASF_UNIT_CM;
use crate::{Error, Result};
use serde_json::json;

/// The page around tables, charts and figures.
const PAGE: &str = include_str!("report.html");
/// The style of the page and of the players in it.
const STYLE: &str = concat!(
    include_str!("../player/player.css"),
    include_str!("report.css")
);
/// Elements and tables, for the scripts of both pages.
const HELPERS: &str = include_str!("helpers.js");
/// The script that draws tables and charts, after that of the players.
const CHARTS: &str = include_str!("report.js");

/// All results of a benchmark, to be written in several formats.
pub struct BenchmarkReport<'a> {
    /// The poses.
    pub dataset: &'a Dataset,
    /// The settings of the run.
    pub settings: &'a Settings,
    /// Takes that were found to be the same.
    pub duplicates: &'a [DuplicateTake],
    /// One result a case: method, split, seed, task and base noise.
    pub results: &'a [BenchmarkResult],
    /// Means over the seeds, with intervals.
    pub summary: &'a [SummaryRow],
    /// Restored poses for the page's figures.
    pub examples: &'a ExampleSet,
}

impl BenchmarkReport<'_> {
    /// The HTML page.
    ///
    /// # Errors
    /// [`Error::Usage`] if the example poses cannot be damaged or drawn.
    pub fn html(&self) -> Result<String> {
        let script = format!("{}\n{HELPERS}\n{CHARTS}", player::SCRIPT);
        let values = [
            ("facts", escape(&self.facts())),
            ("duplicates", self.duplicates_list()),
            ("examples", self.examples_section()?),
            ("results", script_json(&self.page_data()?)),
            ("keys", player::keys()),
            ("style", STYLE.to_string()),
            ("style-hash", player::policy_hash(STYLE)),
            ("script-hash", player::policy_hash(&script)),
            ("script", script),
            ("version", env!("CARGO_PKG_VERSION").to_string()),
        ];
        let values: Vec<(&str, &str)> = values.iter().map(|(k, v)| (*k, v.as_str())).collect();
        Ok(fill(PAGE, &values))
    }

    /// What the page's script draws: the summary, and the tuning curves of the first seed.
    fn page_data(&self) -> Result<serde_json::Value> {
        let first_seed = self.results.iter().map(|r| r.case.seed).min();
        let tuning: Vec<serde_json::Value> = self
            .results
            .iter()
            .filter(|r| Some(r.case.seed) == first_seed)
            .filter_map(|r| {
                let case = &r.case;
                Some(json!({
                    "split": case.split, "base_asf": case.base_asf, "model": case.model,
                    "task": case.task, "seed": case.seed, "tuning": r.tuning.as_ref()?,
                }))
            })
            .collect();
        let summary =
            serde_json::to_value(self.summary).map_err(|e| Error::usage(e.to_string()))?;
        Ok(json!({
            "asf_cm": ASF_UNIT_CM, "points": self.dataset.points, "gaussian_within": SD_LEVELS,
            "summary": summary, "tuning": tuning,
        }))
    }

    /// The size of the data and of the run, in a sentence.
    fn facts(&self) -> String {
        let several = |n: usize, noun: &str| match n {
            1 => format!("1 {noun}"),
            _ => format!("{n} {noun}s"),
        };
        format!(
            "{} of {}, {}; {}, at most {} test frames each.",
            several(self.dataset.takes.len(), "take"),
            several(self.dataset.subjects().len(), "subject"),
            several(self.dataset.xyz.nrows(), "frame"),
            several(self.settings.seeds as usize, "seed"),
            self.settings.frames,
        )
    }

    fn duplicates_list(&self) -> String {
        let describe = |twin: &DuplicateTake| {
            let text = twin.describe(self.dataset);
            format!("<li>{}</li>", escape(text.trim_end_matches(',')))
        };
        match self.duplicates {
            [] => String::new(),
            twins => format!(
                "<p>Takes that share poses stay on one side of every split by takes or subjects:</p><ul>{}</ul>",
                twins.iter().map(describe).collect::<String>()
            ),
        }
    }

    /// The figures of restored poses; empty without examples.
    fn examples_section(&self) -> Result<String> {
        let figures = examples::figures(self)?;
        let Some(poses) = self.examples.poses.as_ref().filter(|_| !figures.is_empty()) else {
            return Ok(String::new());
        };
        let trained = match poses.split {
            Split::Frames => "The models were trained on about half of these frames.",
            Split::Takes | Split::Subjects => "The models were not trained on these takes.",
        };
        Ok(format!(
            "<section id=\"examples\"><h2>Restored poses</h2><p>Split {}, seed {}. {trained}</p>{figures}</section>",
            poses.split.name(),
            poses.seed
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::benchmark::dataset::tests::takes;
    use crate::evaluate::benchmark::examples::{ExampleKind, ExamplePoses, MethodExamples};
    use crate::evaluate::benchmark::splits::Partition;
    use crate::evaluate::benchmark::summary::{summarize, tests::cell};
    use crate::evaluate::benchmark::task::Task;

    /// A page of two models, with examples.
    fn page() -> String {
        let dataset = takes(&[("01_01", 40), ("01_02", 40)]);
        let settings = Settings::default();
        let mut results = Vec::new();
        for task in Task::ALL {
            for (model, mse) in [("gauss", 1.0), ("<b>&mine</script>", 0.5)] {
                results.extend((0..2).map(|seed| cell(model, seed, task, mse, 30)));
            }
        }
        let part = Partition::draw(&dataset, &[], Split::Takes, 0).unwrap();
        let poses = ExamplePoses::choose(&dataset, &part);
        let methods = ["gauss", "<b>&mine</script>"].map(|model| MethodExamples {
            model: model.into(),
            answers: ExampleKind::of(&settings.tasks)
                .into_iter()
                .map(|kind| {
                    let truth = dataset.rows(poses.rows(kind));
                    let rows = truth.rows().into_iter();
                    (kind.name().to_string(), rows.map(|r| r.to_vec()).collect())
                })
                .collect(),
        });
        let report = BenchmarkReport {
            dataset: &dataset,
            settings: &settings,
            duplicates: &[],
            results: &results,
            summary: &summarize(&results),
            examples: &ExampleSet {
                poses: Some(poses),
                methods: methods.to_vec(),
            },
        };
        report.html().unwrap()
    }

    #[test]
    fn the_page_loads_nothing_and_model_names_cannot_break_it() {
        let page = page();
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
        assert!(page == tests::page());
    }

    #[test]
    fn the_page_carries_the_summary_as_json() {
        let page = page();
        let (_, json) = page.split_once("id=\"results\">").unwrap();
        let json = json.split("</script").next().unwrap();
        let data: serde_json::Value = serde_json::from_str(json).unwrap();
        let summary = data["summary"].as_array().unwrap();
        assert_eq!(
            (
                summary.len(),
                summary.iter().filter(|r| r["best"] == true).count()
            ),
            (6, 3)
        );
        assert_eq!(summary[1]["model"], "<b>&mine</script>");
        assert_eq!(data["points"].as_array().unwrap().len(), 23);
        assert_eq!(
            data["gaussian_within"].as_array().unwrap().len(),
            SD_LEVELS.len()
        );
    }

    #[test]
    fn the_content_policy_names_the_page_sources() {
        let page = page();
        let script = format!("{}\n{HELPERS}\n{CHARTS}", player::SCRIPT);
        for source in [STYLE, &script] {
            assert!(page.contains(&player::policy_hash(source)) && page.contains(source));
            assert!(!source.to_lowercase().contains("</s"));
        }
    }

    #[test]
    fn an_empty_report_makes_a_page() {
        let report = BenchmarkReport {
            dataset: &takes(&[("01_01", 4)]),
            settings: &Settings::default(),
            duplicates: &[],
            results: &[],
            summary: &[],
            examples: &ExampleSet::default(),
        };
        assert!(report.html().unwrap().contains("\"summary\":[]"));
    }
}
