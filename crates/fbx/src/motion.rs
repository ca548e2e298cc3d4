//! The motion of a skeleton: where its joints are and how far they are turned from their rest pose.

use crate::Result;
use crate::pose::rotation::is_rotation;
use crate::pose::similarity::nearest_rotation;
use crate::rest::{Stance, affine, rest_pose};
use crate::skeletons::{Skeleton, ancestors};
use crate::takes;
use glam::{DAffine3, DQuat, DVec3};
use ndarray::Array2;
use ufbx::{Anim, Node, SceneRoot};

/// The bytes of a joint in a frame.
const BYTES: usize = size_of::<DVec3>() + size_of::<DQuat>();

/// A joint of a skeleton.
#[derive(Debug, Clone, PartialEq)]
pub struct FbxJoint {
    /// The node's name, with its namespace; names may repeat.
    pub name: String,
    /// The index of the parent joint, which comes before this one; `None` for the first, and for
    /// roots of small trees beside it, which come after its own.
    pub parent: Option<usize>,
    /// Where the joint is in the rest pose, centimeters.
    pub rest: DVec3,
    /// Whether it is but the end of its parent's bone, as Blender writes them: a leaf called as the
    /// parent and `_end`.
    pub is_end: bool,
}

/// A skeleton's motion.
#[derive(Debug, Clone)]
pub struct FbxMotion {
    /// The joints, depth first.
    pub joints: Vec<FbxJoint>,
    /// Frames per second.
    pub rate: f64,
    /// Where the joints are, (frames, 3 joints), centimeters, y up; NaN where a key is no number.
    pub positions: Array2<f64>,
    /// How far each joint is turned in the world from its rest pose, (frames, joints); NaN
    /// likewise.
    pub turns: Array2<DQuat>,
    /// What was odd, a line each.
    pub notes: Vec<String>,
}

/// The motion of a skeleton in a stack.
///
/// # Errors
/// [`crate::Error::Unfit`]: there is no rest pose or no rate, or it is too long.
pub(crate) fn sampled(
    scene: &SceneRoot,
    tree: &Skeleton,
    stack: usize,
    fps: Option<f64>,
) -> Result<FbxMotion> {
    let stack = &scene.anim_stacks[stack];
    let times = takes::of_take(scene, tree, stack, fps, BYTES)?;
    let mut motion = FbxMotion::new(scene, tree, times.frames.len(), times.rate)?;
    motion.notes = times.notes;
    let rest = rest_pose(scene, tree)?;
    let chain = Chain::new(scene, tree);
    let mut worlds = Vec::new();
    for (frame, time) in times.frames.iter().enumerate() {
        chain.evaluate(&stack.anim, *time, &mut worlds);
        let joints = chain.joints.iter().map(|at| Stance::of(&worlds[*at]));
        for (joint, (now, rest)) in joints.zip(&rest).enumerate() {
            motion.put(frame, joint, &now, rest);
        }
    }
    Ok(motion)
}

/// A skeleton in its rest pose.
///
/// # Errors
/// [`crate::Error::Unfit`]: it has none.
pub(crate) fn still(scene: &SceneRoot, tree: &Skeleton) -> Result<FbxMotion> {
    let mut motion = FbxMotion::new(scene, tree, 1, 30.0)?;
    for (joint, rest) in rest_pose(scene, tree)?.iter().enumerate() {
        motion.put(0, joint, rest, rest);
    }
    Ok(motion)
}

impl FbxMotion {
    /// The number of joints of the skeleton itself; those after them stand beside it.
    pub fn tree_len(&self) -> usize {
        let roots = self
            .joints
            .iter()
            .skip(1)
            .position(|joint| joint.parent.is_none());
        roots.map_or(self.joints.len(), |at| at + 1)
    }

    fn new(scene: &SceneRoot, tree: &Skeleton, frames: usize, rate: f64) -> Result<FbxMotion> {
        let rest = rest_pose(scene, tree)?;
        let name = |i: usize| scene.nodes[tree.nodes[i]].element.name.to_string();
        let is_leaf = |i: usize| !tree.parents.contains(&Some(i));
        let joint = |(i, rest): (usize, &Stance)| FbxJoint {
            name: name(i),
            parent: tree.parents[i],
            rest: rest.at,
            is_end: tree.parents[i].is_some_and(|p| name(i) == format!("{}_end", name(p)))
                && is_leaf(i),
        };
        Ok(FbxMotion {
            joints: rest.iter().enumerate().map(joint).collect(),
            rate,
            positions: Array2::zeros((frames, 3 * rest.len())),
            turns: Array2::from_elem((frames, rest.len()), DQuat::IDENTITY),
            notes: Vec::new(),
        })
    }

    /// Takes down where a joint is in a frame.
    fn put(&mut self, frame: usize, joint: usize, now: &Stance, rest: &Stance) {
        let missing = |value: f64| if value.is_finite() { value } else { f64::NAN };
        for (axis, value) in now.at.to_array().into_iter().enumerate() {
            self.positions[[frame, 3 * joint + axis]] = missing(value);
        }
        self.turns[[frame, joint]] = turn(now, rest);
    }
}

/// The rotation from the rest pose; NaN where there is none.
fn turn(now: &Stance, rest: &Stance) -> DQuat {
    let turn = now.axes * rest.axes.transpose();
    if !turn.is_finite() {
        return DQuat::from_array([f64::NAN; 4]);
    }
    if is_rotation(turn, 1e-9) {
        return DQuat::from_mat3(&turn);
    }
    // What shear leaves oblique is made straight.
    let (nearest, ..) = nearest_rotation(&turn.transpose());
    DQuat::from_mat3(&nearest)
}

/// The nodes whose transforms make those of a skeleton's joints, each after its parent.
struct Chain<'a> {
    nodes: Vec<(&'a Node, Option<usize>)>,
    /// The place of each joint among them.
    joints: Vec<usize>,
}

impl<'a> Chain<'a> {
    fn new(scene: &'a SceneRoot, tree: &Skeleton) -> Chain<'a> {
        let mut chain = Chain {
            nodes: Vec::new(),
            joints: Vec::new(),
        };
        let mut places = vec![None; scene.nodes.len()];
        for node in &tree.nodes {
            let node = &scene.nodes[*node];
            let mut path: Vec<&Node> = std::iter::once(node).chain(ancestors(node)).collect();
            path.reverse();
            let mut above = None;
            for node in path {
                let place = &mut places[node.element.typed_id as usize];
                above = Some(*place.get_or_insert_with(|| {
                    chain.nodes.push((node, above));
                    chain.nodes.len() - 1
                }));
            }
            chain.joints.extend(above);
        }
        chain
    }

    /// The transforms of the nodes in the world at a time.
    fn evaluate(&self, anim: &Anim, time: f64, worlds: &mut Vec<DAffine3>) {
        worlds.clear();
        for (node, above) in &self.nodes {
            let own = if node.is_root {
                affine(&node.node_to_parent)
            } else {
                let local = ufbx::evaluate_transform(anim, node, time);
                affine(&ufbx::transform_to_matrix(&local))
            };
            worlds.push(above.map_or(own, |above| worlds[above] * own));
        }
    }
}
