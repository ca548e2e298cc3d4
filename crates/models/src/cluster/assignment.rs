//! The assignment step: which distances need no computing.
//!
//! Each pose x of cluster a keeps u, not below its distance to c_a, and l, not above its distance
//! to any other centroid (Hamerly 2010, Making k-means even faster). When the centroids move, u
//! grows by the shift of c_a and l shrinks by the largest shift; while u < l the label stands.
//!
//! Where it may not stand, the other candidates lie in a ball around c_a (Newling and Fleuret 2016,
//! Fast k-means with accurate bounds, section 3.1, the exponion): `|c_j - c_a| > R >= 2 u` gives
//! `|x - c_j| > R - u >= u`. One ball serves a tile of poses of the same cluster with similar u, so
//! that the distances left are still computed as a product of matrices.
//!
//! Cost of a step: n at the least, k products of k for the balls, n k D at the most.

use super::dataset::{Dataset, NearestCentroid, squared_distance};
use super::squared_distances::{Centroids, SLACK, Scratch, TILE};
use super::update::ClusterMembers;
use crate::numeric::parallel;

/// Poses of one cluster whose labels are in doubt, as a unit of work.
const PIECE: usize = 2 * TILE;
/// Pieces a thread takes at once: their centroids' distances are one product.
const PIECES: usize = 8;

/// Labels, and bounds that say which of them may change.
pub(super) struct BoundedAssignment {
    /// The cluster of each pose.
    pub labels: Vec<u32>,
    /// u less `traveled` of its cluster at the time of writing: moving a centroid touches no pose.
    upper: Vec<f64>,
    /// l plus `farthest` at the time of writing.
    lower: Vec<f64>,
    /// By cluster, the sum of its shifts so far.
    traveled: Vec<f64>,
    /// The sum over steps of the largest shift.
    farthest: f64,
    /// By cluster, whether a pose came or went since [`BoundedAssignment::move_centroids`].
    pub touched: Vec<bool>,
}

/// A pose in doubt and its u, no more than a rounding above the distance itself.
type UncertainPose = (u32, f64);
/// A pose, its new label, u and l.
type Reassignment = (u32, u32, f64, f64);

impl BoundedAssignment {
    /// Starts from `labels` (n), all below `k` and only hints: nothing is known of them.
    pub(crate) fn new(labels: Vec<u32>, k: usize) -> Self {
        let n = labels.len();
        BoundedAssignment {
            labels,
            upper: vec![f64::INFINITY; n],
            lower: vec![0.0; n],
            traveled: vec![0.0; k],
            farthest: 0.0,
            touched: vec![true; k],
        }
    }

    /// Takes note that centroid `j` has moved by `shifts[j]`.
    pub(crate) fn move_centroids(&mut self, shifts: &[f64]) {
        let mut farthest = 0.0f64;
        for (traveled, shift) in self.traveled.iter_mut().zip(shifts) {
            let shift = shift * (1.0 + SLACK);
            *traveled += shift;
            farthest = farthest.max(shift);
        }
        self.farthest += farthest;
        self.touched.fill(false);
    }

    /// Puts pose `i` into cluster `label` whatever its distance; the next step looks at it again.
    pub(crate) fn assign_to(&mut self, i: u32, label: u32) {
        self.relabel(i as usize, label);
        self.upper[i as usize] = f64::INFINITY;
        self.lower[i as usize] = 0.0;
    }

    /// Whether the label was another.
    fn relabel(&mut self, i: usize, label: u32) -> bool {
        let old = std::mem::replace(&mut self.labels[i], label);
        if old != label {
            self.touched[old as usize] = true;
            self.touched[label as usize] = true;
        }
        old != label
    }

    /// Gives each pose to its nearest centroid; says how many changed.
    pub(crate) fn step(&mut self, poses: Dataset<'_>, centroids: &Centroids) -> usize {
        let uncertain = self.uncertain_poses(poses, centroids);
        let names: Vec<u32> = uncertain
            .iter()
            .map(|d| self.labels[d.0 as usize])
            .collect();
        let groups = ClusterMembers::new(&names, centroids.k());
        let pieces = groups.pieces(PIECE, |_| true);
        let findings = parallel::map_chunks(pieces.len(), PIECES, |chunk| {
            let mut scratch = Scratch::new(poses.d);
            let owners: Vec<u32> = pieces[chunk.clone()].iter().map(|p| p.0).collect();
            let distances_to = centroids.centroid_distances(&owners, &mut scratch);
            let mut findings = Vec::new();
            for ((owner, members), distances_to) in pieces[chunk].iter().zip(distances_to.rows()) {
                let mut uncertain: Vec<UncertainPose> =
                    members.iter().map(|&i| uncertain[i as usize]).collect();
                uncertain.sort_unstable_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
                let distances_to = distances_to
                    .to_slice()
                    .expect("a row of a table made there");
                for uncertain in uncertain.chunks(TILE) {
                    assign_tile(
                        poses,
                        centroids,
                        *owner,
                        uncertain,
                        distances_to,
                        &mut scratch,
                        &mut findings,
                    );
                }
            }
            findings
        });
        let mut changed = 0;
        for (i, label, upper, lower) in findings.into_iter().flatten() {
            let i = i as usize;
            changed += usize::from(self.relabel(i, label));
            self.upper[i] = upper - self.traveled[label as usize];
            self.lower[i] = lower + self.farthest;
        }
        changed
    }

    /// The poses whose bounds leave their label open, with u made tight.
    fn uncertain_poses(&self, poses: Dataset<'_>, centroids: &Centroids) -> Vec<UncertainPose> {
        if centroids.k() == 1 {
            return Vec::new();
        }
        let uncertain = parallel::map_chunks(poses.n, 4096, |rows| {
            let mut uncertain = Vec::new();
            for i in rows {
                let label = self.labels[i] as usize;
                let lower = self.lower[i] - self.farthest;
                if self.upper[i] + self.traveled[label] < lower {
                    continue;
                }
                let squared = squared_distance(poses.row(i), centroids.row(label));
                let upper = squared.sqrt() * (1.0 + SLACK);
                // Strictly: on a tie the lower label wins, which only the distances can tell.
                if upper < lower {
                    continue;
                }
                uncertain.push((i as u32, upper));
            }
            uncertain
        });
        uncertain.concat()
    }
}

/// Finds the nearest centroid of a tile of poses of cluster `owner`, `uncertain` ascending in u.
fn assign_tile(
    poses: Dataset<'_>,
    centroids: &Centroids,
    owner: u32,
    uncertain: &[UncertainPose],
    distances_to: &[f32],
    scratch: &mut Scratch,
    findings: &mut Vec<Reassignment>,
) {
    let widest = uncertain.last().map_or(0.0, |d| d.1);
    let others = distances_to
        .iter()
        .enumerate()
        .filter(|&(j, _)| j != owner as usize);
    let nearest = others.fold(
        f32::INFINITY,
        |least, (_, &x)| if x < least { x } else { least },
    );
    // With the nearest neighbor's distance added the ball holds the second-nearest centroid of
    // every pose, so that l is as good as without a ball.
    let radius = 2.0 * widest * (1.0 + SLACK) + f64::from(nearest) * (1.0 + 1e-5);
    let limit = radius as f32 * (1.0 + f32::EPSILON);
    let inside: Vec<u32> = (0..distances_to.len() as u32)
        .filter(|&j| distances_to[j as usize] <= limit || j == owner)
        .collect();
    let all = inside.len() == distances_to.len();
    let ids: Vec<u32> = uncertain.iter().map(|d| d.0).collect();
    let mut found: Vec<NearestCentroid> = Vec::with_capacity(ids.len());
    let candidates = (!all).then_some(&inside[..]);
    centroids.nearest(poses, &ids, candidates, scratch, &mut found);
    for ((i, upper), near) in uncertain.iter().zip(found) {
        let outside = if all { f64::INFINITY } else { radius - upper };
        let lower = near.second.sqrt().min(outside) * (1.0 - SLACK);
        findings.push((*i, near.label, near.squared.sqrt() * (1.0 + SLACK), lower));
    }
}
