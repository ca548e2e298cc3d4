//! The results as text, CSV, JSON, and one HTML page.

use super::labels::LabelRule;
use super::methods::StepSeconds;
use super::score::Precision;
use crate::draw::html::{escape, table};
use crate::draw::plain_page::PlainPage;
use crate::draw::text_table::aligned;
use crate::report::quoted;
use serde_json::{Value, json};
use std::fmt::Write;

/// A precision, or why there is none.
pub type Cell = Result<Precision, String>;

/// A table.
#[derive(Debug, Clone)]
pub struct Sheet {
    /// Its heading.
    pub title: String,
    /// The rule that labeled the pairs.
    pub rule: LabelRule,
    /// The columns.
    pub head: Vec<String>,
    /// The rows: a method, and a cell for each column, or one that says why there are none.
    pub rows: Vec<(String, Vec<Cell>)>,
}

/// The results of a test.
#[derive(Debug, Clone, Default)]
pub struct MetricReport {
    /// Subjects that distances learned from.
    pub learned: Vec<String>,
    /// Subjects that they were tested on.
    pub tested: Vec<String>,
    /// Takes of both.
    pub takes: [usize; 2],
    /// Tables.
    pub sheets: Vec<Sheet>,
    /// Why there are no tables for some rules.
    pub left_out: Vec<String>,
    /// Seconds of each step of the training of the default distance.
    pub seconds: StepSeconds,
    /// Poses found, as HTML.
    pub pictures: Vec<String>,
}

impl MetricReport {
    /// Tables to read; `*` marks the highest precision of a column.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let mut described = None;
        for sheet in &self.sheets {
            if described != Some(sheet.rule) {
                let _ = writeln!(
                    out,
                    "Labels by the rule {}: {}.\n",
                    sheet.rule.name(),
                    sheet.rule.describe()
                );
                described = Some(sheet.rule);
            }
            let _ = writeln!(out, "{}", sheet.title);
            out += &aligned(&sheet.lines());
            out.push('\n');
        }
        for why in &self.left_out {
            let _ = writeln!(out, "Left out: {why}.\n");
        }
        if !self.seconds.is_empty() {
            out += "Seconds of a training step (Table 2)\n";
            out += &aligned(&self.second_lines());
        }
        out
    }

    fn second_lines(&self) -> Vec<Vec<String>> {
        let steps = self.seconds.iter();
        steps
            .map(|(step, seconds)| vec![step.to_string(), format!("{seconds:.2}")])
            .collect()
    }

    /// A line a method and column.
    pub fn csv(&self) -> String {
        let mut out = String::from("labels,table,method,column,precision,low,high,takes,reason\n");
        for sheet in &self.sheets {
            for (method, cells) in &sheet.rows {
                for (column, cell) in sheet.head.iter().zip(cells) {
                    let start = format!(
                        "{},{},{},{}",
                        sheet.rule.name(),
                        quoted(&sheet.title),
                        quoted(method),
                        quoted(column)
                    );
                    let _ = match cell {
                        Ok(p) => writeln!(
                            out,
                            "{start},{},{},{},{},",
                            p.mean, p.interval[0], p.interval[1], p.takes
                        ),
                        Err(why) => writeln!(out, "{start},,,,,{}", quoted(why)),
                    };
                }
            }
        }
        out
    }

    /// The tables, the seconds and the subjects as JSON.
    pub fn json(&self) -> String {
        let cell = |cell: &Cell| match cell {
            Ok(p) => json!({"precision": p.mean, "interval": p.interval, "takes": p.takes}),
            Err(why) => json!({ "reason": why }),
        };
        let sheet = |s: &Sheet| {
            let rows = s.rows.iter().map(|(method, cells)| {
                json!({"method": method, "cells": cells.iter().map(cell).collect::<Vec<_>>()})
            });
            json!({
                "title": s.title, "labels": s.rule.name(), "columns": s.head,
                "rows": rows.collect::<Vec<_>>(),
            })
        };
        let seconds: serde_json::Map<String, Value> = (self.seconds.iter())
            .map(|(step, s)| (step.to_string(), json!(s)))
            .collect();
        let value = json!({
            "learned": self.learned, "tested": self.tested, "takes": self.takes,
            "left_out": self.left_out, "seconds": seconds,
            "tables": self.sheets.iter().map(sheet).collect::<Vec<_>>(),
        });
        format!("{value:#}\n")
    }

    /// A page that needs no other file.
    pub fn html(&self) -> String {
        let mut tables = String::new();
        let mut described = None;
        for sheet in &self.sheets {
            if described != Some(sheet.rule) {
                let _ = write!(
                    tables,
                    "<section><h2>Labels by the rule {}</h2><p>{}.</p></section>",
                    sheet.rule.name(),
                    escape(sheet.rule.describe())
                );
                described = Some(sheet.rule);
            }
            let _ = write!(
                tables,
                "<section><h3>{}</h3>{}</section>",
                escape(&sheet.title),
                table(&sheet.lines())
            );
        }
        for why in &self.left_out {
            let _ = write!(
                tables,
                "<section><p>Left out: {}.</p></section>",
                escape(why)
            );
        }
        let pictures: String = if self.pictures.is_empty() {
            String::new()
        } else {
            format!(
                "<section><h2>Poses found</h2><p>The pose asked for, then the eight nearest poses \
             of other people, nearest first; dashed: of another class.</p>{}</section>",
                self.pictures.concat()
            )
        };
        let seconds = if self.seconds.is_empty() {
            String::new()
        } else {
            format!(
                "<section><h2>Seconds of a training step (Table 2)</h2>{}</section>",
                table(&self.second_lines())
            )
        };
        let lead = format!(
            "Learned from {} takes of {}, tested on {} takes of {}. Labels come from rules in the \
             place of people. Intervals: 95%, bootstrap over the tested takes; the highest \
             precision of a column is marked.",
            self.takes[0],
            escape(&self.learned.join(", ")),
            self.takes[1],
            escape(&self.tested.join(", "))
        );
        PlainPage {
            title: "Distances of poses compared",
            lead: vec![lead],
            main: tables + &pictures + &seconds,
            style: "",
            command: "evaluate metric",
            data: "All numbers are in metric.csv and metric.json.",
        }
        .html()
    }
}

impl Sheet {
    /// The table with its head, as text.
    fn lines(&self) -> Vec<Vec<String>> {
        let best: Vec<f64> = (0..self.head.len())
            .map(|k| {
                let cells = self
                    .rows
                    .iter()
                    .filter_map(|(_, c)| c.get(k)?.as_ref().ok());
                cells.map(|p| p.mean).fold(f64::NEG_INFINITY, f64::max)
            })
            .collect();
        let mut head = vec!["method".to_string()];
        head.extend(self.head.iter().flat_map(|h| [h.clone(), "95%".into()]));
        let mut lines = vec![head];
        for (method, cells) in &self.rows {
            let mut line = vec![method.clone()];
            for (k, best) in best.iter().enumerate() {
                line.extend(match cells.get(k) {
                    Some(Ok(p)) => [
                        format!("{:.3}{}", p.mean, if p.mean == *best { "*" } else { " " }),
                        format!("{:.3} to {:.3}", p.interval[0], p.interval[1]),
                    ],
                    Some(Err(_)) | None => ["- ".into(), "-".into()],
                });
            }
            lines.push(line);
        }
        for (method, cells) in &self.rows {
            if let Some(Err(why)) = cells.first() {
                lines.push(vec![format!("{method}: {why}")]);
            }
        }
        lines
    }
}
