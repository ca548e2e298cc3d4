//! Left and right by the names of points and joints.

/// Words of the sides.
const WORDS: [[&str; 2]; 3] = [["Left", "Right"], ["left", "right"], ["LEFT", "RIGHT"]];
/// Letters of the sides.
const LETTERS: [[char; 2]; 2] = [['L', 'R'], ['l', 'r']];

/// The joint or point on the other side, by its name: `LeftArm` and `RightArm`, `lfemur` and
/// `rfemur`, `LFHD` and `RFHD`, `hand_L` and `hand_R`, `Bip01 L Foot` and `Bip01 R Foot`, each
/// behind a prefix such as `mixamorig:` too; `None` of the middle, and where `names` has it not.
///
/// ```
/// use posing_core::pose::sides::mirrored;
///
/// let names = ["Hips", "LeftArm", "RightArm"].map(String::from);
/// assert_eq!(mirrored(&names, 1), Some(2));
/// assert_eq!(mirrored(&names, 0), None);
/// ```
pub fn mirrored(names: &[String], index: usize) -> Option<usize> {
    let others = other_names(names.get(index)?);
    others
        .iter()
        .find_map(|other| names.iter().position(|n| n == other))
}

/// The mirror image of each name, itself where it has none; images of images are the names.
#[doc(hidden)]
pub fn mirror_images(names: &[String]) -> Vec<usize> {
    let found: Vec<Option<usize>> = (0..names.len()).map(|i| mirrored(names, i)).collect();
    let image = |i: usize| {
        found[i]
            .filter(|other| found[*other] == Some(i))
            .unwrap_or(i)
    };
    (0..names.len()).map(image).collect()
}

/// Whether a name has a word or a letter of its own for a side.
#[doc(hidden)]
pub fn is_of_side(name: &str) -> bool {
    by_word(name).is_some() || by_part(name).is_some()
}

/// The names that the other side of a name may have, the surest first.
fn other_names(name: &str) -> Vec<String> {
    let of_end = name.chars().next_back().and_then(other_letter);
    let end = of_end.map(|other| format!("{}{other}", &name[..name.len() - 1]));
    [by_word(name), by_part(name), by_first_letter(name), end]
        .into_iter()
        .flatten()
        .collect()
}

/// With the other word, as far left as one stands.
fn by_word(name: &str) -> Option<String> {
    let words = WORDS.iter().flat_map(|[a, b]| [(a, b), (b, a)]);
    let found = words.filter_map(|(own, other)| Some((name.find(own)?, own, other)));
    let (at, own, other) = found.min_by_key(|(at, ..)| *at)?;
    Some(format!("{}{other}{}", &name[..at], &name[at + own.len()..]))
}

/// With the other letter where one stands alone between signs and blanks.
fn by_part(name: &str) -> Option<String> {
    let mut at = 0;
    for part in name.split(|c: char| !c.is_alphanumeric()) {
        let mut letters = part.chars();
        if let (Some(letter), None) = (letters.next(), letters.next())
            && let Some(other) = other_letter(letter)
            && part.len() < name.len()
        {
            return Some(format!("{}{other}{}", &name[..at], &name[at + 1..]));
        }
        // What parts two parts may be longer than a byte.
        let sign = name[at + part.len()..].chars().next();
        at += part.len() + sign.map_or(0, char::len_utf8);
    }
    None
}

/// With the other letter at the beginning, behind a prefix.
fn by_first_letter(name: &str) -> Option<String> {
    let start = name.rfind(':').map_or(0, |at| at + 1);
    let other = other_letter(name[start..].chars().next()?)?;
    Some(format!("{}{other}{}", &name[..start], &name[start + 1..]))
}

fn other_letter(letter: char) -> Option<char> {
    let pairs = LETTERS.iter().flat_map(|[a, b]| [(a, b), (b, a)]);
    pairs
        .into_iter()
        .find(|(own, _)| **own == letter)
        .map(|(_, other)| *other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::joints::cmu_names;

    #[test]
    fn sides_of_many_conventions_find_each_other() {
        for [left, right] in [
            ["LeftArm", "RightArm"],
            ["mixamorig:LeftHandIndex1", "mixamorig:RightHandIndex1"],
            ["left_knee", "right_knee"],
            ["hand_L", "hand_R"],
            ["hand.L_end", "hand.R_end"],
            ["hand_l", "hand_r"],
            ["L_Knee", "R_Knee"],
            ["Bip01 L Foot", "Bip01 R Foot"],
            ["LFHD", "RFHD"],
            ["Ann:LFHD", "Ann:RFHD"],
            ["lfemur", "rfemur"],
            ["ElbowL", "ElbowR"],
            ["J\u{f6}rg L Fu\u{df}", "J\u{f6}rg R Fu\u{df}"],
            ["\u{5de6}_L", "\u{5de6}_R"],
        ] {
            let names = [left, "Hips", right, "C7"].map(String::from);
            assert_eq!(mirror_images(&names), [2, 1, 0, 3], "{left}");
        }
    }

    #[test]
    fn the_middle_and_what_has_no_other_side_stay() {
        let names = [
            "root",
            "LTOE",
            "lowerback",
            "RBAK",
            "L",
            "upright",
            "Neck L",
            "",
        ];
        let names = names.map(String::from);
        assert_eq!(mirror_images(&names), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert!(is_of_side("Neck L") && is_of_side("LeftArm") && !is_of_side("RBAK"));
        let names = cmu_names();
        let images = mirror_images(&names);
        assert!(
            images
                .iter()
                .enumerate()
                .all(|(i, other)| images[*other] == i)
        );
        let pairs = images
            .iter()
            .enumerate()
            .filter(|(i, other)| i != *other)
            .count();
        assert_eq!(pairs, 16);
    }
}
