//! Key poses: what is fixed of a motion.

use super::pose_solver::Pose;
use std::sync::Arc;

/// Frames a second of a motion if nothing else is said.
pub(crate) const RATE: f64 = 30.0;

/// A pose at a time.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// Seconds; a whole number of frames.
    pub time: f64,
    /// The pose.
    pub pose: Pose,
    /// The coordinates at which each joint is pinned (K), cm.
    pub pins: Vec<[Option<f64>; 3]>,
}

/// Key poses in the order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Keys {
    /// Shared by the steps of undo that leave them as they are.
    keys: Arc<Vec<Key>>,
    rate: f64,
}

impl Default for Keys {
    fn default() -> Self {
        Keys {
            keys: Arc::default(),
            rate: RATE,
        }
    }
}

impl std::ops::Deref for Keys {
    type Target = [Key];
    fn deref(&self) -> &[Key] {
        &self.keys
    }
}

impl Keys {
    /// Frames a second.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Sets the frames a second; the keys move to the nearest frames, where two meet the earlier
    /// one is lost.
    pub fn set_rate(&mut self, rate: f64) {
        self.rate = rate;
        let keys = std::mem::take(&mut self.keys);
        for key in Arc::unwrap_or_clone(keys) {
            self.set(key);
        }
    }

    /// Sets a key at the frame nearest to its time; it replaces one that is there. Its index.
    pub fn set(&mut self, mut key: Key) -> usize {
        key.time = (key.time * self.rate).round() / self.rate;
        let keys = Arc::make_mut(&mut self.keys);
        let at = keys.partition_point(|k| k.time < key.time);
        match keys.get_mut(at).filter(|k| k.time == key.time) {
            Some(there) => *there = key,
            None => keys.insert(at, key),
        }
        at
    }

    /// Removes a key.
    ///
    /// # Panics
    /// There is no such key.
    pub fn remove(&mut self, index: usize) -> Key {
        Arc::make_mut(&mut self.keys).remove(index)
    }

    /// The key whose pose and pins these are.
    pub fn find(&self, pose: &Pose, pins: &[[Option<f64>; 3]]) -> Option<usize> {
        self.keys
            .iter()
            .position(|k| k.pose.q == pose.q && k.pins == pins)
    }
}
