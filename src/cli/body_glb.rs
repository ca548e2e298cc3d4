//! A take of a body as binary glTF: one skinned mesh, with corrective shapes, shapes of people, and an animation a take.

use super::body_take::BodyTake;
use super::messages;
use crate::body::file::part_name;
use crate::body::skinning::{Frame, Sample};
use crate::body::{BodyModel, Skinning, Template};
use crate::io::glb::{Animation, Bone, Shape, SkinnedMesh};
use crate::{Error, Place, Result};
use glam::{DMat3, DVec3};
use std::path::Path;

/// Corrective shapes of the skin.
const CORRECTIONS: usize = 20;
/// Frames of the take that the skin is fitted to, spread over it; the training poses come with them.
const SAMPLES: usize = 100;
/// Components of shape that become morph targets.
const PEOPLE: usize = 5;

/// Writes a take; says how much the skin errs against the model.
///
/// # Errors
/// [`Error::Usage`]: the take has no times or several shapes. [`Error::Io`]: the file cannot be written.
pub fn save_glb(path: &Path, body: &BodyModel, take: &BodyTake) -> Result<()> {
    let fail = |what: String| Error::data(Place::file(path.display().to_string()), what);
    if take.shapes.len() != 1 {
        let what = "a .glb holds one body; give one shape, or write a folder";
        return Err(Error::usage(what));
    }
    let (shape, still) = (take.shape(0), take.frames.len() < 2);
    if take.poses.time.is_none() && !still {
        return Err(Error::usage(
            "the table has no times, which an animation needs; give the rate with --fps",
        ));
    }
    let template = rest_template(body, shape).map_err(fail)?;
    let meshes = take.meshes(body);
    let there: Vec<usize> = (0..meshes.len())
        .filter(|k| !meshes[*k].is_empty())
        .collect();
    let turned = |k: usize| {
        take.frames[k]
            .as_ref()
            .map_or(&[][..], |(r, _)| r.as_slice())
    };
    let chosen = there.iter().step_by(there.len().div_ceil(SAMPLES).max(1));
    let trained: Vec<Vec<DVec3>> = (body.training_rotations.iter())
        .map(|r| body.synthesise(r, shape))
        .collect();
    let mut samples: Vec<Sample<'_>> = (chosen)
        .map(|k| Sample {
            rotations: turned(*k),
            vertices: &meshes[*k],
        })
        .collect();
    samples.extend(
        body.training_rotations
            .iter()
            .zip(&trained)
            .map(|(r, v)| Sample {
                rotations: r,
                vertices: v,
            }),
    );
    let corrections = CORRECTIONS.min(samples.len());
    let skinning = Skinning::fit(&template, &samples, corrections).map_err(fail)?;
    let frames: std::result::Result<Vec<Frame>, String> = (there.iter())
        .map(|k| {
            skinning.frame(&Sample {
                rotations: turned(*k),
                vertices: &meshes[*k],
            })
        })
        .collect();
    let frames = frames.map_err(fail)?;
    let error = frames.iter().map(|f| f.error_mm).sum::<f64>() / frames.len().max(1) as f64;
    let mut mesh = skinned_mesh(body, shape, &template, &skinning);
    if !still {
        mesh.animations = animations(take, &there, &frames, &skinning, &mesh);
    }
    mesh.unit_weights();
    mesh.save(path)?;
    messages::info(&format!(
        "{}: {} frames; linear skinning with {corrections} corrective shapes is {error:.2} mm from the model (mean)",
        path.display(),
        frames.len()
    ));
    Ok(())
}

/// The body of a shape in the template's pose, as a template.
fn rest_template(body: &BodyModel, shape: &[f64]) -> std::result::Result<Template, String> {
    let template = &body.template;
    let upright = vec![DMat3::IDENTITY; template.parts()];
    let rest = body.synthesise(&upright, shape);
    let shift = template.root_of(&template.vertices) - template.root_of(&rest);
    let rest = rest.into_iter().map(|v| v + shift).collect();
    Template::new(
        rest,
        template.surface().to_vec(),
        template.vertex_parts.clone(),
    )
}

fn metres(v: DVec3) -> [f32; 3] {
    (v / 100.0).as_vec3().to_array()
}

fn skinned_mesh(
    body: &BodyModel,
    shape: &[f64],
    template: &Template,
    skinning: &Skinning,
) -> SkinnedMesh {
    let name = |p: usize| {
        let named = body.joint_names.iter().find(|(part, _)| *part == p);
        named.map_or(part_name(p), |(_, name)| name.clone())
    };
    let bone = |p: usize| Bone {
        name: name(p),
        parent: skinning.parents[p],
        at: metres(skinning.places[p]),
    };
    let offsets = |shape: &[DVec3]| shape.iter().map(|v| metres(*v)).collect();
    let corrections = skinning.shapes.iter().enumerate().map(|(k, s)| Shape {
        name: format!("correction{}", k + 1),
        offsets: offsets(s),
    });
    let person = |k: usize| {
        let mut other = shape.to_vec();
        other.resize(body.shape.len(), 0.0);
        other[k] += 1.0;
        let vertices = rest_template(body, &other).ok()?.vertices;
        let moved: Vec<DVec3> = (vertices.iter().zip(&template.vertices))
            .map(|(a, b)| *a - *b)
            .collect();
        Some(Shape {
            name: format!("shape{}", k + 1),
            offsets: offsets(&moved),
        })
    };
    SkinnedMesh {
        name: "body".into(),
        vertices: template.vertices.iter().map(|v| metres(*v)).collect(),
        faces: (template.surface().iter())
            .map(|f| f.map(|v| v as u32))
            .collect(),
        bones: (0..template.parts()).map(bone).collect(),
        weights: skinning.weights.clone(),
        shapes: corrections
            .chain((0..PEOPLE.min(body.shape.len())).filter_map(person))
            .collect(),
        animations: Vec::new(),
    }
}

/// An animation a take.
fn animations(
    take: &BodyTake,
    there: &[usize],
    frames: &[Frame],
    skinning: &Skinning,
    mesh: &SkinnedMesh,
) -> Vec<Animation> {
    let animation = |range: std::ops::Range<usize>| {
        let keys: Vec<usize> = (0..there.len())
            .filter(|i| range.contains(&there[*i]))
            .collect();
        let time = |k: usize| take.poses.time.as_ref().map_or(0.0, |t| t[k]);
        let start = keys.first().map_or(0.0, |i| time(there[*i]));
        let times = keys
            .iter()
            .map(|i| (time(there[*i]) - start) as f32)
            .collect();
        let places = |frame: &Frame| -> Vec<DVec3> {
            (frame.motions().iter().zip(&skinning.places))
                .map(|(m, place)| m.transform_point3(*place) / 100.0)
                .collect()
        };
        let rotations: Vec<Vec<DMat3>> =
            keys.iter().map(|i| frames[*i].rotations.clone()).collect();
        let places: Vec<Vec<DVec3>> = keys.iter().map(|i| places(&frames[*i])).collect();
        let name =
            (take.poses.take.as_ref()).map_or("take".to_string(), |t| t[range.start].to_string());
        let mut animation = Animation::from_world(name, &mesh.bones, times, &rotations, &places);
        let people = mesh.shapes.len() - skinning.shapes.len();
        animation.weights = (keys.iter())
            .map(|i| {
                let corrections = frames[*i].weights.iter().map(|w| *w as f32);
                corrections.chain(vec![0.0; people]).collect()
            })
            .collect();
        animation
    };
    let takes = take.poses.takes();
    takes
        .into_iter()
        .map(animation)
        .filter(|a| !a.times.is_empty())
        .collect()
}
