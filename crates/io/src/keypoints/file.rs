//! A file of keypoints: a frame, a list of frames, or an object with `frames`. It is read frame by
//! frame, so that only its text and the positions are in the memory.

use super::frame::{Frame, field, is_seen_point};
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
        (Err(e), _) => return Err(syntax(&name, &e)),
        (Ok(()), _) => {}
    }
    top.take()
}

/// What a file has at its top.
#[derive(Default)]
struct Top {
    frames: Frames,
    /// The other fields of an object, which may be a frame.
    fields: serde_json::Map<String, Value>,
    /// The bytes of `fields`.
    size: u64,
    /// The points of a list that is one frame.
    points: Vec<Value>,
    /// What the file has as its frames, where that is no list.
    count: Option<String>,
    failed: Option<Error>,
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
            return pushed.map_err(|e| e.at(Place::file(file)));
        }
        if self.frames.count == 0 && is_seen_point(&value) || !self.points.is_empty() {
            self.points.push(value);
            return Ok(());
        }
        self.push_value(&value)
    }

    fn push_value(&mut self, value: &Value) -> Result<()> {
        let frame = Frame::read(value)?;
        let number = frame.number;
        self.frames.push(frame, number)
    }

    fn take(mut self) -> Result<MarkerTake> {
        let fields = Value::Object(std::mem::take(&mut self.fields));
        let rate = field(&fields, &["fps", "framerate"]).and_then(Value::as_f64);
        let place = Place::file(&self.frames.name);
        let note = fields[NOTE].as_str().map(String::from);
        self.frames.notes.extend(note);
        if !self.points.is_empty() {
            let points = Value::Array(std::mem::take(&mut self.points));
            self.push_value(&points).map_err(|e| e.at(place))?;
        } else if self.frames.count == 0 && (fields != json!({}) || self.count.is_some()) {
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
        self.frames.take(rate.filter(|rate| *rate > 0.0))
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
        while let Some(raw) = list.next_element::<&RawValue>()? {
            let part = format!("frame {}", self.frames.count + 1);
            if let Err(e) = self.push(raw.get()) {
                let place = Place::file(&self.frames.name);
                self.failed = Some(e.at(place.part(part)));
                return Err(A::Error::custom("fails"));
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
            let raw = map.next_value::<&RawValue>()?.get();
            let size = self.size + (raw.len() + key.len()) as u64;
            // What is larger than a frame is none.
            if size <= LARGEST_FRAME
                && let Ok(value) = serde_json::from_str(raw)
            {
                self.size = size;
                self.fields.insert(key, value);
            }
        }
        Ok(())
    }
}
