//! The motion around a pair of poses: both takes in the body's frame of the labeled pose, and the
//! cut from one to the other.

use crate::Result;
use crate::joint_map::{JointMap, PARENTS, joint};
use crate::pose::Poses;
use glam::{DMat3, DVec3};
use ndarray::Array2;

/// Poses a second that a page shows.
pub(crate) const RATE: f64 = 60.0;
/// Length of the cross-fade of a cut, seconds; its middle is the labeled instant.
pub(crate) const FADE: f64 = 0.3;
/// The share of frames whose lowest joint is below the ground.
const BELOW_GROUND: f64 = 0.01;

/// One frame of the sixteen joints, cm; NaN missing.
type Frame = [DVec3; 16];

/// A take whose pairs are shown.
#[derive(Debug, Clone)]
pub struct Motion {
    /// The take's name.
    pub name: String,
    /// (frames, 48): the sixteen joints in the world, cm, y up, NaN missing.
    joints: Array2<f64>,
    /// Frames a second.
    rate: f64,
    /// Scale to the height of all bodies of the page.
    scale: f64,
    /// Height of the ground, cm.
    ground: f64,
}

impl Motion {
    /// The joints of a take at `rate` frames a second, whose bodies are `scale` times as high on
    /// the page.
    ///
    /// # Errors
    /// [`crate::Error::Unfit`]: the joints whose points are missing.
    pub fn new(name: &str, take: &Poses, map: &JointMap, rate: f64, scale: f64) -> Result<Motion> {
        let points = map.find(&take.points)?;
        let joints = Array2::from_shape_fn((take.frames(), 48), |(t, c)| {
            points.at(&take.xyz, t, c / 3)[c % 3]
        });
        let lowest = |row: ndarray::ArrayView1<'_, f64>| {
            let heights = row.iter().skip(1).step_by(3);
            heights.copied().fold(f64::INFINITY, f64::min)
        };
        let mut lows: Vec<f64> = joints.rows().into_iter().map(lowest).collect();
        lows.retain(|low| low.is_finite());
        lows.sort_by(f64::total_cmp);
        let ground = lows.get((lows.len() as f64 * BELOW_GROUND) as usize);
        Ok(Motion {
            name: name.to_string(),
            rate,
            scale,
            ground: ground.copied().unwrap_or(0.0),
            joints,
        })
    }

    /// The time of a frame, seconds since the take began.
    pub(crate) fn time(&self, frame: usize) -> f64 {
        frame as f64 / self.rate
    }

    fn frame(&self, t: usize) -> Frame {
        std::array::from_fn(|j| DVec3::from_array([0, 1, 2].map(|a| self.joints[[t, 3 * j + a]])))
    }

    /// The pose at a time in frames, between two frames on the straight line; missing beyond the
    /// take.
    fn at(&self, time: f64) -> Frame {
        let last = self.joints.nrows() as f64 - 1.0;
        if !(-1e-6..=last + 1e-6).contains(&time) {
            return [DVec3::NAN; 16];
        }
        let before = time.clamp(0.0, last).floor();
        let share = (time - before).clamp(0.0, 1.0);
        let a = self.frame(before as usize);
        if share < 1e-6 {
            return a;
        }
        let b = self.frame((before + 1.0).min(last) as usize);
        std::array::from_fn(|j| a[j].lerp(b[j], share))
    }

    /// The poses around `frame`, as many before as after it, 60 a second. In that frame the hip is
    /// above the origin and the body has no yaw.
    pub(crate) fn around(&self, frame: usize, seconds: f64) -> Vec<Frame> {
        let middle = self.frame(frame);
        let turn = without_yaw(middle[joint::LHIP] - middle[joint::RHIP]);
        let hip = middle[joint::HIP];
        let origin = DVec3::new(hip.x, self.ground, hip.z);
        let half = samples(seconds) / 2;
        let position = |i: usize| {
            let time = frame as f64 + (i as f64 - half as f64) / RATE * self.rate;
            self.at(time).map(|p| turn * ((p - origin) * self.scale))
        };
        (0..=2 * half).map(position).collect()
    }
}

/// The number of poses shown around a frame: as many before as after it.
pub(crate) fn samples(seconds: f64) -> usize {
    2 * ((seconds * RATE) + 1e-6) as usize + 1
}

/// The rotation about y that carries `across`, from the right hip joint to the left one, to x.
fn without_yaw(across: DVec3) -> DMat3 {
    if across.x.hypot(across.z) > 0.0 {
        DMat3::from_rotation_y(across.z.atan2(across.x))
    } else {
        DMat3::IDENTITY
    }
}

/// The cut from `a` to `b`: `a`, faded into `b` over [`FADE`] seconds, then `b`. Bones keep their
/// lengths in the fade.
pub(crate) fn cut(a: &[Frame], b: &[Frame]) -> Vec<Frame> {
    let half = a.len() as f64 / 2.0;
    let pairs = a.iter().zip(b).enumerate();
    let faded = pairs.map(|(i, (a, b))| {
        let time = (i as f64 + 0.5 - half) / RATE;
        let share = (time / FADE + 0.5).clamp(0.0, 1.0);
        blend(a, b, share * share * (3.0 - 2.0 * share))
    });
    faded.collect()
}

/// The pose between two: the hip on the straight line, the bones from it outwards turned and
/// lengthened in proportion.
fn blend(a: &Frame, b: &Frame, share: f64) -> Frame {
    match share {
        0.0 => return *a,
        1.0 => return *b,
        _ => {}
    }
    let mut pose = [a[0].lerp(b[0], share); 16];
    for j in 1..16 {
        let parent = PARENTS[j];
        let (u, v) = (a[j] - a[parent], b[j] - b[parent]);
        let length = u.length() + share * (v.length() - u.length());
        let between = (u.normalize_or_zero()).lerp(v.normalize_or_zero(), share);
        let is_missing = u.is_nan() || v.is_nan();
        let bone = if is_missing {
            DVec3::NAN
        } else {
            length * between.normalize_or_zero()
        };
        pose[j] = pose[parent] + bone;
    }
    pose
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint_map::JOINTS;

    /// A person who walks along x at 120 cm a second and is turned by `yaw`; joints sway.
    fn walking(frames: usize, rate: f64, yaw: f64) -> Motion {
        let turn = DMat3::from_rotation_y(yaw);
        let position = |t: usize, j: usize| {
            let time = t as f64 / rate;
            let side = match j {
                joint::LHIP => 10.0,
                joint::RHIP => -10.0,
                _ => 3.0 * (6.0 * time + j as f64).sin(),
            };
            let world = turn * DVec3::new(side, 100.0 - 5.0 * j as f64, 120.0 * time);
            world + DVec3::new(300.0, 7.0, -40.0)
        };
        let take = Poses {
            points: JOINTS.map(String::from).into(),
            xyz: Array2::from_shape_fn((frames, 48), |(t, c)| position(t, c / 3)[c % 3]),
            ..Poses::default()
        };
        let own = JOINTS.map(|j| (j.to_string(), j.to_string()));
        let map = JointMap::new(own.into()).unwrap();
        Motion::new("walk", &take, &map, rate, 1.0).unwrap()
    }

    #[test]
    fn position_and_yaw_of_the_labeled_frame_are_removed() {
        let (a, b) = (walking(240, 120.0, 0.3), walking(120, 60.0, 2.0));
        // The same motion at two rates and two headings looks the same.
        let (a, b) = (a.around(100, 0.5), b.around(50, 0.5));
        assert_eq!((a.len(), b.len()), (61, 61));
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            assert!((*a - *b).length() < 0.1, "{a} {b}");
        }
        let hip = a[30][joint::HIP];
        assert!(hip.x.abs() < 1e-9 && hip.z.abs() < 1e-9);
        let across = a[30][joint::LHIP] - a[30][joint::RHIP];
        assert!(across.z.abs() < 1e-9 && across.x > 0.0);
    }

    #[test]
    fn the_lowest_joint_stands_on_the_ground() {
        let a = walking(240, 120.0, 0.3).around(100, 0.5);
        assert!(
            a.iter()
                .flatten()
                .map(|p| p.y)
                .fold(f64::INFINITY, f64::min)
                .abs()
                < 1e-9
        );
    }

    #[test]
    fn a_cut_begins_as_a_ends_as_b_and_keeps_bones() {
        let motion = walking(400, 120.0, 0.0);
        let (a, b) = (motion.around(100, 0.5), motion.around(190, 0.5));
        let cut = cut(&a, &b);
        let faded = (FADE / 2.0 * RATE) as usize;
        assert_eq!(cut[..30 - faded], a[..30 - faded]);
        assert_eq!(cut[31 + faded..], b[31 + faded..]);
        for ((a, b), pose) in a.iter().zip(&b).zip(&cut) {
            for j in 1..16 {
                let [a, b, now] = [a, b, pose].map(|p| (p[j] - p[PARENTS[j]]).length());
                assert!(now >= a.min(b) - 1e-9 && now <= a.max(b) + 1e-9);
            }
        }
    }

    #[test]
    fn what_is_missing_stays_missing() {
        let mut motion = walking(240, 120.0, 0.0);
        motion.joints[[101, 3 * joint::LHAND]] = f64::NAN;
        let a = motion.around(100, 0.5);
        assert!(a[30][joint::LHAND].is_finite());
        // Beyond the take nothing is seen.
        assert!(motion.around(10, 0.5)[0][joint::HIP].is_nan());
        let gap = cut(&motion.around(101, 0.5), &a);
        assert!(gap[30][joint::LHAND].is_nan() && gap[30][joint::RHAND].is_finite());
    }
}
