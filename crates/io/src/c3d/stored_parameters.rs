//! The parameters of a C3D file entry by entry, to be written back with some of them changed, all
//! else as it is.

use super::parameters::{Entry, Parameters, TEXT, continued, kind_and_data};
use super::write::{LONGEST_NAME, MOST_BLOCKS, MOST_ITEMS, text_value};
use super::{BLOCK, C3d, parameter_section};
use crate::Result;

/// The first byte of the word of the header that says in which block the frames begin.
const START: usize = 16;
/// The highest number of a group.
const MOST_GROUPS: u8 = 127;

/// The parameters of a file.
#[derive(Debug)]
pub(super) struct StoredParameters<'a> {
    file: &'a C3d,
    /// The first byte of their section, and its bytes up to the frames.
    first: usize,
    room: usize,
    entries: Vec<StoredEntry>,
}

/// A group or a parameter.
#[derive(Debug)]
struct StoredEntry {
    group: u8,
    name: String,
    is_group: bool,
    /// All of it, up to the next one.
    bytes: Vec<u8>,
    /// Where in `bytes` the offset of the next one stands, behind the name.
    offset_at: usize,
}

/// The items of a parameter, and of those that continue it, as they are stored.
#[derive(Debug, Default)]
pub(super) struct StoredItems {
    /// The type of the parameter: text (255), or the bytes of a number.
    pub kind: u8,
    /// The number of its dimensions.
    pub dimensions: u8,
    pub items: Vec<Vec<u8>>,
}

impl<'a> StoredParameters<'a> {
    /// Those of a file. `so` says in messages what cannot be done with the file then.
    ///
    /// # Errors
    /// The frames stand before the parameters, or these cannot be followed to their end.
    pub(super) fn of(file: &'a C3d, so: &str) -> Result<StoredParameters<'a>> {
        let (processor, section) = parameter_section(&file.bytes, &mut Vec::new())?;
        let first = file.bytes.len() - section.len();
        let room = file.layout.start.saturating_sub(first);
        if room < BLOCK {
            return Err(format!("has its frames before its parameters: {so}").into());
        }
        let section = &section[..room];
        let damaged = || format!("has damaged parameters: {so}");
        if Parameters::read(section, processor).broken.is_some() {
            return Err(damaged().into());
        }
        let mut parameters = StoredParameters {
            file,
            first,
            room,
            entries: Vec::new(),
        };
        let mut next = Some(4);
        while let Some((at, entry)) =
            next.and_then(|at| Some((at, Entry::at(section, at, processor)?)))
        {
            next = entry.next;
            let end = next.or(entry.end(section)).ok_or_else(damaged)?;
            let bytes = section.get(at..end).ok_or_else(damaged)?.to_vec();
            let is_group = entry.value.is_none();
            let name = &entry.name;
            let stored = parameters.entry(entry.group, name, is_group, bytes, entry.offset_at - at);
            parameters.entries.push(stored.map_err(|_| damaged())?);
        }
        Ok(parameters)
    }

    /// An entry whose offset leads to the byte behind it.
    fn entry(
        &self,
        group: u8,
        name: &str,
        is_group: bool,
        mut bytes: Vec<u8>,
        offset_at: usize,
    ) -> Result<StoredEntry> {
        let offset = bytes.len().checked_sub(offset_at);
        let offset = offset
            .and_then(|n| u16::try_from(n).ok())
            .filter(|n| *n >= 2);
        let offset = offset.ok_or("has no room for such long names")?;
        let offset = self.file.layout.processor.u16_bytes(offset);
        bytes[offset_at..offset_at + 2].copy_from_slice(&offset);
        Ok(StoredEntry {
            group,
            name: name.to_string(),
            is_group,
            bytes,
            offset_at,
        })
    }

    /// The number of a group.
    pub(super) fn group(&self, name: &str) -> Option<u8> {
        let group = self.entries.iter().find(|e| e.is_group && e.name == name);
        group.map(|e| e.group)
    }

    /// Makes a group; its number.
    ///
    /// # Errors
    /// No number is left.
    pub(super) fn add_group(&mut self, name: &str) -> Result<u8> {
        let is_free = |number: &u8| self.entries.iter().all(|e| e.group != *number);
        let number = (1..=MOST_GROUPS)
            .find(is_free)
            .ok_or("has no room for another group")?;
        let head = [name.len() as u8, number.wrapping_neg()];
        let bytes = [&head, name.as_bytes(), &[0; 3]].concat();
        self.entries
            .push(self.entry(number, name, true, bytes, 2 + name.len())?);
        Ok(number)
    }

    /// The parameter and those that continue it (NAME2 and so on), the first one first.
    fn parameters(&self, group: u8, name: &str) -> Vec<&StoredEntry> {
        let own = self.entries.iter().filter(|e| e.continues(group, name));
        let mut own: Vec<&StoredEntry> = own.collect();
        own.sort_by_key(|e| (e.name.len(), &e.name));
        own
    }

    /// The items of a parameter, and of those that continue it: texts, or `numbers` numbers each.
    pub(super) fn items(&self, group: u8, name: &str, numbers: usize) -> Option<StoredItems> {
        let own = self.parameters(group, name);
        let mut all = StoredItems::default();
        for entry in &own {
            let Some((kind, data)) = kind_and_data(&entry.bytes, entry.offset_at) else {
                continue;
            };
            let sizes = &entry.bytes[entry.offset_at + 3..data.start];
            (all.kind, all.dimensions) = (kind, sizes[0]);
            let width = match kind {
                TEXT => sizes.get(1).map_or(1, |width| *width as usize),
                _ => kind as usize * numbers,
            };
            let data = entry.bytes.get(data).unwrap_or_default();
            all.items
                .extend(data.chunks_exact(width.max(1)).map(<[u8]>::to_vec));
        }
        (!own.is_empty()).then_some(all)
    }

    /// The texts of a parameter, and of those that continue it, as they are stored.
    pub(super) fn texts(&self, group: u8, name: &str) -> Option<Vec<Vec<u8>>> {
        let all = self.items(group, name, 1).filter(|all| all.kind == TEXT);
        all.map(|all| all.items)
    }

    /// What stands behind the value of a parameter: its description after the length of that.
    fn description(&self, group: u8, name: &str) -> Vec<u8> {
        let own = self.parameters(group, name);
        let description = own.first().and_then(|e| {
            let (_, data) = kind_and_data(&e.bytes, e.offset_at)?;
            e.bytes.get(data.end..).filter(|rest| !rest.is_empty())
        });
        description.unwrap_or(&[0]).to_vec()
    }

    /// Puts values in place of a parameter and of those that continue it, else behind their group.
    /// The first keeps its description.
    ///
    /// # Errors
    /// A value is too long.
    pub(super) fn set(&mut self, group: u8, name: &str, values: Vec<Vec<u8>>) -> Result<()> {
        let description = self.description(group, name);
        self.set_described(group, name, values, &description)
    }

    /// As [`StoredParameters::set`], with another description, behind its length.
    pub(super) fn set_described(
        &mut self,
        group: u8,
        name: &str,
        values: Vec<Vec<u8>>,
        description: &[u8],
    ) -> Result<()> {
        let mut new = Vec::new();
        // The length of the name of a locked parameter is below zero.
        let old = self.entries.iter().find(|e| e.continues(group, name));
        let is_locked = old.is_some_and(|e| (e.bytes[0] as i8) < 0);
        for (n, (name, value)) in continued(name).zip(values).enumerate() {
            let description = if n == 0 { description } else { &[0] };
            let length = name.len() as u8;
            let length = if is_locked {
                length.wrapping_neg()
            } else {
                length
            };
            let head = [length, group];
            let bytes = [&head, name.as_bytes(), &[0; 2], &value, description].concat();
            new.push(self.entry(group, &name, false, bytes, 2 + name.len())?);
        }
        let is_group = |e: &StoredEntry| e.group == group && e.is_group;
        let index = self.entries.iter().position(|e| e.continues(group, name));
        let index = index.or(self.entries.iter().position(is_group).map(|at| at + 1));
        self.entries.retain(|e| !e.continues(group, name));
        let index = index.unwrap_or(self.entries.len());
        self.entries.splice(index..index, new);
        Ok(())
    }

    /// Sets a parameter that is one integer.
    ///
    /// # Errors
    /// Its description is too long.
    pub(super) fn set_count(&mut self, group: u8, name: &str, count: u16) -> Result<()> {
        let word = self.file.layout.processor.u16_bytes(count);
        self.set(group, name, vec![[[2, 0], word].concat()])
    }

    /// The file with these parameters and with `rest` from its frames on; `None` where it has no
    /// room for them.
    pub(super) fn finish(mut self, rest: &[u8]) -> Option<Vec<u8>> {
        let (bytes, start) = (&self.file.bytes, self.file.layout.start);
        let length: usize = self.entries.iter().map(|e| e.bytes.len()).sum();
        // The last entry leads to two zeros.
        let blocks = (4 + length + 2).div_ceil(BLOCK).max(self.room / BLOCK);
        let count = u8::try_from(blocks)
            .ok()
            .filter(|n| *n as usize <= MOST_BLOCKS)?;
        let later = blocks - self.room / BLOCK;
        self.move_start("POINT", 0, later)?;
        // Rotations follow the frames.
        let longer = rest
            .len()
            .div_ceil(BLOCK)
            .checked_sub((bytes.len() - start).div_ceil(BLOCK));
        self.move_start("ROTATION", start / BLOCK + 2, later + longer?)?;
        let mut out = bytes[..self.first + 4].to_vec();
        out[self.first + 2] = count;
        self.add(&mut out[START..START + 2], later)?;
        self.entries.iter().for_each(|e| out.extend(&e.bytes));
        out.resize(self.first + blocks * BLOCK, 0);
        out.extend(rest);
        Some(out)
    }

    /// Moves the block that a group says its data start in, if that is `least` or more.
    fn move_start(&mut self, group: &str, least: usize, blocks: usize) -> Option<()> {
        let group = self.group(group);
        let is_start =
            |e: &StoredEntry| Some(e.group) == group && !e.is_group && e.name == "DATA_START";
        let Some(index) = self.entries.iter().position(is_start) else {
            return Some(());
        };
        let entry = &self.entries[index];
        let data = kind_and_data(&entry.bytes, entry.offset_at).filter(|(kind, _)| *kind == 2);
        let word = data
            .and_then(|(_, data)| Some([data.start, data.start + 1]).filter(|_| data.len() > 1));
        let Some([low, high]) = word.filter(|[_, high]| *high < entry.bytes.len()) else {
            return Some(());
        };
        let mut word = [entry.bytes[low], entry.bytes[high]];
        if self.file.layout.processor.u16(word) as usize >= least {
            self.add(&mut word, blocks)?;
        }
        self.entries[index].bytes[low..=high].copy_from_slice(&word);
        Some(())
    }

    /// Adds to the number of a block; 0 says nothing and stays.
    fn add(&self, word: &mut [u8], blocks: usize) -> Option<()> {
        let processor = self.file.layout.processor;
        let block = processor.u16([word[0], word[1]]);
        if block > 0 {
            let block = block.checked_add(u16::try_from(blocks).ok()?)?;
            word.copy_from_slice(&processor.u16_bytes(block));
        }
        Some(())
    }
}

impl StoredEntry {
    /// Whether it is the parameter of a group and a name, or continues it: NAME2 and so on.
    fn continues(&self, group: u8, name: &str) -> bool {
        let number = self.name.strip_prefix(name);
        let is_number = |n: &str| n.bytes().all(|b| b.is_ascii_digit());
        self.group == group && !self.is_group && number.is_some_and(is_number)
    }
}

/// The values of a parameter of texts and of those that continue it.
///
/// # Errors
/// A text is too long.
pub(super) fn text_values(texts: &[Vec<u8>]) -> Result<Vec<Vec<u8>>> {
    if let Some(long) = texts.iter().find(|text| text.len() > LONGEST_NAME) {
        let long = String::from_utf8_lossy(long);
        return Err(format!("has no room for so long a name as {long}").into());
    }
    if texts.is_empty() {
        return Ok(vec![text_value(texts)]);
    }
    Ok(texts.chunks(MOST_ITEMS).map(text_value).collect())
}
