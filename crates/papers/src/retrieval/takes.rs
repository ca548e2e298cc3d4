//! Takes with classes and subjects, divided into those that metrics learn from and those that they
//! are tested on.

use crate::metric::BodyFramePoses;
use crate::metric::blend_test::ClipRange;
use crate::metric::clip::Clip;

/// A take to learn from or to test on.
#[derive(Debug, Clone)]
pub struct ClassifiedTake {
    /// Its name.
    pub name: String,
    /// What is done in it.
    pub class: String,
    /// Who does it.
    pub subject: String,
}

/// Takes and their poses.
#[derive(Debug, Clone, Default)]
pub struct TakeSet {
    /// What each take is.
    pub about: Vec<ClassifiedTake>,
    /// Its poses in the body's frame.
    pub takes: Vec<BodyFramePoses>,
    /// Its joints in the world.
    pub clips: Vec<Clip>,
    /// What it does by itself.
    pub ranges: Vec<ClipRange>,
}

impl TakeSet {
    /// The take `k`, added to another set.
    fn copy_to(&self, k: usize, set: &mut TakeSet) {
        set.about.push(self.about[k].clone());
        set.takes.push(self.takes[k].clone());
        set.clips.push(self.clips[k].clone());
        set.ranges.push(self.ranges[k].clone());
    }

    /// The subjects, in the order of their first take.
    pub fn subjects(&self) -> Vec<String> {
        let mut subjects: Vec<String> = Vec::new();
        for about in &self.about {
            if !subjects.contains(&about.subject) {
                subjects.push(about.subject.clone());
            }
        }
        subjects
    }

    /// Takes of other subjects, to learn from, and takes of `tested`, to test on.
    pub(crate) fn split(&self, tested: &[String]) -> [TakeSet; 2] {
        let mut sets = [TakeSet::default(), TakeSet::default()];
        for k in 0..self.about.len() {
            let is_tested = tested.contains(&self.about[k].subject);
            self.copy_to(k, &mut sets[usize::from(is_tested)]);
        }
        sets
    }
}
