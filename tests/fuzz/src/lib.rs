//! What the targets share: an input of given bytes, what a refusal has to be, and a small skeleton.

use posing::io::{Asf, Input, MarkerTake};
use posing::{Error, Result};
use std::io::{Cursor, Read};

/// A skeleton for takes and sessions, smaller than that of a real subject.
pub const SKELETON: &str = include_str!("../seeds/asf/small.asf");

/// The bytes as a file of a name.
pub fn input(name: &str, bytes: &[u8]) -> Result<Input> {
    Input::new(name, Cursor::new(bytes.to_vec()))
}

/// The bytes as a pipe that gives a few at a time: records stand across its pieces.
pub fn slow_input(name: &str, bytes: &[u8]) -> Result<Input> {
    Input::new(name, Slow(Cursor::new(bytes.to_vec())))
}

struct Slow(Cursor<Vec<u8>>);

impl Read for Slow {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let few = out.len().min(7);
        self.0.read(&mut out[..few])
    }
}

/// What was read; a refusal has to be one line.
pub fn accepted<T>(result: Result<T>) -> Option<T> {
    result.inspect_err(check_message).ok()
}

/// A message has one line and no control characters, which a terminal would obey.
pub fn check_message(error: &Error) {
    check_line(&error.to_string());
}

/// So does a note.
pub fn check_line(said: &str) {
    assert!(!said.chars().any(char::is_control), "{said:?}");
    assert!(said.chars().count() < 1000, "{said:?}");
}

/// Parallel work runs in the calling thread: handing it to another takes longer than to read a small file.
pub fn use_one_thread() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    pool.use_current_thread()
        .build_global()
        .expect("the first pool");
}

/// What files of markers have in common.
pub fn check_take(take: &MarkerTake) {
    assert_eq!(take.xyz.ncols(), 3 * take.points.len());
    take.notes.iter().for_each(|note| check_line(note));
    take.points.iter().for_each(|point| check_line(point));
}

/// The skeleton of [`SKELETON`].
pub fn skeleton() -> Asf {
    input("small.asf", SKELETON.as_bytes())
        .and_then(|input| Asf::read(input, None))
        .expect("the small skeleton is sound")
}

/// Whether two numbers are equal, or both missing.
pub fn same(a: f64, b: f64) -> bool {
    a == b || a.is_nan() && b.is_nan()
}
