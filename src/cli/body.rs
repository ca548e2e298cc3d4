//! What the commands of bodies share: models, meshes in centimeters, maps, tables of rotations and
//! shapes.

use super::args::InputArgs;
use super::number_table::{self, NumberTable};
use super::pair_file::PairFile;
use super::paths::check_read;
use super::{input, messages};
use crate::body::animation::{Animation, MarkerFrame, Offsets, animate};
use crate::body::file::part_name;
use crate::body::fit::Fit;
use crate::body::joint_markers::joint_markers;
use crate::body::take::BodyTake;
use crate::body::{BodyModel, Marker, MarkerModel};
use crate::io::text::excerpt;
use crate::io::{MeshSet, Table};
use crate::numeric::statistics::median;
use crate::pose::Poses;
use crate::pose::rotation::{from_rotation_vector, rotation_vector};
use crate::pose::units::Units;
use crate::restore::{Denoise, Restorer};
use crate::{Error, Place, Result};
use glam::{DMat3, DVec3};
use ndarray::Array2;
use std::path::Path;

/// The largest number of a shape, standard deviations.
const LARGEST_SHAPE: f64 = 100.0;

/// Opens a body model.
///
/// # Errors
/// The file cannot be read, or is no body.
pub fn open_body(path: &Path) -> Result<BodyModel> {
    let model = input::open_model(path)?;
    BodyModel::from_model(&model, &path.display().to_string())
}

/// Reads meshes in centimeters, y up, and checks that they can be bodies.
///
/// # Errors
/// [`Error::Data`]: no sound meshes, other topology than the first, faces without area, or a size
/// that no body has.
pub fn read_meshes<P: AsRef<Path>>(paths: &[P], units: Units) -> Result<MeshSet> {
    let mut set = MeshSet::open(paths)?;
    check_read(&set.names)?;
    for k in 0..set.names.len() {
        let mesh = set.mesh(k);
        let place = || Place::file(&set.names[k]);
        if mesh.faces.is_empty() {
            return Err(Error::data(place(), "has no faces, expected a surface"));
        }
        let scale = units.unit.centimeters() / 100.0;
        mesh.plausible_height(scale).map_err(|e| e.at(place()))?;
    }
    set.faces
        .iter_mut()
        .for_each(|f| *f = units.up.triangle(*f));
    let mut xyz = [0.0; 3];
    for mut row in set.vertices.rows_mut() {
        (0..3).for_each(|a| xyz[a] = f64::from(row[a]));
        units.read(&mut xyz);
        (0..3).for_each(|a| row[a] = xyz[a] as f32);
    }
    Ok(set)
}

/// The vertices of mesh `k` of a set.
pub fn vertices(set: &MeshSet, k: usize) -> Vec<DVec3> {
    let rows = set.vertices.index_axis(ndarray::Axis(0), k);
    (rows.rows().into_iter())
        .map(|r| DVec3::new(f64::from(r[0]), f64::from(r[1]), f64::from(r[2])))
        .collect()
}

/// Reads which vertex each point is on (`point,vertex`); markers in the order of the file, and the
/// names of their points.
///
/// # Errors
/// [`Error::Data`], with the line: a vertex that is not there, or a point twice.
pub fn read_marker_map(path: &Path, vertices: usize) -> Result<(Vec<String>, Vec<Marker>)> {
    let file = PairFile::read(path, ["point", "vertex"])?;
    let (mut names, mut markers): (Vec<String>, Vec<Marker>) = (Vec::new(), Vec::new());
    for (line, point, vertex) in &file.rows {
        if names.contains(point) {
            let what = format!("puts the point \"{}\" on a second vertex", excerpt(point));
            return Err(Error::data(Place::line(&file.name, *line), what));
        }
        names.push(point.clone());
        markers.push(Marker::on(file.index(*line, vertex, "vertex", vertices)?));
    }
    Ok((names, markers))
}

/// The columns of the points `names`, which `whose` names, of a pose table.
///
/// # Errors
/// [`Error::Data`]: the table lacks some of them.
fn columns_of(poses: &Poses, names: &[String], whose: &str, source: &str) -> Result<Vec<usize>> {
    let at = |name: &String| poses.points.iter().position(|p| p == name);
    let missing: Vec<&str> = (names.iter())
        .filter(|n| at(n).is_none())
        .map(String::as_str)
        .collect();
    match missing.first() {
        None => Ok(names.iter().filter_map(at).collect()),
        Some(first) => {
            let what = format!(
                "lacks {} of the {} points of {whose}, the first is \"{}\"",
                missing.len(),
                names.len(),
                excerpt(first)
            );
            Err(Error::data(Place::file(source), what))
        }
    }
}

/// The points at `columns` of a frame; `None` is missing.
pub fn points_of(poses: &Poses, frame: usize, columns: &[usize]) -> Vec<Option<DVec3>> {
    let row = poses.frame(frame);
    let point = |c: &usize| DVec3::new(row[3 * c], row[3 * c + 1], row[3 * c + 2]);
    (columns.iter().map(point))
        .map(|p| p.is_finite().then_some(p))
        .collect()
}

/// The frames of the points `names` of a table, which `whose` names; each is a marker of the body.
///
/// # Errors
/// [`Error::Data`]: the table lacks a marker, or its points spread as no body's do.
pub fn marker_frames(
    body: &BodyModel,
    markers: &[Marker],
    table: &Table,
    names: &[String],
    whose: &str,
) -> Result<Vec<MarkerFrame>> {
    let columns = columns_of(&table.poses, names, whose, &table.name)?;
    let frames = 0..table.poses.frames();
    let mut frames: Vec<MarkerFrame> = frames
        .map(|t| points_of(&table.poses, t, &columns))
        .collect();
    check_points(body, markers, &mut frames, &table.name)?;
    Ok(frames)
}

/// Takes points that are far from all others for missing, and says so: one of them would ruin a
/// fit. Fails if the points of a table cannot be on the body in centimeters: they spread three
/// times as far as its vertices do, or less than a third.
///
/// # Errors
/// [`Error::Data`]: with the remedy, `--units`.
fn check_points(
    body: &BodyModel,
    markers: &[Marker],
    frames: &mut [Vec<Option<DVec3>>],
    source: &str,
) -> Result<()> {
    let Some(fullest) = frames.iter().max_by_key(|f| f.iter().flatten().count()) else {
        return Ok(());
    };
    let rest = |m: &Marker| -> DVec3 {
        let weighted = m
            .vertices
            .iter()
            .map(|(v, w)| body.template.vertices[*v] * *w);
        weighted.sum()
    };
    let seen = fullest.iter().zip(markers).filter(|(f, _)| f.is_some());
    let (found, expected) = (
        spread(fullest.iter().flatten().copied()),
        spread(seen.map(|(_, m)| rest(m))),
    );
    if expected > 0.0 && !(0.33..3.0).contains(&(found / expected)) {
        let what = format!(
            "its points spread over {found:.2} cm, those of the body over {expected:.1} cm; \
             convert them with posing trim --units UNIT --out-units cm"
        );
        return Err(Error::data(Place::file(source), what));
    }
    ignore_strays(frames, 6.0 * spread(body.template.vertices.iter().copied()));
    Ok(())
}

/// The medians of the coordinates.
fn middle(points: impl Iterator<Item = DVec3> + Clone) -> DVec3 {
    let of = |axis: usize| median(points.clone().map(|p| p[axis]).collect());
    DVec3::from_array([0, 1, 2].map(|axis| of(axis).unwrap_or_default()))
}

/// The median distance from the middle.
fn spread(points: impl Iterator<Item = DVec3> + Clone) -> f64 {
    let middle = middle(points.clone());
    median(points.map(|p| (p - middle).length()).collect()).unwrap_or_default()
}

/// Takes points that are farther than `reach` from the median of their frame for missing.
fn ignore_strays(frames: &mut [Vec<Option<DVec3>>], reach: f64) {
    let mut strays = 0;
    for frame in frames {
        let middle = middle(frame.iter().flatten().copied());
        for point in frame.iter_mut() {
            if point.is_some_and(|p| (p - middle).length() > reach) {
                *point = None;
                strays += 1;
            }
        }
    }
    if strays > 0 {
        messages::info(&format!(
            "ignored {strays} points more than {reach:.0} cm from the others of their frame"
        ));
    }
}

/// The columns of a table of rotations.
fn rotation_columns(parts: usize) -> Vec<String> {
    let of_part = |p| ["rx", "ry", "rz"].map(|a| format!("{}.{a}", part_name(p)));
    let mut columns: Vec<String> = (0..parts).flat_map(of_part).collect();
    columns.extend(["root.x", "root.y", "root.z"].map(String::from));
    columns
}

/// Writes a table of rotations: of each frame the rotation vectors of the parts, radians, and the
/// root, centimeters. A frame without an answer has empty cells.
///
/// # Errors
/// When the file cannot be written.
pub fn write_rotations(
    path: &Path,
    poses: &Poses,
    parts: usize,
    frames: &[Option<(Vec<DMat3>, DVec3)>],
) -> Result<()> {
    let columns = rotation_columns(parts);
    let mut values = Array2::from_elem((frames.len(), columns.len()), f64::NAN);
    for (frame, mut row) in frames.iter().zip(values.rows_mut()) {
        if let Some((rotations, root)) = frame {
            let vectors = rotations.iter().map(rotation_vector);
            let numbers = vectors.chain([*root]).flat_map(|v| v.to_array());
            row.iter_mut().zip(numbers).for_each(|(to, v)| *to = v);
        }
    }
    number_table::write(path, poses, &columns, &values)
}

/// Writes a table of shapes; a frame without an answer has empty cells.
///
/// # Errors
/// When the file cannot be written.
pub fn write_shapes(
    path: &Path,
    poses: &Poses,
    components: usize,
    frames: &[Option<Vec<f64>>],
) -> Result<()> {
    let columns: Vec<String> = (1..=components).map(|k| format!("shape{k}")).collect();
    let at = |(t, k): (usize, usize)| frames[t].as_ref().map_or(f64::NAN, |shape| shape[k]);
    let values = Array2::from_shape_fn((frames.len(), components), at);
    number_table::write(path, poses, &columns, &values)
}

/// The rotations and roots of a table; the root is 0 where the table has none.
pub struct RotationTable {
    /// The table.
    pub table: NumberTable,
    /// The rotations of the parts, and the root, of each row; `None` where all cells are empty.
    pub frames: Vec<Option<(Vec<DMat3>, DVec3)>>,
}

/// Reads a table of rotations.
///
/// # Errors
/// [`Error::Data`]: a part of the body has no columns, or a row lacks a number.
pub fn read_rotations(path: &Path, parts: usize) -> Result<RotationTable> {
    let table = number_table::read(path)?;
    let at = |name: &String| table.columns.iter().position(|c| c == name);
    let names = rotation_columns(parts);
    let columns: Vec<Option<usize>> = names.iter().map(at).collect();
    if let Some(k) = (0..3 * parts).find(|k| columns[*k].is_none()) {
        let what = format!(
            "has no column {}; the body has {parts} parts, three numbers each",
            names[k]
        );
        return Err(Error::data(Place::line(&table.name, 1), what));
    }
    let mut frames = Vec::with_capacity(table.values.nrows());
    for (t, row) in table.values.rows().into_iter().enumerate() {
        let number = |k: usize| columns[k].map_or(0.0, |c| row[c]);
        let vector = |k: usize| DVec3::new(number(k), number(k + 1), number(k + 2));
        if columns.iter().flatten().all(|c| row[*c].is_nan()) {
            frames.push(None);
            continue;
        }
        if let Some(k) = (0..names.len()).find(|k| number(*k).is_nan()) {
            let what = format!("{} is empty", names[k]);
            return Err(Error::data(Place::line(&table.name, t as u64 + 2), what));
        }
        let rotations = (0..parts).map(|p| from_rotation_vector(vector(3 * p)));
        frames.push(Some((rotations.collect(), vector(3 * parts))));
    }
    Ok(RotationTable { table, frames })
}

/// The shapes of a flag: numbers with commas between them, or a table `take,time,shape1,...` whose
/// empty rows have none. Rows that are all alike are one.
///
/// # Errors
/// The table cannot be read or has no column shape1, a row is empty in part, or there are more
/// numbers than the body has components.
pub fn read_shapes(text: &str, components: usize) -> Result<Vec<Option<Vec<f64>>>> {
    let list: Option<Vec<f64>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
    let mut shapes = match list {
        Some(list) => vec![Some(list)],
        None => shape_rows(Path::new(text))?,
    };
    for shape in shapes.iter().flatten() {
        if shape.len() > components {
            return Err(Error::usage(format!(
                "--shape has {} numbers, the body has {components} components",
                shape.len()
            )));
        }
        if let Some(v) = shape.iter().find(|v| !(v.abs() <= LARGEST_SHAPE)) {
            return Err(Error::usage(format!(
                "--shape: {v} is no shape; numbers are standard deviations of people, within \
                 {LARGEST_SHAPE}"
            )));
        }
    }
    let first = shapes.iter().flatten().next().cloned();
    if shapes.iter().flatten().all(|s| Some(s) == first.as_ref()) {
        shapes = vec![first];
    }
    Ok(shapes)
}

/// The rows of a table of shapes.
fn shape_rows(path: &Path) -> Result<Vec<Option<Vec<f64>>>> {
    let table = number_table::read(path)?;
    let columns: Vec<usize> = (1..)
        .map_while(|k| table.columns.iter().position(|c| *c == format!("shape{k}")))
        .collect();
    if columns.is_empty() {
        let what = "has no column shape1";
        return Err(Error::data(Place::line(&table.name, 1), what));
    }
    let row = |(t, row): (usize, ndarray::ArrayView1<'_, f64>)| {
        let numbers: Vec<f64> = columns.iter().map(|c| row[*c]).collect();
        match numbers.iter().filter(|v| v.is_nan()).count() {
            0 => Ok(Some(numbers)),
            n if n == numbers.len() => Ok(None),
            _ => {
                let what = "has empty cells; give all numbers of a shape, or none";
                Err(Error::data(Place::line(&table.name, t as u64 + 2), what))
            }
        }
    };
    table
        .values
        .rows()
        .into_iter()
        .enumerate()
        .map(row)
        .collect()
}

/// How far joints of a pose table stand from those of a body, centimeters: a skeleton's are not
/// where the mesh has them.
const JOINT_NOISE: f64 = 2.0;

/// Takes noise from the paths of points, by themselves, where a rate is known.
///
/// # Errors
/// Those of [`Restorer::denoise`].
pub fn smooth(table: &mut Table, fps: Option<f64>) -> Result<()> {
    if fps.is_none() {
        return Ok(());
    }
    let options = Denoise {
        fps,
        ..Denoise::default()
    };
    let xyz = Restorer::without_model()
        .denoise(table, &options)?
        .xyz()
        .to_owned();
    table.poses.xyz = xyz;
    Ok(())
}

/// Fits a take of the markers `names`; says how near they are, and how many lines of findings it
/// told.
///
/// # Errors
/// [`Error::Data`]: no frame has markers enough.
pub fn fit_take(
    body: &BodyModel,
    (names, markers): (&[String], &[Marker]),
    frames: &[MarkerFrame],
    noise: f64,
    offsets: Offsets,
    source: &str,
) -> Result<(Animation, usize)> {
    let model = MarkerModel::new(body, markers);
    let mut prior = body.fit_prior();
    prior.noise = noise;
    let animation =
        animate(&model, &prior, frames, offsets).map_err(|e| e.at(Place::file(source)))?;
    let rms: Vec<f64> = animation.fits.iter().flatten().map(|f| f.rms).collect();
    report_fits(rms, frames.len(), "points are", "the body");
    report_free_parts(&model, frames, source);
    let fits: Vec<&Fit> = animation.fits.iter().flatten().collect();
    let findings = report_markers(&fits, source, names);
    Ok((animation, findings))
}

/// Names parts of which no marker is seen: only the model says where they are.
pub fn report_free_parts(model: &MarkerModel, frames: &[MarkerFrame], source: &str) {
    let is_seen = |frame: &MarkerFrame, part: usize| {
        let mut seen = frame.iter().enumerate().filter(|(_, p)| p.is_some());
        seen.any(|(m, _)| model.part_of(m) == part)
    };
    let free = |part: &usize| frames.iter().filter(|f| !is_seen(f, *part)).count();
    let free: Vec<(usize, usize)> = (0..model.parts()).map(|p| (p, free(&p))).collect();
    let always: Vec<String> = (free.iter())
        .filter(|(_, count)| *count == frames.len())
        .map(|(part, _)| part_name(*part))
        .collect();
    if !always.is_empty() {
        messages::info(&format!(
            "{source}: no marker is seen on {}: the model and the other parts say where they are",
            always.join(", ")
        ));
    }
    let at_times = free.iter().filter(|(_, n)| *n > 0 && *n < frames.len());
    let at_times: Vec<String> = at_times
        .map(|(part, count)| format!("{} ({count} frames)", part_name(*part)))
        .collect();
    if !at_times.is_empty() {
        messages::info(&format!(
            "{source}: at times no marker is seen on {}",
            at_times.join(", ")
        ));
    }
}

/// Says how far points are from their bodies, by the RMS of each frame that has one, and how many
/// of all `frames` have none.
pub fn report_fits(rms: Vec<f64>, frames: usize, points: &str, body: &str) {
    let (found, missed) = (rms.len(), frames - rms.len());
    let worst = rms.iter().copied().fold(0.0, f64::max);
    messages::info(&format!(
        "{found} frames: {points} {:.2} cm from {body} (median), {worst:.2} at most",
        median(rms).unwrap_or_default()
    ));
    if missed > 0 {
        messages::info(&format!(
            "no body in {missed} frames, which have fewer than four points"
        ));
    }
}

/// Tells which markers do not fit their bodies, and bodies that are mirrored; how many lines that
/// are.
pub fn report_markers(fits: &[&Fit], source: &str, names: &[String]) -> usize {
    let mirrored = fits.iter().filter(|fit| fit.is_mirrored).count();
    if mirrored > 0 {
        messages::info(&format!(
            "{source}: left and right are exchanged, or the markers mirrored, in {mirrored} of {} \
             frames: their mirror image fits far better",
            fits.len()
        ));
    }
    let mut lines = usize::from(mirrored > 0);
    let fits: Vec<_> = fits.iter().filter(|fit| !fit.is_mirrored).collect();
    for (m, name) in names.iter().enumerate() {
        let own = fits.iter().flat_map(|fit| &fit.left_out);
        let own: Vec<f64> = own.filter(|(out, _)| *out == m).map(|(_, d)| *d).collect();
        if own.is_empty() {
            continue;
        }
        lines += 1;
        messages::info(&format!(
            "{source}: {name} does not fit: it is {:.1} cm from its place on the body (median) and \
             is left out in {} of {} frames",
            median(own.clone()).unwrap_or_default(),
            own.len(),
            fits.len()
        ));
    }
    lines
}

/// The take of a pose table whose joints the body's model names.
///
/// # Errors
/// The table cannot be read, lacks joints or is of another unit, or the model has no names of
/// joints.
pub fn pose_take(body: &BodyModel, flags: &InputArgs) -> Result<BodyTake> {
    if body.joint_names.is_empty() {
        return Err(Error::usage(
            "the body does not know which joints its parts begin at; train it with body-train \
             --joints JOINTS.csv",
        ));
    }
    let mut table = input::read_table(flags, false, false)?;
    let fps = flags.rate(&table.poses)?;
    smooth(&mut table, fps)?;
    let names: Vec<String> = body.joint_names.iter().map(|(_, n)| n.clone()).collect();
    let markers = joint_markers(&body.template, &body.joint_names);
    let frames = marker_frames(body, &markers, &table, &names, "the body")?;
    let (animation, _) = fit_take(
        body,
        (&names, &markers),
        &frames,
        JOINT_NOISE,
        Offsets::Learned,
        &table.name,
    )?;
    Ok(BodyTake::of(body, &animation, &table.poses, fps))
}
