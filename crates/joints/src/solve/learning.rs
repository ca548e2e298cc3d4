//! A marker set learned from takes whose joints are known: where each marker is on its bone, by its
//! name.

use super::body::BONES;
use super::landmarks::{JointSet, Landmark};
use super::marker_sets::{MarkerSet, NamedMarker};
use super::marker_solver::too_few;
use super::person::{Calibrated, calibrated};
use super::tuning::learning::*;
use super::tuning::{BUILT_IN, FEWEST_MARKERS, FRAMES, LEAST_PEOPLE};
use crate::label::unlabeled::{marker_labels, own_name};
use crate::numeric::statistics::median;
use crate::pose::zeros::Zeros;
use crate::pose::{Poses, point_at};
use crate::prior::rotations::bones::mirror;
use crate::{Error, Result};
use glam::DVec3;
use ndarray::{Axis, concatenate};
use std::collections::BTreeMap;

/// Takes of people, each with its joints in the same frames where these are known.
pub type TakesToLearn<'a> = [(&'a Poses, Option<&'a Poses>)];

impl MarkerSet {
    /// Learns from takes of people: the markers that `set` knows (`None`: the built-in set that
    /// knows most) and those that move as one of the bones does, each by its own name.
    ///
    /// # Errors
    /// [`Error::Usage`]: a take and its joints have other numbers of frames, no joint is known, or
    /// a take has too few markers.
    pub fn learn(
        name: &str,
        takes: &TakesToLearn<'_>,
        set: Option<&MarkerSet>,
    ) -> Result<MarkerSet> {
        let mut positions: BTreeMap<String, Vec<DVec3>> = BTreeMap::new();
        let mut known: BTreeMap<String, Landmark> = BTreeMap::new();
        let mut joints_of = JointSet::Cmu;
        for (markers, joints) in takes {
            let own = set.or_else(|| MarkerSet::of(&markers.points));
            let own = own.ok_or_else(|| Error::usage("no marker set"))?;
            joints_of = joints.map_or(own.joints, |joints| JointSet::of(&joints.points));
            for (pattern, landmark, position) in positions_in(own, markers, *joints, joints_of)? {
                let first = known.entry(pattern.clone()).or_insert(landmark.clone());
                if (&first.bone, first.along) == (&landmark.bone, landmark.along) {
                    positions.entry(pattern).or_default().push(position);
                }
            }
        }
        let learned = known.into_iter().map(|(pattern, landmark)| {
            let [base, sd] = landmark.offset_and_sd(joints_of, false);
            let own = &positions[&pattern];
            let count = own.len() as f64;
            // Half a person is as the built-in landmark has it.
            let mean = (own.iter().sum::<DVec3>() + base * BUILT_IN) / (count + BUILT_IN);
            let scatter = own.iter().map(|p| (*p - mean) * (*p - mean)).sum::<DVec3>();
            let variance = (scatter + sd * sd * LEAST_PEOPLE) / (count + LEAST_PEOPLE);
            let sd = DVec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt());
            (pattern, landmark.at(mean, sd))
        });
        let mut set = MarkerSet::of_landmarks(name, learned);
        set.joints = joints_of;
        Ok(set)
    }
}

/// Where the markers of a take are on their bones, as of the left side, by their pattern.
fn positions_in(
    set: &MarkerSet,
    markers: &Poses,
    joints: Option<&Poses>,
    joints_of: JointSet,
) -> Result<Vec<(String, Landmark, DVec3)>> {
    let mut named = set.markers(&markers.points);
    let count = named.len();
    if count < FEWEST_MARKERS {
        return Err(too_few(set, count));
    }
    let mut xyz = Zeros::emptied(markers).xyz.clone();
    if let Some(joints) = joints {
        if markers.frames() != joints.frames() {
            return Err(Error::usage(format!(
                "{} frames of markers and {} of joints",
                markers.frames(),
                joints.frames()
            )));
        }
        for (name, bone) in joints_of.joints() {
            if let Some(point) = joints.points.iter().position(|p| *p == name) {
                named.push(NamedMarker::joint(markers.points.len() + point, &bone));
            }
        }
        if named.len() == count {
            return Err(Error::usage("no joint is one that markers are solved for"));
        }
        xyz = concatenate![Axis(1), xyz, joints.xyz];
    }
    let calibrated = calibrated(&named, (&xyz.view(), FRAMES), None, joints_of, None)?;
    let mut sides: BTreeMap<String, Vec<(NamedMarker, DVec3)>> = BTreeMap::new();
    for (m, marker) in named.into_iter().take(count).enumerate() {
        let own = BONES + 3 * m;
        let at = DVec3::from_slice(&calibrated.numbers[own..own + 3]);
        let at = if marker.is_right { mirror(at) } else { at };
        let pattern = set.pattern(&markers.points[marker.point]).to_string();
        sides.entry(pattern).or_default().push((marker, at));
    }
    let mean = |(pattern, sides): (String, Vec<(NamedMarker, DVec3)>)| {
        let at = sides.iter().map(|s| s.1).sum::<DVec3>() / sides.len() as f64;
        Some((pattern, sides.into_iter().next()?.0.landmark, at))
    };
    let mut positions: Vec<_> = sides.into_iter().filter_map(mean).collect();
    positions.extend(other_markers(set, markers, &calibrated)?);
    Ok(positions)
}

/// The markers of a take that the set does not know and that move as one of the bones does, which
/// they are then on.
fn other_markers(
    set: &MarkerSet,
    markers: &Poses,
    person: &Calibrated,
) -> Result<Vec<(String, Landmark, DVec3)>> {
    let step = markers.frames().div_ceil(MOST_FRAMES).max(1);
    let rows: Vec<usize> = (0..markers.frames()).step_by(step).collect();
    let postures = person.postures(&rows)?;
    let points = &markers.points;
    let known: Vec<usize> = set.markers(points).iter().map(|m| m.point).collect();
    let is_other = |p: &usize| !known.contains(p);
    let on_bone = |p: usize, bone: usize| {
        let seen = rows.iter().zip(&postures).filter_map(|(t, posture)| {
            let at = point_at(markers.xyz.view(), *t, p);
            let off = posture.rotations[bone].transpose() * (at - posture.starts[bone]);
            off.is_finite().then_some(off)
        });
        let offs: Vec<DVec3> = seen.collect();
        if offs.len() < FEWEST_FRAMES {
            return None;
        }
        let middle = [0, 1, 2].map(|c| median(offs.iter().map(|o| o[c]).collect()));
        let middle = DVec3::new(middle[0]?, middle[1]?, middle[2]?);
        let spread = median(offs.iter().map(|o| o.distance(middle)).collect())?;
        Some((spread, bone, middle))
    };
    let bones = person.body.template.bones();
    let is_near = |(_, bone, at): &(f64, usize, DVec3)| {
        let own = person.body.bone(&person.numbers, *bone);
        let along = at.dot(own) / own.length_squared().max(1.0);
        at.distance(along.clamp(0.0, 1.0) * own) <= FARTHEST
    };
    let of = |p: usize| {
        let all = (0..bones.len())
            .filter_map(|bone| on_bone(p, bone))
            .filter(is_near);
        let (_, bone, at) = all
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .filter(|(spread, ..)| *spread <= MOVES_AS)?;
        let own = person.body.bone(&person.numbers, bone);
        let along = (2.0 * at.dot(own) / own.length_squared().max(1.0)).round() / 2.0;
        let along = along.clamp(0.0, 1.0);
        let at = at - along * own;
        let landmark = Landmark::new(&bones[bone].name, along, [at, DVec3::splat(OTHER_SD)]);
        Some((own_name(&points[p]).to_string(), landmark, at))
    };
    let others = marker_labels(points).into_iter().filter(is_other);
    Ok(others.filter_map(of).collect())
}
