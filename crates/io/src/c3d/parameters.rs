//! The parameter section of a C3D file: groups of named values.

use super::numbers::Processor;
use std::collections::HashMap;
use std::ops::Range;

/// The type of a parameter of texts.
pub(super) const TEXT: u8 = -1_i8 as u8;

/// The values of the parameters of a file, by `GROUP:NAME` in capitals.
#[derive(Debug, Clone, Default)]
pub(crate) struct Parameters {
    values: HashMap<String, Value>,
    /// Where the parameters cannot be followed further, and why.
    pub broken: Option<String>,
}

/// The value of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    /// Strings, without the blanks at their ends.
    Text(Vec<String>),
    /// Integers (those of 16 bits without their sign: counts go up to 65,535) and reals.
    Numbers(Vec<f64>),
}

impl Parameters {
    /// Follows the parameters of a section, which begins with its head of four bytes.
    pub(crate) fn read(section: &[u8], processor: Processor) -> Parameters {
        let mut parameters = Parameters::default();
        let mut groups: HashMap<u8, String> = HashMap::new();
        let mut entries: Vec<(u8, String, Value)> = Vec::new();
        let mut at = 4;
        loop {
            let entry = match Entry::read(section, at, processor) {
                Ok(Some(entry)) => entry,
                Ok(None) => break,
                Err(what) => {
                    parameters.broken = Some(format!("byte {at} of the parameters: {what}"));
                    break;
                }
            };
            match entry.value {
                None => drop(groups.insert(entry.group, entry.name)),
                Some(value) => entries.push((entry.group, entry.name, value)),
            }
            let Some(next) = entry.next else { break };
            at = next;
        }
        for (group, name, value) in entries {
            let group = groups.get(&group).map_or("", String::as_str);
            parameters
                .values
                .entry(format!("{group}:{name}"))
                .or_insert(value);
        }
        parameters
    }

    /// Whether there is a parameter of this group.
    pub(crate) fn has_group(&self, group: &str) -> bool {
        let mut names = self.values.keys().filter_map(|name| name.split_once(':'));
        names.any(|(of, _)| of == group)
    }

    /// The first number of a parameter.
    pub(crate) fn number(&self, name: &str) -> Option<f64> {
        match self.values.get(name)? {
            Value::Numbers(numbers) => numbers.first().copied(),
            Value::Text(_) => None,
        }
    }

    /// The numbers of a parameter; none where it is not there.
    pub(crate) fn numbers(&self, name: &str) -> &[f64] {
        match self.values.get(name) {
            Some(Value::Numbers(numbers)) => numbers,
            _ => &[],
        }
    }

    /// The parameters of a group that are numbers, by their names in the group, in no order.
    pub(crate) fn numbers_of<'a>(
        &'a self,
        group: &'a str,
    ) -> impl Iterator<Item = (&'a str, &'a [f64])> {
        let of = move |(name, value): (&'a String, &'a Value)| {
            let own = name.strip_prefix(group)?.strip_prefix(':')?;
            match value {
                Value::Numbers(numbers) => Some((own, numbers.as_slice())),
                Value::Text(_) => None,
            }
        };
        self.values.iter().filter_map(of)
    }

    /// The first string of a parameter, if it says anything.
    pub(crate) fn text(&self, name: &str) -> Option<&str> {
        let first = self.texts(name).first()?;
        Some(first.as_str()).filter(|text| !text.is_empty())
    }

    /// The strings of a parameter; none where it is not there.
    pub(crate) fn texts(&self, name: &str) -> &[String] {
        match self.values.get(name) {
            Some(Value::Text(texts)) => texts,
            _ => &[],
        }
    }

    /// The strings of a parameter, and of those that continue it: NAME2 and so on.
    pub(crate) fn all_texts<'a>(&'a self, name: &str) -> impl Iterator<Item = &'a str> + use<'a> {
        let names = continued(name);
        let texts = names.map(|name| self.texts(&name));
        let texts = texts.take_while(|texts| !texts.is_empty());
        texts.flatten().map(String::as_str)
    }

    /// The numbers of a parameter, and of those that continue it: NAME2 and so on.
    pub(crate) fn all_numbers(&self, name: &str) -> Vec<f64> {
        let numbers = continued(name).map(|name| self.numbers(&name));
        let numbers = numbers.take_while(|numbers| !numbers.is_empty());
        numbers.flatten().copied().collect()
    }
}

/// The names of a parameter and of those that continue it, without end.
pub(super) fn continued(name: &str) -> impl Iterator<Item = String> + use<> {
    let name = name.to_string();
    let more = (2..).map(|i| i.to_string());
    let numbers = std::iter::once(String::new()).chain(more);
    numbers.map(move |number| format!("{name}{number}"))
}

/// A group, which has no value, or a parameter.
#[derive(Debug)]
pub(super) struct Entry {
    /// The number of the group, or of the parameter's group.
    pub group: u8,
    pub name: String,
    pub value: Option<Value>,
    /// Where the next entry begins; `None` after the last.
    pub next: Option<usize>,
    /// Where the offset of the next entry stands, behind its name.
    pub offset_at: usize,
}

impl Entry {
    /// The entry at a byte of the section; `None` at its end, and where it is damaged.
    pub(super) fn at(section: &[u8], at: usize, processor: Processor) -> Option<Entry> {
        Entry::read(section, at, processor).ok().flatten()
    }

    /// The entry at a byte of the section; `None` at its end.
    fn read(section: &[u8], at: usize, processor: Processor) -> Result<Option<Entry>, String> {
        let Some(head) = section.get(at..at + 2) else {
            return Ok(None);
        };
        // A locked name has a negative length, a group a negative number.
        let (length, number) = ((head[0] as i8).unsigned_abs() as usize, head[1] as i8);
        if length == 0 || number == 0 {
            return Ok(None);
        }
        let cut = || "the section ends within an entry".to_string();
        let name = section.get(at + 2..at + 2 + length).ok_or_else(cut)?;
        let name = text(name).to_ascii_uppercase();
        let after = at + 2 + length;
        let offset = section.get(after..after + 2).ok_or_else(cut)?;
        let offset = processor.u16([offset[0], offset[1]]) as usize;
        let next = (offset > 0).then_some(after + offset);
        let value = if number > 0 {
            Some(value(
                section.get(after + 2..).unwrap_or_default(),
                processor,
                &name,
            )?)
        } else {
            None
        };
        Ok(Some(Entry {
            group: number.unsigned_abs(),
            name,
            value,
            next,
            offset_at: after,
        }))
    }

    /// The byte behind its description, by its own length.
    pub(super) fn end(&self, section: &[u8]) -> Option<usize> {
        let at = match self.value {
            None => self.offset_at + 2,
            Some(_) => kind_and_data(section, self.offset_at)?.1.end,
        };
        let end = at + 1 + *section.get(at)? as usize;
        (end <= section.len()).then_some(end)
    }
}

/// The type of a parameter whose offset stands at a byte of the section, and the bytes of its
/// value, which may lead beyond the section.
pub(super) fn kind_and_data(section: &[u8], offset_at: usize) -> Option<(u8, Range<usize>)> {
    let at = offset_at + 2;
    let (kind, sizes) = (*section.get(at)?, *section.get(at + 1)? as usize);
    let sizes = section.get(at + 2..at + 2 + sizes)?;
    let each = if kind == 2 || kind == 4 { kind } else { 1 };
    let mut sizes_and_each = sizes.iter().chain([&each]);
    let bytes = sizes_and_each.try_fold(1_usize, |n, s| n.checked_mul(*s as usize))?;
    let first = at + 2 + sizes.len();
    Some((kind, first..first.checked_add(bytes)?))
}

/// The value that begins with its type and its dimensions.
fn value(bytes: &[u8], processor: Processor, name: &str) -> Result<Value, String> {
    let cut = || format!("the section ends within {name}");
    let (kind, count) = match bytes {
        [kind, count, ..] => (*kind as i8, *count as usize),
        _ => return Err(cut()),
    };
    let sizes = bytes.get(2..2 + count).ok_or_else(cut)?;
    let items: usize = sizes
        .iter()
        .try_fold(1_usize, |n, s| n.checked_mul(*s as usize))
        .ok_or_else(cut)?;
    let size = match kind {
        -1 | 1 => 1,
        2 => 2,
        4 => 4,
        _ => {
            return Err(format!(
                "{name} has the type {kind}, expected -1, 1, 2 or 4"
            ));
        }
    };
    let rest = &bytes[2 + count..];
    let all = items.checked_mul(size).ok_or_else(cut)?;
    let data = rest.get(..all).ok_or_else(cut)?;
    Ok(match kind {
        -1 => {
            let each = sizes.first().map_or(1, |s| *s as usize);
            Value::Text(data.chunks(each.max(1)).map(text).collect())
        }
        1 => Value::Numbers(data.iter().map(|b| f64::from(*b)).collect()),
        2 => Value::Numbers(
            data.chunks_exact(2)
                .map(|b| f64::from(processor.u16([b[0], b[1]])))
                .collect(),
        ),
        _ => Value::Numbers(
            data.chunks_exact(4)
                .map(|b| f64::from(processor.f32([b[0], b[1], b[2], b[3]])))
                .collect(),
        ),
    })
}

/// Text without control characters, and without blanks at its ends; bytes that are no UTF-8 are
/// taken for Latin-1.
pub(super) fn text(bytes: &[u8]) -> String {
    let whole: String = match std::str::from_utf8(bytes) {
        Ok(text) => text.to_string(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    };
    let shown: String = whole.chars().filter(|c| !c.is_control()).collect();
    shown.trim_matches(' ').to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_a_group_is_read() {
        for number in [1_u8, 127, 128] {
            let group = [
                &[1, 0, 0, 84][..],
                b"\x01",
                &[number.wrapping_neg()],
                b"G\x03\0\0",
            ];
            let mut section = group.concat();
            let is_positive = number < 128;
            if is_positive {
                section.extend([&[1, number][..], b"N\0\0\x01\0\x07"].concat());
            }
            let parameters = Parameters::read(&section, Processor::Intel);
            assert_eq!(parameters.broken, None);
            assert_eq!(parameters.number("G:N"), is_positive.then_some(7.0));
        }
    }
}
