//! `pair-label` around the library: the format of the output, the motion of takes, the pairs as
//! CSV, messages.

use posing::audit::count;
use posing::cli::messages;
use posing::cli::metric_takes::MetricTakes;
use posing::evaluate::pair_label::{self, Motion};
use posing::io::csv::push_cell;
use posing::metric::JointMap;
use posing::metric::pair_proposal::{NEAR_COPY, PairRules, Proposal, propose};
use posing::{Error, Place, Result};

/// The format of the proposed pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum PairFormat {
    /// Page on which a person labels the pairs
    Html,
    /// Table of the pairs with an empty label column
    Csv,
}

/// Proposed pairs with the motion of their takes.
pub struct PairSet {
    takes: Vec<Motion>,
    proposal: Proposal,
    seconds: f64,
}

impl PairSet {
    /// Proposes pairs of frames of takes that have rates, and prints how many.
    ///
    /// # Errors
    /// Usage: the rules are out of range. Data: no pair can be proposed.
    pub fn propose(table: &MetricTakes, map: &JointMap, rules: &PairRules) -> Result<PairSet> {
        rules.check().map_err(Error::into_usage)?;
        let fail = |e: Error| e.at(Place::file(&table.source));
        let proposal = propose(&table.takes, &table.names, rules).map_err(fail)?;
        let frames = table.poses.takes();
        let takes = frames.into_iter().zip(&table.names).zip(&table.takes);
        let takes = takes.map(|((range, name), body)| {
            let (rate, scale) = (body.rate.unwrap_or(1.0), proposal.height / body.height);
            Motion::new(name, &table.poses.slice(range), map, rate, scale)
        });
        let takes = takes.collect::<Result<_>>().map_err(fail)?;
        messages::info(&summary(&proposal, rules));
        Ok(PairSet {
            takes,
            proposal,
            seconds: rules.margin,
        })
    }

    /// The page or the table of the pairs.
    pub fn write(&self, format: PairFormat, title: &str) -> Vec<u8> {
        let (takes, pairs) = (&self.takes, &self.proposal.pairs);
        match format {
            PairFormat::Csv => self.csv(),
            PairFormat::Html => {
                pair_label::page(title, takes, pairs, self.seconds, self.proposal.height)
                    .into_bytes()
            }
        }
    }

    fn csv(&self) -> Vec<u8> {
        let mut out = b"a_take,a_frame,b_take,b_frame,label\n".to_vec();
        for pair in &self.proposal.pairs {
            for at in [pair.a, pair.b] {
                push_cell(&mut out, self.takes[at.take].name.as_bytes());
                out.extend(format!(",{},", at.frame).bytes());
            }
            out.push(b'\n');
        }
        out
    }
}

/// How many pairs there are, how many are proposed, and why they are fewer than asked for.
fn summary(proposal: &Proposal, rules: &PairRules) -> String {
    let (near, proposed) = (rules.near, proposal.pairs.len());
    let pairs = count(proposal.candidates as usize, "pair");
    let found = format!(
        "{pairs} of {} poses within {near} cm; proposed {proposed}",
        proposal.poses
    );
    if proposed < rules.count {
        format!(
            "{found} of {}: any other is within {NEAR_COPY} s of one of these on both sides",
            rules.count
        )
    } else {
        found
    }
}
