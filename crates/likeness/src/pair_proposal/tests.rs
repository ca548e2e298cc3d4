use super::*;
use crate::joint_map::joint;
use crate::testdata::{own_names, standing, take_of};
use glam::DVec3;

/// A person who lifts both hands by `lift(t)` cm at time t, `frames` at 10 a second.
fn lifting(frames: usize, lift: impl Fn(f64) -> f64) -> BodyFramePoses {
    let pose = |t: usize| {
        let mut pose = standing();
        for hand in [joint::LHAND, joint::RHAND] {
            pose[hand] += DVec3::Y * lift(t as f64 / 10.0);
        }
        pose
    };
    let poses: Vec<_> = (0..frames).map(pose).collect();
    BodyFramePoses::new(&take_of(&poses), Some(10.0), &own_names()).unwrap()
}

fn names(count: usize) -> Vec<String> {
    (0..count).map(|i| format!("take{i}")).collect()
}

/// Four takes of waving, each of another pace.
fn waves() -> Vec<BodyFramePoses> {
    let wave = |i: usize| lifting(80 + 40 * i, move |t| 60.0 * ((1.0 + i as f64) * t).sin());
    (0..4).map(wave).collect()
}

#[test]
fn pairs_obey_the_rules() {
    let takes = waves();
    let rules = PairRules::default();
    let proposal = propose(&takes, &names(4), &rules).unwrap();
    assert_eq!(proposal.pairs.len(), 100);
    assert!(proposal.candidates > 1000);
    let time = |at: TakeFrame| at.frame as f64 / 10.0;
    for (i, pair) in proposal.pairs.iter().enumerate() {
        let (a, b) = (pair.a, pair.b);
        assert!(a.take < b.take || a.take == b.take && time(b) - time(a) >= APART);
        for at in [a, b] {
            assert!((5..takes[at.take].frames() - 5).contains(&at.frame));
        }
        let poses = [a, b].map(|at| takes[at.take].frame(at.frame));
        let lengths = (0..16).map(|k| (poses[0][k] - poses[1][k]).length());
        let mean = lengths.sum::<f64>() / 16.0 * proposal.height;
        assert!((mean - pair.distance).abs() < 1e-9 && mean < 10.0);
        for other in &proposal.pairs[..i] {
            let close = |s, t| (time(s) - time(t)).abs() <= NEAR_COPY;
            let same = (a.take, b.take) == (other.a.take, other.b.take);
            assert!(!(same && close(a, other.a) && close(b, other.b)));
        }
    }
}

#[test]
fn pairs_are_spread_over_takes_and_distances() {
    let rules = PairRules {
        count: 60,
        ..PairRules::default()
    };
    let pairs = propose(&waves(), &names(4), &rules).unwrap().pairs;
    let uses = |take: usize| {
        let sides = pairs.iter().flat_map(|p| [p.a.take, p.b.take]);
        sides.filter(|t| *t == take).count()
    };
    assert!((0..4).all(|take| uses(take) >= 20), "the mean is 30");
    // The hands alone move, up to 2 x 60 cm, so all distances up to 10 cm (2/16 of 80 cm) occur.
    let lower = pairs.iter().filter(|p| p.distance < 5.0).count();
    assert!((20..=40).contains(&lower), "{lower}");
}

#[test]
fn the_seed_alone_decides() {
    let propose_seed = |seed| {
        let rules = PairRules {
            count: 20,
            seed,
            ..PairRules::default()
        };
        propose(&waves(), &names(4), &rules).unwrap()
    };
    assert_eq!(propose_seed(1), propose_seed(1));
    assert_ne!(propose_seed(1).pairs, propose_seed(2).pairs);
    let alone = crate::numeric::parallel::single_threaded(|| propose_seed(1));
    assert_eq!(alone, propose_seed(1));
}

#[test]
fn only_other_takes_on_request() {
    let rules = PairRules {
        other_takes: true,
        ..PairRules::default()
    };
    let pairs = propose(&waves(), &names(4), &rules).unwrap().pairs;
    assert!(pairs.iter().all(|p| p.a.take != p.b.take));
}

#[test]
fn missing_joints_and_short_runs_are_left_out() {
    let mut takes = waves();
    takes.truncate(2);
    takes[0].joints[[30, joint::HEAD, 1]] = f64::NAN;
    takes[1].runs = vec![0..9, 9..takes[1].frames()];
    let all = PairRules {
        count: 2000,
        ..PairRules::default()
    };
    for pair in propose(&takes, &names(2), &all).unwrap().pairs {
        for at in [pair.a, pair.b] {
            assert!(at.take != 0 || at.frame != 30);
            assert!(at.take != 1 || at.frame >= 14);
        }
    }
}

#[test]
fn each_failure_has_its_phrase() {
    let fails = |takes: &[BodyFramePoses], names: &[String], rules: PairRules, part: &str| {
        let said = propose(takes, names, &rules).unwrap_err().to_string();
        assert!(said.contains(part), "{said}");
    };
    let (takes, usual) = (waves(), PairRules::default);
    let with = |change: fn(&mut PairRules)| {
        let mut rules = usual();
        change(&mut rules);
        rules
    };
    for (rules, part) in [
        (
            with(|r| r.count = 0),
            "the option `count 0`: expected 1 to 2000",
        ),
        (with(|r| r.count = 2001), "the option `count 2001`"),
        (with(|r| r.near = f64::NAN), "the option `near NaN`"),
        (with(|r| r.near = 0.0), "the option `near 0`"),
        (with(|r| r.margin = 6.0), "the option `seconds 6`"),
        (
            with(|r| r.margin = f64::INFINITY),
            "the option `seconds inf`",
        ),
    ] {
        fails(&takes, &names(4), rules, part);
    }
    fails(&[], &[], usual(), "no frames");
    let twice = vec!["walk".to_string(); 4];
    fails(&takes, &twice, usual(), "two takes are named \"walk\"");
    let alone = with(|r| r.other_takes = true);
    fails(
        &takes[..1],
        &names(1),
        alone,
        "the option `other_takes` needs two",
    );
    let short = |frames| [lifting(frames, |t| t)];
    fails(&short(9), &names(1), usual(), "lasts 0.80 s");
    fails(&short(15), &names(1), usual(), "one take of 1.40 s");
    let still = [lifting(80, |_| 0.0)];
    // One pose throughout: all pairs are copies.
    fails(&still, &names(1), usual(), "no two poses");
    let mut untimed = waves();
    untimed[2].rate = None;
    fails(&untimed, &names(4), usual(), "the option `fps`");
    let mut gaps = [lifting(80, |t| t)];
    gaps[0].joints.fill(f64::NAN);
    fails(&gaps, &names(1), usual(), "all 16 joints");
}
