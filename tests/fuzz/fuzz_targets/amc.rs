//! AMC takes of a fixed skeleton: frames read one at a time are those that are read many at a time.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::Result;
use posing::io::amc::{AmcFrame, AmcFrames, AmcReader};
use posing::io::{Asf, Input};
use posing::pose::kinematics::Space;
use posing_fuzz::{accepted, input, skeleton, slow_input, use_one_thread};
use std::sync::LazyLock;

static ASF: LazyLock<Asf> = LazyLock::new(skeleton);

fuzz_target!(init: use_one_thread(), |bytes: &[u8]| {
    for keep_whole in [false, true] {
        let blocks = input("t.amc", bytes).and_then(|i| by_block(i, keep_whole));
        let single = slow_input("t.amc", bytes).and_then(|i| one_by_one(i, keep_whole));
        match (accepted(blocks), accepted(single)) {
            (Some(blocks), Some(single)) => {
                assert_eq!(blocks, single);
                let joints: Vec<usize> = (0..ASF.skeleton.bones().len()).collect();
                let _ = blocks.positions(&ASF.skeleton, &joints, Space::World);
            }
            (blocks, single) => assert_eq!(blocks.is_none(), single.is_none()),
        }
    }
});

fn by_block(input: Input, keep_whole: bool) -> Result<AmcFrames> {
    let mut reader = AmcReader::new(&ASF, input, keep_whole)?;
    let (mut all, mut block) = (AmcFrames::default(), AmcFrames::default());
    while reader.read_block(&mut block)? {
        all.numbers.append(&mut block.numbers);
        all.values.append(&mut block.values);
    }
    Ok(all)
}

fn one_by_one(input: Input, keep_whole: bool) -> Result<AmcFrames> {
    let mut reader = AmcReader::new(&ASF, input, keep_whole)?;
    let (mut all, mut frame) = (AmcFrames::default(), AmcFrame::default());
    while reader.read(&mut frame)? {
        all.numbers.push(frame.number);
        all.values.extend(&frame.values);
    }
    Ok(all)
}
