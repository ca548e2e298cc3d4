//! Six people of a sample study, with Vicon's own values in their files (`data/gait` of the larger
//! collection beside the repository; where it is not there, nothing is tested).

use glam::DVec3;
use ndarray::Array2;
use posing_core::pose::{LengthUnit, UpAxis};
use posing_gait::{
    ANGLES, Event, EventChoice, EventKind, EventSource, GaitSettings, GaitTrial, MARKERS, Markers,
    Norm, ProfileScores, Session, SessionTrial, Side, Trial,
};
use posing_io::{C3d, Input};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const PEOPLE: [&str; 6] = ["HC030A", "HC031A", "HC036A", "HC038A", "HC040A", "HC055A"];

/// A file, and its trial.
struct Take {
    file: C3d,
    trial: Trial,
}

impl Take {
    fn open(folder: &Path, person: &str, kind: &str) -> Take {
        let file = C3d::open(folder.join(format!("{person}_{kind}.c3d"))).unwrap();
        let trial = Trial::from_c3d(&file, None, None).unwrap();
        Take { file, trial }
    }

    /// Vicon's values of a point; NaN where it has none.
    fn stored(&self, name: &str) -> Vec<DVec3> {
        let take = &self.file.take;
        let at = take.points.iter().position(|p| p == name).unwrap();
        let xyz = |t: usize, c: usize| take.xyz[[t, 3 * at + c]];
        let point = |t: usize| DVec3::new(xyz(t, 0), xyz(t, 1), xyz(t, 2));
        let missing = |p: DVec3| if p == DVec3::ZERO { DVec3::NAN } else { p };
        (0..take.xyz.nrows()).map(|t| missing(point(t))).collect()
    }

    fn has(&self, name: &str) -> bool {
        self.file.take.points.iter().any(|p| p == name)
    }
}

fn folder() -> Option<PathBuf> {
    let own = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR")?);
    let folder = own.join("../../../shared/data/gait");
    if !folder.exists() {
        println!("skipped: no {}", folder.display());
        return None;
    }
    Some(folder)
}

/// The worst figure of each kind.
#[derive(Default)]
struct Worst(BTreeMap<String, Vec<f64>>);

impl Worst {
    fn add(&mut self, name: impl Into<String>, value: f64) {
        self.0.entry(name.into()).or_default().push(value);
    }

    /// Prints mean and worst of each; checks the worst.
    fn check(&self, limit: impl Fn(&str) -> f64) {
        let mut wrong = Vec::new();
        for (name, values) in &self.0 {
            let worst = values.iter().copied().fold(0.0, f64::max);
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            println!(
                "{name:34} n {:3}  mean {mean:.6}  worst {worst:.6}",
                values.len()
            );
            if worst.is_nan() || worst > limit(name) {
                wrong.push(format!("{name} {worst}, at most {}", limit(name)));
            }
        }
        assert!(wrong.is_empty(), "{wrong:?}");
    }
}

/// The largest distance in the frames that Vicon has; they must be there.
fn largest(own: &[DVec3], stored: &[DVec3], apart: impl Fn(DVec3) -> f64) -> f64 {
    let pairs = own.iter().zip(stored).filter(|(_, s)| s.is_finite());
    pairs
        .map(|(a, b)| apart(*a - *b))
        .fold(0.0, |m, v| if v.is_nan() { v } else { m.max(v) })
}

fn wrapped(v: DVec3) -> f64 {
    v.map(|d| ((d + 180.0).rem_euclid(360.0) - 180.0).abs())
        .max_element()
}

#[test]
fn centers_and_angles_are_vicon_s() {
    let Some(folder) = folder() else { return };
    let mut worst = Worst::default();
    for person in PEOPLE {
        let statics = Take::open(&folder, person, "Static").trial;
        for kind in ["Straight", "Turn"] {
            let mut take = Take::open(&folder, person, kind);
            let settings = GaitSettings {
                vicon_quirks: true,
                ..GaitSettings::default()
            };
            let gait = GaitTrial::new(&take.trial, None, &settings).unwrap();
            for side in ["L", "R"] {
                for (own, vicon) in [("HJC", "FEP"), ("KJC", "FEO"), ("AJC", "TIO")] {
                    let stored = take.stored(&format!("{side}{vicon}"));
                    let own = &gait.curves[&format!("{side}{own}")];
                    worst.add("center, mm", largest(own, &stored, DVec3::length));
                }
            }
            // The same without the offsets that are stored with the trial.
            for name in ["StaticPlantFlex", "StaticRotOff"] {
                for side in ["L", "R"] {
                    take.trial.given.set(&format!("{side}{name}"), f64::NAN);
                }
            }
            let by_static = GaitTrial::new(&take.trial, Some(&statics), &settings).unwrap();
            for (name, side) in ANGLES[..5]
                .iter()
                .flat_map(|name| [(name, "L"), (name, "R")])
            {
                let name = format!("{side}{name}");
                if !take.has(&name) {
                    continue;
                }
                let stored = take.stored(&name);
                let own = largest(&gait.curves[&name], &stored, wrapped);
                worst.add(format!("{}, degrees", &name[1..]), own);
                let own = largest(&by_static.curves[&name], &stored, wrapped);
                worst.add(format!("{} by static, degrees", &name[1..]), own);
            }
        }
    }
    worst.check(|name| match name {
        "center, mm" => 0.000_52,
        "FootProgressAngles by static, degrees" => 0.004,
        name if name.contains("static") => 0.000_051,
        _ => 0.000_03,
    });
}

#[test]
fn forces_and_moments_are_vicon_s() {
    let Some(folder) = folder() else { return };
    for kind in ["Straight", "Turn"] {
        let mut worst = Worst::default();
        for person in PEOPLE {
            let take = Take::open(&folder, person, kind);
            let gait = GaitTrial::new(&take.trial, None, &GaitSettings::default()).unwrap();
            for side in Side::BOTH {
                if take.has(&format!("{}GroundReactionForce", side.letter())) {
                    kinetics(&take, &gait, side, &mut worst);
                }
            }
        }
        println!("{kind}");
        worst.check(|name| match name {
            "ground reaction, N/kg" => 1e-5,
            "force, N/kg" => 0.0045,
            _ => 0.5,
        });
    }
}

/// The distances of a side's forces, moments and powers from Vicon's.
fn kinetics(take: &Take, gait: &GaitTrial, side: Side, worst: &mut Worst) {
    let of = |name: &str| {
        let name = format!("{}{name}", side.letter());
        let (own, stored) = (&gait.curves[&name], take.stored(&name));
        own.iter().copied().zip(stored).collect::<Vec<_>>()
    };
    let pairs = of("GroundReactionForce").into_iter();
    let loaded: Vec<_> = pairs.filter(|(own, _)| own.z > 0.0).collect();
    if !loaded.is_empty() {
        let apart = loaded.iter().map(|(a, b)| (*a - *b).length());
        worst.add("ground reaction, N/kg", apart.fold(0.0, f64::max));
    }
    let contacts = gait.contacts.iter().filter(|c| c.side == side && !c.of_two);
    for contact in contacts {
        let [on, off] = [contact.on + 0.02, contact.off - 0.02].map(|t| t * take.trial.rate);
        let frames = on.ceil() as usize..(off as usize).min(take.trial.markers.frames() - 4);
        let hip = &gait.curves[&format!("{}HipForce", side.letter())];
        assert!(hip[frames].iter().all(|v| v.is_finite()));
    }
    for joint in ["Ankle", "Knee", "Hip"] {
        for (kind, axes) in [("Force", 0..3), ("Moment", 0..3), ("Power", 2..3)] {
            for axis in axes {
                let pairs = of(&format!("{joint}{kind}")).into_iter();
                let pairs = pairs.map(|(a, b)| (a[axis], b[axis]));
                let pairs: Vec<_> = pairs.filter(|(a, b)| (a + b).is_finite()).collect();
                let stored = || pairs.iter().map(|(_, b)| *b);
                let range = stored().fold(f64::MIN, f64::max) - stored().fold(f64::MAX, f64::min);
                if pairs.is_empty() {
                    continue;
                }
                if kind == "Force" {
                    let apart = pairs.iter().map(|(a, b)| (a - b).abs());
                    worst.add("force, N/kg", apart.fold(0.0, f64::max));
                    continue;
                }
                let square: f64 = pairs.iter().map(|(a, b)| (a - b).powi(2)).sum();
                let rms = (square / pairs.len() as f64).sqrt();
                let name = format!("{joint} {kind} {}, % of range", ["x", "y", "z"][axis]);
                worst.add(name, 100.0 * rms / range);
            }
        }
    }
}

#[test]
fn events_are_those_of_plates_and_near_to_them_by_markers() {
    let Some(folder) = folder() else { return };
    let mut apart: BTreeMap<(&str, bool), Vec<f64>> = BTreeMap::new();
    for person in PEOPLE {
        for kind in ["Straight", "Turn"] {
            let take = Take::open(&folder, person, kind);
            let of = |events| {
                let settings = GaitSettings {
                    events,
                    ..GaitSettings::default()
                };
                GaitTrial::new(&take.trial, None, &settings).unwrap()
            };
            let (auto, markers) = (of(EventChoice::Auto), of(EventChoice::Markers));
            for plate in auto
                .events
                .iter()
                .filter(|e| e.source == EventSource::Plate)
            {
                let own = markers
                    .events
                    .iter()
                    .filter(|e| e.side == plate.side && e.kind == plate.kind);
                let own = own
                    .map(|e| 1e3 * (e.time_s - plate.time_s))
                    .filter(|d| d.abs() < 120.0);
                let name = if plate.kind == EventKind::FootStrike {
                    "strike"
                } else {
                    "off"
                };
                match own.min_by(|a, b| a.abs().total_cmp(&b.abs())) {
                    Some(own) => apart.entry((name, kind == "Turn")).or_default().push(own),
                    None => println!(
                        "{person} {kind}: no {name} {:?} at {:.3}",
                        plate.side, plate.time_s
                    ),
                }
            }
            for side in Side::BOTH {
                let own = auto
                    .events
                    .iter()
                    .filter(|e| e.side == side)
                    .collect::<Vec<_>>();
                assert!(own.windows(2).all(|e| e[1].time_s - e[0].time_s > 0.05));
            }
            let (missed, alone) = unlike_the_file(&take, &markers.events);
            assert!(missed.is_empty(), "{person} {kind} missed {missed:?}");
            assert!(alone.is_empty(), "{person} {kind} false {alone:?}");
        }
    }
    for ((name, turn), values) in &apart {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
        println!(
            "{name} by markers less by plate, turn {turn}: n {count} mean {mean:.1} sd {sd:.1} ms"
        );
        if !turn {
            let (most, spread) = if *name == "strike" {
                (2.0, 7.0)
            } else {
                (3.0, 9.0)
            };
            assert!(mean.abs() < most && sd < spread);
        }
    }
}

/// An event as side, kind and seconds.
type Told = (Side, EventKind, f64);

/// The file's events within the markers' span that events by markers miss by .1 s, and those by
/// markers between the file's events that it has not.
fn unlike_the_file(take: &Take, events: &[Event]) -> (Vec<Told>, Vec<Told>) {
    let settings = GaitSettings {
        events: EventChoice::File,
        ..GaitSettings::default()
    };
    let file = GaitTrial::new(&take.trial, None, &settings).unwrap().events;
    let told = |e: &Event| (e.side, e.kind, e.time_s);
    let is_near = |a: &Event, b: &Event| {
        (a.side, a.kind) == (b.side, b.kind) && (a.time_s - b.time_s).abs() < 0.1
    };
    let (mut missed, mut alone) = (Vec::new(), Vec::new());
    for side in Side::BOTH {
        let own = ["HEE", "TOE", "ANK"].map(|m| format!("{}{m}", side.letter()));
        let names = || own.iter().map(String::as_str).chain(["LASI", "RASI"]);
        let seen = |t: &usize| names().all(|m| take.trial.markers.get(m).unwrap()[*t].is_finite());
        let frames = 0..take.trial.markers.frames();
        let Some(low) = frames.clone().find(seen) else {
            continue;
        };
        let high = frames.rev().find(seen).unwrap();
        let (low, high) = (take.trial.time(low) + 0.1, take.trial.time(high) - 0.1);
        let file: Vec<&Event> = file.iter().filter(|e| e.side == side).collect();
        let inside = file.iter().filter(|e| low < e.time_s && e.time_s < high);
        let lacking = inside.filter(|e| !events.iter().any(|own| is_near(own, e)));
        missed.extend(lacking.map(|e| told(e)));
        let (Some(first), Some(last)) = (file.first(), file.last()) else {
            continue;
        };
        let span = low.max(first.time_s - 0.05)..high.min(last.time_s + 0.05);
        let own = events
            .iter()
            .filter(|e| e.side == side && span.contains(&e.time_s));
        alone.extend(
            own.filter(|e| !file.iter().any(|f| is_near(e, f)))
                .map(told),
        );
    }
    (missed, alone)
}

/// Another lab's files, with the markers' diameter that they do not store.
#[test]
fn another_lab_s_angles_and_values_are_vicon_s() {
    let Some(folder) = folder() else { return };
    let folder = folder.join("../formats/c3d/pig");
    if !folder.exists() {
        println!("skipped: no {}", folder.display());
        return;
    }
    let mut worst = Worst::default();
    for name in ["Full", "Hole"] {
        let open = |kind: &str| {
            let file = C3d::open(folder.join(format!("PiG_{kind}-FlatFoot-{name}.c3d"))).unwrap();
            let trial = Trial::from_c3d(&file, None, None).unwrap();
            Take { file, trial }
        };
        let (take, statics) = (open("Motion"), open("Calibration"));
        let mut settings = GaitSettings {
            events: EventChoice::File,
            ..GaitSettings::default()
        };
        settings.given.set("MarkerDiameter", 16.0);
        let gait = GaitTrial::new(&take.trial, Some(&statics.trial), &settings).unwrap();
        for (angle, side) in ANGLES.iter().flat_map(|name| [(name, "L"), (name, "R")]) {
            let angle = format!("{side}{angle}");
            if take.has(&angle) {
                let apart = largest(&gait.curves[&angle], &take.stored(&angle), wrapped);
                worst.add(format!("{name} {}, degrees", &angle[1..]), apart);
            }
        }
        let values = take.file.numbers("ANALYSIS:VALUES").iter();
        let texts = |name: &str| take.file.texts(&format!("ANALYSIS:{name}")).iter();
        assert_eq!(values.len(), 22);
        for ((what, side), value) in texts("NAMES").zip(texts("CONTEXTS")).zip(values) {
            let own = OF_ANALYSIS
                .iter()
                .find(|(n, _)| what.eq_ignore_ascii_case(n))
                .unwrap()
                .1;
            let whole = gait
                .cycles
                .iter()
                .find(|(cycle, values)| format!("{:?}", cycle.side) == *side && values.len() == 12);
            let apart = (whole.unwrap().1[own] - value).abs() / value.abs().max(0.1);
            worst.add(format!("{name} ANALYSIS, share"), apart);
        }
    }
    worst.check(|name| {
        if name.contains("ANALYSIS") {
            1e-4
        } else {
            0.001
        }
    });
}

/// The names of Vicon's ANALYSIS and ours.
const OF_ANALYSIS: [(&str, &str); 11] = [
    ("cadence", "cadence_steps_per_min"),
    ("walking speed", "walking_speed_m_per_s"),
    ("stride time", "stride_time_s"),
    ("step time", "step_time_s"),
    ("opposite foot off", "opposite_foot_off_percent"),
    ("opposite foot contact", "opposite_foot_strike_percent"),
    ("foot off", "foot_off_percent"),
    ("single support", "single_support_s"),
    ("double support", "double_support_s"),
    ("stride length", "stride_length_m"),
    ("step length", "step_length_m"),
];

#[test]
fn what_is_estimated_or_does_not_fit_is_told() {
    let Some(folder) = folder() else { return };
    let settings = GaitSettings::default();
    let kinds = |gait: &GaitTrial| gait.findings.iter().map(|f| f.kind).collect::<Vec<_>>();
    let mut worst = Worst::default();
    for (i, person) in PEOPLE.into_iter().enumerate() {
        let mut take = Take::open(&folder, person, "Straight");
        let other = Take::open(&folder, PEOPLE[(i + 1) % 6], "Static").trial;
        let mut own = Take::open(&folder, person, "Static").trial;
        let right = GaitTrial::new(&take.trial, Some(&own), &settings).unwrap();
        let told = kinds(&right);
        assert!(
            // The raw tracks of HC040A begin and end one by one.
            told.iter()
                .all(|k| *k == "event_alone" || person == "HC040A" && *k == "marker_late"),
            "{person} {:?}",
            right.findings
        );
        let wrong = GaitTrial::new(&take.trial, Some(&other), &settings).unwrap();
        assert!(kinds(&wrong).contains(&"static_differs"), "{person}");
        for trial in [&mut take.trial, &mut own] {
            trial.given = posing_gait::GivenValues::default();
            let mass = right.parameters.value("Bodymass");
            trial.given.set("Bodymass", mass);
        }
        let gait = GaitTrial::new(&take.trial, Some(&own), &settings).unwrap();
        assert!(kinds(&gait).contains(&"estimated") && kinds(&gait).contains(&"default"));
        for name in ["LegLength", "KneeWidth", "AnkleWidth"] {
            for side in ["L", "R"] {
                let name = format!("{side}{name}");
                let apart = gait.parameters.value(&name) - right.parameters.value(&name);
                worst.add(format!("{}, mm", &name[1..]), apart.abs());
            }
        }
        for (name, axis) in [("HipAngles", 1), ("KneeAngles", 0), ("KneeAngles", 1)] {
            let of = |gait: &GaitTrial| gait.curves[&format!("L{name}")].clone();
            let pairs = of(&gait).into_iter().zip(of(&right));
            let apart: Vec<f64> = pairs.map(|(a, b)| (a - b)[axis].powi(2)).collect();
            let seen: Vec<f64> = apart.into_iter().filter(|v| v.is_finite()).collect();
            let rms = (seen.iter().sum::<f64>() / seen.len() as f64).sqrt();
            worst.add(format!("{name} {axis} with estimates, degrees"), rms);
        }
    }
    worst.check(|name| match name {
        "LegLength, mm" => 45.0,
        name if name.ends_with("mm") => 30.0,
        _ => 4.0,
    });
}

/// Gaps made in a knee's marker, filled by lines: how often the true angle is within 1.96 sd.
#[test]
fn bands_hold_the_truth() {
    let Some(folder) = folder() else { return };
    let knee = MARKERS.iter().position(|m| *m == "LKNE").unwrap();
    let take = Take::open(&folder, "HC030A", "Straight");
    let names = take.file.take.points.iter();
    let whole: Vec<(&str, Vec<DVec3>)> = names.map(|n| (n.as_str(), take.stored(n))).collect();
    let right = GaitTrial::new(&take.trial, None, &GaitSettings::default()).unwrap();
    let length = 10;
    let fill = |track: &mut [DVec3], start: usize| {
        let (a, b) = (track[start - 1], track[start + length]);
        for k in 0..length {
            track[start + k] = a.lerp(b, (k + 1) as f64 / (length + 1) as f64);
        }
    };
    let track = take.trial.markers.get("LKNE").unwrap();
    let starts = (20..track.len() - 30).step_by(5);
    let starts: Vec<usize> = starts
        .filter(|s| track[s - 1..s + 11].iter().all(|p| p.is_finite()))
        .collect();
    // The sd of such a fill, by its place in the gap.
    let mut sd = vec![0.0; length];
    for &start in &starts {
        let mut filled = track.to_vec();
        fill(&mut filled, start);
        let apart = |k: usize| (filled[start + k] - track[start + k]).length_squared() / 3.0;
        (0..length).for_each(|k| sd[k] += apart(k) / starts.len() as f64);
    }
    let (mut inside, mut all) = (0, 0);
    for &start in &starts {
        let mut tracks = whole.clone();
        let own = tracks.iter_mut().find(|(n, _)| *n == "LKNE").unwrap();
        fill(&mut own.1, start);
        let mut trial = take.trial.clone();
        trial.markers = Markers::new(tracks).unwrap();
        let gait = GaitTrial::new(&trial, None, &GaitSettings::default()).unwrap();
        let mut deviations = Array2::zeros((trial.markers.frames(), MARKERS.len()));
        (0..length).for_each(|k| deviations[[start + k, knee]] = sd[k].sqrt());
        let bands = gait.deviations(&trial, &deviations).unwrap();
        for t in start..start + length {
            for axis in 0..3 {
                let apart = gait.curves["LKneeAngles"][t] - right.curves["LKneeAngles"][t];
                let band = 1.96 * bands["LKneeAngles"][t][axis];
                inside += usize::from(apart[axis].abs() <= band);
                all += usize::from(apart[axis].is_finite());
            }
        }
    }
    let share = inside as f64 / all as f64;
    println!("the 95% band of {} gaps holds {share:.3}", starts.len());
    assert!(share > 0.85);
}

/// Each person's walk against the norm of the five others.
#[test]
fn scores_are_those_of_healthy_children() {
    let Some(folder) = folder() else { return };
    let walks = PEOPLE.map(|person| {
        let take = Take::open(&folder, person, "Straight");
        let gait = GaitTrial::new(&take.trial, None, &GaitSettings::default()).unwrap();
        let of = |side: Side| {
            let own = gait.cycles.iter().filter(|(cycle, _)| cycle.side == side);
            own.map(|(cycle, _)| gait.nine_angles(&take.trial, cycle))
                .collect::<Vec<_>>()
        };
        Side::BOTH.map(of)
    });
    let mut overall = Vec::new();
    for (i, walk) in walks.iter().enumerate() {
        let others = walks.iter().enumerate().filter(|(k, _)| *k != i);
        let others: Vec<_> = others.flat_map(|(_, walk)| walk.concat()).collect();
        let norm = Norm::of_cycles(&others).unwrap();
        let sides = [&walk[0], &walk[1]].map(|cycles| Norm::of_cycles(cycles));
        if let [Some(left), Some(right)] = sides {
            let scores = [left, right].map(|own| norm.variable_scores(&own.mean));
            overall.push(ProfileScores::new(scores).overall);
        }
    }
    println!("GPS {overall:.2?}");
    assert!(overall.len() > 3 && overall.iter().all(|gps| (3.0..11.0).contains(gps)));
}

/// A file with bytes of its head and parameters exchanged gives a trial or an error.
#[test]
fn damaged_files_do_not_panic() {
    let Some(folder) = folder() else { return };
    let whole = std::fs::read(folder.join("HC030A_Straight.c3d")).unwrap();
    let (mut state, mut computed) = (1_u64, 0);
    let mut next = |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for _ in 0..200 {
        let mut bytes = whole.clone();
        for _ in 0..4 {
            bytes[next(8000)] = next(256) as u8;
        }
        let input = Input::new("walk.c3d", std::io::Cursor::new(bytes)).unwrap();
        let Ok(file) = C3d::read(input, true) else {
            continue;
        };
        let Ok(trial) = Trial::from_c3d(&file, Some(LengthUnit::Mm), Some(UpAxis::Z)) else {
            continue;
        };
        let gait = GaitTrial::new(&trial, Some(&trial), &GaitSettings::default());
        computed += usize::from(gait.is_ok());
    }
    assert!(computed > 100, "{computed}");
}

/// Ten trials of ten cycles a side are a page that a browser opens at once.
#[test]
fn a_session_s_page_shows_all_trials_and_stays_small() {
    let Some(folder) = folder() else { return };
    let statics = Take::open(&folder, PEOPLE[0], "Static").trial;
    let of = |kind: &str| {
        let trial = Take::open(&folder, PEOPLE[0], kind).trial;
        let gait = GaitTrial::new(&trial, Some(&statics), &GaitSettings::default()).unwrap();
        SessionTrial {
            name: format!("{} {kind}", PEOPLE[0]),
            file: format!("{}_{kind}.c3d", PEOPLE[0]),
            trial,
            gait,
            deviations: None,
        }
    };
    let walks = ["Straight", "Turn"].map(of);
    let mut session = Session::new(walks.to_vec(), Some("Static.c3d".into()), None).unwrap();
    session.norm = session.own_norm().map(|norm| ("norm.json".into(), norm));
    let page = session.page(&[]);
    let shown = [
        "Knee flexion",
        "Hip moment",
        "Ankle power",
        "norm.json",
        "HC030A Turn",
    ];
    assert!(shown.iter().all(|text| page.contains(text)) && !page.contains("NaN"));
    assert!(page.matches("<figure").count() == 27 && page.len() < 1_000_000);
    let many = |i: usize| {
        let mut own = walks[i % 2].clone();
        own.name = format!("walk {i}");
        own.gait.cycles = own.gait.cycles.iter().cycle().take(20).cloned().collect();
        own
    };
    session.trials = (0..10).map(many).collect();
    let page = session.page(&[]);
    assert!(page.contains("walk 9") && page.len() < 3_000_000);
    let player = walks[0].player(Some("index.html")).unwrap().unwrap();
    assert!(player.contains("HC030A Straight") && player.contains("#frame="));
}
