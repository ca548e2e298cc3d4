//! The curves of a session over the gait cycle, for its page: which charts there are, how they are
//! called, and what is drawn in each.

use super::chart::{Chart, SideCurve, SingleCycle};
use crate::angles::Direction;
use crate::axes::wrapped;
use crate::curves::is_angle;
use crate::cycles::mean_and_sd;
use crate::norm::GVS;
use crate::session::{Series, Session};
use crate::side::Side;
use glam::DVec3;

/// The charts of the lower body in rows of three: curve, its number, title.
const LOWER: &str = "\
PelvisAngles 0 Pelvic tilt: anterior (+) / posterior
PelvisAngles 1 Pelvic obliquity: side up (+) / down
PelvisAngles 2 Pelvic rotation: internal (+) / external
HipAngles 0 Hip flexion (+) / extension
HipAngles 1 Hip adduction (+) / abduction
HipAngles 2 Hip rotation: internal (+) / external
KneeAngles 0 Knee flexion (+) / extension
KneeAngles 1 Knee varus (+) / valgus
KneeAngles 2 Knee rotation: internal (+) / external
AnkleAngles 0 Ankle dorsiflexion (+) / plantarflexion
AnkleAngles 2 Ankle rotation: internal (+) / external
FootProgressAngles 2 Foot progression: internal (+) / external";

/// Moments are the muscles' own, which answer what acts from outside.
const KINETICS: &str = "\
HipMoment 0 Hip moment: extensor (+) / flexor
HipMoment 1 Hip moment: abductor (+) / adductor
HipMoment 2 Hip moment: external (+) / internal rotator
KneeMoment 0 Knee moment: extensor (+) / flexor
KneeMoment 1 Knee moment: valgus (+) / varus
KneeMoment 2 Knee moment: external (+) / internal rotator
AnkleMoment 0 Ankle moment: plantarflexor (+) / dorsiflexor
AnkleMoment 1 Ankle moment: evertor (+) / invertor
AnkleMoment 2 Ankle moment: external (+) / internal rotator
HipPower 2 Hip power: generated (+) / absorbed
KneePower 2 Knee power: generated (+) / absorbed
AnklePower 2 Ankle power: generated (+) / absorbed
GroundReactionForce 0 Ground reaction: forward (+) / backward
GroundReactionForce 1 Ground reaction: medial (+) / lateral
GroundReactionForce 2 Ground reaction: up";

/// The wrist turns with the forearm, which has no axis of its own: its angles have no plain names.
/// An empty line leaves a place free.
const UPPER: &str = "\
ThoraxAngles 0 Thorax tilt: forward (+) / backward
ThoraxAngles 1 Thorax tilt: to the other side (+) / own side
ThoraxAngles 2 Thorax rotation: to the other side (+) / own side
HeadAngles 0 Head tilt: backward (+) / forward
HeadAngles 1 Head tilt: to the other side (+) / own side
HeadAngles 2 Head rotation: to the other side (+) / own side
SpineAngles 0 Spine flexion (+) / extension
SpineAngles 1 Spine tilt: to the own side (+) / other side
SpineAngles 2 Spine rotation: to the own side (+) / other side
NeckAngles 0 Neck flexion (+) / extension
NeckAngles 1 Neck tilt: to the own side (+) / other side
NeckAngles 2 Neck rotation: to the own side (+) / other side
ShoulderAngles 0 Shoulder flexion (+) / extension
ShoulderAngles 1 Shoulder abduction (+) / adduction
ShoulderAngles 2 Shoulder rotation: internal (+) / external
ElbowAngles 0 Elbow flexion (+) / extension


WristAngles 0 Wrist: Plug-in Gait's x
WristAngles 1 Wrist: Plug-in Gait's y
WristAngles 2 Wrist: Plug-in Gait's z";

/// Unit, the factor from the curve's own, and the least span of an axis.
fn unit(curve: &str) -> (&'static str, f64, f64) {
    match curve {
        name if is_angle(name) => ("degrees", 1.0, 20.0),
        name if name.ends_with("Moment") => ("N m/kg", 1e-3, 0.4),
        name if name.ends_with("Power") => ("W/kg", 1.0, 1.0),
        _ => ("N/kg", 1.0, 2.0),
    }
}

/// Forces of the laboratory's axes as forward, toward the middle of the body, up.
fn of_walk(direction: Direction, side: Side) -> impl Fn(DVec3) -> DVec3 {
    let axes = direction.axes().transpose();
    move |force| axes * force * DVec3::new(1.0, -side.sign(), 1.0)
}

/// Moves each value by whole turns to the one before it.
fn unwound(mut values: Vec<f64>) -> Vec<f64> {
    for i in 1..values.len() {
        let step = values[i] - values[i - 1];
        if step.is_finite() {
            values[i] = values[i - 1] + wrapped(step);
        }
    }
    values
}

/// Values by whole turns near to others.
fn near(values: &[f64], others: &[f64]) -> Vec<f64> {
    let pairs = values.iter().zip(others);
    pairs.map(|(v, other)| other + wrapped(v - other)).collect()
}

/// The curves of all trials.
struct Walks<'a> {
    session: &'a Session,
    /// The curves of each trial and side.
    series: Vec<[Vec<Series>; 2]>,
    foot_off: [Option<f64>; 2],
}

impl<'a> Walks<'a> {
    fn new(session: &'a Session) -> Walks<'a> {
        let trials = session.trials.iter();
        let off = |side: Side| session.values(side).get("foot_off_percent").map(|v| v.mean);
        Walks {
            session,
            series: trials
                .map(|t| Side::BOTH.map(|side| t.series(side)))
                .collect(),
            foot_off: Side::BOTH.map(off),
        }
    }

    /// A side's cycles of a number of a curve, in the charts' unit.
    fn side(&self, side: Side, curve: &str, axis: usize) -> SideCurve {
        let (mut all, mut single) = (Vec::new(), Vec::new());
        let (_, scale, _) = unit(curve);
        let of_axis = |v: &[DVec3]| v.iter().map(|v| scale * v[axis]).collect::<Vec<f64>>();
        for (trial, series) in self.session.trials.iter().zip(&self.series) {
            let Some(own) = series[side as usize].iter().find(|s| s.name == curve) else {
                continue;
            };
            let of_walk = of_walk(trial.gait.direction, side);
            for cycle in trial.cycles(side) {
                let mut values = trial.resampled(own, cycle);
                if curve == "GroundReactionForce" {
                    values.iter_mut().for_each(|v| *v = of_walk(*v));
                }
                let sd = own.sd.as_ref().map(|sd| {
                    let [from, to] = [cycle.start_s, cycle.end_s].map(|t| trial.trial.place(t));
                    of_axis(&crate::cycles::resampled(sd, from, to, false))
                });
                if values.iter().any(|v| v[axis].is_finite()) {
                    let name = format!("{}, cycle {}", trial.name, cycle.cycle);
                    single.push(SingleCycle {
                        name,
                        values: of_axis(&values),
                        sd,
                    });
                    all.push(values);
                }
            }
        }
        let [mut mean, sd] = mean_and_sd(&all, is_angle(curve)).map(|v| of_axis(&v));
        if is_angle(curve) {
            mean = unwound(mean);
            single
                .iter_mut()
                .for_each(|c| c.values = near(&c.values, &mean));
        }
        SideCurve {
            cycles: single,
            mean,
            sd,
            foot_off: self.foot_off[side as usize],
        }
    }

    /// The charts of a list that have values, as figures.
    fn charts(&self, list: &str) -> String {
        let chart = |(i, line): (usize, &str)| {
            let (curve, rest) = line.split_once(' ')?;
            let (axis, title) = rest.split_once(' ')?;
            let axis: usize = axis.parse().ok()?;
            let (unit, _, least) = unit(curve);
            let gvs = GVS
                .iter()
                .position(|(_, name, k)| (*name, *k) == (curve, axis));
            let norm = self.session.norm.as_ref().zip(gvs);
            let chart = Chart {
                title,
                unit,
                least,
                sides: Side::BOTH.map(|side| self.side(side, curve, axis)),
                norm: norm.map(|((_, norm), k)| [&norm.mean[k][..], &norm.sd[k]]),
            };
            chart.figure(i % 3)
        };
        list.lines().enumerate().filter_map(chart).collect()
    }
}

const LINE: &str = "M0 6H30";
const AREA: &str = "M0 1H30V11H0Z";
/// What is drawn: its classes, a sample of it, what it means.
const LEGEND: [(&str, &str, &str); 8] = [
    ("mean l", LINE, "left, mean of all cycles"),
    ("mean r", LINE, "right, mean of all cycles"),
    ("sd l|sd r", AREA, "mean \u{b1} standard deviation"),
    ("one l|one r", LINE, "single cycles, of a side with 2 to 10"),
    ("norm", AREA, "norm, mean \u{b1} standard deviation"),
    (
        "doubt l|doubt r",
        AREA,
        "95 % band of a cycle where markers were filled or doubted",
    ),
    ("off l", "M15 0V12", "left foot off"),
    ("off r", "M15 0V12", "right foot off"),
];

/// What lines and areas mean, of those that are in some charts.
fn legend(charts: &str) -> String {
    let sample = |(classes, path, text): &(&str, &str, &str)| {
        let classes = || classes.split('|').map(|class| format!("class=\"{class}\""));
        let drawn: String = classes()
            .map(|c| format!("<path {c} d=\"{path}\"/>"))
            .collect();
        let svg = format!("<svg viewBox=\"0 0 30 12\" aria-hidden=\"true\">{drawn}</svg>");
        let is_there = classes().any(|class| charts.contains(&class));
        is_there.then(|| format!("<span>{svg}{text}</span>"))
    };
    let samples: String = LEGEND.iter().filter_map(sample).collect();
    format!("<p class=\"legend\">{samples}</p>")
}

/// The curves as a section of the page; empty without cycles.
pub(crate) fn section(session: &Session) -> String {
    let walks = Walks::new(session);
    let [lower, kinetics, upper] = [LOWER, KINETICS, UPPER].map(|list| walks.charts(list));
    let all = [&*lower, &kinetics, &upper].concat();
    if all.is_empty() {
        return String::new();
    }
    let part = |title: &str, note: &str, charts: &str| match charts {
        "" => String::new(),
        charts => format!("<h3>{title}</h3>{note}<div class=\"curves\">{charts}</div>"),
    };
    let upper = match &upper[..] {
        "" => String::new(),
        charts => format!(
            "<details><summary>Upper body: thorax, head, spine, neck, arms</summary><div \
             class=\"curves\">{charts}</div></details>"
        ),
    };
    let [left, right] = Side::BOTH.map(|side| walks.side(side, "HipMoment", 0).whole());
    let note = format!(
        "<p>Moments are those of the muscles. Where a foot is on the floor beside the plates \
         nothing is known: whole cycles left {left}, right {right}.</p>"
    );
    format!(
        "<section id=\"curves\"><h2>Curves over the gait cycle</h2><p>From a foot's strike (0 %) \
         to its next (100 %), of all trials.</p>{}{}{}{upper}</section>\n",
        legend(&all),
        part("Angles", "", &lower),
        part("Moments, powers and ground reaction", &note, &kinetics)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_go_around_and_forces_are_those_of_the_walk() {
        assert_eq!(unwound(vec![170.0, -175.0, -160.0]), [170.0, 185.0, 200.0]);
        assert_eq!(near(&[-175.0, f64::NAN], &[185.0, 1.0])[..1], [185.0]);
        let (forward, standing) = (-DVec3::Y, false);
        let direction = Direction { forward, standing };
        // Who walks to -y has the left at +x.
        let force = |side| of_walk(direction, side)(DVec3::new(1.0, -2.0, 9.0));
        assert_eq!(force(Side::Left), DVec3::new(2.0, -1.0, 9.0));
        assert_eq!(force(Side::Right), DVec3::new(2.0, 1.0, 9.0));
    }
}
