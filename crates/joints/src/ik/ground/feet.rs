//! Points of feet, and the floor that they tell.

use super::floor::{Floor, Level};
use super::report::{FloorReport, GroundReport, Standing};
use super::stance::{Sample, samples, stances};
use super::tuning::*;
use glam::DVec3;

/// Points of feet over time.
pub(super) struct Feet {
    /// By point, its positions (frames; NaN missing).
    pub points: Vec<Vec<DVec3>>,
    /// Frames per second, and what counts as a centimeter.
    pub scale: [f64; 2],
    /// What the whole turns about, (x, z).
    pub pivot: [f64; 2],
}

impl Feet {
    /// Their floor, over the frames in which a point may stand; what it is if there is none.
    pub(super) fn floor(
        &self,
        may_stand: impl Fn(usize, usize) -> bool,
    ) -> std::result::Result<Floor, Standing> {
        let [rate, unit] = self.scale;
        let mut all: Vec<Sample> = Vec::new();
        for (track, points) in self.points.iter().enumerate() {
            for stance in stances(points, self.scale, SPEED, |t| may_stand(track, t)) {
                all.extend(samples(track, points, &stance, rate));
            }
        }
        all.sort_by(|a, b| a.time.total_cmp(&b.time));
        let standing = all.iter().map(|s| s.seconds).sum::<f64>();
        if 2.0 * standing < STANDS * self.points.len().max(2) as f64 {
            return Err(Standing::Never);
        }
        let frames = self.points.first().map_or(0, Vec::len);
        let seconds = frames.saturating_sub(1) as f64 / rate;
        let floor = Floor::find(&all, self.points.len(), seconds, self.pivot, unit);
        if floor.is_one() {
            Ok(floor)
        } else {
            Err(Standing::NoPlane)
        }
    }
}

/// How high the lowest points stand over the floor of the result: as high as they were, if that may
/// be the thickness of soles, else `sole`. `at_zero`: the heights at which they are on the floor;
/// what is tilted or sinks is known no better than soles that are none.
pub(super) fn target(floor: &Floor, lowest: f64, sole: f64, at_zero: [f64; 2], unit: f64) -> f64 {
    let is_near = (at_zero[0]..=at_zero[1]).contains(&lowest);
    if is_near && (floor.is_level() || lowest > THIN * unit) {
        lowest
    } else {
        sole
    }
}

/// What is told of a take of `frames` frames that is carried onto a level floor, and of how high
/// the lowest points stood and stand.
pub(super) fn told(level: &Level, [before, after]: [f64; 2], frames: usize) -> GroundReport {
    let floor = &level.floor;
    let [x, z] = floor.slope;
    let told = FloorReport {
        height: before - after,
        slope: floor.degrees(),
        // Of a level floor 0, whatever the signs of its zeros.
        direction: (x + 0.0).atan2(z + 0.0).to_degrees(),
        sinking: floor.sunk() * 60.0 * level.rate / frames.max(2) as f64,
        sole: after,
    };
    GroundReport {
        floor: Some(told),
        leveled: !level.is_still(),
        ..GroundReport::left(Standing::OnFloor)
    }
}
