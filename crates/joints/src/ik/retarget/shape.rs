//! A body found by the shape of its tree: two legs on one joint, two arms on another, the head
//! between the arms; left and right by words in the names, else by where the toes point.

use super::hierarchy::Hierarchy;
use super::tuning::shape::*;
use crate::{Error, Result};
use glam::DVec3;

/// A leg (hip, knee, ankle) or an arm (shoulder, elbow, wrist).
#[derive(Debug, Clone, PartialEq)]
pub(in crate::ik) struct Limb {
    pub joints: [usize; 3],
    /// The joint of the toes, or at the hand's end.
    pub end: Option<usize>,
}

/// Joints from one that hangs on a fork downwards, along the longest way.
type Chain = Vec<usize>;

/// Legs and arms of a body.
type Limbs = ([Limb; 2], [Limb; 2]);

/// The legs and the arms of a tree.
///
/// # Errors
/// [`Error::Unfit`]: why it has none, or not for sure.
pub(super) fn find(tree: &Hierarchy) -> Result<Limbs> {
    let (lengths, sizes) = (lengths(tree), sizes(tree));
    let mut pairs: Vec<(usize, [Chain; 2])> = Vec::new();
    for joint in 0..tree.len() {
        pairs.extend(pair(tree, [&lengths, &sizes], joint).map(|pair| (joint, pair)));
    }
    // Fingers and the like hang on limbs: of pairs the uppermost two count.
    let depth = |joint: usize| tree.upwards(joint).count();
    pairs.sort_by_key(|(joint, _)| depth(*joint));
    let (Some(lower), rest) = (pairs.first(), pairs.get(1..).unwrap_or_default()) else {
        return Err(Error::unfit("it has no two limbs alike"));
    };
    let hangs_on_it = |(joint, _): &&(usize, [Chain; 2])| {
        let limbs = lower.1.iter().map(|chain| chain[0]);
        limbs.into_iter().all(|limb| !tree.is_below(*joint, limb))
    };
    let Some(upper) = rest.iter().find(hangs_on_it) else {
        return Err(Error::unfit("it has two limbs alike, not four"));
    };
    let limbs = |pair: &(usize, [Chain; 2])| pair.1.clone().map(|chain| limb(tree, &chain));
    let ([a, b], [c, d]) = (limbs(lower), limbs(upper));
    let ([Some(a), Some(b)], [Some(c), Some(d)]) = ([a, b], [c, d]) else {
        return Err(Error::unfit("its limbs have no two long bones"));
    };
    let long = |limb: &Limb| length(tree, limb.joints[0], limb.joints[2]);
    let (legs, arms) = if long(&a) > long(&c) {
        ([a, b], [c, d])
    } else {
        // The tree grows from the chest.
        ([c, d], [a, b])
    };
    if !LEG_TO_ARM.contains(&(long(&legs[0]) / long(&arms[0]))) {
        return Err(Error::unfit(
            "its limbs are too much alike to tell legs from arms",
        ));
    }
    sided(tree, legs, arms)
}

/// By joint, the length of the longest way down from it.
fn lengths(tree: &Hierarchy) -> Vec<f64> {
    let tips = |j: usize| tree.tips[j].iter().map(|t| t.length());
    let mut lengths: Vec<f64> = (0..tree.len())
        .map(|j| tips(j).fold(0.0, f64::max))
        .collect();
    for j in (1..tree.len()).rev() {
        if let Some(parent) = tree.parents[j] {
            lengths[parent] = lengths[parent].max(tree.offsets[j].length() + lengths[j]);
        }
    }
    lengths
}

/// By joint, the number of joints from it downwards.
fn sizes(tree: &Hierarchy) -> Vec<f64> {
    let mut sizes = vec![1.0; tree.len()];
    for j in (1..tree.len()).rev() {
        if let Some(parent) = tree.parents[j] {
            sizes[parent] += sizes[j];
        }
    }
    sizes
}

/// The longest two branches of a joint that are alike, each of three joints at least.
fn pair(tree: &Hierarchy, [lengths, sizes]: [&[f64]; 2], joint: usize) -> Option<[Chain; 2]> {
    let whole = |j: usize| tree.offsets[j].length() + lengths[j];
    let mut branches: Vec<usize> = tree.children(joint).collect();
    branches.sort_by(|a, b| whole(*b).total_cmp(&whole(*a)));
    let is_alike = |a: usize, b: usize| {
        whole(a) - whole(b) <= ALIKE * whole(a) && sizes[a] == sizes[b] && sizes[a] >= 3.0
    };
    let two = branches.iter().enumerate().find_map(|(n, &a)| {
        let others = branches[n + 1..].iter().copied();
        others
            .take(MOST_BRANCHES)
            .find(|&b| is_alike(a, b))
            .map(|b| [a, b])
    });
    let chains = two?.map(|j| chain(tree, lengths, j));
    chains.iter().all(|c| c.len() >= 3).then_some(chains)
}

fn chain(tree: &Hierarchy, lengths: &[f64], from: usize) -> Chain {
    let whole = |j: &usize| tree.offsets[*j].length() + lengths[*j];
    let longest = |j: &usize| {
        let children = tree.children(*j);
        children.max_by(|a, b| whole(a).total_cmp(&whole(b)))
    };
    std::iter::successors(Some(from), longest).collect()
}

/// The limb of a chain: its two longest neighboring bones; of several that are about as long, as
/// collar and upper arm are, the last.
fn limb(tree: &Hierarchy, chain: &[usize]) -> Option<Limb> {
    let bone = |j: usize| tree.offsets[j].length();
    let long = |three: &[usize]| bone(three[1]) + bone(three[2]);
    let longest = chain.windows(3).map(long).fold(0.0, f64::max);
    let at = (chain.windows(3)).rposition(|three| long(three) >= ABOUT_AS_LONG * longest)?;
    let joints = [chain[at], chain[at + 1], chain[at + 2]];
    let is_limb = RATIO.contains(&(bone(joints[1]) / bone(joints[2])));
    is_limb.then_some(Limb {
        joints,
        end: chain.get(at + 3).copied(),
    })
}

fn length(tree: &Hierarchy, from: usize, to: usize) -> f64 {
    let path = tree.path(from, to);
    path.iter().map(|&j| tree.offsets[j].length()).sum()
}

/// Legs and arms, left before right.
fn sided(tree: &Hierarchy, [a, b]: [Limb; 2], [c, d]: [Limb; 2]) -> Result<Limbs> {
    let positions = tree.zero().positions;
    let at = |limb: &Limb, n: usize| positions[limb.joints[n]];
    let across = at(&a, 0) - at(&b, 0);
    let by_words = |a: &Limb, b: &Limb| {
        let side = |limb: &Limb| side(&tree.names[limb.joints[1]]);
        match (side(a), side(b)) {
            (Some(a), Some(b)) if a != b => Some(a),
            _ => None,
        }
    };
    let by_toes = || {
        let up = (at(&c, 0) + at(&d, 0) - at(&a, 2) - at(&b, 2)).try_normalize()?;
        let toes = |limb: &Limb| match limb.end {
            Some(end) => Some(positions[end] - at(limb, 2)),
            None => tree.tips[limb.joints[2]].first().copied(),
        };
        let forward = toes(&a)? + toes(&b)?;
        let forward = (forward - forward.dot(up) * up).try_normalize()?;
        let left = up.cross(forward).dot(across.try_normalize()?);
        (left.abs() > FORWARD).then_some(left > 0.0)
    };
    let Some(is_left) = by_words(&a, &b).or_else(by_toes) else {
        return Err(Error::unfit("nothing tells its left from its right"));
    };
    let shoulders: DVec3 = at(&c, 0) - at(&d, 0);
    let is_same = match by_words(&c, &d) {
        Some(c_is_left) => c_is_left == is_left,
        None => shoulders.dot(across) > 0.0,
    };
    let legs = if is_left { [a, b] } else { [b, a] };
    let arms = if is_same == is_left { [c, d] } else { [d, c] };
    Ok((legs, arms))
}

/// Whether a name is of the left side; `None`: it says nothing.
fn side(name: &str) -> Option<bool> {
    let name = name.to_ascii_lowercase();
    let is_word = |word: &str| {
        name.split(|c: char| !c.is_alphanumeric())
            .any(|w| w == word)
    };
    let left = name.contains("left") || is_word("l");
    let right = name.contains("right") || is_word("r");
    (left != right).then_some(left)
}

/// The joint of the head: on the longest branch of the chest that is no arm, the first that carries
/// not one joint alone. Of three or more joints, the last of which has no length, it is the one
/// before: neck, head, top of the head.
pub(super) fn head(tree: &Hierarchy, chest: usize, arms: Option<&[Limb; 2]>) -> Option<usize> {
    let lengths = lengths(tree);
    let is_arm = |j: usize| {
        let mut shoulders = arms.into_iter().flatten().map(|arm| arm.joints[0]);
        shoulders.any(|shoulder| tree.is_below(shoulder, j))
    };
    let whole = |j: &usize| tree.offsets[*j].length() + lengths[*j];
    let branches = tree.children(chest).filter(|&j| !is_arm(j));
    let neck = branches.max_by(|a, b| whole(a).total_cmp(&whole(b)))?;
    let mut joint = neck;
    let is_top = |j: usize| {
        let is_third = tree.parents[j].is_some_and(|p| p != neck) && j != neck;
        is_third && tree.tips[j].iter().all(|t| t.length() == 0.0)
    };
    loop {
        let mut children = tree.children(joint);
        match (children.next(), children.next()) {
            (Some(only), None) => joint = only,
            (None, _) if is_top(joint) => return tree.parents[joint],
            _ => return Some(joint),
        }
    }
}
