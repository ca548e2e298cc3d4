//! Tracks without a label, by the names that systems give them: `*68`, `Unlabeled 3`, `New 0002`,
//! `uname12`, `U_7`; a subject's prefix may come first.

use crate::pose::Poses;
use ndarray::Axis;
use std::borrow::Cow;

/// What such names begin with, in small letters; digits may follow. After the second, which may be
/// labels themselves, they must.
const BEGINNINGS: [&str; 5] = ["*", "unlabeled", "unlabelled", "unnamed", "uname"];
const BEFORE_DIGITS: [&str; 3] = ["new", "u", "u_"];

/// A name without the subject's prefix.
pub fn own_name(name: &str) -> &str {
    name.rsplit(':').next().unwrap_or(name)
}

/// Whether a name says that its track has no label.
pub fn is_unlabeled(name: &str) -> bool {
    let own = own_name(name).to_lowercase();
    let is_number = |rest: &str| {
        let digits = rest.strip_prefix([' ', '_']).unwrap_or(rest);
        digits.bytes().all(|b| b.is_ascii_digit() || b == b'_')
    };
    let mut rests = BEGINNINGS.iter().filter_map(|b| own.strip_prefix(b));
    let mut numbered = BEFORE_DIGITS.iter().filter_map(|b| own.strip_prefix(b));
    let ends_in_digit = own.ends_with(|c: char| c.is_ascii_digit());
    rests.any(is_number) || ends_in_digit && numbered.any(is_number)
}

/// Whether a point is no marker but computed from others, by its name among `all`: the origin and
/// the axes of a segment (HEDO, HEDA, HEDL, HEDP), or a center of mass.
pub fn is_computed(name: &str, all: &[String]) -> bool {
    let ends = ['O', 'A', 'L', 'P'];
    let has = |stem: &str, end: char| all.iter().any(|n| n.strip_suffix(end) == Some(stem));
    let stem = name.strip_suffix(ends);
    stem.is_some_and(|stem| ends.iter().all(|end| has(stem, *end)))
        || own_name(name).starts_with("Cent") && name.contains("OfMass")
}

/// The names of `points` that are labels, as indices among them.
pub fn labeled(points: &[String]) -> Vec<usize> {
    let all = 0..points.len();
    all.filter(|p| !is_unlabeled(&points[*p])).collect()
}

/// The names of `points` that are markers' labels, as indices among them: those of what was not
/// computed from others.
pub fn marker_labels(points: &[String]) -> Vec<usize> {
    let mut labels = labeled(points);
    labels.retain(|p| !is_computed(&points[*p], points));
    labels
}

/// The poses of the `points` of some that have a label.
pub fn labeled_poses<'a>(poses: &'a Poses, points: &[usize]) -> Cow<'a, Poses> {
    if points.len() == poses.points.len() {
        return Cow::Borrowed(poses);
    }
    let columns: Vec<usize> = points.iter().flat_map(|p| 3 * p..3 * p + 3).collect();
    Cow::Owned(Poses {
        points: points.iter().map(|p| poses.points[*p].clone()).collect(),
        xyz: poses.xyz.select(Axis(1), &columns),
        time: poses.time.clone(),
        take: poses.take.clone(),
    })
}

/// What to say of the tracks without a label among `points`; `None` if there are none.
pub fn left_alone(points: &[String]) -> Option<String> {
    let of = labeled(points);
    let some: Vec<&str> = (0..points.len())
        .filter(|p| of.binary_search(p).is_err())
        .map(|p| points[p].as_str())
        .collect();
    let shown = some.iter().take(3).copied().collect::<Vec<_>>().join(", ");
    match some.len() {
        0 => None,
        1 => Some(format!("{shown} has no label: left alone")),
        n => {
            let more = if n > 3 { ", …" } else { "" };
            Some(format!(
                "{n} tracks without a label are left alone ({shown}{more})"
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_without_a_label_are_told() {
        for name in [
            "*68",
            "*",
            "Unlabeled 3",
            "Anna:*112",
            "New 0003",
            "unlabelled_9004",
            "uname",
            "U_12",
            "U7",
            "Unnamed",
        ] {
            assert!(is_unlabeled(name), "{name}");
        }
        for name in [
            "LASI",
            "U",
            "U_",
            "New",
            "Newton",
            "UPA",
            "unit_1",
            "root",
            "Anna:LUPA",
            "new_hip",
        ] {
            assert!(!is_unlabeled(name), "{name}");
        }
    }

    #[test]
    fn they_are_named() {
        let points = |names: &str| names.split(' ').map(String::from).collect::<Vec<_>>();
        assert_eq!(left_alone(&points("LASI RASI")), None);
        assert_eq!(
            left_alone(&points("LASI *3")).as_deref(),
            Some("*3 has no label: left alone")
        );
        let many = left_alone(&points("*3 a *4 *5 *6"));
        let want = "4 tracks without a label are left alone (*3, *4, *5, …)";
        assert_eq!(many.as_deref(), Some(want));
        assert_eq!(labeled(&points("*3 a *4 b")), [1, 3]);
        assert!(labeled(&points("*3 *4")).is_empty());
        let none = "2 tracks without a label are left alone (*3, *4)";
        assert_eq!(left_alone(&points("*3 *4")).as_deref(), Some(none));
    }
}
