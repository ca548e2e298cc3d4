//! Two takes on one timeline.

use super::*;

/// A take of points along x, each frame a centimeter on, from `start` on at `rate`.
fn poses(points: &[&str], frames: usize, start: f64, rate: f64) -> Poses {
    Poses {
        points: points.iter().map(|name| name.to_string()).collect(),
        xyz: Array2::from_shape_fn((frames, 3 * points.len()), |(t, c)| {
            (start + t as f64 / rate) * 100.0 + (c % 3) as f64
        }),
        time: Some((0..frames).map(|t| start + t as f64 / rate).collect()),
        take: None,
    }
}

fn take<'a>(name: &'a str, poses: &'a Poses, rate: f64) -> PairTake<'a> {
    PairTake {
        name,
        file: name,
        poses,
        rate,
        is_clocked: true,
        bones: &[],
        status: None,
        sd: None,
        method: None,
    }
}

fn pair(a: &Poses, b: &Poses, rates: [f64; 2]) -> TakePair {
    TakePair::new([take("a", a, rates[0]), take("b", b, rates[1])]).unwrap()
}

fn largest(pair: &TakePair) -> f64 {
    pair.differences.as_ref().unwrap().points[0].largest
}

#[test]
fn a_take_differs_from_itself_by_nothing() {
    let a = poses(&["hip", "knee"], 50, 0.0, 100.0);
    let pair = pair(&a, &a, [100.0; 2]);
    assert!(pair.is_frame_by_frame && pair.remarks.is_empty());
    let told = pair.differences.as_ref().unwrap();
    assert_eq!((told.frames.len(), told.points.len()), (50, 2));
    assert!(told.frames.iter().all(|d| d.unwrap().largest == 0.0));
    assert_eq!(pair.takes[0].xyz, a.xyz);
}

#[test]
fn a_planted_difference_is_found_with_its_point_and_frame() {
    let a = poses(&["hip", "knee", "toe"], 40, 0.0, 100.0);
    // Another order of the points, and one of its own.
    let mut b = poses(&["toe", "head", "knee"], 40, 0.0, 100.0);
    b.xyz[[7, 6]] += 3.0;
    b.xyz[[7, 7]] -= 4.0;
    let pair = pair(&a, &b, [100.0; 2]);
    assert_eq!(pair.points, ["hip", "knee", "toe", "head"]);
    assert_eq!(pair.takes[1].has, [false, true, true, true]);
    let told = pair.differences.as_ref().unwrap();
    let frame = told.frames[7].unwrap();
    assert!((frame.largest - 5.0).abs() <= 1e-9 && frame.point == 1);
    assert!((frame.rms - 5.0 / 2.0_f64.sqrt()).abs() <= 1e-9);
    let first = told.points[0];
    assert_eq!((told.points.len(), first.point, first.frame), (2, 1, 7));
    assert!((first.rms - 5.0 / 40.0_f64.sqrt()).abs() <= 1e-9);
    assert!(pair.remarks[0].contains("2 points that both have by name, of 3 and 3"));
}

#[test]
fn a_prefix_of_all_names_parts_no_points() {
    let a = poses(&["mixamorig:Hips", "mixamorig:Head"], 20, 0.0, 100.0);
    let mut b = poses(&["Head", "Hips"], 20, 0.0, 100.0);
    b.xyz[[7, 0]] += 2.0;
    let pair = pair(&a, &b, [100.0; 2]);
    assert_eq!(pair.points, a.points);
    let told = pair.differences.as_ref().unwrap();
    assert_eq!(told.frames[7].unwrap().point, 1);
    assert!((largest(&pair) - 2.0).abs() <= 1e-9);
}

#[test]
fn every_fourth_frame_of_a_take_differs_from_it_by_nothing() {
    let whole = poses(&["hip"], 41, 0.0, 120.0);
    let fourth = poses(&["hip"], 11, 0.0, 30.0);
    for swapped in [false, true] {
        let pair = if swapped {
            pair(&fourth, &whole, [30.0, 120.0])
        } else {
            pair(&whole, &fourth, [120.0, 30.0])
        };
        assert_eq!(pair.takes[0].frames.len(), 41, "at the higher rate");
        assert!(largest(&pair) <= 1e-9);
        assert_eq!(pair.runs.len(), 1);
        let slow = &pair.takes[usize::from(!swapped)].frames;
        // The frame between is as near to either.
        assert_eq!([0, 1, 3, 4, 5].map(|t| slow[t]), [0, 0, 1, 1, 1].map(Some));
        let told = pair.remarks.join(" ");
        assert!(
            told.contains("Both play in seconds.") && told.contains("nearest frames"),
            "{told}"
        );
    }
}

#[test]
fn no_frame_is_lost_and_none_is_compared_where_one_has_ended() {
    let long = poses(&["hip"], 101, 0.0, 100.0);
    let late = poses(&["hip"], 31, 0.9, 30.0);
    let pair = pair(&long, &late, [100.0, 30.0]);
    for (take, count) in pair.takes.iter().zip([101, 31]) {
        let mut own: Vec<usize> = take.frames.iter().flatten().copied().collect();
        own.dedup();
        assert_eq!(own, (0..count).collect::<Vec<_>>());
    }
    let told = pair.differences.as_ref().unwrap();
    assert!(told.frames[..88].iter().all(Option::is_none));
    assert!(told.frames[92].is_some() && told.frames.last().unwrap().is_none());
    assert!(
        largest(&pair) <= 0.5 * 3_f64.sqrt() + 1e-9,
        "half a frame of the faster"
    );
    // After the end of the faster take, time goes on at the rate of the other.
    let rates: Vec<f64> = pair.runs.iter().map(|run| run.rate).collect();
    assert_eq!(rates, [100.0, 30.0]);
    let last = pair.runs.last().unwrap();
    let seconds = last.time + (pair.takes[0].frames.len() - 1 - last.first) as f64 / last.rate;
    assert!((seconds - 1.9).abs() <= 1e-9, "{seconds}");
}

#[test]
fn takes_without_a_clock_begin_together_and_those_without_a_time_in_common_are_not_compared() {
    let a = poses(&["hip"], 20, 0.0, 100.0);
    let mut b = poses(&["hip"], 20, 7.0, 100.0);
    b.xyz.clone_from(&a.xyz);
    let clocked = pair(&a, &b, [100.0; 2]);
    assert!(clocked.differences.is_none());
    assert!(clocked.remarks.join(" ").contains("no time in common"));
    let mut takes = [take("a", &a, 100.0), take("b", &b, 100.0)];
    takes[0].is_clocked = false;
    let free = TakePair::new(takes).unwrap();
    assert_eq!(largest(&free), 0.0);
    let told = free.differences.unwrap().frames;
    assert!(told.len() == 20 && told.iter().all(Option::is_some));
}

#[test]
fn what_is_missing_or_flat_in_one_is_left_out() {
    let mut a = poses(&["hip", "knee"], 3, 0.0, 10.0);
    let mut b = a.clone();
    a.xyz[[1, 0]] = f64::NAN;
    (0..3).for_each(|t| [2, 5].iter().for_each(|c| b.xyz[[t, *c]] = f64::NAN));
    let told = pair(&a, &b, [10.0; 2]).differences.unwrap();
    assert!(told.frames.iter().all(|d| d.unwrap().largest == 0.0));
    b.xyz.fill(f64::NAN);
    let none = pair(&a, &b, [10.0; 2]);
    assert!(none.differences.is_none() && none.remarks[0].contains("No point is seen in both"));
    let other = poses(&["toe"], 3, 0.0, 10.0);
    let none = pair(&a, &other, [10.0; 2]);
    assert!(none.differences.is_none() && none.remarks[0].contains("No point of a has the name"));
}

#[test]
fn several_takes_in_a_file_are_compared_frame_by_frame_or_refused() {
    let mut a = poses(&["hip"], 4, 0.0, 10.0);
    a.take = Some(["v", "v", "w", "w"].map(Into::into).to_vec());
    a.time = Some(vec![0.0, 0.1, 0.0, 0.1]);
    let same = pair(&a, &a, [10.0; 2]);
    let names: Vec<&str> = same.runs.iter().map(|run| &*run.name).collect();
    assert_eq!(names, ["v", "w"]);
    let b = poses(&["hip"], 5, 0.0, 10.0);
    let takes = [take("a", &a, 10.0), take("b", &b, 10.0)];
    let error = TakePair::new(takes).unwrap_err().to_string();
    assert!(error.contains("holds 2 takes"), "{error}");
    a.take = None;
    let takes = [take("a", &a, 10.0), take("b", &b, 10.0)];
    let error = TakePair::new(takes).unwrap_err().to_string();
    assert!(error.contains("do not rise after frame 1"), "{error}");
}
