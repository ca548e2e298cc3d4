//! Tables of the page of a session: values of both sides, scores, and how numbers are written.

use crate::draw::html::escape;
use crate::draw::text_table::short;
use crate::norm::GVS;
use crate::session::{Session, Spread};
use crate::side::Side;

/// The values of a cycle: key, words, unit.
pub(crate) const VALUES: [(&str, &str, &str); 12] = [
    ("walking_speed_m_per_s", "Walking speed", "m/s"),
    ("cadence_steps_per_min", "Cadence", "steps/min"),
    ("stride_time_s", "Stride time", "s"),
    ("stride_length_m", "Stride length", "m"),
    ("step_time_s", "Step time", "s"),
    ("step_length_m", "Step length", "m"),
    ("step_width_m", "Step width", "m"),
    ("foot_off_percent", "Foot off", "% of cycle"),
    (
        "opposite_foot_off_percent",
        "Opposite foot off",
        "% of cycle",
    ),
    (
        "opposite_foot_strike_percent",
        "Opposite foot strike",
        "% of cycle",
    ),
    ("single_support_s", "Single support", "s"),
    ("double_support_s", "Double support", "s"),
];

/// Three digits that count; a dash where it is not known.
pub(crate) fn number(value: Option<f64>) -> String {
    match value.filter(|v| v.is_finite()) {
        None => "\u{2013}".into(),
        Some(v) if v.abs() < 5e-4 => "0".into(),
        Some(v) => short(v).replace('-', "\u{2212}"),
    }
}

/// A table of cells that are HTML; the first row is its head, the first `names` columns are text.
pub(crate) fn table(names: usize, head: &[&str], rows: &[Vec<String>]) -> String {
    let row = |tag: &str, cells: &[String]| {
        let cell = |(i, cell): (usize, &String)| {
            let tag = if i == 0 { "th" } else { tag };
            let class = if i < names { " class=\"name\"" } else { "" };
            format!("<{tag}{class}>{cell}</{tag}>")
        };
        format!(
            "<tr>{}</tr>",
            cells.iter().enumerate().map(cell).collect::<String>()
        )
    };
    let head: Vec<String> = head.iter().map(|cell| escape(cell)).collect();
    let body: String = rows.iter().map(|cells| row("td", cells)).collect();
    format!(
        "<div class=\"wide\"><table><thead>{}</thead><tbody>{body}</tbody></table></div>\n",
        row("th", &head)
    )
}

/// The values of both sides.
pub(crate) fn values(session: &Session) -> String {
    let [left, right] = Side::BOTH.map(|side| session.values(side));
    let symmetry = session.symmetry();
    let spread = |of: Option<&Spread>| match of {
        Some(s) if s.sd.is_finite() => {
            format!(
                "{} <small>({})</small>",
                number(Some(s.mean)),
                number(Some(s.sd))
            )
        }
        of => number(of.map(|s| s.mean)),
    };
    let row = |(key, words, unit): &(&str, &str, &str)| {
        let sides = [left.get(key), right.get(key)];
        let cells = || {
            let name = format!("{words} <small>{unit}</small>");
            let [left, right] = sides.map(spread);
            vec![name, left, right, number(symmetry.get(key).copied())]
        };
        sides.iter().any(Option::is_some).then(cells)
    };
    let rows: Vec<Vec<String>> = VALUES.iter().filter_map(row).collect();
    let cycles = Side::BOTH.map(|side| session.cycles(side));
    if rows.is_empty() {
        return "<section id=\"values\"><h2>Values</h2><p>No whole cycle.</p></section>\n".into();
    }
    format!(
        "<section id=\"values\"><h2>Values</h2><p>Mean (standard deviation) of {} left and {} \
         right cycles; the difference of both sides is in percent of their mean, 0 is alike.</p>{}\
         </section>\n",
        cycles[0],
        cycles[1],
        table(1, &["Value", "Left", "Right", "Difference, %"], &rows)
    )
}

/// The scores against the norm; empty without one.
pub(crate) fn scores(session: &Session) -> String {
    let Some((file, norm)) = &session.norm else {
        return String::new();
    };
    let about = format!("Norm: {}, of {} cycles.", escape(file), norm.cycles);
    let (text, table) = match session.scores() {
        None => ("No scores: a side has no whole cycle.", String::new()),
        Some((scores, profile)) => {
            let of = |(k, (name, ..)): (usize, &(&str, &str, usize))| {
                let [left, right] = [0, 1].map(|side| number(Some(scores[side][k])));
                vec![capital(&name.replace('_', " ")), left, right, String::new()]
            };
            let mut rows: Vec<Vec<String>> = GVS.iter().enumerate().map(of).collect();
            let all = [profile.left, profile.right, profile.overall];
            let all = all.map(|v| format!("<b>{}</b>", number(Some(v))));
            rows.push([&["<b>Gait profile score</b>".to_string()], &all[..]].concat());
            let text = "How far the mean cycle is from the norm, root mean square over the cycle, \
                        degrees. The overall score counts the pelvis once.";
            (
                text,
                table(1, &["Angle", "Left", "Right", "Overall"], &rows),
            )
        }
    };
    format!(
        "<section id=\"scores\"><h2>Gait variable and profile scores</h2><p>{about} \
         {text}</p>{table}</section>\n"
    )
}

/// A text that begins with a capital.
pub(crate) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|c| c.to_ascii_uppercase());
    first.into_iter().chain(letters).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits() {
        let all = [1.23456, -0.0123456, 123.456, 1e-9, f64::NAN];
        let all: Vec<String> = all.into_iter().map(|v| number(Some(v))).collect();
        assert_eq!(all.join(" "), "1.23 −0.0123 123 0 –");
        assert_eq!(capital("pelvic tilt"), "Pelvic tilt");
    }
}
