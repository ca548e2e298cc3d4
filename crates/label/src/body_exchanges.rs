//! What the body says of labels that labeled takes or the mirror image say are exchanged in every
//! frame of a take, and which it says so of by itself.

use super::label_model::LabelModel;
use super::label_settings::LabelSettings;
use super::marker_distances::Distances;
use super::mirror::Mirror;
use super::people::Person;
use super::referee::Referee;
use super::templates::{WholeTake, WholeTakeKind};
use super::tuning::referee::{NO_OBJECTION, SURE, TOLD};
use ndarray::{ArrayView2, Axis};

/// What is found to be wrong in every frame of a take, as the body says: without what it objects
/// to, with what it says besides.
pub(super) fn judged(
    found: Vec<WholeTake>,
    people: &[Person],
    (names, xyz): (&[String], ArrayView2<'_, f64>),
    settings: &LabelSettings,
) -> Vec<WholeTake> {
    let Some(body) = settings.body.as_deref() else {
        return found;
    };
    let mut left = found;
    let mut out = Vec::new();
    for person in people {
        let is_own = |whole: &WholeTake| whole.points.iter().all(|p| person.points.contains(p));
        let (own, others) = left.into_iter().partition(is_own);
        left = others;
        match Judge::new(body, person, names, xyz) {
            Some(judge) => out.extend(judge.judged(own, settings.are_by_like)),
            None => out.extend::<Vec<WholeTake>>(own),
        }
    }
    out.extend(left);
    out
}

/// The labels of a person and their body.
struct Judge<'a> {
    referee: Referee<'a>,
    person: &'a Person,
    names: Vec<String>,
    xyz: ArrayView2<'a, f64>,
}

impl<'a> Judge<'a> {
    fn new(
        body: &'a dyn LabelModel,
        person: &'a Person,
        names: &[String],
        xyz: ArrayView2<'a, f64>,
    ) -> Option<Judge<'a>> {
        let own = |p: &usize| person.own_name(&names[*p]).to_string();
        Some(Judge {
            referee: Referee::new(body, names, &person.points, xyz)?,
            names: person.points.iter().map(own).collect(),
            person,
            xyz,
        })
    }

    fn judged(&self, found: Vec<WholeTake>, are_by_like: bool) -> Vec<WholeTake> {
        let has_hand = found.iter().any(|whole| whole.kind == WholeTakeKind::Hand);
        if has_hand {
            return found;
        }
        let mut out: Vec<WholeTake> = (found.into_iter())
            .filter_map(|whole| self.of(whole, are_by_like))
            .collect();
        // What nothing else says.
        let known: Vec<usize> = out.iter().flat_map(|whole| whole.points.clone()).collect();
        for (gain, pair) in self.referee.exchanged() {
            let is_known = pair.iter().any(|p| known.contains(p));
            if !is_known
                && !out
                    .iter()
                    .any(|w| pair.iter().any(|p| w.points.contains(p)))
            {
                let is_sure = gain >= SURE && self.mirror_says(pair) == Some(true);
                out.push(WholeTake::by_body(pair.to_vec(), is_sure));
            }
        }
        out
    }

    /// What the body makes of what something else says.
    fn of(&self, whole: WholeTake, are_by_like: bool) -> Option<WholeTake> {
        match (whole.kind, &whole.points[..]) {
            (WholeTakeKind::Exchanged, [_, _]) => {
                let gain = self.referee.gain(&whole.points);
                let is_sure = whole.is_sure
                    || gain.is_some_and(|gain| gain >= SURE)
                    || are_by_like && gain.is_none_or(|gain| gain >= NO_OBJECTION);
                let is_wrong = !is_sure && gain.is_some_and(|gain| gain <= -TOLD);
                (!is_wrong).then_some(WholeTake { is_sure, ..whole })
            }
            (WholeTakeKind::EitherSide, points) => {
                let half = points.len() / 2;
                let sides = [&points[..half], &points[half..]];
                if half != 2 {
                    return Some(whole);
                }
                let gains = sides.map(|side| self.referee.gain(side));
                let [Some(one), Some(other)] = gains else {
                    return Some(whole);
                };
                let (best, side) = if one > other {
                    (one, sides[0])
                } else {
                    (other, sides[1])
                };
                if best >= TOLD {
                    return Some(WholeTake::by_body(side.to_vec(), true));
                }
                (best > NO_OBJECTION).then_some(whole)
            }
            _ => Some(whole),
        }
    }

    /// What the sides of the body say of two points that are exchanged or not.
    fn mirror_says(&self, pair: [usize; 2]) -> Option<bool> {
        let points = &self.person.points;
        let columns: Vec<usize> = points.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
        let own = self.xyz.select(Axis(1), &columns);
        let at = |p: usize| points.iter().position(|q| *q == p);
        let pair = [at(pair[0])?, at(pair[1])?];
        Mirror::new(&self.names, own.view()).says(&Distances::measure(own.view()), pair)
    }
}
