//! What a file is, told by its beginning: a message is one line, and a pipe gives the same bytes as a file.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::MotionFormat;
use posing::io::motion_format::recognized;
use posing_fuzz::{accepted, check_line, input, slow_input};

fuzz_target!(|bytes: &[u8]| {
    let Some(mut file) = accepted(input("t", bytes)) else {
        return;
    };
    accepted(file.look_ahead());
    let format = MotionFormat::of(file.first_bytes());
    check_line(format.name());
    recognized(file.first_bytes()).inspect(|what| check_line(what));
    let Some(mut pipe) = accepted(slow_input("t", bytes)) else {
        return;
    };
    accepted(pipe.look_ahead());
    assert_eq!(MotionFormat::of(pipe.first_bytes()), format);
    let (file, pipe) = (file.read_all(1 << 27), pipe.read_all(1 << 27));
    assert_eq!(accepted(file), accepted(pipe));
});
