//! Two-bone inverse kinematics: a hip, a knee and an ankle (or an arm's joints) whose end is to be
//! at a goal.
//!
//! With thigh a, shin b and the distance d of hip H and goal, the knee stands at
//! `H + x e + h p`, e the unit vector to the goal, `x = (a² + d² - b²) / 2d`, `h² = a² - x²`, and p
//! the unit vector across e on whose side the knee bends.

use super::rotation::shortest_arc;
use glam::{DMat3, DVec3};

/// Shorter than this, cm, a bone has no direction.
const NO_LENGTH: f64 = 1e-9;

/// Where the three joints of a limb stand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoBones {
    /// Where the upper bone starts.
    pub hip: DVec3,
    /// Where the bones meet.
    pub knee: DVec3,
    /// Where the lower bone ends.
    pub ankle: DVec3,
}

/// What carries a limb to its goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reached {
    /// Turns the upper bone, from the left: `G ← upper G`.
    pub upper: DMat3,
    /// Turns the lower bone likewise.
    pub lower: DMat3,
    /// Where the ankle stands then: the goal, or as near as it may be.
    pub ankle: DVec3,
}

impl TwoBones {
    /// The knee's offset from the line through hip and ankle.
    pub fn bend(&self) -> DVec3 {
        let line = (self.ankle - self.hip).normalize_or_zero();
        let thigh = self.knee - self.hip;
        thigh - thigh.dot(line) * line
    }

    /// Carries the ankle to `goal`. `pole` is a vector to whose side the knee bends now; it turns
    /// along with the line from hip to ankle. The limb is stretched to the share `reach` of its
    /// length at most, or as far as it is already. `None`: a bone has no length, or the goal is at
    /// the hip.
    pub fn reach(&self, goal: DVec3, pole: DVec3, reach: f64) -> Option<Reached> {
        let (a, b) = (self.knee.distance(self.hip), self.ankle.distance(self.knee));
        let before = self.ankle.distance(self.hip);
        let line = (goal - self.hip).try_normalize()?;
        if a.min(b).min(before) <= NO_LENGTH || !(a + b).is_finite() {
            return None;
        }
        let farthest = before.max(reach * (a + b)).min(a + b);
        let d = goal.distance(self.hip).clamp((a - b).abs(), farthest);
        let pole = shortest_arc(self.ankle - self.hip, line)? * pole;
        let across = (pole - pole.dot(line) * line).normalize_or(line.any_orthonormal_vector());
        let along = ((a * a + d * d - b * b) / (2.0 * d)).clamp(-a, a);
        let knee = self.hip + along * line + (a * a - along * along).max(0.0).sqrt() * across;
        let ankle = self.hip + d * line;
        Some(Reached {
            upper: shortest_arc(self.knee - self.hip, knee - self.hip)?,
            lower: shortest_arc(self.ankle - self.knee, ankle - knee)?,
            ankle,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leg(bend: f64) -> TwoBones {
        TwoBones {
            hip: DVec3::new(1.0, 80.0, 2.0),
            knee: DVec3::new(1.0, 40.0, 2.0 + bend),
            ankle: DVec3::new(1.0, 0.0, 2.0),
        }
    }

    fn turned(limb: &TwoBones, by: &Reached) -> DVec3 {
        limb.hip + by.upper * (limb.knee - limb.hip) + by.lower * (limb.ankle - limb.knee)
    }

    #[test]
    fn the_ankle_comes_to_the_goal_and_bones_keep_their_lengths() {
        for goal in [[5.0, 10.0, 8.0], [1.0, 3.0, -20.0], [-30.0, 40.0, 30.0]] {
            let (limb, goal) = (leg(6.0), DVec3::from_array(goal));
            let reached = limb.reach(goal, limb.bend(), 0.9995).unwrap();
            assert!((reached.ankle - goal).length() <= 1e-9);
            assert!((turned(&limb, &reached) - goal).length() <= 1e-9);
        }
    }

    #[test]
    fn a_limb_at_its_goal_stays_as_it_is() {
        let limb = leg(3.0);
        let reached = limb.reach(limb.ankle, limb.bend(), 0.9995).unwrap();
        assert!(reached.upper.abs_diff_eq(DMat3::IDENTITY, 1e-9));
        assert!(reached.lower.abs_diff_eq(DMat3::IDENTITY, 1e-9));
    }

    #[test]
    fn a_straight_limb_bends_to_the_side_of_its_pole() {
        let limb = leg(0.0);
        let reached = limb
            .reach(limb.ankle + 5.0 * DVec3::Y, DVec3::Z, 1.0)
            .unwrap();
        let knee = limb.hip + reached.upper * (limb.knee - limb.hip);
        assert!(knee.z > limb.knee.z + 5.0 && (knee.x - 1.0).abs() <= 1e-9);
    }

    #[test]
    fn a_goal_out_of_reach_stretches_the_limb_to_the_limit() {
        let limb = leg(20.0);
        let reached = limb
            .reach(DVec3::new(1.0, -40.0, 2.0), limb.bend(), 0.9)
            .unwrap();
        let full = 2.0 * limb.knee.distance(limb.hip);
        assert!((reached.ankle.distance(limb.hip) - 0.9 * full).abs() <= 1e-9);
        assert!((turned(&limb, &reached) - reached.ankle).length() <= 1e-9);
    }

    #[test]
    fn no_length_and_no_number_are_no_limb() {
        let limb = leg(3.0);
        assert!(limb.reach(limb.hip, DVec3::Z, 1.0).is_none());
        let short = TwoBones {
            knee: limb.hip,
            ..limb
        };
        assert!(short.reach(DVec3::ZERO, DVec3::Z, 1.0).is_none());
        let lost = TwoBones {
            knee: DVec3::NAN,
            ..limb
        };
        assert!(lost.reach(DVec3::ZERO, DVec3::Z, 1.0).is_none());
    }
}
