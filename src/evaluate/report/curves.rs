//! Error against sparsity and against the size of the dictionary, and the tuning curves.

use super::charts::{Line, Log, joined, lines, title};
use super::tables::short;
use crate::evaluate::benchmark::method::{Method, ModelSource, TREATED};
use crate::evaluate::benchmark::result::BenchmarkResult;
use crate::evaluate::benchmark::summary::SummaryRow;
use crate::evaluate::benchmark::task::Task;
use crate::evaluate::html::escape;
use crate::prior::tuning::ASF2;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Atoms a pose that a published dictionary takes where a name does not say: the paper's.
const KAPPA: usize = 3;

/// What a name says of a dictionary.
struct Named {
    kind: String,
    atoms: Option<usize>,
    sparsity: Option<usize>,
}

/// Reads the name of a sparse method.
fn named(name: &str) -> Option<Named> {
    let method = Method::parse(name).ok()?;
    let ModelSource::Kind { kind, atoms } = &method.source else {
        return None;
    };
    if kind != "sparse" {
        return None;
    }
    let kind = name.split([':', '+']).next().unwrap_or_default();
    // `sparse` finds its own sparsity where none is named.
    let usual = (kind != "sparse").then_some(KAPPA);
    let treated = if method.treated { TREATED } else { "" };
    Some(Named {
        kind: format!("{kind}{treated}"),
        atoms: *atoms,
        sparsity: method.choice.sparsity.or(usual),
    })
}

/// What a dictionary's error is drawn against.
type Place = dyn Fn(&Named) -> Option<(String, usize)>;

/// Charts of the rows of one split and base noise, where dictionaries of several sizes or sparsities were run.
pub(super) fn sweeps(out: &mut String, rows: &[SummaryRow]) {
    let by_sparsity = |n: &Named| {
        let size = n.atoms.map(|a| format!(", {a} atoms")).unwrap_or_default();
        Some((format!("{}{size}", n.kind), n.sparsity?))
    };
    let by_size = |n: &Named| {
        let sparsity = n.sparsity.map(|k| format!(", {k} a pose"));
        let name = format!("{}{}", n.kind, sparsity.unwrap_or_default());
        Some((name, n.atoms?))
    };
    let both: [(&str, &Place); 2] = [
        ("Error against sparsity (atoms a pose)", &by_sparsity),
        ("Error against the size of the dictionary (atoms)", &by_size),
    ];
    for (title_of, place) in both {
        let mut charts = String::new();
        for task in Task::ALL {
            let own: Vec<(&SummaryRow, Named)> = rows
                .iter()
                .filter(|r| r.task == task)
                .filter_map(|r| named(&r.model).map(|n| (r, n)))
                .collect();
            let label = format!("{}: {title_of}", title(task));
            lines(&mut charts, title(task), &label, &gathered(&own, place));
        }
        if !charts.is_empty() {
            let _ = write!(
                out,
                "<h3>{title_of}</h3><p>MSE in asf², both axes logarithmic: on unseen poses with 95% intervals, dashed on poses \
                 learnt from.</p><div class=\"charts\">{charts}</div>"
            );
        }
    }
}

/// Lines of two points or more: rows by the name of their line and their place along it.
fn gathered(rows: &[(&SummaryRow, Named)], place: &Place) -> Vec<Line> {
    let mut found: BTreeMap<String, BTreeMap<usize, &SummaryRow>> = BTreeMap::new();
    for (row, named) in rows {
        if let Some((line, at)) = place(named) {
            found.entry(line).or_default().insert(at, row);
        }
    }
    found.retain(|_, points| points.len() > 1);
    let line = |(name, points): (String, BTreeMap<usize, &SummaryRow>)| Line {
        name,
        points: points
            .into_iter()
            .map(|(at, r)| (at as f64, r.mse, r.interval, r.training_mse))
            .collect(),
    };
    found.into_iter().map(line).collect()
}

/// A setting that was tried: inflation, noise (asf²), error (asf²).
type Tried = (f64, f64, f64);

/// What a cell's tuning says.
struct Curve {
    task: Task,
    tried: Vec<Tried>,
    /// Inflation and noise (asf²).
    chosen: Option<(f64, f64)>,
}

/// It, where it says something that can be drawn.
fn curve(cell: &BenchmarkResult) -> Option<Curve> {
    let tuning = cell.tuning.as_ref()?;
    let number = |v: &Value, key: &str| v.get(key).and_then(Value::as_f64);
    let setting = |v: &Value| Some((number(v, "inflation")?, number(v, "noise")? / ASF2));
    let one = |v: &Value| {
        let (inflation, noise) = setting(v)?;
        Some((inflation, noise, number(v, "mse")? / ASF2))
    };
    let curve = tuning.get("curve")?.as_array()?;
    let tried: Vec<Tried> = curve.iter().filter_map(one).collect();
    let chosen = tuning.get("chosen").and_then(setting);
    (!tried.is_empty()).then_some(Curve {
        task: cell.case.task,
        tried,
        chosen,
    })
}

/// A small chart a tuned model: the error of held-back training poses against the inflation, a line a task; `cells` are
/// those of one split and base noise.
pub(super) fn tuning(out: &mut String, cells: &[BenchmarkResult]) {
    let Some(seed) = cells.iter().map(|c| c.case.seed).min() else {
        return;
    };
    let mut models: Vec<&str> = Vec::new();
    for cell in cells.iter().filter(|c| c.tuning.is_some()) {
        if !models.contains(&cell.case.model.as_str()) {
            models.push(&cell.case.model);
        }
    }
    let mut charts = String::new();
    for model in models {
        let own: Vec<&BenchmarkResult> = cells
            .iter()
            .filter(|c| c.case.model == model && c.case.seed == seed)
            .collect();
        one_tuning(&mut charts, model, &own);
    }
    if charts.is_empty() {
        return;
    }
    let _ = write!(
        out,
        "<details><summary>DuplicateEvidence each was tuned</summary><p>A model's covariance is multiplied by an inflation (1 / λ; where a \
         model has none it is its own width), and where noise is not told an equal noise of every coordinate is assumed. Both \
         are searched on a part of the training poses that is held back, by task; test poses are never seen. Upwards: MSE of \
         the held-back poses in asf², with the best noise at each inflation (to the right), both logarithmic; the ring is what \
         was chosen. Seed {seed}; the others, and every noise, are in results.json.</p><p class=\"legend\"><span><i \
         class=\"k0\"></i>dense</span> <span><i class=\"k1\"></i>sparse</span> <span><i \
         class=\"k2\"></i>complete</span></p><div class=\"charts small\">{charts}</div></details>"
    );
}

fn one_tuning(out: &mut String, model: &str, cells: &[&BenchmarkResult]) {
    let all: Vec<Curve> = cells.iter().filter_map(|c| curve(c)).collect();
    // The best noise at each inflation.
    let envelope = |curve: &[Tried]| {
        let mut best: Vec<(f64, f64)> = Vec::new();
        for (inflation, _, mse) in curve {
            match best.iter_mut().find(|b| b.0 == *inflation) {
                Some(b) => b.1 = b.1.min(*mse),
                None => best.push((*inflation, *mse)),
            }
        }
        best.sort_by(|a, b| a.0.total_cmp(&b.0));
        best
    };
    let points = || all.iter().flat_map(|c| envelope(&c.tried));
    let (left, right, top, bottom) = (44.0, 232.0, 8.0, 132.0);
    let (Some(across), Some(up)) = (
        Log::over(points().map(|p| p.0), left, right),
        Log::over(points().map(|p| p.1), bottom, top),
    ) else {
        return;
    };
    let mut told = Vec::new();
    let mut svg = String::new();
    for tick in up.ticks() {
        let y = up.at(tick);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{tick}</text>",
            left - 5.0,
            y + 3.5
        );
    }
    for tick in across.ticks() {
        let x = across.at(tick);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{top}\" y2=\"{bottom}\"/><text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{tick}</text>",
            bottom + 14.0
        );
    }
    for Curve {
        task,
        tried,
        chosen,
    } in &all
    {
        let class = match task {
            Task::Dense => "k0",
            Task::Sparse => "k1",
            Task::Complete => "k2",
        };
        let best = envelope(tried);
        let line = joined(best.iter().map(|p| (across.at(p.0), up.at(p.1))));
        let _ = write!(svg, "<polyline class=\"{class}\" points=\"{line}\"/>");
        for (inflation, mse) in &best {
            let ring = chosen.is_some_and(|(i, _)| i == *inflation);
            let (x, y) = (across.at(*inflation), up.at(*mse));
            let (hollow, r) = if ring { ("hollow ", 5.0) } else { ("", 2.2) };
            let _ = write!(
                svg,
                "<circle class=\"{hollow}{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r}\"/>"
            );
        }
        if let Some((inflation, noise)) = chosen {
            let noise = match *noise > 0.0 {
                true => format!(", noise {} asf²", short(*noise)),
                false => String::new(),
            };
            told.push(format!("{} {inflation}{noise}", task.name()));
        }
    }
    let name = escape(model);
    let _ = write!(
        out,
        "<figure><figcaption>{name}</figcaption><svg viewBox=\"0 0 240 152\" role=\"img\" aria-label=\"Tuning of {name}\">{svg}</svg><p class=\"legend\">{}</p></figure>",
        told.join(" · ")
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::benchmark::summary::{rows, tests::cell};
    use serde_json::json;

    #[test]
    fn sizes_and_sparsities_become_lines() {
        let names = [
            "ksvd",
            "ksvd:k=5",
            "ksvd:n=50",
            "ksvd:n=70",
            "ksvd:n=70:k=5",
            "gaussian",
        ];
        let cells: Vec<_> = names
            .iter()
            .map(|n| cell(n, 0, Task::Dense, 1.0, 30))
            .collect();
        let rows = rows(&cells);
        let mut out = String::new();
        sweeps(&mut out, &rows);
        // Against sparsity: as many atoms as is usual, and 70 of them; against size: three a pose.
        assert_eq!(out.matches("<svg").count(), 2);
        assert_eq!(out.matches("<polyline").count(), 2 * (2 + 1));
        assert!(
            out.contains(">ksvd, 70 atoms<") && out.contains(">ksvd, 3 a pose<"),
            "{out}"
        );
        let mut none = String::new();
        sweeps(&mut none, &rows[5..]);
        assert_eq!(none, "");
    }

    #[test]
    fn tuning_is_drawn_where_there_is_one() {
        let mut cells = vec![
            cell("pca", 0, Task::Dense, 1.0, 30),
            cell("x", 0, Task::Dense, 1.0, 30),
        ];
        let at =
            |i: f64, mse: f64| json!({"task": "dense", "inflation": i, "noise": 0.0, "mse": mse});
        cells[0].tuning = Some(json!({
            "chosen": {"inflation": 2.5, "noise": 0.0},
            "curve": [at(1.0, 9.0), at(2.5, 4.0), at(4.0, f64::NAN), at(6.0, 5.0)],
        }));
        cells[1].tuning = Some(json!({"curve": "none"}));
        let mut out = String::new();
        tuning(&mut out, &cells);
        assert_eq!(out.matches("<svg").count(), 1);
        assert_eq!(out.matches("class=\"hollow").count(), 1);
        assert!(out.contains("dense 2.5") && !out.contains("NaN"), "{out}");
        let mut none = String::new();
        tuning(&mut none, &cells[1..]);
        assert_eq!(none, "");
    }
}
