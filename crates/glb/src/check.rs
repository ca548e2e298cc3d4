//! Whether a mesh can be written: sizes, indices, finite numbers.

use super::{Animation, Bone, SkinnedMesh};
use crate::{Error, Place, Result};

/// The phrase of what is wrong.
type Checked = std::result::Result<(), String>;

/// Checks a whole mesh.
pub(crate) fn check(mesh: &SkinnedMesh) -> Result<()> {
    let fail = |part: String, what: String| Error::data(Place::file("the mesh").part(part), what);
    surface(mesh).map_err(|what| Error::data(Place::file("the mesh"), what))?;
    skeleton(&mesh.bones).map_err(|what| fail("bones".into(), what))?;
    for (v, weights) in mesh.weights.iter().enumerate() {
        vertex(weights, mesh.bones.len()).map_err(|what| fail(format!("vertex {v}"), what))?;
    }
    for shape in &mesh.shapes {
        let checked = sized("offsets", shape.offsets.len(), mesh.vertices.len())
            .and_then(|()| finite(shape.offsets.iter().flatten()));
        checked.map_err(|what| fail(shape.name.clone(), what))?;
    }
    for animation in &mesh.animations {
        let checked = keys(animation, mesh.bones.len(), mesh.shapes.len());
        checked.map_err(|what| fail(animation.name.clone(), what))?;
    }
    Ok(())
}

fn surface(mesh: &SkinnedMesh) -> Checked {
    let count = mesh.vertices.len();
    if count == 0 || mesh.faces.is_empty() {
        return Err("has no vertices or no triangles".into());
    }
    if let Some(v) = mesh.faces.iter().flatten().find(|v| **v as usize >= count) {
        return Err(format!(
            "a triangle names vertex {v}, but the mesh has {count} vertices"
        ));
    }
    let followed = if mesh.bones.is_empty() { 0 } else { count };
    sized("weights", mesh.weights.len(), followed)?;
    finite(mesh.vertices.iter().flatten())
}

fn skeleton(bones: &[Bone]) -> Checked {
    let count = bones.len();
    if count > usize::from(u16::MAX) {
        return Err(format!(
            "expected at most {} bones, found {count}",
            u16::MAX
        ));
    }
    finite(bones.iter().flat_map(|b| b.at.iter().chain(&b.rotation)))?;
    if bones.iter().any(|b| b.rotation == [0.0; 4]) {
        return Err("a quaternion is 0".into());
    }
    for bone in bones {
        let mut parent = bone.parent;
        for _ in 0..count {
            let Some(p) = parent else { break };
            let above = bones.get(p).ok_or(format!("there is no bone {p}"))?;
            parent = above.parent;
        }
        if parent.is_some() {
            return Err(format!("the parents of {} form a circle", bone.name));
        }
    }
    Ok(())
}

fn vertex(weights: &[(u16, f32); 4], bones: usize) -> Checked {
    finite(weights.iter().map(|(_, w)| w))?;
    if weights.iter().any(|(_, w)| *w < 0.0) || weights.iter().all(|(_, w)| *w == 0.0) {
        return Err("expected weights of at least 0, one of them above 0".into());
    }
    for (k, (bone, _)) in weights.iter().enumerate().filter(|(_, w)| w.1 > 0.0) {
        if usize::from(*bone) >= bones {
            return Err(format!("there is no bone {bone}"));
        }
        if weights[..k].iter().any(|w| w.1 > 0.0 && w.0 == *bone) {
            return Err(format!("follows bone {bone} twice"));
        }
    }
    Ok(())
}

fn keys(animation: &Animation, bones: usize, shapes: usize) -> Checked {
    let times = &animation.times;
    finite(times)?;
    if times.first().is_none_or(|t| *t < 0.0) || times.windows(2).any(|t| !(t[0] < t[1])) {
        return Err("expected one time or more, rising from 0 or later".into());
    }
    let (rotations, translations) = (&animation.rotations, &animation.translations);
    if rotations.is_empty() && translations.is_empty() && animation.weights.is_empty() {
        return Err("moves no bone and no morph target".into());
    }
    if !rotations.is_empty() {
        sized("bones with rotations", rotations.len(), bones)?;
    }
    if !translations.is_empty() {
        sized("bones with translations", translations.len(), bones)?;
    }
    for keys in rotations {
        sized("rotations of a bone", keys.len(), times.len())?;
        finite(keys.iter().flatten())?;
        if keys.iter().any(|q| q.iter().all(|c| *c == 0.0)) {
            return Err("a quaternion is 0".into());
        }
    }
    for keys in translations {
        sized("translations of a bone", keys.len(), times.len())?;
        finite(keys.iter().flatten())?;
    }
    if !animation.weights.is_empty() {
        sized("keys with weights", animation.weights.len(), times.len())?;
    }
    for weights in &animation.weights {
        sized("weights of a key", weights.len(), shapes)?;
        finite(weights)?;
    }
    Ok(())
}

fn sized(what: &str, found: usize, expected: usize) -> Checked {
    if found == expected {
        Ok(())
    } else {
        Err(format!("expected {expected} {what}, found {found}"))
    }
}

fn finite<'a>(numbers: impl IntoIterator<Item = &'a f32>) -> Checked {
    if numbers.into_iter().all(|v| v.is_finite()) {
        Ok(())
    } else {
        Err("holds a number that is not finite".into())
    }
}
