//! Labels that are exchanged in every frame of a take, so that no frame shows it.

use super::tuning::whole_take::CLEAR;
use crate::numeric::parallel;

/// The pairs of labels that are exchanged, the clearest first: one exchange is made after the
/// other, while one gains enough. `gain` is that of exchanging two labels, where the label `l` is
/// at the positions of the track `tracks[l]`.
pub(super) fn exchanged(
    labels: usize,
    gain: impl Fn(&[usize], [usize; 2]) -> f64 + Sync,
) -> Vec<[usize; 2]> {
    let mut tracks: Vec<usize> = (0..labels).collect();
    let mut out: Vec<[usize; 2]> = Vec::new();
    while out.len() < labels {
        let best_with = |a: usize| {
            let later = (a + 1..labels).map(|b| (gain(&tracks, [a, b]), [a, b]));
            later.max_by(|x, y| x.0.total_cmp(&y.0))
        };
        let rows = parallel::map_chunks(labels, 1, |range| best_with(range.start));
        let best = rows.into_iter().flatten();
        match best.max_by(|x, y| x.0.total_cmp(&y.0)) {
            Some((gain, pair)) if gain > CLEAR && !out.contains(&pair) => {
                tracks.swap(pair[0], pair[1]);
                out.push(pair);
            }
            _ => break,
        }
    }
    out
}

/// The labels of pairs that share some, together, in order.
pub(super) fn groups(pairs: &[[usize; 2]]) -> Vec<Vec<usize>> {
    let mut out: Vec<Vec<usize>> = Vec::new();
    for pair in pairs {
        let (with, rest): (Vec<_>, Vec<_>) = std::mem::take(&mut out)
            .into_iter()
            .partition(|group| pair.iter().any(|l| group.contains(l)));
        let mut group = with.concat();
        group.extend(pair);
        group.sort_unstable();
        group.dedup();
        out = rest;
        out.push(group);
    }
    out
}
