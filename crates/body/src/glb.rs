//! A take of a body as binary glTF: one skinned mesh, with corrective shapes, shapes of people, and
//! an animation a take.

use super::file::part_name;
use super::skinning::{Frame, Sample};
use super::take::BodyTake;
use super::{BodyModel, Skinning, Template};
use crate::{Error, Place, Result};
use glam::{DMat3, DVec3};
use posing_glb::{Animation, Bone, Shape, SkinnedMesh};
use std::ops::Range;

/// Corrective shapes of the skin.
const CORRECTIONS: usize = 20;
/// Frames of the take that the skin is fitted to, spread over it; the training poses come with
/// them.
const SAMPLES: usize = 100;
/// Components of shape that become morph targets.
const PEOPLE: usize = 5;

/// A take as a skinned mesh.
pub struct SkinnedTake {
    /// The mesh and its animations.
    pub mesh: SkinnedMesh,
    /// How many frames have a body.
    pub frames: usize,
    /// The number of corrective shapes.
    pub corrections: usize,
    /// The mean distance of the skinned mesh from the model, mm.
    pub error_mm: f64,
}

impl SkinnedTake {
    /// The skinned mesh of a take, which messages call `name`.
    ///
    /// # Errors
    /// [`Error::Usage`]: the take has several shapes, or frames without times. [`Error::Data`]: no
    /// skin fits it.
    pub fn new(body: &BodyModel, take: &BodyTake, name: &str) -> Result<SkinnedTake> {
        if take.shapes.len() != 1 {
            let what = "a .glb holds one body; give one shape, or write a folder";
            return Err(Error::usage(what));
        }
        if take.poses.time.is_none() && take.frames.len() > 1 {
            let what = "the table has no times, which an animation needs; give the rate with the \
                        option `fps`";
            return Err(Error::usage(what));
        }
        let skin = fit_skin(body, take).map_err(|e| e.at(Place::file(name)))?;
        let mut mesh = skinned_mesh(body, take.shape(0), &skin);
        if !take.is_at_rest() {
            mesh.animations = animations(take, &skin, &mesh);
        }
        mesh.unit_weights();
        let frames = skin.frames.len();
        let errors = skin.frames.iter().map(|(_, f)| f.error_mm);
        Ok(SkinnedTake {
            mesh,
            frames,
            corrections: skin.skinning.shapes.len(),
            error_mm: errors.sum::<f64>() / frames.max(1) as f64,
        })
    }
}

/// A skin, and the frames of a take that it follows.
struct Skin {
    /// The body in the template's pose.
    template: Template,
    skinning: Skinning,
    /// Frames of the take, where something is known.
    frames: Vec<(usize, Frame)>,
}

/// Fits a skin to frames of the take and to the training poses, and its bones to each frame.
fn fit_skin(body: &BodyModel, take: &BodyTake) -> Result<Skin> {
    let shape = take.shape(0);
    let meshes = take.meshes(body);
    let frame = |k: usize| {
        let (rotations, _) = take.frames[k].as_ref()?;
        let vertices = &meshes[k];
        Some((
            k,
            Sample {
                rotations,
                vertices,
            },
        ))
    };
    let there: Vec<(usize, Sample<'_>)> = (0..meshes.len()).filter_map(frame).collect();
    let trained: Vec<Vec<DVec3>> = (body.training_rotations.iter())
        .map(|r| body.synthesize(r, shape))
        .collect();
    let training = body.training_rotations.iter().zip(&trained);
    let step = there.len().div_ceil(SAMPLES).max(1);
    let samples: Vec<Sample<'_>> = (there.iter().step_by(step))
        .map(|(_, sample)| *sample)
        .chain(training.map(|(rotations, vertices)| Sample {
            rotations,
            vertices,
        }))
        .collect();
    let base = &body.template;
    let (faces, parts) = (base.surface().to_vec(), base.vertex_parts.clone());
    let template = Template::new(rest_vertices(body, shape), faces, parts)?;
    let skinning = Skinning::fit(&template, &samples, CORRECTIONS.min(samples.len()))?;
    let frames = there.iter().map(|(k, s)| Ok((*k, skinning.frame(s)?)));
    Ok(Skin {
        frames: frames.collect::<Result<_>>()?,
        template,
        skinning,
    })
}

/// The vertices of a shape in the template's pose and position.
fn rest_vertices(body: &BodyModel, shape: &[f64]) -> Vec<DVec3> {
    let template = &body.template;
    let upright = vec![DMat3::IDENTITY; template.parts()];
    let rest = body.synthesize(&upright, shape);
    let shift = template.root_of(&template.vertices) - template.root_of(&rest);
    rest.into_iter().map(|v| v + shift).collect()
}

fn meters(v: DVec3) -> [f32; 3] {
    (v / 100.0).as_vec3().to_array()
}

fn skinned_mesh(body: &BodyModel, shape: &[f64], skin: &Skin) -> SkinnedMesh {
    let (template, skinning) = (&skin.template, &skin.skinning);
    let name = |p: usize| {
        let named = body.joint_names.iter().find(|(part, _)| *part == p);
        named.map_or(part_name(p), |(_, name)| name.clone())
    };
    let bone = |p: usize| Bone {
        name: name(p),
        parent: skinning.parents[p],
        at: meters(skinning.places[p]),
        ..Bone::default()
    };
    let mut bones: Vec<Bone> = (0..template.parts()).map(bone).collect();
    Bone::point_along(&mut bones);
    let offsets = |shape: &[DVec3]| shape.iter().map(|v| meters(*v)).collect();
    let corrections = skinning.shapes.iter().enumerate().map(|(k, s)| Shape {
        name: format!("correction{}", k + 1),
        offsets: offsets(s),
    });
    let person = |k: usize| Shape {
        name: format!("shape{}", k + 1),
        offsets: offsets(&person_offsets(body, template, shape, k)),
    };
    SkinnedMesh {
        name: "body".into(),
        vertices: template.vertices.iter().map(|v| meters(*v)).collect(),
        faces: (template.surface().iter())
            .map(|f| f.map(|v| v as u32))
            .collect(),
        bones,
        weights: skinning.weights.clone(),
        shapes: corrections
            .chain((0..PEOPLE.min(body.shape.len())).map(person))
            .collect(),
        animations: Vec::new(),
    }
}

/// How far each vertex moves, cm, where the k-th number of a person's shape is greater by 1.
fn person_offsets(body: &BodyModel, template: &Template, shape: &[f64], k: usize) -> Vec<DVec3> {
    let mut other = shape.to_vec();
    other.resize(body.shape.len(), 0.0);
    other[k] += 1.0;
    let moved = rest_vertices(body, &other);
    let moved = moved.iter().zip(&template.vertices);
    moved.map(|(a, b)| *a - *b).collect()
}

/// An animation a take.
fn animations(take: &BodyTake, skin: &Skin, mesh: &SkinnedMesh) -> Vec<Animation> {
    let takes = take.poses.takes().into_iter();
    let animations = takes.map(|frames| animation(take, skin, mesh, frames));
    animations.filter(|a| !a.times.is_empty()).collect()
}

/// The animation of some frames, those of one take.
fn animation(take: &BodyTake, skin: &Skin, mesh: &SkinnedMesh, frames: Range<usize>) -> Animation {
    let people = mesh.shapes.len() - skin.skinning.shapes.len();
    let time = |k: usize| take.poses.time.as_ref().map_or(0.0, |t| t[k]);
    let positions = |frame: &Frame| -> Vec<DVec3> {
        (frame.motions().iter().zip(&skin.skinning.places))
            .map(|(m, position)| m.transform_point3(*position) / 100.0)
            .collect()
    };
    let keys = skin.frames.iter().filter(|(k, _)| frames.contains(k));
    let start = keys.clone().next().map_or(0.0, |(k, _)| time(*k));
    let times = keys
        .clone()
        .map(|(k, _)| (time(*k) - start) as f32)
        .collect();
    let rotations: Vec<Vec<DMat3>> = keys.clone().map(|(_, f)| f.rotations.clone()).collect();
    let positions: Vec<Vec<DVec3>> = keys.clone().map(|(_, f)| positions(f)).collect();
    let named = take
        .poses
        .take
        .as_ref()
        .map(|t| t[frames.start].to_string());
    let name = named.unwrap_or_else(|| "take".into());
    let mut animation = Animation::from_world(name, &mesh.bones, times, &rotations, &positions);
    // The shapes of people stay at 0.
    let weights = |(_, f): &(usize, Frame)| {
        let corrections = f.weights.iter().map(|w| *w as f32);
        corrections.chain(vec![0.0; people]).collect()
    };
    animation.weights = keys.map(weights).collect();
    animation
}
