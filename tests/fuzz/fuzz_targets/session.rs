//! Sessions of posing by hand: one that opens is written, and opens again.
#![no_main]

use libfuzzer_sys::fuzz_target;
use posing::edit::{Rig, Session};
use posing::io::Model;
use posing_fuzz::{accepted, skeleton, use_one_thread};
use std::cell::RefCell;

const MODEL: &[u8] = include_bytes!("../seeds/model/gaussian.npz");

fn new_session() -> Session {
    let model = Model::from_bytes(MODEL, "the model").expect("the seed is sound");
    let rig = Rig::new(skeleton().skeleton, &model.meta.points).expect("a rig");
    Session::new(&model, "the model", rig).expect("a session")
}

thread_local! {
    static SESSION: RefCell<Session> = RefCell::new(new_session());
}

fuzz_target!(init: use_one_thread(), |bytes: &[u8]| {
    SESSION.with_borrow_mut(|session| {
        if accepted(session.open_json(bytes)).is_some() {
            let written = session.to_json();
            session.open_json(written.as_bytes()).expect("what was written opens");
        }
    });
});
