//! Levenberg-Marquardt: minimizes by Gauss-Newton steps, damped until they lower the value.

/// The schedule of the damping λ of steps such as `(H + λ diag H) δ = −g`, which the caller solves.
#[derive(Debug, Clone, Copy)]
pub struct Damping {
    /// λ of the first step.
    pub start: f64,
    /// λ after an accepted step, from λ and whether it was the first step tried from its state.
    pub accepted: fn(f64, bool) -> f64,
    /// λ after a rejected step.
    pub rejected: fn(f64) -> f64,
    /// Largest λ: where no step lowers the value, the state is a minimum, to rounding.
    pub most: f64,
}

impl Damping {
    /// Minimizes from a state with a value: gives the best state, and whether the search converged
    /// before `most_accepted` steps were accepted or `most_tried` tried.
    ///
    /// `attempt(state, λ, fresh)` gives the value and the state after a step; `None` when the
    /// normal equations cannot be solved. Only a `fresh` state needs new ones: other steps from it
    /// were rejected. The last step lowers the value by at most an `absolute` tolerance and a
    /// `relative` one, a share of the value, or would have raised it by less than the absolute one.
    pub fn minimize<S>(
        &self,
        (most_accepted, most_tried): (usize, usize),
        (absolute, relative): (f64, f64),
        (mut value, mut state): (f64, S),
        mut attempt: impl FnMut(&S, f64, bool) -> Option<(f64, S)>,
    ) -> (S, bool) {
        let (mut damping, mut fresh, mut taken) = (self.start, true, 0);
        for _ in 0..most_tried {
            let converged = match attempt(&state, damping, fresh) {
                Some((reached, next)) if reached < value => {
                    let gain = value - reached;
                    taken += 1;
                    (value, state) = (reached, next);
                    (damping, fresh) = ((self.accepted)(damping, fresh), true);
                    gain <= absolute + relative * value
                }
                rejected => {
                    (damping, fresh) = ((self.rejected)(damping), false);
                    damping > self.most || rejected.is_some_and(|(r, _)| r - value < absolute)
                }
            };
            if converged || taken >= most_accepted {
                return (state, converged);
            }
        }
        (state, false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAMPING: Damping = Damping {
        start: 1e-3,
        accepted: |damping, first| damping * if first { 0.1 } else { 0.5 },
        rejected: |damping| (damping * 10.0).max(1e-2),
        most: 1e6,
    };
    const TOLERANCE: (f64, f64) = (1e-20, 0.0);

    /// Rosenbrock's function, (1 − x)² + 100 (y − x²)².
    fn rosenbrock([x, y]: [f64; 2]) -> f64 {
        (1.0 - x).powi(2) + 100.0 * (y - x * x).powi(2)
    }

    /// A damped Gauss-Newton step of it.
    fn step(&[x, y]: &[f64; 2], damping: f64) -> (f64, [f64; 2]) {
        // Residuals 1 − x and 10 (y − x²), rows of the Jacobian (−1, 0) and (−20 x, 10).
        let second = 10.0 * (y - x * x);
        let (a, b, d) = (1.0 + 400.0 * x * x, -200.0 * x, 100.0);
        let (a, d) = (a * (1.0 + damping), d * (1.0 + damping));
        let (g, h) = (x - 1.0 - 20.0 * x * second, 10.0 * second);
        let determinant = a * d - b * b;
        let next = [
            x - (d * g - b * h) / determinant,
            y - (a * h - b * g) / determinant,
        ];
        (rosenbrock(next), next)
    }

    #[test]
    fn rosenbrock_reaches_its_minimum_downhill() {
        let start = (rosenbrock([-1.2, 1.0]), [-1.2, 1.0]);
        let (mut values, mut rejected) = (Vec::new(), 0);
        let (end, converged) =
            DAMPING.minimize((100, 100), TOLERANCE, start, |at, damping, fresh| {
                if fresh {
                    values.push(rosenbrock(*at))
                } else {
                    rejected += 1
                }
                Some(step(at, damping))
            });
        assert!(converged && values.len() + rejected < 100);
        assert!(rejected > 0 && values.windows(2).all(|w| w[1] < w[0]));
        assert!(end.iter().all(|v| (v - 1.0).abs() < 1e-8), "{end:?}");
        // Three steps are too few, whether all of them count or those that are accepted.
        for (most, expected) in [((100, 3), 3), ((3, 100), 3 + rejected)] {
            let mut tried = 0;
            let (end, converged) = DAMPING.minimize(most, TOLERANCE, start, |at, damping, _| {
                tried += 1;
                Some(step(at, damping))
            });
            assert!(!converged && rosenbrock(end) > 0.1);
            assert!(tried >= 3 && tried <= expected, "{tried}");
        }
    }

    #[test]
    fn a_rejected_step_leaves_the_state_and_raises_the_damping() {
        let mut tried = Vec::new();
        let values = [2.0, f64::NAN, f64::INFINITY, 0.5, 0.25, 3.0, 0.25];
        let (end, converged) =
            DAMPING.minimize((20, 20), TOLERANCE, (1.0, 0), |at, damping, fresh| {
                tried.push((*at, damping, fresh));
                let value = values[tried.len() - 1];
                (value != f64::INFINITY).then_some((value, tried.len()))
            });
        let (states, fresh): (Vec<_>, Vec<_>) = tried.iter().map(|t| (t.0, t.2)).unzip();
        assert_eq!(states, [0, 0, 0, 0, 4, 5, 5]);
        assert_eq!(fresh, [true, false, false, false, true, true, false]);
        let expected = [1e-3, 1e-2, 1e-1, 1.0, 0.5, 0.05, 0.5];
        for (tried, expected) in tried.iter().zip(expected) {
            assert!((tried.1 / expected - 1.0).abs() < 1e-12, "{tried:?}");
        }
        // A step that changes the value by less than the tolerance ends the search, and so does a
        // damping beyond the largest.
        assert!(converged && end == 5);
        let mut count = 0;
        let (end, converged) = DAMPING.minimize((20, 20), TOLERANCE, (1.0, 0), |_, _, _| {
            count += 1;
            None
        });
        assert!(
            converged && end == 0 && (9..=10).contains(&count),
            "{count}"
        );
    }
}
