//! Model files: an `.npz` archive of named arrays, which `numpy.load` opens, and `meta`, JSON as an
//! array of bytes.
//!
//! Entries are stored in a fixed order with the time 1980-01-01, so equal models are equal bytes.

use super::Input;
use super::npy;
use super::output::write_file;
use super::text::excerpt;
use crate::pose::Body;
use crate::{Error, Place, Result};
use bytes::Bytes;
use ndarray::{Array2, CowArray, Ix2};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;

pub(crate) use super::model_array::{Matrix, PackedMatrix};

/// The format this version writes; it reads all up to it.
pub(crate) const FORMAT: u32 = 1;

/// The largest number of points of a model: memory and time of priors grow with its square or
/// faster.
pub(crate) const MAX_POINTS: usize = 2048;

/// Checks the number of points of a model; `source` is for the message.
///
/// # Errors
/// [`Error::Data`]: more than `MAX_POINTS`.
pub fn check_point_count(points: usize, source: &str) -> Result<()> {
    if points <= MAX_POINTS {
        return Ok(());
    }
    let what =
        format!("has {points} points; a model has at most {MAX_POINTS}; keep those of one body");
    Err(Error::data(Place::file(source), what))
}

/// The largest size of a model file, in bytes.
const LARGEST: u64 = 8 << 30;

/// The largest ratio of unpacked to packed size. Floats hardly compress, so an archive beyond it is
/// made to fill the memory.
const MOST_PACKED: u64 = 50;

/// The description of a model and its history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// The format's version.
    pub format: u32,
    /// `sparse`, `centroids`, …
    pub kind: String,
    /// The points' names, in the order of the arrays' columns.
    pub points: Vec<String>,
    /// Always `cm`.
    pub units: String,
    /// `body`: rows were used as they were (root at the origin, no global rotation); `world`: each
    /// was placed.
    pub space: String,
    /// The bones and their lengths in the model's space.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<BodyMeta>,
    /// The largest number of atoms in a code.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sparsity: Option<usize>,
    /// Root mean square of the training poses' error a coordinate, centimeters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training_rms: Option<f64>,
    /// Words that must go with the data the model was learned from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub credit: Option<String>,
    /// Arrays that are kept as 16-bit whole multiples (`<i2`) of a step: by name, the step. Only
    /// in files; here the arrays know.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    steps: BTreeMap<String, f32>,
    /// Other facts that the kind needs.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub details: Map<String, Value>,
    /// How it was made: never threads, paths or dates.
    #[serde(default)]
    pub history: Vec<HistoryEntry>,
}

/// One step of a model's history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HistoryEntry {
    /// The command.
    pub command: String,
    /// Its version.
    pub version: String,
    /// The flags that change numbers, the seed among them.
    pub flags: BTreeMap<String, String>,
    /// SHA-256 of the inputs' poses, in order.
    pub inputs: Vec<String>,
}

/// A [`Body`] in JSON, where NaN is null.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BodyMeta {
    /// The point each point hangs on.
    pub parents: Vec<Option<usize>>,
    /// Centimeters.
    pub lengths: Vec<Option<f64>>,
}

impl From<&Body> for BodyMeta {
    fn from(body: &Body) -> Self {
        let lengths = body
            .lengths
            .iter()
            .map(|l| l.is_finite().then_some(*l))
            .collect();
        BodyMeta {
            parents: body.parents.clone(),
            lengths,
        }
    }
}

impl From<&BodyMeta> for Body {
    fn from(meta: &BodyMeta) -> Self {
        let lengths = meta.lengths.iter().map(|l| l.unwrap_or(f64::NAN)).collect();
        Body {
            parents: meta.parents.clone(),
            lengths,
        }
    }
}

/// A model: what it is, and its arrays.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// The kind of model.
    pub meta: Meta,
    /// Arrays by name; vectors have one column.
    arrays: BTreeMap<String, Matrix>,
}

impl Model {
    /// A model of a kind, without arrays yet.
    pub fn new(kind: &str, points: &[String], space: &str) -> Model {
        Model {
            meta: Meta {
                format: FORMAT,
                kind: kind.into(),
                points: points.to_vec(),
                units: "cm".into(),
                space: space.into(),
                body: None,
                sparsity: None,
                training_rms: None,
                credit: None,
                steps: BTreeMap::new(),
                details: Map::new(),
                history: Vec::new(),
            },
            arrays: BTreeMap::new(),
        }
    }

    /// The arrays by name, in the order of their names.
    pub fn arrays(&self) -> impl Iterator<Item = (&str, &Matrix)> {
        self.arrays
            .iter()
            .map(|(name, matrix)| (name.as_str(), matrix))
    }

    /// Checks that it is of a kind; `else_what` ends the sentence that says of which it is.
    ///
    /// # Errors
    /// [`Error::Data`]: it is of another kind.
    #[doc(hidden)]
    pub fn check_kind(&self, kind: &str, else_what: &str, source: &str) -> Result<()> {
        let own = &self.meta.kind;
        if own == kind {
            return Ok(());
        }
        let what = format!("is a model of kind {own}, {else_what}");
        Err(Error::data(Place::file(source), what))
    }

    /// The numbers of an array as f32; `None` where the model has no such array.
    pub fn get(&self, name: &str) -> Option<CowArray<'_, f32, Ix2>> {
        self.arrays.get(name).map(Matrix::floats)
    }

    /// The array of a name as the file keeps it, or an error that names it.
    ///
    /// # Errors
    /// [`Error::Data`]: the model has no such array; `source` names the model.
    pub fn matrix(&self, name: &str, source: &str) -> Result<&Matrix> {
        let missing = || {
            let place = Place::file(source).part(name);
            Error::data(place, "the model has no such array")
        };
        self.arrays.get(name).ok_or_else(missing)
    }

    /// The numbers of an array as f32, or an error that names it.
    ///
    /// # Errors
    /// [`Error::Data`]: the model has no such array; `source` names the model.
    pub fn array(&self, name: &str, source: &str) -> Result<CowArray<'_, f32, Ix2>> {
        self.matrix(name, source).map(Matrix::floats)
    }

    /// Adds an array, in place of what has its name.
    pub fn insert(&mut self, name: &str, array: impl Into<Matrix>) {
        self.arrays.insert(name.into(), array.into());
    }

    /// Adds an array that is kept as 16-bit whole multiples of a step, and rounds it to them.
    ///
    /// The step is the smallest that holds the largest value. Every value must be finite.
    #[doc(hidden)]
    pub fn insert_quantized(&mut self, name: &str, array: &Array2<f32>) {
        let packed = PackedMatrix::quantized(array);
        self.arrays.insert(name.into(), Matrix::Packed(packed));
    }

    /// Takes an array out.
    #[doc(hidden)]
    pub fn remove(&mut self, name: &str) {
        self.arrays.remove(name);
    }

    /// The file's bytes.
    ///
    /// # Errors
    /// [`Error::Data`]: more than `MAX_POINTS` points.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let fail = |e: String| Error::data(Place::file("the model"), e);
        check_point_count(self.meta.points.len(), "the model")?;
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        // The default time of an entry is 1980-01-01, the earliest ZIP knows.
        let options = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored)
            .last_modified_time(zip::DateTime::default())
            .large_file(false);
        let step = |(name, array): (&String, &Matrix)| Some((name.clone(), array.step()?));
        let mut meta = self.meta.clone();
        meta.steps = self.arrays.iter().filter_map(step).collect();
        let json = serde_json::to_vec(&meta).map_err(|e| fail(e.to_string()))?;
        let mut entry = |name: &str, bytes: &[u8]| -> Result<()> {
            zip.start_file(format!("{name}.npy"), options)
                .map_err(|e| fail(e.to_string()))?;
            zip.write_all(bytes).map_err(|e| fail(e.to_string()))
        };
        let mut bytes = npy::header_of("|u1", &[json.len()]);
        bytes.extend_from_slice(&json);
        entry("meta", &bytes)?;
        for (name, array) in &self.arrays {
            entry(name, &array.to_npy())?;
        }
        Ok(zip.finish().map_err(|e| fail(e.to_string()))?.into_inner())
    }

    /// Reads a model from its bytes, which it keeps where there are packed arrays; `name` is for
    /// messages.
    ///
    /// # Errors
    /// [`Error::Data`]: no sound archive, no model, or one of a newer format.
    pub fn from_bytes(bytes: impl Into<Bytes>, name: &str) -> Result<Model> {
        Model::of(bytes.into(), name)
    }

    fn of(bytes: Bytes, name: &str) -> Result<Model> {
        let fail = |what: String| Error::data(Place::file(name), what);
        let broken = |e: zip::result::ZipError| {
            let e = e.to_string();
            fail(format!("is a damaged NPZ archive: {}", excerpt(&e)))
        };
        let mut zip = zip::ZipArchive::new(Cursor::new(&bytes[..])).map_err(broken)?;
        let (mut meta, mut arrays) = (None, BTreeMap::new());
        let mut budget = (MOST_PACKED * bytes.len() as u64 + (1 << 20)).min(LARGEST);
        for i in 0..zip.len() {
            let mut entry = zip.by_index(i).map_err(broken)?;
            let key = entry
                .name()
                .map_err(broken)?
                .trim_end_matches(".npy")
                .to_string();
            let at = Place::file(name).part(excerpt(&key));
            let content = content(&mut entry, &bytes, budget)
                .map_err(|e| Error::data(at.clone(), excerpt(&e.to_string())))?;
            budget = match budget.checked_sub(content.len() as u64) {
                Some(left) => left,
                None => return Err(Error::data(at, "unpacks to far more than the file's size")),
            };
            if key == "meta" {
                let json = npy::bytes_of(&content, &at)?;
                let read: Meta = serde_json::from_slice(json)
                    .map_err(|e| Error::data(at, excerpt(&e.to_string())))?;
                meta = Some(read);
            } else {
                arrays.insert(key, Matrix::from_npy(&content, &at)?);
            }
        }
        let Some(mut meta) = meta else {
            return Err(fail(
                "is an NPZ archive without meta, not a model of posing".into(),
            ));
        };
        if meta.format > FORMAT {
            return Err(fail(format!(
                "has format {}, this version reads up to {FORMAT}; a newer posing is needed",
                meta.format
            )));
        }
        if meta.units != "cm" || !["body", "world"].contains(&meta.space.as_str()) {
            let what = format!(
                "says units \"{}\" and space \"{}\", expected cm, and body or world",
                excerpt(&meta.units),
                excerpt(&meta.space)
            );
            return Err(Error::data(Place::file(name).part("meta"), what));
        }
        for (key, step) in std::mem::take(&mut meta.steps) {
            match arrays.get_mut(&key) {
                Some(Matrix::Packed(packed)) => packed.step = step,
                Some(Matrix::Floats(array)) => array.mapv_inplace(|v: f32| v * step),
                None => {}
            }
        }
        let points = meta.points.len();
        check_point_count(points, name)?;
        let sound = meta.body.as_ref().is_none_or(|b| {
            b.parents.len() == points
                && b.lengths.len() == points
                && b.parents.iter().flatten().all(|&p| p < points)
                && Body::from(b).order().len() == points
        });
        if points == 0 || !sound {
            return Err(Error::data(
                Place::file(name).part("meta"),
                "its points and bones do not match",
            ));
        }
        Ok(Model { meta, arrays })
    }

    /// Reads a model file.
    ///
    /// ```
    /// use ndarray::array;
    /// use posing_io::Model;
    ///
    /// let folder = tempfile::tempdir()?;
    /// let path = folder.path().join("hand.npz");
    /// let mut model = Model::new("sparse", &["hand".to_string()], "body");
    /// model.insert("atoms", array![[0.6, 0.8, 0.0]]);
    /// model.save(&path)?;
    /// assert_eq!(Model::open(&path)?, model);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be read. [`Error::Data`]: no model, or one of a newer format.
    pub fn open(path: impl AsRef<Path>) -> Result<Model> {
        Model::read(Input::open(path)?)
    }

    /// Writes the model to a file, complete or not at all. Equal models give equal bytes.
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be written. [`Error::Data`]: more than `MAX_POINTS` points.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        write_file(path, &self.to_bytes()?)
    }

    /// Reads a model from an open input.
    ///
    /// # Errors
    /// Those of [`Model::open`].
    pub fn read(input: Input) -> Result<Model> {
        let name = input.name.clone();
        if input.kind() != super::input::ContentKind::Npz {
            return Err(Error::data(
                Place::file(name),
                "is not a model; expected an NPZ file",
            ));
        }
        Model::from_bytes(input.read_all(LARGEST)?, &name)
    }
}

/// What an entry holds: where it is not compressed, where it stands in the archive. Of others no
/// more than a little above `most` is read: the directory's sizes are not to be trusted.
fn content(
    entry: &mut zip::read::ZipFile<'_, impl Read>,
    archive: &Bytes,
    most: u64,
) -> std::io::Result<Bytes> {
    let plain = entry.compression() == zip::CompressionMethod::Stored && !entry.encrypted();
    let start = entry.data_start().filter(|_| plain);
    let range = start.and_then(|start| {
        let end = start.checked_add(entry.compressed_size())?;
        Some(usize::try_from(start).ok()?..usize::try_from(end).ok()?)
    });
    if let Some(range) = range.filter(|p| p.end <= archive.len()) {
        let content = archive.slice(range);
        return if crc32fast::hash(&content) == entry.crc32() {
            Ok(content)
        } else {
            Err(std::io::Error::other("Invalid checksum"))
        };
    }
    let mut content = Vec::new();
    entry.take(most + 1).read_to_end(&mut content)?;
    Ok(content.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    fn model() -> Model {
        let mut model = Model::new("sparse", &["a".to_string()], "body");
        model.meta.body = Some(BodyMeta {
            parents: vec![None],
            lengths: vec![None],
        });
        model.meta.training_rms = Some(0.1);
        model.insert("atoms", array![[0.1, 0.2, 0.3], [1.0, f32::NAN, 0.0]]);
        model
    }

    #[test]
    fn equal_models_are_equal_bytes_and_read_back() {
        let bytes = model().to_bytes().unwrap();
        assert_eq!(bytes, model().to_bytes().unwrap());
        let back = Model::from_bytes(bytes.clone(), "m.npz").unwrap();
        assert_eq!(back.meta, model().meta);
        let atoms = |model: &Model| model.array("atoms", "m").unwrap().row(0).to_vec();
        assert_eq!(atoms(&back), atoms(&model()));
        assert!(
            back.array("atom", "m.npz")
                .unwrap_err()
                .to_string()
                .contains("m.npz: atom")
        );
    }

    #[test]
    fn packed_arrays_keep_their_values_to_a_step() {
        let mut packed = model();
        let values = Array2::from_shape_fn((7, 3), |(i, j)| (i as f32 - 3.0) * 11.7 + j as f32);
        packed.insert_quantized("poses", &values);
        packed.insert_quantized("none", &Array2::zeros((2, 1)));
        let bytes = packed.to_bytes().unwrap();
        let back = Model::from_bytes(bytes.clone(), "m.npz").unwrap();
        assert_eq!(back.arrays["poses"], packed.arrays["poses"]);
        assert_eq!(back.get("none").unwrap(), Array2::<f32>::zeros((2, 1)));
        let off = &back.get("poses").unwrap() - &values;
        assert!(off.iter().all(|v| v.abs() <= 37.1 / 32767.0));
        assert_eq!(back.to_bytes().unwrap(), bytes);
    }

    #[test]
    fn archives_may_be_compressed_and_damage_is_reported() {
        let mut packed = model();
        let values = Array2::from_shape_fn((50, 3), |(i, j)| (i * j) as f32);
        packed.insert_quantized("poses", &values);
        packed.remove("atoms");
        let bytes = packed.to_bytes().unwrap();
        let mut stored = zip::ZipArchive::new(Cursor::new(&bytes)).unwrap();
        let mut deflated = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let options =
            SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
        for i in 0..stored.len() {
            let mut entry = stored.by_index(i).unwrap();
            let name = entry.name().unwrap().to_string();
            deflated.start_file(name, options).unwrap();
            std::io::copy(&mut entry, &mut deflated).unwrap();
        }
        let deflated = deflated.finish().unwrap().into_inner();
        assert!(deflated.len() < bytes.len());
        assert_eq!(Model::from_bytes(deflated, "m").unwrap(), packed);
        let start = stored.by_name("poses.npy").unwrap().data_start().unwrap();
        for at in [0, 90, 200, 300] {
            let mut damaged = bytes.clone();
            damaged[start as usize + at] ^= 4;
            let message = Model::from_bytes(damaged, "m").unwrap_err().to_string();
            assert!(message.contains("m: poses"), "{message}");
        }
    }

    #[test]
    fn damaged_models_are_refused() {
        let bytes = model().to_bytes().unwrap();
        for cut in [0, 1, 30, bytes.len() / 2, bytes.len() - 1] {
            assert!(Model::from_bytes(bytes[..cut].to_vec(), "m").is_err());
        }
        let mut wide = model();
        wide.meta.points = (0..=MAX_POINTS).map(|k| k.to_string()).collect();
        let message = wide.to_bytes().unwrap_err();
        assert!(message.to_string().contains("at most"), "{message}");
        let mut newer = model();
        newer.meta.format = 99;
        assert!(
            Model::from_bytes(newer.to_bytes().unwrap(), "m")
                .unwrap_err()
                .to_string()
                .contains("newer")
        );
        let mut odd = model();
        odd.meta.body = Some(BodyMeta {
            parents: vec![Some(7)],
            lengths: vec![None],
        });
        assert!(Model::from_bytes(odd.to_bytes().unwrap(), "m").is_err());
    }
}
