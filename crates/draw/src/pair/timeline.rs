//! One timeline for two takes: which frame of each is shown when, and which are compared.

use super::PairTake;
use crate::pose::Poses;
use crate::{Error, Place, Result};

/// Times that differ by less are one, s.
const EQUAL_TIME: f64 = 1e-6;
/// What rounded times may add to half a frame.
const ROUNDING: f64 = 1.001;

/// Frames on end at a steady rate.
#[derive(Debug, Clone, PartialEq)]
pub struct PairRun {
    /// The take's name, where both hold several takes.
    pub name: String,
    /// The first frame on the timeline.
    pub first: usize,
    /// The time of that frame, s.
    pub time: f64,
    /// Frames a second.
    pub rate: f64,
}

/// The frames of two takes in the order of time.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Timeline {
    /// The frame of each take that is shown; `None` where it has none.
    pub shown: Vec<[Option<usize>; 2]>,
    /// The stretches of the timeline.
    pub runs: Vec<PairRun>,
    /// The place on the timeline whose two frames are compared; `None` where one take has none.
    pub compared: Vec<Option<usize>>,
    /// Whether each take begins at its own start, and not by a clock that both know.
    pub from_starts: bool,
    /// Whether the takes have some time in common.
    pub shares_time: bool,
}

impl Timeline {
    /// The timeline: frame by frame where both have the same; else the frames of the take with the
    /// higher rate, beside them the nearest frames of the other, and what only that has.
    ///
    /// # Errors
    /// [`Error::Data`]: frames differ, and a file holds several takes or its times do not rise.
    pub fn new(takes: &[PairTake<'_>; 2]) -> Result<Timeline> {
        let mut times = [seconds(&takes[0]), seconds(&takes[1])];
        if has_same_frames(takes, &times) {
            return Ok(Timeline::frame_by_frame(&takes[0]));
        }
        for (take, times) in takes.iter().zip(&times) {
            check_one_take(take, times)?;
        }
        let [start, end] = [
            |t: &Vec<f64>| t.first().copied(),
            |t: &Vec<f64>| t.last().copied(),
        ];
        let is_clocked = takes.iter().all(|take| take.is_clocked);
        let overlap = start(&times[0]) <= end(&times[1]) && start(&times[1]) <= end(&times[0]);
        // A file without a clock that is as long as the other is most likely made from the whole of
        // it; a part begins where its times say.
        let long = times
            .each_ref()
            .map(|t| end(t).unwrap_or(0.0) - start(t).unwrap_or(0.0));
        let is_as_long = (long[0] - long[1]).abs() <= 0.5 / takes[0].rate.min(takes[1].rate);
        let from_starts = !overlap || !is_clocked && is_as_long;
        if from_starts {
            for times in &mut times {
                let first = start(times).unwrap_or_default();
                times.iter_mut().for_each(|time| *time -= first);
            }
        }
        let mut line = Timeline::by_time(&times, [takes[0].rate, takes[1].rate]);
        line.from_starts = from_starts;
        if is_clocked && !overlap {
            line.shares_time = false;
            line.compared.fill(None);
        }
        Ok(line)
    }

    fn frame_by_frame(take: &PairTake<'_>) -> Timeline {
        let poses = take.poses;
        let frames = 0..poses.frames();
        let of_run = |(range, own): (std::ops::Range<usize>, Option<f64>)| PairRun {
            name: (poses.take.as_ref()).map_or(String::new(), |t| t[range.start].to_string()),
            first: range.start,
            time: poses.time.as_ref().map_or(0.0, |t| t[range.start]),
            rate: own.unwrap_or(take.rate),
        };
        let runs = poses.timed_runs(&poses.rates()).into_iter().map(of_run);
        Timeline {
            shown: frames.clone().map(|t| [Some(t); 2]).collect(),
            runs: runs.collect(),
            compared: frames.map(Some).collect(),
            from_starts: false,
            shares_time: true,
        }
    }

    /// The timeline of rising `times`, s.
    fn by_time(times: &[Vec<f64>; 2], rates: [f64; 2]) -> Timeline {
        let fast = usize::from(rates[1] > rates[0]);
        let slow = 1 - fast;
        let half = rates.map(|rate| ROUNDING * 0.5 / rate);
        let own = times[fast].iter().map(|time| (*time, fast));
        let between = times[slow].iter().map(|time| (*time, slow));
        let between =
            between.filter(|(time, _)| nearest(&times[fast], *time, half[fast]).is_none());
        let mut moments: Vec<(f64, usize)> = own.chain(between).collect();
        moments.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut shown, mut runs) = (Vec::new(), Vec::<PairRun>::new());
        let mut places = vec![0; times[fast].len()];
        for (at, &(time, whose)) in moments.iter().enumerate() {
            let mut frames = [None; 2];
            frames[slow] = nearest(&times[slow], time, half[slow]);
            if whose == fast {
                frames[fast] = nearest(&times[fast], time, half[fast]);
                frames[fast].iter().for_each(|frame| places[*frame] = at);
            }
            shown.push(frames);
            let goes_on = at > 0 && moments[at - 1].1 == whose && {
                let step = time - moments[at - 1].0;
                step <= 1.5 / rates[whose]
            };
            if !goes_on {
                runs.push(PairRun {
                    name: String::new(),
                    first: at,
                    time,
                    rate: rates[whose],
                });
            }
        }
        // Frames of the slower take are compared with the nearest ones of the other, not the other
        // way around: a take of every fourth frame differs by nothing from the whole.
        let beside = |frame: usize| nearest(&times[fast], times[slow][frame], half[fast]);
        let compared = shown
            .iter()
            .map(|frames| Some(places[beside(frames[slow]?)?]));
        Timeline {
            compared: compared.collect(),
            shown,
            runs,
            from_starts: false,
            shares_time: true,
        }
    }
}

/// The times of a take's frames, s.
pub(super) fn seconds(take: &PairTake<'_>) -> Vec<f64> {
    take.poses.times(Some(take.rate)).unwrap_or_default()
}

/// The index of the nearest of rising times within `reach`.
fn nearest(times: &[f64], time: f64, reach: f64) -> Option<usize> {
    let after = times.partition_point(|other| *other < time);
    let near = [after.checked_sub(1), Some(after)].into_iter().flatten();
    let far = |i: usize| times.get(i).map(|other| (other - time).abs());
    let near = near.filter_map(|i| Some((far(i)?, i)));
    let (far, index) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
    (far <= reach).then_some(index)
}

/// Whether both have the same frames: times, and takes where there are several.
fn has_same_frames(takes: &[PairTake<'_>; 2], times: &[Vec<f64>; 2]) -> bool {
    let [a, b] = takes.map(|take| take.poses);
    let has_several = |poses: &Poses| poses.takes().len() > 1;
    let has_same_takes = a.take == b.take || !(has_several(a) || has_several(b));
    let is_same = |(a, b): (&f64, &f64)| (a - b).abs() <= EQUAL_TIME;
    let has_same_times =
        times[0].len() == times[1].len() && times[0].iter().zip(&times[1]).all(is_same);
    has_same_takes && has_same_times
}

fn check_one_take(take: &PairTake<'_>, times: &[f64]) -> Result<()> {
    let fail = |what: String| Err(Error::data(Place::file(take.file), what));
    let count = take.poses.takes().len();
    if count > 1 {
        return fail(format!(
            "holds {count} takes; of files with different frames one take each can be drawn: cut \
             it out with trim"
        ));
    }
    match times.windows(2).position(|pair| !(pair[0] < pair[1])) {
        Some(at) => fail(format!(
            "its times do not rise after frame {at} (counted from 0)"
        )),
        None => Ok(()),
    }
}
