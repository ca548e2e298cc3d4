//! Headless Chromium, driven by its debugging protocol over a pipe: JSON messages, each ended by
//! NUL.

use crate::common::skipped;
use base64::prelude::{BASE64_STANDARD, Engine};
use serde_json::{Value, json};
use std::cell::Cell;
use std::collections::HashMap;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, mpsc};
use std::time::{Duration, Instant};

/// Only so that a failing test ends: a loaded machine may take long.
const PATIENCE: Duration = Duration::from_secs(120);
const FLAGS: &[&str] = &[
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    // Pages of other tests are open beside this one.
    "--disable-background-timer-throttling",
    "--disable-backgrounding-occluded-windows",
    "--disable-renderer-backgrounding",
    "--remote-debugging-pipe",
];
/// Removes the folder of the browser when it has ended, which it does when the pipe is closed.
const START: &str =
    r#""$@" --user-data-dir="$0" 3<&0 4>&1 </dev/null >/dev/null 2>&1; rm -rf "$0""#;

type Faults = Arc<Mutex<Vec<String>>>;

/// A browser for all tests of a process.
struct Browser {
    input: Mutex<ChildStdin>,
    next: AtomicU64,
    /// Who waits for the answer to a request; `None` when the browser has ended.
    waiting: Mutex<Option<HashMap<u64, mpsc::Sender<Value>>>>,
    /// What went wrong in each page, by its session.
    faults: Mutex<HashMap<String, Faults>>,
}

/// The program: `CHROMIUM`, or the first that is installed.
fn program() -> Option<PathBuf> {
    if let Some(own) = std::env::var_os("CHROMIUM") {
        return Some(own.into());
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let paths = std::env::split_paths(&folders).flat_map(|f| names.map(|name| f.join(name)));
    paths.into_iter().find(|path| path.is_file())
}

/// The browser, started when it is first wanted; `None`, recorded as skipped, where there is none.
fn browser() -> Option<&'static Browser> {
    static BROWSER: OnceLock<Option<&Browser>> = OnceLock::new();
    let started = *BROWSER.get_or_init(|| Some(Browser::start(&program()?)));
    if started.is_none() {
        skipped("Chromium is not installed");
    }
    started
}

impl Browser {
    fn start(program: &Path) -> &'static Browser {
        let name = format!("chromium-{}", std::process::id());
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let mut child = Command::new("sh")
            .args(["-c", START])
            .arg(folder)
            .arg(program)
            .args(FLAGS)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let output = child.stdout.take().unwrap();
        let browser: &Browser = Box::leak(Box::new(Browser {
            input: Mutex::new(child.stdin.take().unwrap()),
            next: AtomicU64::new(1),
            waiting: Mutex::new(Some(HashMap::new())),
            faults: Mutex::default(),
        }));
        std::thread::spawn(move || {
            browser.listen(BufReader::new(output));
            let _ = child.wait();
        });
        browser
    }

    fn listen(&self, mut output: impl BufRead) {
        let mut message = Vec::new();
        while output.read_until(0, &mut message).is_ok_and(|n| n > 0) {
            let text = message.strip_suffix(&[0]).unwrap_or(&message);
            if let Ok(said) = serde_json::from_slice::<Value>(text) {
                self.hear(&said);
            }
            message.clear();
        }
        self.waiting.lock().unwrap().take();
    }

    fn hear(&self, said: &Value) {
        if let Some(id) = said["id"].as_u64() {
            let mut waiting = self.waiting.lock().unwrap();
            if let Some(asker) = waiting.as_mut().and_then(|w| w.remove(&id)) {
                // A page that is closed asks and does not wait.
                let _ = asker.send(said.clone());
            }
        } else if let Some(fault) = fault(said) {
            let faults = self.faults.lock().unwrap();
            let session = said["sessionId"].as_str().unwrap_or_default();
            if let Some(page) = faults.get(session) {
                page.lock().unwrap().push(fault);
            }
        }
    }

    /// Sends a request; where its answer comes.
    fn send(&self, session: Option<&str>, method: &str, params: Value) -> mpsc::Receiver<Value> {
        let id = self.next.fetch_add(1, Ordering::Relaxed);
        let mut message = json!({ "id": id, "method": method, "params": params });
        if let Some(session) = session {
            message["sessionId"] = session.into();
        }
        let (asker, answer) = mpsc::channel();
        if let Some(waiting) = self.waiting.lock().unwrap().as_mut() {
            waiting.insert(id, asker);
        }
        // A browser that has ended is told of by the answer, which does not come.
        let message = message.to_string() + "\0";
        let _ = self.input.lock().unwrap().write_all(message.as_bytes());
        answer
    }

    fn ask(&self, session: Option<&str>, method: &str, params: Value) -> Value {
        let answer = self.send(session, method, params).recv_timeout(PATIENCE);
        let mut answer = answer.unwrap_or_else(|e| panic!("{method}: Chromium: {e}"));
        assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
        answer["result"].take()
    }
}

/// What an event tells that should not be: an exception, an error or a warning on the console, what
/// a policy refused.
fn fault(event: &Value) -> Option<String> {
    let params = &event["params"];
    let is_bad = |level: &Value| matches!(level.as_str(), Some("error" | "warning" | "assert"));
    match event["method"].as_str()? {
        "Runtime.exceptionThrown" => {
            let thrown = &params["exceptionDetails"];
            let told = thrown["exception"]["description"].as_str();
            Some(told.map_or_else(|| thrown.to_string(), String::from))
        }
        "Runtime.consoleAPICalled" if is_bad(&params["type"]) => Some(params["args"].to_string()),
        "Log.entryAdded" if is_bad(&params["entry"]["level"]) => {
            let text = params["entry"]["text"].as_str()?;
            // Of the pictures that tests take.
            let is_own = text.contains("GPU stall due to ReadPixels");
            (!is_own).then(|| text.to_string())
        }
        _ => None,
    }
}

/// What a page is seen on.
#[derive(Debug, Clone, Copy)]
pub struct Screen {
    pub size: [u32; 2],
    pub dark: bool,
    pub touch: bool,
}

pub const WIDE: Screen = Screen {
    size: [1400, 900],
    dark: false,
    touch: false,
};
pub const NARROW: Screen = Screen {
    size: [400, 850],
    dark: false,
    touch: true,
};

/// A place in a page, pixels.
pub type Spot = [f64; 2];

/// A page in a window of its own, with nothing kept of other pages.
pub struct Page {
    browser: &'static Browser,
    context: String,
    session: String,
    faults: Faults,
    /// The keys that are held: shift 8, ctrl 2, alt 1.
    held: Cell<u32>,
    /// Whether the mouse button is.
    pressed: Cell<bool>,
    downloads: tempfile::TempDir,
}

/// What an area of a page looks like.
#[derive(Debug, PartialEq)]
pub struct Look {
    /// How many colors there are.
    pub colors: usize,
    /// The share of pixels that are not of the most common color.
    pub ink: f64,
    /// Equal for equal pixels.
    pub digest: u64,
}

impl Page {
    /// Opens an address; `None`, recorded as skipped, where no Chromium is installed.
    pub fn open(address: &str, screen: Screen) -> Option<Page> {
        let browser = browser()?;
        let ask = |method, params| browser.ask(None, method, params);
        let text = |value: &Value| value.as_str().unwrap().to_string();
        let context = text(&ask("Target.createBrowserContext", json!({}))["browserContextId"]);
        let [width, height] = screen.size;
        let blank = json!({ "url": "about:blank", "browserContextId": context, "newWindow": true,
                            "width": width, "height": height });
        let target = ask("Target.createTarget", blank);
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = text(&ask("Target.attachToTarget", attach)["sessionId"]);
        let faults = Faults::default();
        let known = (session.clone(), Arc::clone(&faults));
        browser.faults.lock().unwrap().extend([known]);
        let page = Page {
            browser,
            context,
            session,
            faults,
            held: Cell::new(0),
            pressed: Cell::new(false),
            downloads: tempfile::tempdir().unwrap(),
        };
        let folder = page.downloads.path();
        let saving = json!({ "behavior": "allow", "browserContextId": page.context, "downloadPath": folder });
        ask("Browser.setDownloadBehavior", saving);
        for domain in ["Page", "Runtime", "Log", "DOM"] {
            page.ask(&format!("{domain}.enable"), json!({}));
        }
        page.ask(
            "Emulation.setFocusEmulationEnabled",
            json!({ "enabled": true }),
        );
        page.ask(
            "Emulation.setDeviceMetricsOverride",
            json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": screen.touch }),
        );
        if screen.touch {
            let touch = json!({ "enabled": true, "maxTouchPoints": 5 });
            page.ask("Emulation.setTouchEmulationEnabled", touch);
        }
        let scheme = if screen.dark { "dark" } else { "light" };
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        page.ask(
            "Emulation.setEmulatedMedia",
            json!({ "features": features }),
        );
        page.go(address);
        Some(page)
    }

    /// Goes to another address.
    pub fn go(&self, address: &str) {
        let gone = self.ask("Page.navigate", json!({ "url": address }));
        assert!(gone["errorText"].is_null(), "{address}: {gone}");
        self.until("document.readyState === 'complete' && location.href !== 'about:blank'");
    }

    fn ask(&self, method: &str, params: Value) -> Value {
        self.browser.ask(Some(&self.session), method, params)
    }

    /// The value of an expression, when it is there if it is promised.
    pub fn eval(&self, expression: &str) -> Value {
        let params =
            json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let mut said = self.ask("Runtime.evaluate", params);
        let thrown = &said["exceptionDetails"];
        assert!(thrown.is_null(), "{expression}: {thrown}");
        said["result"]["value"].take()
    }

    pub fn number(&self, expression: &str) -> f64 {
        let value = self.eval(expression);
        let number = value.as_f64();
        number.unwrap_or_else(|| panic!("{expression} is no number: {value}"))
    }

    pub fn text(&self, selector: &str) -> String {
        let text = self.eval(&format!("document.querySelector('{selector}').textContent"));
        text.as_str().unwrap().to_string()
    }

    pub fn holds(&self, truth: &str) -> bool {
        self.eval(&format!("!!({truth})")) == true
    }

    /// Waits until an expression is true.
    pub fn until(&self, truth: &str) {
        let begun = Instant::now();
        while !self.holds(truth) {
            let late = begun.elapsed() > PATIENCE;
            assert!(
                !late,
                "still not: {truth}; {:?}",
                self.faults.lock().unwrap()
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Waits until what was asked to be drawn is drawn.
    pub fn drawn(&self) {
        self.eval("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))");
    }

    /// Nothing has gone wrong in the page, but for what a text is told to have.
    pub fn sound_but(&self, expected: &[&str]) {
        self.drawn();
        let mut faults = self.faults.lock().unwrap().clone();
        faults.retain(|fault| !expected.iter().any(|text| fault.contains(text)));
        assert!(faults.is_empty(), "{faults:#?}");
    }

    pub fn sound(&self) {
        self.sound_but(&[]);
    }

    // ---- elements ----

    /// Left, top, width and height of an element, which is brought into view.
    pub fn area(&self, selector: &str) -> [f64; 4] {
        let area = self.eval(&format!(
            "(() => {{ const node = document.querySelector('{selector}'); if (!node) return null;
               node.scrollIntoView({{ block: 'nearest', behavior: 'instant' }});
               const box = node.getBoundingClientRect(); return [box.left, box.top, box.width, box.height]; }})()"
        ));
        let area: Option<[f64; 4]> = serde_json::from_value(area).unwrap();
        area.unwrap_or_else(|| panic!("no {selector}"))
    }

    pub fn middle(&self, selector: &str) -> Spot {
        let [left, top, width, height] = self.area(selector);
        [left + width / 2.0, top + height / 2.0]
    }

    /// Clicks the middle of an element, which has to be seen.
    pub fn click_on(&self, selector: &str) {
        let at = self.middle(selector);
        let hit = format!(
            "(() => {{ const node = document.querySelector('{selector}'), hit = document.elementFromPoint({}, {});
               return node === hit || node.contains(hit) || hit?.contains(node) && hit.tagName === 'LABEL'; }})()",
            at[0], at[1]
        );
        assert!(self.holds(&hit), "{selector} is hidden at {at:?}");
        self.click(at);
    }

    pub fn focus(&self, selector: &str) {
        self.eval(&format!("document.querySelector('{selector}').focus()"));
    }

    /// Chooses a value of a list or a slider.
    pub fn choose(&self, selector: &str, value: &str) {
        self.eval(&format!(
            "(() => {{ const node = document.querySelector('{selector}'); node.focus(); node.value = '{value}';
               for (const way of ['input', 'change']) node.dispatchEvent(new Event(way, {{ bubbles: true }})); }})()"
        ));
    }

    /// Types over what a field has.
    pub fn fill(&self, selector: &str, text: &str) {
        self.eval(&format!(
            "(() => {{ const node = document.querySelector('{selector}'); node.focus(); node.select(); }})()"
        ));
        self.ask("Input.insertText", json!({ "text": text }));
    }

    /// Gives a file to a field.
    pub fn give(&self, selector: &str, file: &Path) {
        let expression = format!("document.querySelector('{selector}')");
        let node = self.ask("Runtime.evaluate", json!({ "expression": expression }));
        let node = &node["result"]["objectId"];
        let give = json!({ "files": [file], "objectId": node });
        self.ask("DOM.setFileInputFiles", give);
    }

    /// The file of this name that the page has saved.
    pub fn saved(&self, name: &str) -> String {
        let path = self.downloads.path().join(name);
        let begun = Instant::now();
        // The browser makes an empty file of the name first.
        let size = || std::fs::metadata(&path).map_or(0, |about| about.len());
        let mut before = 0;
        while before == 0 || size() != before {
            before = size();
            let late = begun.elapsed() > PATIENCE;
            assert!(!late, "{name} is not saved");
            std::thread::sleep(Duration::from_millis(20));
        }
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        text
    }

    // ---- mouse, fingers, keys ----

    fn mouse(&self, kind: &str, [x, y]: Spot, more: Value) -> mpsc::Receiver<Value> {
        let mut event = json!({
            "type": kind, "x": x, "y": y, "modifiers": self.held.get(), "pointerType": "mouse",
            "button": if self.pressed.get() || kind == "mouseReleased" { "left" } else { "none" },
            "buttons": u8::from(self.pressed.get()), "clickCount": u8::from(kind.ends_with("ed") && kind != "mouseMoved"),
        });
        let own = event.as_object_mut().unwrap();
        own.extend(more.as_object().unwrap().clone());
        let session = Some(self.session.as_str());
        self.browser
            .send(session, "Input.dispatchMouseEvent", event)
    }

    fn done(&self, answer: mpsc::Receiver<Value>) {
        let answer = answer.recv_timeout(PATIENCE).unwrap();
        assert!(answer["error"].is_null(), "{answer}");
    }

    pub fn move_to(&self, at: Spot) {
        self.done(self.mouse("mouseMoved", at, json!({})));
    }

    /// Moves the mouse, and does not wait until the page has seen it.
    pub fn move_unseen(&self, at: Spot) {
        self.mouse("mouseMoved", at, json!({}));
    }

    /// Moves in a straight line, in steps.
    pub fn glide(&self, [a, b]: Spot, [x, y]: Spot, steps: u32) {
        for i in 1..=steps {
            let share = f64::from(i) / f64::from(steps);
            self.move_to([a + share * (x - a), b + share * (y - b)]);
        }
    }

    pub fn press(&self, at: Spot) {
        self.move_to(at);
        self.pressed.set(true);
        self.done(self.mouse("mousePressed", at, json!({})));
    }

    pub fn release(&self, at: Spot) {
        self.pressed.set(false);
        self.done(self.mouse("mouseReleased", at, json!({})));
    }

    pub fn click(&self, at: Spot) {
        self.press(at);
        self.release(at);
    }

    pub fn wheel(&self, at: Spot, down: f64) {
        self.done(self.mouse("mouseWheel", at, json!({ "deltaX": 0, "deltaY": down })));
    }

    /// Fingers: `touchStart`, `touchMove`, `touchEnd`.
    pub fn touch(&self, kind: &str, at: &[Spot]) {
        let points = at
            .iter()
            .enumerate()
            .map(|(id, [x, y])| json!({ "x": x, "y": y, "id": id }));
        let event = json!({ "type": kind, "touchPoints": points.collect::<Value>() });
        self.ask("Input.dispatchTouchEvent", event);
    }

    /// Presses keys such as `k`, `Shift+ArrowUp` or `Control+z`.
    pub fn key(&self, keys: &str) {
        let (held, key) = keys.rsplit_once('+').unwrap_or(("", keys));
        let before = self.held.get();
        held.split('+').for_each(|key| self.hold(key));
        let code: u32 = match key {
            "Tab" => 9,
            "Enter" => 13,
            "Escape" => 27,
            "End" => 35,
            "Home" => 36,
            "ArrowLeft" => 37,
            "ArrowUp" => 38,
            "ArrowRight" => 39,
            "ArrowDown" => 40,
            "Delete" => 46,
            _ => key.to_uppercase().chars().next().map_or(0, u32::from),
        };
        let text = match key {
            "Enter" => "\r",
            _ if key.chars().count() == 1 && self.held.get() & 3 == 0 => key,
            _ => "",
        };
        for kind in ["keyDown", "keyUp"] {
            let mut event = json!({ "type": kind, "key": key, "windowsVirtualKeyCode": code, "modifiers": self.held.get() });
            if kind == "keyDown" {
                event["text"] = text.into();
            }
            self.ask("Input.dispatchKeyEvent", event);
        }
        self.held.set(before);
    }

    /// Holds `Shift`, `Control` or `Alt` from now on.
    pub fn hold(&self, key: &str) {
        let one = match key {
            "Alt" => 1,
            "Control" => 2,
            "Shift" => 8,
            _ => 0,
        };
        self.held.set(self.held.get() | one);
    }

    pub fn let_go(&self) {
        self.held.set(0);
    }

    // ---- what is seen ----

    /// A picture of an area (left, top, width, height) of the window, PNG in base64; none: of all
    /// of it.
    fn picture(&self, area: Option<[f64; 4]>) -> String {
        let mut params = json!({ "format": "png" });
        if let Some([x, y, width, height]) = area {
            let scroll: Spot = serde_json::from_value(self.eval("[scrollX, scrollY]")).unwrap();
            params["clip"] = json!({ "x": x + scroll[0], "y": y + scroll[1], "width": width, "height": height, "scale": 1 });
        }
        let taken = self.ask("Page.captureScreenshot", params);
        taken["data"].as_str().unwrap().to_string()
    }

    /// What an element looks like.
    pub fn look(&self, selector: &str) -> Look {
        let area = self.area(selector);
        assert!(
            area[2] >= 1.0 && area[3] >= 1.0,
            "{selector} has no size: {area:?}"
        );
        self.drawn();
        let look = self.eval(&format!("({LOOK})('{}')", self.picture(Some(area))));
        Look {
            colors: look[0].as_u64().unwrap() as usize,
            ink: look[1].as_f64().unwrap(),
            digest: look[2].as_u64().unwrap(),
        }
    }

    /// Waits until an element is there, and something is drawn in it.
    pub fn shows(&self, selector: &str) {
        self.until(&format!("document.querySelector('{selector}')"));
        let begun = Instant::now();
        loop {
            let look = self.look(selector);
            if look.ink > 0.001 && look.colors > 1 {
                return;
            }
            let late = begun.elapsed() > PATIENCE;
            assert!(!late, "{selector} is empty: {look:?}");
        }
    }

    /// Waits until an element looks otherwise.
    pub fn redrawn(&self, selector: &str, before: &Look) {
        let begun = Instant::now();
        while self.look(selector) == *before {
            let late = begun.elapsed() > PATIENCE;
            assert!(!late, "{selector} looks as before");
        }
    }

    /// Keeps a picture of the window in the folder `SHOTS`, if that is set, for a person to look
    /// at.
    pub fn shot(&self, name: &str) {
        if let Some(folder) = std::env::var_os("SHOTS") {
            self.drawn();
            let png = BASE64_STANDARD.decode(self.picture(None)).unwrap();
            let path = Path::new(&folder).join(format!("{name}.png"));
            std::fs::write(path, png).unwrap();
        }
    }
}

/// Reads the pixels of a picture: the number of colors, the share that is not of the commonest, a
/// digest.
const LOOK: &str = "async data => {
  const bytes = Uint8Array.from(atob(data), c => c.charCodeAt(0)), image = await createImageBitmap(new Blob([bytes], { type: 'image/png' }));
  const ctx = new OffscreenCanvas(image.width, image.height).getContext('2d', { willReadFrequently: true });
  ctx.drawImage(image, 0, 0);
  const pixels = new Uint32Array(ctx.getImageData(0, 0, image.width, image.height).data.buffer), counts = new Map();
  let digest = 7;
  for (const pixel of pixels) { counts.set(pixel, (counts.get(pixel) || 0) + 1); digest = (digest * 31 + pixel) % 4294967291; }
  return [counts.size, 1 - Math.max(...counts.values()) / pixels.length, digest];
}";

impl Drop for Page {
    fn drop(&mut self) {
        let close = json!({ "browserContextId": self.context });
        self.browser
            .send(None, "Target.disposeBrowserContext", close);
        let mut faults = self.browser.faults.lock().unwrap();
        faults.remove(&self.session);
    }
}
