//! Which nodes of a scene are a skeleton.
//!
//! A skeleton is a tree of joints: nodes that are bones, or have a bone below and one above, from
//! the topmost bone down. What stands above it moves its root. Without any bones it is the largest
//! tree of empty nodes that moves.

use crate::Result;
use std::collections::HashSet;
use ufbx::{AnimStack, ElementType, Node, SceneRoot};

/// A tree that has fewer than this share of the joints of the largest is left out: controls, props.
const SMALL: usize = 3;

/// A skeleton of a scene.
#[derive(Debug, Clone)]
pub struct Skeleton {
    /// The name of its root joint; of several whose roots have one name, that of the node above.
    pub name: String,
    /// Whether it is left out where none is chosen: it is small beside the largest, or never moves
    /// while others do.
    pub is_aside: bool,
    /// Whether its joints stand among those of the skeleton beside it, too.
    pub(crate) is_beside: bool,
    /// The joints' nodes by their index in the scene, depth first, as children stand in the file;
    /// after the tree, those of small ones beside it.
    pub(crate) nodes: Vec<usize>,
    /// The parent of each joint but the roots, which comes before it.
    pub(crate) parents: Vec<Option<usize>>,
    /// The elements whose keys move it: its joints and what stands above the root.
    movers: HashSet<u32>,
}

impl Skeleton {
    /// The number of its joints, ends of bones among them.
    pub fn joint_count(&self) -> usize {
        self.nodes.len()
    }

    /// Whether a stack has keys that move it.
    pub(crate) fn has_keys(&self, stack: &AnimStack) -> bool {
        let mut curves = self.curves(stack);
        curves.any(|curve| !curve.keyframes.is_empty())
    }

    /// The curves of a stack that move it.
    pub(crate) fn curves<'a>(
        &'a self,
        stack: &'a AnimStack,
    ) -> impl Iterator<Item = &'a ufbx::AnimCurve> {
        let props = stack
            .layers
            .iter()
            .flat_map(|layer| layer.anim_props.iter());
        let own = props.filter(|prop| {
            let name: &str = &prop.prop_name;
            matches!(name, "Lcl Translation" | "Lcl Rotation" | "Lcl Scaling")
                && self.movers.contains(&prop.element.element_id)
        });
        let curves = own.flat_map(|prop| prop.anim_value.curves.iter().flatten());
        curves.map(|curve| &**curve)
    }
}

/// The skeletons of a scene.
///
/// # Errors
/// [`crate::Error::Unfit`]: there is none.
pub(crate) fn of_scene(scene: &SceneRoot) -> Result<Vec<Skeleton>> {
    let animated = animated(scene);
    let known: HashSet<u32> = bound(scene).union(&animated).copied().collect();
    // A limb that lost its attribute, and so the word for what it is.
    let is_limb = |node: &Node| {
        node.attrib.is_none()
            && known.contains(&node.element.element_id)
            && ancestors(node).any(|above| above.bone.is_some())
    };
    let is_bone =
        |node: &Node| node.bone.is_some() || node.attrib_type == ElementType::Bone || is_limb(node);
    let mut trees = trees(scene, &is_bone);
    if trees.is_empty() {
        let is_null =
            |node: &Node| matches!(node.attrib_type, ElementType::Empty | ElementType::Unknown);
        let moves = |node: &Node| is_null(node) && animated.contains(&node.element.element_id);
        let mut nulls = trees_from(scene, &moves, &is_null);
        nulls.sort_by_key(|tree| std::cmp::Reverse(tree.nodes.len()));
        trees.extend(nulls.into_iter().next().filter(|tree| tree.nodes.len() > 1));
    }
    if trees.is_empty() {
        let what = "has no skeleton: neither bones nor a tree of empty nodes that moves (a text \
                    that was cut short may read so too)";
        return Err(what.into());
    }
    set_aside(scene, &mut trees);
    add_beside(scene, &mut trees);
    tell_apart(scene, &mut trees);
    Ok(trees)
}

/// The elements that have keys in any stack.
fn animated(scene: &SceneRoot) -> HashSet<u32> {
    let layers = scene.anim_layers.iter();
    let props = layers.flat_map(|layer| layer.anim_props.iter());
    let has_keys = |prop: &&ufbx::AnimProp| {
        let mut curves = prop.anim_value.curves.iter().flatten();
        curves.any(|curve| !curve.keyframes.is_empty())
    };
    props
        .filter(has_keys)
        .map(|prop| prop.element.element_id)
        .collect()
}

/// The nodes that stand in a bind pose.
fn bound(scene: &SceneRoot) -> HashSet<u32> {
    let poses = scene.poses.iter().filter(|pose| pose.is_bind_pose);
    let bones = poses.flat_map(|pose| pose.bone_poses.iter());
    bones
        .map(|bone| bone.bone_node.element.element_id)
        .collect()
}

/// The nodes above one, from its parent up.
pub(crate) fn ancestors(node: &Node) -> impl Iterator<Item = &Node> {
    std::iter::successors(node.parent.as_deref(), |above| above.parent.as_deref())
}

/// The nodes below one; what stands between for its scale alone is passed over.
fn children(node: &Node) -> Vec<&Node> {
    let mut all = Vec::new();
    for child in &node.children {
        if child.is_scale_helper {
            all.extend(&child.children);
        } else {
            all.push(child);
        }
    }
    all
}

/// The trees of bones.
fn trees(scene: &SceneRoot, is_bone: &dyn Fn(&Node) -> bool) -> Vec<Skeleton> {
    let mut holds = HashSet::new(); // bones, and what has one below
    for node in &scene.nodes {
        if is_bone(node) {
            holds.insert(node.element.element_id);
            for above in ancestors(node) {
                if !holds.insert(above.element.element_id) {
                    break;
                }
            }
        }
    }
    trees_from(scene, is_bone, &|node| {
        holds.contains(&node.element.element_id)
    })
}

/// The trees that begin at the topmost nodes that are roots and go on while nodes belong to them.
fn trees_from(
    scene: &SceneRoot,
    is_root: &dyn Fn(&Node) -> bool,
    belongs: &dyn Fn(&Node) -> bool,
) -> Vec<Skeleton> {
    let (mut trees, mut stack) = (Vec::new(), vec![&*scene.root_node]);
    while let Some(node) = stack.pop() {
        if !node.is_root && is_root(node) {
            trees.push(tree(node, belongs));
        } else {
            stack.extend(children(node).into_iter().rev());
        }
    }
    trees
}

/// The tree below a root.
fn tree(root: &Node, belongs: &dyn Fn(&Node) -> bool) -> Skeleton {
    let (mut nodes, mut parents) = (Vec::new(), Vec::new());
    let mut movers: HashSet<u32> = ancestors(root)
        .map(|node| node.element.element_id)
        .collect();
    let mut stack = vec![(root, None)];
    while let Some((node, parent)) = stack.pop() {
        let own = nodes.len();
        nodes.push(node.element.typed_id as usize);
        parents.push(parent);
        movers.insert(node.element.element_id);
        movers.extend(
            node.scale_helper
                .iter()
                .map(|helper| helper.element.element_id),
        );
        let below = children(node).into_iter().filter(|node| belongs(node));
        stack.extend(below.rev().map(|node| (node, Some(own))));
    }
    Skeleton {
        name: root.element.name.to_string(),
        is_aside: false,
        is_beside: false,
        nodes,
        parents,
        movers,
    }
}

/// Marks those that are left out.
fn set_aside(scene: &SceneRoot, trees: &mut [Skeleton]) {
    let moves = |tree: &Skeleton| scene.anim_stacks.iter().any(|stack| tree.has_keys(stack));
    let moving: Vec<bool> = trees.iter().map(moves).collect();
    let any = moving.contains(&true);
    let counted = trees
        .iter()
        .zip(&moving)
        .filter(|(_, moves)| !any || **moves);
    let largest = counted.map(|(tree, _)| tree.nodes.len()).max().unwrap_or(0);
    for (tree, moves) in trees.iter_mut().zip(moving) {
        tree.is_aside = any && !moves || SMALL * tree.nodes.len() < largest;
    }
}

/// Adds small trees that move to the skeleton in whose armature they stand: a bone for a camera or
/// a prop.
fn add_beside(scene: &SceneRoot, trees: &mut [Skeleton]) {
    let parent = |tree: &Skeleton| {
        let above = scene.nodes[tree.nodes[0]].parent.as_deref();
        above
            .filter(|above| !above.is_root)
            .map(|above| above.element.element_id)
    };
    let moves = |tree: &Skeleton| scene.anim_stacks.iter().any(|stack| tree.has_keys(stack));
    for i in 0..trees.len() {
        if !trees[i].is_aside || !moves(&trees[i]) {
            continue;
        }
        let armature = parent(&trees[i]);
        let holds = |tree: &&mut Skeleton| !tree.is_aside && parent(tree) == armature;
        let small = trees[i].clone();
        let mut main = trees.iter_mut().filter(holds);
        if let (Some(_), Some(tree), None) = (armature, main.next(), main.next()) {
            let first = tree.nodes.len();
            tree.nodes.extend(small.nodes);
            let parents = small.parents.iter().map(|parent| parent.map(|p| first + p));
            tree.parents.extend(parents);
            tree.movers.extend(small.movers);
            trees[i].is_beside = true;
        }
    }
}

/// Names those whose roots have one name by the nodes above these; where that does not help, counts
/// them.
fn tell_apart(scene: &SceneRoot, trees: &mut [Skeleton]) {
    let is_repeated =
        |trees: &[Skeleton], name: &str| trees.iter().filter(|tree| tree.name == name).count() > 1;
    let repeated: Vec<bool> = trees
        .iter()
        .map(|tree| is_repeated(trees, &tree.name))
        .collect();
    for (tree, _) in trees
        .iter_mut()
        .zip(repeated)
        .filter(|(_, repeated)| *repeated)
    {
        let root = &scene.nodes[tree.nodes[0]];
        if let Some(above) = ancestors(root).find(|above| !above.is_root) {
            tree.name = above.element.name.to_string();
        }
    }
    let mut taken = HashSet::new();
    for tree in trees {
        let own = tree.name.clone();
        let mut number = 1;
        while !taken.insert(tree.name.clone()) {
            number += 1;
            tree.name = format!("{own}_{number}");
        }
    }
}
