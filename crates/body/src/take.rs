//! A take as rotations and positions of a body, and the meshes of it.

use super::BodyModel;
use super::animation::Animation;
use crate::numeric::parallel;
use crate::pose::Poses;
use glam::{DMat3, DVec3};
use ndarray::Array2;
use std::sync::Arc;

/// Rotations of the parts and position of the root, frame by frame.
#[derive(Debug, Clone)]
pub struct BodyTake {
    /// The times and the takes of the frames, without points.
    pub poses: Poses,
    /// `None` where nothing is known.
    pub frames: Vec<Option<(Vec<DMat3>, DVec3)>>,
    /// One shape, or one per frame.
    pub shapes: Vec<Vec<f64>>,
}

impl BodyTake {
    /// The template's pose.
    pub fn at_rest(body: &BodyModel) -> BodyTake {
        let root = body.template.root_of(&body.template.vertices);
        let upright = vec![DMat3::IDENTITY; body.template.parts()];
        BodyTake {
            poses: frames_of(1, None, None),
            frames: vec![Some((upright, root))],
            shapes: vec![Vec::new()],
        }
    }

    /// Whether it is the one frame of [`BodyTake::at_rest`].
    pub fn is_at_rest(&self) -> bool {
        let upright = |r: &DMat3| *r == DMat3::IDENTITY;
        match &self.frames[..] {
            [Some((rotations, _))] => rotations.iter().all(upright),
            _ => false,
        }
    }

    /// The first frame, `count` times.
    #[must_use]
    pub fn repeated(&self, count: usize) -> BodyTake {
        BodyTake {
            poses: frames_of(count, None, None),
            frames: vec![self.frames[0].clone(); count],
            shapes: self.shapes.clone(),
        }
    }

    /// A take of rotations and positions, with the times and takes of `poses`, or else `fps` frames
    /// per second.
    pub fn of_rotations(
        poses: &Poses,
        frames: Vec<Option<(Vec<DMat3>, DVec3)>>,
        fps: Option<f64>,
    ) -> BodyTake {
        BodyTake {
            poses: timed(poses, fps),
            frames,
            shapes: vec![Vec::new()],
        }
    }

    /// The frames of an animation of `poses`.
    pub fn of(
        body: &BodyModel,
        animation: &Animation,
        poses: &Poses,
        fps: Option<f64>,
    ) -> BodyTake {
        let shape = body.shape.matrices(&animation.shape);
        let frame = |k: usize| {
            let fit = animation.fits[k].as_ref()?;
            let vertices = body.synthesize_shaped(&fit.state.rotations, &shape);
            // A fit's shift is that of the first vertex.
            let root = body.template.root_of(&vertices) + fit.shift - vertices[0];
            Some((fit.state.rotations.clone(), root))
        };
        let chunks = parallel::map_chunks(animation.fits.len(), 8, |range| {
            range.map(frame).collect::<Vec<_>>()
        });
        BodyTake {
            poses: timed(poses, fps),
            frames: chunks.concat(),
            shapes: vec![animation.shape.clone()],
        }
    }

    /// The shape of frame `k`.
    pub fn shape(&self, k: usize) -> &[f64] {
        &self.shapes[if self.shapes.len() == 1 { 0 } else { k }]
    }

    /// The meshes, centimeters; empty where nothing is known.
    pub fn meshes(&self, body: &BodyModel) -> Vec<Vec<DVec3>> {
        self.map_meshes(body, |_, mesh| mesh)
    }

    /// What `work` makes of each frame's number and mesh.
    fn map_meshes<T: Send + Clone>(
        &self,
        body: &BodyModel,
        work: impl Fn(usize, Vec<DVec3>) -> T + Sync,
    ) -> Vec<T> {
        let one = (self.shapes.len() == 1).then(|| body.shape.matrices(&self.shapes[0]));
        let mesh = |k: usize| {
            let Some((rotations, root)) = &self.frames[k] else {
                return Vec::new();
            };
            let vertices = match &one {
                Some(shape) => body.synthesize_shaped(rotations, shape),
                None => body.synthesize(rotations, self.shape(k)),
            };
            let shift = *root - body.template.root_of(&vertices);
            vertices.into_iter().map(|v| v + shift).collect()
        };
        let chunks = parallel::map_chunks(self.frames.len(), 4, |range| {
            range.map(|k| work(k, mesh(k))).collect::<Vec<_>>()
        });
        chunks.concat()
    }

    /// The same rotations on bodies of other shapes, each frame at the height of its lowest vertex.
    #[must_use]
    pub fn on_body(&self, body: &BodyModel, shapes: Vec<Vec<f64>>) -> BodyTake {
        let lowest = |_, mesh: Vec<DVec3>| mesh.iter().map(|v| v.y).fold(f64::INFINITY, f64::min);
        let mut other = BodyTake {
            shapes,
            ..self.clone()
        };
        let heights =
            (self.map_meshes(body, lowest).into_iter()).zip(other.map_meshes(body, lowest));
        for (frame, (own, others)) in other.frames.iter_mut().zip(heights) {
            if let Some((_, root)) = frame {
                root.y += own - others;
            }
        }
        other
    }

    /// The frames `range`, with their shapes.
    #[must_use]
    pub fn part(&self, range: std::ops::Range<usize>) -> BodyTake {
        BodyTake {
            poses: self.poses.slice(range.clone()),
            frames: self.frames[range.clone()].to_vec(),
            shapes: match self.shapes.len() {
                1 => self.shapes.clone(),
                _ => self.shapes[range].to_vec(),
            },
        }
    }
}

/// Frames without points.
pub fn frames_of(count: usize, time: Option<Vec<f64>>, take: Option<Vec<Arc<str>>>) -> Poses {
    Poses {
        points: Vec::new(),
        xyz: Array2::zeros((count, 0)),
        time,
        take,
    }
}

/// The frames of poses without points, with times by `fps` from the start of each take where they
/// have none.
pub fn timed(poses: &Poses, fps: Option<f64>) -> Poses {
    frames_of(poses.frames(), poses.times(fps), poses.take.clone())
}
