use super::*;
use crate::numeric::parallel::rng;
use ndarray::Array2;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

const POINTS: usize = 6;

/// A performance: some waves a point and axis, of frequencies that never repeat.
struct Performance(Vec<[f64; 3]>);

impl Performance {
    fn new(seed: u64) -> Performance {
        let mut random = rng(seed, 0);
        let waves = 3 * POINTS * 12;
        let mut wave = |_| {
            let hertz: f64 = random.random_range(0.05..2.5);
            let phase = random.random_range(0.0..std::f64::consts::TAU);
            [random.random_range(2.0..12.0) / (0.4 + hertz), hertz, phase]
        };
        Performance((0..waves).map(&mut wave).collect())
    }

    fn at(&self, s: f64, column: usize) -> f64 {
        let own = &self.0[12 * column..12 * column + 12];
        let wave = |[size, hertz, phase]: &[f64; 3]| {
            size * (std::f64::consts::TAU * hertz * s + phase).sin()
        };
        own.iter().map(wave).sum()
    }

    /// It, recorded from the time `from` on with a clock on which a second lasts `second`.
    fn recorded(&self, from: f64, second: f64, rate: f64, frames: usize, noise: f64) -> Poses {
        let mut random = rng(frames as u64, (from * 1e3) as u64);
        let mut xyz = Array2::from_shape_fn((frames, 3 * POINTS), |(t, c)| {
            self.at(from + second * t as f64 / rate, c)
        });
        xyz.mapv_inplace(|v| {
            let error: f64 = StandardNormal.sample(&mut random);
            v + noise * error
        });
        Poses {
            points: (0..POINTS).map(|p| format!("p{p}")).collect(),
            xyz,
            time: Some((0..frames).map(|t| 2.0 + t as f64 / rate).collect()),
            take: None,
        }
    }
}

fn shared() -> Vec<[usize; 2]> {
    (0..POINTS).map(|p| [p, p]).collect()
}

fn found(a: &Poses, b: &Poses, drift: bool) -> Option<TimeAlignment> {
    let found = align(a, b, &shared(), &TimeAlignmentOptions { drift }).unwrap();
    found.filter(|found| found.is_clear)
}

#[test]
fn a_planted_shift_is_found_whatever_the_rates() {
    let play = Performance::new(1);
    for (from, rate) in [
        (0.1447, 120.0),
        (5.3, 100.0),
        (3.0, 30.0 / 1.001),
        (8.25, 240.0),
    ] {
        let a = play.recorded(4.0, 1.0, 120.0, 1200, 0.2);
        let b = play.recorded(from, 1.0, rate, (9.0 * rate) as usize, 0.2);
        let one = found(&a, &b, false).unwrap();
        assert!(
            (one.shift - from + 4.0).abs() < 0.05 / 120.0,
            "{from} {rate}: {one:?}"
        );
        assert!(
            one.correlation > 0.9 && one.unasked_drift.is_none(),
            "{one:?}"
        );
        // The other way about.
        let other = found(&b, &a, false).unwrap();
        assert!((other.shift + one.shift).abs() < 0.02 / 120.0, "{other:?}");
    }
}

#[test]
fn place_and_heading_do_not_count_and_missing_pieces_are_left_out() {
    let play = Performance::new(2);
    let a = play.recorded(0.0, 1.0, 120.0, 1500, 0.1);
    let mut b = play.recorded(1.2345, 1.0, 120.0, 1300, 0.1);
    for mut row in b.xyz.rows_mut() {
        for p in 0..POINTS {
            let [x, y, z] = [0, 1, 2].map(|c| row[3 * p + c]);
            let new = [0.6 * x + 0.8 * z + 300.0, y + 9.0, 0.6 * z - 0.8 * x];
            (0..3).for_each(|c| row[3 * p + c] = new[c]);
        }
    }
    b.xyz.slice_mut(ndarray::s![200..420, 0..6]).fill(f64::NAN);
    b.xyz.slice_mut(ndarray::s![.., 9..12]).fill(f64::NAN);
    let one = found(&a, &b, false).unwrap();
    assert!((one.shift - 1.2345).abs() < 0.05 / 120.0, "{one:?}");
}

#[test]
fn a_drift_is_found_and_told_where_it_was_not_asked_for() {
    let play = Performance::new(3);
    for drift in [0.001, -0.004, 0.0] {
        let a = play.recorded(0.0, 1.0, 100.0, 9000, 0.2);
        let b = play.recorded(2.5, 1.0 + drift, 60.0, 4800, 0.2);
        let one = found(&a, &b, true).unwrap();
        assert!((one.drift - drift).abs() < 1e-5, "{one:?}");
        assert!((one.shift - 2.5).abs() < 1e-3, "{one:?}");
        assert!((one.drift - drift).abs() < 5.0 * one.drift_sd, "{one:?}");
    }
    let a = play.recorded(0.0, 1.0, 100.0, 3000, 0.2);
    let b = play.recorded(1.0, 1.001, 100.0, 2500, 0.2);
    let told = found(&a, &b, false).unwrap().unasked_drift.unwrap();
    assert!((told - 0.001).abs() < 1e-4, "{told}");
}

#[test]
fn the_stated_deviation_is_that_of_the_errors() {
    let mut ratios = Vec::new();
    for seed in 0..60 {
        let play = Performance::new(100 + seed);
        let from = 1.0 + 0.0137 * seed as f64;
        let a = play.recorded(0.0, 1.0, 120.0, 900, 0.5);
        let b = play.recorded(from, 1.0, 120.0, 860, 0.5);
        let one = found(&a, &b, false).unwrap();
        ratios.push((one.shift - from) / one.shift_sd);
    }
    let rms = (ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len() as f64).sqrt();
    assert!((0.75..1.35).contains(&rms), "{rms}: {ratios:?}");
}

#[test]
fn another_performance_is_not_found() {
    for seed in 0..12 {
        let (one, other) = (Performance::new(10 + seed), Performance::new(50 + seed));
        let a = one.recorded(0.0, 1.0, 120.0, 700, 0.1);
        let b = other.recorded(0.0, 1.0, 120.0, 600, 0.1);
        for drift in [false, true] {
            assert_eq!(found(&a, &b, drift), None, "{seed}");
        }
    }
}

#[test]
fn a_recording_lies_on_itself_exactly() {
    let a = Performance::new(5).recorded(0.0, 1.0, 120.0, 400, 0.1);
    let one = found(&a, &a, false).unwrap();
    assert!(one.shift.abs() < 1e-9 && one.shift_sd < 1e-9, "{one:?}");
    let drifting = found(&a, &a, true).unwrap();
    assert!(drifting.drift.abs() < 1e-9, "{drifting:?}");
}

#[test]
fn what_tells_nothing_gives_nothing() {
    let play = Performance::new(6);
    let a = play.recorded(0.0, 1.0, 120.0, 400, 0.0);
    assert_eq!(
        align(&a, &a, &[], &TimeAlignmentOptions::default()).unwrap(),
        None
    );
    for value in [0.0, f64::NAN, f64::INFINITY] {
        let mut still = a.clone();
        still.xyz.fill(value);
        for drift in [false, true] {
            assert_eq!(found(&a, &still, drift), None, "{value}");
            assert_eq!(found(&still, &a, drift), None, "{value}");
        }
    }
    for frames in [2, 5, 20] {
        assert_eq!(found(&a, &a.slice(0..frames), true), None);
    }
    let mut paused = a.clone();
    paused.time.as_mut().unwrap()[399] = 1e12;
    let long = align(&a, &paused, &shared(), &TimeAlignmentOptions::default());
    assert!(long.unwrap_err().to_string().contains("cut it first"));
    for frames in [0, 1] {
        assert!(
            align(
                &a,
                &a.slice(0..frames),
                &shared(),
                &TimeAlignmentOptions::default()
            )
            .is_err()
        );
    }
}
