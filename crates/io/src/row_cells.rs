//! The cells of a row of text: parted by one byte, which may stand within quotes too.

use std::borrow::Cow;

/// The cells of a row, with their quotes; there is at least one.
pub(crate) fn cells_of(row: &[u8], separator: u8) -> impl Iterator<Item = &[u8]> {
    let mut rest = Some(row);
    std::iter::from_fn(move || {
        let row = rest?;
        let mut is_quoted = false;
        let end = row.iter().position(|b| {
            is_quoted ^= *b == b'"';
            *b == separator && !is_quoted
        });
        // A quote that is never closed is a sign like any other.
        let end = match end {
            None if is_quoted => row.iter().position(|b| *b == separator),
            end => end,
        };
        rest = end.map(|end| &row[end + 1..]);
        Some(&row[..end.unwrap_or(row.len())])
    })
}

/// The cells of a line of text, without blanks around them and without quotes.
pub(crate) fn texts_of(line: &str, separator: u8) -> Vec<Cow<'_, str>> {
    // The separator is ASCII: what stands between two is text.
    let text = |cell| unquoted(std::str::from_utf8(cell).unwrap_or_default().trim());
    cells_of(line.as_bytes(), separator).map(text).collect()
}

fn unquoted(cell: &str) -> Cow<'_, str> {
    let inner = cell.strip_prefix('"').and_then(|c| c.strip_suffix('"'));
    match inner {
        Some(inner) if inner.contains('"') => Cow::Owned(inner.replace("\"\"", "\"")),
        Some(inner) => Cow::Borrowed(inner.trim()),
        None => Cow::Borrowed(cell),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separators_within_quotes_part_nothing() {
        let cells = texts_of(" a ,\"b,c\",\"say \"\"x\"\"\",,\"1.5 \"", b',');
        assert_eq!(cells, ["a", "b,c", "say \"x\"", "", "1.5"]);
        assert_eq!(texts_of("", b','), [""]);
        assert_eq!(texts_of("a\"b,c", b','), ["a\"b", "c"]);
    }
}
