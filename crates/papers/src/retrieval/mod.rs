//! How often distances of poses are right, on people that they have not learned from: figures
//! 4 to 8 and Table 2 of Chen et al. 2011.
//!
//! Takes have classes (what is done) and subjects. Distances learn from the takes of some subjects
//! and are tested on the others. Labels come from rules instead of people ([`LabelRule`]).
//! With the rule `class` poses are retrieved across people, and a pose found is right when it is of
//! the query's class; with the others, pairs are decided by the best threshold.

mod labels;
mod methods;
mod pictures;
mod report;
mod score;
mod takes;

pub use labels::LabelRule;
pub use methods::StepSeconds;
pub use report::{Cell, MetricReport, Sheet};
pub use score::{Precision, SCOPES};
pub use takes::{ClassifiedTake, TakeSet};

use crate::Result;
use crate::metric::{JointMap, LabeledPair, PoseMetric};
use methods::{Method, Methods};

/// What is tested.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricSettings {
    /// The rules that label pairs.
    pub rules: Vec<LabelRule>,
    /// The subjects that distances are tested on; of the others they learn.
    pub tested: Vec<String>,
    /// Pairs of each label, to learn from and to test on.
    pub pairs: usize,
    /// The seed of all draws.
    pub seed: u64,
    /// Whether only the published distances are compared, not ranks, numbers of poses, and
    /// learners.
    pub is_short: bool,
}

/// Poses found by two distances, drawn.
const PICTURED: [&str; 2] = ["wjod", "gpd+rdsr"];

/// Tests distances of poses. `progress` is called with what is being done, and how much of the
/// whole is done, 0 to 1.
///
/// # Errors
/// [`crate::Error::Unfit`]: no subject is left to learn from or to test on, or no rule finds pairs.
pub fn test(
    set: &TakeSet,
    map: &JointMap,
    settings: &MetricSettings,
    progress: &mut dyn FnMut(&str, f64),
) -> Result<MetricReport> {
    let [learned, tested] = set.split(&settings.tested);
    if learned.takes.is_empty() || tested.takes.is_empty() {
        return Err(format!(
            "has takes of {}; distances learn from some subjects and are tested on others (the \
             option `test` names them)",
            set.subjects().join(", ")
        )
        .into());
    }
    let mut report = MetricReport {
        learned: learned.subjects(),
        tested: tested.subjects(),
        takes: [learned.takes.len(), tested.takes.len()],
        ..MetricReport::default()
    };
    for (k, rule) in settings.rules.iter().enumerate() {
        let mut trial = match Trial::new(*rule, [&learned, &tested], map, settings) {
            Ok(trial) => trial,
            Err(why) => {
                report.left_out.push(why.to_string());
                continue;
            }
        };
        let share = |part: f64| (k as f64 + part) / settings.rules.len() as f64;
        trial.run(settings, &mut |what, part| progress(what, share(part)))?;
        report.sheets.extend(trial.sheets);
        if report.seconds.is_empty() {
            report.seconds = trial.seconds;
        }
        report.pictures.extend(trial.pictures);
    }
    if report.sheets.is_empty() {
        Err(report.left_out.join("; ").into())
    } else {
        Ok(report)
    }
}

/// The tests of one rule.
struct Trial<'a> {
    rule: LabelRule,
    learned: &'a TakeSet,
    tested: &'a TakeSet,
    map: &'a JointMap,
    /// Pairs to learn from, and to test on.
    pairs: [Vec<LabeledPair>; 2],
    sheets: Vec<Sheet>,
    seconds: StepSeconds,
    pictures: Option<String>,
}

impl<'a> Trial<'a> {
    fn new(
        rule: LabelRule,
        [learned, tested]: [&'a TakeSet; 2],
        map: &'a JointMap,
        settings: &MetricSettings,
    ) -> Result<Trial<'a>> {
        let pairs = [(learned, 1), (tested, 2)].map(|(set, stream)| {
            rule.label(set, settings.pairs, settings.seed.wrapping_mul(8) + stream)
        });
        if pairs.iter().any(Vec::is_empty) {
            return Err(format!(
                "no pairs of both labels are found by the rule {} ({})",
                rule.name(),
                rule.describe()
            )
            .into());
        }
        Ok(Trial {
            rule,
            learned,
            tested,
            map,
            pairs,
            sheets: Vec::new(),
            seconds: Vec::new(),
            pictures: None,
        })
    }

    fn run(
        &mut self,
        settings: &MetricSettings,
        progress: &mut dyn FnMut(&str, f64),
    ) -> Result<()> {
        let methods = Methods::new(self.map, self.rule.reach(), settings.seed);
        let mut tables = vec![("distances (figures 5 and 8)", methods.distances())];
        if !settings.is_short {
            tables.push((
                "features by learners (figure 6)",
                methods.features_by_learners(),
            ));
            tables.push(("rank (figure 4)", methods.ranks()));
            tables.push(("unlabeled poses (figure 7)", methods.unlabeled()));
        }
        let all = tables.iter().map(|(_, m)| m.len()).sum::<usize>() as f64;
        let mut done = 0.0;
        for (title, methods) in tables {
            let mut sheet = Sheet {
                title: format!("{}: {title}", self.rule.name()),
                rule: self.rule,
                head: self.columns(),
                rows: Vec::new(),
            };
            let mut pictured = Vec::new();
            for method in methods {
                progress(
                    &format!("{}: {}", self.rule.name(), method.name),
                    done / all,
                );
                let cells = match self.fit(&method) {
                    Ok(metric) => {
                        let cells = self.score(&metric);
                        if PICTURED.contains(&&*method.name) {
                            pictured.push((method.name.clone(), metric));
                        }
                        cells
                    }
                    Err(why) => vec![Err(why.to_string())],
                };
                sheet.rows.push((method.name, cells));
                done += 1.0;
            }
            self.sheets.push(sheet);
            // Of the first table: a later one has the default again.
            if self.rule == LabelRule::Class && self.pictures.is_none() {
                self.pictures = Some(pictures::draw(&pictured, self.learned, self.tested));
            }
        }
        Ok(())
    }

    fn fit(&mut self, method: &Method) -> Result<PoseMetric> {
        let (metric, seconds) = method.fit(self.map, &self.learned.takes, &self.pairs[0])?;
        if method.name == "gpd+rdsr" && self.seconds.is_empty() {
            self.seconds = seconds;
        }
        Ok(metric)
    }

    fn columns(&self) -> Vec<String> {
        match self.rule {
            LabelRule::Class => SCOPES.map(|s| format!("{s} found")).into(),
            _ => vec!["pairs".into()],
        }
    }

    fn score(&self, metric: &PoseMetric) -> Vec<Cell> {
        let none = || "nothing to judge".to_string();
        match self.rule {
            LabelRule::Class => {
                let found = score::retrieval(metric, self.learned, self.tested);
                found.into_iter().map(|p| p.ok_or_else(none)).collect()
            }
            _ => vec![score::decisions(metric, self.tested, &self.pairs[1]).ok_or_else(none)],
        }
    }
}
