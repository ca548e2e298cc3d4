//! L-BFGS: minimizes a smooth function of many numbers from its gradient.

use std::collections::VecDeque;

/// Steps that are remembered.
const REMEMBERED: usize = 8;
/// A step is shortened at most this often.
const SHORTENED: usize = 25;

/// A function of some numbers: its value and its gradient.
pub(crate) type Objective<'a> = dyn FnMut(&[f64]) -> (f64, Vec<f64>) + 'a;

/// The least value that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum {
    /// The value.
    pub value: f64,
    /// Where it is.
    pub at: Vec<f64>,
    /// Whether the search ended because no step fell any further, not because the steps ran out.
    pub converged: bool,
}

/// Minimizes from `x` by L-BFGS with backtracking (Nocedal and Wright 2006, algorithm 7.4).
///
/// Stops after `steps` steps, or once a step falls by at most `tolerance` (1 + |value|). The
/// function may be infinite, but not at the start.
pub fn minimize(
    mut x: Vec<f64>,
    steps: usize,
    tolerance: f64,
    objective: &mut Objective<'_>,
) -> Minimum {
    let (mut value, mut gradient) = objective(&x);
    let mut pairs: VecDeque<(Vec<f64>, Vec<f64>)> = VecDeque::new();
    let mut converged = false;
    for _ in 0..steps {
        let mut direction = two_loops(&gradient, &pairs);
        let mut slope = dot(&direction, &gradient);
        if !(slope < 0.0) {
            pairs.clear();
            direction = gradient.iter().map(|g| -g).collect();
            slope = dot(&direction, &gradient);
        }
        if !(slope < -1e-14 * (1.0 + value.abs())) {
            converged = slope.is_finite();
            break;
        }
        // Without curvature the first step is of unit length at most.
        let first = if pairs.is_empty() {
            (1.0 / (-slope).sqrt()).min(1.0)
        } else {
            1.0
        };
        let Some((there, v, g)) = backtrack(&x, value, &direction, slope, first, objective) else {
            if pairs.is_empty() {
                break;
            }
            pairs.clear();
            continue;
        };
        let moved: Vec<f64> = there.iter().zip(&x).map(|(a, b)| a - b).collect();
        let bent: Vec<f64> = g.iter().zip(&gradient).map(|(a, b)| a - b).collect();
        let fallen = value - v;
        (x, value, gradient) = (there, v, g);
        if dot(&moved, &bent) > 1e-12 * dot(&bent, &bent) {
            pairs.push_back((moved, bent));
            if pairs.len() > REMEMBERED {
                pairs.pop_front();
            }
        }
        if fallen <= tolerance * (1.0 + value.abs()) {
            converged = true;
            break;
        }
    }
    Minimum {
        value,
        at: x,
        converged,
    }
}

/// The first point along `direction`, at most `step` far, that falls enough (Armijo): where, its
/// value and gradient.
fn backtrack(
    x: &[f64],
    value: f64,
    direction: &[f64],
    slope: f64,
    mut step: f64,
    objective: &mut Objective<'_>,
) -> Option<(Vec<f64>, f64, Vec<f64>)> {
    for _ in 0..SHORTENED {
        let there = x.iter().zip(direction).map(|(x, d)| x + step * d);
        let there: Vec<f64> = there.collect();
        let (v, g) = objective(&there);
        if v <= value + 1e-4 * step * slope {
            return Some((there, v, g));
        }
        step *= 0.4;
    }
    None
}

/// −H g, with H the L-BFGS estimate of the inverse Hessian from the pairs.
fn two_loops(gradient: &[f64], pairs: &VecDeque<(Vec<f64>, Vec<f64>)>) -> Vec<f64> {
    let mut q: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut factors = Vec::with_capacity(pairs.len());
    for (s, y) in pairs.iter().rev() {
        let a = dot(s, &q) / dot(s, y);
        q.iter_mut().zip(y).for_each(|(q, y)| *q -= a * y);
        factors.push(a);
    }
    if let Some((s, y)) = pairs.back() {
        let scale = dot(s, y) / dot(y, y);
        q.iter_mut().for_each(|q| *q *= scale);
    }
    for ((s, y), a) in pairs.iter().zip(factors.into_iter().rev()) {
        let b = dot(y, &q) / dot(s, y);
        q.iter_mut().zip(s).for_each(|(q, s)| *q += (a - b) * s);
    }
    q
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_valley_is_followed_to_its_end() {
        let mut valley = |x: &[f64]| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            let by = vec![-2.0 * a - 400.0 * x[0] * b, 200.0 * b];
            (a * a + 100.0 * b * b, by)
        };
        let end = minimize(vec![-1.2, 1.0], 200, 1e-9, &mut valley);
        assert!(end.converged && end.value <= 1e-8 && (end.at[0] - 1.0).abs() <= 1e-3);
        assert!(!minimize(vec![-1.2, 1.0], 3, 1e-9, &mut valley).converged);
        let end = minimize(vec![1.0], 10, 1e-9, &mut |_| (f64::NAN, vec![f64::NAN]));
        assert!(end.value.is_nan() && !end.converged);
    }
}
