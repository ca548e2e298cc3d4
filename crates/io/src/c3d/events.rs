//! The events of a C3D file, such as a foot's strike.

use super::C3d;
use super::parameters::TEXT;
use super::stored_parameters::{StoredItems, StoredParameters, text_values};
use super::write::MOST_ITEMS;
use crate::Result;

/// The parameters that hold something of each event: their type, and the numbers of an event.
const EACH: [(&str, u8, usize); 7] = [
    ("CONTEXTS", TEXT, 1),
    ("LABELS", TEXT, 1),
    ("TIMES", 4, 2),
    ("ICON_IDS", 2, 1),
    ("DESCRIPTIONS", TEXT, 1),
    ("SUBJECTS", TEXT, 1),
    ("GENERIC_FLAGS", 1, 1),
];
/// Those of them that every file with events has.
const NEEDED: usize = 3;

/// An event as the file has it.
#[derive(Debug, Clone, PartialEq)]
pub struct FileEvent {
    /// Whose it is: `Left`, `Right`, `General`.
    pub context: String,
    /// What it is: `Foot Strike`, `Foot Off`.
    pub label: String,
    /// Seconds; frame 1 is at 0.
    pub time: f64,
}

impl C3d {
    /// The events (EVENT:TIMES, CONTEXTS, LABELS) in time; those without a time are left out.
    pub fn events(&self) -> Vec<FileEvent> {
        let used = self.parameters.number("EVENT:USED").unwrap_or(0.0) as usize;
        let times = self.parameters.all_numbers("EVENT:TIMES");
        let mut contexts = self.parameters.all_texts("EVENT:CONTEXTS");
        let mut labels = self.parameters.all_texts("EVENT:LABELS");
        let text = |texts: &mut dyn Iterator<Item = &str>| {
            texts.next().unwrap_or_default().trim().to_string()
        };
        let mut events: Vec<FileEvent> = times
            .chunks_exact(2)
            .take(used)
            .map(|time| FileEvent {
                context: text(&mut contexts),
                label: text(&mut labels),
                time: 60.0 * time[0] + time[1],
            })
            .filter(|event| event.time.is_finite())
            .collect();
        events.sort_by(|a, b| a.time.total_cmp(&b.time));
        events
    }
}

/// An event to be written.
struct WrittenEvent<'a> {
    /// The event of the file that it is, or whose icon, description and so on it takes.
    stored: Option<usize>,
    /// What it is, if it is new.
    new: Option<&'a FileEvent>,
}

/// Puts left and right events in place of a file's own; its others stay.
///
/// # Errors
/// More events than a file holds, or one without a time.
pub(super) fn set_events(
    parameters: &mut StoredParameters<'_>,
    file: &C3d,
    events: &[FileEvent],
) -> Result<()> {
    let events: Vec<&FileEvent> = events.iter().filter(|e| is_side(&e.context)).collect();
    if events.iter().any(|event| !event.time.is_finite()) {
        return Err("cannot hold an event without a time".into());
    }
    let Some(all) = written(file, events) else {
        return Ok(());
    };
    if all.len() > MOST_ITEMS {
        let what = format!("holds {MOST_ITEMS} events at most, not {}", all.len());
        return Err(what.into());
    }
    let group = parameters.group("EVENT");
    let group = group.map_or_else(|| parameters.add_group("EVENT"), Ok)?;
    parameters.set_count(group, "USED", all.len() as u16)?;
    for (i, (name, kind, numbers)) in EACH.into_iter().enumerate() {
        let own = parameters.items(group, name, numbers);
        if i >= NEEDED && own.is_none() {
            continue;
        }
        // Flags are bytes or words.
        let is_kind = |own: u8| own == kind || matches!((own, kind), (1, 2) | (2, 1));
        let own = own.filter(|own| is_kind(own.kind)).unwrap_or(StoredItems {
            kind,
            ..StoredItems::default()
        });
        let items = all
            .iter()
            .map(|event| item(event, name, &own, file, numbers));
        let items: Vec<Vec<u8>> = items.collect();
        let sizes = [numbers as u8, items.len() as u8];
        let sizes = &sizes[usize::from(numbers == 1)..];
        let values = match kind {
            TEXT => text_values(&items)?,
            _ => vec![[&[own.kind, sizes.len() as u8], sizes, &items.concat()].concat()],
        };
        parameters.set(group, name, values)?;
    }
    Ok(())
}

/// Whether events of a context are of a side.
fn is_side(context: &str) -> bool {
    let context = context.trim();
    ["Left", "Right"]
        .iter()
        .any(|side| side.eq_ignore_ascii_case(context))
}

/// A file's events of no side, and these new ones; `None` where the file has no others now.
fn written<'a>(file: &C3d, new: Vec<&'a FileEvent>) -> Option<Vec<WrittenEvent<'a>>> {
    let texts = |name: &str| {
        let texts = file.parameters.all_texts(name).map(str::trim);
        texts.chain(std::iter::repeat(""))
    };
    let used = file.parameters.number("EVENT:USED").unwrap_or(0.0) as usize;
    let used = used.min(file.parameters.all_numbers("EVENT:TIMES").len() / 2);
    let old = texts("EVENT:CONTEXTS")
        .zip(texts("EVENT:LABELS"))
        .take(used);
    let old: Vec<(&str, &str)> = old.collect();
    let others = (0..used).filter(|i| !is_side(old[*i].0));
    let others = others.map(|i| WrittenEvent {
        stored: Some(i),
        new: None,
    });
    let mut all: Vec<WrittenEvent<'_>> = others.collect();
    let is_same = new.is_empty() && all.len() == used;
    all.extend(new.into_iter().map(|event| {
        let own = (&*event.context, &*event.label);
        let same = old.iter().position(|old| *old == own);
        WrittenEvent {
            stored: same.or_else(|| old.iter().position(|old| old.1 == own.1)),
            new: Some(event),
        }
    }));
    (!is_same).then_some(all)
}

/// What a parameter holds of an event.
fn item(
    event: &WrittenEvent<'_>,
    name: &str,
    own: &StoredItems,
    file: &C3d,
    numbers: usize,
) -> Vec<u8> {
    let stored = event.stored.and_then(|i| own.items.get(i)).cloned();
    let word = |n: u16| file.layout.processor.u16_bytes(n).to_vec();
    match (event.new, name) {
        (Some(new), "CONTEXTS") => new.context.clone().into_bytes(),
        (Some(new), "LABELS") => new.label.clone().into_bytes(),
        (Some(new), "TIMES") => {
            let minutes = (new.time / 60.0).trunc();
            let time = [minutes, new.time - 60.0 * minutes];
            time.map(|v| file.layout.processor.f32_bytes(v as f32))
                .concat()
        }
        _ if stored.is_some() => stored.unwrap_or_default(),
        (_, "SUBJECTS") => {
            let subjects = file.texts("SUBJECTS:NAMES").iter();
            let subjects = subjects.chain(file.texts("EVENT:SUBJECTS"));
            let subject = subjects.into_iter().find(|name| !name.is_empty());
            subject.cloned().unwrap_or_default().into_bytes()
        }
        // As Vicon numbers them.
        (Some(new), "ICON_IDS") if own.kind == 2 => match &*new.label {
            "Foot Strike" => word(1),
            "Foot Off" => word(2),
            _ => word(0),
        },
        _ if own.kind == TEXT => Vec::new(),
        _ => vec![0; own.kind as usize * numbers],
    }
}

#[cfg(test)]
mod tests {
    use super::super::analog::testdata::file;

    #[test]
    fn events_are_in_time_and_may_lack_texts() {
        let parameters: [(u8, &str, &[f32]); 2] = [
            (3, "USED", &[9.0]),
            (3, "TIMES", &[1.0, 2.5, 0.0, 3.5, f32::NAN, 1.0]),
        ];
        let texts = b"\x08\x03CONTEXTS\x0c\0\xff\x02\x05\x01Right\0";
        let events = file(&parameters, texts, &[]).events();
        let times: Vec<f64> = events.iter().map(|e| e.time).collect();
        assert_eq!(times, [3.5, 62.5]);
        assert_eq!((&*events[0].context, &*events[1].context), ("", "Right"));
    }
}
