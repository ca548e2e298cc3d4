//! A session for programs: gait.json.

use crate::events::Event;
use crate::norm::GVS;
use crate::session::{Session, SessionTrial, Spread, axes};
use crate::side::Side;
use crate::trial::FilledGap;
use crate::values::range;
use serde_json::{Map, Value, json};

impl Session {
    /// The session as posing-json(5) has it.
    pub fn report(&self) -> Value {
        let trials: Vec<Value> = self.trials.iter().map(trial).collect();
        let failed = self.failed.iter();
        let failed = failed.map(|(file, error)| json!({ "file": file, "error": error }));
        let failed: Vec<Value> = failed.collect();
        json!({
            "model": "Plug-in Gait",
            "static": self.static_file,
            "trials": trials,
            "summary": {
                "left": self.side_summary(Side::Left),
                "right": self.side_summary(Side::Right),
                "symmetry_percent": numbers(self.symmetry().into_iter()),
            },
            "scores": self.scores_value(),
            "failed": failed,
        })
    }

    fn side_summary(&self, side: Side) -> Value {
        let values = self.values(side).into_iter();
        let spread = |s: Spread| json!({ "mean": number(s.mean), "sd": number(s.sd) });
        let mut all: Map<String, Value> = values.map(|(n, s)| (n.into(), spread(s))).collect();
        all.insert("cycles".into(), self.cycles(side).into());
        all.into()
    }

    fn scores_value(&self) -> Value {
        let Some((file, (scores, profile))) =
            self.norm.as_ref().map(|(file, _)| file).zip(self.scores())
        else {
            return Value::Null;
        };
        let nine = |side: Side| {
            numbers(
                GVS.map(|(name, ..)| name)
                    .into_iter()
                    .zip(scores[side as usize]),
            )
        };
        json!({
            "norm": file,
            "gvs_deg": { "left": nine(Side::Left), "right": nine(Side::Right) },
            "gps_deg": {
                "left": number(profile.left),
                "right": number(profile.right),
                "overall": number(profile.overall),
            },
        })
    }
}

fn trial(own: &SessionTrial) -> Value {
    let gait = &own.gait;
    let parameter = |(name, p): (&String, &crate::Parameter)| {
        let value = json!({
            "value": number(p.value),
            "unit": p.unit,
            "source": p.source,
            "sd": p.sd.map(number),
        });
        (name.clone(), value)
    };
    let parameters: Map<String, Value> = gait.parameters.0.iter().map(parameter).collect();
    json!({
        "name": own.name,
        "file": own.file,
        "model": gait.model,
        "rate_hz": own.trial.rate,
        "frames": own.trial.markers.frames(),
        "first_frame": own.trial.first_frame,
        "direction": gait.direction.name(),
        "standing": gait.direction.standing,
        "parameters": parameters,
        "gaps": gaps(own),
        "events": gait.events.iter().map(event).collect::<Vec<_>>(),
        "cycles": cycles(own),
        "findings": gait.findings,
    })
}

fn gaps(own: &SessionTrial) -> Vec<Value> {
    let of = |gap: &FilledGap| {
        let sd = gap.sd_mm.map(number);
        json!({ "marker": gap.marker, "frames": gap.frames, "sd_mm": sd })
    };
    own.trial.gaps.iter().map(of).collect()
}

fn event(event: &Event) -> Value {
    json!({
        "time_s": number(event.time_s),
        "side": event.side,
        "kind": event.kind,
        "source": event.source,
        "sd_ms": event.sd_ms,
        "plate": event.plate,
        "file_time_s": event.file_time_s.map(number),
    })
}

/// The cycles with their values and the ranges of angles in them.
fn cycles(own: &SessionTrial) -> Vec<Value> {
    let series = Side::BOTH.map(|side| own.series(side));
    let of = |(cycle, values): &(crate::Cycle, crate::CycleValues)| {
        let mut all = Map::new();
        all.insert("side".into(), json!(cycle.side));
        all.insert("cycle".into(), cycle.cycle.into());
        all.insert("start_s".into(), number(cycle.start_s));
        all.insert("end_s".into(), number(cycle.end_s));
        all.extend(
            values
                .iter()
                .map(|(name, value)| (name.to_string(), number(*value))),
        );
        let angles = series[cycle.side as usize]
            .iter()
            .filter(|s| crate::is_angle(s.name));
        let ranges = angles.flat_map(|series| {
            let range = range(&own.resampled(series, cycle));
            let of =
                move |(axis, i): &(&str, usize)| (format!("{}.{axis}", series.name), range[*i]);
            axes(series.name).iter().map(of)
        });
        all.insert("range_of_motion_deg".into(), numbers(ranges));
        Value::from(all)
    };
    own.gait.cycles.iter().map(of).collect()
}

fn numbers(values: impl Iterator<Item = (impl Into<String>, f64)>) -> Value {
    let all: Map<String, Value> = values.map(|(name, v)| (name.into(), number(v))).collect();
    all.into()
}

/// A number to six decimals; null where it is not known.
fn number(value: f64) -> Value {
    json!(Some((1e6 * value).round() / 1e6).filter(|v| v.is_finite()))
}
