//! What moves: rotations and positions, with steps from one to another as vectors.

use crate::pose::ranges;
use glam::{DQuat, DVec3};
use std::ops::Range;

/// A rotation or a position.
pub(super) trait Movable: Copy + Send + Sync {
    /// The step to another, in one's own frame: a rotation vector, radians, or a shift, cm.
    fn step_to(self, other: Self) -> DVec3;
    /// What a step leads to.
    fn stepped(self, step: DVec3) -> Self;
    /// The mean of some, the first where they have none.
    fn mean(all: &[Self]) -> Option<Self>;
    /// The step from the mean, continuous in time where the values are.
    fn off_mean(self, mean: Self) -> DVec3;
}

impl Movable for DQuat {
    fn step_to(self, other: DQuat) -> DVec3 {
        let between = self.conjugate() * other;
        rotation_vector(if between.w < 0.0 { -between } else { between })
    }

    fn stepped(self, step: DVec3) -> DQuat {
        (self * DQuat::from_scaled_axis(step)).normalize()
    }

    fn mean(all: &[DQuat]) -> Option<DQuat> {
        let first = *all.first()?;
        let sum = all.iter().fold(DQuat::from_array([0.0; 4]), |s, q| s + *q);
        let is_none = sum.length() < 1e-3 * all.len() as f64;
        Some(if is_none { first } else { sum.normalize() })
    }

    /// Past half a turn, no jump to the other side.
    fn off_mean(self, mean: DQuat) -> DVec3 {
        rotation_vector(mean.conjugate() * self)
    }
}

impl Movable for DVec3 {
    fn step_to(self, other: DVec3) -> DVec3 {
        other - self
    }

    fn stepped(self, step: DVec3) -> DVec3 {
        self + step
    }

    fn mean(all: &[DVec3]) -> Option<DVec3> {
        let sum: DVec3 = all.iter().sum();
        (!all.is_empty()).then(|| sum / all.len() as f64)
    }

    fn off_mean(self, mean: DVec3) -> DVec3 {
        self - mean
    }
}

/// The rotation vector of a unit quaternion, by its own sign: up to a whole turn long.
fn rotation_vector(q: DQuat) -> DVec3 {
    let v = q.xyz();
    let sine = v.length();
    if sine > 1e-9 {
        v * (2.0 * sine.atan2(q.w) / sine)
    } else {
        v * 2.0 * q.w.signum()
    }
}

/// Runs of frames that are not seen.
pub(super) fn gaps(seen: &[bool]) -> Vec<Range<usize>> {
    ranges((0..seen.len()).filter(|t| !seen[*t]))
}

/// The straight way over a gap between the frames beside it; at an end of the take the one there
/// is. Nothing where the take has no other frame.
pub(super) fn straight<M: Movable>(values: &[M], gap: &Range<usize>) -> Vec<M> {
    let before = gap.start.checked_sub(1).map(|t| values[t]);
    match (before, values.get(gap.end).copied()) {
        (Some(a), Some(b)) => {
            let step = a.step_to(b) / (gap.len() + 1) as f64;
            let at = |k: usize| a.stepped(step * (k + 1) as f64);
            (0..gap.len()).map(at).collect()
        }
        (one, other) => one.or(other).map_or(Vec::new(), |v| vec![v; gap.len()]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_lead_where_they_came_from() {
        let a = DQuat::from_scaled_axis(DVec3::new(0.4, -1.0, 2.0));
        for b in [a, -a, DQuat::from_rotation_x(3.1), DQuat::IDENTITY] {
            let found = a.stepped(a.step_to(b));
            assert!(found.dot(b).abs() > 1.0 - 1e-12, "{b}");
            assert!(a.step_to(b).length() <= std::f64::consts::PI + 1e-9);
        }
        // Continuous past half a turn.
        let turned = |angle: f64| DQuat::from_rotation_y(angle).off_mean(DQuat::IDENTITY);
        assert!((turned(3.2) - turned(3.1)).length() < 0.11);
        assert_eq!(DVec3::X.stepped(DVec3::X.step_to(DVec3::Y)), DVec3::Y);
    }

    #[test]
    fn the_straight_way_is_even_and_holds_at_the_ends() {
        let turn = |t: usize| DQuat::from_rotation_z(0.3 * t as f64);
        let values: Vec<DQuat> = (0..9).map(turn).collect();
        for (t, q) in (3..6).zip(straight(&values, &(3..6))) {
            assert!(q.dot(turn(t)).abs() > 1.0 - 1e-12);
        }
        assert_eq!(straight(&values, &(0..2)), [values[2]; 2]);
        assert_eq!(straight(&values, &(7..9)), [values[6]; 2]);
        assert!(straight(&values[..2], &(0..2)).is_empty());
        assert_eq!(gaps(&[false, true, false, false]), [0..1, 2..4]);
    }
}
