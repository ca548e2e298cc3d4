//! Which of the paper's claims hold, decided from its printed errors and the measured ones.

use super::paper::{Column, Comparison};
use super::tables::short;
use crate::evaluate::benchmark::splits::Split;
use crate::evaluate::benchmark::task::Task;

/// Errors within this factor of the printed ones count as equal.
const SAME_FACTOR: f64 = 2.0;
/// Atoms a pose of the published model: κ in the paper's tables.
const KAPPA: usize = 3;
/// The bound that the caption of Table 4 states, asf².
const TABLE_4_BOUND: f64 = 0.1;
/// The three forms of the paper's model here: as published, with optimised OMP, and the default model in its place.
const OWN: [&str; 3] = ["ksvd-omp", "ksvd", "multiscale+treated"];

/// A claim and the evidence.
pub(super) struct Finding {
    /// The claim, with the table's number.
    pub claim: String,
    /// Whether the claim holds on random frames, the paper's split; `None` if the finding is a measurement only.
    pub holds: Option<bool>,
    /// The evidence, a sentence each.
    pub sentences: Vec<String>,
}

/// All findings that the runs allow.
pub(super) fn findings(paper: &Comparison<'_>) -> Vec<Finding> {
    let run = |c: &&Column| c.run.is_some();
    let of = |tables: std::ops::RangeInclusive<usize>| -> Vec<&Column<'_>> {
        let columns = paper.columns.iter().filter(run);
        columns.filter(|c| tables.contains(&c.table)).collect()
    };
    let (large, small) = (of(1..=1), of(2..=4));
    let mut all = Vec::new();
    if !large.is_empty() {
        let claim = "Table 1: the paper's model has the lowest error in all three tasks";
        all.push(lowest(paper, claim, &large));
    }
    if !small.is_empty() {
        let claim = "Tables 2 to 4: the paper's model has the lowest error for single subjects";
        let mut finding = lowest(paper, claim, &small);
        finding.sentences.insert(0, printed_exceptions(paper));
        all.push(finding);
        all.push(completion_bound(paper, &of(4..=4)));
        all.push(sik_is_worst(paper, &small));
    }
    all.extend(paper.columns.iter().filter_map(|c| magnitudes(paper, c)));
    all.push(held_out_ratio(paper, &of(1..=4)));
    all.extend(best_sparsity(paper));
    all
}

/// The measured errors of the paper's models: (index in [`Comparison::models`], asf²).
fn errors(paper: &Comparison<'_>, column: &Column<'_>, split: Split) -> Vec<(usize, f64)> {
    let models = paper.models.iter().enumerate();
    models
        .filter_map(|(i, m)| Some((i, column.measured(split, &m.method)?)))
        .collect()
}

fn minimum(errors: &[(usize, f64)]) -> Option<(usize, f64)> {
    errors.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Whether the paper's model is below all its rivals in each column, as published or with optimised OMP.
fn lowest(paper: &Comparison<'_>, claim: &str, columns: &[&Column<'_>]) -> Finding {
    let mut holds = None;
    let mut sentences = Vec::new();
    for split in Split::ALL {
        let (mut wins, mut was_run, mut details) = ([0; 3], [false; 3], Vec::new());
        for column in columns {
            let mut rivals = errors(paper, column, split);
            rivals.retain(|(i, _)| paper.models[*i].method != OWN[0]);
            let Some((best, error)) = minimum(&rivals) else {
                continue;
            };
            let own = OWN.map(|method| column.measured(split, method));
            for (k, own) in own.iter().enumerate() {
                wins[k] += usize::from(own.is_some_and(|e| e < error));
                was_run[k] |= own.is_some();
            }
            let [published, optimised, default] = own.map(|v| v.map_or("–".into(), short));
            let column_name = match column.table {
                1 => column.task.name().to_string(),
                _ => format!("{}, {}", column.subject, column.task.name()),
            };
            details.push(format!(
                "{column_name}: best rival {} {}, published {published}, with optimised OMP {optimised}, default here {default}",
                paper.models[best].name,
                short(error),
            ));
        }
        if details.is_empty() {
            continue;
        }
        let cells = details.len();
        if split == Split::Frames {
            holds = Some(wins[0].max(wins[1]) == cells);
        }
        let count = |k: usize| {
            if was_run[k] {
                wins[k].to_string()
            } else {
                "–".into()
            }
        };
        sentences.push(format!(
            "Split {}: below all rivals of the paper in {} of {cells} cells as published, in {} with optimised OMP; the default \
             model here in {}.",
            split.name(),
            count(0),
            count(1),
            count(2)
        ));
        if cells <= 3 {
            sentences.extend(details);
        }
    }
    Finding {
        claim: claim.into(),
        holds,
        sentences,
    }
}

/// Where the printed errors contradict the paper's claim.
fn printed_exceptions(paper: &Comparison<'_>) -> String {
    let mut exceptions = Vec::new();
    for column in paper.columns.iter().filter(|c| c.table > 1) {
        for (i, model) in paper.models.iter().enumerate().skip(1) {
            if let (Some(own), Some(rival)) = (column.printed(0), column.printed(i))
                && rival < own
            {
                exceptions.push(format!(
                    "table {}, {}: {} {rival:.2} below {own:.2}",
                    column.table, column.subject, model.name
                ));
            }
        }
    }
    match exceptions.is_empty() {
        true => "The printed errors have no exception.".into(),
        false => format!(
            "The printed errors have exceptions: {}.",
            exceptions.join("; ")
        ),
    }
}

/// The caption of Table 4: only the paper's model is below [`TABLE_4_BOUND`] for all subjects.
fn completion_bound(paper: &Comparison<'_>, columns: &[&Column<'_>]) -> Finding {
    let (mut holds, mut sentences) = (None, Vec::new());
    for split in [Split::Frames, Split::Takes] {
        let has_errors = |c: &&&Column| !errors(paper, c, split).is_empty();
        let columns: Vec<&&Column> = columns.iter().filter(has_errors).collect();
        if columns.is_empty() {
            continue;
        }
        let below = |method: &str| {
            let error = |c: &&&Column| c.measured(split, method);
            columns
                .iter()
                .all(|c| error(c).is_some_and(|e| e < TABLE_4_BOUND))
        };
        let models = paper.all_models().map(|(_, m)| m);
        let names: Vec<&str> = models
            .filter(|m| below(&m.method))
            .map(|m| m.name.as_str())
            .collect();
        if split == Split::Frames {
            let own = &paper.models[0].name;
            holds = Some(names.iter().all(|n| n.starts_with(own)) && !names.is_empty());
        }
        sentences.push(format!(
            "Split {}, {} subjects: below {TABLE_4_BOUND} for all of them: {}.",
            split.name(),
            columns.len(),
            if names.is_empty() {
                "none".into()
            } else {
                names.join(", ")
            }
        ));
    }
    Finding {
        claim: format!(
            "Table 4: only the paper's model is below {TABLE_4_BOUND} asf² in completion for all subjects"
        ),
        holds,
        sentences,
    }
}

/// Whether SIK has the largest error in most cells.
fn sik_is_worst(paper: &Comparison<'_>, columns: &[&Column<'_>]) -> Finding {
    let sik = paper.models.iter().position(|m| m.method == "sik");
    // Of the cells that have SIK: how many there are, and in how many its error is the largest.
    let count = |all: Vec<Vec<(usize, f64)>>| {
        let cells = all
            .iter()
            .filter(|errors| errors.iter().any(|e| Some(e.0) == sik));
        let worst = |errors: &&Vec<(usize, f64)>| {
            let most = errors.iter().max_by(|a, b| a.1.total_cmp(&b.1));
            most.map(|m| m.0) == sik
        };
        (cells.clone().filter(worst).count(), cells.count())
    };
    let printed = paper.columns.iter().filter(|c| c.table > 1).map(|c| {
        let models = 0..paper.models.len();
        models.filter_map(|m| Some((m, c.printed(m)?))).collect()
    });
    let (printed, printed_cells) = count(printed.collect());
    let measured = columns.iter().map(|c| errors(paper, c, Split::Frames));
    let (measured, cells) = count(measured.collect());
    Finding {
        claim: "Tables 2 to 4: SIK, whose active set is small, has the largest error".into(),
        holds: (cells > 0).then_some(2 * measured > cells),
        sentences: vec![
            format!("The paper: the largest error in {printed} of {printed_cells} lines."),
            format!("Here, on random frames: in {measured} of {cells} cells."),
        ],
    }
}

/// Measured errors divided by the printed ones of a column, and whether the order of the models is the same.
fn magnitudes(paper: &Comparison<'_>, column: &Column<'_>) -> Option<Finding> {
    let measured = errors(paper, column, Split::Frames).into_iter();
    let pairs: Vec<(usize, f64, f64)> = measured
        .filter_map(|(i, error)| Some((i, error, column.printed(i)?)))
        .collect();
    if pairs.len() < 2 {
        return None;
    }
    let same = |p: &&(usize, f64, f64)| (p.1 / p.2).ln().abs() <= SAME_FACTOR.ln();
    let agree = pairs.iter().filter(same).count();
    let ratios: Vec<String> = pairs
        .iter()
        .map(|(i, here, there)| {
            let (ratio, here) = (short(here / there), short(*here));
            format!(
                "{} × {ratio} ({here} for {there:.2})",
                paper.models[*i].name
            )
        })
        .collect();
    let subject = match column.table {
        1 => String::new(),
        _ => format!("subject {}, ", column.subject),
    };
    Some(Finding {
        claim: format!(
            "Table {}, {subject}{}: magnitudes",
            column.table,
            column.task.name()
        ),
        holds: Some(2 * agree > pairs.len()),
        sentences: vec![
            format!(
                "Within a factor of {SAME_FACTOR} of the paper's: {agree} of {} models; rank correlation of the models {:.2}.",
                pairs.len(),
                spearman(&pairs)
            ),
            ratios.join("; "),
        ],
    })
}

/// Spearman's rank correlation of the second and third entries; ties share their mean rank.
fn spearman(pairs: &[(usize, f64, f64)]) -> f64 {
    let ranks = |values: Vec<f64>| -> Vec<f64> {
        let rank = |v: &f64| {
            let below = values.iter().filter(|o| *o < v).count() as f64;
            let same = values.iter().filter(|o| *o == v).count() as f64;
            below + (same - 1.0) / 2.0
        };
        values.iter().map(rank).collect()
    };
    let a = ranks(pairs.iter().map(|p| p.1).collect());
    let b = ranks(pairs.iter().map(|p| p.2).collect());
    let mean = (pairs.len() as f64 - 1.0) / 2.0;
    let product = |x: &[f64], y: &[f64]| -> f64 {
        let both = x.iter().zip(y);
        both.map(|(x, y)| (x - mean) * (y - mean)).sum()
    };
    let norm = (product(&a, &a) * product(&b, &b)).sqrt();
    if norm > 0.0 {
        product(&a, &b) / norm
    } else {
        0.0
    }
}

/// How much larger each model's error is on held-out takes than on random frames.
fn held_out_ratio(paper: &Comparison<'_>, columns: &[&Column<'_>]) -> Finding {
    let mut ratios: Vec<(&str, f64, usize)> = Vec::new();
    for (_, model) in paper.all_models() {
        let logs: Vec<f64> = columns
            .iter()
            .filter_map(|c| {
                let error = |split| c.measured(split, &model.method).filter(|e| *e > 0.0);
                Some((error(Split::Takes)? / error(Split::Frames)?).ln())
            })
            .collect();
        if !logs.is_empty() {
            let mean = logs.iter().sum::<f64>() / logs.len() as f64;
            ratios.push((&model.name, mean.exp(), logs.len()));
        }
    }
    ratios.sort_by(|a, b| a.1.total_cmp(&b.1));
    let texts = ratios
        .iter()
        .map(|(name, ratio, _)| format!("{name} × {}", short(*ratio)));
    let texts: Vec<String> = texts.collect();
    let sentence = match ratios.iter().map(|r| r.2).max() {
        None => "No run has both splits.".into(),
        Some(count) => format!(
            "Error on held-out takes divided by that on random frames, geometric mean over {count} cells: {}.",
            texts.join(", ")
        ),
    };
    Finding {
        claim: "The paper's split: a test frame has its neighbours in time in the training half"
            .into(),
        holds: None,
        sentences: vec![sentence],
    }
}

/// The published model at other sparsities, if a run has them: the paper searches κ, its tables here have 3.
fn best_sparsity(paper: &Comparison<'_>) -> Option<Finding> {
    let method = OWN[1];
    let mut names: Vec<(String, usize)> =
        (1..=100).map(|k| (format!("{method}:k={k}"), k)).collect();
    names.push((method.to_string(), KAPPA));
    let mut sentences = Vec::new();
    for run in paper.runs {
        for split in run.splits() {
            let mut best = Vec::new();
            for task in Task::ALL {
                let error =
                    |(name, k): &(String, usize)| Some((*k, run.row(split, task, name)?.mse));
                let rows: Vec<(usize, f64)> = names.iter().filter_map(error).collect();
                if let Some((k, error)) = minimum(&rows).filter(|_| rows.len() > 1) {
                    best.push(format!("{} {} (κ = {k})", task.name(), short(error)));
                }
            }
            if !best.is_empty() {
                let (subjects, split) = (run.subjects().join(", "), split.name());
                sentences.push(format!(
                    "Subject {subjects}, split {split}: {}.",
                    best.join(", ")
                ));
            }
        }
    }
    let claim = "The paper searches κ: the lowest error over the sparsities run, with optimised OMP (chosen on the test poses, \
                 so a lower bound)";
    (!sentences.is_empty()).then(|| Finding {
        claim: claim.into(),
        holds: None,
        sentences,
    })
}

#[cfg(test)]
mod tests {
    use super::super::paper::tests::run;
    use super::*;

    #[test]
    fn claims_are_decided_from_the_errors() {
        let decide = |ours: f64| {
            let errors = [
                ("ksvd-omp", ours),
                ("mfa", 0.11),
                ("gaussian", 0.2),
                ("sik", 3.0),
                ("ksvd", 0.3),
                ("ksvd:k=5", 0.02),
            ];
            let runs = [run(&["07"], &errors), run(&["01", "07"], &errors)];
            let paper = Comparison::new(&runs).unwrap();
            let all = findings(&paper);
            let find = |start: &str| {
                let found = all.iter().find(|f| f.claim.starts_with(start)).unwrap();
                (found.holds, found.sentences.join(" "))
            };
            assert_eq!(find("Tables 2 to 4: SIK").0, Some(true));
            let (_, best) = find("The paper searches");
            assert!(
                best.contains("dense 0.0") && best.contains("(κ = 5)"),
                "{best}"
            );
            // Errors double on held-out takes.
            let (_, ratio) = find("The paper's split");
            assert!(ratio.contains("MFA × 2.0"), "{ratio}");
            // PCA is lower for 09 in Table 4, as the paper prints it.
            let (_, lowest) = find("Tables 2 to 4: the paper's model");
            assert!(
                lowest.contains("table 4, 09: PCA 0.05 below 0.09"),
                "{lowest}"
            );
            ["Table 1: the paper's", "Table 4:", "Table 4, subject 07"].map(find)
        };
        let [first, bound, magnitudes] = decide(0.04);
        assert_eq!([first.0, bound.0, magnitudes.0], [Some(true); 3]);
        assert!(
            magnitudes.1.contains("rank correlation"),
            "{}",
            magnitudes.1
        );
        let [first, bound, _] = decide(0.5);
        assert_eq!((first.0, bound.0), (Some(false), Some(false)));
    }

    #[test]
    fn ranks_correlate() {
        let pairs = |b: [f64; 4]| -> Vec<(usize, f64, f64)> {
            (0..4).map(|i| (i, i as f64, b[i])).collect()
        };
        assert!((spearman(&pairs([1.0, 2.0, 5.0, 9.0])) - 1.0).abs() <= 1e-12);
        assert!((spearman(&pairs([9.0, 5.0, 2.0, 1.0])) + 1.0).abs() <= 1e-12);
        assert_eq!(spearman(&pairs([1.0; 4])), 0.0);
    }
}
