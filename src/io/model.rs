//! Models: one `.npz` file of named arrays that `numpy.load` opens, and `meta`, JSON as an array of bytes.
//!
//! Entries are stored in a fixed order with the time 1980-01-01, so equal models are equal bytes.

use super::Input;
use super::npy;
use super::text::short;
use crate::pose::Body;
use crate::{Error, Place, Result};
use ndarray::{Array2, ArrayView2};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::io::{Cursor, Read, Write};
use zip::write::SimpleFileOptions;

/// The format this version writes; it reads all up to it.
pub const FORMAT: u32 = 1;

/// A model has at most so many points: what priors keep and what they cost grows with the square, and more.
pub const MOST_POINTS: usize = 2048;

/// Refuses more points than a model has.
///
/// # Errors
/// Data: the source is named.
pub fn few_enough(points: usize, source: &str) -> Result<()> {
    if points <= MOST_POINTS {
        return Ok(());
    }
    let what =
        format!("has {points} points, a model has at most {MOST_POINTS}; pick those of a body");
    Err(Error::data(Place::file(source), what))
}

/// No model is larger.
const LARGEST: u64 = 8 << 30;

/// An archive may unpack to so many times its own size, and a little more: floats hardly compress, so one that does
/// is made to fill the memory.
const MOST_PACKED: u64 = 50;

/// What a model is and where it came from.
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
    /// `body`: rows were used as they were (root at the origin, no global rotation); `world`: each was placed.
    pub space: String,
    /// The bones and their lengths in the model's space.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<BodyMeta>,
    /// At most so many atoms a pose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sparsity: Option<usize>,
    /// Root mean square of the training poses' error a coordinate, centimetres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training_rms: Option<f64>,
    /// Words that must go with the data the model was learnt from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub credit: Option<String>,
    /// Arrays that are kept as 16-bit whole multiples (`<i2`) of a step: by name, the step.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub steps: BTreeMap<String, f32>,
    /// What else the kind wants to know.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub details: Map<String, Value>,
    /// How it was made: never threads, paths or dates.
    #[serde(default)]
    pub history: Vec<Entry>,
}

/// One step of a model's history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Entry {
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
    /// Centimetres.
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
    /// What it is.
    pub meta: Meta,
    /// Two-dimensional arrays by name, as f32 (vectors have one column).
    pub arrays: BTreeMap<String, Array2<f32>>,
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

    /// The array of a name, or an error that names it.
    pub fn array(&self, name: &str, source: &str) -> Result<ArrayView2<'_, f32>> {
        match self.arrays.get(name) {
            Some(a) => Ok(a.view()),
            None => Err(Error::data(
                Place::file(source).part(name),
                "the model has no such array",
            )),
        }
    }

    /// Adds an array that is kept as 16-bit whole multiples of a step, and rounds it to them.
    ///
    /// The step is the smallest that holds the largest value. Every value must be finite.
    pub fn insert_packed(&mut self, name: &str, mut array: Array2<f32>) {
        let largest = array.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        let step = (largest / f32::from(i16::MAX)).max(f32::MIN_POSITIVE);
        array.mapv_inplace(|v| (v / step).round() * step);
        self.meta.steps.insert(name.into(), step);
        self.arrays.insert(name.into(), array);
    }

    /// The file's bytes.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let fail = |e: String| Error::data(Place::file("the model"), e);
        few_enough(self.meta.points.len(), "the model")?;
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        // The default time of an entry is 1980-01-01, the earliest ZIP knows.
        let options = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored)
            .last_modified_time(zip::DateTime::default())
            .large_file(false);
        let json = serde_json::to_vec(&self.meta).map_err(|e| fail(e.to_string()))?;
        let mut entry = |name: &str, bytes: &[u8]| -> Result<()> {
            zip.start_file(format!("{name}.npy"), options)
                .map_err(|e| fail(e.to_string()))?;
            zip.write_all(bytes).map_err(|e| fail(e.to_string()))
        };
        let mut bytes = npy::header_of("|u1", &[json.len()]);
        bytes.extend_from_slice(&json);
        entry("meta", &bytes)?;
        for (name, array) in &self.arrays {
            if let Some(step) = self.meta.steps.get(name) {
                let mut bytes = npy::header_of("<i2", &[array.nrows(), array.ncols()]);
                bytes.reserve(2 * array.len());
                for v in array {
                    bytes.extend_from_slice(&((v / step).round() as i16).to_le_bytes());
                }
                entry(name, &bytes)?;
                continue;
            }
            let mut bytes = npy::header_of("<f4", &[array.nrows(), array.ncols()]);
            bytes.reserve(4 * array.len());
            for v in array {
                bytes.extend_from_slice(&v.to_le_bytes());
            }
            entry(name, &bytes)?;
        }
        Ok(zip.finish().map_err(|e| fail(e.to_string()))?.into_inner())
    }

    /// Reads a model from its bytes; `name` is for messages.
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Model> {
        let fail = |what: String| Error::data(Place::file(name), what);
        let broken = |e: zip::result::ZipError| {
            let e = e.to_string();
            fail(format!("is no sound NPZ archive: {}", short(&e)))
        };
        let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).map_err(broken)?;
        let (mut meta, mut arrays) = (None, BTreeMap::new());
        let mut budget = (MOST_PACKED * bytes.len() as u64 + (1 << 20)).min(LARGEST);
        // Room for one array after the other: memory that is asked for anew costs more than reading into it.
        let mut content = Vec::new();
        for i in 0..zip.len() {
            let mut entry = zip.by_index(i).map_err(broken)?;
            let key = entry
                .name()
                .map_err(broken)?
                .trim_end_matches(".npy")
                .to_string();
            // Read in pieces, up to what a model may hold: the directory's sizes are not to be trusted.
            content.clear();
            let at = Place::file(name).part(short(&key));
            let read = entry.by_ref().take(budget + 1).read_to_end(&mut content);
            read.map_err(|e| Error::data(at.clone(), short(&e.to_string())))?;
            budget = match budget.checked_sub(content.len() as u64) {
                Some(left) => left,
                None => return Err(Error::data(at, "unpacks to far more than the file's size")),
            };
            if key == "meta" {
                let json = npy::bytes_of(&content, &at)?;
                let read: Meta = serde_json::from_slice(json)
                    .map_err(|e| Error::data(at, short(&e.to_string())))?;
                meta = Some(read);
            } else {
                arrays.insert(key, npy::matrix_of(&content, &at)?);
            }
        }
        let Some(meta) = meta else {
            return Err(fail(
                "is an NPZ archive without meta: no model of posing".into(),
            ));
        };
        if meta.format > FORMAT {
            return Err(fail(format!(
                "has format {}, this version reads up to {FORMAT}; a newer posing is needed",
                meta.format
            )));
        }
        for (key, step) in &meta.steps {
            if let Some(array) = arrays.get_mut(key) {
                array.mapv_inplace(|v: f32| v * step);
            }
        }
        let points = meta.points.len();
        few_enough(points, name)?;
        let sound = meta.body.as_ref().is_none_or(|b| {
            b.parents.len() == points
                && b.lengths.len() == points
                && b.parents.iter().flatten().all(|&p| p < points)
                && Body::from(b).order().len() == points
        });
        if points == 0 || !sound {
            return Err(Error::data(
                Place::file(name).part("meta"),
                "its points and bones do not fit together",
            ));
        }
        Ok(Model { meta, arrays })
    }

    /// Reads a model.
    pub fn read(mut input: Input) -> Result<Model> {
        let name = input.name.clone();
        if input.kind()? != super::input::Kind::Npz {
            return Err(Error::data(
                Place::file(name),
                "is no model: expected an .npz file",
            ));
        }
        Model::from_bytes(&input.read_all(LARGEST)?, &name)
    }
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
        model.arrays.insert(
            "atoms".into(),
            array![[0.1, 0.2, 0.3], [1.0, f32::NAN, 0.0]],
        );
        model
    }

    #[test]
    fn equal_models_are_equal_bytes_and_read_back() {
        let bytes = model().to_bytes().unwrap();
        assert_eq!(bytes, model().to_bytes().unwrap());
        let back = Model::from_bytes(&bytes, "m.npz").unwrap();
        assert_eq!(back.meta, model().meta);
        assert_eq!(back.arrays["atoms"].row(0), model().arrays["atoms"].row(0));
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
        packed.insert_packed("poses", values.clone());
        packed.insert_packed("none", Array2::zeros((2, 1)));
        let bytes = packed.to_bytes().unwrap();
        let back = Model::from_bytes(&bytes, "m.npz").unwrap();
        assert_eq!(back.arrays["poses"], packed.arrays["poses"]);
        assert_eq!(back.arrays["none"], Array2::<f32>::zeros((2, 1)));
        let off = &back.arrays["poses"] - &values;
        assert!(off.iter().all(|v| v.abs() <= 37.1 / 32767.0));
        assert_eq!(back.to_bytes().unwrap(), bytes);
    }

    #[test]
    fn damaged_models_are_refused() {
        let bytes = model().to_bytes().unwrap();
        for cut in [0, 1, 30, bytes.len() / 2, bytes.len() - 1] {
            assert!(Model::from_bytes(&bytes[..cut], "m").is_err());
        }
        let mut wide = model();
        wide.meta.points = (0..=MOST_POINTS).map(|k| k.to_string()).collect();
        let said = wide.to_bytes().unwrap_err();
        assert!(said.to_string().contains("at most"), "{said}");
        let mut newer = model();
        newer.meta.format = 99;
        assert!(
            Model::from_bytes(&newer.to_bytes().unwrap(), "m")
                .unwrap_err()
                .to_string()
                .contains("newer")
        );
        let mut odd = model();
        odd.meta.body = Some(BodyMeta {
            parents: vec![Some(7)],
            lengths: vec![None],
        });
        assert!(Model::from_bytes(&odd.to_bytes().unwrap(), "m").is_err());
    }
}
