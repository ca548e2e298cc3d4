//! A cache by noise pattern. The frames of a take share a few patterns.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// Values by the bits of the variances. Clones share one cache.
pub struct NoiseCache<T>(Arc<Mutex<HashMap<Vec<u64>, Arc<T>>>>);

impl<T> NoiseCache<T> {
    /// The value of this noise pattern, made now unless it is cached. A full cache (`most`
    /// patterns) is emptied first. Callers share one value, so lazily computed parts of it are
    /// computed once.
    pub fn get(&self, noise: &[f64], most: usize, make: impl FnOnce() -> T) -> Arc<T> {
        let key: Vec<u64> = noise.iter().map(|n| n.to_bits()).collect();
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = lock().get(&key) {
            return found.clone();
        }
        // Without the lock: others need not wait for a pattern that is not theirs.
        let new = Arc::new(make());
        let mut made = lock();
        if made.len() >= most && !made.contains_key(&key) {
            made.clear();
        }
        made.entry(key).or_insert(new).clone()
    }
}

impl<T> Clone for NoiseCache<T> {
    fn clone(&self) -> Self {
        NoiseCache(self.0.clone())
    }
}

impl<T> Default for NoiseCache<T> {
    fn default() -> Self {
        NoiseCache(Arc::default())
    }
}

impl<T> fmt::Debug for NoiseCache<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("NoiseCache").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_is_made_once_until_there_are_too_many() {
        let cache = NoiseCache::default();
        let mut count = 0;
        let mut made = |noise: &[f64]| {
            *cache.get(noise, 2, || {
                count += 1;
                count
            })
        };
        let missing = [f64::INFINITY, 1.0];
        assert_eq!([made(&[0.0, 1.0]), made(&missing)], [1, 2]);
        assert_eq!([made(&[0.0, 1.0]), made(&missing)], [1, 2]);
        // The third is one too many: all is forgotten before it.
        assert_eq!([made(&[5.0, 1.0]), made(&missing)], [3, 4]);
        assert_eq!(made(&[0.0, 1.0]), 5);
    }

    #[test]
    fn clones_and_threads_share_one() {
        let cache = NoiseCache::default();
        let clone = cache.clone();
        let first = cache.get(&[1.0], 4, || 1);
        assert!(Arc::ptr_eq(&first, &clone.get(&[1.0], 4, || 2)));
        // Who is asked for it while it is made makes it too, and then all hold the first.
        let slow = cache.get(&[2.0], 4, || *clone.get(&[2.0], 4, || 3) + 1);
        assert_eq!((*slow, *cache.get(&[2.0], 4, || 9)), (3, 3));
    }
}
