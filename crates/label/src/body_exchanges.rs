//! What the body says of labels that labeled takes or the mirror image say are exchanged in every
//! frame of a take, and which it says so of by itself.

use super::body_evidence::BodyEvidence;
use super::label_model::LabelModel;
use super::label_settings::LabelSettings;
use super::marker_distances::Distances;
use super::mirror::{Mirror, image};
use super::people::Person;
use super::templates::{WholeTake, WholeTakeKind};
use super::tuning::body_evidence::{NO_OBJECTION, SURE, TOLD};
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
        match PersonLabels::new(body, person, names, xyz) {
            Some(labels) => out.extend(labels.judged(own, settings.named_by_like)),
            None => out.extend::<Vec<WholeTake>>(own),
        }
    }
    out.extend(left);
    out
}

/// The labels of a person and their body.
struct PersonLabels<'a> {
    evidence: BodyEvidence<'a>,
    person: &'a Person,
    names: Vec<String>,
    xyz: ArrayView2<'a, f64>,
}

impl<'a> PersonLabels<'a> {
    fn new(
        body: &'a dyn LabelModel,
        person: &'a Person,
        names: &[String],
        xyz: ArrayView2<'a, f64>,
    ) -> Option<PersonLabels<'a>> {
        let own = |p: &usize| person.own_name(&names[*p]).to_string();
        Some(PersonLabels {
            evidence: BodyEvidence::new(body, names, &person.points, xyz)?,
            names: person.points.iter().map(own).collect(),
            person,
            xyz,
        })
    }

    fn judged(&self, found: Vec<WholeTake>, named_by_like: bool) -> Vec<WholeTake> {
        let has_hand = found.iter().any(|whole| whole.kind == WholeTakeKind::Hand);
        if has_hand {
            return found;
        }
        let sure_of = |(gain, pair): (f64, [usize; 2])| {
            let is_sure =
                gain >= SURE && (self.other_side_is_right(pair) || self.mirror_agrees(pair));
            WholeTake::by_body(pair.to_vec(), is_sure)
        };
        let by_body: Vec<WholeTake> = self.evidence.exchanged().into_iter().map(sure_of).collect();
        let meets = |whole: &WholeTake, others: &[WholeTake]| {
            let mut all = others.iter().flat_map(|other| &other.points);
            all.any(|p| whole.points.contains(p))
        };
        // The mirror image does not say which pair of several it is.
        let is_other = |w: &WholeTake| w.kind != WholeTakeKind::EitherSide || !meets(w, &by_body);
        let found = found.into_iter().filter(is_other);
        let mut out: Vec<WholeTake> = found
            .filter_map(|whole| self.of(whole, named_by_like))
            .collect();
        for whole in by_body {
            if !meets(&whole, &out) {
                out.push(whole);
            }
        }
        out
    }

    /// What the body makes of what something else says.
    fn of(&self, whole: WholeTake, named_by_like: bool) -> Option<WholeTake> {
        match (whole.kind, &whole.points[..]) {
            (WholeTakeKind::Exchanged, [_, _]) => {
                let gain = self.evidence.gain(&whole.points);
                let is_sure = whole.is_sure
                    || gain.is_some_and(|gain| gain >= SURE)
                    || named_by_like && gain.is_none_or(|gain| gain >= NO_OBJECTION);
                let is_wrong = !is_sure && gain.is_some_and(|gain| gain <= -TOLD);
                (!is_wrong).then_some(WholeTake { is_sure, ..whole })
            }
            (WholeTakeKind::EitherSide, points) => {
                let half = points.len() / 2;
                let sides = [&points[..half], &points[half..]];
                if half != 2 {
                    return Some(whole);
                }
                let gains = sides.map(|side| self.evidence.gain(side));
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

    /// Whether the mirror images of two points fit the body as they are named. Where they do not
    /// either, markers may be meant to be where they are.
    fn other_side_is_right(&self, pair: [usize; 2]) -> bool {
        let image = |p: usize| {
            let label = self.person.points.iter().position(|q| *q == p)?;
            let image = image(&self.names, label).filter(|image| *image != label)?;
            Some(self.person.points[image])
        };
        let [Some(a), Some(b)] = pair.map(image) else {
            return false;
        };
        self.evidence
            .gain(&[a, b])
            .is_some_and(|gain| gain <= -TOLD)
    }

    /// Whether the sides of the body say that two points are exchanged, or differ less once they
    /// are.
    fn mirror_agrees(&self, pair: [usize; 2]) -> bool {
        let points = &self.person.points;
        let at = |p: usize| points.iter().position(|q| *q == p);
        let [Some(a), Some(b)] = pair.map(at) else {
            return false;
        };
        let columns = |points: &[usize]| -> Vec<usize> {
            points.iter().flat_map(|p| 3 * p..3 * p + 3).collect()
        };
        let own = self.xyz.select(Axis(1), &columns(points));
        let as_named = Mirror::new(&self.names, own.view());
        let distances = Distances::measure(own.view());
        let says = as_named.says(&distances, [a, b]);
        let before = as_named.exchanged(&distances).len();
        if says.is_some() || before == 0 {
            return says == Some(true);
        }
        let mut exchanged = points.clone();
        exchanged.swap(a, b);
        let put_back = self.xyz.select(Axis(1), &columns(&exchanged));
        let after = Mirror::new(&self.names, put_back.view());
        after.exchanged(&Distances::measure(put_back.view())).len() < before
    }
}
