//! Which axis of a C3D file points up: what POINT:Y_SCREEN says, or, where that is not to be understood, what the points tell.

use super::parameters::Parameters;
use crate::pose::NameMap;
use ndarray::ArrayView2;

/// Frames that are looked at, evenly spread over the take.
const FRAMES: usize = 2000;

/// The axis that points up, as `+Z`, else what the file says of it; and whether it was inferred, which is noted.
pub fn up(
    parameters: &Parameters,
    points: &[String],
    xyz: ArrayView2<'_, f64>,
    notes: &mut Vec<String>,
) -> (Option<String>, bool) {
    let said = parameters.text("POINT:Y_SCREEN").map(str::to_string);
    let right = parameters.text("POINT:X_SCREEN").unwrap_or_default();
    let word = said.as_deref().unwrap_or_default().to_ascii_uppercase();
    let axis = |word: &str| word.trim_start_matches(['+', '-']).to_ascii_uppercase();
    let is_odd = axis(right) == axis(&word) && !word.is_empty();
    if matches!(&*word, "+X" | "+Y" | "+Z" | "X" | "Y" | "Z") && !is_odd {
        return (said, false);
    }
    let maker = ["MANUFACTURER:COMPANY", "MANUFACTURER:SOFTWARE"];
    let maker = maker.iter().find_map(|name| parameters.text(name));
    let is_qualisys = maker.is_none_or(|m| {
        let m = m.to_ascii_lowercase();
        m.contains("qualisys") || m.contains("qtm")
    });
    if word == "-Z" && matches!(right.to_ascii_uppercase().as_str(), "+X" | "X") && is_qualisys {
        notes.push(
            "POINT:Y_SCREEN is -Z and X_SCREEN +X, as Qualisys writes them: z is taken for up (--up changes it)".into(),
        );
        return (Some("+Z".into()), true);
    }
    let told = told_by_points(points, xyz);
    let says = match &said {
        Some(said) => format!("POINT:Y_SCREEN is {said}"),
        None => "POINT:Y_SCREEN is not there".into(),
    };
    match told {
        Some((axis, true, share)) => {
            notes.push(format!(
                "{says}: {axis} is taken for up, since the head is above the feet along it in {share:.0}% of the frames (--up changes it)"
            ));
            (Some(format!("+{}", axis.to_uppercase())), true)
        }
        Some((axis, false, share)) => {
            notes.push(format!(
                "{says}, and the head is below the feet along {axis} in {share:.0}% of the frames"
            ));
            (said, false)
        }
        None if is_odd => (Some(format!("{word}, with {right} to the right")), false),
        None => (said, false),
    }
}

/// The axis along which heads and feet are farthest apart in most frames, whether heads are above, and the share of these frames in percent.
fn told_by_points(
    points: &[String],
    xyz: ArrayView2<'_, f64>,
) -> Option<(&'static str, bool, f64)> {
    let named = NameMap::fitting(points).map(|map| map.model_names(points));
    let is = |test: fn(&str) -> bool| -> Vec<usize> {
        let is_one = |p: &usize| test(&points[*p]) || named.as_ref().is_some_and(|n| test(&n[*p]));
        (0..points.len()).filter(is_one).collect()
    };
    let (heads, feet) = (is(is_head), is(is_foot));
    let mut votes = [[0_usize; 2]; 3];
    let step = (xyz.nrows() / FRAMES).max(1);
    for row in xyz.rows().into_iter().step_by(step) {
        let mean = |of: &[usize], c: usize| {
            let seen = of.iter().map(|p| row[3 * p + c]).filter(|v| !v.is_nan());
            let (sum, count) = seen.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
            sum / count
        };
        let apart = [0, 1, 2].map(|c| mean(&heads, c) - mean(&feet, c));
        let far = (0..3).max_by(|a, b| apart[*a].abs().total_cmp(&apart[*b].abs()))?;
        if apart[far].is_finite() && apart[far] != 0.0 {
            votes[far][usize::from(apart[far] > 0.0)] += 1;
        }
    }
    let all: usize = votes.iter().flatten().sum();
    let choices = (0..3).flat_map(|c| [(c, false), (c, true)]);
    let (axis, above) = choices.max_by_key(|(c, above)| votes[*c][usize::from(*above)])?;
    let most = votes[axis][usize::from(above)];
    (2 * most > all).then(|| {
        let share = 100.0 * most as f64 / all as f64;
        (["x", "y", "z"][axis], above, share)
    })
}

/// The name without what stands before its last colon, letters alone, in lower case.
fn letters(name: &str) -> String {
    let own = name.rsplit(':').next().unwrap_or_default();
    let letters = own.chars().filter(char::is_ascii_alphabetic);
    letters.collect::<String>().to_ascii_lowercase()
}

/// Whether a point is called as one of the head.
fn is_head(name: &str) -> bool {
    let name = letters(name);
    // Heads of bones are none.
    let bones = ["fib", "fem", "met", "mt", "hum", "rad", "uln"];
    let is_short = name.ends_with("hd") && name.len() <= 4;
    (name.contains("head") || is_short) && !bones.iter().any(|bone| name.contains(bone))
}

/// Whether a point is called as one of a foot.
fn is_foot(name: &str) -> bool {
    let name = letters(name);
    let parts = ["heel", "toe", "ankle", "foot"];
    let is_short = ["hee", "ank", "cal", "mt"]
        .iter()
        .any(|end| name.ends_with(end));
    parts.iter().any(|part| name.contains(part)) || is_short && name.len() <= 4
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    fn told(names: &[&str], xyz: &[f64]) -> Option<(&'static str, bool)> {
        let names: Vec<String> = names.iter().map(|n| n.to_string()).collect();
        let xyz = Array2::from_shape_vec(
            (xyz.len() / (3 * names.len()), 3 * names.len()),
            xyz.to_vec(),
        );
        told_by_points(&names, xyz.unwrap().view()).map(|(axis, above, _)| (axis, above))
    }

    #[test]
    fn heads_are_above_feet() {
        let n = f64::NAN;
        let names = ["Ann:LFHD", "LHEE", "RTOE", "LELB"];
        let up = [1., 2., 170., 0., 0., 5., n, n, n, 9., 900., 9.];
        let lying = [170., 2., 3., 0., 0., 5., n, n, n, 9., 9., 9.];
        assert_eq!(told(&names, &[up, up, lying].concat()), Some(("z", true)));
        assert_eq!(told(&names, &[up, lying].concat()), None);
        let down = up.map(|v| -v);
        assert_eq!(told(&names, &[down, down].concat()), Some(("z", false)));
        assert_eq!(told(&["LELB", "LHEE"], &[0., 0., 9., 0., 0., 0.]), None);
        assert!(is_foot("L.Heel") && is_foot("RANK") && !is_foot("LSHANK") && !is_foot("RFRANK"));
        assert!(is_head("HeadL") && is_head("rbhd") && !is_head("L_FibHead") && !is_head("RMT5"));
    }
}
