//! Who is who in a take of several people: by what is written before or behind the names, else by
//! the distances, which are steady within a body and not between bodies.
//!
//! Names part people as `Ann:LFHD` and `Ben:LFHD` do, `Ann_LFHD` and `Ben_LFHD`, or `LFHD` and
//! `LFHD_2`, which is how readers tell repeated names apart.

use super::marker_distances::Distances;
use super::mirror::image;
use super::tuning::people::*;
use super::unlabeled::{labeled, marker_labels, own_name};
use crate::Result;
use ndarray::{ArrayView2, Axis, s};
use std::collections::{BTreeMap, BTreeSet};

/// The points of one person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Person {
    /// What stands before or behind the names; empty where nothing does.
    pub name: String,
    /// The points, in their order.
    pub points: Vec<usize>,
}

impl Person {
    /// A name of this person's without what tells the person: `Ann:LFHD`, `Ann_LFHD`, or `LFHD_2`.
    pub(crate) fn own_name<'n>(&self, name: &'n str) -> &'n str {
        let person = self.name.as_str();
        let before = name.strip_prefix(person).and_then(|n| n.strip_prefix('_'));
        let behind = name.strip_suffix(person).and_then(|n| n.strip_suffix('_'));
        let own = before.or(behind).filter(|_| !person.is_empty());
        own_name(own.unwrap_or(name))
    }
}

/// The people whose points are the `labels` among `points`, at `xyz` (frames, 3 P; cm): one of all,
/// where nothing parts them.
pub fn people(points: &[String], labels: &[usize], xyz: ArrayView2<'_, f64>) -> Vec<Person> {
    let parted = named(points, labels);
    if parted.len() > 1 {
        return parted;
    }
    let bodies = bodies(labels, xyz).into_iter().map(|points| Person {
        name: String::new(),
        points,
    });
    bodies.collect()
}

/// The people whose markers some points are: labels that are not computed from others, nor at the
/// origin in every frame.
pub(crate) fn people_of_markers(points: &[String], xyz: ArrayView2<'_, f64>) -> Vec<Person> {
    let mut labels = marker_labels(points);
    let is_somewhere = |p: usize| {
        xyz.slice(s![.., 3 * p..3 * p + 3])
            .iter()
            .any(|v| *v != 0.0)
    };
    labels.retain(|p| is_somewhere(*p));
    people(points, &labels, xyz)
}

/// What to say of people whom their names do not part.
pub(crate) fn parted_by_distances(points: &[String], people: &[Person]) -> Option<String> {
    let is_named = people.iter().any(|person| !person.name.is_empty());
    let first = people.first().filter(|_| people.len() > 1 && !is_named)?;
    let some: Vec<&str> = first
        .points
        .iter()
        .take(3)
        .map(|p| points[*p].as_str())
        .collect();
    Some(format!(
        "{} people by the distances between points, as no names part them: {}, … ({} points) move \
         as one body",
        people.len(),
        some.join(", "),
        first.points.len()
    ))
}

/// The points of a person by what tells that person in their names, and their own names.
///
/// # Errors
/// [`crate::Error::Unfit`]: the names tell no such person.
pub fn points_of_person(points: &[String], name: &str) -> Result<Vec<(usize, String)>> {
    let people = named(points, &labeled(points));
    let Some(person) = people.iter().find(|p| p.name == name && people.len() > 1) else {
        let all: Vec<&str> = people.iter().map(|p| p.name.as_str()).collect();
        return Err(match people.len() {
            0 | 1 => "names no people, such as Ann:LFHD and Ben:LFHD".to_string(),
            _ => format!("has no person \"{name}\", but {}", all.join(", ")),
        }
        .into());
    };
    let own = |p: &usize| (*p, person.own_name(&points[*p]).to_string());
    Ok(person.points.iter().map(own).collect())
}

/// The people that the names of points tell apart, each with their points and the own names of
/// these; points that are nobody's are left out. Empty where they tell none.
pub fn people_by_name(points: &[String]) -> Vec<(String, Vec<(usize, String)>)> {
    let people = named(points, &labeled(points));
    if people.len() < 2 {
        return Vec::new();
    }
    let own = |person: Person| {
        let of = |p: &usize| (*p, person.own_name(&points[*p]).to_string());
        (person.name.clone(), person.points.iter().map(of).collect())
    };
    people.into_iter().map(own).collect()
}

/// How many people the names of points tell apart.
pub fn named_people(points: &[String]) -> usize {
    named(points, &labeled(points)).len()
}

/// What tells a person in a name, and the person's own name.
type Parting = fn(&str) -> (&str, &str);

/// The people that names tell apart.
pub(crate) fn named(points: &[String], labels: &[usize]) -> Vec<Person> {
    let one = || {
        vec![Person {
            name: String::new(),
            points: labels.to_vec(),
        }]
    };
    let ways: [Parting; 3] = [
        |name| name.rsplit_once(':').unwrap_or(("", name)),
        |name| name.split_once('_').unwrap_or(("", name)),
        |name| match name.rsplit_once('_') {
            Some((own, number)) if number.parse::<u32>().is_ok() => (number, own),
            _ => ("", name),
        },
    ];
    let parted = ways.into_iter().enumerate().find_map(|(way, part)| {
        let mut by_mark: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for &label in labels {
            let (mark, _) = part(&points[label]);
            by_mark.entry(mark).or_default().push(label);
        }
        let own =
            |of: &[usize]| -> BTreeSet<&str> { of.iter().map(|l| part(&points[*l]).1).collect() };
        let people: Vec<&Vec<usize>> = (by_mark.values())
            .filter(|of| of.len() >= FEWEST_NAMED)
            .collect();
        // A colon stands behind a person's name; else two must share most of their names, and have
        // two sides: a left and a right hand are no people.
        let is_alike = |a: &[usize], b: &[usize]| {
            let (a, b) = (own(a), own(b));
            let both: Vec<String> = a.intersection(&b).map(|n| n.to_string()).collect();
            let sided = (0..both.len()).filter(|k| image(&both, *k).is_some_and(|i| i != *k));
            both.len() >= FEWEST_SHARED
                && 2 * both.len() > a.len().min(b.len())
                && sided.count() >= FEWEST_SIDED
        };
        let has_two = people.iter().enumerate().any(|(k, a)| {
            let has_mark = by_mark.get("").is_none_or(|of| of != *a);
            people[k + 1..].iter().any(|b| match way {
                0 => has_mark && !by_mark.contains_key("") || is_alike(a, b),
                1 => is_alike(a, b),
                // A repeated name has a number; so have the markers of a cluster.
                _ => !has_mark && is_alike(a, b),
            })
        });
        has_two.then_some(by_mark)
    });
    parted.map_or_else(one, |by_mark| {
        let person = |(name, points): (&str, Vec<usize>)| Person {
            name: name.to_string(),
            points,
        };
        by_mark.into_iter().map(person).collect()
    })
}

/// Bodies whose distances are not steady between each other; one of all, where they are.
fn bodies(labels: &[usize], xyz: ArrayView2<'_, f64>) -> Vec<Vec<usize>> {
    let count = labels.len();
    if !(2 * FEWEST_OF_BODY..=MOST_LABELS).contains(&count) {
        return vec![labels.to_vec()];
    }
    let columns: Vec<usize> = labels.iter().flat_map(|l| 3 * l..3 * l + 3).collect();
    let distances = Distances::measure(xyz.select(Axis(1), &columns).view());
    let between = |a: usize, b: usize| distances.between(a, b);
    let is_steady =
        |a: usize, b: usize| between(a, b).is_some_and(|d| d.spread < STEADY && d.median < NEAR);
    let mut body_of: Vec<Option<usize>> = vec![None; count];
    let mut bodies: Vec<Vec<usize>> = Vec::new();
    for first in 0..count {
        if body_of[first].is_some() {
            continue;
        }
        body_of[first] = Some(bodies.len());
        let mut all = vec![first];
        let mut k = 0;
        while k < all.len() {
            let next = (0..count).filter(|b| body_of[*b].is_none() && is_steady(all[k], *b));
            let next: Vec<usize> = next.collect();
            next.iter().for_each(|b| body_of[*b] = Some(bodies.len()));
            all.extend(next);
            k += 1;
        }
        bodies.push(all);
    }
    let is_large = |of: &Vec<usize>| of.len() >= FEWEST_OF_BODY.max(count / LARGEST_SHARE);
    let (mut large, small): (Vec<Vec<usize>>, Vec<Vec<usize>>) =
        bodies.into_iter().partition(is_large);
    if large.len() < 2 {
        return vec![labels.to_vec()];
    }
    let whole = large.clone();
    for point in small.into_iter().flatten() {
        let looseness = |of: &Vec<usize>| {
            let all = of.iter().filter_map(|b| between(point, *b));
            all.map(|d| d.looseness()).fold(f64::INFINITY, f64::min)
        };
        let nearest =
            (0..whole.len()).min_by(|a, b| looseness(&whole[*a]).total_cmp(&looseness(&whole[*b])));
        large[nearest.unwrap_or(0)].push(point);
    }
    let points = |mut of: Vec<usize>| {
        of.sort_unstable();
        of.into_iter().map(|k| labels[k]).collect()
    };
    large.into_iter().map(points).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    fn of(names: &[String]) -> Vec<(String, usize)> {
        let labels: Vec<usize> = (0..names.len()).collect();
        let all = named(names, &labels);
        all.into_iter().map(|p| (p.name, p.points.len())).collect()
    }

    fn marked(marks: [&str; 2], names: &str) -> Vec<String> {
        let all = |[before, behind]: [&str; 2]| {
            let own = names
                .split(' ')
                .map(move |n| format!("{before}{n}{behind}"));
            own.collect::<Vec<_>>()
        };
        all(marks)
    }

    #[test]
    fn names_part_people() {
        let set = "LFHD RFHD C7 T10 LSHO RSHO LELB RELB LWRA RWRA LKNE RKNE";
        let both = |a: [&str; 2], b: [&str; 2]| [marked(a, set), marked(b, set)].concat();
        let two = |a: &str, b: &str| vec![(a.to_string(), 12), (b.to_string(), 12)];
        assert_eq!(of(&both(["Ann:", ""], ["Ben:", ""])), two("Ann", "Ben"));
        assert_eq!(of(&both(["Ann_", ""], ["Ben_", ""])), two("Ann", "Ben"));
        assert_eq!(of(&both(["", ""], ["", "_2"])), two("", "2"));
        assert_eq!(of(&both(["", ""], ["Ben:", ""])), two("", "Ben"));
        // One person: a prefix of some, sides of a body, numbers behind.
        let one = vec![(String::new(), 12)];
        assert_eq!(
            of(&[marked(["A:", ""], set), marked(["", ""], "a b c d e f")].concat()),
            vec![(String::new(), 18)]
        );
        assert_eq!(
            of(&marked(
                ["", ""],
                "L_a R_a L_b R_b L_c R_c L_d R_d L_e R_e L_f R_f"
            )),
            one
        );
        assert_eq!(
            of(&marked(
                ["", ""],
                "a a_2 b b_2 c_1 c_2 c_3 c_4 d_1 d_2 d_3 d_4"
            )),
            one
        );
    }

    #[test]
    fn bodies_that_move_apart_are_two() {
        let body = |k: usize, t: usize| {
            let way = (0.05 * t as f64 + 2.0 * (k / 12) as f64).sin();
            let own = (k % 12) as f64;
            [
                90.0 * (k / 12) as f64 + 80.0 * way,
                9.0 * own,
                4.0 * (own * 1.7).sin(),
            ]
        };
        let xyz = Array2::from_shape_fn((200, 72), |(t, c)| body(c / 3, t)[c % 3]);
        let labels: Vec<usize> = (0..24).collect();
        let halves = vec![(0..12).collect::<Vec<_>>(), (12..24).collect()];
        assert_eq!(bodies(&labels, xyz.view()), halves);
        let one = xyz.slice(ndarray::s![.., ..51]);
        assert_eq!(bodies(&labels[..17], one), [labels[..17].to_vec()]);
    }
}
