#![deny(unsafe_code)]
#![warn(missing_docs)]
//! FBX files of any program: skeletons, their rest poses, their takes. (FBX is never written.)
//!
//! The crate `ufbx` reads a file and evaluates its layers, pivots, rotation orders and scales; here
//! stands what no file says outright: which nodes are a skeleton ([`FbxFile::skeletons`]), which
//! stacks are takes, from when to when and how many frames a second they are sampled
//! ([`FbxFile::motion`]), and what the rest pose is.
//!
//! Positions are in centimeters, right-handed, y up, whatever the file's unit and axes.
//!
//! ```
//! use posing_fbx::FbxFile;
//!
//! let error = FbxFile::read("walk.fbx", b"; FBX 7.4.0 project file\n").err();
//! assert!(error.is_some_and(|e| e.to_string().starts_with("walk.fbx: is an FBX file that ends")));
//! ```

use posing_core::error::excerpt;
use posing_core::{Error, Place, Result, pose};

mod motion;
mod rest;
mod scene;
mod skeletons;
mod takes;
#[cfg(test)]
mod tests;

pub use motion::{FbxJoint, FbxMotion};
pub use skeletons::Skeleton;

use ufbx::SceneRoot;

/// An FBX file that is open.
pub struct FbxFile {
    name: String,
    scene: SceneRoot,
    skeletons: Vec<Skeleton>,
    notes: Vec<String>,
}

/// Which of several takes and skeletons of a file is meant.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FbxChoice {
    /// The name of the take; `None`: the only one.
    pub take: Option<String>,
    /// The name of the skeleton ([`Skeleton::name`]); `None`: the only one.
    pub skeleton: Option<String>,
}

/// A take of a skeleton.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FbxTake {
    /// The name of its animation stack; one that repeats has `_2` and so on.
    pub name: String,
    /// The name of the skeleton.
    pub skeleton: String,
    stack: usize,
    tree: usize,
}

impl FbxFile {
    /// Reads the bytes of a file, binary or ASCII; `name` is for messages.
    ///
    /// # Errors
    /// [`Error::Data`]: it is cut, damaged, too large, of another version, or has no skeleton.
    pub fn read(name: &str, bytes: &[u8]) -> Result<FbxFile> {
        let at = |e: Error| e.at(Place::file(name));
        let (scene, notes) = scene::load(bytes).map_err(at)?;
        let skeletons = skeletons::of_scene(&scene).map_err(at)?;
        Ok(FbxFile {
            name: name.to_string(),
            scene,
            skeletons,
            notes,
        })
    }

    /// The file's skeletons, in its order; those that are small beside the largest, or never move
    /// where others do, are [aside](Skeleton::is_aside).
    pub fn skeletons(&self) -> &[Skeleton] {
        &self.skeletons
    }

    /// The name that messages call it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The takes that `choice` leaves: stacks that have keys on a skeleton, for each skeleton that
    /// is not aside or is chosen.
    ///
    /// # Errors
    /// [`Error::Data`]: there is none; the message lists those that there are.
    pub fn takes_of(&self, choice: &FbxChoice) -> Result<Vec<FbxTake>> {
        self.chosen(choice).map_err(|e| e.at(self.place()))
    }

    /// The one take that `choice` leaves.
    ///
    /// # Errors
    /// [`Error::Data`]: there are several, or none; the message lists them and names the option.
    pub fn take(&self, choice: &FbxChoice) -> Result<FbxTake> {
        let mut takes = self.takes_of(choice)?;
        let names = |of: fn(&FbxTake) -> &String| distinct(takes.iter().map(of));
        let (stacks, trees) = (names(|take| &take.name), names(|take| &take.skeleton));
        let several = match (stacks.len(), trees.len()) {
            (1, 1) => return Ok(takes.remove(0)),
            (_, 2..) => several("skeletons", "skeleton", &trees),
            _ => several("takes", "take", &stacks),
        };
        Err(several.at(self.place()))
    }

    fn chosen(&self, choice: &FbxChoice) -> Result<Vec<FbxTake>> {
        let tree = choice.skeleton.as_deref();
        if tree.is_some() {
            self.skeleton(tree)?;
        }
        let is_tree = |one: &Skeleton| tree.map_or(!one.is_aside, |name| one.name == name);
        let (mut takes, mut seen) = (Vec::new(), Vec::new());
        for (stack, anim) in self.scene.anim_stacks.iter().enumerate() {
            // Names that repeat are counted.
            let own = anim.element.name.to_string();
            let before = seen.iter().filter(|name| **name == own).count();
            seen.push(own.clone());
            let name = match before {
                0 => own,
                n => format!("{own}_{}", n + 1),
            };
            let trees = self.skeletons.iter().enumerate();
            let moved = trees.filter(|(_, one)| is_tree(one) && one.has_keys(anim));
            takes.extend(moved.map(|(tree, one)| FbxTake {
                name: name.clone(),
                skeleton: one.name.clone(),
                stack,
                tree,
            }));
        }
        if takes.is_empty() {
            return Err("has no take: no animation stack has keys on its skeleton".into());
        }
        let Some(name) = &choice.take else {
            return Ok(takes);
        };
        let names = distinct(takes.iter().map(|take| &take.name));
        takes.retain(|take| take.name == *name);
        if takes.is_empty() {
            Err(unknown("take", name, &names))
        } else {
            Ok(takes)
        }
    }

    /// The skeleton of this name, else the only one that is not aside.
    fn skeleton(&self, name: Option<&str>) -> Result<usize> {
        let trees = self.skeletons.iter().enumerate();
        let is_meant = |(_, tree): &(usize, &Skeleton)| match name {
            Some(name) => tree.name == name,
            None => !tree.is_aside,
        };
        let left: Vec<usize> = trees.filter(is_meant).map(|(i, _)| i).collect();
        let names = |all: bool| -> Vec<String> {
            let trees = self.skeletons.iter().filter(|one| all || !one.is_aside);
            trees.map(|one| one.name.clone()).collect()
        };
        match (left[..].first(), name) {
            (Some(one), _) if left.len() == 1 || name.is_some() => Ok(*one),
            (_, Some(name)) => Err(unknown("skeleton", name, &names(true))),
            _ => Err(several("skeletons", "skeleton", &names(false))),
        }
    }

    /// A take's motion, at its own rate or `fps` frames a second.
    ///
    /// # Errors
    /// [`Error::Data`]: too many frames, or neither the file nor `fps` says a rate.
    pub fn motion(&self, take: &FbxTake, fps: Option<f64>) -> Result<FbxMotion> {
        let (tree, stack) = (&self.skeletons[take.tree], take.stack);
        let moved = motion::sampled(&self.scene, tree, stack, fps);
        let mut moved = moved.map_err(|e| e.at(self.place()))?;
        moved.notes.splice(0..0, self.told_of(take.tree));
        Ok(moved)
    }

    /// A skeleton in its rest pose, as one frame.
    ///
    /// # Errors
    /// [`Error::Data`]: there are several, and `skeleton` names none; its rest pose has no numbers.
    pub fn rest(&self, skeleton: Option<&str>) -> Result<FbxMotion> {
        let tree = self.skeleton(skeleton).map_err(|e| e.at(self.place()))?;
        let still = motion::still(&self.scene, &self.skeletons[tree]);
        let mut still = still.map_err(|e| e.at(self.place()))?;
        still.notes.splice(0..0, self.told_of(tree));
        Ok(still)
    }

    /// What was odd about the file, and which skeletons are left out beside `tree`.
    fn told_of(&self, tree: usize) -> Vec<String> {
        let mut notes = self.notes.clone();
        let aside = self.skeletons.iter().enumerate();
        let aside = aside.filter(|(i, one)| *i != tree && one.is_aside && !one.is_beside);
        let names: Vec<String> = aside.map(|(_, one)| one.name.clone()).collect();
        if !names.is_empty() {
            notes.push(format!(
                "left out what is small or never moves: {}; the option `skeleton` chooses one",
                listed(&names)
            ));
        }
        notes
    }

    fn place(&self) -> Place {
        Place::file(&self.name)
    }
}

/// Names, each once.
fn distinct<'a>(names: impl Iterator<Item = &'a String>) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for name in names {
        if !out.contains(name) {
            out.push(name.clone());
        }
    }
    out
}

/// The error that asks for a choice among several things by an option.
fn several(what: &str, option: &str, names: &[String]) -> Error {
    let names = listed(names);
    format!("has several {what}: {names}; choose one with the option `{option} NAME`").into()
}

/// There is no `what` of this name.
fn unknown(what: &str, name: &str, names: &[String]) -> Error {
    let (name, names) = (excerpt(name), listed(names));
    format!("has no {what} \"{name}\"; it has {names}: choose one with the option `{what} NAME`")
        .into()
}

/// Names for a message: the first ones, and how many more there are.
fn listed(names: &[String]) -> String {
    const SHOWN: usize = 6;
    let first: Vec<String> = names.iter().take(SHOWN).map(|name| excerpt(name)).collect();
    match names.len().checked_sub(SHOWN) {
        Some(more @ 1..) => format!("{} and {more} more", first.join(", ")),
        _ => first.join(", "),
    }
}
