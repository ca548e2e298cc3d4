//! The markers of Plug-in Gait by name, as positions over time.

use crate::pose::Poses;
use crate::pose::point_at;
use crate::side::Side;
use crate::{Error, Result};
use glam::DVec3;
use ndarray::Array2;

/// The markers that the model knows: pelvis, left and right leg, head, trunk, left and right arm.
pub const MARKERS: [&str; 35] = [
    "LASI", "RASI", "SACR", "LPSI", "RPSI", "LTHI", "LKNE", "LTIB", "LANK", "LHEE", "LTOE", "RTHI",
    "RKNE", "RTIB", "RANK", "RHEE", "RTOE", "LFHD", "RFHD", "LBHD", "RBHD", "C7", "T10", "CLAV",
    "STRN", "LSHO", "LELB", "LWRA", "LWRB", "LFIN", "RSHO", "RELB", "RWRA", "RWRB", "RFIN",
];
/// Where parts of the body begin among [`MARKERS`], those of the left side before the right ones.
const LEGS: usize = 5;
const HEAD: usize = 17;
const TRUNK: usize = 21;
const ARMS: usize = 25;

/// The tracks of the markers: positions in millimeters in the axes of the laboratory, z up; NaN
/// where a marker is missing.
#[derive(Debug, Clone, PartialEq)]
pub struct Markers {
    frames: usize,
    /// One a name of [`MARKERS`]; `None` where there is no such marker.
    tracks: Vec<Option<Vec<DVec3>>>,
    /// The markers that are at exactly 0 0 0 in some frames, which are taken for missing there.
    pub at_zero: Vec<&'static str>,
}

impl Markers {
    /// Markers of tracks of equal length, millimeters, z up. A prefix that ends in `:` does not
    /// count; of tracks of one name the first is taken, and names that [`MARKERS`] has not are
    /// left out. Where there is a SACR, LPSI and RPSI are not used.
    ///
    /// # Errors
    /// [`Error::Unfit`]: a track is longer or shorter than the first.
    pub fn new<'a>(given: impl IntoIterator<Item = (&'a str, Vec<DVec3>)>) -> Result<Markers> {
        let given: Vec<_> = given.into_iter().collect();
        let frames = given.first().map_or(0, |(_, track)| track.len());
        if let Some((name, _)) = given.iter().find(|(_, track)| track.len() != frames) {
            let what = format!("the track of {name} has another length than the first");
            return Err(Error::unfit(what));
        }
        Ok(Markers::of_tracks(frames, given.into_iter()))
    }

    /// The markers of poses, which are in centimeters with y up; [`Markers::new`] says of which
    /// names.
    pub fn from_poses(poses: &Poses) -> Markers {
        let to_lab = |p: DVec3| 10.0 * DVec3::new(p.x, -p.z, p.y);
        let frames = poses.frames();
        let at = |point: usize, t: usize| to_lab(point_at(poses.xyz.view(), t, point));
        let names = poses.points.iter().enumerate();
        let tracks = names.map(|(p, name)| (&**name, (0..frames).map(|t| at(p, t)).collect()));
        Markers::of_tracks(frames, tracks)
    }

    /// Whether these are the markers of Plug-in Gait's pelvis, and of a thigh or a shank.
    pub fn are_plug_in_gait(&self) -> bool {
        let has = |names: &[&str]| names.iter().all(|name| self.get(name).is_some());
        let sacrum = has(&["SACR"]) || has(&["LPSI", "RPSI"]);
        let wands = ["LTHI", "LTIB", "RTHI", "RTIB"];
        has(&["LASI", "RASI"]) && sacrum && wands.iter().any(|wand| has(&[*wand]))
    }

    /// The markers as poses, in centimeters with y up, with a time a frame in seconds; empty (NaN)
    /// where one is missing.
    pub fn to_poses(&self, times: Vec<f64>) -> Poses {
        let known = || {
            MARKERS
                .iter()
                .zip(&self.tracks)
                .filter_map(|(n, t)| Some((n, t.as_ref()?)))
        };
        let tracks: Vec<&Vec<DVec3>> = known().map(|(_, track)| track).collect();
        let value = |(t, c): (usize, usize)| {
            let at = tracks[c / 3][t];
            [at.x, at.z, -at.y][c % 3] / 10.0
        };
        Poses {
            points: known().map(|(name, _)| name.to_string()).collect(),
            xyz: Array2::from_shape_fn((self.frames, 3 * tracks.len()), value),
            time: Some(times),
            take: None,
        }
    }

    fn of_tracks<'a>(frames: usize, given: impl Iterator<Item = (&'a str, Vec<DVec3>)>) -> Markers {
        let mut tracks: Vec<Option<Vec<DVec3>>> = vec![None; MARKERS.len()];
        let mut at_zero = Vec::new();
        for (name, mut track) in given {
            let name = name.rsplit(':').next().unwrap_or_default().trim();
            let at = MARKERS.iter().position(|marker| *marker == name);
            let Some(at) = at.filter(|at| tracks[*at].is_none()) else {
                continue;
            };
            if track.contains(&DVec3::ZERO) {
                at_zero.push(MARKERS[at]);
                let zeros = track.iter_mut().filter(|p| **p == DVec3::ZERO);
                zeros.for_each(|p| *p = DVec3::NAN);
            }
            tracks[at] = Some(track);
        }
        if tracks[2].is_some() {
            tracks[3..5].fill(None);
        }
        Markers {
            frames,
            tracks,
            at_zero,
        }
    }

    /// The number of frames.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The track of a marker, (frames), millimeters; `None` where there is none.
    pub fn get(&self, name: &str) -> Option<&[DVec3]> {
        let at = MARKERS.iter().position(|marker| *marker == name)?;
        self.tracks[at].as_deref()
    }

    /// The track of a marker by its place in [`MARKERS`].
    pub(crate) fn track_mut(&mut self, marker: usize) -> Option<&mut Vec<DVec3>> {
        self.tracks[marker].as_mut()
    }

    /// The track of a marker with its gaps filled by straight lines, beyond its ends by its first
    /// and last position; NaN where it is never seen.
    pub(crate) fn filled(&self, name: &str) -> Vec<DVec3> {
        let track = self.get(name).unwrap_or_default();
        let seen: Vec<usize> = (0..track.len()).filter(|&t| track[t].is_finite()).collect();
        let at = |t: usize| {
            let next = seen.partition_point(|&s| s < t);
            match (next.checked_sub(1).map(|i| seen[i]), seen.get(next)) {
                (Some(a), Some(&b)) => track[a].lerp(track[b], (t - a) as f64 / (b - a) as f64),
                (a, b) => a.or(b.copied()).map_or(DVec3::NAN, |t| track[t]),
            }
        };
        (0..self.frames).map(at).collect()
    }

    /// All markers in a frame.
    pub(crate) fn frame(&self, frame: usize) -> Frame {
        let at = |m: usize| {
            self.tracks[m]
                .as_ref()
                .map_or(DVec3::NAN, |track| track[frame])
        };
        Frame(std::array::from_fn(at))
    }
}

/// The positions of [`MARKERS`] in a frame; NaN where one is missing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame(pub [DVec3; MARKERS.len()]);

impl Frame {
    /// LASI, RASI and SACR, which is the middle of LPSI and RPSI where it has no marker.
    pub(crate) fn pelvis(&self) -> [DVec3; 3] {
        let [lasi, rasi, sacr, lpsi, rpsi] = self.part(0);
        [
            lasi,
            rasi,
            if sacr.is_nan() {
                (lpsi + rpsi) / 2.0
            } else {
                sacr
            },
        ]
    }

    /// THI, KNE, TIB, ANK, HEE and TOE of a side.
    pub(crate) fn leg(&self, side: Side) -> [DVec3; 6] {
        self.part(LEGS + 6 * side as usize)
    }

    /// LFHD, RFHD, LBHD and RBHD.
    pub(crate) fn head(&self) -> [DVec3; 4] {
        self.part(HEAD)
    }

    /// C7, T10, CLAV and STRN.
    pub(crate) fn trunk(&self) -> [DVec3; 4] {
        self.part(TRUNK)
    }

    /// SHO, ELB, WRA, WRB and FIN of a side.
    pub(crate) fn arm(&self, side: Side) -> [DVec3; 5] {
        self.part(ARMS + 5 * side as usize)
    }

    fn part<const N: usize>(&self, first: usize) -> [DVec3; N] {
        std::array::from_fn(|i| self.0[first + i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_those_of_the_names() {
        let at = |name: &str| MARKERS.iter().position(|m| *m == name).unwrap() as f64;
        let frame = Frame(std::array::from_fn(|m| DVec3::splat(m as f64)));
        assert_eq!(
            frame.pelvis().map(|p| p.x),
            ["LASI", "RASI", "SACR"].map(at)
        );
        for side in Side::BOTH {
            let own = |names: &str| -> Vec<f64> {
                names
                    .split(' ')
                    .map(|n| at(&format!("{}{n}", side.letter())))
                    .collect()
            };
            assert_eq!(
                frame.leg(side).map(|p| p.x),
                *own("THI KNE TIB ANK HEE TOE")
            );
            assert_eq!(frame.arm(side).map(|p| p.x), *own("SHO ELB WRA WRB FIN"));
        }
        assert_eq!(
            frame.head().map(|p| p.x),
            ["LFHD", "RFHD", "LBHD", "RBHD"].map(at)
        );
        assert_eq!(
            frame.trunk().map(|p| p.x),
            ["C7", "T10", "CLAV", "STRN"].map(at)
        );
    }

    #[test]
    fn zeros_are_missing_and_gaps_are_filled() {
        let p = |x: f64| DVec3::new(x, 1.0, 2.0);
        let track = vec![DVec3::ZERO, p(1.0), DVec3::NAN, p(3.0), DVec3::NAN];
        let markers = Markers::new([("Ann:LTOE", track), ("X", vec![p(0.0); 5])]).unwrap();
        assert_eq!(markers.at_zero, ["LTOE"]);
        assert!(markers.get("LTOE").unwrap()[0].is_nan() && markers.get("X").is_none());
        let filled = markers.filled("LTOE");
        assert_eq!(filled, [1.0, 1.0, 2.0, 3.0, 3.0].map(p));
        assert!(markers.filled("RTOE").iter().all(|p| p.is_nan()));
        assert!(Markers::new([("LTOE", vec![]), ("RTOE", vec![p(0.0)])]).is_err());
    }
}
