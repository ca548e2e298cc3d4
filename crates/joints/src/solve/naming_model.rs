//! What labeled takes teach: the body, where enough of their labels are on it, else the labels by
//! themselves.

use super::body_labels::BodyModel;
use super::marker_sets::MarkerSet;
use super::tuning::FEWEST_MARKERS;
use super::tuning::naming_model::*;
use crate::label::unlabeled::{is_unlabeled, marker_labels};
use crate::label::{LabelModel, LabelSettings};
use crate::numeric::statistics::{median, quantile};
use crate::pose::Poses;
use crate::pose::zeros::Zeros;
use crate::{Error, Result};
use ndarray::Array2;
use std::sync::Arc;

/// How labels are put right, with the body that those among some points are on.
pub fn on_body(settings: &LabelSettings, points: &[String]) -> LabelSettings {
    LabelSettings {
        body: body_of(points),
        ..settings.clone()
    }
}

/// The body that the labels of some points are on, by the built-in set that knows most of them;
/// `None` where it knows few.
fn body_of(points: &[String]) -> Option<Arc<dyn LabelModel>> {
    let set = MarkerSet::of(points)?;
    let known = set.markers(points).len();
    let body = (known >= FEWEST_MARKERS).then(|| BodyModel::new(set).ok());
    body.flatten()
        .map(|body| Arc::new(body) as Arc<dyn LabelModel>)
}

/// The model that names tracks as in labeled takes of people: their body, where `set` (`None`: the
/// built-in set that knows most) knows at least eight, and half, of the labels; else the labels by
/// themselves. Without takes, it is that of the set.
///
/// # Errors
/// [`Error::Usage`]: too few labels, or neither takes nor a set.
pub fn naming_model(takes: &[&Poses], set: Option<&MarkerSet>) -> Result<Box<dyn LabelModel>> {
    match set.filter(|_| takes.is_empty()) {
        Some(set) => set.model(),
        None => MarkerSet::of_labels("like", takes, set)?.model(),
    }
}

impl MarkerSet {
    fn model(&self) -> Result<Box<dyn LabelModel>> {
        match &self.postures {
            Some(postures) => Ok(Box::new(postures.clone())),
            None => Ok(Box::new(BodyModel::new(self)?)),
        }
    }

    fn of_labels(name: &str, takes: &[&Poses], set: Option<&MarkerSet>) -> Result<MarkerSet> {
        if !takes.iter().all(|take| is_on_body(&take.points, set)) {
            return MarkerSet::of_postures(name, takes);
        }
        let pairs: Vec<_> = takes.iter().map(|take| (*take, None)).collect();
        MarkerSet::learn(name, &pairs, set)
    }

    /// Learns a set from takes, such as those of a folder: from those of them in which labeled
    /// people stand still, or else from all that have labels. Which these are is told as well.
    ///
    /// Where `set` (`None`: the built-in set that knows most) knows too few of the labels, the set
    /// has no landmarks: it names tracks, and makes no skeleton.
    ///
    /// # Errors
    /// [`Error::Usage`]: no take has labels, or too few are seen.
    pub fn learn_from(
        name: &str,
        takes: &[&Poses],
        set: Option<&MarkerSet>,
    ) -> Result<(MarkerSet, Vec<usize>)> {
        let labeled: Vec<usize> = (0..takes.len()).filter(|n| is_labeled(takes[*n])).collect();
        if labeled.is_empty() {
            return Err(Error::usage("no take has labels to learn"));
        }
        let is_static = |n: &&usize| stands(takes[**n]);
        let statics: Vec<usize> = labeled.iter().filter(is_static).copied().collect();
        let used = if statics.is_empty() { labeled } else { statics };
        let own: Vec<&Poses> = used.iter().map(|n| takes[*n]).collect();
        Ok((MarkerSet::of_labels(name, &own, set)?, used))
    }
}

/// Whether a set knows enough of some labels to tell a body by them.
fn is_on_body(points: &[String], set: Option<&MarkerSet>) -> bool {
    let Some(set) = set.or_else(|| MarkerSet::of(points)) else {
        return false;
    };
    let known = set.markers(points).len();
    known >= FEWEST_MARKERS && 2 * known >= marker_labels(points).len()
}

/// Whether most of the tracks of a take have labels.
fn is_labeled(take: &Poses) -> bool {
    let nameless = take.points.iter().filter(|p| is_unlabeled(p)).count();
    marker_labels(&take.points).len() >= FEWEST_LABELS.max(nameless)
}

/// Whether half of the labels of a take hardly move.
fn stands(take: &Poses) -> bool {
    let xyz: &Array2<f64> = &Zeros::emptied(take).xyz;
    let moves = |p: usize| {
        let of = |c: usize| {
            let column = xyz.column(3 * p + c);
            let seen: Vec<f64> = column.iter().copied().filter(|v| v.is_finite()).collect();
            Some(quantile(seen.clone(), 0.95)? - quantile(seen, 0.05)?)
        };
        let all = [0, 1, 2].map(of).into_iter().flatten();
        all.reduce(f64::max)
    };
    let all = marker_labels(&take.points).into_iter().filter_map(moves);
    median(all.collect()).is_some_and(|moves| moves < STILL)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::marker_solver::tests::person;
    use crate::solve::{SolveSettings, solve};

    /// The take with labels that no set knows.
    fn renamed(poses: &Poses) -> Poses {
        let names = 0..poses.points.len();
        Poses {
            points: names.map(|n| format!("q{n}")).collect(),
            ..poses.clone()
        }
    }

    #[test]
    fn a_set_of_any_labels_is_the_same_from_its_file() {
        let other = renamed(&person(60).0);
        let (set, used) = MarkerSet::learn_from("mine", &[&other], None).unwrap();
        assert_eq!(used, [0]);
        let file = tempfile::NamedTempFile::new().unwrap();
        let text = set.to_json().unwrap();
        std::fs::write(file.path(), &text).unwrap();
        let again = MarkerSet::open(file.path()).unwrap();
        assert_eq!(again.to_json().unwrap(), text);
        let model = naming_model(&[], Some(&again)).unwrap();
        assert_eq!(model.labels(), other.points);
        // It says why it makes no skeleton.
        let settings = SolveSettings {
            set: Some(&again),
            ..SolveSettings::default()
        };
        let error = solve(&other, &settings, &mut |_| ())
            .unwrap_err()
            .to_string();
        assert!(error.contains("no skeleton: the set"), "{error}");
        let broken = text.replacen("\"q0\",", "", 1);
        std::fs::write(file.path(), broken).unwrap();
        let error = MarkerSet::open(file.path()).unwrap_err().to_string();
        assert!(error.contains("do not fit each other"), "{error}");
    }

    #[test]
    fn labels_on_a_body_are_learned_as_before() {
        let (poses, _) = person(60);
        let learned = MarkerSet::learn("mine", &[(&poses, None)], None).unwrap();
        let (set, _) = MarkerSet::learn_from("mine", &[&poses], None).unwrap();
        assert_eq!(set, learned);
        let mut still = poses.clone();
        for t in 0..60 {
            let first = poses.xyz.row(0).to_owned();
            still.xyz.row_mut(t).assign(&first);
        }
        // The static take is believed, not what moves beside it, nor what has no labels.
        let mut nameless = poses.clone();
        nameless
            .points
            .iter_mut()
            .for_each(|p| *p = "*1".to_string());
        let takes = [&nameless, &poses, &still];
        let (_, used) = MarkerSet::learn_from("mine", &takes, None).unwrap();
        assert_eq!(used, [2]);
        assert!(MarkerSet::learn_from("mine", &takes[..1], None).is_err());
    }
}
