//! Heads and feet among points, by their names.

use super::NameMap;

/// The points of heads and of feet: joints or markers, by their own names or as a shipped map of
/// names has them.
pub fn head_and_feet(points: &[String]) -> [Vec<usize>; 2] {
    let named = NameMap::fitting(points).map(|map| map.model_names(points));
    let is = |test: fn(&str) -> bool| -> Vec<usize> {
        let is_one = |p: &usize| test(&points[*p]) || named.as_ref().is_some_and(|n| test(&n[*p]));
        (0..points.len()).filter(is_one).collect()
    };
    [is(is_head), is(is_foot)]
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

    #[test]
    fn names_tell_heads_and_feet() {
        assert!(is_foot("L.Heel") && is_foot("RANK") && !is_foot("LSHANK") && !is_foot("RFRANK"));
        assert!(is_head("HeadL") && is_head("rbhd") && !is_head("L_FibHead") && !is_head("RMT5"));
        let points = ["Ann:LFHD", "LELB", "RTOE"].map(String::from);
        assert_eq!(head_and_feet(&points), [vec![0], vec![2]]);
    }
}
