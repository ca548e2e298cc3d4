//! Small work on values over time: slopes, peaks and crossings.

/// The slope at each frame, a second: central differences, one-sided at the ends.
pub(crate) fn slope(values: &[f64], rate: f64) -> Vec<f64> {
    let last = values.len() - 1;
    let at = |t: usize| {
        let (a, b) = (t.saturating_sub(1), (t + 1).min(last));
        (values[b] - values[a]) / (b - a).max(1) as f64 * rate
    };
    (0..=last).map(at).collect()
}

/// The frames of peaks that stand out by more than `prominence`, between frames: the vertex of the
/// parabola through a peak and its neighbors.
pub(crate) fn peaks(values: &[f64], prominence: f64) -> Vec<f64> {
    let is_peak = |t: &usize| values[*t] > values[t - 1] && values[*t] > values[t + 1];
    let is_high = |t: &usize| {
        let lowest = |side: &mut dyn Iterator<Item = usize>| {
            let lower = side.map(|i| values[i]).take_while(|v| *v <= values[*t]);
            lower.fold(f64::INFINITY, f64::min)
        };
        let [before, after] = [
            lowest(&mut (0..*t).rev()),
            lowest(&mut (t + 1..values.len())),
        ];
        values[*t] - before.max(after) >= prominence
    };
    let vertex = |t: usize| {
        let [a, b, c] = [values[t - 1], values[t], values[t + 1]];
        t as f64 + 0.5 * (a - c) / (a - 2.0 * b + c)
    };
    let inner = 1..values.len().saturating_sub(1);
    inner.filter(is_peak).filter(is_high).map(vertex).collect()
}

/// The frames at which values rise through a threshold, or fall, on the lines between frames.
pub(crate) fn crossings(values: &[f64], threshold: f64, rises: bool) -> Vec<f64> {
    let is_crossing = |t: &usize| {
        let [now, next] = [values[*t], values[t + 1]].map(|v| v > threshold);
        next == rises && now != rises
    };
    let at = |t: usize| t as f64 + (threshold - values[t]) / (values[t + 1] - values[t]);
    (0..values.len().saturating_sub(1))
        .filter(is_crossing)
        .map(at)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_and_crossings_lie_between_frames() {
        let wave: Vec<f64> = (0..40)
            .map(|t| (0.3 * (f64::from(t) - 0.2)).sin())
            .collect();
        let quarter = std::f64::consts::FRAC_PI_2 / 0.3 + 0.2;
        let found = peaks(&wave, 0.5);
        assert!(
            (found[0] - quarter).abs() < 0.01 && found.len() == 2,
            "{found:?}"
        );
        assert_eq!(peaks(&wave, 3.0).len(), 0);
        let falls = crossings(&wave, 0.0, false);
        assert!((falls[0] - (std::f64::consts::PI / 0.3 + 0.2)).abs() < 0.01);
        assert!((crossings(&wave, 0.0, true)[0] - 0.2).abs() < 0.01);
        let line: Vec<f64> = (0..5).map(|t| 2.0 * f64::from(t)).collect();
        assert_eq!(slope(&line, 10.0), [20.0; 5]);
    }
}
