//! Acclaim skeletons (ASF).
//!
//! `length` in `:units` scales every length: meters = raw / length * 0.0254. Angles are `deg` or
//! `rad`. A bone's own frame is `C = Rz Ry Rx` of its `axis` line, in the order it names; its
//! direction is in global coordinates.

use super::Input;
use super::text::{Lines, check_length, excerpt, parse_number};
use crate::pose::rotation::{Axis, compose, parse_order};
use crate::pose::{Bone, Channel, Dof, Skeleton};
use crate::{Error, Place, Result};
use glam::{DMat3, DVec3};
use std::collections::HashMap;
use std::path::Path;

/// A file with more bones than this is refused: no skeleton has them.
const MOST_BONES: usize = 10_000;

/// A skeleton with the conventions its AMC files follow.
///
/// ```
/// use posing_io::Asf;
///
/// let asf = Asf::open("../../testdata/cmu/09/09.asf")?;
/// assert_eq!(asf.skeleton.bones().len(), 31);
/// assert_eq!(asf.skeleton.find("root"), Some(0));
/// assert!(asf.degrees);
/// # Ok::<(), posing_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Asf {
    /// The bones, in centimeters and radians.
    pub skeleton: Skeleton,
    /// Centimeters in one unit of the files.
    pub unit: f64,
    /// Whether `:units` gives angles in degrees (AMC files may say otherwise).
    pub degrees: bool,
}

impl Asf {
    /// Opens a skeleton file.
    ///
    /// # Errors
    /// [`Error::Io`]: the file cannot be read. [`Error::Data`]: no sound ASF file; the place has
    /// the line.
    pub fn open(path: impl AsRef<Path>) -> Result<Asf> {
        Asf::read(Input::open(path)?, None)
    }

    /// Reads a skeleton from an open input. `unit` (centimeters in one raw unit) overrides the
    /// file's own.
    ///
    /// # Errors
    /// Those of [`Asf::open`].
    pub fn read(input: Input, unit: Option<f64>) -> Result<Asf> {
        let name = input.name.clone();
        let mut lines = Lines::new(name.clone(), input.into_reader());
        let mut parser = Parser::default();
        let mut section = String::new();
        while let Some(line) = lines.next_line()? {
            let text = line.split('#').next().unwrap_or("").trim().to_string();
            let here = lines.here();
            if text.is_empty() {
                continue;
            }
            if let Some(rest) = text.strip_prefix(':') {
                section = rest
                    .split_whitespace()
                    .next()
                    .unwrap_or("")
                    .to_ascii_lowercase();
                continue;
            }
            // Brackets and commas are white space to the format (Acclaim Skeleton File Definition
            // 1.10).
            let words: Vec<&str> = text
                .split(|c: char| c.is_whitespace() || "(),".contains(c))
                .filter(|w| !w.is_empty())
                .collect();
            if words.is_empty() {
                continue;
            }
            match section.as_str() {
                "units" => parser.units(&words),
                "root" => parser.root(&words),
                "bonedata" => parser.bone(&words, here.line.unwrap_or(0)),
                "hierarchy" => parser.hierarchy(&words, here.line.unwrap_or(0)),
                "" => Err("expected a section such as :units; not an ASF file".into()),
                // :version, :name, :documentation and whatever else does not bear on motion.
                _ => Ok(()),
            }
            .map_err(|e: Error| e.at(here))?;
        }
        parser.finish(&name, unit)
    }
}

/// A bone as the file gives it: raw lengths, angles in the file's unit.
#[derive(Default)]
struct RawBone {
    name: String,
    line: u64,
    direction: Option<DVec3>,
    length: Option<f64>,
    axis: Option<([f64; 3], [Axis; 3])>,
    dofs: Vec<Channel>,
    limits: Vec<(f64, f64)>,
}

#[derive(Default)]
struct Parser {
    unit: Option<f64>,
    degrees: Option<bool>,
    root_order: Vec<Channel>,
    position: DVec3,
    orientation: [f64; 3],
    bones: Vec<RawBone>,
    open: Option<RawBone>,
    limits_open: bool,
    /// The line that hangs a child on its parent. (Not the parent's name: one long name with many
    /// children on one line would be copied for each.)
    parents: HashMap<String, u64>,
    children: Vec<(String, Vec<String>)>,
    hierarchy_seen: bool,
}

/// Three numbers.
fn triple(words: &[&str]) -> Result<[f64; 3]> {
    let [a, b, c] = words else {
        return Err(format!("expected three numbers, found {}", words.len()).into());
    };
    Ok([parse_number(a)?, parse_number(b)?, parse_number(c)?])
}

impl Parser {
    fn units(&mut self, words: &[&str]) -> Result<()> {
        match (words[0].to_ascii_lowercase().as_str(), &words[1..]) {
            ("length", [value]) => match parse_number(value)? {
                v if v > 0.0 => self.unit = Some(2.54 / v),
                _ => return Err("the length unit must be above zero".into()),
            },
            ("angle", [value]) => match value.to_ascii_lowercase().as_str() {
                "deg" | "degrees" => self.degrees = Some(true),
                "rad" | "radians" => self.degrees = Some(false),
                other => {
                    return Err(
                        format!("expected angle deg or rad, found \"{}\"", excerpt(other)).into(),
                    );
                }
            },
            ("length" | "angle", _) => {
                return Err(format!("expected one value after {}", words[0]).into());
            }
            _ => {}
        }
        Ok(())
    }

    fn root(&mut self, words: &[&str]) -> Result<()> {
        match words[0].to_ascii_lowercase().as_str() {
            "order" => {
                self.root_order = channels(&words[1..])?;
            }
            "axis" => {
                // The order of `orientation`, which is added angle by angle: it only has to be an
                // order.
                parse_order(words.get(1).unwrap_or(&""))
                    .ok_or_else(|| "expected an axis order such as XYZ".to_string())?;
            }
            "position" => self.position = DVec3::from_array(triple(&words[1..])?),
            "orientation" => self.orientation = triple(&words[1..])?,
            _ => {}
        }
        Ok(())
    }

    fn bone(&mut self, words: &[&str], line: u64) -> Result<()> {
        let key = words[0].to_ascii_lowercase();
        if key == "begin" {
            if self.open.is_some() {
                return Err("a bone begins inside another; is an \"end\" missing?".into());
            }
            if self.bones.len() >= MOST_BONES {
                return Err(format!("more than {MOST_BONES} bones").into());
            }
            self.open = Some(RawBone {
                line,
                ..RawBone::default()
            });
            return Ok(());
        }
        let Some(bone) = self.open.as_mut() else {
            return Err(format!("expected \"begin\", found \"{}\"", excerpt(words[0])).into());
        };
        let more_limits = self.limits_open && words.len() == 2 && bound(words[0], 0.0).is_ok();
        self.limits_open = key == "limits" || more_limits;
        match key.as_str() {
            "name" => {
                bone.name = words
                    .get(1)
                    .ok_or("the bone's name is missing")?
                    .to_string()
            }
            "direction" => bone.direction = Some(DVec3::from_array(triple(&words[1..])?)),
            "length" => match parse_number(words.get(1).unwrap_or(&""))? {
                v if v >= 0.0 => bone.length = Some(v),
                _ => return Err("a bone's length cannot be negative".into()),
            },
            "axis" => {
                let order = words.get(4).and_then(|w| parse_order(w));
                let order = order.ok_or("expected three angles and an order such as XYZ")?;
                bone.axis = Some((triple(&words[1..4])?, order));
            }
            "dof" => bone.dofs = channels(&words[1..])?,
            "limits" => bone.limits.push(limit(&words[1..])?),
            "end" => {
                let bone = self.open.take().unwrap_or_default();
                self.close(bone)?;
            }
            _ if more_limits => bone.limits.push(limit(words)?),
            // id, bodymass, cofmass and the like.
            _ => {}
        }
        Ok(())
    }

    fn close(&mut self, bone: RawBone) -> Result<()> {
        let lacks = |what: &str| {
            format!(
                "bone \"{}\" (line {}) has no {what}",
                excerpt(&bone.name),
                bone.line
            )
        };
        if bone.name.is_empty() {
            return Err(lacks("name").into());
        }
        if bone.name == "root" || self.bones.iter().any(|b| b.name == bone.name) {
            return Err(format!("two bones are named \"{}\"", excerpt(&bone.name)).into());
        }
        if bone.direction.is_none() {
            return Err(lacks("direction").into());
        }
        if bone.length.is_none() {
            return Err(lacks("length").into());
        }
        if !bone.limits.is_empty() && bone.limits.len() != bone.dofs.len() {
            return Err(format!(
                "bone \"{}\" has {} degrees of freedom but {} limits",
                excerpt(&bone.name),
                bone.dofs.len(),
                bone.limits.len()
            )
            .into());
        }
        self.bones.push(bone);
        Ok(())
    }

    fn hierarchy(&mut self, words: &[&str], line: u64) -> Result<()> {
        self.hierarchy_seen = true;
        if matches!(words[0].to_ascii_lowercase().as_str(), "begin" | "end") {
            return Ok(());
        }
        let parent = words[0].to_string();
        for child in &words[1..] {
            if self.parents.insert(child.to_string(), line).is_some() {
                return Err(format!("bone \"{}\" has two parents", excerpt(child)).into());
            }
        }
        self.children
            .push((parent, words[1..].iter().map(|w| w.to_string()).collect()));
        Ok(())
    }

    fn finish(self, name: &str, unit: Option<f64>) -> Result<Asf> {
        let fail = |what: String| Err(Error::data(Place::file(name), what));
        if self.bones.is_empty() && self.children.is_empty() && self.root_order.is_empty() {
            return fail("has no skeleton; an ASF file has :root, :bonedata and :hierarchy".into());
        }
        if let Some(bone) = &self.open {
            return fail(format!(
                "bone \"{}\" (line {}) has no \"end\"; the file is cut off",
                excerpt(&bone.name),
                bone.line
            ));
        }
        if !self.hierarchy_seen {
            return fail("has no :hierarchy; the file is cut off".into());
        }
        let Some(unit) = unit.or(self.unit) else {
            return fail("states no length in :units; give the option `units`".into());
        };
        if self.root_order.is_empty() {
            return fail("has no order in :root".into());
        }
        let reach = self
            .bones
            .iter()
            .map(|b| (b.direction.unwrap_or(DVec3::ZERO) * b.length.unwrap_or(0.0)).length())
            .fold(1.0 + self.position.length(), f64::max);
        if let Err(what) = check_length(reach * unit) {
            return fail(format!("its longest bone or :units are damaged: {what}"));
        }
        let degrees = self.degrees.unwrap_or(true);
        let bones = self.in_order(name, unit, if degrees { 1f64.to_radians() } else { 1.0 })?;
        let skeleton =
            Skeleton::new(bones).map_err(|e| Error::data(Place::file(name), e.to_string()))?;
        Ok(Asf {
            skeleton,
            unit,
            degrees,
        })
    }

    /// The bones depth first, in the order in which the hierarchy names the children.
    fn in_order(&self, name: &str, unit: f64, angle: f64) -> Result<Vec<Bone>> {
        let known: HashMap<&str, &RawBone> =
            self.bones.iter().map(|b| (b.name.as_str(), b)).collect();
        let mut children: HashMap<&str, Vec<&str>> = HashMap::new();
        for (parent, names) in &self.children {
            children
                .entry(parent)
                .or_default()
                .extend(names.iter().map(String::as_str));
        }
        let mut out = vec![self.root_bone(unit, angle)];
        let mut stack: Vec<(&str, usize)> = children
            .get("root")
            .into_iter()
            .flatten()
            .rev()
            .map(|c| (*c, 0))
            .collect();
        while let Some((child, parent)) = stack.pop() {
            let line = &self.parents[child];
            let Some(raw) = known.get(child) else {
                let what = format!(
                    "the hierarchy names \"{}\", which is not in :bonedata",
                    excerpt(child)
                );
                return Err(Error::data(Place::line(name, *line), what));
            };
            let at = out.len();
            out.push(bone(raw, parent, unit, angle));
            stack.extend(
                children
                    .get(child)
                    .into_iter()
                    .flatten()
                    .rev()
                    .map(|c| (*c, at)),
            );
        }
        // Each child has one parent, so whatever the root does not reach is an orphan or on a
        // cycle.
        for raw in &self.bones {
            if out.iter().any(|b| b.name == raw.name) {
                continue;
            }
            let what = match self.parents.get(&raw.name) {
                None => format!("bone \"{}\" is not in the hierarchy", excerpt(&raw.name)),
                Some(_) => format!(
                    "bone \"{}\" cannot be reached from root: the hierarchy has a cycle",
                    excerpt(&raw.name)
                ),
            };
            return Err(Error::data(Place::line(name, raw.line), what));
        }
        if let Some((child, line)) = self
            .parents
            .iter()
            .filter(|(c, _)| *c == "root" || !known.contains_key(c.as_str()))
            .min()
        {
            let what = format!(
                "the hierarchy names \"{}\", which is not a bone",
                excerpt(child)
            );
            return Err(Error::data(Place::line(name, *line), what));
        }
        Ok(out)
    }

    fn root_bone(&self, unit: f64, angle: f64) -> Bone {
        let dofs = self.root_order.iter().map(|&channel| {
            let offset = match channel {
                Channel::Translate(a) => self.position[a.index()] * unit,
                Channel::Rotate(a) => self.orientation[a.index()] * angle,
                Channel::Length => 0.0,
            };
            Dof {
                channel,
                limits: None,
                offset,
            }
        });
        Bone {
            name: "root".into(),
            parent: None,
            offset: DVec3::ZERO,
            axis: DMat3::IDENTITY,
            dofs: dofs.collect(),
        }
    }
}

/// One bone in centimeters and radians.
fn bone(raw: &RawBone, parent: usize, unit: f64, angle: f64) -> Bone {
    let direction = raw.direction.unwrap_or(DVec3::ZERO);
    // Published files give the direction to six digits; the length is what the file means to be
    // exact.
    let offset = direction * raw.length.unwrap_or(0.0) * unit;
    let axis = raw.axis.map_or(DMat3::IDENTITY, |(a, order)| {
        // As on a dof line, the first number belongs to the axis named first, which turns first.
        compose(&order, &a.map(|a| a * angle))
    });
    let dofs = raw.dofs.iter().enumerate().map(|(i, &channel)| {
        let scale = if channel.is_angle() { angle } else { unit };
        let limits = raw
            .limits
            .get(i)
            .map(|&(low, high)| (low * scale, high * scale));
        Dof {
            channel,
            limits,
            offset: 0.0,
        }
    });
    Bone {
        name: raw.name.clone(),
        parent: Some(parent),
        offset,
        axis,
        dofs: dofs.collect(),
    }
}

/// A list of channels, each named once.
fn channels(words: &[&str]) -> Result<Vec<Channel>> {
    let mut out = Vec::new();
    for word in words {
        let channel = Channel::parse(word).ok_or_else(|| {
            format!(
                "expected tx ty tz rx ry rz or l, found \"{}\"",
                excerpt(word)
            )
        })?;
        if out.contains(&channel) {
            return Err(format!("\"{}\" appears twice", excerpt(word)).into());
        }
        out.push(channel);
    }
    Ok(out)
}

/// `(low high)`, without the brackets.
fn limit(words: &[&str]) -> Result<(f64, f64)> {
    let [low, high] = words else {
        return Err(format!(
            "expected limits such as (-90 45), found {} values",
            words.len()
        )
        .into());
    };
    let (low, high) = (bound(low, f64::NEG_INFINITY)?, bound(high, f64::INFINITY)?);
    if low > high {
        return Err(format!("the lower limit {low} is above the upper {high}").into());
    }
    Ok((low, high))
}

/// A number, or `inf` in either sign for `open`.
fn bound(word: &str, open: f64) -> Result<f64> {
    match word.to_ascii_lowercase().trim_start_matches(['-', '+']) {
        "inf" | "infinity" => Ok(open),
        _ => parse_number(word),
    }
}
