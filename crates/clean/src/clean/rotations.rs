//! What was done to the rotations of a file, for its record and for people.

use super::places::{PlaceToSee, Told};
use crate::audit::count;
use crate::ik::rotation_cleaning::{CleanedRotations, CleanedTrack};
use crate::io::MotionFile;
use serde::Serialize;
use std::ops::Range;

/// Joints that a line names.
const LISTED: usize = 4;
/// Gaps of rotations filled less surely than this are findings: the error over gaps like them
/// (rms, radians).
const UNSURE: f64 = 15.0 * std::f64::consts::PI / 180.0;
/// Gaps without any like them elsewhere are findings where they are longer, seconds.
const LONG: f64 = 0.3;

/// Rotations cleaned by themselves, and the file's names for them.
pub(crate) struct CleanedFile {
    pub cleaned: CleanedRotations,
    joints: Vec<String>,
    rate: f64,
    /// Gaps of positions filled less surely than this are findings: the error over gaps like them
    /// (rms, cm).
    max_sd: f64,
}

/// The rotations of a file in its record.
#[derive(Debug, Serialize)]
pub(crate) struct RotationLines {
    /// Median over the joints that move, degrees about an axis.
    noise_deg: f64,
    smoothed: bool,
    joints: Vec<JointLine>,
    /// Joints that are left out, since there are so many.
    #[serde(skip_serializing_if = "is_zero")]
    left_out: usize,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// What was done to a joint: to its rotation, to one of its angles, or to its position.
#[derive(Debug, Serialize)]
struct JointLine {
    joint: String,
    /// The channels among those of a frame, counted from 0.
    channels: Vec<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    noise_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    noise_cm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    smoothed: Option<StrengthLine>,
    /// The first frame of each pop, counted from 0, and the first after it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pops: Vec<[usize; 2]>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    gaps: Vec<RotationGapLine>,
}

#[derive(Debug, Serialize)]
struct StrengthLine {
    order: usize,
    lambda: f64,
    cutoff_hz: f64,
}

#[derive(Debug, Serialize)]
struct RotationGapLine {
    frames: [usize; 2],
    /// The error over gaps like it in the take, rms, degrees or cm.
    error: Option<f64>,
}

impl RotationLines {
    /// Only the first joints, and the first pops and gaps of each.
    pub(crate) fn cut(&mut self, few: usize) {
        self.left_out = self.joints.len().saturating_sub(few);
        self.joints.truncate(few);
        for joint in &mut self.joints {
            joint.pops.truncate(few);
            joint.gaps.truncate(few);
        }
    }
}

fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

fn ends(frames: &Range<usize>) -> [usize; 2] {
    [frames.start, frames.end]
}

impl CleanedFile {
    /// What became of the rotations of a file.
    pub(crate) fn new(file: &MotionFile, cleaned: CleanedRotations, max_sd: f64) -> CleanedFile {
        CleanedFile {
            cleaned,
            joints: file.channels().into_iter().map(|j| j.joint).collect(),
            rate: file.rate().unwrap_or(1.0),
            max_sd,
        }
    }

    /// The noise, degrees.
    pub(crate) fn noise(&self) -> f64 {
        self.cleaned.noise.to_degrees()
    }

    /// Whether anything was smoothed.
    pub(crate) fn is_smoothed(&self) -> bool {
        self.cleaned.tracks.iter().any(|t| t.strength.is_some())
    }

    /// Frames of pops, over all joints.
    pub(crate) fn popped(&self) -> usize {
        let runs = self.cleaned.tracks.iter().flat_map(|t| &t.pops);
        runs.map(|run| run.len()).sum()
    }

    /// Values that are missing still.
    pub(crate) fn missing(&self) -> usize {
        self.cleaned.motion.iter().filter(|v| v.is_nan()).count()
    }

    fn name(&self, track: &CleanedTrack) -> &str {
        &self.joints[track.joint]
    }

    /// All of it.
    pub(crate) fn lines(&self) -> RotationLines {
        let line = |track: &CleanedTrack| {
            let unit = if track.is_place {
                1.0
            } else {
                1_f64.to_degrees()
            };
            let noise = Some(rounded(track.noise * unit));
            JointLine {
                joint: self.name(track).to_string(),
                channels: track.channels.clone(),
                noise_deg: noise.filter(|_| !track.is_place),
                noise_cm: noise.filter(|_| track.is_place),
                smoothed: track.strength.map(|strength| StrengthLine {
                    order: strength.order,
                    lambda: strength.lambda,
                    cutoff_hz: rounded(strength.cutoff(self.rate)),
                }),
                pops: track.pops.iter().map(ends).collect(),
                gaps: (track.gaps.iter())
                    .map(|(frames, error)| RotationGapLine {
                        frames: ends(frames),
                        error: error.is_finite().then(|| rounded(error * unit)),
                    })
                    .collect(),
            }
        };
        RotationLines {
            noise_deg: rounded(self.noise()),
            smoothed: self.is_smoothed(),
            joints: self.cleaned.tracks.iter().map(line).collect(),
            left_out: 0,
        }
    }

    /// The pops.
    pub(crate) fn places(&self) -> Vec<PlaceToSee> {
        let tracks = self.cleaned.tracks.iter();
        let of = |track: &CleanedTrack| {
            let place = |run: &Range<usize>| self.place("pop", track, run);
            track.pops.iter().map(place).collect::<Vec<_>>()
        };
        tracks.flat_map(of).collect()
    }

    fn place(&self, what: &str, track: &CleanedTrack, run: &Range<usize>) -> PlaceToSee {
        let joint = self.name(track).to_string();
        PlaceToSee::of(what, Some(&joint), [run.start, run.end])
    }

    /// The gaps that are filled with little to go by.
    fn unsure<'a>(
        &self,
        track: &'a CleanedTrack,
    ) -> impl Iterator<Item = &'a (Range<usize>, f64)> + use<'a> {
        let long = LONG * self.rate;
        let most = if track.is_place { self.max_sd } else { UNSURE };
        let is_unsure = move |(frames, error): &&(Range<usize>, f64)| {
            if error.is_nan() {
                frames.len() as f64 > long
            } else {
                *error > most
            }
        };
        track.gaps.iter().filter(is_unsure)
    }

    /// What somebody should look at.
    pub(crate) fn findings(&self) -> Option<Told> {
        let (mut all, mut places) = (Vec::new(), Vec::new());
        for track in &self.cleaned.tracks {
            all.extend(self.unsure(track).map(|(frames, error)| {
                places.push(self.place("unsure", track, frames));
                let [first, last] = [frames.start, frames.end - 1];
                let by = match (error.is_nan(), track.is_place) {
                    (true, _) => "nothing to compare with".to_string(),
                    (_, true) => format!("gaps like it are {error:.1} cm off"),
                    _ => format!("gaps like it are {:.0} degrees off", error.to_degrees()),
                };
                format!("{} in frames {first} to {last} ({by})", self.name(track))
            }));
        }
        let line = format!(
            "unsure: {} filled: {}",
            count(all.len(), "gap"),
            listed(&all)
        );
        (!all.is_empty()).then_some(Told { line, places })
    }

    /// What was done, a line each; `noise_limit`: radians.
    pub(crate) fn notes(&self, noise_limit: f64) -> Vec<String> {
        let mut out = Vec::new();
        let tracks = &self.cleaned.tracks;
        if self.is_smoothed() {
            let mut all: Vec<&CleanedTrack> = tracks.iter().filter(|t| !t.is_place).collect();
            let joints = count(all.len(), "joint");
            all.sort_by(|a, b| b.noise.total_cmp(&a.noise));
            all.retain(|t| t.strength.is_some());
            let one = |t: &&CleanedTrack| {
                let cutoff = t.strength.map_or(0.0, |s| s.cutoff(self.rate));
                format!(
                    "{} {:.2}, left below {cutoff:.1} Hz",
                    self.name(t),
                    t.noise.to_degrees()
                )
            };
            let some: Vec<String> = all.iter().map(one).collect();
            out.push(format!(
                "rotations: noise of {:.2} degrees (median of {joints}) smoothed ({})",
                self.noise(),
                listed(&some)
            ));
        } else if !self.cleaned.is_noise && self.cleaned.noise >= noise_limit {
            out.push(format!(
                "noise: at most {:.2} degrees, which cannot be told from motion: it stays",
                self.noise()
            ));
        }
        let mut pops = Vec::new();
        for track in tracks {
            let one = |run: &Range<usize>| format!("{} in frame {}", self.name(track), run.start);
            pops.extend(track.pops.iter().map(one));
        }
        if !pops.is_empty() {
            let what = count(pops.len(), "pop");
            out.push(format!("pops: {what} bridged ({})", listed(&pops)));
        }
        let gaps: usize = tracks.iter().map(|t| t.gaps.len()).sum();
        if gaps > 0 {
            out.push(format!("channels: {} filled", count(gaps, "gap")));
        }
        out
    }
}

/// Some of a list.
fn listed(all: &[String]) -> String {
    let some = all.iter().take(LISTED).cloned().collect::<Vec<_>>();
    match all.len() - some.len() {
        0 => some.join(", "),
        more => format!("{} and {more} more", some.join(", ")),
    }
}
