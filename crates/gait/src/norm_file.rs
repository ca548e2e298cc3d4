//! A norm as a file: JSON, a mean and a standard deviation a percent of the cycle and an angle.

use crate::cycles::POINTS;
use crate::norm::{GVS, Norm};
use crate::{Error, Place, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Serialize, Deserialize)]
struct NormFile {
    /// What the file is.
    kind: String,
    /// The cycles it is made of.
    cycles: usize,
    /// The angles by the names of [`GVS`].
    angles: BTreeMap<String, Angle>,
}

#[derive(Serialize, Deserialize)]
struct Angle {
    mean_deg: Vec<f64>,
    sd_deg: Vec<f64>,
}

const KIND: &str = "gait norm";

impl Norm {
    /// The norm as a file.
    ///
    /// # Errors
    /// [`Error::Usage`]: it cannot be written as JSON.
    pub fn to_json(&self) -> Result<String> {
        let rounded = |values: &[f64]| -> Vec<f64> {
            // A norm of one cycle has no deviation.
            let known = values.iter().map(|v| if v.is_finite() { *v } else { 0.0 });
            known.map(|v| (1e4 * v).round() / 1e4).collect()
        };
        let angle = |(k, (name, ..)): (usize, &(&str, &str, usize))| {
            let angle = Angle {
                mean_deg: rounded(&self.mean[k]),
                sd_deg: rounded(&self.sd[k]),
            };
            (name.to_string(), angle)
        };
        let file = NormFile {
            kind: KIND.to_string(),
            cycles: self.cycles,
            angles: GVS.iter().enumerate().map(angle).collect(),
        };
        let text = serde_json::to_string(&file).map_err(|e| Error::usage(e.to_string()))?;
        Ok(text + "\n")
    }

    /// Reads a norm from its file, which is called `name` in messages.
    ///
    /// # Errors
    /// [`Error::Data`]: it is no norm, or an angle has not 101 numbers.
    pub fn from_json(text: &[u8], name: &str) -> Result<Norm> {
        let bad = |what: String| Error::data(Place::file(name), what);
        let file: NormFile =
            serde_json::from_slice(text).map_err(|e| bad(format!("is no norm of gait ({e})")))?;
        if file.kind != KIND || file.cycles == 0 {
            return Err(bad("is no norm of gait".into()));
        }
        let of = |k: usize| {
            let own = file.angles.get(GVS[k].0).into_iter();
            let mut own = own.flat_map(|angle| [&angle.mean_deg, &angle.sd_deg]);
            let mut next = || own.next().filter(|v| v.len() == POINTS).cloned();
            let wrong = || {
                let what = format!(
                    "expected {POINTS} means and deviations of {} in degrees",
                    GVS[k].0
                );
                bad(what)
            };
            let both = [next().ok_or_else(wrong)?, next().ok_or_else(wrong)?];
            let is_angle = both[0].iter().all(|v| v.abs() <= 180.0);
            let is_spread = both[1].iter().all(|v| (0.0..=180.0).contains(v));
            (is_angle && is_spread).then_some(both).ok_or_else(wrong)
        };
        let all: Vec<[Vec<f64>; 2]> = (0..GVS.len()).map(of).collect::<Result<_>>()?;
        let part = |i: usize| std::array::from_fn(|k| all[k][i].clone());
        Ok(Norm {
            mean: part(0),
            sd: part(1),
            cycles: file.cycles,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_norm_reads_back_and_others_are_refused() {
        let cycle: crate::NineAngles = std::array::from_fn(|k| vec![k as f64; POINTS]);
        let norm = Norm::of_cycles(&[cycle.clone(), cycle]).unwrap();
        let text = norm.to_json().unwrap();
        assert_eq!(Norm::from_json(text.as_bytes(), "n").unwrap(), norm);
        for bad in [
            "",
            "{}",
            "[1]",
            &text.replace("gait norm", "model"),
            &text.replace("[8.0,", "["),
        ] {
            let said = Norm::from_json(bad.as_bytes(), "n.json")
                .unwrap_err()
                .to_string();
            assert!(
                said.starts_with("n.json: ") && said.lines().count() == 1,
                "{said}"
            );
        }
    }
}
