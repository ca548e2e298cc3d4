//! Two takes on one timeline, such as one before and after a repair: every point of either, and the
//! differences of those that both have by name.

mod differences;
mod timeline;

pub use differences::{Differences, FrameDifference, PointDifference};
pub use timeline::PairRun;

use crate::Result;
use crate::pose::{FillMethod, Poses, Status, same_points};
use ndarray::Array2;
use timeline::{Timeline, seconds};

/// A take to lay beside another.
#[derive(Debug, Clone, Copy)]
pub struct PairTake<'a> {
    /// The name on the page.
    pub name: &'a str,
    /// What messages call its file.
    pub file: &'a str,
    /// The frames and points, cm.
    pub poses: &'a Poses,
    /// Frames a second, above 0.
    pub rate: f64,
    /// Whether the times of its frames are those of a clock, as in tables and C3D files; else they
    /// count from its start.
    pub is_clocked: bool,
    /// Pairs of its points to join.
    pub bones: &'a [(usize, usize)],
    /// Frames x points, if known.
    pub status: Option<&'a Array2<Status>>,
    /// Frames x points, if known: the standard deviation of a coordinate, cm.
    pub sd: Option<&'a Array2<f64>>,
    /// Frames x points, if known: how a point was filled.
    pub method: Option<&'a Array2<Option<FillMethod>>>,
}

/// A take on the timeline that it shares with another, with the points of both.
#[derive(Debug, Clone)]
pub struct Paired {
    /// The name.
    pub name: String,
    /// Frames x (3 x points), cm; NaN where the take has no such point or frame.
    pub xyz: Array2<f64>,
    /// Frames x points, if known.
    pub status: Option<Array2<Status>>,
    /// Frames x points, if known, cm.
    pub sd: Option<Array2<f64>>,
    /// Frames x points, if known.
    pub method: Option<Array2<Option<FillMethod>>>,
    /// The pairs of points to join.
    pub bones: Vec<(usize, usize)>,
    /// Whether it has each of the points.
    pub has: Vec<bool>,
    /// The frame of the take at each frame of the timeline; `None` where it has none.
    pub frames: Vec<Option<usize>>,
}

/// Two takes on one timeline.
#[derive(Debug, Clone)]
pub struct TakePair {
    /// The names of the points: those of the first take, then what only the second has.
    pub points: Vec<String>,
    /// The takes.
    pub takes: [Paired; 2],
    /// The stretches of the timeline.
    pub runs: Vec<PairRun>,
    /// Whether both takes have the same frames.
    pub is_frame_by_frame: bool,
    /// The differences; none, where no point and time is in both.
    pub differences: Option<Differences>,
    /// How the two go together, a sentence each.
    pub remarks: Vec<String>,
}

impl TakePair {
    /// Lays two takes on one timeline, in seconds: neither is stretched. At each moment the nearest
    /// frame of a take stands, none beyond half a frame.
    ///
    /// # Errors
    /// [`crate::Error::Data`]: frames differ, and a file holds several takes or its times do not
    /// rise.
    pub fn new(takes: [PairTake<'_>; 2]) -> Result<TakePair> {
        let line = Timeline::new(&takes)?;
        let [first, second] = takes.map(|take| &take.poses.points);
        let mut points = first.clone();
        // Where each point of the second stands among all.
        let mut places = Vec::new();
        for (name, place) in second.iter().zip(same_points(second, first)) {
            places.push(place.unwrap_or(points.len()));
            if place.is_none() {
                points.push(name.clone());
            }
        }
        let shared: Vec<usize> = places
            .iter()
            .copied()
            .filter(|p| *p < first.len())
            .collect();
        let own: Vec<usize> = (0..first.len()).collect();
        let paired = [(0, &own), (1, &places)].map(|(k, places)| {
            let frames: Vec<Option<usize>> = line.shown.iter().map(|frames| frames[k]).collect();
            paired(&takes[k], frames, places, points.len())
        });
        let is_compared = !shared.is_empty() && line.compared.iter().any(Option::is_some);
        let differences = is_compared.then(|| {
            let xyz = [paired[0].xyz.view(), paired[1].xyz.view()];
            Differences::new(xyz, &shared, &line.compared)
        });
        let differences = differences.filter(|d| !d.points.is_empty());
        let is_frame_by_frame = line.shown.iter().all(|[a, b]| a == b);
        Ok(TakePair {
            remarks: remarks(&takes, &line, shared.len(), differences.is_some()),
            points,
            takes: paired,
            runs: line.runs,
            is_frame_by_frame,
            differences,
        })
    }
}

/// A take spread over `frames` of the timeline and `count` points, its own at `places`.
fn paired(
    take: &PairTake<'_>,
    frames: Vec<Option<usize>>,
    places: &[usize],
    count: usize,
) -> Paired {
    let mut own = vec![None; count];
    places
        .iter()
        .enumerate()
        .for_each(|(p, place)| own[*place] = Some(p));
    let axes = |p: &Option<usize>| [0, 1, 2].map(|axis| p.map(|p| 3 * p + axis));
    let columns: Vec<Option<usize>> = own.iter().flat_map(axes).collect();
    let bones = take.bones.iter().map(|(a, b)| (places[*a], places[*b]));
    Paired {
        name: take.name.into(),
        xyz: spread(&take.poses.xyz, &frames, &columns, f64::NAN),
        status: take
            .status
            .map(|s| spread(s, &frames, &own, Status::Observed)),
        sd: take.sd.map(|sd| spread(sd, &frames, &own, f64::NAN)),
        method: take.method.map(|m| spread(m, &frames, &own, None)),
        bones: bones.collect(),
        has: own.iter().map(Option::is_some).collect(),
        frames,
    }
}

/// Some rows and columns of an array; `absent` where there is none.
fn spread<T: Copy>(
    from: &Array2<T>,
    rows: &[Option<usize>],
    columns: &[Option<usize>],
    absent: T,
) -> Array2<T> {
    Array2::from_shape_fn((rows.len(), columns.len()), |(t, c)| {
        (rows[t].zip(columns[c])).map_or(absent, |(t, c)| from[[t, c]])
    })
}

/// How the two go together, where they have not all in common.
fn remarks(
    takes: &[PairTake<'_>; 2],
    line: &Timeline,
    shared: usize,
    are_compared: bool,
) -> Vec<String> {
    let mut out = Vec::new();
    let [a, b] = takes.map(|take| take.name);
    if !line.shares_time || !line.shown.iter().all(|[a, b]| a == b) {
        let [one, other] = takes.map(|take| extent(&take));
        let start = match (line.from_starts, line.shares_time) {
            (false, _) => "",
            (true, true) => ", each from its own start",
            (true, false) => ", each from its own start: they have no time in common",
        };
        out.push(format!(
            "{a}: {one}; {b}: {other}. Both play in seconds{start}."
        ));
    }
    let fast = usize::from(takes[1].rate > takes[0].rate);
    if are_compared && takes[0].rate != takes[1].rate {
        out.push(format!(
            "Differences are those of the frames of {} to the nearest frames of {}.",
            takes[1 - fast].name,
            takes[fast].name
        ));
    }
    let count = takes.map(|take| take.poses.points.len());
    if shared == 0 {
        out.push(format!(
            "No point of {a} has the name of a point of {b}: no differences can be told."
        ));
    } else if !line.shares_time {
        out.push("No differences can be told.".into());
    } else if !are_compared {
        out.push("No point is seen in both at one time: no differences can be told.".into());
    } else if count != [shared; 2] {
        let s = if shared == 1 { "" } else { "s" };
        out.push(format!(
            "Differences are those of the {shared} point{s} that both have by name, of {} and {}.",
            count[0], count[1]
        ));
    }
    out
}

/// Frames, rate and times of a take, such as "316 frames at 120 a second, 0.00 to 2.63 s".
fn extent(take: &PairTake<'_>) -> String {
    let times = seconds(take);
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return "no frames".into();
    };
    let rate = (take.rate * 1e3).round() / 1e3;
    let s = if times.len() == 1 { "" } else { "s" };
    format!(
        "{} frame{s} at {rate} a second, {first:.2} to {last:.2} s",
        times.len()
    )
}

#[cfg(test)]
mod tests;
