//! The contacts of feet with force plates, and what acts on a foot in a frame.

use crate::markers::Markers;
use crate::plate::Plate;
use crate::side::Side;
use glam::DVec3;

/// A foot is on a plate from where the vertical force rises through this to where it falls, N.
const ON: f64 = 20.0;
/// A contact lasts longer, seconds, and its largest force is above this, N.
const SHORTEST: f64 = 0.15;
const LEAST_PEAK: f64 = 80.0;
/// A longer one is of two feet, seconds.
const LONGEST: f64 = 1.0;
/// A foot further from the center of pressure is not on the plate, millimeters.
const FARTHEST: f64 = 400.0;
/// A person's feet push with less, N.
const HEAVIEST: f64 = 20_000.0;
/// Vicon shows the forces of frames whose mean is above this, N (it lies between 3.9 and 4.7).
const SHOWN: f64 = 4.3;

impl Plate {
    /// Force and moment in a frame: the mean of the samples up to half a frame before and after
    /// it. Beyond the ends the outermost sample counts again.
    fn at_frame(&self, frame: usize) -> [DVec3; 2] {
        let half = self.per_frame / 2;
        let (last, count) = (self.force.len() - 1, (2 * half + 1) as f64);
        let around = frame * self.per_frame..=frame * self.per_frame + 2 * half;
        let around = around.map(|i| i.saturating_sub(half).min(last));
        around.fold([DVec3::ZERO; 2], |[f, m], i| {
            [f + self.force[i] / count, m + self.moment[i] / count]
        })
    }

    /// The samples after which the force rises through [`ON`], and after which it falls.
    fn loads(&self) -> Vec<[usize; 2]> {
        let is_on = |i: usize| self.force[i].z.abs() > ON;
        let steps = (1..self.force.len()).filter(|&i| is_on(i) != is_on(i - 1));
        let steps: Vec<usize> = steps.map(|i| i - 1).collect();
        let first = usize::from(!self.force.is_empty() && is_on(0));
        let pairs = steps.get(first..).unwrap_or_default().chunks_exact(2);
        pairs.map(|pair| [pair[0], pair[1]]).collect()
    }

    /// Why its forces cannot be those of feet; `None` of a sound one.
    /// Somebody who stands may load it all the time.
    pub(crate) fn fault(&self, stands: bool) -> Option<&'static str> {
        let up = self.force.iter().map(|f| f.z);
        if up.clone().any(|f| !f.is_finite() || f.abs() > HEAVIEST) {
            return Some("it has samples that are no forces of a person");
        }
        if !stands && !self.force.is_empty() && up.into_iter().all(|f| f.abs() > ON) {
            return Some("it is never free of load: it was not zeroed, and tells nothing");
        }
        (self.presses_from_below(DVec3::Z))
            .then_some("its forces point into the floor: their sign is the other way")
    }

    /// Whether its forces on the foot point against `up`, into the floor.
    pub(crate) fn presses_from_below(&self, up: DVec3) -> bool {
        let all = self.force.iter().map(|f| f.dot(up));
        all.filter(|f| f.abs() > LEAST_PEAK).sum::<f64>() < 0.0
    }

    /// The time at which the force is [`ON`] after a sample, in samples: on the line to the next.
    fn crossing(&self, sample: usize) -> f64 {
        let [now, next] = [sample, sample + 1].map(|i| self.force[i].z.abs());
        sample as f64 + (ON - now) / (next - now)
    }
}

/// A foot, or two, on a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Whose foot is nearer to the center of pressure.
    pub side: Side,
    /// The plate, counted from 1.
    pub plate: usize,
    /// When it begins, seconds from the trial's first frame.
    pub on: f64,
    /// When it ends.
    pub off: f64,
    /// Whether it lasts so long that both feet must have been on the plate, so that it tells
    /// nothing of either.
    pub of_two: bool,
}

/// The contacts of feet with plates, in time. `rate` is that of the markers.
pub(crate) fn contacts(plates: &[Option<Plate>], markers: &Markers, rate: f64) -> Vec<Contact> {
    let all = loads(plates, markers, rate).into_iter();
    all.filter(|(_, away)| away.is_none())
        .map(|(contact, _)| contact)
        .collect()
}

/// The loads of plates in time, as contacts of the foot that is nearer, and how far it is away from
/// the center of pressure, mm, where that is too far for a contact. Loads while neither foot is
/// seen are left out.
pub(crate) fn loads(
    plates: &[Option<Plate>],
    markers: &Markers,
    rate: f64,
) -> Vec<(Contact, Option<f64>)> {
    let feet = Side::BOTH.map(|side| {
        let [heel, toe] = ["HEE", "TOE"].map(|m| markers.filled(&format!("{}{m}", side.letter())));
        heel.into_iter()
            .zip(toe)
            .map(|(heel, toe)| (heel + toe) / 2.0)
            .collect::<Vec<_>>()
    });
    let mut found = Vec::new();
    for (p, plate) in plates.iter().enumerate() {
        let Some(plate) = plate else { continue };
        let sample_rate = rate * plate.per_frame as f64;
        for [i, e] in plate.loads() {
            let peak = (i..e).map(|s| plate.force[s].z.abs()).fold(0.0, f64::max);
            if ((e - i) as f64) < SHORTEST * sample_rate || peak < LEAST_PEAK {
                continue;
            }
            let away = Side::BOTH.map(|side| distance(plate, &feet[side as usize], i + 1..e));
            let seen = Side::BOTH
                .into_iter()
                .filter(|s| away[*s as usize].is_finite());
            let Some(side) = seen.min_by(|a, b| away[*a as usize].total_cmp(&away[*b as usize]))
            else {
                continue;
            };
            let [on, off] = [i, e].map(|s| plate.crossing(s) / sample_rate);
            let contact = Contact {
                side,
                plate: p + 1,
                on,
                off,
                of_two: off - on > LONGEST,
            };
            found.push((
                contact,
                Some(away[side as usize]).filter(|away| *away >= FARTHEST),
            ));
        }
    }
    found.sort_by(|(a, _), (b, _)| a.on.total_cmp(&b.on));
    found
}

/// The mean distance of a foot from the center of pressure, weighted by the force.
fn distance(plate: &Plate, foot: &[DVec3], samples: std::ops::Range<usize>) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for s in samples {
        let at = s as f64 / plate.per_frame as f64;
        let frame = (at as usize).min(foot.len() - 1);
        let next = foot[(frame + 1).min(foot.len() - 1)];
        let place = foot[frame].lerp(next, at - frame as f64);
        let weight = plate.force[s].z.abs();
        sum += weight * (place - plate.pressure(s)).truncate().length();
        weights += weight;
    }
    sum / weights
}

/// What acts on a foot in each frame: the force, N, and its moment about the laboratory's origin,
/// N mm; 0 where it is on no plate. `alone` are its contacts.
pub(crate) fn on_foot(
    plates: &[Option<Plate>],
    alone: &[Contact],
    frames: usize,
    rate: f64,
) -> Vec<[DVec3; 2]> {
    let mut loads = vec![[DVec3::ZERO; 2]; frames];
    for contact in alone {
        let Some(plate) = plates.get(contact.plate - 1).and_then(Option::as_ref) else {
            continue;
        };
        let first = ((contact.on * rate).ceil() as usize).saturating_sub(3);
        let end = ((contact.off * rate).floor() as usize + 4).min(frames);
        for t in first..end {
            let [force, moment] = plate.at_frame(t);
            if force.z.abs() > SHOWN {
                loads[t] = [force, moment + plate.center.cross(force)];
            }
        }
    }
    loads
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plate at (100, 0, 0) whose force of 700 N acts at (130, -20, 0) from sample 100 to 399.
    fn plate() -> Plate {
        let load = |s: usize| if (100..400).contains(&s) { 700.0 } else { 0.0 };
        let force: Vec<DVec3> = (0..600).map(|s| DVec3::new(50.0, 0.0, load(s))).collect();
        let arm = DVec3::new(30.0, -20.0, 0.0);
        Plate {
            center: DVec3::new(100.0, 0.0, 0.0),
            normal: DVec3::Z,
            per_frame: 10,
            moment: force.iter().map(|f| arm.cross(*f)).collect(),
            force,
        }
    }

    #[test]
    fn forces_and_moments_are_those_by_hand() {
        let (plates, place) = ([Some(plate())], DVec3::new(130.0, -20.0, 0.0));
        let plate = plates[0].as_ref().unwrap();
        assert!((plate.pressure(200) - place).length() < 1e-9);
        assert_eq!(plate.loads(), [[99, 399]]);
        let foot = |x: f64| vec![DVec3::new(x, 0.0, 0.0); 60];
        let tracks = [
            ("LHEE", foot(90.0)),
            ("LTOE", foot(150.0)),
            ("RHEE", foot(300.0)),
        ];
        let right = [("RTOE", foot(360.0))];
        let markers = Markers::new(tracks.into_iter().chain(right)).unwrap();
        let found = contacts(&plates, &markers, 100.0);
        assert!(found.len() == 1 && found[0].side == Side::Left && !found[0].of_two);
        assert!((found[0].on - (0.099 + 1e-3 * 20.0 / 700.0)).abs() < 1e-9);
        let loads = on_foot(&plates, &found, 60, 100.0);
        let force = DVec3::new(50.0, 0.0, 700.0);
        assert!((loads[20][0] - force).length() < 1e-9);
        assert!((loads[20][1] - place.cross(force)).length() < 1e-6);
        // Six of eleven samples around frame 10.
        assert!((loads[10][0].z - 700.0 * 6.0 / 11.0).abs() < 1e-9);
        assert_eq!(loads[50], [DVec3::ZERO; 2]);
    }
}
