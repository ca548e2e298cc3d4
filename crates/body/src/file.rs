//! Bodies as model files: kind `body`.
//!
//! The points of the model are the parts. Its arrays: `vertices` (V, 3) cm, `faces` (P, 3) and
//! `parts` (V, 1) of whole numbers, the template; `pose_joints` (P, J) and `pose`
//! (P, 9 (n J + 1)), the pose model, with n numbers a joint, of which `pose_inputs` tells the
//! kind; `shape_mean` (P, 9) and `shape` (K, 9 P), the shape model; `rotations` (n, 9 parts), those
//! of the training poses. P counts the bridges too, which `faces` leaves out.

use super::body_model::{BodyModel, HeldOutErrors};
use super::pose_model::{JointInputs, PoseModel};
use super::shape_model::ShapeModel;
use super::template::Template;
use crate::io::Model;
use crate::{Error, Place, Result};
use glam::{DMat3, DVec3};
use ndarray::Array2;
use serde_json::{Value, json};

/// The kind of a model file that holds a body.
pub(crate) const KIND: &str = "body";

/// The name of part `p` in tables.
pub fn part_name(p: usize) -> String {
    format!("part{p}")
}

impl BodyModel {
    /// The body as a model, without a history yet.
    pub fn to_model(&self) -> Model {
        let template = &self.template;
        let names: Vec<String> = (0..template.parts()).map(part_name).collect();
        let mut model = Model::new(KIND, &names, "world");
        let surface = template.surface();
        let whole = |v: usize| v as f32;
        model.insert(
            "vertices",
            table(template.vertices.len(), 3, |v, a| {
                template.vertices[v][a] as f32
            }),
        );
        model.insert(
            "faces",
            table(surface.len(), 3, |k, c| whole(surface[k][c])),
        );
        model.insert(
            "parts",
            table(template.vertices.len(), 1, |v, _| {
                whole(template.vertex_parts[v])
            }),
        );
        let joints = &self.pose.joints;
        model.insert(
            "pose_joints",
            table(joints.len(), joints[0].len(), |k, j| whole(joints[k][j])),
        );
        model.insert("pose", self.pose.coefficients.clone());
        model.insert("shape_mean", self.shape.mean.clone());
        model.insert("shape", self.shape.components.clone());
        let poses = &self.training_rotations;
        model.insert(
            "rotations",
            table(poses.len(), 9 * template.parts(), |i, e| {
                poses[i][e / 9].to_cols_array()[e % 9] as f32
            }),
        );
        let details = &mut model.meta.details;
        details.insert("pose_inputs".into(), json!(self.pose.inputs.name()));
        if let Some(errors) = &self.errors {
            details.insert("decomposed_mm".into(), millimeters(Some(errors.decomposed)));
            details.insert("poses_left_out_mm".into(), millimeters(errors.poses));
            details.insert("people_left_out_mm".into(), millimeters(errors.people));
        }
        if !self.joint_names.is_empty() {
            let names: Vec<Value> = (self.joint_names.iter())
                .map(|(part, name)| json!([part, name]))
                .collect();
            model
                .meta
                .details
                .insert("joints".into(), Value::Array(names));
        }
        model
    }

    /// The body of a model; `source` names it in errors.
    ///
    /// # Errors
    /// [`Error::Data`]: the model is of another kind, or its arrays do not belong together.
    pub fn from_model(model: &Model, source: &str) -> Result<BodyModel> {
        let fail = |what: String| Error::data(Place::file(source), what);
        model.check_kind(KIND, "not a body; train one with body-train", source)?;
        let array = |name: &str| model.array(name, source);
        let whole = |v: &f32| *v as usize;
        let vertices = array("vertices")?;
        let faces = array("faces")?;
        let parts: Vec<usize> = array("parts")?.iter().map(whole).collect();
        let damaged = || fail("is a damaged body: its arrays do not belong together".into());
        if vertices.ncols() != 3 || faces.ncols() != 3 {
            return Err(damaged());
        }
        let vertices = vertices.rows().into_iter();
        let vertices =
            vertices.map(|r| DVec3::new(f64::from(r[0]), f64::from(r[1]), f64::from(r[2])));
        let faces = faces.rows().into_iter();
        let faces = faces.map(|r| [whole(&r[0]), whole(&r[1]), whole(&r[2])]);
        let template = Template::new(vertices.collect(), faces.collect(), parts)
            .map_err(|e| e.at(Place::file(source)))?;
        let joints = array("pose_joints")?;
        let joints = joints.rows().into_iter();
        // Files of version 0.2 and before have twists.
        let inputs = match model
            .meta
            .details
            .get("pose_inputs")
            .and_then(Value::as_str)
        {
            None => JointInputs::Twist,
            Some(name) => JointInputs::of_name(name).ok_or_else(damaged)?,
        };
        let body = BodyModel {
            pose: PoseModel {
                joints: joints.map(|r| r.iter().map(whole).collect()).collect(),
                inputs,
                coefficients: array("pose")?.into_owned(),
            },
            shape: ShapeModel {
                mean: array("shape_mean")?.into_owned(),
                components: array("shape")?.into_owned(),
            },
            training_rotations: rotations(&array("rotations")?.into_owned()),
            joint_names: joint_names(model),
            errors: errors(model),
            template,
        };
        if is_sound(&body, model.meta.points.len()) {
            Ok(body)
        } else {
            Err(damaged())
        }
    }
}

fn millimeters(cm: Option<f64>) -> Value {
    cm.map_or(Value::Null, |cm| json!((1e4 * cm).round() / 1e3))
}

fn errors(model: &Model) -> Option<HeldOutErrors> {
    let cm = |name: &str| Some(model.meta.details.get(name)?.as_f64()? / 10.0);
    Some(HeldOutErrors {
        decomposed: cm("decomposed_mm")?,
        poses: cm("poses_left_out_mm"),
        people: cm("people_left_out_mm"),
    })
}

fn table(rows: usize, columns: usize, at: impl Fn(usize, usize) -> f32) -> Array2<f32> {
    Array2::from_shape_fn((rows, columns), |(i, j)| at(i, j))
}

fn rotations(rows: &Array2<f32>) -> Vec<Vec<DMat3>> {
    let matrix = |m: &[f64]| DMat3::from_cols_array(&std::array::from_fn(|e| m[e]));
    (rows.rows().into_iter())
        .map(|row| {
            let numbers: Vec<f64> = row.iter().map(|v| f64::from(*v)).collect();
            numbers.chunks_exact(9).map(matrix).collect()
        })
        .collect()
}

fn joint_names(model: &Model) -> Vec<(usize, String)> {
    let pair = |v: &Value| {
        let part = usize::try_from(v.get(0)?.as_u64()?).ok()?;
        Some((part, v.get(1)?.as_str()?.to_string()))
    };
    let list = model.meta.details.get("joints").and_then(Value::as_array);
    list.map_or(Vec::new(), |list| list.iter().filter_map(pair).collect())
}

/// Whether all arrays have the sizes of the template.
fn is_sound(body: &BodyModel, parts: usize) -> bool {
    let (faces, joints) = (body.template.faces.len(), body.template.joints.len());
    let followed = body.pose.joints.first().map_or(0, Vec::len);
    body.template.parts() == parts
        && body.pose.joints.len() == faces
        && (body.pose.joints.iter().flatten()).all(|j| *j < joints)
        && body.pose.coefficients.dim() == (faces, 9 * (body.pose.inputs.width() * followed + 1))
        && body.shape.mean.dim() == (faces, 9)
        && body.shape.components.ncols() == 9 * faces
        && (body.training_rotations.iter()).all(|r| r.len() == parts)
        && (body.training_rotations.iter().flatten()).all(DMat3::is_finite)
        && (body.pose.coefficients.iter())
            .chain(&body.shape.mean)
            .chain(&body.shape.components)
            .all(|v| v.is_finite())
        && body.joint_names.iter().all(|(part, _)| *part < parts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::template::tests::column;
    use crate::train::{Settings, train};

    #[test]
    fn a_body_is_the_same_after_writing_and_reading() {
        let template = column(8);
        let bend = |by: f64| -> Vec<DVec3> {
            (template.vertices.iter())
                .map(|v| DVec3::new(v.x + by * v.y * v.y, v.y, v.z))
                .collect()
        };
        let (poses, people) = ([bend(0.0), bend(0.02)], [bend(0.01), bend(0.03)]);
        let settings = Settings::default();
        let mut body = train(template.clone(), &poses, &people, &settings, &mut || ()).unwrap();
        body.joint_names = vec![(1, "head".to_string())];
        let model = body.to_model();
        let back = BodyModel::from_model(&model, "b").unwrap();
        assert_eq!(back.to_model(), model);
        let rotations = &body.training_rotations[1];
        let (a, b) = (
            body.synthesize(rotations, &[0.5]),
            back.synthesize(rotations, &[0.5]),
        );
        assert!(a.iter().zip(&b).all(|(a, b)| (*a - *b).length() < 1e-5));
        let mut cut = model.clone();
        cut.insert("pose", Array2::zeros((3, 9)));
        let error = BodyModel::from_model(&cut, "b.npz").unwrap_err();
        assert!(error.to_string().contains("b.npz: is a damaged"), "{error}");
        let other = Model::new("sparse", &model.meta.points, "body");
        let error = BodyModel::from_model(&other, "b").unwrap_err().to_string();
        assert!(error.contains("body-train"), "{error}");
    }
}
