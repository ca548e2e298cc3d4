//! The shift at which speeds correlate best, of all.
//!
//! At each shift, what both have of each point is compared, whatever else is missing: six sums of
//! products over all shifts at once, by Fourier transforms. A correlation counts by Fisher's
//! z = artanh r, times the root of how much is compared: short ends that are alike by chance do not
//! win.

use super::correlation::Correlator;
use super::speeds::Speeds;
use crate::numeric::statistics::mean_of_finite;

/// Speeds are compared this often at most, a second.
pub(super) const GRID: f64 = 30.0;
/// What is compared at least, seconds, and of the shorter recording.
const LEAST_OVERLAP: f64 = 1.0;
const LEAST_SHARE: f64 = 0.1;
/// Another place is further away than this, seconds.
pub(super) const ANOTHER: f64 = 0.35;
/// Points that are compared at most: those that move most.
const MOST_POINTS: usize = 40;
/// Correlations above this count as it.
const HIGHEST: f64 = 0.9999;
/// Places that are refined, to be compared.
const PLACES: usize = 6;

/// Where B may lie beside A.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaceInTime {
    /// Seconds.
    pub shift: f64,
    pub drift: f64,
    /// The share of all that is compared there: its root.
    pub weight: f64,
}

/// The best places of B beside A, the first first.
pub(super) fn places(a: &Speeds, b: &Speeds) -> Vec<PlaceInTime> {
    let grid = GRID.min(a.rate).min(b.rate);
    places_of(&a.sampled(1.0 / grid), &b.sampled(1.0 / grid), grid)
}

/// The best places of speeds by points, `grid` of them a second, beside others.
pub(super) fn places_of(a: &[Vec<f64>], b: &[Vec<f64>], grid: f64) -> Vec<PlaceInTime> {
    let [long, short] = [a, b].map(|all| all.first().map_or(0, Vec::len));
    let correlator = Correlator::new(long + short);
    let mut sums = Sums::new(correlator.shifts());
    for point in moving(a, b) {
        sums.add(&correlator, &a[point], &b[point]);
    }
    let shifts = 1 - short as isize..long as isize;
    let at = |shift: isize| shift.rem_euclid(correlator.shifts() as isize) as usize;
    let most = sums.count.iter().copied().fold(0.0, f64::max);
    let share = (LEAST_OVERLAP * grid / long.min(short) as f64).clamp(LEAST_SHARE, 0.5);
    let weight = |shift: isize| (sums.count[at(shift)] / most).sqrt();
    let correlation = |shift: isize| {
        let k = at(shift);
        let r = sums.covariance[k] / (sums.variances[0][k] * sums.variances[1][k]).sqrt();
        let is_enough = sums.count[k] >= share * most;
        if r.is_finite() && is_enough { r } else { 0.0 }
    };
    let by_evidence = |shift: isize| (evidence(correlation(shift)) * weight(shift), shift);
    let mut left: Vec<(f64, isize)> = shifts.map(by_evidence).collect();
    let apart = (ANOTHER * grid).round() as isize;
    let mut out: Vec<PlaceInTime> = Vec::new();
    while out.len() < PLACES {
        let best = left.iter().copied().max_by(|x, y| x.0.total_cmp(&y.0));
        let Some((_, shift)) = best.filter(|(evidence, _)| *evidence > 0.0) else {
            break;
        };
        left.retain(|(_, other)| (other - shift).abs() > apart);
        let beside = [-1, 0, 1].map(|step| correlation(shift + step));
        out.push(PlaceInTime {
            shift: (shift as f64 + vertex(beside)) / grid,
            drift: 0.0,
            weight: weight(shift),
        });
    }
    out
}

/// What a correlation counts: Fisher's z.
pub(super) fn evidence(correlation: f64) -> f64 {
    correlation.clamp(0.0, HIGHEST).atanh()
}

/// Where the parabola through three values in a row is highest, from the middle one.
pub(super) fn vertex([before, here, after]: [f64; 3]) -> f64 {
    let bend = before - 2.0 * here + after;
    let place = 0.5 * (before - after) / bend;
    if bend < 0.0 && place.abs() <= 1.0 {
        place
    } else {
        0.0
    }
}

/// The points that both show, those first that move most in A.
pub(super) fn moving(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<usize> {
    let variance = |values: &[f64]| {
        let mean = mean_of_finite(values.iter().copied())?;
        mean_of_finite(values.iter().map(|v| (v - mean).powi(2))).filter(|v| *v > 0.0)
    };
    let both = (0..a.len()).filter_map(|p| Some((variance(&a[p])?, variance(&b[p])?, p)));
    let mut both: Vec<(f64, f64, usize)> = both.collect();
    both.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.2.cmp(&y.2)));
    both.iter().take(MOST_POINTS).map(|(.., p)| *p).collect()
}

/// What is compared at each shift, over all points: how many speeds, and their moments about the
/// means of each point there.
struct Sums {
    count: Vec<f64>,
    covariance: Vec<f64>,
    variances: [Vec<f64>; 2],
}

impl Sums {
    fn new(shifts: usize) -> Sums {
        let none = vec![0.0; shifts];
        Sums {
            count: none.clone(),
            covariance: none.clone(),
            variances: [none.clone(), none],
        }
    }

    /// Adds the speeds of a point.
    fn add(&mut self, correlator: &Correlator, a: &[f64], b: &[f64]) {
        let spectra = |values: &[f64]| {
            // Less their mean, so that no digits are lost.
            let mean = mean_of_finite(values.iter().copied()).unwrap_or(0.0);
            let power = |k: i32| {
                let of = move |v: &f64| {
                    if v.is_finite() {
                        (v - mean).powi(k)
                    } else {
                        0.0
                    }
                };
                correlator.spectrum(values.iter().map(of))
            };
            [0, 1, 2].map(power)
        };
        let (a, b) = (spectra(a), spectra(b));
        let product = |i: usize, j: usize| correlator.correlation(&a[i], &b[j]);
        let (n, cross) = (product(0, 0), product(1, 1));
        let (a_sum, b_sum) = (product(1, 0), product(0, 1));
        let (a_squares, b_squares) = (product(2, 0), product(0, 2));
        for k in (0..correlator.shifts()).filter(|k| n[*k] > 0.5) {
            self.count[k] += n[k].round();
            self.covariance[k] += cross[k] - a_sum[k] * b_sum[k] / n[k];
            self.variances[0][k] += (a_squares[k] - a_sum[k].powi(2) / n[k]).max(0.0);
            self.variances[1][k] += (b_squares[k] - b_sum[k].powi(2) / n[k]).max(0.0);
        }
    }
}
