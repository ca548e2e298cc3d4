//! A file of keypoints: a frame, a list of frames, or an object with `frames`. It is read frame by
//! frame, so that only its text and the positions are in the memory.

use super::frame::{Frame, field, is_missing_point, is_seen_point};
use super::frames::Frames;
use crate::bvh::LARGEST_FILE;
use crate::input::Input;
use crate::keypoint_files::{CONTENT, FILE, LARGEST_FRAME, NOTE, syntax};
use crate::marker_take::MarkerTake;
use crate::text::excerpt;
use crate::{Error, Place, Result};
use serde::de::{DeserializeSeed, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::value::RawValue;
use serde_json::{Value, json};
use std::io::Read;
use std::path::Path;

/// Reads a file: a frame, a list of frames, or an object with `frames`. With `keep_whole`, a file
/// that ends early gives the frames that it has.
///
/// # Errors
/// [`Error::Data`]: it is no JSON of keypoints in space, frames differ in their points, or people
/// cannot be told apart. [`Error::Io`]: reading fails.
pub fn read(input: Input, keep_whole: bool) -> Result<MarkerTake> {
    let name = input.name.clone();
    let bytes = input.read_all(LARGEST_FILE)?;
    let text = std::str::from_utf8(&bytes)
        .map_err(|_| Error::data(Place::file(&name), "is no UTF-8, as JSON is"))?;
    let mut top = Top {
        frames: Frames::new(&name),
        ..Top::default()
    };
    let mut json = serde_json::Deserializer::from_str(text.trim_start_matches('\u{feff}'));
    let read = (&mut top).deserialize(&mut json).and_then(|()| json.end());
    let Top { failed, frames, .. } = &mut top;
    match (read, failed.take()) {
        (_, Some(error)) => return Err(error),
        (Err(e), _) if e.is_eof() && keep_whole && frames.count > 0 => {
            let what = format!("ends within a frame, after {} whole ones", frames.count);
            frames.notes.push(what);
        }
        (Err(e), _) => {
            let advice = "; of a list of frames, the option `keep_whole` reads the whole ones";
            return Err(syntax(&name, &e, advice));
        }
        (Ok(()), _) => {}
    }
    top.take()
}

/// Whether a file is JSON whose first frame with people [`read`] reads; no more of it is read.
pub(crate) fn is_keypoints(input: Input) -> bool {
    let has_mark = input.first_bytes().starts_with("\u{feff}".as_bytes());
    let mut reader = input.into_reader().take(LARGEST_FILE);
    let mut top = Top {
        is_search: true,
        ..Top::default()
    };
    // What cannot be read fails below.
    let _mark = has_mark.then(|| reader.read_exact(&mut [0; 3]));
    let read = (&mut top).deserialize(&mut serde_json::Deserializer::from_reader(reader));
    let has_frame = top.frames.is_told() && top.failed.is_none();
    has_frame || read.is_ok() && (top.is_frame() || top.take().is_ok())
}

/// What a file has at its top.
#[derive(Default)]
struct Top {
    frames: Frames,
    /// The other fields of an object, which may be a frame.
    fields: serde_json::Map<String, Value>,
    /// The bytes of `fields`.
    size: u64,
    /// The points of a list that is one frame, or what is missing before its first frame.
    points: Vec<Value>,
    is_one_frame: bool,
    /// What the file has as its frames, where that is no list.
    count: Option<String>,
    failed: Option<Error>,
    /// Whether the first frame with people is enough.
    is_search: bool,
}

impl Top {
    /// Adds a frame of a list.
    fn push(&mut self, raw: &str) -> Result<()> {
        if raw.len() as u64 > LARGEST_FRAME {
            return Err(format!("has more than the {LARGEST_FRAME} bytes of a frame").into());
        }
        let value: Value = serde_json::from_str(raw).map_err(|e| format!("is no frame: {e}"))?;
        if let Some(file) = value[FILE].as_str() {
            let read = Frame::read(&value[CONTENT]);
            let pushed = read.and_then(|frame| self.frames.push(frame, value["frame"].as_u64()));
            let path = Path::new(&self.frames.name).join(file);
            return pushed.map_err(|e| e.at(Place::file(path.display().to_string())));
        }
        let is_start = self.frames.count == 0;
        self.is_one_frame |= is_start && is_seen_point(&value);
        if self.is_one_frame || is_start && is_missing_point(&value) {
            self.points.push(value);
            return Ok(());
        }
        self.push_missing()?;
        self.push_value(&value)
    }

    /// Adds what is missing before the first frame.
    fn push_missing(&mut self) -> Result<()> {
        let missing = std::mem::take(&mut self.points);
        missing.iter().try_for_each(|value| self.push_value(value))
    }

    fn push_value(&mut self, value: &Value) -> Result<()> {
        let frame = Frame::read(value)?;
        let number = frame.number;
        self.frames.push(frame, number)
    }

    /// Whether the fields are those of a frame.
    fn is_frame(&self) -> bool {
        Frame::is_of(&Value::Object(self.fields.clone()))
    }

    fn take(mut self) -> Result<MarkerTake> {
        let fields = Value::Object(std::mem::take(&mut self.fields));
        let rate = field(&fields, &["fps", "framerate"]).and_then(Value::as_f64);
        let rate = rate.filter(|rate| *rate > 0.0);
        let place = Place::file(&self.frames.name);
        let note = fields[NOTE].as_str().map(String::from);
        self.frames.notes.extend(note);
        if self.is_one_frame {
            let points = Value::Array(std::mem::take(&mut self.points));
            self.push_value(&points).map_err(|e| e.at(place))?;
            return self.frames.take(rate);
        }
        self.push_missing().map_err(|e| e.at(place.clone()))?;
        if self.frames.count == 0 && (fields != json!({}) || self.count.is_some()) {
            let failed = self.push_value(&fields);
            let failed = failed.map_err(|e| match &self.count {
                Some(count) => Error::unfit(format!(
                    "has {count} as its frames, which are to be a list: call the list of frames \
                     \"frames\", and their number otherwise"
                )),
                None => e,
            });
            failed.map_err(|e| e.at(place))?;
        }
        self.frames.take(rate)
    }
}

impl<'de> DeserializeSeed<'de> for &mut Top {
    type Value = ();
    fn deserialize<D: Deserializer<'de>>(
        self,
        deserializer: D,
    ) -> std::result::Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for &mut Top {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str("frames of keypoints")
    }

    fn visit_u64<E>(self, count: u64) -> std::result::Result<(), E> {
        self.count = Some(count.to_string());
        Ok(())
    }

    fn visit_str<E>(self, count: &str) -> std::result::Result<(), E> {
        self.count = Some(format!("\"{}\"", excerpt(count)));
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> std::result::Result<(), A::Error> {
        while let Some(raw) = list.next_element::<Box<RawValue>>()? {
            let part = self.frames.count + self.points.len() + 1;
            let part = format!("frame {part}");
            if let Err(e) = self.push(raw.get()) {
                let place = Place::file(&self.frames.name);
                self.failed = Some(e.at(place.part(part)));
                return Err(A::Error::custom("fails"));
            }
            if self.is_search && self.frames.is_told() {
                return Err(A::Error::custom("is enough"));
            }
        }
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            if key == "frames" {
                map.next_value_seed(&mut *self)?;
                continue;
            }
            let raw = map.next_value::<Box<RawValue>>()?;
            let size = self.size + (raw.get().len() + key.len()) as u64;
            // What is larger than a frame is none.
            if size <= LARGEST_FRAME
                && let Ok(value) = serde_json::from_str(raw.get())
            {
                self.size = size;
                self.fields.insert(key, value);
            }
        }
        Ok(())
    }
}
