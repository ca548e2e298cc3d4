//! Positions in NPZ archives: markers of AMASS with their names and rate, or the one array of
//! joints (frames, points, 3).

use super::input::Input;
use super::marker_take::{MarkerTake, unique_names};
use super::npy::{NpyReader, with_values};
use super::npz_entries::{Entry, LARGEST, Zipped, listed, number, plain, text_width, texts};
use super::row::{Row, TableOptions};
use crate::numeric::statistics::{median, span};
use crate::{Error, Place, Result};
use bytes::Bytes;
use ndarray::{Array2, ArrayView2};
use std::io::Cursor;
use std::ops::RangeInclusive;
use zip::write::SimpleFileOptions;

/// The extent of a body's markers in meters, in whatever pose.
const BODY: RangeInclusive<f64> = 0.2..=5.0;

/// A take of an archive.
#[derive(Debug, Clone)]
pub struct NpzTake {
    /// The points, in the archive's unit and axes.
    pub take: MarkerTake,
    /// The number of the entry that holds them.
    entry: usize,
    archive: Bytes,
}

impl NpzTake {
    /// Reads an archive. `joints` are the points' names, instead of those in it.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: it is damaged, or has no array of positions,
    /// or several.
    pub fn read(input: Input, joints: Option<&[String]>) -> Result<NpzTake> {
        let name = input.name.clone();
        let archive: Bytes = input.read_all(LARGEST)?.into();
        let zipped = Zipped {
            name: &name,
            archive: &archive,
        };
        let entries = zipped.entries()?;
        let place = Place::file(&name);
        let chosen = choose(&entries).map_err(|e| e.at(place.clone()))?;
        let names = match joints {
            Some(joints) => Some(joints.to_vec()),
            None => zipped.names(&entries, chosen)?,
        };
        let mut notes = Vec::new();
        let is_amass = is_amass(&entries, chosen);
        let points = chosen.header.shape[1];
        let names = match names {
            None if is_amass => {
                notes.push(
                    "the names of its markers cannot be read: they are point1 and so on".into(),
                );
                let points = usize::try_from(points).unwrap_or(0).min(1 << 20);
                Some((1..=points).map(|n| format!("point{n}")).collect())
            }
            names => names,
        };
        let content = zipped.content(chosen.index)?;
        let (points, xyz) = positions(&name, content, names)?;
        let is_meters = is_amass && is_metric(xyz.view());
        if is_meters {
            notes.push("taken as meters, z up, as markers of AMASS are by custom".into());
        } else if is_amass {
            notes.push(
                "its markers' extent is no body's in meters, as markers of AMASS are by custom"
                    .into(),
            );
        }
        let rate = zipped.rate(&entries)?;
        Ok(NpzTake {
            take: MarkerTake {
                name: name.clone(),
                points,
                xyz,
                first_frame: 1,
                rate,
                units: is_meters.then(|| "m".to_string()),
                up: is_meters.then(|| "+Z".to_string()),
                units_are_inferred: is_meters,
                up_is_inferred: is_meters,
                notes,
                ..MarkerTake::default()
            },
            entry: chosen.index,
            archive,
        })
    }

    /// Whether an archive is none of motion but of posing itself, or of meshes.
    ///
    /// # Errors
    /// [`Error::Io`]: reading fails. [`Error::Data`]: it is damaged.
    pub fn is_other(input: Input) -> Result<bool> {
        let name = input.name.clone();
        let archive: Bytes = input.read_all(LARGEST)?.into();
        let zipped = Zipped {
            name: &name,
            archive: &archive,
        };
        Ok(of_posing(&zipped.entries()?).is_some())
    }

    /// The bytes of the archive with the positions `new` (frames, 3 P; in the archive's unit and
    /// axes). All other entries stay byte by byte, and so do values that did not change.
    ///
    /// # Errors
    /// [`Error::Data`]: the archive cannot be made.
    pub fn with_points(&self, new: ArrayView2<'_, f64>) -> Result<Vec<u8>> {
        let zipped = Zipped {
            name: &self.take.name,
            archive: &self.archive,
        };
        let broken = |e: zip::result::ZipError| zipped.fail(&e.to_string());
        let place = Place::file(&self.take.name);
        let content = zipped.content(self.entry)?;
        let content = with_values(&content, self.take.xyz.view(), new).map_err(|e| e.at(place))?;
        let mut from = zipped.open()?;
        let mut to = zip::ZipWriter::new(Cursor::new(Vec::with_capacity(self.archive.len())));
        for index in 0..from.len() {
            let entry = from.by_index_raw(index).map_err(broken)?;
            if index != self.entry {
                to.raw_copy_file(entry).map_err(broken)?;
                continue;
            }
            let options = SimpleFileOptions::default()
                .compression_method(entry.compression())
                .last_modified_time(entry.last_modified().unwrap_or_default())
                .large_file(content.len() as u64 > u64::from(u32::MAX) - 1024);
            let name = entry.name().map_err(broken)?.into_owned();
            to.start_file(name, options).map_err(broken)?;
            std::io::Write::write_all(&mut to, &content)
                .map_err(|e| zipped.fail(&e.to_string()))?;
        }
        Ok(to.finish().map_err(broken)?.into_inner())
    }
}

/// The take of an array file, NPY, which says neither its rate nor its unit and axis. `joints` are
/// the points' names.
///
/// # Errors
/// [`Error::Io`]: reading fails. [`Error::Data`]: no array of positions, or none whose points have
/// names.
pub fn read_npy(input: Input, joints: Option<&[String]>) -> Result<MarkerTake> {
    let name = input.name.clone();
    let content = input.read_all(LARGEST)?;
    let (points, xyz) = positions(&name, content, joints.map(<[String]>::to_vec))?;
    Ok(MarkerTake {
        name,
        points,
        xyz,
        first_frame: 1,
        ..MarkerTake::default()
    })
}

/// The points of an array and their positions.
fn positions(
    name: &str,
    content: Vec<u8>,
    names: Option<Vec<String>>,
) -> Result<(Vec<String>, Array2<f64>)> {
    let input = Input::new(name, Cursor::new(content))?;
    let options = TableOptions {
        joints: names,
        ..TableOptions::default()
    };
    let mut reader = NpyReader::new(input, &options)?;
    let (mut row, mut xyz) = (Row::default(), Vec::new());
    let mut frames = 0;
    while reader.read(&mut row)? {
        xyz.extend_from_slice(&row.xyz);
        frames += 1;
    }
    let points = std::mem::take(&mut reader.columns.points);
    let xyz = Array2::from_shape_vec((frames, 3 * points.len()), xyz);
    let xyz = xyz.map_err(|e| Error::data(Place::file(name), e.to_string()))?;
    if frames == 0 {
        return Err(Error::data(Place::file(name), "has no frames"));
    }
    Ok((points, xyz))
}

/// Whether a body of these positions may be in meters: by the largest extent of the median frame.
fn is_metric(xyz: ArrayView2<'_, f64>) -> bool {
    let extents = xyz.rows().into_iter().filter_map(|row| {
        let along = |axis: usize| {
            let values = row.iter().skip(axis).step_by(3).copied();
            span(values.filter(|v| v.is_finite()))
        };
        let extent = along(0).max(along(1)).max(along(2));
        (extent >= 0.0).then_some(extent)
    });
    median(extents.collect()).is_some_and(|extent| BODY.contains(&extent))
}

impl Zipped<'_> {
    /// The names of the points, where an array of text has as many.
    fn names(&self, entries: &[Entry], chosen: &Entry) -> Result<Option<Vec<String>>> {
        let count = chosen.header.shape[1];
        let is_text =
            |e: &&Entry| e.header.shape[..] == [count] && text_width(&e.header.descr).is_some();
        let known = |e: &&Entry| {
            let name = plain(&e.name);
            ["label", "name", "joint", "marker", "keypoint", "bodypart"]
                .iter()
                .any(|word| name.contains(word))
        };
        let Some(entry) = entries.iter().filter(is_text).find(known) else {
            return Ok(None);
        };
        let bytes = self.values(entry)?;
        let names = texts(&entry.header.descr, &bytes);
        let is_whole = names.len() as u64 == count;
        Ok(is_whole.then(|| unique_names(names.iter().map(String::as_str))))
    }

    /// Frames a second, where a number of a usual name says so.
    fn rate(&self, entries: &[Entry]) -> Result<Option<f64>> {
        const NAMES: [&str; 9] = [
            "mocapframerate",
            "mocapfps",
            "mocaprate",
            "framerate",
            "fps",
            "rate",
            "samplingrate",
            "frequency",
            "freq",
        ];
        let is_scalar = |e: &&Entry| matches!(e.header.shape[..], [] | [1]);
        let find = |name: &&str| {
            entries
                .iter()
                .filter(is_scalar)
                .find(|e| plain(&e.name) == **name)
        };
        let Some(entry) = NAMES.iter().find_map(find) else {
            return Ok(None);
        };
        let value = number(&entry.header.descr, &self.values(entry)?);
        Ok(value.filter(|rate| *rate > 0.0 && *rate <= 1e6))
    }
}

/// What an archive is of posing itself, or of meshes.
fn of_posing(entries: &[Entry]) -> Option<&'static str> {
    let has = |name: &str| entries.iter().any(|e| e.name == name);
    // That of a model is text as bytes; others keep what they like under this name.
    let is_meta = |e: &Entry| e.name == "meta" && e.header.descr == "|u1";
    if entries
        .iter()
        .any(|e| is_meta(e) && e.header.shape.len() == 1)
    {
        return Some("is a model of posing, expected positions");
    }
    (has("faces") && (has("vertices") || has("predicted")))
        .then_some("holds meshes, expected positions of points")
}

/// Names of arrays of positions.
const POSITIONS: [&str; 24] = [
    "markers",
    "markersobs",
    "joints",
    "joints3d",
    "joint3d",
    "jtr",
    "jointpositions",
    "jointspositions",
    "bodypositions",
    "xyz",
    "positions",
    "position",
    "positions3d",
    "keypoints",
    "keypoints3d",
    "kp3d",
    "kpts3d",
    "points",
    "points3d",
    "pose3d",
    "poses3d",
    "pos3d",
    "coords",
    "coordinates",
];

/// Parts of the names of arrays that hold something else.
const OTHERS: [&str; 12] = [
    "rot", "quat", "angle", "orient", "vel", "acc", "theta", "pose", "normal", "force", "moment",
    "axis",
];

/// The array of positions.
fn choose(entries: &[Entry]) -> Result<&Entry> {
    if let Some(what) = of_posing(entries) {
        return Err(what.into());
    }
    let is_spatial = |e: &&Entry| {
        let is_float = matches!(e.header.descr.as_str(), "<f4" | "<f8");
        is_float && matches!(e.header.shape[..], [_, _, 3])
    };
    let spatial: Vec<&Entry> = entries.iter().filter(is_spatial).collect();
    if let Some(markers) = spatial.iter().find(|e| plain(&e.name) == "markerdata") {
        return Ok(markers);
    }
    let is_known = |e: &&&Entry| POSITIONS.contains(&plain(&e.name).as_str());
    let known: Vec<&&Entry> = spatial.iter().filter(is_known).collect();
    if let [one] = known[..] {
        return Ok(one);
    }
    let is_other = |e: &&&Entry| OTHERS.iter().any(|part| plain(&e.name).contains(part));
    let maybe: Vec<&&Entry> = spatial.iter().filter(|e| !is_other(e)).collect();
    match maybe[..] {
        [one] => Ok(one),
        [] => Err(without_positions(entries).into()),
        _ => Err(format!(
            "holds several arrays of positions ({}): save one of them with numpy.save as NPY",
            listed(maybe.iter().map(|e| **e))
        )
        .into()),
    }
}

/// What an archive is that holds no positions.
fn without_positions(entries: &[Entry]) -> String {
    let has = |name: &str| entries.iter().any(|e| e.name == name);
    let arrays = listed(entries.iter());
    if has("poses") || has("body_pose") || has("pose_body") || has("smpl_poses") {
        format!(
            "holds parameters of a SMPL body and no positions ({arrays}): a body model (smplx in \
         Python) turns them into joints; save these with numpy.save and read them with the \
         option `joints` smpl"
        )
    } else {
        format!("holds no array of positions (frames, points, 3) of <f4 or <f8; it has {arrays}")
    }
}

/// Whether the positions are AMASS' markers, which are in meters, z up.
fn is_amass(entries: &[Entry], chosen: &Entry) -> bool {
    let has = |word: &str| entries.iter().any(|e| plain(&e.name) == word);
    match plain(&chosen.name).as_str() {
        "markerdata" => true,
        "markers" | "markersobs" => has("mocapframerate") && has("poses") && has("betas"),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::npy::header_of;
    use std::io::Write;

    /// An archive of arrays: name, type, shape, bytes.
    fn archive(arrays: &[(&str, &str, &[usize], Vec<u8>)], is_packed: bool) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let method = if is_packed {
            zip::CompressionMethod::Deflated
        } else {
            zip::CompressionMethod::Stored
        };
        for (name, descr, shape, bytes) in arrays {
            let options = SimpleFileOptions::default().compression_method(method);
            zip.start_file(format!("{name}.npy"), options).unwrap();
            zip.write_all(&header_of(descr, shape)).unwrap();
            zip.write_all(bytes).unwrap();
        }
        zip.finish().unwrap().into_inner()
    }

    fn f8(values: &[f64]) -> Vec<u8> {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    fn wide(names: &[&str], width: usize) -> Vec<u8> {
        let chars = |name: &&str| {
            let mut chars: Vec<u32> = name.chars().map(u32::from).collect();
            chars.resize(width, 0);
            chars
                .into_iter()
                .flat_map(u32::to_le_bytes)
                .collect::<Vec<u8>>()
        };
        names.iter().flat_map(chars).collect()
    }

    fn read(bytes: Vec<u8>, joints: Option<&[String]>) -> Result<NpzTake> {
        NpzTake::read(Input::new("x.npz", Cursor::new(bytes))?, joints)
    }

    /// AMASS' markers: two frames of two markers.
    fn amass(is_packed: bool) -> Vec<u8> {
        let values = [
            0.1,
            0.2,
            1.5,
            0.3,
            0.4,
            f64::NAN,
            0.1,
            0.2,
            1.6,
            0.3,
            0.4,
            1.0,
        ];
        archive(
            &[
                ("trans", "<f8", &[2, 3], f8(&[0.0; 6])),
                ("poses", "<f8", &[2, 156], f8(&[0.0; 312])),
                ("betas", "<f8", &[16], f8(&[0.0; 16])),
                ("mocap_framerate", "<i8", &[], 120i64.to_le_bytes().to_vec()),
                ("marker_data", "<f8", &[2, 2, 3], f8(&values)),
                ("marker_labels", "<U4", &[2], wide(&["LFHD", "C7"], 4)),
            ],
            is_packed,
        )
    }

    #[test]
    fn markers_of_amass_have_names_a_rate_and_a_unit() {
        for is_packed in [false, true] {
            let read = read(amass(is_packed), None).unwrap();
            let take = &read.take;
            assert_eq!(take.points, ["LFHD", "C7"]);
            assert_eq!((take.rate, take.xyz.dim()), (Some(120.0), (2, 6)));
            assert_eq!(
                (take.units.as_deref(), take.up.as_deref()),
                (Some("m"), Some("+Z"))
            );
            assert!(take.notes[0].contains("meters, z up"), "{:?}", take.notes);
            assert!(take.units_are_inferred && take.up_is_inferred);
            assert!(take.xyz[[0, 5]].is_nan());
            let mut new = take.xyz.clone();
            new[[0, 5]] = 1.25;
            let written = read.with_points(new.view()).unwrap();
            let back = super::tests::read(written.clone(), None).unwrap().take;
            assert_eq!(back.xyz[[0, 5]], 1.25);
            assert_eq!((back.points, back.rate), (take.points.clone(), take.rate));
            // Nothing else has changed.
            let old = read.take.xyz.clone();
            let again = super::tests::read(written, None)
                .unwrap()
                .with_points(old.view());
            let again = super::tests::read(again.unwrap(), None).unwrap();
            assert_eq!(
                again.take.xyz[[0, 5]],
                1.25,
                "a missing value takes none away"
            );
        }
        let millimeters = archive(
            &[(
                "marker_data",
                "<f8",
                &[1, 2, 3],
                f8(&[0., 0., 0., 0., 0., 1500.]),
            )],
            false,
        );
        let take = read(millimeters, None).unwrap().take;
        assert_eq!((take.units, take.points.len()), (None, 2));
        assert!(!take.units_are_inferred && take.notes.concat().contains("no body's in meters"));
        // A hand in centimeters, and a body of which one marker flew off.
        let of = |values: &[f64]| {
            is_metric(ArrayView2::from_shape((values.len() / 6, 6), values).unwrap())
        };
        assert!(!of(&[0., 0., 0., 0., 0., 18.]));
        let (body, thrown) = ([0., 0., 0., 0., 0., 1.7], [0., 0., 0., 900., 0., 1.7]);
        assert!(of(&[body, body, thrown].concat()) && !of(&[f64::NAN; 6]));
    }

    #[test]
    fn one_array_of_joints_is_taken() {
        let joints = || ("joints", "<f8", &[1usize, 1, 3][..], f8(&[1., 2., 3.]));
        let other = |name| (name, "<f8", &[1usize, 1, 3][..], f8(&[4., 5., 6.]));
        let named = ("joint_names", "|S4", &[1usize][..], b"hip\0".to_vec());
        let take = |arrays: &[_]| read(archive(arrays, false), None).map(|npz| npz.take);
        let one = take(&[other("body_rotations"), joints(), named.clone()]).unwrap();
        assert_eq!((one.points, one.xyz[[0, 0]]), (vec!["hip".into()], 1.0));
        assert_eq!((one.units, one.up, one.rate), (None, None, None));
        assert_eq!(
            take(&[other("abc"), named.clone()]).unwrap().xyz[[0, 0]],
            4.0
        );
        let fails = |arrays: &[_], part: &str| {
            let said = take(arrays).unwrap_err().to_string();
            assert!(said.contains(part), "{said}");
        };
        fails(&[other("a"), other("b")], "a (1, 1, 3), b (1, 1, 3)");
        fails(&[joints()], "the option `joints`");
        fails(&[other("poses")], "SMPL body and no positions");
        fails(&[("a", "<f8", &[3], f8(&[1.; 3]))], "it has a (3)");
        fails(&[("meta", "|u1", &[1], vec![0])], "a model of posing");
        // What others keep under this name.
        let meta = ("meta", "|S4", &[1usize][..], b"walk".to_vec());
        let with_meta = take(&[joints(), meta, named.clone()]).unwrap();
        assert_eq!(with_meta.points, ["hip"]);
        fails(&[("joints", "<f8", &[0, 1, 3], vec![]), named], "no frames");
        let hips = ["hips".to_string()];
        let named = read(archive(&[joints()], true), Some(&hips)).unwrap();
        assert_eq!(named.take.points, hips);
    }

    #[test]
    fn damage_is_reported() {
        let bytes = amass(false);
        for cut in [4, 40, bytes.len() / 2, bytes.len() - 3] {
            assert!(read(bytes[..cut].to_vec(), None).is_err(), "{cut}");
        }
        let fails = read(b"PK\x05\x06".iter().copied().chain([0; 18]).collect(), None);
        assert!(fails.unwrap_err().to_string().contains("without arrays"));
    }
}
