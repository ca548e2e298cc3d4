//! Tables of other programs: Vicon Nexus, Qualisys 6D, NAME_x and names above x, y, z; and the way back, which keeps what did not change.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::io::marker_csv;
use posing_fuzz::{accepted, check_take, input, slow_input};

fuzz_target!(|bytes: &[u8]| {
    for keep_whole in [false, true] {
        let take = input("t.csv", bytes).and_then(|i| marker_csv::read(i, None, keep_whole));
        let Some(take) = accepted(take) else {
            continue;
        };
        check_take(&take);
        let columns = &take.carried;
        assert!(columns.names.is_empty() || columns.rows.len() <= take.xyz.nrows());
        let old = take.xyz.view();
        if bytes[..bytes.len().min(2)] != [0x1f, 0x8b] && bytes[..bytes.len().min(2)] != [0x28, 0xb5] {
            assert_eq!(take.cells.with_points(bytes, old, old), bytes);
        }
        take.cells.with_points(bytes, old, take.xyz.mapv(|v| v + 1.0).view());
        // A pipe gives the same.
        let slow = slow_input("t.csv", bytes).and_then(|i| marker_csv::read(i, None, keep_whole));
        let slow = accepted(slow).expect("what was read as a file is read from a pipe");
        assert_eq!((slow.points, slow.notes), (take.points, take.notes));
    }
});
