//! The people of a take, by what was solved or by names.

use super::person::{TakePerson, picture};
use super::restored::Restored;
use crate::label::people::people_by_name;
use crate::label::unlabeled::labeled;
use crate::pose::{Poses, point_at};
use ndarray::Axis;
use serde_json::Value;

/// The people of a take, and what is `solved` of them; the pictures of skeletons are taken out of
/// that.
pub(super) fn people(restored: &Restored<'_>, solved: Option<&mut Value>) -> Vec<TakePerson> {
    let points = &restored.take.file.table.poses.points;
    let named = people_by_name(points);
    let Some(solved) = solved else {
        let one = |person: Option<&String>| TakePerson {
            person: person.cloned(),
            picture: own_picture(restored, person),
            ..TakePerson::default()
        };
        return match &named[..] {
            [] => vec![one(None)],
            named => named.iter().map(|(name, _)| one(Some(name))).collect(),
        };
    };
    let of = |report: &mut Value| {
        let text = |value: &Value| value.as_str().map(String::from);
        let picture = report.as_object_mut().and_then(|r| r.remove("picture"));
        let person = text(&report["person"]);
        TakePerson {
            file: text(&report["output"]["file"]),
            none: text(&report["none"]),
            picture: (picture.and_then(|p| serde_json::from_value(p).ok()))
                .unwrap_or_else(|| own_picture(restored, person.as_ref())),
            person,
        }
    };
    if solved["people"].is_array() {
        let people = solved["people"].as_array_mut();
        people.into_iter().flatten().map(of).collect()
    } else {
        vec![of(solved)]
    }
}

/// The points of a person, or of the whole take, as they are in the result.
fn own_picture(restored: &Restored<'_>, person: Option<&String>) -> Option<[String; 3]> {
    let file = &restored.take.file;
    let source = &file.table.poses;
    let named = people_by_name(&source.points);
    let own = named.into_iter().find(|(name, _)| Some(name) == person);
    let name = |p: usize| (p, source.points[p].clone());
    let own = own.map_or_else(
        || match labeled(&source.points) {
            none if none.is_empty() => (0..source.points.len()).map(name).collect(),
            labeled => labeled.into_iter().map(name).collect(),
        },
        |(_, own)| own,
    );
    let is_all = own.len() == source.points.len();
    let bones = file.bones().ok().filter(|_| is_all && person.is_none());
    let columns: Vec<usize> = own.iter().flat_map(|(p, _)| 3 * p..3 * p + 3).collect();
    let captured = restored.take.labels.captured(file);
    let seen = |t: usize| {
        let is_seen = |(p, _): &&(usize, String)| point_at(captured, t, *p).is_finite();
        own.iter().filter(is_seen).count()
    };
    let poses = Poses {
        points: own.iter().map(|(_, name)| name.clone()).collect(),
        xyz: restored.points.xyz().select(Axis(1), &columns),
        ..Poses::default()
    };
    picture(&poses, bones, seen)
}
