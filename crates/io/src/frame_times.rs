//! The times of frames as a column of text has them: rounded, and sometimes at odds with the rate
//! that the file states.

/// Fewer frames do not tell a rate from their rounded times.
const RATED_FRAMES: usize = 10;
/// Times that tell a rate so many times larger or smaller than the stated one are no seconds.
const NO_SECONDS: f64 = 10.0;
/// Rates that differ by less than this share agree.
const AGREES: f64 = 0.01;
/// The largest time, seconds.
const LATEST: f64 = 1e9;

/// The cells of a column of times.
#[derive(Debug, Default)]
pub(crate) struct TimeCells {
    /// The frame, from 0, and the seconds of each cell that has some.
    seconds: Vec<(usize, f64)>,
    /// The most digits after the point.
    decimals: usize,
}

/// What a column of times tells.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct FrameTimes {
    /// The times of all frames; `None`: they follow from the frames' numbers and the rate.
    pub times: Option<Vec<f64>>,
    /// The rate that the times tell, where it contradicts the stated one.
    pub rate: Option<f64>,
    /// What was odd.
    pub note: Option<String>,
}

impl TimeCells {
    /// Adds the cell of a frame; one that is no time is passed over.
    pub(crate) fn push(&mut self, frame: usize, cell: &str) {
        let cell = cell.trim();
        let Some(seconds) = cell.parse::<f64>().ok().filter(|t| t.is_finite()) else {
            return;
        };
        let decimals = match cell.split_once('.') {
            Some((_, digits)) if digits.bytes().all(|b| b.is_ascii_digit()) => digits.len(),
            Some(_) => 17,
            None => 0,
        };
        self.decimals = self.decimals.max(decimals);
        self.seconds.push((frame, seconds));
    }

    /// Drops the cells of all but the first frames.
    pub(crate) fn truncate(&mut self, frames: usize) {
        self.seconds.retain(|(frame, _)| *frame < frames);
    }

    /// The number of frames, from the first with a time to the last, and the rate between them.
    fn own_rate(&self) -> Option<(usize, f64)> {
        let ((from, first), (to, last)) = (self.seconds.first()?, self.seconds.last()?);
        let steps = to - from;
        (steps > 0 && last > first).then(|| (steps, steps as f64 / (last - first)))
    }

    /// A note where the times contradict a rate that is taken all the same.
    pub(crate) fn contradiction(&self, rate: Option<f64>) -> Option<String> {
        let ((steps, own), rate) = (self.own_rate()?, rate?);
        (steps >= RATED_FRAMES && differ(own, rate)).then(|| {
            format!("says {rate} frames per second, but its times tell {own:.3}; {rate} is taken")
        })
    }

    /// The times of so many frames. `number`: of the first frame, from 1; `rate`: as the file
    /// states it.
    pub(crate) fn times(&self, frames: usize, number: u64, rate: Option<f64>) -> FrameTimes {
        let by_number = |note: Option<String>| FrameTimes {
            note,
            ..FrameTimes::default()
        };
        let Some(&(from, first)) = self.seconds.first() else {
            return by_number(None);
        };
        if self.seconds.iter().any(|(_, t)| t.abs() > LATEST) {
            return by_number(Some(
                "its times are too large; those of the frames' numbers are taken".into(),
            ));
        }
        if let Some(times) = rate.and_then(|rate| self.regular(frames, from, first, rate)) {
            let is_usual = times[0] == (number.max(1) - 1) as f64 / rate.unwrap_or(1.0);
            return FrameTimes {
                times: (!is_usual).then_some(times),
                ..FrameTimes::default()
            };
        }
        let not_ascending = |frame: usize| {
            let what = format!(
                "its times do not ascend (frame {}); those of the frames' numbers and the rate \
                 are taken",
                number + frame as u64
            );
            by_number(Some(what))
        };
        // Rounded times of frames that follow faster stand still, or step back by a digit.
        let least = -1.01 * self.last_digit();
        if let Some(frame) = self.steps_by(|step| step < least) {
            return not_ascending(frame);
        }
        let own = self.own_rate();
        if let (Some((_, own)), Some(rate)) = (own, rate)
            && !(1.0 / NO_SECONDS..NO_SECONDS).contains(&(own / rate))
        {
            let what = format!(
                "its times are no seconds (with {rate} frames per second they would tell \
                 {own:.3}); those of the frames' numbers and the rate are taken"
            );
            return by_number(Some(what));
        }
        let contradicts = own
            .zip(rate)
            .filter(|((steps, own), rate)| *steps >= RATED_FRAMES && differ(*own, *rate));
        let regular = own.and_then(|(_, own)| self.regular(frames, from, first, own));
        if let (None, Some(frame)) = (&regular, self.steps_by(|step| step <= 0.0)) {
            return not_ascending(frame);
        }
        let note = contradicts.map(|((_, own), rate)| {
            format!(
                "says {rate} frames per second, but its times tell {own:.3}; the times are taken"
            )
        });
        FrameTimes {
            times: Some(regular.unwrap_or_else(|| self.as_they_are(frames, own, rate))),
            rate: contradicts.map(|((_, own), _)| own),
            note,
        }
    }

    /// What the last digit of the times counts, seconds.
    fn last_digit(&self) -> f64 {
        10_f64.powi(-(self.decimals.min(17) as i32)).max(1e-9)
    }

    /// The first frame to which the time steps so.
    fn steps_by(&self, is_so: impl Fn(f64) -> bool) -> Option<usize> {
        let mut pairs = self.seconds.windows(2);
        let pair = pairs.find(|pair| is_so(pair[1].1 - pair[0].1))?;
        Some(pair[1].0)
    }

    /// Times of one step from the first on, if all cells agree with them up to their rounding.
    fn regular(&self, frames: usize, from: usize, first: f64, rate: f64) -> Option<Vec<f64>> {
        let last_digit = self.last_digit();
        let count = first * rate - from as f64;
        // The first frame's time counts frames, where its rounding allows that.
        let whole = count.round();
        let start = if (whole - count).abs() <= 0.51 * last_digit * rate {
            whole
        } else {
            count
        };
        let time = |frame: usize| (start + frame as f64) / rate;
        let agrees = |(frame, t): &(usize, f64)| (time(*frame) - t).abs() <= 1.01 * last_digit;
        (self.seconds.iter().all(agrees)).then(|| (0..frames).map(time).collect())
    }

    /// The cells, with frames without a time between and beyond them.
    fn as_they_are(&self, frames: usize, own: Option<(usize, f64)>, rate: Option<f64>) -> Vec<f64> {
        let step = 1.0 / own.map(|(_, own)| own).or(rate).unwrap_or(1.0);
        let mut times = Vec::with_capacity(frames);
        let mut known = self.seconds.iter().peekable();
        let mut before: Option<(usize, f64)> = None;
        for frame in 0..frames {
            let time = match (known.peek(), before) {
                (Some((at, t)), _) if *at == frame => *t,
                (Some((at, t)), Some((from, since))) => {
                    since + (t - since) * (frame - from) as f64 / (at - from) as f64
                }
                (Some((at, t)), None) => t - (at - frame) as f64 * step,
                (None, Some((from, since))) => since + (frame - from) as f64 * step,
                (None, None) => frame as f64 * step,
            };
            if known.next_if(|(at, _)| *at == frame).is_some() {
                before = Some((frame, time));
            }
            times.push(time);
        }
        times
    }
}

fn differ(own: f64, rate: f64) -> bool {
    !((own - rate).abs() <= AGREES * rate)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(cells: &[&str], number: u64, rate: f64) -> FrameTimes {
        let mut times = TimeCells::default();
        (cells.iter().enumerate()).for_each(|(i, cell)| times.push(i, cell));
        times.times(cells.len(), number, Some(rate))
    }

    #[test]
    fn times_are_the_columns() {
        // As the numbers have them: 120 a second, rounded.
        let usual = of(&["0.000", "0.008", "0.017", "0.025"], 1, 120.0);
        assert_eq!(usual, FrameTimes::default());
        let later = of(&["3.38", "3.39", "3.40"], 1, 100.0).times.unwrap();
        assert_eq!(later, [3.38, 3.39, 3.4]);
        // Between two frames of the recording.
        let between = of(&["0.0042", "0.0125", "0.0208"], 1, 120.0).times.unwrap();
        assert!((between[2] - 0.0042 - 2.0 / 120.0).abs() < 1e-12);
        let missing = of(&["", "3.39", "x", "3.41", ""], 1, 100.0).times.unwrap();
        assert_eq!(missing, [3.38, 3.39, 3.4, 3.41, 3.42]);
        let uneven = of(&["1.00", "", "1.50", "1.60"], 1, 10.0).times.unwrap();
        assert_eq!(uneven, [1.0, 1.25, 1.5, 1.6]);
        assert_eq!(of(&["", ""], 1, 100.0), FrameTimes::default());
        // Rounded to more than a frame, as some round them.
        let rounded = of(
            &["3.38", "3.38", "3.39", "3.40", "3.40", "3.40", "3.41"],
            1,
            200.0,
        );
        assert!(rounded.note.is_none() && (rounded.times.unwrap()[6] - 3.41).abs() < 1e-9);
        let still = of(&["1.0", "1.5", "1.5", "1.7"], 1, 10.0);
        assert!(still.times.is_none() && still.note.unwrap().contains("frame 3"));
    }

    #[test]
    fn what_contradicts_the_rate_is_said_once() {
        let cells: Vec<String> = (0..20)
            .map(|t| format!("{:.2}", 0.02 * f64::from(t)))
            .collect();
        let cells: Vec<&str> = cells.iter().map(String::as_str).collect();
        let half = of(&cells, 1, 100.0);
        assert!((half.rate.unwrap() - 50.0).abs() < 1e-9 && half.times.unwrap()[19] == 0.38);
        assert!(
            half.note
                .unwrap()
                .contains("times tell 50.000; the times are taken")
        );
        let numbers: Vec<String> = (0..20).map(|t| t.to_string()).collect();
        let numbers: Vec<&str> = numbers.iter().map(String::as_str).collect();
        let frames = of(&numbers, 1, 100.0);
        assert!(frames.times.is_none() && frames.note.unwrap().contains("no seconds"));
        let back = of(&["0", "0.01", "-0.01", "0.02"], 5, 100.0);
        assert!(back.times.is_none() && back.note.unwrap().contains("do not ascend (frame 7)"));
    }
}
