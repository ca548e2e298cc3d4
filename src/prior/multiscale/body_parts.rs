//! Which points make which part of a body, and which parts make a whole.

use crate::pose::joints;

/// The limbs of CMU's skeleton by the joint each begins with; the trunk is what is left, the root goes with the legs.
const LIMBS: [&str; 4] = ["lhipjoint", "rhipjoint", "lclavicle", "rclavicle"];

/// The coordinates of each part, and which parts make a whole body: {whole}, {legs and root, upper},
/// {left leg and root, right leg, upper}, {legs and root, trunk, left arm, right arm}.
///
/// Points that the skeleton does not know make one part, the whole.
pub fn parts(points: &[String]) -> (Vec<Vec<usize>>, Vec<Vec<usize>>) {
    let limb = |name: &String| {
        let mut at = joints::CMU.iter().position(|c| c == name)?;
        loop {
            if let Some(limb) = LIMBS.iter().position(|l| *l == joints::CMU[at]) {
                return Some(limb + 1);
            }
            if at == 0 {
                return Some(0);
            }
            at = joints::CMU_PARENT[at];
        }
    };
    let limbs: Option<Vec<usize>> = points.iter().map(limb).collect();
    let all = |needed: &dyn Fn(usize) -> bool| -> Vec<usize> {
        (0..points.len())
            .filter(|&p| needed(p))
            .flat_map(|p| 3 * p..3 * p + 3)
            .collect()
    };
    let whole = all(&|_| true);
    let Some(limbs) = limbs else {
        return (vec![whole], vec![vec![0]]);
    };
    let root = |p: usize| points[p] == joints::CMU[0];
    let of = |list: &[usize], with_root: bool| {
        all(&|p| {
            if root(p) {
                with_root
            } else {
                list.contains(&limbs[p])
            }
        })
    };
    let parts = vec![
        whole,
        of(&[1, 2], true),
        of(&[0, 3, 4], false),
        of(&[1], true),
        of(&[2], false),
        of(&[0], false),
        of(&[3], false),
        of(&[4], false),
    ];
    if parts.iter().any(Vec::is_empty) {
        return (vec![parts[0].clone()], vec![vec![0]]);
    }
    let factorizations = vec![vec![0], vec![1, 2], vec![3, 4, 2], vec![1, 5, 6, 7]];
    (parts, factorizations)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_way_covers_every_coordinate_once() {
        let names = joints::cmu_names();
        let (parts, factorizations) = parts(&names);
        assert_eq!(factorizations.len(), 4);
        for factorization in &factorizations {
            let mut all: Vec<usize> = factorization
                .iter()
                .flat_map(|&p| parts[p].clone())
                .collect();
            all.sort_unstable();
            assert_eq!(all, (0..69).collect::<Vec<_>>());
        }
        let (parts, factorizations) = super::parts(&["a".into(), "b".into()]);
        assert_eq!(
            (parts, factorizations),
            (vec![(0..6).collect()], vec![vec![0]])
        );
    }
}
