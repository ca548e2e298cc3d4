//! The shapes and colors of stick figures in SVG.

use crate::scene::Status;

pub(crate) const INK: &str = "#39424e";
pub(crate) const PALE: &str = "#6b7684";
pub(crate) const LEFT: &str = "#1f6fb4";
pub(crate) const RIGHT: &str = "#d1622b";
/// Overlaid figures, and their right limbs.
pub(crate) const FIGURES: [(&str, &str); 6] = [
    ("#2b3440", "#8b949f"),
    ("#d1462f", "#ee9c8c"),
    ("#1f78b4", "#8dbfe0"),
    ("#2a8f5b", "#8fcbaa"),
    ("#a6761d", "#d9bb7f"),
    ("#b03a86", "#dc9ac5"),
];
pub(crate) const CHANGED: &str = "#0b8f83";
pub(crate) const INFERRED: &str = "#8a3ffc";
pub(crate) const REJECTED: &str = "#cf1039";
pub(crate) const UNKNOWN: &str = "#8b949f";

/// A position on the paper (px).
pub(crate) type At = [f64; 2];

/// A bone, dashed if an end was inferred; with a white edge, so that the nearer of two that cross
/// is seen.
pub(crate) fn stick(
    a: At,
    b: At,
    color: &str,
    thick: f64,
    ends: [Status; 2],
    edged: bool,
) -> String {
    let line = |a: At, b: At| format!("M{} {}L{} {}", n(a[0]), n(a[1]), n(b[0]), n(b[1]));
    let dashes = if ends.contains(&Status::Inferred) {
        format!(
            " stroke-dasharray=\"{} {}\"",
            n(thick * 1.6),
            n(thick * 1.1)
        )
    } else {
        " stroke-linecap=\"round\"".into()
    };
    let mut out = String::new();
    // The edge stops before the joints, where it would cut into the neighboring bones.
    let (long, free) = ((b[0] - a[0]).hypot(b[1] - a[1]), 2.4 * thick);
    if edged && long > 2.5 * free {
        let part = |t: f64| [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t];
        let (edge, wide) = (
            line(part(free / long), part(1.0 - free / long)),
            n(thick * 1.9),
        );
        out.push_str(&format!(
            "<path d=\"{edge}\" stroke=\"#fff\" stroke-width=\"{wide}\"/>"
        ));
    }
    let (line, wide) = (line(a, b), n(thick));
    out + &format!("<path d=\"{line}\" stroke=\"{color}\" stroke-width=\"{wide}\"{dashes}/>\n")
}

/// A point as its status wants it: plain, ringed, hollow, crossed.
pub(crate) fn dot([x, y]: [f64; 2], radius: f64, color: &str, status: Status) -> String {
    let (x, y, small) = (n(x), n(y), radius.min(4.0));
    let circle = |radius: f64, fill: &str, edge: &str| {
        let line = n((0.45 * small).max(1.2));
        let radius = n(radius);
        format!(
            "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" fill=\"{fill}\" stroke=\"{edge}\" \
             stroke-width=\"{line}\"/>"
        )
    };
    let grown = radius.max(small * 1.35);
    match status {
        Status::Observed => format!(
            "<circle cx=\"{x}\" cy=\"{y}\" r=\"{}\" fill=\"{color}\"/>\n",
            n(radius)
        ),
        Status::Changed => circle(grown, CHANGED, "#fff") + "\n",
        Status::Inferred => circle(grown, "#fff", INFERRED) + "\n",
        Status::Unknown => circle(grown, "#fff", UNKNOWN) + "\n",
        Status::Rejected => {
            let arm = n(small * 1.2);
            format!(
                "<path d=\"M{x} {y}m-{arm} -{arm}l{d} {d}m0 -{d}l-{d} {d}\" stroke=\"{REJECTED}\" \
                 stroke-width=\"1.6\"/>\n",
                d = n(small * 2.4)
            )
        }
    }
}

/// Text broken into lines of at most `most` characters, if its words allow.
pub(crate) fn wrapped(text: &str, most: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if (line.chars().count() + word.chars().count()) as f64 + 1.0 <= most => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_string()),
        }
    }
    lines
}

/// Text shortened to at most `most` characters.
pub(crate) fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_string();
    }
    text.chars()
        .take(most.saturating_sub(1))
        .chain(['…'])
        .collect()
}

/// A number of the picture: two decimals at most, and never `-0`.
pub(crate) fn n(value: f64) -> String {
    let text = format!("{value:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".into()
    } else {
        text.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_fitted() {
        assert_eq!(
            [3, 2, 0].map(|most| shortened("abc", most)),
            ["abc", "a…", "…"]
        );
        assert_eq!(wrapped("a bc  def g", 4.0), ["a bc", "def", "g"]);
        assert!(wrapped(" ", 4.0).is_empty());
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [1.0, 1.005, -0.001, 12.5, 100.0].map(n),
            ["1", "1", "0", "12.5", "100"]
        );
    }
}
