//! Escaping of text in HTML, XML and JSON inside a page, and templates.

use base64::prelude::{BASE64_STANDARD, Engine};
use sha2::{Digest, Sha256};
use std::fmt::Write;

/// Text for an element or a quoted attribute, in HTML and in XML alike.
///
/// Control characters are replaced: XML 1.0 forbids them even when escaped.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\t' | '\n' => out.push(' '),
            '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// JSON that may stand inside `<script type="application/json">`: no `<` is left in it, so that
/// neither `</script>` nor `<!--` can end or open anything. (In JSON, `<` occurs only inside
/// strings.)
pub fn script_json(value: &serde_json::Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

/// Replaces each `{{name}}` of a template by its value, in one pass: what a value contains is never
/// read again.
pub(crate) fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let length = values.iter().map(|(_, value)| value.len()).sum::<usize>();
    let mut out = String::with_capacity(template.len() + length);
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        out.push_str(before);
        let Some((name, after)) = after.split_once("}}") else {
            out.push_str("{{");
            rest = after;
            break;
        };
        out.push_str(
            values
                .iter()
                .find(|(n, _)| *n == name)
                .map_or("", |(_, v)| v),
        );
        rest = after;
    }
    out.push_str(rest);
    out
}

/// A source's hash as a content security policy wants it.
pub fn policy_hash(source: &str) -> String {
    format!(
        "sha256-{}",
        BASE64_STANDARD.encode(Sha256::digest(source.as_bytes()))
    )
}

/// A page of a template: its values, its style and its script with their hashes, and the version.
pub fn page(template: &str, style: &str, script: &str, values: &[(&str, &str)]) -> String {
    let (style_hash, script_hash) = (policy_hash(style), policy_hash(script));
    let own = [
        ("style", style),
        ("style-hash", &style_hash),
        ("script", script),
        ("script-hash", &script_hash),
        ("version", env!("CARGO_PKG_VERSION")),
    ];
    fill(template, &[values, &own].concat())
}

/// Rows as an HTML table; the first is its head. A cell that ends in `*` is marked as the best.
pub fn table(rows: &[Vec<String>]) -> String {
    let mut out = String::from("<div class=\"wide\"><table>");
    for (i, row) in rows.iter().enumerate() {
        out += "<tr>";
        for (k, cell) in row.iter().enumerate() {
            let tag = if i == 0 || k == 0 { "th" } else { "td" };
            let best = if cell.ends_with('*') {
                " class=\"best\""
            } else {
                ""
            };
            // Writing to memory cannot fail.
            let _ = write!(
                out,
                "<{tag}{best}>{}</{tag}>",
                escape(cell.trim_end_matches(['*', ' ']))
            );
        }
        out += "</tr>";
    }
    out + "</table></div>"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_what_could_break_out() {
        assert_eq!(
            escape("<a b='c'>&\"\u{1}"),
            "&lt;a b=&#39;c&#39;&gt;&amp;&quot;\u{fffd}"
        );
        let json = script_json(&serde_json::json!({"n</script><!--": "</script>"}));
        assert!(!json.contains('<'));
        let back: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(back["n</script><!--"], "</script>");
    }

    #[test]
    fn fills_in_one_pass() {
        assert_eq!(
            fill("{{a}}-{{b}}-{{c}}", &[("a", "{{b}}"), ("b", "x")]),
            "{{b}}-x-"
        );
        assert_eq!(fill("a {{ b", &[]), "a {{ b");
    }
}
