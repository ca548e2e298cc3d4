//! Poses that are alike by a chain of pairs.

use crate::numeric::union_find::root;

/// The connected components of alike pairs, the "chunklets" of Bar-Hillel et al. 2005.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Components {
    /// The members of each component of at least two poses, in rising order; components by their
    /// first member.
    pub groups: Vec<Vec<usize>>,
    /// The representative of each pose, its own index where it is alike to none: (n).
    pub of: Vec<usize>,
}

/// The components of `n` poses under pairs of indices below `n`. O(n + pairs), up to a slowly
/// growing factor.
pub(super) fn components(n: usize, alike: &[[usize; 2]]) -> Components {
    let mut of: Vec<usize> = (0..n).collect();
    for &[a, b] in alike {
        let (a, b) = (root(&mut of, a), root(&mut of, b));
        // The lower index stands for both, so that the order of the pairs does not matter.
        of[a.max(b)] = a.min(b);
    }
    let mut members = vec![Vec::new(); n];
    for i in 0..n {
        let root = root(&mut of, i);
        of[i] = root;
        members[root].push(i);
    }
    let groups = members.into_iter().filter(|m| m.len() > 1).collect();
    Components { groups, of }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_join_in_any_order() {
        let want = vec![vec![0, 3, 5], vec![1, 2]];
        for alike in [[[5, 3], [3, 0], [1, 2]], [[2, 1], [0, 5], [3, 5]]] {
            let found = components(7, &alike);
            assert_eq!(found.groups, want);
            assert_eq!(found.of, [0, 1, 1, 0, 4, 0, 6]);
        }
        assert!(components(3, &[[1, 1]]).groups.is_empty());
        assert!(components(0, &[]).of.is_empty());
    }
}
