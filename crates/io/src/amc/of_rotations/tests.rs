//! Motions of BVH as takes of the skeletons of CMU.

use super::*;

fn walk(asf: &Asf) -> (Amc<'_>, Bvh) {
    let take = Amc::open("../../testdata/cmu/07/07_01.amc", asf).unwrap();
    let bvh = take.to_bvh(120.0).unwrap();
    (take, bvh)
}

fn asf() -> Asf {
    Asf::open("../../testdata/cmu/07/07.asf").unwrap()
}

#[test]
fn a_take_comes_back_with_its_values() {
    let asf = asf();
    let (take, bvh) = walk(&asf);
    let (back, [_, most]) = asf.take_of(&bvh).unwrap();
    assert!(most <= 1e-6, "{most}");
    assert_eq!(back.frames.numbers, take.frames.numbers);
    for (a, b) in take.frames.values.iter().zip(&back.frames.values) {
        assert!((a - b).abs() <= 1e-6, "{a} {b}");
    }
}

#[test]
fn a_shank_out_of_its_plane_keeps_its_direction() {
    let asf = asf();
    let (_, mut bvh) = walk(&asf);
    let column = |name: &str| {
        let before = bvh.joints.iter().take_while(|joint| joint.name != name);
        before.map(|joint| joint.channels.len()).sum::<usize>()
    };
    // The knee bends, and turns by half a radian more about y, which the skeleton cannot do.
    let (y, x) = (column("ltibia") + 1, column("ltibia") + 2);
    bvh.motion.column_mut(y).mapv_inplace(|v| v + 0.5);
    bvh.motion.column_mut(x).mapv_inplace(|v| v + 0.8);
    let skeleton = &asf.skeleton;
    let (take, [mean, _]) = asf.take_of(&bvh).unwrap();
    assert!(mean > 0.0);
    let shank = skeleton
        .bones()
        .iter()
        .position(|b| b.name == "ltibia")
        .unwrap();
    let (frames, dofs) = (bvh.motion.nrows(), skeleton.dof_count());
    let foot = bvh
        .joints
        .iter()
        .position(|joint| joint.name == "lfoot")
        .unwrap();
    let tree = crate::bvh::BvhSkeleton::new(&bvh.joints, DMat3::IDENTITY, true).unwrap();
    let goal = tree.positions(bvh.motion.view(), crate::bvh::BvhPoints::Origins);
    let mut posture = Posture::default();
    for t in 0..frames {
        skeleton.posture_into(&take.frames.values[t * dofs..][..dofs], &mut posture);
        let ankle = [0, 1, 2].map(|axis| goal[[t, 3 * foot + axis]]);
        let far = posture.ends[shank].distance(DVec3::from_array(ankle));
        assert!(far <= 0.1, "frame {t}: {far} cm");
    }
}

#[test]
fn missing_values_and_other_bones_are_refused() {
    let asf = asf();
    let (_, mut bvh) = walk(&asf);
    bvh.motion[[3, 20]] = f64::NAN;
    let error = asf.take_of(&bvh).unwrap_err().to_string();
    assert!(error.contains("cannot hold"), "{error}");
    bvh.motion[[3, 20]] = 0.0;
    bvh.joints[4].name = "tail".into();
    assert!(asf.take_of(&bvh).is_err());
}
