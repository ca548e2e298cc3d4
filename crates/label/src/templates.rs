//! Labels that are wrong in every frame of a take: by labeled takes, or by the body's mirror image.

use super::marker_distances::Distances;
use super::mirror::Mirror;
use super::people::{Person, people_of_markers};
use super::person_template::{Labels, Template};
use super::tuning::nameless::SAME;
use super::tuning::person_template::FEWEST_LABELS;
use super::tuning::whole_take::MOST_LABELS;
use super::whole_take::groups;
use crate::io::MotionFile;
use crate::io::motion_folder::name_of;
use crate::pose::Poses;
use crate::pose::zeros::Zeros;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2, Axis, s};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Labeled takes that others are compared with.
#[derive(Default)]
pub struct Templates {
    all: Vec<Arc<Named>>,
    are_same_person: bool,
    digest: Sha256,
}

/// A person of a labeled take.
struct Named {
    take: String,
    person: String,
    template: Template,
}

impl std::fmt::Debug for Templates {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let takes: Vec<&str> = self.all.iter().map(|t| t.take.as_str()).collect();
        f.debug_tuple("Templates").field(&takes).finish()
    }
}

impl Named {
    /// What tells the person in the take's labels, else what the take's file is called.
    fn called(&self) -> String {
        if !self.person.is_empty() {
            return self.person.clone();
        }
        let file = name_of(Path::new(&self.take)).display().to_string();
        file.split('.').next().unwrap_or_default().to_string()
    }
}

/// The labels of a person of a take.
struct Labeled {
    person: Person,
    /// Their names without what tells the person.
    names: Vec<String>,
    /// (frames, 3 L), cm.
    positions: Array2<f64>,
}

/// Labels that are wrong in every frame of a take.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeTake {
    pub kind: WholeTakeKind,
    /// The labels, as points of the table: those that are exchanged, or pairs of them.
    pub points: Vec<usize>,
    /// The labeled takes that say it.
    pub like: Vec<String>,
    /// Whether more than one take says it: two of them, or one and the sides of the body.
    pub is_sure: bool,
    /// Whether changes put it right.
    pub is_put_back: bool,
}

/// How labels are wrong in every frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum WholeTakeKind {
    /// Left and right are exchanged altogether.
    Hand,
    /// Some labels are exchanged with each other.
    Exchanged,
    /// The first half of them are exchanged, or the others, their mirror images.
    EitherSide,
    /// Two labels are exchanged with each other, as the places of labels on bodies say.
    Body,
}

impl Templates {
    /// Learns from the takes of some files, those of the people that will be compared with them or
    /// of others.
    ///
    /// # Errors
    /// [`Error::Data`]: a file has too few labels, or too many.
    pub fn learn(files: &[MotionFile], are_same_person: bool) -> Result<Templates> {
        let mut out = Templates {
            are_same_person,
            ..Templates::default()
        };
        for file in files {
            let poses = file.poses();
            let before = out.all.len();
            poses.points.iter().for_each(|name| out.digest.update(name));
            poses
                .xyz
                .iter()
                .for_each(|v| out.digest.update(v.to_le_bytes()));
            let poses = &*Zeros::emptied(poses);
            for take in poses.takes() {
                for labeled in labeled_people(poses, &take) {
                    let (names, positions) = (&labeled.names, labeled.positions.view());
                    out.all.push(Arc::new(Named {
                        take: file.table.name.clone(),
                        template: Template::learn(names, positions, are_same_person),
                        person: labeled.person.name,
                    }));
                }
            }
            if out.all.len() == before {
                let what = format!(
                    "has no person with {FEWEST_LABELS} to {MOST_LABELS} labels, so it tells \
                     nothing of those of others"
                );
                return Err(Error::data(Place::file(&file.table.name), what));
            }
        }
        Ok(out)
    }

    /// What people are called whose labels are there (frames, 3 L; cm): by the labeled take whose
    /// steady distances are theirs, by numbers where none or several say it.
    #[doc(hidden)]
    pub fn who(&self, labels: &[String], people: &[Array2<f64>]) -> Vec<String> {
        let mut near: Vec<(f64, usize, String)> = Vec::new();
        for (k, positions) in people.iter().enumerate() {
            let distances = Distances::measure(positions.view());
            let of = |t: &Arc<Named>| Some((t.template.off(labels, &distances)?, k, t.called()));
            near.extend(
                self.all
                    .iter()
                    .filter_map(of)
                    .filter(|(off, ..)| *off <= SAME),
            );
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut called: Vec<Option<String>> = vec![None; people.len()];
        for (_, k, name) in near {
            let is_known = called.iter().flatten().any(|known| *known == name);
            if called[k].is_none() && !is_known {
                called[k] = Some(name);
            }
        }
        let known: Vec<String> = called.iter().flatten().cloned().collect();
        let mut free = (1..)
            .map(|n: usize| n.to_string())
            .filter(|n| !known.contains(n));
        let name = |name: Option<String>| name.or_else(|| free.next()).unwrap_or_default();
        called.into_iter().map(name).collect()
    }

    /// The takes of people whose labels are there (frames, 3 L; cm); none where one of these people
    /// is in no take.
    #[doc(hidden)]
    pub fn of_people(&self, labels: &[String], people: &[Array2<f64>]) -> Templates {
        let mut is_of = vec![false; self.all.len()];
        for positions in people {
            let distances = Distances::measure(positions.view());
            let off = |t: &Named| t.template.off(labels, &distances);
            let own: Vec<bool> = (self.all.iter())
                .map(|t| off(t).is_some_and(|off| off <= SAME))
                .collect();
            if !own.contains(&true) {
                return Templates::default();
            }
            is_of.iter_mut().zip(own).for_each(|(all, own)| *all |= own);
        }
        let own = self.all.iter().zip(is_of).filter(|(_, is_of)| *is_of);
        Templates {
            all: own.map(|(t, _)| t.clone()).collect(),
            are_same_person: self.are_same_person,
            digest: self.digest.clone(),
        }
    }

    /// The files of the takes, without their folders.
    #[doc(hidden)]
    pub fn files(&self) -> Vec<String> {
        let file = |t: &Arc<Named>| name_of(Path::new(&t.take)).display().to_string();
        let mut files: Vec<String> = self.all.iter().map(file).collect();
        files.dedup();
        files
    }

    #[doc(hidden)]
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// What tells these takes, and how they are compared, from others; nothing where there are
    /// none.
    #[doc(hidden)]
    pub fn digest(&self) -> Option<String> {
        let digest = self.digest.clone().finalize();
        let hex: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        (!self.all.is_empty()).then(|| {
            if self.are_same_person {
                format!("same person {hex}")
            } else {
                hex
            }
        })
    }

    /// Whether the takes are of those people that others are compared with.
    pub(crate) fn are_same_person(&self) -> bool {
        self.are_same_person
    }

    /// What is wrong in every frame of a take of a table, and notes on the templates.
    pub(crate) fn check(
        &self,
        poses: &Poses,
        take: &Range<usize>,
    ) -> (Vec<WholeTake>, Vec<String>) {
        let (mut found, mut notes) = (Vec::new(), Vec::new());
        for person in labeled_people(poses, take) {
            let mirror = Mirror::new(&person.names, person.positions.view());
            let distances = Distances::measure(person.positions.view());
            if self.is_empty() {
                found.extend(person.by_mirror(&mirror, &distances));
                continue;
            }
            let labels = Labels {
                names: &person.names,
                positions: person.positions.view(),
                distances: &distances,
            };
            let (own, said) = self.compare(&person.person, labels, &mirror);
            found.extend(own);
            notes.extend(said);
        }
        (found, notes)
    }

    /// The templates of a person: those of the same name, all where none has it.
    fn of(&self, person: &str) -> Vec<&Named> {
        let all = || self.all.iter().map(|t| &**t);
        let own: Vec<&Named> = all().filter(|t| t.person == person).collect();
        if own.is_empty() {
            return all().collect();
        }
        own
    }

    /// How badly the distances of some labels of a person, which were exchanged with each other,
    /// fit those of the templates in some frames, χ², in the mean; `None` where these say nothing.
    pub(crate) fn cost(
        &self,
        person: &str,
        names: &[String],
        positions: ArrayView2<'_, f64>,
        labels: &[usize],
        frames: &[Range<usize>],
    ) -> Option<f64> {
        let of = |t: &&Named| t.template.cost(names, positions, labels, frames);
        let costs: Vec<f64> = self.of(person).iter().filter_map(of).collect();
        (!costs.is_empty()).then(|| costs.iter().sum::<f64>() / costs.len() as f64)
    }

    /// What most of the templates of a person say is wrong, and notes on those that differ from the
    /// take and the others.
    fn compare(
        &self,
        person: &Person,
        labels: Labels<'_>,
        mirror: &Mirror<'_>,
    ) -> (Vec<WholeTake>, Vec<String>) {
        let mirrored = &mirror.images();
        let templates = self.of(&person.name);
        let mut said: BTreeMap<(WholeTakeKind, Vec<usize>), Vec<usize>> = BTreeMap::new();
        let mut known = Vec::new();
        let mut notes = Vec::new();
        for (n, Named { template, .. }) in templates.iter().enumerate() {
            let unlike = template.compare(labels, mirrored);
            if unlike.other_hand {
                let all = (WholeTakeKind::Hand, Vec::new());
                said.entry(all).or_default().push(n);
            }
            for group in groups(&unlike.pairs) {
                let exchanged = (WholeTakeKind::Exchanged, group);
                said.entry(exchanged).or_default().push(n);
            }
            known.push(unlike.known);
        }
        if known.iter().all(|labels| labels.len() < FEWEST_LABELS) {
            notes.push("labeled takes have other labels: not compared".to_string());
        }
        let mut found = Vec::new();
        for ((kind, group), by) in said {
            let knows = |labels: &&Vec<usize>| {
                labels.len() >= FEWEST_LABELS && group.iter().all(|l| labels.contains(l))
            };
            let all = known.iter().filter(knows).count();
            let sided: Vec<usize> = match kind {
                WholeTakeKind::Hand => (0..mirrored.len())
                    .filter(|l| mirrored[*l] > *l)
                    .flat_map(|l| [l, mirrored[l]])
                    .collect(),
                _ => group.clone(),
            };
            let mut like: Vec<String> = by.iter().map(|n| templates[*n].take.clone()).collect();
            like.dedup();
            let by_mirror = match group[..] {
                [a, b] => mirror.says(labels.distances, [a, b]),
                _ => None,
            };
            let one = WholeTake {
                kind,
                is_sure: by_mirror.unwrap_or(by.len() > 1),
                is_put_back: false,
                points: sided.iter().map(|l| person.points[*l]).collect(),
                like,
            };
            // The odd one out is wrong: a template, where most others are like the take.
            if 2 * by.len() > all {
                found.push(one);
            } else {
                let names: Vec<&str> = group.iter().map(|l| labels.names[*l].as_str()).collect();
                notes.push(one.of_templates(&names));
            }
        }
        (found, notes)
    }
}

impl Labeled {
    /// The labels that are exchanged by the body's mirror image: on this side or on the other.
    fn by_mirror(&self, mirror: &Mirror<'_>, distances: &Distances) -> Vec<WholeTake> {
        let images = mirror.images();
        let one = |group: Vec<usize>| {
            let others: Vec<usize> = group.iter().map(|l| images[*l]).collect();
            let labels = [group, others].concat();
            WholeTake {
                kind: WholeTakeKind::EitherSide,
                points: labels.iter().map(|l| self.person.points[*l]).collect(),
                like: Vec::new(),
                is_sure: false,
                is_put_back: false,
            }
        };
        // On one side; the other side's are theirs.
        let pairs = mirror.exchanged(distances).into_iter();
        let both: Vec<[usize; 2]> = pairs.flat_map(|p| [p, p.map(|l| images[l])]).collect();
        let mut out: Vec<Vec<usize>> = Vec::new();
        for group in groups(&both) {
            let is_other = |of: &Vec<usize>| group.iter().any(|l| of.contains(&images[*l]));
            if !out.iter().any(is_other) {
                out.push(group);
            }
        }
        out.into_iter().map(one).collect()
    }
}

/// The people of a take that have labels enough.
fn labeled_people(poses: &Poses, take: &Range<usize>) -> Vec<Labeled> {
    let names = &poses.points;
    let xyz = poses.xyz.slice(s![take.clone(), ..]);
    let are_enough = |p: &Person| (FEWEST_LABELS..=MOST_LABELS).contains(&p.points.len());
    let one = |person: Person| {
        let columns: Vec<usize> = person
            .points
            .iter()
            .flat_map(|p| 3 * p..3 * p + 3)
            .collect();
        let own = |p: &usize| person.own_name(&names[*p]).to_string();
        Labeled {
            names: person.points.iter().map(own).collect(),
            positions: xyz.select(Axis(1), &columns),
            person,
        }
    };
    let all = people_of_markers(names, xyz).into_iter().filter(are_enough);
    all.map(one).collect()
}

impl WholeTake {
    /// Two points that are exchanged as the body says.
    pub(crate) fn by_body(points: Vec<usize>, is_sure: bool) -> WholeTake {
        WholeTake {
            kind: WholeTakeKind::Body,
            points,
            like: Vec::new(),
            is_sure,
            is_put_back: false,
        }
    }

    /// What is wrong in words; `names` are those of the table.
    pub fn sentence(&self, names: &[String]) -> String {
        let name = |k: usize| names[self.points[k]].as_str();
        let like = self.like.join(" and ");
        match self.kind {
            WholeTakeKind::Hand if self.like.len() > 1 => {
                format!("left and right are exchanged altogether: {like} have them otherwise")
            }
            WholeTakeKind::Hand => {
                format!("left and right are exchanged altogether, here or in {like}")
            }
            WholeTakeKind::Exchanged => {
                let all: Vec<&str> = (0..self.points.len()).map(name).collect();
                let all = all.join(" and ");
                match self.like.len() {
                    1 => format!("{all} are exchanged in every frame, here or in {like}"),
                    _ => format!("{all} are exchanged in every frame: {like} have them otherwise"),
                }
            }
            WholeTakeKind::Body => {
                let [a, b] = [name(0), name(1)];
                format!(
                    "{a} and {b} are exchanged in every frame, as their places on the body say: \
                     give a labeled take with the option `like`, or put them right with the option \
                     `exchange {a}:{b}`"
                )
            }
            WholeTakeKind::EitherSide => {
                let all: Vec<&str> = (0..self.points.len()).map(name).collect();
                let [one, other] =
                    [0, 1].map(|k| all[k * all.len() / 2..][..all.len() / 2].join("/"));
                format!(
                    "{one} or {other} are exchanged in every frame, as the sides of the body \
                     differ: give a labeled take with the option `like`"
                )
            }
        }
    }

    /// What differs in templates, where the take is like most.
    fn of_templates(&self, names: &[&str]) -> String {
        let what = match self.kind {
            WholeTakeKind::Hand => "left and right".to_string(),
            _ => names.join(" and "),
        };
        let like = self.like.join(" and ");
        format!("{like} has {what} exchanged, other labeled takes and this one have not")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};
    use ndarray::concatenate;

    const NAMES: [&str; 15] = [
        "LSHO", "LUPA", "LELB", "LFRM", "LWRA", "LWRB", "RSHO", "RUPA", "RELB", "RFRM", "RWRA",
        "RWRB", "CLAV", "STRN", "C7",
    ];

    /// A person of a size, from a time on: two arms that swing, and a trunk.
    fn person(size: f64, from: f64) -> Poses {
        let mut xyz = Array2::zeros((240, 45));
        for t in 0..240 {
            let time = from + t as f64 / 60.0;
            let trunk = DVec3::new(10.0 * time, 3.0 * (5.0 * time).sin(), 0.0);
            let middle = [[0.0, 135.0, 9.0], [0.0, 118.0, 11.0], [0.0, 146.0, -8.0]];
            let mut positions: Vec<DVec3> = Vec::new();
            for s in [1.0, -1.0] {
                let upper = DMat3::from_rotation_x(0.6 * (3.0 * time + s).sin());
                let lower = upper * DMat3::from_rotation_x(0.5 + 0.4 * (4.0 * time - s).sin());
                let shoulder = trunk + DVec3::new(18.0 * s, 140.0, 0.0);
                let elbow = shoulder + upper * DVec3::new(2.0 * s, -28.0, 0.0);
                let of_lower = [[3.0, -12.0, 3.0], [3.0, -24.0, 2.5], [-3.0, -24.0, -2.5]];
                positions.extend([shoulder, shoulder + upper * DVec3::new(5.0 * s, -14.0, 2.0)]);
                positions.push(elbow);
                let all = of_lower.map(|[x, y, z]| elbow + lower * DVec3::new(x * s, y, z));
                positions.extend(all);
            }
            positions.extend(middle.map(|off| trunk + DVec3::from_array(off)));
            for (k, position) in positions.into_iter().enumerate() {
                (0..3).for_each(|c| xyz[[t, 3 * k + c]] = size * position[c]);
            }
        }
        Poses {
            points: NAMES.map(|n| format!("Ann:{n}")).to_vec(),
            xyz,
            ..Poses::default()
        }
    }

    fn exchanged(mut poses: Poses, [a, b]: [usize; 2]) -> Poses {
        for t in 0..poses.frames() {
            (0..3).for_each(|c| poses.xyz.swap([t, 3 * a + c], [t, 3 * b + c]));
        }
        poses
    }

    fn templates(takes: &[Poses], is_same_person: bool) -> Templates {
        let one = |(n, poses): (usize, &Poses)| Named {
            take: format!("take {n}"),
            person: String::new(),
            template: Template::learn(&poses.points, poses.xyz.view(), is_same_person),
        };
        Templates {
            all: takes.iter().enumerate().map(one).map(Arc::new).collect(),
            ..Templates::default()
        }
    }

    /// What is found in a take, and notes.
    fn check(templates: &Templates, poses: &Poses) -> (Vec<(WholeTakeKind, Vec<usize>)>, usize) {
        let (found, notes) = templates.check(poses, &(0..poses.frames()));
        let all = found.into_iter().map(|w| (w.kind, w.points)).collect();
        (all, notes.len())
    }

    #[test]
    fn exchanges_of_a_whole_take_show_beside_a_labeled_one() {
        for (size, is_same_person) in [(1.0, true), (1.1, false)] {
            let like = templates(&[person(1.0, 0.0)], is_same_person);
            let take = person(size, 9.0);
            assert_eq!(check(&like, &take), (vec![], 0));
            for pair in [[2, 4], [1, 3], [12, 13], [7, 8]] {
                let want = (WholeTakeKind::Exchanged, pair.to_vec());
                let found = check(&like, &exchanged(take.clone(), pair));
                assert_eq!(found, (vec![want], 0));
            }
        }
    }

    /// A person that stands still, with other arms.
    fn still(from: f64) -> Poses {
        let mut poses = person(1.0, from);
        let first = poses.xyz.row(0).to_owned();
        poses
            .xyz
            .rows_mut()
            .into_iter()
            .for_each(|mut row| row.assign(&first));
        poses
    }

    #[test]
    fn one_that_stands_still_says_little_of_one_that_moves() {
        let [walk, stand] = [person(1.0, 9.0), still(0.3)];
        for (like, take) in [(&stand, &walk), (&walk, &stand), (&stand, &still(1.1))] {
            let like = templates(std::slice::from_ref(like), true);
            assert_eq!(check(&like, take), (vec![], 0));
        }
        let like = templates(&[stand], true);
        let found = check(&like, &exchanged(walk, [4, 5]));
        assert_eq!(found, (vec![(WholeTakeKind::Exchanged, vec![4, 5])], 0));
    }

    #[test]
    fn one_take_alone_is_not_sure() {
        let take = || exchanged(person(1.0, 9.0), [12, 13]);
        let is_sure = |like: &[Poses], take: &Poses| {
            let (found, _) = templates(like, true).check(take, &(0..240));
            found.iter().map(|w| w.is_sure).collect::<Vec<bool>>()
        };
        let [first, second] = [0.0, 3.0].map(|from| person(1.0, from));
        assert_eq!(is_sure(std::slice::from_ref(&first), &take()), [false]);
        assert_eq!(is_sure(&[first, second], &take()), [true]);
        // It is the labeled take that is wrong, as the sides of the body say.
        let right = person(1.0, 9.0);
        let wrong = exchanged(person(1.0, 0.0), [1, 2]);
        assert_eq!(is_sure(&[wrong], &right), [false]);
    }

    #[test]
    fn left_and_right_altogether_are_one_finding() {
        let mut take = person(1.0, 9.0);
        for k in 0..6 {
            take = exchanged(take, [k, k + 6]);
        }
        let like = templates(&[person(1.0, 0.0)], true);
        let sides = (0..6).flat_map(|k| [k, k + 6]).collect();
        let hand = (WholeTakeKind::Hand, sides);
        assert_eq!(check(&like, &take), (vec![hand.clone()], 0));
        let want = (WholeTakeKind::Exchanged, vec![2, 4]);
        let (mut found, _) = check(&like, &exchanged(take, [2, 4]));
        found.sort();
        assert_eq!(found, [hand, want]);
    }

    #[test]
    fn the_odd_one_of_three_takes_is_wrong() {
        let right = || person(1.0, 3.0);
        let wrong = exchanged(person(1.0, 6.0), [2, 4]);
        let like = templates(&[person(1.0, 0.0), wrong.clone()], true);
        assert_eq!(check(&like, &right()), (vec![], 1));
        let like = templates(&[person(1.0, 0.0), right()], true);
        let (found, notes) = like.check(&wrong, &(0..240));
        assert!(notes.is_empty());
        assert_eq!(
            found[0].sentence(&wrong.points),
            "Ann:LELB and Ann:LWRA are exchanged in every frame: take 0 and take 1 have them \
             otherwise"
        );
    }

    #[test]
    fn the_mirror_image_shows_exchanges_of_one_side() {
        let alone = Templates::default();
        assert_eq!(check(&alone, &person(1.0, 0.0)), (vec![], 0));
        let take = exchanged(person(1.0, 0.0), [2, 4]);
        let (found, _) = check(&alone, &take);
        let mut points = found[0].1.clone();
        points.sort_unstable();
        assert_eq!((found.len(), found[0].0), (1, WholeTakeKind::EitherSide));
        assert_eq!(points, [2, 4, 8, 10]);
    }

    #[test]
    fn one_side_of_a_long_exchange_fits() {
        let (right, wrong) = (person(1.1, 3.0), exchanged(person(1.1, 3.0), [2, 4]));
        let both = concatenate![Axis(0), right.xyz, wrong.xyz];
        let like = templates(&[person(1.0, 0.0)], false);
        let cost = |frames: Range<usize>| {
            like.cost(
                "",
                &right.points,
                both.view(),
                &[2, 4],
                std::slice::from_ref(&frames),
            )
        };
        let [first, second] = [0..240, 240..480].map(|frames| cost(frames).unwrap());
        assert!(second > first + 12.0, "{first} {second}");
        assert_eq!(cost(5..5), None);
    }

    #[test]
    fn takes_without_positions_say_nothing() {
        let mut poses = person(1.0, 0.0);
        poses.xyz.fill(f64::NAN);
        let like = templates(&[person(1.0, 0.0)], true);
        for templates in [&like, &Templates::default()] {
            for frames in [0, 1, 240] {
                assert_eq!(templates.check(&poses, &(0..frames)).0, []);
            }
        }
    }
}
