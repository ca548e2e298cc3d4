//! The column of times of a table with other numbers; the text of all else stays.

use crate::text::push_f64;
use std::ops::Range;

/// The bytes of a table as CSV, with other numbers in its column `time`: those of `times`, a row
/// each. Every other byte stays, as do rows beyond these. `None` of a table without that column.
pub fn with_times(table: &[u8], times: &[f64]) -> Option<Vec<u8>> {
    let mut cells = Cells::new(table);
    let header = cells.record()?;
    let is_time = |cell: &Range<usize>| {
        let name = table[cell.clone()].trim_ascii();
        let name = name.strip_prefix(b"\xef\xbb\xbf").unwrap_or(name);
        name == b"time" || name == b"\"time\""
    };
    let column = header.iter().position(is_time)?;
    let (mut out, mut copied) = (Vec::with_capacity(table.len()), 0);
    for time in times {
        let Some(cell) = cells.record().and_then(|cells| cells.get(column).cloned()) else {
            break;
        };
        out.extend_from_slice(&table[copied..cell.start]);
        push_f64(&mut out, *time);
        copied = cell.end;
    }
    out.extend_from_slice(&table[copied..]);
    Some(out)
}

/// Records of a table, one after another, by where their cells are.
struct Cells<'a> {
    table: &'a [u8],
    at: usize,
}

impl<'a> Cells<'a> {
    fn new(table: &'a [u8]) -> Cells<'a> {
        Cells { table, at: 0 }
    }

    /// The cells of the next record that is not blank, quotes and all; `None` at the end.
    fn record(&mut self) -> Option<Vec<Range<usize>>> {
        let is_end = |b: u8| matches!(b, b'\r' | b'\n');
        while self.table.get(self.at).is_some_and(|b| is_end(*b)) {
            self.at += 1;
        }
        let (mut cells, mut start, mut is_quoted) = (Vec::new(), self.at, false);
        if start >= self.table.len() {
            return None;
        }
        loop {
            match self.table.get(self.at) {
                Some(b'"') => is_quoted = !is_quoted,
                Some(b',') if !is_quoted => {
                    cells.push(start..self.at);
                    start = self.at + 1;
                }
                Some(b) if is_quoted || !is_end(*b) => {}
                _ => break,
            }
            self.at += 1;
        }
        cells.push(start..self.at);
        Some(cells)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_times_change() {
        let table = "\u{feff}take,\"time\",a.x,a.y,a.z\r\n\"a \"\"b\",0.10,1.500,-0,+2\r\n\r\n\
            \"line\nbreak\",0.20,,,1e0\r\nc,0.30,1,2,3";
        let got = with_times(table.as_bytes(), &[0.0, 0.25]).unwrap();
        let want = table.replace("0.10", "0").replace("0.20", "0.25");
        assert_eq!(String::from_utf8(got).unwrap(), want);
        let more = with_times(b"time,a.x\n1,2", &[3.0, 4.0, 5.0]).unwrap();
        assert_eq!(more, b"time,a.x\n3,2");
        assert!(with_times(b"a.x,a.y\n1,2", &[3.0]).is_none());
        assert!(with_times(b"", &[]).is_none());
    }
}
