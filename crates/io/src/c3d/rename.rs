//! The points of a C3D file named anew: its parameters with other labels, which lose their
//! description, all else as it is.

use super::numbers::Processor;
use super::parameters::{Entry, Parameters, Value};
use super::write::{LONGEST_NAME, MOST_BLOCKS, label_parameters};
use super::{BLOCK, C3d, parameter_section};
use crate::{Error, Place, Result};
use std::ops::Range;

/// The first byte of the word of the header that says in which block the frames begin.
const START: usize = 16;

impl C3d {
    /// The bytes of the file with other names of some of its points.
    ///
    /// # Errors
    /// [`Error::Data`]: a name, or all of them, are too long for the format.
    pub(crate) fn with_names(&self, names: &[(usize, String)]) -> Result<Vec<u8>> {
        let place = |e: Error| e.at(Place::file(&self.take.name));
        let (processor, section) = parameter_section(&self.bytes, &mut Vec::new())?;
        let first = self.bytes.len() - section.len();
        let room = self.layout.start.saturating_sub(first);
        if room < BLOCK {
            let what = "has its frames before its parameters: its points cannot be named";
            return Err(place(what.into()));
        }
        let mut all = labels(&section[..room], processor).map_err(place)?;
        all.resize(all.len().max(self.layout.points), String::new());
        for (point, name) in names {
            all[*point].clone_from(name);
        }
        let mut own = with_labels(&section[..room], processor, &all).map_err(place)?;
        let blocks = own.len().div_ceil(BLOCK).max(room / BLOCK);
        if blocks > MOST_BLOCKS {
            return Err(place("has no room for such long names".into()));
        }
        own.resize(blocks * BLOCK, 0);
        own[2] = blocks as u8;
        let mut head = self.bytes[..first].to_vec();
        let later = (blocks - room / BLOCK) as u16;
        if later > 0 {
            // 0 says nothing.
            let add = |bytes: &mut [u8]| match processor.u16([bytes[0], bytes[1]]) {
                0 => Some(()),
                start => {
                    let start = processor.u16_bytes(start.checked_add(later)?);
                    bytes[..2].copy_from_slice(&start);
                    Some(())
                }
            };
            let said = entries(&own, processor).map_err(place)?;
            let group = point_group(&said);
            let is_start =
                |e: &&StoredEntry| Some(e.entry.group) == group && e.entry.name == "DATA_START";
            let data = said
                .iter()
                .find(is_start)
                .and_then(|e| e.entry.data(&own, 2));
            let data = data.filter(|data| data.len() >= 2);
            let moved = data.is_none_or(|data| add(&mut own[data]).is_some());
            if !moved || add(&mut head[START..START + 2]).is_none() {
                return Err(place("has no room for such long names".into()));
            }
        }
        Ok([&head, &own, &self.bytes[first + room..]].concat())
    }
}

/// An entry of a section of parameters and the bytes that it takes.
struct StoredEntry {
    entry: Entry,
    bytes: Range<usize>,
}

/// The entries of a section.
///
/// # Errors
/// The entries cannot be followed to their end.
fn entries(section: &[u8], processor: Processor) -> Result<Vec<StoredEntry>> {
    if Parameters::read(section, processor).broken.is_some() {
        return Err("has damaged parameters: its points cannot be named".into());
    }
    let mut all = Vec::new();
    let mut at = 4;
    while let Some(entry) = Entry::at(section, at, processor) {
        let next = entry.next.filter(|next| *next > at);
        let end = next
            .or(entry.end(section))
            .filter(|end| *end <= section.len());
        let end = end.ok_or("has damaged parameters: its points cannot be named")?;
        all.push(StoredEntry {
            entry,
            bytes: at..end,
        });
        match next {
            Some(next) => at = next,
            None => break,
        }
    }
    Ok(all)
}

/// Whether a parameter lists labels of points: LABELS, LABELS2 and so on.
fn is_labels(entry: &Entry) -> bool {
    let number = entry.name.strip_prefix("LABELS");
    entry.value.is_some() && number.is_some_and(|n| n.bytes().all(|b| b.is_ascii_digit()))
}

/// The number of the group POINT.
fn point_group(all: &[StoredEntry]) -> Option<u8> {
    let group = all
        .iter()
        .find(|e| e.entry.value.is_none() && e.entry.name == "POINT");
    group.map(|e| e.entry.group)
}

/// Labels of points, also of those that the file does not have.
fn labels(section: &[u8], processor: Processor) -> Result<Vec<String>> {
    let all = entries(section, processor)?;
    let group = point_group(&all);
    let is_own = |e: &StoredEntry| Some(e.entry.group) == group && is_labels(&e.entry);
    let mut own: Vec<Entry> = all.into_iter().filter(is_own).map(|e| e.entry).collect();
    own.sort_by_key(|e| (e.name.len(), e.name.clone()));
    let texts = own.into_iter().filter_map(|e| match e.value {
        Some(Value::Text(texts)) => Some(texts),
        _ => None,
    });
    Ok(texts.flatten().collect())
}

/// A section with these labels of points in place of its own.
fn with_labels(section: &[u8], processor: Processor, labels: &[String]) -> Result<Vec<u8>> {
    if let Some(long) = labels.iter().find(|l| l.len() > LONGEST_NAME) {
        return Err(format!("has no room for so long a name as {long}").into());
    }
    let all = entries(section, processor)?;
    let group = point_group(&all).ok_or("has no parameters of points: they cannot be named")?;
    let is_own = |e: &StoredEntry| e.entry.group == group && is_labels(&e.entry);
    // Where they stood, else behind their group.
    let is_group = |e: &StoredEntry| e.entry.group == group && e.entry.value.is_none();
    let index = all.iter().position(is_own);
    let index = index.or(all.iter().position(is_group).map(|at| at + 1));
    let mut out = section[..4].to_vec();
    for (n, stored) in all.iter().enumerate() {
        if Some(n) == index {
            out.extend(label_entries(group, processor, labels)?);
        }
        if !is_own(stored) {
            let (first, offset) = (out.len(), stored.entry.offset_at - stored.bytes.start);
            out.extend(&section[stored.bytes.clone()]);
            // The last one may lead nowhere.
            let length = stored.bytes.len() - offset;
            let length = u16::try_from(length).map_err(|_| "has damaged parameters")?;
            out[first + offset..first + offset + 2].copy_from_slice(&processor.u16_bytes(length));
        }
    }
    if index == Some(all.len()) {
        out.extend(label_entries(group, processor, labels)?);
    }
    // The last entry leads to these two zeros.
    out.extend([0, 0]);
    Ok(out)
}

/// The entries LABELS, LABELS2 and so on of a group.
fn label_entries(group: u8, processor: Processor, labels: &[String]) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    for (name, value) in label_parameters(labels) {
        out.extend([name.len() as u8, group]);
        out.extend(name.as_bytes());
        // Behind the offset the value, and a description of no length.
        let offset = u16::try_from(2 + value.len() + 1);
        let offset = offset.map_err(|_| "has no room for such long names")?;
        out.extend(processor.u16_bytes(offset));
        out.extend(value);
        out.push(0);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::super::write::NewC3d;
    use super::*;
    use crate::Input;
    use ndarray::Array2;

    fn read(bytes: Vec<u8>) -> C3d {
        C3d::read(
            Input::new("take.c3d".to_string(), std::io::Cursor::new(bytes)).unwrap(),
            false,
        )
        .unwrap()
    }

    #[test]
    fn points_are_named_anew_and_all_else_stays() {
        for count in [3, 300] {
            let points: Vec<String> = (0..count).map(|n| format!("*{n}")).collect();
            let xyz = Array2::from_shape_fn((4, 3 * count), |(t, c)| (t * 7 + c) as f64 / 3.0);
            let new = NewC3d {
                points: &points,
                rate: 100.0,
                first_frame: 5,
                units: "mm",
                screen: ["+X", "+Z"],
            };
            let c3d = read(new.bytes(xyz.view()).unwrap());
            let long = "a name that is far longer than those were".to_string();
            for name in ["L".to_string(), long] {
                let names = [(1, name.clone()), (count - 1, "R".into())];
                let renamed = read(c3d.with_names(&names).unwrap());
                let mut want = points.clone();
                (want[1], want[count - 1]) = (name, "R".into());
                assert_eq!(renamed.take.points, want);
                assert_eq!(renamed.take.xyz, c3d.take.xyz);
                assert_eq!(
                    (renamed.take.rate, renamed.take.first_frame),
                    (Some(100.0), 5)
                );
                assert_eq!(renamed.take.units, c3d.take.units);
                assert_eq!(renamed.take.notes, Vec::<String>::new());
            }
            let error = c3d
                .with_names(&[(0, "x".repeat(256))])
                .unwrap_err()
                .to_string();
            assert!(error.contains("so long a name"), "{error}");
        }
    }
}
