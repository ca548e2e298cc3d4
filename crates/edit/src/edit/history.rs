//! Steps that can be undone and done again.

/// No more steps are kept.
const MOST: usize = 500;

/// The states before and after the present one, each with the name of the step between.
///
/// ```
/// use posing_edit::edit::History;
///
/// let mut history = History::default();
/// history.record("raise the arm", "arms down"); // the state before the step
/// assert_eq!(history.undo_step(), Some("raise the arm"));
/// assert_eq!(history.undo("arm raised"), Some("arms down"));
/// assert_eq!(history.redo("arms down"), Some("arm raised"));
/// ```
#[derive(Debug, Clone)]
pub struct History<T> {
    past: Vec<(String, T)>,
    future: Vec<(String, T)>,
}

impl<T> Default for History<T> {
    fn default() -> Self {
        History {
            past: Vec::new(),
            future: Vec::new(),
        }
    }
}

impl<T> History<T> {
    /// Records a step from the state `before`. What was undone cannot be done again.
    pub fn record(&mut self, step: impl Into<String>, before: T) {
        self.past.push((step.into(), before));
        if self.past.len() > MOST {
            self.past.remove(0);
        }
        self.future.clear();
    }

    /// The state before the last step, whose present state is `now`; `None` if there is none.
    pub fn undo(&mut self, now: T) -> Option<T> {
        let (step, before) = self.past.pop()?;
        self.future.push((step, now));
        Some(before)
    }

    /// The state after the step undone last.
    pub fn redo(&mut self, now: T) -> Option<T> {
        let (step, after) = self.future.pop()?;
        self.past.push((step, now));
        Some(after)
    }

    /// The name of the step that can be undone.
    pub fn undo_step(&self) -> Option<&str> {
        self.past.last().map(|s| s.0.as_str())
    }

    /// The name of the step that can be done again.
    pub fn redo_step(&self) -> Option<&str> {
        self.future.last().map(|s| s.0.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_undone_and_done_again() {
        let mut history = History::default();
        history.record("to 2", 1);
        history.record("to 3", 2);
        assert_eq!(history.undo_step(), Some("to 3"));
        assert_eq!(history.undo(3), Some(2));
        assert_eq!(history.undo(2), Some(1));
        assert_eq!(history.undo(1), None);
        assert_eq!(history.redo(1), Some(2));
        assert_eq!(history.redo_step(), Some("to 3"));
        history.record("elsewhere", 2);
        assert_eq!(history.redo(9), None);
        assert_eq!(history.undo(9), Some(2));
    }

    #[test]
    fn the_oldest_steps_are_forgotten() {
        let mut history = History::default();
        (0..MOST + 7).for_each(|i| history.record("", i));
        let mut now = 0;
        let mut steps = 0;
        while let Some(before) = history.undo(now) {
            (now, steps) = (before, steps + 1);
        }
        assert_eq!((now, steps), (7, MOST));
    }
}
