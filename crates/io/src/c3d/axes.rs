//! Which axis of a C3D file points up: what POINT:Y_SCREEN says, or, where that is not to be
//! understood, what the points tell.

use super::parameters::Parameters;
use crate::pose::head_and_feet::head_and_feet;
use ndarray::ArrayView2;

/// Frames that are looked at, evenly spread over the take.
const FRAMES: usize = 2000;
/// The share of frames in which heads must be above feet.
const LEAST_FRAMES: f64 = 0.8;
/// The share of their distance by which they must be.
const LEAST_SHARE: f64 = 1.0 / 3.0;

/// The axis that points up, as `+Z`, else what the file says of it; and whether it was inferred,
/// which is noted.
pub(crate) fn up(
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
    let is_qualisys = maker.is_some_and(|m| {
        let m = m.to_ascii_lowercase();
        m.contains("qualisys") || m.contains("qtm")
    });
    let is_custom = word == "-Z" && matches!(right.to_ascii_uppercase().as_str(), "+X" | "X");
    let found = if is_custom && is_qualisys {
        None
    } else {
        axis_of_points(points, xyz)
    };
    if found.is_none() && is_custom && (is_qualisys || maker.is_none()) {
        let unnamed = if is_qualisys {
            ""
        } else {
            ", the file names no maker and its points tell no axis"
        };
        notes.push(format!(
            "POINT:Y_SCREEN is -Z and X_SCREEN +X, as Qualisys writes them{unnamed}: z is taken \
             for up (the option `up` changes it)"
        ));
        return (Some("+Z".into()), true);
    }
    let says = match &said {
        Some(said) => format!("POINT:Y_SCREEN is {said}"),
        None => "POINT:Y_SCREEN is not there".into(),
    };
    match found {
        Some((axis, true, share)) => {
            notes.push(format!(
                "{says}: {axis} is taken for up, since the head is above the feet along it in \
                 {share:.0}% of the frames (the option `up` changes it)"
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

/// The axis, y or z, along which heads are above feet in most frames, or below them (`false`), and
/// the share of these frames in percent. (x is up in no file: where heads and feet are apart along
/// it, somebody lies.)
fn axis_of_points(
    points: &[String],
    xyz: ArrayView2<'_, f64>,
) -> Option<(&'static str, bool, f64)> {
    let [heads, feet] = head_and_feet(points);
    // By axis, the frames with heads below and above.
    let (mut votes, mut all) = ([[0_usize; 2]; 3], 0_u32);
    // By axis, the sum of the share of the distance that is along it.
    let mut shares = [0.0_f64; 3];
    let step = (xyz.nrows() / FRAMES).max(1);
    for row in xyz.rows().into_iter().step_by(step) {
        let mean = |of: &[usize], c: usize| {
            let seen = of.iter().map(|p| row[3 * p + c]).filter(|v| !v.is_nan());
            let (sum, count) = seen.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
            sum / count
        };
        let apart = [0, 1, 2].map(|c| mean(&heads, c) - mean(&feet, c));
        let distance = apart.iter().map(|v| v * v).sum::<f64>().sqrt();
        if !(distance.is_finite() && distance > 0.0) {
            continue;
        }
        all += 1;
        for c in [1, 2] {
            let share = apart[c] / distance;
            shares[c] += share.abs();
            if share.abs() >= LEAST_SHARE {
                votes[c][usize::from(share > 0.0)] += 1;
            }
        }
    }
    let choices = [(1, true), (2, true), (1, false), (2, false)].into_iter();
    let count = |(c, above): (usize, bool)| votes[c][usize::from(above)] as f64;
    let most = choices.filter(|choice| count(*choice) > LEAST_FRAMES * f64::from(all));
    let (axis, above) = most.max_by(|a, b| shares[a.0].total_cmp(&shares[b.0]))?;
    let share = 100.0 * count((axis, above)) / f64::from(all);
    Some((["x", "y", "z"][axis], above, share))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    fn up_of(names: &[&str], xyz: &[f64]) -> Option<(&'static str, bool)> {
        let names: Vec<String> = names.iter().map(|n| n.to_string()).collect();
        let xyz = Array2::from_shape_vec(
            (xyz.len() / (3 * names.len()), 3 * names.len()),
            xyz.to_vec(),
        );
        axis_of_points(&names, xyz.unwrap().view()).map(|(axis, above, _)| (axis, above))
    }

    #[test]
    fn heads_are_above_feet() {
        let n = f64::NAN;
        let names = ["Ann:LFHD", "LHEE", "RTOE", "LELB"];
        let up = [1., 2., 170., 0., 0., 5., n, n, n, 9., 900., 9.];
        let lying = [170., 2., 3., 0., 0., 5., n, n, n, 9., 9., 9.];
        let most = [up, up, up, up, up, lying].concat();
        assert_eq!(up_of(&names, &most), Some(("z", true)));
        assert_eq!(up_of(&names, &[up, up, lying].concat()), None);
        // Somebody who lies along x, or leans along y.
        assert_eq!(up_of(&names, &[lying, lying].concat()), None);
        let leaning = [1., 90., 170., 0., 0., 5., n, n, n, 9., 900., 9.];
        assert_eq!(up_of(&names, &leaning), Some(("z", true)));
        let down = up.map(|v| -v);
        assert_eq!(up_of(&names, &[down, down].concat()), Some(("z", false)));
        assert_eq!(up_of(&["LELB", "LHEE"], &[0., 0., 9., 0., 0., 0.]), None);
    }

    #[test]
    fn y_screen_of_minus_z_is_the_custom_of_qualisys() {
        let up_of = |maker: &[u8], names: [&str; 2]| {
            let mut section = vec![1, 0x50, 1, 84];
            section.extend(b"\x05\xffPOINT\x03\0\0\x0c\xfeMANUFACTURER\x03\0\0");
            section.extend(b"\x08\x01X_SCREEN\x07\0\xff\x01\x02+X");
            section.extend(b"\x08\x01Y_SCREEN\x07\0\xff\x01\x02-Z");
            section.extend([b"\x07\x02COMPANY\x0d\0\xff\x01\x08", maker, b"\0\0\0"].concat());
            let parameters = Parameters::read(&section, super::super::numbers::Processor::Intel);
            assert_eq!(parameters.text("POINT:Y_SCREEN"), Some("-Z"));
            let xyz = Array2::from_shape_vec((1, 6), vec![0., 170., 0., 0., 5., 0.]).unwrap();
            let mut notes = Vec::new();
            let names = names.map(String::from);
            let up = super::up(&parameters, &names, xyz.view(), &mut notes);
            (up.0.unwrap(), notes.concat())
        };
        let (body, thing) = (["HEAD", "LHEE"], ["A", "B"]);
        assert_eq!(up_of(b"Qualisys", body).0, "+Z");
        let (up, note) = up_of(b"        ", body);
        assert!(up == "+Y" && note.contains("100% of the frames"), "{note}");
        let (up, note) = up_of(b"        ", thing);
        assert!(up == "+Z" && note.contains("names no maker"), "{note}");
        assert_eq!(up_of(b"Acme    ", thing).0, "-Z");
        assert_eq!(up_of(b"Acme    ", body).0, "+Y");
    }
}
