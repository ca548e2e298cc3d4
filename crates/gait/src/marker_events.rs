//! Strikes and offs of feet from markers alone.
//!
//! A strike is near where the heel's speed falls through .15 √(g L), an off near where the toe's
//! rises through .30 √(g L), L the leg's length. Both are then moved toward other signs of the
//! same event, with weights that were fitted to force plates.

use crate::markers::Markers;
use crate::numeric::butterworth::LowPass;
use crate::peaks::{crossings, peaks, slope};
use crate::side::Side;
use glam::DVec3;

/// mm/s².
const GRAVITY: f64 = 9810.0;
/// The low-pass filters of feet, and of what is compared with the pelvis, Hz.
const FAST: f64 = 15.0;
const SLOW: f64 = 7.0;
/// Two events of one foot are further apart, seconds: of two kinds, and of one kind.
const SHORTEST: f64 = 0.12;
const NEXT_OF_KIND: f64 = 0.4;
/// Beyond the markers of foot and pelvis there are no events.
const SPAN: [&str; 3] = ["HEE", "TOE", "ANK"];

/// Strikes (`true`) and offs of a foot in time, frames; none at rates that are too low to filter.
pub(crate) fn events(markers: &Markers, side: Side, leg: f64, rate: f64) -> Vec<(f64, bool)> {
    let own = |name: &str| format!("{}{name}", side.letter());
    let tracks = ["LASI", "RASI"]
        .map(String::from)
        .into_iter()
        .chain(SPAN.map(own));
    let seen = |t: usize, name: &String| markers.get(name).is_some_and(|m| m[t].is_finite());
    let names: Vec<String> = tracks.collect();
    let whole = |t: &usize| names.iter().all(|name| seen(*t, name));
    let first = (0..markers.frames()).find(whole);
    let (Some(first), Some(last)) = (first, (0..markers.frames()).rev().find(whole)) else {
        return Vec::new();
    };
    let Some(signs) = Signs::of(markers, side, leg, rate) else {
        return Vec::new();
    };
    let mut events = signs.events(rate);
    events.retain(|(t, _)| (first as f64..=last as f64).contains(t));
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut k = 0;
    while k + 1 < events.len() {
        let apart = (events[k + 1].0 - events[k].0) / rate;
        let is_same = events[k].1 == events[k + 1].1;
        if is_same && apart < NEXT_OF_KIND {
            events.remove(k + 1);
        } else if !is_same && apart < SHORTEST {
            events.drain(k..k + 2);
            k = k.saturating_sub(1);
        } else {
            k += 1;
        }
    }
    events
}

/// A track without what is faster than a cutoff of each of two runs; gaps are filled by lines.
fn smooth(markers: &Markers, name: &str, cutoff: f64, rate: f64) -> Option<Vec<DVec3>> {
    // The coefficients are for runs that each have their cutoff there, not both together.
    let pi = std::f64::consts::PI;
    let both = ((2f64.sqrt() - 1.0).powf(0.25) * (pi * cutoff / rate).tan()).atan() * rate / pi;
    let filter = LowPass::new(both, rate)?;
    let mut track = markers.filled(name);
    for axis in 0..3 {
        let mut values: Vec<f64> = track.iter().map(|p| p[axis]).collect();
        filter.apply(&mut values);
        track.iter_mut().zip(values).for_each(|(p, v)| p[axis] = v);
    }
    Some(track)
}

/// The velocity of a track, mm/s.
fn velocity(track: &[DVec3], rate: f64) -> Vec<DVec3> {
    let axes = [0, 1, 2].map(|axis| {
        let values: Vec<f64> = track.iter().map(|p| p[axis]).collect();
        slope(&values, rate)
    });
    (0..track.len())
        .map(|t| DVec3::new(axes[0][t], axes[1][t], axes[2][t]))
        .collect()
}

/// Signs of events, frames.
struct Signs {
    heel_slow: Vec<f64>,
    toe_down: Vec<f64>,
    ankle_slow: Vec<f64>,
    heel_brakes: Vec<f64>,
    toe_fast: Vec<f64>,
    toe_behind: Vec<f64>,
    toe_speeds_up: Vec<f64>,
}

impl Signs {
    fn of(markers: &Markers, side: Side, leg: f64, rate: f64) -> Option<Signs> {
        let own = |name: &str, cutoff: f64| {
            smooth(markers, &format!("{}{name}", side.letter()), cutoff, rate)
        };
        let [heel, toe, ankle] = [own("HEE", FAST)?, own("TOE", FAST)?, own("ANK", FAST)?]
            .map(|track| velocity(&track, rate));
        let speed = |v: &[DVec3]| v.iter().map(|v| v.length()).collect::<Vec<f64>>();
        let [heel, toe_speed, ankle] = [&heel, &toe, &ankle].map(|v| speed(v));
        let unit = (GRAVITY * leg).sqrt();
        let down: Vec<f64> = toe.iter().map(|v| -v.z).collect();
        let braking: Vec<f64> = slope(&heel, rate).iter().map(|v| -v).collect();
        let behind = behind(markers, &own("TOE", SLOW)?, rate)?;
        Some(Signs {
            heel_slow: crossings(&heel, 0.15 * unit, false),
            toe_down: peaks(&down, 0.05 * unit),
            ankle_slow: crossings(&ankle, 0.3 * unit, false),
            heel_brakes: peaks(&braking, 2000.0),
            toe_fast: crossings(&toe_speed, 0.3 * unit, true),
            toe_behind: peaks(&behind, 60.0),
            toe_speeds_up: peaks(&slope(&toe_speed, rate), 2000.0),
        })
    }

    /// Strikes and offs, frames.
    fn events(&self, rate: f64) -> Vec<(f64, bool)> {
        let strike = |t: &f64| {
            let signs = [
                (&self.toe_down, 0.12, 0.455),
                (&self.ankle_slow, 0.12, -0.27),
                (&self.heel_brakes, 0.15, 0.127),
            ];
            (t + moved(*t, &signs, [0.0077, 0.0078], rate), true)
        };
        let off = |t: &f64| {
            let signs = [
                (&self.toe_behind, 0.15, 0.585),
                (&self.toe_speeds_up, 0.12, 0.415),
            ];
            (t + moved(*t, &signs, [-0.0156, 0.0118], rate), false)
        };
        let strikes = self.heel_slow.iter().map(strike);
        strikes.chain(self.toe_fast.iter().map(off)).collect()
    }
}

/// By how many frames an event at `t` moves: the weighted distances of its other signs, each with
/// how far it may be (seconds) and its weight, and the first of `constants` (seconds); the second
/// alone where a sign lacks.
fn moved(t: f64, signs: &[(&Vec<f64>, f64, f64)], constants: [f64; 2], rate: f64) -> f64 {
    let weighted = signs.iter().map(|(times, reach, weight)| {
        let distances = times.iter().map(|other| other - t);
        let nearest = distances.min_by(|a, b| a.abs().total_cmp(&b.abs()));
        nearest
            .filter(|d| d.abs() < reach * rate)
            .map(|d| weight * d)
    });
    match weighted.sum::<Option<f64>>() {
        Some(sum) => sum + constants[0] * rate,
        None => constants[1] * rate,
    }
}

/// How far the toe is behind the middle of the pelvis along its facing, mm.
fn behind(markers: &Markers, toe: &[DVec3], rate: f64) -> Option<Vec<f64>> {
    let of = |name: &str| smooth(markers, name, SLOW, rate);
    let sacrum = if markers.get("SACR").is_some() {
        of("SACR")?
    } else {
        let pair = of("LPSI")?.into_iter().zip(of("RPSI")?);
        pair.map(|(left, right)| (left + right) / 2.0).collect()
    };
    let (left, right) = (of("LASI")?, of("RASI")?);
    let at = |t: usize| {
        let front = (left[t] + right[t]) / 2.0;
        let facing = (front - sacrum[t]).with_z(0.0).normalize();
        ((front + sacrum[t]) / 2.0 - toe[t]).dot(facing)
    };
    Some((0..toe.len()).map(at).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_moves_by_its_other_signs() {
        let (near, far) = (vec![3.0, 52.0], vec![80.0]);
        assert!((moved(50.0, &[(&near, 0.1, 0.5)], [0.01, 0.02], 100.0) - 2.0).abs() < 1e-12);
        let both = [(&near, 0.1, 0.5), (&far, 0.1, 0.5)];
        assert!((moved(50.0, &both, [0.01, 0.02], 100.0) - 2.0).abs() < 1e-12);
        assert!((moved(50.0, &[(&far, 0.1, 1.0)], [0.01, 0.03], 100.0) - 3.0).abs() < 1e-12);
    }
}
