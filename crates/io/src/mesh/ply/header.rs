//! The header of a PLY file: the elements, their counts and their properties.

use super::super::super::text::{Lines, excerpt};
use crate::{Error, Result};

/// The largest number of elements and properties of a header.
const MOST: usize = 1000;

/// How the values are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn of(word: &str) -> Result<Kind> {
        Ok(match word {
            "char" | "int8" => Kind::I8,
            "uchar" | "uint8" => Kind::U8,
            "short" | "int16" => Kind::I16,
            "ushort" | "uint16" => Kind::U16,
            "int" | "int32" => Kind::I32,
            "uint" | "uint32" => Kind::U32,
            "float" | "float32" => Kind::F32,
            "double" | "float64" => Kind::F64,
            _ => {
                let found = excerpt(word);
                return Err(format!("expected a type such as float, found \"{found}\"").into());
            }
        })
    }

    /// Bytes of a value.
    pub(super) fn size(self) -> usize {
        match self {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 => 2,
            Kind::I32 | Kind::U32 | Kind::F32 => 4,
            Kind::F64 => 8,
        }
    }
}

/// A property: a value, or a list of values.
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
    /// The type of the list's length; `None` for one value.
    pub(super) list: Option<Kind>,
}

/// An element: as many rows as its count, each with a value or a list for each property.
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The bytes that a row has at least.
    pub(super) fn smallest_row(&self) -> u64 {
        let size = |p: &Property| p.list.unwrap_or(p.kind).size() as u64;
        self.properties.iter().map(size).sum()
    }
}

/// What a header says.
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
}

impl Header {
    /// The number of rows of the element that holds the vertices.
    pub(super) fn vertices(&self) -> Option<u64> {
        let vertex = self.elements.iter().find(|e| e.name == "vertex");
        vertex.map(|e| e.count)
    }
}

/// Reads the header, up to and with the line `end_header`.
pub(super) fn read(lines: &mut Lines<&[u8]>) -> Result<Header> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let Some(line) = lines.next_line()? else {
            return Err(Error::data(lines.here(), "ends before end_header"));
        };
        let words: Vec<&str> = line.split_ascii_whitespace().take(6).collect();
        if words == ["end_header"] {
            break;
        }
        let first = words.first().copied().unwrap_or_default();
        let done = match first {
            "format" => format(&words).map(|e| encoding = Some(e)),
            "element" | "property" => declaration(&words, &mut elements),
            _ => other(&words),
        };
        done.map_err(|e| e.at(lines.here()))?;
    }
    let fail = |what: String| Err(Error::data(lines.here(), what));
    let Some(encoding) = encoding else {
        return fail("the header has no line format".into());
    };
    if let Some(element) = elements
        .iter()
        .find(|e| e.properties.is_empty() && e.count > 0)
    {
        let name = excerpt(&element.name);
        return fail(format!("the element {name} has no properties"));
    }
    Ok(Header { encoding, elements })
}

fn format(words: &[&str]) -> Result<Encoding> {
    match words {
        ["format", "ascii", ..] => Ok(Encoding::Text),
        ["format", "binary_little_endian", ..] => Ok(Encoding::LittleEndian),
        ["format", "binary_big_endian", ..] => Ok(Encoding::BigEndian),
        _ => Err(
            "expected format ascii, format binary_little_endian or format binary_big_endian".into(),
        ),
    }
}

fn other(words: &[&str]) -> Result<()> {
    match words {
        [] | ["ply" | "comment" | "obj_info", ..] => Ok(()),
        [word, ..] => Err(format!(
            "expected element, property or end_header, found \"{}\"",
            excerpt(word)
        )
        .into()),
    }
}

/// Adds an element, or a property to the last one.
fn declaration(words: &[&str], elements: &mut Vec<Element>) -> Result<()> {
    let declared: usize = elements.iter().map(|e| 1 + e.properties.len()).sum();
    if declared >= MOST {
        return Err(format!("the header has more than {MOST} elements and properties").into());
    }
    let (name, kind, list) = match words {
        ["element", name, count] => {
            if elements.iter().any(|e| e.name == *name) {
                return Err(format!("a second element {}", excerpt(name)).into());
            }
            let count = count.parse();
            let count = count.map_err(|_| "expected a count after the element")?;
            elements.push(Element {
                name: (*name).into(),
                count,
                properties: Vec::new(),
            });
            return Ok(());
        }
        ["property", "list", length, kind, name] => (name, kind, Some(Kind::of(length)?)),
        ["property", kind, name] if *kind != "list" => (name, kind, None),
        _ => return Err("expected element NAME COUNT or property TYPE NAME".into()),
    };
    let Some(element) = elements.last_mut() else {
        return Err("a property stands before the first element".into());
    };
    if element.properties.iter().any(|p| p.name == *name) {
        return Err(format!("a second property {}", excerpt(name)).into());
    }
    element.properties.push(Property {
        name: (*name).into(),
        kind: Kind::of(kind)?,
        list,
    });
    Ok(())
}
