//! The second half of a BVH file: how many frames, how long each, and their values.

use super::Joint;
use super::words::{BvhFault, Tokens, bounded};
use crate::io::text::{excerpt, parse_number};

/// The count of frames, the Frame Time, and where the count stands.
pub fn motion_head(words: &mut Tokens) -> std::result::Result<(f64, f64, usize), BvhFault> {
    let (frames, start) = labelled(words, &["frames"], "Frames:")?;
    let (time, _) = labelled(words, &["frame", "time"], "Frame Time:")?;
    Ok((frames, time, start))
}

/// A number after a label, however the colon is spaced.
fn labelled(
    words: &mut Tokens,
    label: &[&str],
    shown: &str,
) -> std::result::Result<(f64, usize), BvhFault> {
    let expected = |at: usize, word: &str| {
        BvhFault(at, format!("expected {shown}, found \"{}\"", excerpt(word)))
    };
    let (mut start, mut letters) = (None, String::new());
    let wanted = label.concat();
    while letters != wanted {
        let Some((at, word)) = words.next() else {
            return Err(BvhFault(
                words.text.len(),
                format!("expected {shown}; the file is cut off"),
            ));
        };
        start.get_or_insert(at);
        let (text, value) = match word.split_once(':') {
            Some((text, value)) => (text, value),
            None => (word, ""),
        };
        letters.push_str(&text.to_ascii_lowercase());
        if !wanted.starts_with(&letters) {
            return Err(expected(at, word));
        }
        if !value.is_empty() {
            if letters != wanted {
                return Err(expected(at, word));
            }
            return Ok((parse_number(value).map_err(|what| BvhFault(at, what))?, at));
        }
    }
    let (mut at, mut word) = words.next().unwrap_or((words.text.len(), ""));
    if word == ":" {
        (at, word) = words.next().unwrap_or((words.text.len(), ""));
    }
    let word = word.strip_prefix(':').unwrap_or(word);
    let value = parse_number(word).map_err(|what| BvhFault(at, format!("{shown} {what}")))?;
    Ok((value, start.unwrap_or(at)))
}

/// Everything after the head, which says that there are so many `frames`, in radians and centimetres.
pub fn values(
    words: &mut Tokens,
    joints: &[Joint],
    unit: f64,
    frames: f64,
) -> std::result::Result<Vec<f64>, BvhFault> {
    let scales: Vec<f64> = joints
        .iter()
        .flat_map(|j| &j.channels)
        .map(|c| {
            if c.is_angle() {
                1f64.to_radians()
            } else {
                unit
            }
        })
        .collect();
    check_lines(&words.text[words.at..], words.at, scales.len(), frames)?;
    let mut out = Vec::new();
    let mut channel = 0;
    while let Some((at, word)) = words.next() {
        let value = bounded(word).map_err(|what| {
            let frame = out.len() / scales.len().max(1) + 1;
            BvhFault(at, format!("frame {frame}, value {}: {what}", channel + 1))
        })?;
        let Some(scale) = scales.get(channel) else {
            return Err(BvhFault(at, "values, but no joint has channels".into()));
        };
        out.push(value * scale);
        channel = (channel + 1) % scales.len();
    }
    Ok(out)
}

/// Where frames have lines of their own, as many as the file says or most of the lines, one with too few or too many values
/// would shift all after it. (The last may be cut off, and frames may be laid out otherwise: then values count alone.)
fn check_lines(
    text: &str,
    start: usize,
    width: usize,
    frames: f64,
) -> std::result::Result<(), BvhFault> {
    let mut at = start;
    let mut lines = Vec::new();
    for line in text.split_inclusive(['\n', '\r']) {
        let count = line.split_ascii_whitespace().count();
        if count > 0 {
            lines.push((at, count));
        }
        at += line.len();
    }
    let exact = lines.iter().filter(|(_, count)| *count == width).count();
    if width == 0 || !(lines.len() as f64 == frames || 2 * exact > lines.len()) {
        return Ok(());
    }
    for (i, (at, count)) in lines.iter().enumerate() {
        let is_cut_off = i + 1 == lines.len() && *count < width;
        if count % width != 0 && !is_cut_off {
            let what = format!("frame {}: expected {width} values, found {count}", i + 1);
            return Err(BvhFault(*at, what));
        }
    }
    Ok(())
}
