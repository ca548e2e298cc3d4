//! Which pairs of a table's takes a command is about, and whether they have one rate.

use posing::cli::metric_takes::MetricTakes;
use posing::io::text::excerpt;
use posing::{Error, Place, Result};

/// Most names that an error lists.
const LISTED: usize = 8;

/// Pairs of takes, in the order of the table: from each, or the one named, to each other, or the
/// one named; with `within`, or where both are named alike, also a take with itself.
///
/// # Errors
/// [`Error::Data`]: a named take is not there. [`Error::Usage`]: no pair is left.
pub fn take_pairs(
    takes: &MetricTakes,
    from: Option<&str>,
    to: Option<&str>,
    within: bool,
) -> Result<Vec<[usize; 2]>> {
    let ends = |named: Option<&str>| match named {
        Some(name) => find(takes, name).map(|k| vec![k]),
        None => Ok((0..takes.names.len()).collect()),
    };
    let (lefts, rights) = (ends(from)?, ends(to)?);
    let all = (lefts.iter()).flat_map(|a| rights.iter().map(move |b| [*a, *b]));
    let with_itself = within || from.is_some() && from == to;
    let pairs: Vec<[usize; 2]> = all.filter(|[a, b]| a != b || with_itself).collect();
    if pairs.is_empty() {
        Err(Error::usage(format!(
            "{}: transitions need two takes; give another, or --within for those of a take into \
             itself",
            takes.source
        )))
    } else {
        Ok(pairs)
    }
}

/// The index of a take.
fn find(takes: &MetricTakes, name: &str) -> Result<usize> {
    takes.names.iter().position(|n| n == name).ok_or_else(|| {
        let listed = takes.names.iter().take(LISTED).map(|n| excerpt(n));
        let mut listed: Vec<String> = listed.collect();
        if takes.names.len() > LISTED {
            listed.push("...".into());
        }
        let listed = listed.join(", ");
        let what = format!("has no take \"{}\"; it has {listed}", excerpt(name));
        Error::data(Place::file(&takes.source), what)
    })
}

/// Fails unless the takes of each pair have one rate.
///
/// # Errors
/// [`Error::Usage`], with the takes and their rates.
pub fn check_rates(takes: &MetricTakes, pairs: &[[usize; 2]]) -> Result<()> {
    for pair in pairs {
        let [x, y] = pair.map(|take| takes.takes[take].rate.unwrap_or(0.0));
        if (x - y).abs() > 1e-3 * x.max(y) {
            let [a, b] = pair.map(|take| excerpt(&takes.names[take]));
            return Err(Error::usage(format!(
                "{}: takes {a} and {b} have {x} and {y} frames per second; blending needs one \
                 rate: choose other takes with --from and --to, or write both at one rate",
                takes.source
            )));
        }
    }
    Ok(())
}
