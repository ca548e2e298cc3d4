//! Disjoint sets: each member points to another, and at last to the one that stands for all.

/// The member that stands for the set of `i`; halves the way to it.
pub fn root(parents: &mut [usize], mut i: usize) -> usize {
    while parents[i] != i {
        parents[i] = parents[parents[i]];
        i = parents[i];
    }
    i
}
