//! The distances between points of a take: how long they are, and how steady.

use super::tuning::distances::*;
use ndarray::ArrayView2;

/// The distance of two points over a take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Distance {
    /// The median, cm.
    pub median: f64,
    /// Standard deviation by the 10th and 90th percentiles, cm.
    pub spread: f64,
    /// Standard deviation by the 5th and 95th percentiles, cm: larger where a tenth of the lengths
    /// differ.
    pub tails: f64,
    /// In how many frames it was measured.
    pub frames: usize,
}

impl Distance {
    /// The distance of two points of `xyz` (frames, 3 J; cm, NaN missing). `None` where they are
    /// never seen together.
    pub(crate) fn measure(xyz: ArrayView2<'_, f64>, points: [usize; 2]) -> Option<Distance> {
        let step = xyz.nrows().div_ceil(MOST_FRAMES).max(1);
        let [a, b] = points;
        let length = |row: ndarray::ArrayView1<'_, f64>| {
            let square = |axis: usize| (row[3 * a + axis] - row[3 * b + axis]).powi(2);
            (0..3).map(square).sum::<f64>().sqrt()
        };
        let all = xyz.rows().into_iter().step_by(step).map(length);
        Distance::of(all.filter(|l| l.is_finite()).collect())
    }

    /// How little it says, cm: its spread, and a little for its length.
    pub(crate) fn looseness(&self) -> f64 {
        self.spread + LOOSER * self.median
    }

    /// The distance whose measured lengths, cm, these are; `None` of none.
    pub(crate) fn of(mut lengths: Vec<f64>) -> Option<Distance> {
        let last = lengths.len().checked_sub(1)?;
        lengths.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| lengths[(share * last as f64).round() as usize];
        Some(Distance {
            median: at(0.5),
            // Of a Gaussian these are 2.56 standard deviations apart.
            spread: (at(0.9) - at(0.1)) / 2.563,
            tails: (at(0.95) - at(0.05)) / 3.29,
            frames: lengths.len(),
        })
    }
}

/// How much likelier a length is as that of a distance than as that to any point, nats; both may be
/// wrong now and then.
pub(crate) fn log_likelihood(length: f64, distance: &Distance) -> f64 {
    let sd = distance.spread.max(LEAST_SPREAD);
    let z = (length - distance.median) / sd;
    let density = (-0.5 * z * z).exp() / (sd * (2.0 * std::f64::consts::PI).sqrt());
    ((1.0 - ANY) * density * ANYWHERE + ANY).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn a_distance_is_measured_though_a_tenth_is_off() {
        let xyz = Array2::from_shape_fn((200, 6), |(t, c)| match c {
            3 if t % 12 == 0 => 90.0,
            3 => 10.0 + 0.1 * (t as f64).sin(),
            5 if t < 20 => f64::NAN,
            _ => 0.0,
        });
        let found = Distance::measure(xyz.view(), [0, 1]).unwrap();
        assert_eq!(found.frames, 180);
        assert!(
            (found.median - 10.0).abs() <= 0.03 && found.spread <= 0.1,
            "{found:?}"
        );
        assert_eq!(
            Distance::measure(xyz.slice(ndarray::s![..20, ..]), [0, 1]),
            None
        );
    }
}
