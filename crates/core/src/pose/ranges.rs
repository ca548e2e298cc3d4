//! Frames on end as ranges.

use std::ops::{AddAssign, Range};

/// The frames in which something is so, in rising order, as ranges on end.
#[doc(hidden)]
pub fn ranges<T>(frames: impl IntoIterator<Item = T>) -> Vec<Range<T>>
where
    T: Copy + PartialEq + AddAssign + From<u8>,
{
    let mut out: Vec<Range<T>> = Vec::new();
    for t in frames {
        match out.last_mut().filter(|last| last.end == t) {
            Some(last) => last.end += T::from(1),
            None => {
                let mut end = t;
                end += T::from(1);
                out.push(t..end);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::ranges;

    #[test]
    fn frames_on_end_are_one_range() {
        assert_eq!(ranges([3usize, 4, 6, 8, 9, 10]), [3..5, 6..7, 8..11]);
        assert_eq!(ranges([-1isize, 0, 2]), [-1..1, 2..3]);
        assert_eq!(ranges::<usize>([]), []);
    }
}
