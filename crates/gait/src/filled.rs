//! Gaps of markers, filled from elsewhere within their span.

use crate::markers::MARKERS;
use crate::pose::{Poses, point_at};
use crate::trial::{FilledGap, Trial};
use glam::DVec3;
use ndarray::{Array2, ArrayView2};

impl Trial {
    /// Whether a marker is missing between its first and its last position.
    pub fn has_gaps(&self) -> bool {
        let tracks = MARKERS.iter().filter_map(|name| self.markers.get(name));
        let mut tracks = tracks.map(gaps_within);
        tracks.any(|gaps| !gaps.is_empty())
    }

    /// The trial with gaps of its markers filled where `restored` (centimeters, y up, points by the
    /// markers' names) has a position whose standard deviation `sd` (frames, points; cm) is at
    /// most `most` cm in all frames of the gap. What was seen stays, and nothing is written before
    /// a marker's first frame or behind its last. With it the deviations (frames, [`MARKERS`]; mm,
    /// 0 where a marker was seen).
    #[must_use]
    pub fn filled(
        &self,
        restored: &Poses,
        sd: ArrayView2<'_, f64>,
        most: f64,
    ) -> (Trial, Array2<f64>) {
        let mut trial = self.clone();
        let mut deviations = Array2::zeros((self.markers.frames(), MARKERS.len()));
        for (m, marker) in MARKERS.into_iter().enumerate() {
            let Some(track) = trial.markers.track_mut(m) else {
                continue;
            };
            let point = restored.points.iter().position(|name| name == marker);
            for [start, end] in gaps_within(track) {
                let filled = |t: usize| {
                    let p = point.filter(|p| sd[[t, *p]] <= most)?;
                    let at = point_at(restored.xyz.view(), t, p);
                    let at = 10.0 * DVec3::new(at.x, -at.z, at.y);
                    at.is_finite().then_some((at, 10.0 * sd[[t, p]]))
                };
                let whole: Option<Vec<(DVec3, f64)>> = (start..end).map(filled).collect();
                for (t, (at, sd)) in (start..end).zip(whole.iter().flatten()) {
                    track[t] = *at;
                    deviations[[t, m]] = *sd;
                }
                let square =
                    |all: Vec<(DVec3, f64)>| all.iter().map(|(_, sd)| sd * sd).sum::<f64>();
                let largest = whole
                    .iter()
                    .flatten()
                    .map(|(_, sd)| *sd)
                    .fold(0.0, f64::max);
                trial.gaps.push(FilledGap {
                    largest_mm: largest,
                    marker,
                    frames: [start, end],
                    sd_mm: whole.map(|all| (square(all) / (end - start) as f64).sqrt()),
                });
            }
        }
        (trial, deviations)
    }
}

/// The gaps of a track between its first and its last position.
fn gaps_within(track: &[DVec3]) -> Vec<[usize; 2]> {
    let seen: Vec<usize> = (0..track.len()).filter(|&t| track[t].is_finite()).collect();
    let pairs = seen.windows(2).filter(|pair| pair[1] - pair[0] > 1);
    pairs.map(|pair| [pair[0] + 1, pair[1]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Markers;

    #[test]
    fn what_was_seen_and_what_is_beyond_stays() {
        let nan = DVec3::NAN;
        let at = |x: f64| DVec3::new(x, 2.0, 3.0);
        let track = vec![nan, at(1.0), nan, nan, at(4.0), nan, at(6.0), nan];
        let trial = Trial::new(Markers::new([("LKNE", track.clone())]).unwrap(), 100.0);
        let mut restored = Poses {
            points: vec!["LKNE".into()],
            xyz: Array2::from_shape_fn((8, 3), |(t, c)| [t as f64, 0.3, -0.2][c]),
            ..Poses::default()
        };
        let sd = Array2::from_shape_fn((8, 1), |(t, _)| if t == 5 { 9.0 } else { 0.1 });
        let (filled, deviations) = trial.filled(&restored, sd.view(), 5.0);
        let own = filled.markers.get("LKNE").unwrap();
        assert!(own[0].is_nan() && own[5].is_nan() && own[7].is_nan());
        assert_eq!(own[1..5], [at(1.0), at(20.0), at(30.0), at(4.0)]);
        let knee = MARKERS.iter().position(|m| *m == "LKNE").unwrap();
        assert_eq!(deviations.column(knee).sum(), 2.0);
        assert_eq!(
            filled.gaps.iter().map(|g| g.sd_mm).collect::<Vec<_>>(),
            [Some(1.0), None]
        );
        restored.points[0] = "RKNE".into();
        assert_eq!(
            trial
                .filled(&restored, sd.view(), 5.0)
                .0
                .markers
                .get("LKNE")
                .unwrap()[1..2],
            track[1..2]
        );
    }
}
