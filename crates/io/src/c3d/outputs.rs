//! What a model computed, written into the C3D file that it was computed from: angles, forces,
//! moments and powers as points, and events.

use super::parameters::{Parameters, TEXT, text};
use super::stored_parameters::{StoredParameters, text_values};
use super::write::{MOST_ITEMS, MOST_POINTS, text_value};
use super::{
    BLOCK, C3d, LIMIT, LISTS, Layout, Quantity, events, labels, own_name, parameter_section, points,
};
use crate::{FileEvent, Place, Result};
use std::collections::BTreeMap;

/// The first byte of the word of the header that counts the points.
const POINTS: usize = 2;

/// What a model computed of a joint or a segment, as C3D files store it: a point.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputPoint {
    /// Its name, such as `LKneeAngles`.
    pub name: String,
    /// What it is: the parameter that lists such points will name it.
    pub quantity: Quantity,
    /// Its three numbers in each frame; NaN where they are not known.
    pub values: Vec<[f64; 3]>,
}

impl C3d {
    /// The bytes of the file with these outputs of a model, and with the left and right ones of
    /// `events`. Analog values, markers and all other points stay byte for byte, as do events of
    /// other contexts and the parameters but those that count, name and list points and events.
    ///
    /// Points that have the name of an output, also behind a subject's (`Name:LKneeAngles`), get
    /// its values; outputs that the file stores and that are not among these become invalid. New
    /// points follow the others.
    ///
    /// # Errors
    /// [`Error::Data`](crate::Error::Data): the file's points are integers, its parameters are
    /// damaged or have no room, its counts contradict each other, it ends early, or an output has
    /// another number of frames.
    pub fn with_outputs(&self, outputs: &[OutputPoint], events: &[FileEvent]) -> Result<Vec<u8>> {
        let written = self.outputs_written(outputs, events);
        written.map_err(|e| e.at(Place::file(&self.take.name)))
    }

    fn outputs_written(&self, outputs: &[OutputPoint], events: &[FileEvent]) -> Result<Vec<u8>> {
        let layout = &self.layout;
        if !layout.real {
            let what = "stores its points as integers, which do not hold angles; export it with \
                        real numbers";
            return Err(what.into());
        }
        if let Some(output) = outputs.iter().find(|o| o.values.len() != layout.frames) {
            let (name, frames) = (&output.name, output.values.len());
            let what = format!("has {} frames, {name} {frames}", layout.frames);
            return Err(what.into());
        }
        let changes = self.changes(outputs);
        let last = changes.last_key_value().map_or(0, |(p, _)| p + 1);
        let count = last.max(layout.points);
        if count > MOST_POINTS {
            return Err(format!("has no room for more than {MOST_POINTS} points").into());
        }
        let mut parameters = StoredParameters::of(self, "it takes no outputs")?;
        let group = parameters.group("POINT");
        let group = group.ok_or("has no parameters of points: it takes no outputs")?;
        let new = changes.range(layout.points..);
        let new: Vec<&OutputPoint> = new.filter_map(|(_, output)| *output).collect();
        set_points(&mut parameters, group, layout, &new)?;
        set_lists(&mut parameters, group, outputs)?;
        events::set_events(&mut parameters, self, events)?;
        let frames = self.frames_with(&changes, count)?;
        let bytes = parameters.finish(&frames);
        let mut bytes = bytes.ok_or("has no room for the names of the outputs")?;
        let word = layout.processor.u16_bytes(count as u16);
        bytes[POINTS..POINTS + 2].copy_from_slice(&word);
        self.check(&bytes, count)?;
        Ok(bytes)
    }

    /// What the points that change hold then, by their indices.
    fn changes<'a>(&self, outputs: &'a [OutputPoint]) -> BTreeMap<usize, Option<&'a OutputPoint>> {
        let labels = labels(&self.parameters, self.layout.points);
        let own: Vec<&str> = labels.iter().map(|label| own_name(label)).collect();
        let mut changes: BTreeMap<usize, Option<&OutputPoint>> = BTreeMap::new();
        let mut count = labels.len();
        for output in outputs {
            let is_named = |p: &usize| own[*p] == output.name || labels[*p].trim() == output.name;
            let mut points = (0..labels.len()).filter(is_named);
            count += usize::from(points.clone().next().is_none());
            changes.insert(points.next().unwrap_or(count - 1), Some(output));
            // Other points of the same name hold what is not known any more.
            for other in points {
                changes.entry(other).or_insert(None);
            }
        }
        changes
    }

    /// The bytes from the first frame on, with `count` points a frame.
    fn frames_with(
        &self,
        changes: &BTreeMap<usize, Option<&OutputPoint>>,
        count: usize,
    ) -> Result<Vec<u8>> {
        let layout = &self.layout;
        let width = 4 * layout.number_bytes();
        let added = (count - layout.points) * width;
        let size = added.checked_mul(layout.frames);
        let size = size.and_then(|n| n.checked_add(self.bytes.len()));
        let size = size.filter(|n| *n as u64 <= LIMIT);
        let mut out = Vec::with_capacity(size.ok_or("would be too large with the outputs")?);
        for t in 0..layout.frames {
            let [point, analog] = [0, layout.points].map(|p| layout.point_at(t, p));
            let first = out.len();
            out.extend(&self.bytes[point..analog]);
            out.resize(first + count * width, 0);
            for (p, output) in changes {
                let value = output.map(|output| output.values[t]);
                let value = value.filter(|v| v.iter().all(|v| (*v as f32).is_finite()));
                let value = points::encode(value, layout);
                let value = value.map_err(|v| format!("does not hold {v}"))?;
                out[first + p * width..][..width].copy_from_slice(&value);
            }
            out.extend(&self.bytes[analog..layout.point_at(t + 1, 0)]);
        }
        // What follows begins with a block.
        out.resize(out.len().next_multiple_of(BLOCK), 0);
        let behind = self.bytes.get(layout.end().next_multiple_of(BLOCK)..);
        out.extend(behind.unwrap_or_default());
        Ok(out)
    }

    /// Checks that the file is read as it is meant.
    fn check(&self, bytes: &[u8], points: usize) -> Result<()> {
        let (processor, section) = parameter_section(bytes, &mut Vec::new())?;
        let first = bytes.len() - section.len();
        let own = section.get(..section[2] as usize * BLOCK);
        let parameters = Parameters::read(own.unwrap_or(section), processor);
        let read = Layout::read(bytes, processor, &parameters, first, false, &mut Vec::new());
        let shape = |layout: &Layout| (layout.frames, layout.first_frame, layout.analog);
        let is_right = |read: &Layout| read.points == points && shape(read) == shape(&self.layout);
        if parameters.broken.is_some() || !read.is_ok_and(|read| is_right(&read)) {
            let what = "ends early, or its counts contradict each other: it takes no outputs";
            return Err(what.into());
        }
        Ok(())
    }
}

/// Whether a quantity is one of those that only models compute.
fn is_computed(quantity: Quantity) -> bool {
    use Quantity::{Angles, Force, Moment, Power};
    [Angles, Force, Moment, Power].contains(&quantity)
}

/// Counts and names new points behind the others.
fn set_points(
    parameters: &mut StoredParameters<'_>,
    group: u8,
    layout: &Layout,
    new: &[&OutputPoint],
) -> Result<()> {
    let count = layout.points + new.len();
    parameters.set_count(group, "USED", count as u16)?;
    if new.is_empty() {
        return Ok(());
    }
    let mut labels = parameters.texts(group, "LABELS").unwrap_or_default();
    labels.resize(layout.points, Vec::new());
    labels.extend(new.iter().map(|output| output.name.clone().into_bytes()));
    parameters.set(group, "LABELS", text_values(&labels)?)?;
    // Where each point has one.
    let descriptions = parameters.texts(group, "DESCRIPTIONS");
    if let Some(mut all) = descriptions.filter(|all| all.len() >= layout.points) {
        all.truncate(layout.points);
        all.resize(count, Vec::new());
        parameters.set(group, "DESCRIPTIONS", text_values(&all)?)?;
    }
    Ok(())
}

/// Lists the outputs by their quantities.
fn set_lists(
    parameters: &mut StoredParameters<'_>,
    group: u8,
    outputs: &[OutputPoint],
) -> Result<()> {
    let types = parameters.items(group, "TYPE_GROUPS", 1);
    let mut types = types.filter(|all| all.kind == TEXT).unwrap_or_default();
    let before = types.items.len();
    for (list, quantity) in LISTS.into_iter().filter(|(_, q)| is_computed(*q)) {
        let stored = parameters.texts(group, list).unwrap_or_default();
        let mut listed = stored.clone();
        let is_other = |name: &str| {
            outputs
                .iter()
                .any(|o| o.name == name && o.quantity != quantity)
        };
        listed.retain(|name| !is_other(&text(name)));
        for output in outputs.iter().filter(|o| o.quantity == quantity) {
            if listed.iter().all(|name| text(name) != output.name) {
                listed.push(output.name.clone().into_bytes());
            }
        }
        // Pairs of the list and what it is of: ANGLES and ANGLE.
        let mut lists = types.items.iter().step_by(2);
        if !listed.is_empty() && lists.all(|name| text(name) != list) {
            let pair = [list, list.trim_end_matches('S')];
            types
                .items
                .extend(pair.map(|name| name.as_bytes().to_vec()));
        }
        if listed != stored {
            parameters.set(group, list, text_values(&listed)?)?;
        }
    }
    let count = types.items.len();
    if types.kind == TEXT && count > before && count.is_multiple_of(2) && count <= MOST_ITEMS {
        let mut value = text_value(&types.items);
        if types.dimensions == 3 {
            value.splice(1..4, [3, value[2], 2, value[3] / 2]);
        }
        parameters.set(group, "TYPE_GROUPS", vec![value])?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::parameters::Entry;
    use super::super::write::NewC3d;
    use super::*;
    use crate::Input;
    use ndarray::Array2;
    use std::path::PathBuf;

    const NAMES: [&str; 4] = ["LASI", "Anna:LKneeAngles", "RHipPower", "RASI"];

    fn read(bytes: Vec<u8>) -> Result<C3d> {
        C3d::read(Input::new("walk.c3d", std::io::Cursor::new(bytes))?, true)
    }

    fn walk() -> C3d {
        let points = NAMES.map(str::to_string);
        let new = NewC3d {
            points: &points,
            rate: 100.0,
            first_frame: 5,
            units: "mm",
            screen: ["+X", "+Z"],
        };
        let mut xyz = Array2::from_shape_fn((6, 12), |(t, c)| (t * 7 + c) as f64 / 3.0);
        xyz[[2, 0]] = f64::NAN;
        read(new.bytes(xyz.view()).unwrap()).unwrap()
    }

    fn outputs(count: usize, frames: usize) -> Vec<OutputPoint> {
        use Quantity::{Angles, Force, Moment, Power};
        let output = |n: usize| {
            let mut values = vec![[0.5 + n as f64, -0.0, 0.25]; frames];
            values
                .iter_mut()
                .skip(1)
                .step_by(4)
                .for_each(|v| v[1] = f64::NAN);
            OutputPoint {
                name: format!("L{n}Output").replace("L0Output", "LKneeAngles"),
                quantity: [Angles, Force, Moment, Power][n % 4],
                values,
            }
        };
        (0..count).map(output).collect()
    }

    fn event(context: &str, label: &str, time: f64) -> FileEvent {
        FileEvent {
            context: context.to_string(),
            label: label.to_string(),
            time,
        }
    }

    fn steps() -> [FileEvent; 3] {
        [
            event("Left", "Foot Strike", 0.25),
            event("Right", "Foot Off", 61.5),
            event("Left", "Foot Off", 130.0),
        ]
    }

    /// The parameters that stay, without the offsets to the next.
    fn kept(file: &C3d) -> Vec<Vec<u8>> {
        let (processor, section) = parameter_section(&file.bytes, &mut Vec::new()).unwrap();
        let stored = StoredParameters::of(file, "").unwrap();
        let groups = ["POINT", "EVENT", "ROTATION"].map(|name| stored.group(name));
        let (mut next, mut all) = (Some(4), Vec::new());
        while let Some((at, entry)) =
            next.and_then(|at| Some((at, Entry::at(section, at, processor)?)))
        {
            let free = [
                "USED",
                "LABELS",
                "DESCRIPTIONS",
                "TYPE_GROUPS",
                "DATA_START",
            ];
            let lists = LISTS[..4].iter().map(|(list, _)| *list);
            let is_free = match groups.iter().position(|group| *group == Some(entry.group)) {
                Some(0) => free
                    .into_iter()
                    .chain(lists)
                    .any(|n| entry.name.starts_with(n)),
                Some(1) => true,
                group => group.is_some() && entry.name == "DATA_START",
            };
            let end = entry.next.or(entry.end(section)).unwrap();
            let parts = [at..entry.offset_at, entry.offset_at + 2..end];
            all.extend((!is_free).then(|| parts.map(|part| &section[part]).concat()));
            next = entry.next;
        }
        all
    }

    /// Writes outputs and events into a file, and checks what comes back.
    fn check(file: &C3d, outputs: &[OutputPoint], steps: &[FileEvent]) -> C3d {
        let bytes = file.with_outputs(outputs, steps).unwrap();
        let back = read(bytes.clone()).unwrap();
        assert!(back.with_outputs(outputs, steps).unwrap() == bytes);
        assert_eq!(kept(&back), kept(file));
        let changes = file.changes(outputs);
        let range = |file: &C3d, t: usize, p: usize, width: usize| {
            let at = file.layout.point_at(t, p);
            file.bytes[at..at + width].to_vec()
        };
        let points = file.layout.points;
        for t in 0..file.layout.frames {
            for p in (0..points).filter(|p| !changes.contains_key(p)) {
                assert_eq!(range(&back, t, p, 16), range(file, t, p, 16));
            }
            let analog = 4 * file.layout.analog;
            let new = range(&back, t, back.layout.points, analog);
            assert_eq!(new, range(file, t, points, analog));
        }
        for (p, output) in &changes {
            let values = back.take.xyz.slice(ndarray::s![.., 3 * p..3 * p + 3]);
            let Some(output) = output else {
                assert!(values.iter().all(|v| v.is_nan()));
                continue;
            };
            assert_eq!(own_name(&back.take.points[*p]), output.name);
            assert_eq!(back.take.quantities[*p], output.quantity);
            for (read, value) in values.rows().into_iter().zip(&output.values) {
                let is_known = !value[1].is_nan();
                assert!(
                    read.iter()
                        .zip(value)
                        .all(|(a, b)| a == b || !is_known && a.is_nan())
                );
            }
        }
        let mut sides = back.events();
        sides.retain(|event| event.context != "Other" && event.context != "General");
        assert_eq!(sides, steps);
        back
    }

    #[test]
    fn outputs_and_events_come_back_and_all_else_stays() {
        for count in [0, 1, 7, 300] {
            let file = walk();
            let back = check(&file, &outputs(count, 6), &steps());
            assert_eq!(back.bytes.len() % BLOCK, 0);
            assert_eq!(back.take.points.len(), 4 + count.saturating_sub(1));
            assert_eq!(back.take.points[..4], NAMES);
            // What is not given stays.
            assert_eq!(back.take.xyz.column(6), file.take.xyz.column(6));
            assert_eq!(back.take.notes, Vec::<String>::new());
            // Outputs that are no longer given stay, and the events go.
            let less = check(&back, &[], &[]);
            let [before, after] = [&back, &less].map(|file| file.take.xyz[[0, 3]]);
            assert_eq!(before, after);
        }
    }

    #[test]
    fn locked_parameters_stay_locked() {
        let mut bytes = walk().bytes;
        let at = |bytes: &[u8]| bytes.windows(6).position(|w| w == b"LABELS").unwrap() - 2;
        // The length of the name, below zero.
        let length = at(&bytes);
        bytes[length] = (-6_i8) as u8;
        let new = read(bytes)
            .unwrap()
            .with_outputs(&outputs(3, 6), &[])
            .unwrap();
        assert_eq!(new[at(&new)] as i8, -6);
    }

    #[test]
    fn analog_values_and_what_follows_the_frames_stay() {
        // The last point becomes four analog values.
        let mut bytes = walk().bytes;
        (bytes[2], bytes[4], bytes[18]) = (3, 4, 1);
        bytes.extend([7; 700]);
        let file = read(bytes).unwrap();
        assert_eq!((file.layout.points, file.layout.analog), (3, 4));
        let bytes = file.with_outputs(&outputs(9, 6), &[]).unwrap();
        assert_eq!(bytes[bytes.len() - 700..], [7; 700]);
        let mut bytes = file.bytes.clone();
        bytes.truncate(bytes.len() - 700);
        let back = check(&read(bytes).unwrap(), &outputs(9, 6), &steps());
        assert_eq!(back.take.points[2..4], ["RHipPower", "L1Output"]);
    }

    #[test]
    fn events_of_other_contexts_stay() {
        let bytes = walk().with_outputs(&[], &steps()).unwrap();
        let at = bytes.windows(5).position(|b| b == b"Right").unwrap();
        let mut other = bytes.clone();
        other[at..at + 5].copy_from_slice(b"Other");
        let file = read(other).unwrap();
        let back = check(&file, &outputs(2, 6), &steps()[..1]);
        let right = [steps()[0].clone(), event("Other", "Foot Off", 61.5)];
        assert_eq!(back.events(), right);
        assert_eq!(check(&back, &[], &[]).events(), right[1..]);
    }

    #[test]
    fn files_that_cannot_hold_outputs_are_refused() {
        let file = walk();
        let refused = |file: &C3d, outputs: &[OutputPoint], events: &[FileEvent], what: &str| {
            let said = file.with_outputs(outputs, events).map(|bytes| bytes.len());
            let said = said.unwrap_err().to_string();
            assert!(
                said.starts_with("walk.c3d: ") && said.contains(what),
                "{said}"
            );
        };
        refused(&file, &outputs(2, 5), &[], "has 6 frames, LKneeAngles 5");
        let many = vec![event("Left", "Foot Off", 1.0); 256];
        refused(&file, &[], &many, "255 events at most, not 256");
        refused(&file, &[], &[event("Left", "", f64::NAN)], "without a time");
        let mut long = outputs(1, 6);
        long[0].name = "x".repeat(256);
        refused(&file, &long, &[], "so long a name");
        let mut long = outputs(300, 6);
        (long.iter_mut()).for_each(|o| o.name += &"x".repeat(240));
        refused(&file, &long, &[], "no room for the names");
        let mut integers = file.bytes.clone();
        integers[12..16].copy_from_slice(&1_f32.to_le_bytes());
        refused(&read(integers).unwrap(), &[], &[], "as integers");
        let cut = file.bytes[..file.layout.end() - 80].to_vec();
        refused(&read(cut).unwrap(), &[], &[], "ends early");
        let mut damaged = file.bytes.clone();
        // The type of POINT:USED.
        damaged[BLOCK + 22] = 7;
        refused(
            &read(damaged).unwrap(),
            &[],
            &[],
            "has damaged parameters: it takes no outputs",
        );
    }

    #[test]
    fn damaged_files_do_not_panic() {
        let whole = walk().with_outputs(&outputs(9, 6), &steps()).unwrap();
        let (mut state, mut written) = (1_u64, 0);
        let mut next = |below: usize| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040);
            (state >> 33) as usize % below
        };
        for _ in 0..20_000 {
            let mut bytes = whole.clone();
            for _ in 0..=next(4) {
                bytes[next(1600)] = next(256) as u8;
            }
            if next(8) == 0 {
                bytes.truncate(next(whole.len()));
            }
            let Ok(file) = read(bytes) else { continue };
            let result = file.with_outputs(&outputs(5, file.layout.frames.min(1000)), &steps());
            written += usize::from(result.is_ok_and(|bytes| read(bytes).is_ok()));
            let _ = file.with_names(&[(0, "NAME".to_string())]);
        }
        assert!(written > 2000, "{written}");
    }

    #[test]
    fn files_of_many_makers_take_outputs() {
        let own = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap());
        let mut written = 0;
        for folder in [
            "gait",
            "formats/c3d/pig",
            "formats/c3d/others",
            "formats/c3d/sample01",
        ] {
            let folder = own.join("../../../shared/data").join(folder);
            for entry in std::fs::read_dir(folder).into_iter().flatten() {
                let path = entry.unwrap().path();
                let Ok(file) = C3d::open(&path) else { continue };
                let outputs = outputs(7, file.layout.frames);
                if file.with_outputs(&outputs, &steps()).is_ok() {
                    check(&file, &outputs, &steps());
                    written += 1;
                }
            }
        }
        assert!(written == 0 || written > 25, "{written}");
    }
}
