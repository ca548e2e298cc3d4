//! The last step: the record of a result, and what else stands beside it.

use super::naming::are_nameless;
use super::page::write_page;
use super::people::people;
use super::places::{PlaceToSee, Told};
use super::record::{Fingerprint, Record, Summary};
use super::skeleton::people_of;
use super::written::Written;
use crate::Result;
use crate::pose::PointNaming;
use crate::restore::gap_report::gap_lines;
use serde_json::{Value, json};

impl Written<'_> {
    /// Writes what stands beside the result: the skeleton, the page and the record.
    ///
    /// # Errors
    /// [`crate::Error::Io`]: the record cannot be written.
    pub(super) fn recorded(self) -> Result<Summary> {
        let restored = &self.restored;
        let (take, run) = (restored.take, &restored.take.run);
        let (mut solved, of_skeleton) = self.skeleton();
        let people = people(restored, solved.as_mut());
        let mut summary = self.summary(people, of_skeleton);
        // The result is whole also where its page is not written.
        match write_page(restored, &summary) {
            Ok(note) => summary.notes.extend(note),
            Err(e) => summary.findings.push(format!("page: not written: {e}")),
        }
        Record {
            command: "clean",
            made_from: &run.made_from,
            read_as: &take.file.read_as,
            map: match &restored.naming {
                PointNaming::Map(map) => Some(&map.name),
                _ => None,
            },
            audit: take.before.clone(),
            summary: &summary,
            redone: &run.settings.redo,
            named: take.labels.named.clone(),
            labels: take.labels.record().cloned(),
            gaps: gap_lines(&restored.points),
            gaps_by_point: Vec::new(),
            rotations: (restored.rotations.as_ref()).map(|r| r.lines()),
            solved,
            left_out: 0,
            output: Fingerprint::read(&run.job.output)?,
            outliers: self.replaced,
        }
        .write(&run.job.output, take.capture.size)?;
        Ok(summary)
    }

    /// The skeleton beside the result, if it is asked for, and its findings; why there is none is
    /// one.
    fn skeleton(&self) -> (Option<Value>, Vec<Told>) {
        let take = self.restored.take;
        let Some(skeletons) = take.run.skeletons(take.file.format) else {
            return (None, Vec::new());
        };
        let written = if take.labels.report.named.is_none() && are_nameless(&take.file) {
            Err("its tracks have no names".into())
        } else {
            skeletons.write(&self.restored)
        };
        match written {
            Ok(solved) => {
                let findings = people_of(&solved).iter().flat_map(findings_of).collect();
                (Some(solved), findings)
            }
            Err(e) => {
                let e = e.with_option_names(take.run.settings.option_names);
                let finding = format!("skeleton: none: {e}");
                (Some(json!({"none": e.to_string()})), vec![finding.into()])
            }
        }
    }
}

/// What is to be told of a skeleton.
fn findings_of(solved: &Value) -> Vec<Told> {
    let findings = solved["findings"].as_array().into_iter().flatten();
    let told = findings.filter_map(|f| f.as_str()).map(String::from);
    let none = solved["none"].as_str().map(|why| format!("none: {why}"));
    let person = solved["person"].as_str();
    let of_person = person.map_or(String::new(), |person| format!("{person}: "));
    let limbs = solved["unseen_limbs"].as_array();
    let place = |what: &str| {
        let is_of = |limb: &&Value| {
            let name = limb["limb"].as_str();
            name.is_some_and(|name| what.starts_with(&format!("{name}: ")))
        };
        let limb = limbs?.iter().find(is_of)?;
        let frames: [usize; 2] = serde_json::from_value(limb["frames"].clone()).ok()?;
        Some(PlaceToSee::of("no marker", None, frames))
    };
    let all = told.chain(none);
    all.map(|what| Told {
        places: place(&what).into_iter().collect(),
        line: format!("skeleton: {of_person}{what}"),
    })
    .collect()
}
