//! The page of `posing edit`, with real mouse, touch and key events.

use super::chromium::{NARROW, Page, Screen, Spot, WIDE};
use crate::common::edit_program::Server;
use crate::common::{run, take, text};
use serde_json::{Value, json};
use std::ops::Deref;

/// A program of its own, and its page.
struct Editor {
    server: Option<Server>,
    page: Page,
}

impl Deref for Editor {
    type Target = Page;
    fn deref(&self) -> &Page {
        &self.page
    }
}

impl Editor {
    fn new() -> Option<Editor> {
        Editor::on(WIDE)
    }

    fn on(screen: Screen) -> Option<Editor> {
        Editor::with(&[], screen)
    }

    fn with(flags: &[&str], screen: Screen) -> Option<Editor> {
        let server = Server::with(flags);
        let page = open(&server, screen)?;
        let server = Some(server);
        Some(Editor { server, page })
    }

    /// What the page knows.
    fn state(&self) -> Value {
        self.eval("posing.state()")
    }

    /// Waits until everything that was asked for is answered and drawn.
    fn settled(&self) {
        self.drawn();
        self.until("posing.inFlight() + posing.waiting() === 0");
        self.drawn();
    }

    /// Where a joint is drawn.
    fn place(&self, joint: &str) -> Spot {
        self.place_in(joint, false)
    }

    fn place_in(&self, joint: &str, second: bool) -> Spot {
        let place = self.eval(&format!("posing.place('{joint}', {second})"));
        serde_json::from_value(place).unwrap_or_else(|_| panic!("{joint} is not drawn"))
    }

    /// Where a place in space, or a pixel of the picture, is drawn.
    fn project(&self, place: &Value) -> Spot {
        serde_json::from_value(self.eval(&format!("posing.project({place})"))).unwrap()
    }

    /// Takes a joint so far with the mouse, and holds it there; where the mouse is then.
    fn pull(&self, joint: &str, [dx, dy]: Spot) -> Spot {
        let [x, y] = self.place(joint);
        let end = [x + dx, y + dy];
        self.press([x, y]);
        self.glide([x, y], end, 20);
        self.settled();
        end
    }

    fn let_fall(&self, at: Spot) {
        self.release(at);
        self.settled();
    }

    fn drag(&self, joint: &str, by: Spot) {
        let end = self.pull(joint, by);
        self.let_fall(end);
    }

    fn click_joint(&self, joint: &str) {
        self.click(self.place(joint));
        self.settled();
    }

    fn press_key(&self, key: &str) {
        self.key(key);
        self.settled();
    }

    fn push(&self, selector: &str) {
        self.click_on(selector);
        self.settled();
    }

    /// Nothing went wrong, and there was never more than one request at a time.
    fn sound(&self) {
        self.page.sound();
        assert_eq!(self.number("posing.most()"), 1.0);
    }

    /// From now on, the requests to a path wait so many milliseconds in the page.
    fn slow(&self, path: &str, ms: u32) {
        self.eval(&format!(
            "{{ const send = fetch.bind(window); window.fetch = async (to, options) => {{
               if (to === '{path}') await new Promise(done => setTimeout(done, {ms}));
               return send(to, options); }}; 1 }}"
        ));
    }

    /// Gives a picture of this size, in pixels, to the page.
    fn photograph(&self, width: u32, height: u32) {
        let png = self.eval(&format!(
            "(() => {{ const canvas = document.createElement('canvas'); [canvas.width, canvas.height] = [{width}, {height}];
               canvas.getContext('2d').fillRect(0, 0, {width}, {height}); return canvas.toDataURL('image/png').split(',')[1]; }})()"
        ));
        let file = tempfile::Builder::new().suffix(".png").tempfile().unwrap();
        use base64::prelude::{BASE64_STANDARD, Engine};
        let png = BASE64_STANDARD.decode(png.as_str().unwrap()).unwrap();
        std::fs::write(file.path(), png).unwrap();
        self.give("#photo-file", file.path());
        self.until("document.body.classList.contains('in-picture')");
        self.drawn();
    }
}

/// A page of the program.
fn open(server: &Server, screen: Screen) -> Option<Page> {
    let page = Page::open(&server.address(), screen)?;
    ready(&page);
    Some(page)
}

fn ready(page: &Page) {
    page.until("posing.state().joints.length > 0 && !!posing.place(posing.state().joints[0])");
}

/// Coordinates, such as those of a joint.
fn at(value: &Value) -> Vec<f64> {
    let numbers: Result<Vec<f64>, _> = serde_json::from_value(value.clone());
    numbers.unwrap_or_else(|_| panic!("no place: {value}"))
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// How far two places of a joint are apart.
fn moved(a: &Value, b: &Value) -> f64 {
    apart(&at(a), &at(b))
}

/// The farthest that a joint of one pose is from that of another.
fn farthest(a: &Value, b: &Value) -> f64 {
    let joints = a.as_object().unwrap().keys();
    joints.map(|j| moved(&a[j], &b[j])).fold(0.0, f64::max)
}

fn names(map: &Value) -> Vec<&String> {
    map.as_object().unwrap().keys().collect()
}

#[test]
fn a_dragged_joint_is_under_the_pointer_and_pins_stay_exactly() {
    let Some(page) = Editor::new() else { return };
    for foot in ["lfoot", "rfoot"] {
        page.click_joint(foot);
    }
    let start = page.state();
    let pins = &start["pins"];
    assert_eq!(names(pins), ["lfoot", "rfoot"]);
    let held = |now: &Value| {
        names(pins)
            .iter()
            .all(|j| moved(&now["pose"][j], &pins[j]) < 0.05)
    };
    let end = page.pull("lwrist", [50.0, -90.0]);
    let now = page.state();
    let dot = page.project(&now["moving"]["lwrist"]);
    assert!(
        apart(&dot, &end) < 1.0,
        "the dot is at {dot:?}, the pointer at {end:?}"
    );
    assert!(moved(&now["pose"]["lwrist"], &now["moving"]["lwrist"]) < 3.0);
    assert!(held(&now));
    page.let_fall(end);
    let now = page.state();
    assert!(moved(&now["pose"]["lwrist"], &start["pose"]["lwrist"]) > 10.0);
    assert!(held(&now) && !now["undo"].is_null());
    page.sound();
}

#[test]
fn the_dot_does_not_wait_for_the_program() {
    let Some(page) = Editor::new() else { return };
    page.slow("/solve", 400);
    let [x, y] = page.place("rwrist");
    page.press([x, y]);
    page.glide([x, y], [x - 40.0, y - 60.0], 12);
    page.drawn();
    let dot = page.project(&page.state()["moving"]["rwrist"]);
    assert!(apart(&dot, &[x - 40.0, y - 60.0]) < 1.0);
    assert!(
        page.holds("posing.waiting() <= 1"),
        "the newest waiting request takes the place of the others"
    );
    let target = page.state()["moving"]["rwrist"].clone();
    page.let_fall([x - 40.0, y - 60.0]);
    assert!(
        moved(&page.state()["pose"]["rwrist"], &target) < 3.0,
        "the last place counts"
    );
    page.sound();
}

#[test]
fn the_dot_is_drawn_in_the_next_frame() {
    let Some(page) = Editor::new() else { return };
    page.eval(&format!("({WATCH_FRAMES})('lwrist')"));
    let ([x, y], moves) = (page.place("lwrist"), 60);
    page.press([x, y]);
    // On an arc that never comes back; sent whether or not the one before is handled.
    for i in 1..=moves {
        let turn = f64::from(i) / f64::from(moves) * 2.0;
        let spot = [x + 70.0 * turn.sin(), y - 70.0 * (1.0 - turn.cos())];
        page.move_unseen(spot);
        std::thread::sleep(std::time::Duration::from_millis(16));
    }
    page.settled();
    let seen = page.eval("watched");
    page.let_fall([x, y]);
    let list = |what: &str| seen[what].as_array().unwrap();
    let (events, draws) = (list("events"), list("draws"));
    assert!(!events.is_empty());
    for (i, event) in events.iter().enumerate() {
        let number = |value: &Value| value.as_u64().unwrap() as usize;
        let next = draws.iter().find(|d| number(&d["events"]) > i).unwrap();
        let pointer = &events[number(&next["events"]) - 1];
        assert_eq!(number(&next["frame"]), number(&event["frame"]) + 1);
        assert!(
            moved(&next["dot"], &pointer["at"]) < 1.0,
            "{next} {pointer}"
        );
        // A body that knows this place or a newer one is drawn later.
        let knows = |d: &&Value| {
            seen["answers"][d["revision"].to_string()]
                .as_u64()
                .is_some_and(|a| a as usize >= i)
        };
        assert!(
            draws.iter().any(|d| knows(&d)),
            "event {i} of {} has no answer",
            events.len()
        );
    }
    page.sound();
}

/// Notes each move of the pointer, each answer, and what each frame draws; `frame` counts frames
/// that have begun.
const WATCH_FRAMES: &str = "joint => {
  const events = [], draws = [], answers = {}, next = requestAnimationFrame.bind(window), send = fetch.bind(window);
  let frame = 0, last = -1;
  const begin = time => { if (time !== last) { last = time; frame++; } };
  const tick = time => { begin(time); next(tick); };
  next(tick);
  window.watched = { events, draws, answers };
  addEventListener('pointermove', ({ clientX, clientY }) => {
    const { moving } = posing.state();
    if (moving) events.push({ frame, at: [clientX, clientY], target: moving[joint].join() });
  });
  window.requestAnimationFrame = draw => next(time => {
    begin(time);
    draw(time);
    const { moving, revision } = posing.state();
    if (moving) draws.push({ frame, events: events.length, revision, dot: posing.project(moving[joint]) });
  });
  window.fetch = async (path, options) => {
    const answer = await send(path, options), drag = path === '/solve' && JSON.parse(options.body).drags[joint];
    if (!drag) return answer;
    const event = events.findLastIndex(one => one.target === drag.xyz.join()), text = await answer.text();
    answers[JSON.parse(text).revision] = event;
    return { ok: answer.ok, text: async () => text };
  };
}";

#[test]
fn depth_by_shift_and_by_the_wheel_fine_by_ctrl_escape_cancels() {
    let Some(page) = Editor::new() else { return };
    let before = page.state();
    let wrist = || page.state()["moving"]["rwrist"].clone();
    let [x, y] = page.place("rwrist");
    page.press([x, y]);
    page.hold("Shift");
    page.glide([x, y], [x, y + 60.0], 6);
    page.let_go();
    let still = wrist();
    assert!(
        apart(&page.project(&still), &[x, y]) < 1.0,
        "in depth, the dot stays where it is in the view"
    );
    assert!(moved(&still, &before["pose"]["rwrist"]) > 5.0);
    page.wheel([x, y + 60.0], 300.0);
    page.until(&format!(
        "Math.hypot(...posing.state().moving.rwrist.map((v, c) => v - {still}[c])) > 2"
    ));
    page.hold("Control");
    let from = page.project(&wrist());
    page.glide([x, y + 60.0], [x + 50.0, y + 60.0], 5);
    let far = apart(&page.project(&wrist()), &from);
    assert!(
        (far - 10.0).abs() < 1.0,
        "a fifth of 50 pixels, and not {far}"
    );
    page.let_go();
    page.press_key("Escape");
    page.let_fall([x + 50.0, y + 60.0]);
    let now = page.state();
    assert!(now["moving"].is_null());
    assert!(farthest(&before["pose"], &now["pose"]) < 0.01);
    assert_eq!(now["undo"], before["undo"]);
    page.sound();
}

#[test]
fn joints_of_the_second_view_are_dragged_in_its_own_plane() {
    let Some(page) = Editor::new() else { return };
    let (before, [x, y], large) = (
        page.state(),
        page.place_in("rwrist", true),
        page.place("rwrist"),
    );
    page.press([x, y]);
    page.glide([x, y], [x + 12.0, y], 6);
    page.settled();
    let target = page.state()["moving"]["rwrist"].clone();
    assert!(moved(&target, &before["pose"]["rwrist"]) > 3.0);
    assert!(
        apart(&page.project(&target), &large) < 12.0,
        "in the large view, that is depth"
    );
    page.let_fall([x + 12.0, y]);
    page.sound();
}

#[test]
fn a_joint_goes_straight_up_and_level_when_it_is_seen_from_above() {
    let Some(page) = Editor::new() else { return };
    let before = at(&page.state()["pose"]["lwrist"]);
    let end = page.pull("lwrist", [0.0, -120.0]);
    let now = at(&page.state()["moving"]["lwrist"]);
    // The view looks from 25 degrees to the left of the front.
    let (sin, cos) = 25f64.to_radians().sin_cos();
    let toward = (now[0] - before[0]) * sin + (now[2] - before[2]) * cos;
    assert!(now[1] - before[1] > 20.0);
    assert!(toward.abs() < 0.01, "{toward} cm in depth");
    page.let_fall(end);
    page.press_key("Control+z");
    (0..12).for_each(|_| page.key("w"));
    page.drawn();
    let end = page.pull("lwrist", [20.0, 40.0]);
    let now = at(&page.state()["moving"]["lwrist"]);
    assert!((now[1] - before[1]).abs() < 0.01 && apart(&now, &before) > 5.0);
    page.let_fall(end);
    page.sound();
}

#[test]
fn pins_by_click_of_axes_of_both_feet_and_a_pinned_joint_takes_its_pin_along() {
    let Some(page) = Editor::new() else { return };
    page.click_joint("rwrist");
    assert!(!page.state()["pins"]["rwrist"].is_null());
    page.drag("rwrist", [-30.0, -30.0]);
    let now = page.state();
    assert!(
        moved(&now["pins"]["rwrist"], &now["pose"]["rwrist"]) < 0.05,
        "the pin is where the joint is"
    );
    page.click_joint("rwrist");
    assert!(page.state()["pins"]["rwrist"].is_null());
    page.push("#pin-y");
    let pin = page.state()["pins"]["rwrist"].clone();
    assert!(pin[0].is_null() && pin[2].is_null());
    page.drag("rwrist", [-30.0, -30.0]);
    let high = page.state()["pose"]["rwrist"][1].as_f64().unwrap();
    assert!(
        (high - pin[1].as_f64().unwrap()).abs() < 0.05,
        "a pinned height stays"
    );
    page.push("#unpin");
    page.push("#pin-feet");
    let feet = page.state()["pins"].clone();
    for name in ["lfoot", "ltibia", "rfoot", "rtibia"] {
        assert!(!feet[name].is_null(), "ankles, too");
    }
    let count = names(&feet).len();
    assert_eq!(page.text("#unpin"), format!("Unpin all ({count})"));
    // Both sides together.
    page.key("b");
    page.click_joint("lradius");
    let pins = page.state()["pins"].clone();
    assert!(!pins["lradius"].is_null() && !pins["rradius"].is_null());
    page.click_joint("rradius");
    assert_eq!(names(&page.state()["pins"]), names(&feet));
    page.sound();
}

#[test]
fn a_dragged_foot_takes_its_pins_along() {
    let Some(page) = Editor::new() else { return };
    page.push("#pin-feet");
    let before = page.state();
    page.drag("lfoot", [30.0, -50.0]);
    let now = page.state();
    assert_eq!(names(&now["pins"]), names(&before["pins"]));
    let by = |joint: &str, state: &Value, what: &str| -> Vec<f64> {
        let (a, b) = (at(&before["pins"][joint]), at(&state[what][joint]));
        a.iter().zip(b).map(|(a, b)| b - a).collect()
    };
    let way = by("lfoot", &now, "pins");
    assert!(apart(&way, &[0.0; 3]) > 8.0, "{way:?}");
    for joint in names(&before["pins"]) {
        let goal = if joint.starts_with('l') {
            &way[..]
        } else {
            &[0.0; 3]
        };
        for what in ["pins", "pose"] {
            let gone = by(joint, &now, what);
            assert!(
                apart(&gone, goal) < 0.05,
                "{joint}: {what} by {gone:?}, not {goal:?}"
            );
        }
    }
    assert_eq!(names(&now["missed"]).len(), 0);
    // Not through the floor.
    page.drag("ltibia", [0.0, 200.0]);
    let now = page.state();
    for joint in names(&now["pins"]) {
        assert!(now["pins"][joint][1].as_f64().unwrap() > -0.01, "{joint}");
    }
    page.sound();
}

#[test]
fn joints_may_have_any_name() {
    let folder = tempfile::tempdir().unwrap();
    let (rig, map) = (
        folder.path().join("rig.bvh"),
        folder.path().join("map.toml"),
    );
    let mut bvh = run("xyz2bvh", &[], &take("07", "07_01", &[]).unwrap());
    let mut lines = String::new();
    let odd = [
        ("lwrist", "constructor"),
        ("rwrist", "toString"),
        ("ltibia", "hasOwnProperty"),
        ("lowerneck", "valueOf"),
        ("lowerback", "__proto__"),
    ];
    for (joint, name) in odd {
        bvh = bvh.replace(&format!("JOINT {joint}\n"), &format!("JOINT {name}\n"));
        lines += &format!("{joint} = \"{name}\"\n");
    }
    assert!(bvh.contains("JOINT __proto__"));
    std::fs::write(&rig, bvh).unwrap();
    std::fs::write(&map, lines).unwrap();
    let Some(page) = Editor::with(&["--skeleton", text(&rig), "--map", text(&map)], WIDE) else {
        return;
    };
    for name in ["constructor", "__proto__"] {
        let before = page.state();
        page.drag(name, [40.0, -40.0]);
        assert!(
            moved(&page.state()["pose"][name], &before["pose"][name]) > 2.0,
            "{name}"
        );
        page.choose("#joint", name);
        page.push("#pin");
        assert_eq!(names(&page.state()["pins"]), [name]);
        page.push("#unpin");
        assert_eq!(names(&page.state()["pins"]).len(), 0);
    }
    page.push("#table-part summary");
    page.drag("root", [10.0, 0.0]);
    page.press_key("k");
    page.drag("toString", [-30.0, -40.0]);
    page.press_key("k");
    page.push("#play");
    page.until("posing.state().playing");
    page.sound();
}

#[test]
fn commands_in_quick_succession_are_done_in_order() {
    let Some(page) = Editor::new() else { return };
    let first = page.state();
    page.drag("root", [0.0, 60.0]);
    assert!(farthest(&page.state()["pose"], &first["pose"]) > 0.5);
    // As slow as a program on a busy machine.
    page.slow("/act", 150);
    for key in ["Control+z", "Shift+P", "Control+z", "Shift+P"] {
        page.key(key);
    }
    page.settled();
    let now = page.state();
    assert!(farthest(&now["pose"], &first["pose"]) < 0.01);
    assert!(!now["pins"]["lfoot"].is_null() && !now["pins"]["rtibia"].is_null());
    for name in names(&now["pins"]) {
        let far = moved(&now["pins"][name], &first["pose"][name]);
        assert!(
            far < 0.01,
            "{name} is pinned where it is after the step back"
        );
    }
    // A joint that is caught meanwhile follows when the answer is there, with the pins of then.
    page.key("Shift+P");
    page.drag("lwrist", [40.0, -40.0]);
    let after = page.state();
    assert_eq!(after["pins"], json!({}));
    assert!(moved(&after["pose"]["lwrist"], &first["pose"]["lwrist"]) > 5.0);
    page.sound();
}

#[test]
fn what_is_out_of_reach_says_by_how_much() {
    let Some(page) = Editor::new() else { return };
    page.push("#pin-feet");
    let end = page.pull("rwrist", [-600.0, -300.0]);
    let missed = page.state()["missed"]["rwrist"].as_f64().unwrap();
    assert!(missed > 5.0, "{missed}");
    let said = page.text("#warning");
    assert!(
        said.contains("right hand cannot reach its place (") && said.contains(" cm away)"),
        "{said}"
    );
    let [left, top, width, height] = page.area("#warning");
    for joint in ["rwrist", "rradius", "head", "lfoot", "rfoot"] {
        let [x, y] = page.place(joint);
        let under = (left..left + width).contains(&x) && (top..top + height).contains(&y);
        assert!(!under, "{joint} is under the warning");
    }
    page.let_fall(end);
    // After the drag, there is no place to reach.
    page.until("!/right hand/.test(document.querySelector('#warning').textContent)");
    page.sound();
}

#[test]
fn a_wide_tolerance_lets_a_dragged_joint_stay_away_from_the_pointer() {
    let Some(page) = Editor::new() else { return };
    let away = || {
        let end = page.pull("lwrist", [60.0, -120.0]);
        let now = page.state();
        assert!(!page.text("#warning").contains("reach"));
        page.let_fall(end);
        page.press_key("Control+z");
        moved(&now["pose"]["lwrist"], &now["moving"]["lwrist"])
    };
    let near = away();
    page.choose("#tolerance", "1.3");
    assert_eq!(page.text("#tolerance-words"), "20 cm");
    let far = away();
    assert!(near < 3.0 && far > near + 3.0, "{near} and {far} cm");
    page.choose("#tolerance", "-0.3");
    assert_eq!(page.text("#tolerance-words"), "0.5 cm");
    assert!(
        page.holds(
            "document.querySelector('#tolerance').style.getPropertyValue('--done') === '0%'"
        )
    );
    page.sound();
}

#[test]
fn whole_gestures_are_undone_and_done_again() {
    let Some(page) = Editor::new() else { return };
    let first = page.state();
    page.drag("lwrist", [60.0, -60.0]);
    let second = page.state();
    page.drag("head", [25.0, 10.0]);
    let third = page.state();
    let is_at = |state: &Value| assert!(farthest(&page.state()["pose"], &state["pose"]) < 0.01);
    page.press_key("Control+z");
    is_at(&second);
    page.push("#undo");
    is_at(&first);
    page.press_key("Shift+Control+z");
    is_at(&second);
    page.push("#redo");
    is_at(&third);
    assert!(page.state()["redo"].is_null());
    page.sound();
}

#[test]
fn other_poses_are_shown_first_then_taken_or_left() {
    let Some(page) = Editor::new() else { return };
    page.push("#pin-feet");
    page.drag("lwrist", [40.0, -70.0]);
    let before = page.state();
    page.press_key("n");
    if page.holds("!document.querySelector('#notice').hidden") {
        assert!(page.text("#notice").contains("No other pose"));
        return;
    }
    let now = page.state();
    assert_eq!(now["other"], 0);
    assert!(farthest(&now["pose"], &before["pose"]) < 0.01, "shown only");
    page.key("Escape");
    assert_eq!(page.state()["other"], -1);
    page.press_key("n");
    page.press_key("Enter");
    assert!(farthest(&page.state()["pose"], &before["pose"]) > 4.9);
    // By the button, which has the focus then.
    page.push("#others");
    if page.state()["other"] == 0 {
        page.key("Escape");
        assert_eq!(page.state()["other"], -1);
    }
    page.sound();
}

#[test]
fn mirror_both_sides_together_and_a_limb_that_is_reset() {
    let Some(page) = Editor::new() else { return };
    page.key("b");
    let before = page.state();
    page.drag("lwrist", [40.0, -60.0]);
    let now = page.state();
    for wrist in ["lwrist", "rwrist"] {
        assert!(moved(&now["pose"][wrist], &before["pose"][wrist]) > 5.0);
    }
    page.key("b");
    page.drag("lwrist", [30.0, -30.0]);
    let lopsided = page.state();
    page.press_key("m");
    let mirrored = page.state();
    let high =
        |state: &Value, wrist: &str| at(&state["pose"][wrist])[1] - at(&state["pose"]["root"])[1];
    let (is, was) = (high(&mirrored, "rwrist"), high(&lopsided, "lwrist"));
    assert!((is - was).abs() < 2.0, "{is} {was}");
    page.choose("#joint", "rhumerus");
    page.push("#reset-limb");
    assert!(!page.state()["undo"].is_null());
    page.sound();
}

#[test]
fn a_pose_from_a_photograph() {
    let Some(page) = Editor::new() else { return };
    let pose = page.state()["pose"].clone();
    // A photograph of the present pose from the front, 3 pixels a centimeter; only its marks
    // matter.
    let joints = [
        "lhipjoint",
        "rhipjoint",
        "lclavicle",
        "rclavicle",
        "lfemur",
        "rfemur",
        "lhumerus",
        "rhumerus",
        "ltibia",
        "rtibia",
        "lradius",
        "rradius",
        "head",
    ];
    page.photograph(600, 800);
    assert!(page.text("#photo-state").contains("at least 4"));
    let root = at(&pose["root"]);
    for name in joints {
        let asked = page.eval("document.querySelector('#marks [aria-pressed=true]').title");
        assert_eq!(asked, name, "asked for in turn");
        let place = at(&pose[name]);
        let pixel = json!([
            300.0 + 3.0 * (place[0] - root[0]),
            400.0 - 3.0 * (place[1] - root[1])
        ]);
        page.click(page.project(&pixel));
        page.settled();
    }
    let fitted = page.state();
    assert_eq!(names(&fitted["marks"]).len(), joints.len());
    let said = page.text("#photo-state");
    assert!(
        said.contains("The fit is ") && said.contains(" px off)"),
        "{said}"
    );
    for name in joints {
        assert!(
            moved(&fitted["picture"][name], &fitted["marks"][name]) < 25.0,
            "{name}"
        );
    }
    // Another mark by dragging a joint of the fitted body; then it is removed.
    let [x, y] = page.project(&fitted["picture"]["upperback"]);
    page.press([x, y]);
    page.glide([x, y], [x + 12.0, y], 6);
    page.let_fall([x + 12.0, y]);
    assert!(!page.state()["marks"]["upperback"].is_null());
    page.press_key("Delete");
    assert!(page.state()["marks"]["upperback"].is_null());
    page.click_on("#marks [data-joint=lradius]");
    page.push("#photo-flip");
    let said = page.text("#notice");
    assert!(said.contains("The person's left arm now bends "), "{said}");
    page.choose("#focal", "50");
    page.settled();
    page.push("#photo-use");
    let used = page.state();
    assert!(!used["undo"].is_null());
    page.push("#photo-back");
    page.push("#photo-leave");
    assert!(
        farthest(&page.state()["pose"], &used["pose"]) < 0.01,
        "left as it was"
    );
    page.sound();
}

#[test]
fn a_photograph_without_enough_marks_gives_no_pose() {
    let Some(page) = Editor::new() else { return };
    // The start poses begin with one of each kind.
    let starts = page.eval("[...document.querySelectorAll('#starts button')].map(b => b.textContent.replace(/ [0-9]+$/, ''))");
    let starts: Vec<String> = serde_json::from_value(starts).unwrap();
    let first: std::collections::BTreeSet<&String> = starts.iter().take(4).collect();
    assert_eq!(first.len(), 4, "{starts:?}");
    page.photograph(300, 150);
    assert!(
        page.text("#guide")
            .contains("left hip in the picture: on your right")
    );
    for pixel in [[170, 80], [130, 80], [175, 30], [125, 30]] {
        page.click(page.project(&json!(pixel)));
        page.settled();
    }
    let can_be_used = || page.holds("!document.querySelector('#photo-use').disabled");
    assert!(can_be_used());
    page.press_key("Control+z");
    assert!(!can_be_used());
    assert!(page.state()["picture"].is_null());
    page.push("#photo-leave");
    page.sound();
}

#[test]
fn keys_the_motion_between_them_and_play() {
    let Some(page) = Editor::new() else { return };
    let high = || page.number("document.querySelector('.timeline').clientHeight");
    let empty = high();
    page.press_key("k");
    page.drag("lwrist", [50.0, -80.0]);
    page.press_key("k");
    let keys = page.state()["keys"].clone();
    let times: Vec<&Value> = keys
        .as_array()
        .unwrap()
        .iter()
        .map(|k| &k["time"])
        .collect();
    assert_eq!(
        times,
        [&json!(0), &json!(0.5)],
        "the second key comes after the first"
    );
    // In between, the hand is in between.
    page.fill("#time", "0.25");
    page.key("Tab");
    page.until("posing.state().shown.lwrist[1] !== posing.state().pose.lwrist[1]");
    let wrist = |key: usize| at(&keys[key]["pose"]["lwrist"])[1];
    let shown = at(&page.state()["shown"]["lwrist"])[1];
    assert!(shown > wrist(0).min(wrist(1)) && shown < wrist(0).max(wrist(1)));
    page.push("#play");
    let frames = page.number("posing.frames()");
    page.until(&format!(
        "posing.state().playing && posing.frames() > {frames} + 8"
    ));
    page.push("#play");
    page.key("Escape");
    // A card is dragged in time, opened, removed.
    let [x, y] = page.middle("#cards button:nth-child(2)");
    page.press([x, y]);
    page.glide([x, y], [x + 150.0, y], 10);
    page.let_fall([x + 150.0, y]);
    let time = page.state()["keys"][1]["time"].as_f64().unwrap();
    assert!(time > 0.6, "moved to {time}");
    page.push("#cards button:nth-child(1)");
    let now = page.state();
    assert_eq!(now["key"], 0);
    assert!(farthest(&now["pose"], &keys[0]["pose"]) < 0.01);
    assert_eq!(high(), empty, "the first key moves nothing");
    // A second Delete does not take the next key.
    page.focus("#cards button");
    page.key("Delete");
    page.press_key("Delete");
    page.press_key("Delete");
    assert_eq!(page.state()["keys"].as_array().unwrap().len(), 1);
    page.sound();
}

#[test]
fn what_is_saved_can_be_read_and_a_session_opens_again() {
    let Some(page) = Editor::new() else { return };
    page.press_key("k");
    page.drag("rwrist", [-50.0, -80.0]);
    page.press_key("k");
    let before = page.state();
    let saved = |button: &str, name: &str| {
        page.push("#save");
        page.click_on(button);
        let text = page.saved(name);
        page.until("!document.querySelector('#files').matches(':popover-open')");
        text
    };
    let frames = |bvh: &str| -> usize {
        assert!(bvh.starts_with("HIERARCHY") && bvh.contains("ROOT ") && bvh.contains("MOTION"));
        let count = bvh.split("Frames:").nth(1).unwrap();
        count.split_whitespace().next().unwrap().parse().unwrap()
    };
    assert_eq!(
        frames(&saved("#save-pose [data-format=bvh]", "pose.bvh")),
        1
    );
    assert!(frames(&saved("#save-motion [data-format=bvh]", "pose-motion.bvh")) > 10);
    let csv = crate::common::Numbers::read(&saved("#save-pose [data-format=csv]", "pose.csv"));
    let wrist = csv.points.iter().position(|p| p == "rwrist").unwrap();
    let (at_file, at_page) = (
        &csv.rows[0][3 * wrist..3 * wrist + 3],
        at(&before["pose"]["rwrist"]),
    );
    assert!(apart(at_file, &at_page) < 0.1);
    let csv = saved("#save-motion [data-format=csv]", "pose-motion.csv");
    assert!(csv.lines().count() > 10);
    let session = saved("#save-session", "pose.json");
    page.push("#starts button:nth-child(2)");
    assert!(farthest(&page.state()["pose"], &before["pose"]) > 1.0);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("session.json");
    std::fs::write(&file, session).unwrap();
    page.give("#session-file", &file);
    page.until("/Opened/.test(document.querySelector('#notice').textContent)");
    let back = page.state();
    assert!(farthest(&back["pose"], &before["pose"]) < 0.01);
    assert_eq!(back["keys"].as_array().unwrap().len(), 2);
    page.sound();
}

#[test]
fn a_large_session_that_was_saved_opens_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("many.json");
    let Some(page) = Editor::with(&["--session", text(&file)], WIDE) else {
        return;
    };
    page.press_key("k");
    let mut session: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    let key = session["keys"][0].clone();
    let keys = (0..400).map(|i| {
        let mut key = key.clone();
        key["time"] = json!(f64::from(i) / 30.0);
        key
    });
    session["keys"] = keys.collect();
    let many = folder.path().join("400.json");
    std::fs::write(&many, session.to_string()).unwrap();
    assert!(many.metadata().unwrap().len() > 1 << 20);
    page.give("#session-file", &many);
    page.until("posing.state().keys.length === 400");
    page.sound();
}

#[test]
fn by_keys_alone() {
    let Some(page) = Editor::new() else { return };
    let selected = || page.state()["selected"].clone();
    page.focus("#big");
    page.key("Tab");
    assert_eq!(selected(), page.state()["joints"][0]);
    for _ in 0..30 {
        if selected() == "lwrist" {
            break;
        }
        page.key("Tab");
    }
    assert_eq!(selected(), "lwrist");
    let before = at(&page.state()["pose"]["lwrist"]);
    (0..3).for_each(|_| page.key("ArrowUp"));
    page.key("Shift+ArrowUp");
    let rests = "posing.state().moving === null && posing.inFlight() + posing.waiting() === 0";
    page.until(rests);
    page.settled();
    let up = at(&page.state()["pose"]["lwrist"])[1] - before[1];
    assert!((up - 13.0).abs() < 0.5, "{up} cm up");
    let said = page.text("#spoken");
    assert!(
        said.contains("left hand 1") && said.contains(" cm up"),
        "{said}"
    );
    page.press_key("p");
    assert!(!page.state()["pins"]["lwrist"].is_null());
    assert!(page.text("#spoken").contains("left hand pinned"));
    page.key("Alt+ArrowUp");
    page.until(rests);
    page.press_key("Control+z");
    page.key("?");
    assert!(page.holds("document.querySelector('#keys-help').open"));
    page.key("Escape");
    page.until("!document.querySelector('#keys-help').open");
    // A typed number.
    page.fill("#at-y", "100");
    page.key("Enter");
    page.until(
        "Math.abs(posing.state().pose.lwrist[1] - 100) < 2 && posing.state().moving === null",
    );
    page.settled();
    // The first joint again, and out of the view.
    page.focus("#big");
    (0..40).for_each(|_| page.key("Tab"));
    assert!(
        page.holds("document.activeElement.id !== 'big'"),
        "Tab is no trap"
    );
    page.sound();
}

#[test]
fn one_finger_drags_a_long_press_pins_and_two_fingers_zoom() {
    let Some(page) = Editor::on(NARROW) else {
        return;
    };
    let before = page.state();
    let [x, y] = page.place("lwrist");
    page.touch("touchStart", &[[x + 8.0, y]]);
    for i in 1..=10 {
        page.touch(
            "touchMove",
            &[[x + 8.0 + 3.0 * f64::from(i), y - 5.0 * f64::from(i)]],
        );
    }
    page.settled();
    let dot = page.project(&page.state()["moving"]["lwrist"]);
    assert!(apart(&dot, &[x + 38.0, y - 50.0]) < 1.5, "{dot:?}");
    page.touch("touchEnd", &[]);
    page.settled();
    assert!(moved(&page.state()["pose"]["lwrist"], &before["pose"]["lwrist"]) > 5.0);
    page.touch("touchStart", &[page.place("rwrist")]);
    page.until("posing.state().pins.rwrist");
    page.touch("touchEnd", &[]);
    page.settled();
    let wide = || apart(&page.place("lfoot"), &page.place("head"));
    let was = wide();
    page.touch("touchStart", &[[60.0, 200.0]]);
    page.touch("touchStart", &[[60.0, 200.0], [120.0, 200.0]]);
    for i in 1..=10 {
        let i = f64::from(i);
        page.touch(
            "touchMove",
            &[[60.0 - 2.0 * i, 200.0], [120.0 + 4.0 * i, 200.0]],
        );
    }
    page.touch("touchEnd", &[]);
    page.drawn();
    assert!(wide() > 1.3 * was, "two fingers zoom");
    page.sound();
}

#[test]
fn of_two_tabs_each_takes_what_the_other_has_changed() {
    let Some(one) = Editor::new() else { return };
    let two = Editor {
        page: open(one.server.as_ref().unwrap(), WIDE).unwrap(),
        server: None,
    };
    for (tab, other, wrist) in [(&one, &two, "lwrist"), (&two, &one, "rwrist")] {
        tab.drag(wrist, [40.0, -60.0]);
        let place = &tab.state()["pose"][wrist];
        other.until(&format!(
            "Math.hypot(...posing.state().pose.{wrist}.map((v, c) => v - {place}[c])) < .01"
        ));
    }
    one.sound();
    two.sound();
}

#[test]
fn the_page_goes_on_when_the_program_is_started_again() {
    let Some(mut page) = Editor::new() else {
        return;
    };
    page.drag("lwrist", [40.0, -70.0]);
    page.click_joint("lfoot");
    let pose = page.state()["pose"].clone();
    // A moment after the last change, what is kept has it.
    page.until("JSON.parse(posing.state().kept || '{}').pins?.some(pin => pin[0] !== null)");
    let first = page.server.take().unwrap();
    let port = first.port.to_string();
    first.stop();
    page.until("/has stopped/.test(document.querySelector('#banner').textContent) && !document.querySelector('#banner').hidden");
    // The view still turns.
    let was = page.place("lwrist");
    page.press([200.0, 300.0]);
    page.glide([200.0, 300.0], [300.0, 300.0], 5);
    page.release([300.0, 300.0]);
    page.drawn();
    assert!(apart(&page.place("lwrist"), &was) > 3.0);
    // A joint does not, and nothing else of it.
    let still = page.place("lwrist");
    page.press(still);
    page.glide(still, [still[0] + 80.0, still[1]], 5);
    page.release([still[0] + 80.0, still[1]]);
    page.drawn();
    assert!(apart(&page.place("lwrist"), &still) < 0.1);
    page.click_on("#save");
    page.click_on("#save-session");
    assert!(page.text("#notice").contains("has stopped"));
    page.key("Escape");
    page.server = Some(Server::with(&["--port", &port]));
    let token = page.server.as_ref().unwrap().token.clone();
    page.eval(&format!("location.hash = 'token={token}'"));
    page.until("posing.state().way === 'fine' && document.querySelector('#banner').hidden");
    page.settled();
    assert!(
        farthest(&page.state()["pose"], &pose) < 0.05,
        "the pose of before"
    );
    assert!(!page.state()["pins"]["lfoot"].is_null());
    page.drag("rwrist", [-30.0, -40.0]);
    assert!(
        moved(&page.state()["pose"]["rwrist"], &pose["rwrist"]) > 2.0,
        "and it goes on"
    );
    page.sound_but(&[
        "ERR_CONNECTION_REFUSED",
        "ERR_EMPTY_RESPONSE",
        "ERR_CONNECTION_RESET",
        "401",
        "403",
    ]);
}

#[test]
fn an_address_without_its_token_says_so() {
    let server = Server::new();
    let address = server.address();
    let Some(page) = Page::open(address.split('#').next().unwrap(), WIDE) else {
        return;
    };
    page.until("/not complete/.test(document.querySelector('#banner').textContent)");
    page.sound();
}

#[test]
fn all_is_seen_and_large_enough_on_each_screen() {
    let Some(first) = Editor::new() else { return };
    let server = first.server.as_ref().unwrap();
    for size in [WIDE.size, NARROW.size] {
        for dark in [false, true] {
            let screen = Screen {
                size,
                dark,
                touch: false,
            };
            let page = open(server, screen).unwrap();
            for canvas in ["#big", "#small", "#starts button canvas", "#ruler"] {
                assert!(page.look(canvas).ink > 0.01, "{canvas}");
            }
            let wider =
                "document.documentElement.scrollWidth > document.documentElement.clientWidth";
            assert!(!page.holds(wider), "{screen:?}");
            page.click_on("#table-part summary");
            assert!(!page.holds(wider), "{screen:?}, with the table");
            page.eval("scrollTo(0, 0)");
            page.shot(&format!(
                "edit-{}-{}",
                size[0],
                if dark { "dark" } else { "light" }
            ));
            if size == NARROW.size {
                let low = "[...document.querySelectorAll('button, select, input[type=number]')].filter(n => n.checkVisibility())
                    .map(n => [n.id || n.textContent, n.getBoundingClientRect().height]).filter(([, h]) => h > 0 && h < 37.5)";
                assert_eq!(
                    page.eval(low),
                    json!([]),
                    "all is large enough for a finger"
                );
                page.eval("scrollTo(0, 600)");
                page.drawn();
                let top =
                    page.number("document.querySelector('#undo').getBoundingClientRect().top");
                assert!((0.0..60.0).contains(&top), "undo stays in reach");
            }
            page.sound();
        }
    }
}
