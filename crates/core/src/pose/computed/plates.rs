//! What force plates make: centers of pressure, which have one and the same position while nobody
//! stands there and travel in the plane of the floor while somebody does, and the tips of forces.
//! So also the projection of a center of mass to the floor.

use super::{EXACT, FEWEST_FRAMES, MOVES, Tracks};
use crate::numeric::statistics::median;
use glam::DVec3;

/// Under load for fewer frames, a plate shows no travel.
const FEWEST_LOADED: usize = 5;
/// So many times the steps of its travel a center of pressure jumps from its idle position and
/// back; a marker whose value was held goes on from where it was.
const JUMP: f64 = 5.0;
/// The floor is no higher above nearly all other points than this, cm: markers have a radius, and
/// the axes of a foot may end below.
const ABOVE_LOWEST: f64 = 3.0;

/// A point with an idle position: the frames in which it is there, and those in which it is
/// elsewhere.
struct Idle {
    position: DVec3,
    idle: Vec<usize>,
    loaded: Vec<usize>,
}

/// Centers of pressure, tips of forces, and centers of mass with their projections.
pub(super) fn computed(tracks: Tracks<'_>) -> Vec<usize> {
    let all = 0..tracks.points();
    let on_floor: Vec<usize> = all.clone().filter(|p| is_on_floor(tracks, *p)).collect();
    let idle_of: Vec<Option<Idle>> = all.clone().map(|p| Idle::of(tracks, p)).collect();
    let is_pressure = |p: &usize| {
        let is_said = has_name(tracks, *p, &["cop", "cofp", "ofpressure", "of_pressure"]);
        let jumps = |idle: &Idle| idle.jumps(tracks, *p);
        is_said || idle_of[*p].as_ref().is_some_and(jumps)
    };
    let plates: Vec<usize> = on_floor.iter().copied().filter(is_pressure).collect();
    let is_tip = |p: &usize| {
        let loads = |plate: &usize| match (&idle_of[*p], &idle_of[*plate]) {
            (Some(tip), Some(plate)) => tip.is_loaded_with(plate),
            _ => false,
        };
        plates.iter().any(loads)
    };
    let mut found: Vec<usize> = all.clone().filter(is_tip).collect();
    for floor in &on_floor {
        let is_above = |p: &usize| p != floor && is_projected(tracks, *p, *floor);
        let above: Vec<usize> = all.clone().filter(is_above).collect();
        let is_mass = |p: &usize| has_name(tracks, *p, &["mass", "com", "cog", "gravity"]);
        found.extend((!above.is_empty()).then_some(*floor));
        found.extend(above.into_iter().filter(is_mass));
    }
    found.extend(plates);
    found
}

fn has_name(tracks: Tracks<'_>, point: usize, parts: &[&str]) -> bool {
    let name = tracks.own_name(point);
    parts.iter().any(|part| name.contains(part))
}

/// Whether a point moves in one plane below nearly all others, to the last digit, in all frames but
/// those of its idle position.
fn is_on_floor(tracks: Tracks<'_>, point: usize) -> bool {
    let idle = Idle::of(tracks, point).map(|idle| idle.position);
    let is_loaded = |t: usize| {
        let at = tracks.at(t, point);
        at.is_finite() && Some(at) != idle
    };
    let extent = tracks.extent(point, is_loaded);
    if extent.y > EXACT || extent.x.max(extent.z) < MOVES {
        return false;
    }
    let loaded: Vec<usize> = (0..tracks.frames()).filter(|t| is_loaded(*t)).collect();
    let is_lowest = |t: &&usize| {
        let others = (0..tracks.points()).map(|p| tracks.at(**t, p).y);
        let others: Vec<f64> = others.filter(|y| y.is_finite() && *y != 0.0).collect();
        let floor = tracks.at(**t, point).y - ABOVE_LOWEST;
        let below = others.iter().filter(|y| **y < floor).count();
        !others.is_empty() && 10 * below <= others.len()
    };
    loaded.len() >= FEWEST_LOADED
        && 10 * loaded.iter().filter(is_lowest).count() >= 9 * loaded.len()
}

/// Whether a point is straight above another in all frames in which both are seen.
fn is_projected(tracks: Tracks<'_>, point: usize, floor: usize) -> bool {
    let both = (0..tracks.frames()).map(|t| tracks.at(t, point) - tracks.at(t, floor));
    let mut both = both.filter(|off| off.is_finite()).peekable();
    let (mut count, mut highest) = (0, 0_f64);
    let is_above = |off: DVec3| {
        count += 1;
        highest = highest.max(off.y);
        off.x.abs().max(off.z.abs()) <= EXACT
    };
    both.all(is_above) && count >= FEWEST_FRAMES && highest > MOVES
}

impl Idle {
    /// By the position that a point has for most frames on end; `None` where these are few, or it
    /// has no other.
    fn of(tracks: Tracks<'_>, point: usize) -> Option<Idle> {
        let (mut longest, mut position) = (0, None);
        let (mut run, mut last) = (0, None);
        for t in 0..tracks.frames() {
            let at = Some(tracks.at(t, point)).filter(|at| at.is_finite());
            run = if at.is_some() && at == last {
                run + 1
            } else {
                1
            };
            last = at;
            if at.is_some() && run > longest {
                (longest, position) = (run, at);
            }
        }
        let position = position.filter(|_| longest >= FEWEST_FRAMES)?;
        let seen = (0..tracks.frames()).filter(|t| tracks.at(*t, point).is_finite());
        let (idle, loaded): (Vec<_>, Vec<_>) = seen.partition(|t| tracks.at(*t, point) == position);
        let all = Idle {
            position,
            idle,
            loaded,
        };
        (all.loaded.len() >= FEWEST_LOADED).then_some(all)
    }

    /// Whether the point jumps each time it leaves its idle position, and each time it comes back.
    fn jumps(&self, tracks: Tracks<'_>, point: usize) -> bool {
        let (mut travel, mut jumps) = (Vec::new(), Vec::new());
        for t in 1..tracks.frames() {
            let [was, is] = [t - 1, t].map(|t| tracks.at(t, point));
            let step = (is - was).length();
            match [was, is].iter().filter(|at| **at == self.position).count() {
                _ if !step.is_finite() => {}
                0 if step > EXACT => travel.push(step),
                1 => jumps.push(step),
                _ => {}
            }
        }
        let least = (JUMP * median(travel).unwrap_or(0.0)).max(MOVES);
        !jumps.is_empty() && jumps.iter().all(|jump| *jump > least)
    }

    /// Whether it is idle when a plate is; one frame more or less at each end is left to filters.
    fn is_loaded_with(&self, plate: &Idle) -> bool {
        let other = |frames: &[usize], of: &[usize]| {
            let is_other = |t: &&usize| of.binary_search(t).is_err();
            frames.iter().filter(is_other).count()
        };
        let differs = other(&self.idle, &plate.idle) + other(&self.loaded, &plate.loaded);
        10 * differs <= plate.loaded.len()
    }
}
