//! The page in a browser: Chromium without a window, led by its DevTools protocol.
//!
//! `CHROMIUM` names the program, `chromium` unless set. Where there is none and nothing is set, what needs it is skipped and says so.

use crate::rig::{BY_HAND, Desk, Rig};
use edm_servo_head::head::{Fault, State};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, ErrorKind};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

/// The longest that the page may take to become what is waited for.
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser with one page.
struct Browser {
    process: Child,
    socket: WebSocket<TcpStream>,
    session: Value,
    next: u64,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// At the address of a desk, so wide; `None` where there is no browser.
    fn at(desk: &Desk, wide: u32, dark: bool) -> Option<Browser> {
        let named = std::env::var("CHROMIUM").ok();
        let profile = tempfile::tempdir().unwrap();
        let mut command = Command::new(named.as_deref().unwrap_or("chromium"));
        command.args(["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]);
        command
            .arg("--remote-debugging-port=0")
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank");
        let mut process = match command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn() {
            Err(error) if error.kind() == ErrorKind::NotFound && named.is_none() => {
                eprintln!("SKIPPED: no chromium; CHROMIUM names another browser of its kind");
                return None;
            }
            process => process.unwrap(),
        };
        let mut said = BufReader::new(process.stderr.take().unwrap()).lines().map_while(Result::ok);
        let url = said.find_map(|line| Some(line.split_once("DevTools listening on ")?.1.to_owned())).unwrap();
        // It may go on to say things.
        std::thread::spawn(move || said.for_each(drop));
        let address = url.split('/').nth(2).unwrap();
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (socket, _) = tungstenite::client(&url, stream).unwrap();
        let mut browser = Browser { process, socket, session: Value::Null, next: 1, _profile: profile };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }))["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", json!({ "targetId": target, "flatten": true }));
        browser.session = attached["sessionId"].clone();
        let scheme = if dark { "dark" } else { "light" };
        let feature = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        browser.call("Emulation.setEmulatedMedia", json!({ "features": feature }));
        let size = json!({ "width": wide, "height": 900, "deviceScaleFactor": 1, "mobile": false });
        browser.call("Emulation.setDeviceMetricsOverride", size);
        browser.call("Page.navigate", json!({ "url": format!("http://{}/", desk.address) }));
        browser.until(
            "document.querySelector('#found li') && !document.querySelector('#found').innerText.startsWith('Scanning')",
        );
        Some(browser)
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        let id = self.next;
        self.next += 1;
        let mut request = json!({ "id": id, "method": method, "params": params });
        if self.session.is_string() {
            request["sessionId"] = self.session.clone();
        }
        self.socket.send(Message::text(request.to_string())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let answer: Value = serde_json::from_str(&text).unwrap();
            if answer["id"] == id {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// What an expression is in the page.
    fn value(&mut self, expression: &str) -> Value {
        let how = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true, "userGesture": true });
        let answer = self.call("Runtime.evaluate", how);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    /// Waits in the page until an expression holds.
    fn until(&mut self, expression: &str) {
        let ms = PATIENCE.as_millis() / 2;
        let waits = format!(
            "new Promise((done) => {{ const end = Date.now() + {ms}; const look = () => {{ if ({expression}) done(true);
             else if (Date.now() > end) done(document.body.innerText); else setTimeout(look, 20); }}; look(); }})"
        );
        let held = self.value(&waits);
        assert_eq!(held, true, "{expression} in vain");
    }

    /// Loads the page again, as F5 does.
    fn reload(&mut self) {
        self.load("document.querySelector('#found button') !== null");
    }

    fn reload_without_heads(&mut self) {
        self.load("document.querySelector('#found') !== null");
    }

    fn load(&mut self, there: &str) {
        self.value("window.before = true");
        self.call("Page.reload", json!({}));
        let there = format!("!window.before && {there}");
        let end = Instant::now() + PATIENCE;
        // Between two pages there is nothing to evaluate in.
        while self.call("Runtime.evaluate", json!({ "expression": there }))["result"]["value"] != true {
            assert!(Instant::now() < end, "not loaded again");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn text(&mut self, selector: &str) -> String {
        self.value(&format!("document.querySelector('{selector}').innerText")).as_str().unwrap().to_owned()
    }

    /// Waits until the page has been drawn so many times.
    fn drawn(&mut self, frames: u32) {
        self.value(&format!(
            "new Promise((done) => {{ let left = {frames}; const next = () => left-- ? requestAnimationFrame(next) : done(true); next(); }})"
        ));
    }

    fn click(&mut self, selector: &str) {
        self.until(&format!("!document.querySelector('{selector}').disabled"));
        self.value(&format!("document.querySelector('{selector}').click()"));
    }

    /// Presses a key, which types a text.
    fn key(&mut self, key: &str, code: u32, text: &str) {
        let kind = if text.is_empty() { "rawKeyDown" } else { "keyDown" };
        for kind in [kind, "keyUp"] {
            let text = if kind == "keyUp" { "" } else { text };
            let key = json!({ "type": kind, "key": key, "text": text, "windowsVirtualKeyCode": code });
            self.call("Input.dispatchKeyEvent", key);
        }
    }

    fn view(&mut self, name: &str) {
        self.click(&format!("nav a[href=\"#{name}\"]"));
        self.until(&format!("!document.getElementById('{name}').hidden"));
    }

    /// Takes command.
    fn command(&mut self) {
        self.click("#command");
        self.until("document.querySelector('#command').innerText === 'Release command'");
    }

    /// A picture of the page as it is, for a person to look at, among the temporary files of tests.
    fn picture(&mut self, name: &str) {
        self.value("scrollTo(0, 0)");
        let picture = self.call("Page.captureScreenshot", json!({ "captureBeyondViewport": true }));
        let path = format!("{}/{name}.png", env!("CARGO_TARGET_TMPDIR"));
        std::fs::write(path, from_base64(picture["data"].as_str().unwrap())).unwrap();
    }

    /// What a link saves under a name.
    fn download(&mut self, selector: &str, name: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_str().unwrap();
        self.call("Page.setDownloadBehavior", json!({ "behavior": "allow", "downloadPath": path }));
        self.click(selector);
        let file = folder.path().join(name);
        let end = Instant::now() + PATIENCE;
        while !file.exists() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(20));
        }
        std::fs::read_to_string(file).unwrap()
    }

    /// Takes command and begins a hole.
    fn bore(&mut self, depth_mm: f64) {
        self.command();
        self.view("run");
        self.value(&format!("document.querySelector('[name=depth]').value = {depth_mm}"));
        self.click("#begin");
        self.until("document.querySelector('#state').innerText === 'eroding'");
    }
}

/// RFC 4648, section 4.
fn from_base64(text: &str) -> Vec<u8> {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digits: Vec<u32> =
        text.bytes().filter_map(|c| DIGITS.iter().position(|digit| *digit == c)).map(|digit| digit as u32).collect();
    let bytes = digits.chunks(4).flat_map(|four| {
        let wide = four.iter().fold(0, |wide, digit| wide << 6 | digit) << (6 * (4 - four.len()));
        wide.to_be_bytes().into_iter().skip(1).take(four.len() - 1)
    });
    bytes.collect()
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn a_stranger_bores_a_hole_in_the_page() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.view("log");
    assert!(page.text("#events").contains("the program has started"), "{}", page.text("#events"));
    page.view("heads");
    let found = page.text("#found");
    assert!(found.contains("Node 1") && found.contains("disabled, not homed"), "{found}");
    assert_eq!(page.value("document.querySelector('#begin').disabled"), true, "this session only watches");
    page.bore(0.002);
    page.until("document.querySelector('#doing').innerText.startsWith('Bored: ')");
    let said = page.text("#doing");
    assert!(said.contains(" of 0.002 mm in "), "{said}");
    assert_eq!(page.value("document.querySelector('#progress').value"), 1);
    let truth = rig.truth();
    assert_eq!((truth.state, truth.pulses, truth.fault), (State::Disabled, false, None));
    // The peaks of a fresh surface are 3 um above its mean, which is at 2 mm.
    assert!(truth.deepest >= 1999, "{truth:?}");
    page.until(DRAWN);
    page.view("log");
    assert!(page.text("#events").contains("bores to 0.002 mm"), "{}", page.text("#events"));
}

/// The same with the firmware on the modelled chip, which `.ci/release desk` has put on a bus: several times slower than a head.
#[test]
fn a_stranger_bores_a_hole_with_the_firmware_in_the_page() {
    let Ok(connection) = std::env::var("EDM_CHIP_BUS") else { return };
    let desk = Desk::new(&connection);
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    let at_last = |page: &mut Browser, condition: &str| {
        println!("waits for {condition}");
        let end = Instant::now() + 10 * PATIENCE;
        while page.value(condition) != true {
            assert!(Instant::now() < end, "{condition}: {}", page.text("body"));
            std::thread::sleep(Duration::from_millis(200));
        }
    };
    page.view("heads");
    at_last(&mut page, "document.querySelector('#found').innerText.includes('Node 1')");
    page.command();
    page.view("scope");
    page.click("#record-fast button");
    at_last(&mut page, "document.querySelector('#recorded').innerText.includes('samples')");
    page.view("run");
    page.value("document.querySelector('[name=depth]').value = 0.002");
    page.click("#begin");
    at_last(&mut page, "document.querySelector('#doing').innerText.startsWith('Bored: ')");
    assert!(page.text("#doing").contains(" of 0.002 mm in "), "{}", page.text("#doing"));
    // The work is 2 mm below home: too near for the default.
    let (_, _, error) = crate::rig::run(&connection, &["settings", "set", "identify.travel_um=1500"]);
    assert_eq!(error, "");
    page.view("motor");
    page.value("document.querySelector('#identify [name=at]').value = 1.8");
    page.click("#identify-begin");
    at_last(&mut page, "document.querySelector('#found-values').rows.length > 5");
    page.picture("motor-of-the-firmware");
    page.click("#identify-begin");
    at_last(&mut page, "document.querySelector('#state').innerText === 'identifying'");
    page.click("#stop");
    at_last(&mut page, "document.querySelector('#state').innerText === 'disabled'");
}

#[test]
fn a_program_is_eroded_from_the_page_and_what_is_wrong_in_it_is_marked_in_its_line() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.command();
    page.view("run");
    page.click("#path summary");
    let type_in = |page: &mut Browser, text: &str| {
        page.value(&format!(
            "(() => {{ const field = document.querySelector('[name=program]'); field.value = '{text}'; field.oninput(); }})()"
        ));
    };
    type_in(&mut page, "G1 Z-0.002 F30\\nG5 X1\\nM2");
    assert_eq!(page.value("document.querySelector('[name=depth]').disabled"), true, "the program has the depth");
    page.click("#begin");
    page.until("document.querySelector('#run-said').innerText.startsWith('program line 2: G5: must be one of')");
    let marked = "(() => { const field = document.querySelector('[name=program]');
        return field.classList.contains('wrong') && field.value.slice(field.selectionStart, field.selectionEnd); })()";
    assert_eq!(page.value(marked), "G5 X1");
    page.picture("run-program-wrong");
    type_in(&mut page, "G1 Z-0.002 F30\\nX0.004\\nM2");
    page.click("#begin");
    page.until("/line [12]: /.test(document.querySelector('#doing').innerText)");
    page.until("document.querySelector('#doing').innerText.startsWith('Bored: ')");
    assert!(page.text("#doing").contains("End of the program"), "{}", page.text("#doing"));
    let beside = page.text("#beside");
    assert!(beside.starts_with("0.00") && beside.contains(", 0.000 mm"), "{beside}");
    assert_eq!(page.value("document.querySelector('#progress').value"), 1);
    page.picture("run-program");
    let truth = rig.truth();
    assert!(truth.deepest >= 1999 && !truth.pulses, "{truth:?}");
}

#[test]
fn a_table_runs_from_the_page_which_says_the_row_and_asks_for_the_generator() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.command();
    page.view("run");
    page.click("#rows summary");
    assert_eq!(page.value("document.querySelector('#row-row').offsetHeight"), 0, "no table is under way");
    let type_in = |page: &mut Browser, fine: &str| {
        let head = "electrode = 'copper'\\nwork = 'steel'\\n[[row]]\\nname = 'rough'\\nleaves_um = 2\\n";
        let text = format!("{head}generator.on_us = 160\\n[[row]]\\nname = 'fine'\\n{fine}");
        page.value(&format!(
            "(() => {{ const field = document.querySelector('[name=table]'); field.value = \"{text}\"; field.oninput(); }})()"
        ));
    };
    page.value("document.querySelector('[name=depth]').value = 0.004");
    type_in(&mut page, "settings.gap.setpoint_v = 500");
    page.click("#begin");
    page.until("document.querySelector('#run-said').innerText.startsWith('table line 9: row \"fine\": gap.setpoint_v = 500: must be')");
    let marked = "(() => { const field = document.querySelector('[name=table]');
        return field.classList.contains('wrong') && field.value.slice(field.selectionStart, field.selectionEnd); })()";
    assert_eq!(page.value(marked), "settings.gap.setpoint_v = 500");
    page.picture("run-table-wrong");
    type_in(&mut page, "generator.on_us = 60");
    page.click("#begin");
    for (row, generator) in [("1 of 2, rough", "on_us 160 (row 1, rough)"), ("2 of 2, fine", "on_us 60 (row 2, fine)")]
    {
        page.until(&format!("document.querySelector('#generator span').innerText === '{generator}'"));
        assert!(!rig.truth().pulses);
        assert_eq!(page.text("#row"), row);
        page.picture(if row.starts_with('1') { "run-table-waits" } else { "run-table-waits-fine" });
        page.click("#generator-set");
        page.until("document.querySelector('#generator').hidden");
    }
    page.until("document.querySelector('#doing').innerText.startsWith('Bored: ')");
    assert_eq!(page.value("document.querySelector('#progress').value"), 1);
}

/// Something is drawn in each pane.
const DRAWN: &str = "document.querySelectorAll('#chart canvas').length === 3
    && [...document.querySelectorAll('#chart canvas')].every((canvas) => canvas.width > 100
    && canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some((byte) => byte))";

#[test]
fn a_loop_is_measured_and_gets_other_gains_in_the_page_and_the_old_ones_back() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let set =
        ["servo.velocity_hz=90", "servo.position_hz=45", "tune.travel_um=1500", "tune.points=6", "tune.lowest_hz=60"];
    let (_, _, error) = crate::rig::run(&rig.connection(), &[&["settings", "set"][..], &set].concat());
    assert_eq!(error, "");
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.view("motor");
    assert_eq!(page.value("document.querySelector('#tune-begin').disabled"), true, "this session only watches");
    page.command();
    page.value("document.querySelector('#tune [name=at]').value = 1.8");
    page.click("#tune-begin");
    page.until("document.querySelector('#tune-doing').innerText.includes('of 6 frequencies')");
    page.until("document.querySelectorAll('#tune-rows tr').length === 3");
    let rows = page.text("#tune-rows");
    assert!(rows.contains("as it was") && rows.contains("proposal") && rows.contains("Ziegler-Nichols"), "{rows}");
    page.until("document.querySelectorAll('#bode canvas').length === 2 && document.querySelector('#steps canvas')");
    page.click("#tune-rows tr:nth-child(2) button");
    page.until("document.querySelectorAll('#tune-rows tr').length === 4");
    let said = page.text("#tune-said");
    assert!(said.contains("The new gains are in force"), "{said}");
    page.picture("loop");
    page.click("#tune-rows tr:first-child button");
    page.until("document.querySelector('#tune-said').innerText === 'The gains are as they were.'");
    let (_, said, _) = crate::rig::run(&rig.connection(), &["settings", "get", "servo.velocity_hz"]);
    assert!(said.contains("90"), "{said}");
    // Whoever comes later sees it.
    page.reload();
    page.view("motor");
    page.until("document.querySelectorAll('#tune-rows tr').length === 4");
}

/// A colour of the page as the bytes that are drawn.
fn shade(page: &mut Browser, name: &str) -> Value {
    page.value(&format!(
        "(() => {{ const g = document.createElement('canvas').getContext('2d');
         g.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('{name}').trim();
         return g.fillStyle.match(/[0-9a-f]{{2}}/g).map((two) => parseInt(two, 16)); }})()"
    ))
}

#[test]
fn a_hole_stays_as_it_was_bored_when_the_head_has_gone_home_and_in_a_page_that_is_loaded_later() {
    for (wide, dark, name) in [(1280, false, "bored-light"), (800, true, "bored-dark")] {
        let rig = Rig::new();
        let desk = Desk::new(&rig.connection());
        let Some(mut page) = Browser::at(&desk, wide, dark) else { return };
        page.call(
            "Emulation.setDeviceMetricsOverride",
            json!({ "width": wide, "height": 800, "deviceScaleFactor": 1, "mobile": false }),
        );
        page.bore(0.03);
        page.until("document.querySelector('#doing').innerText.startsWith('Bored: ')");
        for again in [false, true] {
            if again {
                page.reload();
                page.until("document.querySelector('#doing').innerText.startsWith('Bored: ')");
            }
            page.until("/^0.03[0-9] mm$/.test(document.querySelector('#depth').innerText)");
            assert_eq!(page.text("#target").trim(), "of 0.030 mm;");
            page.until(
                "/^electrode [12].[0-9]{3} mm above the work$/.test(document.querySelector('#electrode').innerText)",
            );
            assert!(page.text("#doing").ends_with("Depth reached. The head is disabled, pulses are off."));
            page.until(DRAWN);
            // The depth has the hole's scale and grows downward. The target is near the lower edge of the pane. It is touched for a moment,
            // which can lie between two samples of the trace: the line ends within 10 um of it.
            let traced = shade(&mut page, "--trace");
            let rows = page.value(&format!(
                "(() => {{ const canvas = document.querySelector('#chart canvas'), g = canvas.getContext('2d');
                 const {{ data, width, height }} = g.getImageData(0, 0, canvas.width, canvas.height);
                 const rows = []; for (let at = 0; at < data.length; at += 4)
                   if ({traced}.every((byte, place) => Math.abs(byte - data[at + place]) < 3)) rows.push(Math.floor(at / 4 / width) / height);
                 return [Math.min(...rows), Math.max(...rows)]; }})()"
            ));
            let (high, low) = (rows[0].as_f64().unwrap(), rows[1].as_f64().unwrap());
            assert!(high < 0.5 && low > 0.75, "the hole is a flat line: {rows}");
            // The strip of states, in the colour of each.
            for state in ["--eroding", "--moving"] {
                let shade = shade(&mut page, state);
                let seen = page.value(&format!(
                    "(() => {{ const canvas = document.querySelector('#chart canvas'), g = canvas.getContext('2d');
                     const {{ data }} = g.getImageData(0, 0, canvas.width, 26); let count = 0;
                     for (let at = 0; at < data.length; at += 4) count += {shade}.every((byte, place) => byte === data[at + place]);
                     return count; }})()"
                ));
                assert!(seen.as_i64().unwrap() > 20, "{state}: {seen}");
            }
            // From two metres: digits of 8 mm on a screen of 96 dots an inch.
            for (id, least) in [("depth", 36.0), ("gap-now", 27.0), ("left", 27.0), ("state", 20.0)] {
                let size =
                    page.value(&format!("parseFloat(getComputedStyle(document.querySelector('#{id}')).fontSize)"));
                assert!(size.as_f64().unwrap() >= least, "{id}: {size}");
            }
            let edges = page.value(
                "[document.querySelector('#chart').getBoundingClientRect().top, document.querySelector('#chart').getBoundingClientRect().bottom,
                 document.querySelector('#chart').getBoundingClientRect().right]",
            );
            let edge = |place: usize| edges[place].as_f64().unwrap();
            assert!(edge(2) > f64::from(wide) - 40.0, "half of the page is empty: {edges}");
            assert!(edge(0) < 560.0 && (wide < 1280 || edge(1) <= 800.0), "the plots are below the fold: {edges}");
            page.picture(&format!("{name}{}", if again { "-again" } else { "" }));
            // The gap keeps its last pulses as well.
            page.view("gap");
            page.until("/^No pulses now. At [0-9:]{8}: /.test(document.querySelector('#verdict').innerText)");
            page.until("document.querySelectorAll('#stack div').length > 1");
            page.until("/^[0-9.]+ ± [0-9.]+ .ms/.test(document.querySelector('#hazard').innerText)");
            page.picture(&format!("{name}-gap{}", if again { "-again" } else { "" }));
            page.view("run");
        }
    }
}

#[test]
fn what_is_refused_stands_in_its_own_view_and_at_its_field_which_keeps_what_was_typed() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.command();
    page.view("run");
    page.value("document.querySelector('[name=depth]').value = 500");
    page.click("#begin");
    page.until("document.querySelector('#run-said').innerText.startsWith('depth 500 mm: must be at most')");
    assert_eq!(page.value("document.querySelector('[name=depth]').classList.contains('wrong')"), true);
    page.click("#more summary");
    page.until("document.querySelector('[name=jump_height_um]').placeholder === '1000'");
    page.value(
        "document.querySelector('[name=depth]').value = 0.1; document.querySelector('[name=jump_height_um]').value = 1",
    );
    page.click("#begin");
    page.until("document.querySelector('[name=jump_height_um]').classList.contains('wrong')");
    let why = page.text("#run-said");
    assert!(why.contains("jump.height_um") && why.contains("must be a number from 10 to 1000000 um"), "{why}");
    page.click("#jog summary");
    page.picture("run-wrong-light");
    page.click("#jog [data-step=\"0.1\"]");
    page.until("document.querySelector('#run-said').innerText.startsWith('the head is not enabled to jog')");
    page.click("#jog-begin");
    page.until("document.querySelector('#jog-doing').innerText === 'holding, pulses off'");
    page.click("#jog [data-step=\"0.1\"]");
    page.until("/^0.(099|10[01]) mm$/.test(document.querySelector('#jog-position').innerText)");
    page.click("#jog-end");
    page.until("document.querySelector('#jog-doing').innerText === 'not enabled' && document.querySelector('#state').innerText === 'disabled'");
    page.view("settings");
    page.until("document.querySelector('[aria-label=\"gap.setpoint_v\"]')");
    let type_in = |page: &mut Browser, text: &str| {
        page.value(&format!(
            "(() => {{ const field = document.querySelector('[aria-label=\"gap.setpoint_v\"]');
             field.value = '{text}'; field.onchange(); }})()"
        ));
    };
    type_in(&mut page, "5000");
    page.until("document.querySelector('#list small.wrong')");
    let why = page.text("#list small.wrong");
    assert!(why.contains("must be a number from 1 to 300 V") && why.ends_with("The head has 65 V"), "{why}");
    let field = page.value("document.querySelector('[aria-label=\"gap.setpoint_v\"]').value");
    assert_eq!(field, "5000", "what was typed");
    // Nothing of that in another view.
    for said in ["settings-said", "scope-said", "heads-said", "bring-up-said"] {
        assert_eq!(page.value(&format!("document.querySelector('#{said}').textContent")), "", "{said}");
    }
    assert_eq!(page.value("document.querySelector('#doing').textContent"), "No hole in progress.");
    page.picture("settings-light");
    type_in(&mut page, "60");
    page.until("document.querySelector('#settings-said').innerText === 'gap.setpoint_v = 60'");
    assert_eq!(page.value("document.querySelector('#list small.wrong')"), Value::Null);
    page.view("log");
    page.until("document.querySelector('#events').innerText.includes('has changed gap.setpoint_v 65 -> 60 V')");
}

#[test]
fn a_new_head_gets_its_node_id_in_the_page() {
    let rig = Rig::unnamed();
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.until("document.querySelector('#found').innerText.startsWith('No node answers')");
    page.command();
    page.click("#name");
    page.until("document.querySelector('#heads-said').innerText === 'Serial number 1 is node 1.'");
    page.until("document.querySelector('#now-1').innerText === 'disabled, not homed'");
    page.picture("heads-light");
    page.click("#name");
    page.until("document.querySelector('#heads-said').innerText === 'No head waits for a node-ID.'");
}

#[test]
fn a_head_is_brought_up_in_the_page() {
    for (wide, dark, name) in [(1280, false, "bring-up-light"), (800, true, "bring-up-dark")] {
        let rig = Rig::new();
        let desk = Desk::new(&rig.connection());
        let Some(mut page) = Browser::at(&desk, wide, dark) else { return };
        rig.happen("workpiece.raised_mm", -100.0);
        page.command();
        page.view("bring-up");
        page.click("#up-begin");
        page.until("document.querySelectorAll('#up-list tr').length > 15");
        let said = page.text("#up-list");
        assert!(
            said.contains(
                "no gate: set gap.average = plain for this step; without pulses no other average shows the voltage"
            ),
            "{said}"
        );
        page.view("settings");
        page.until("document.querySelector('[aria-label=\"gap.average\"]')");
        page.value(
            "(() => { const average = document.querySelector('[aria-label=\"gap.average\"]');
             average.value = 'plain'; average.onchange(); })()",
        );
        page.view("bring-up");
        for (wire, value, what, becomes) in BY_HAND {
            rig.happen(wire, value);
            page.until(&format!(
                "[...document.querySelectorAll('#up-list tr')].some((row) => row.cells[1].firstChild.data === '{what}'
                 && (row.cells[2].innerText === '{becomes}' || row.className === '{becomes}'))"
            ));
        }
        page.click("#up-check");
        page.until("document.querySelector('#up-doing').innerText === 'guided check: passed'");
        page.click("#up-report");
        page.until("!document.querySelector('#up-files').hidden");
        assert_eq!(page.text("#up-doing"), "All checks passed.", "{}", page.text("#up-list"));
        let file = page.value("document.querySelector('#up-markdown').download").as_str().unwrap().to_owned();
        assert!(file.starts_with("bring-up-1-20") && file.ends_with(".md"), "{file}");
        page.picture(name);
        let text = page.download("#up-markdown", &file);
        assert!(text.contains(" | 12 mm +- 1.2 mm (axis.stroke_um) | passed"), "{text}");
    }
}

#[test]
fn the_gap_is_seen_while_a_hole_is_bored() {
    for (wide, dark, name) in [(1280, false, "gap-light"), (800, true, "gap-dark")] {
        let rig = Rig::new();
        let desk = Desk::new(&rig.connection());
        let Some(mut page) = Browser::at(&desk, wide, dark) else { return };
        page.view("gap");
        page.until("document.querySelectorAll('#ladder tr').length === 4");
        assert_eq!(page.text("#gap-volts"), "-");
        assert_eq!(page.text("#gap-quality").trim(), ": no gate, not valid now");
        assert!(page.text("#ladder").contains("not known"), "no seek has measured the open circuit");
        assert_eq!((page.text("#gap-left").as_str(), page.text("#gap-target").as_str()), ("-", "no hole in progress"));
        page.bore(0.5);
        page.view("gap");
        let cell = |list: &str, what: &str| {
            format!(
                "Number([...document.querySelectorAll('#{list} tr')]
                 .find((row) => row.cells[0].firstChild.data === '{what}').cells[1].innerText)"
            )
        };
        page.until(&format!("{} > 0", cell("shares", "spark")));
        page.until("document.querySelector('#gap-left').innerText.match(/^[0-9]+ s$/)");
        let mut value = |list, what| page.value(&cell(list, what)).as_f64().unwrap();
        let (open, seek) = (value("ladder", "open circuit"), value("ladder", "seek ends"));
        // Of the model: 100 V. Of the settings: 85 %, 65 V, 20 V.
        assert!((90.0..110.0).contains(&open) && (seek - 0.85 * open).abs() < 0.11, "{open} {seek}");
        assert_eq!((value("ladder", "set point"), value("ladder", "short")), (65.0, 20.0));
        // At one moment: the page goes on.
        let all = page.value(
            "[...document.querySelectorAll('#shares tr')]
             .reduce((sum, row) => sum + Number(row.cells[1].innerText), 0)",
        );
        let all = all.as_f64().unwrap();
        assert!((all - 100.0).abs() <= 1.5, "{all}");
        let volts = page.text("#gap-volts");
        let number: f64 = volts.split(' ').next().unwrap().parse().unwrap();
        assert!((5.0..110.0).contains(&number) && volts.ends_with("valid"), "{volts}");
        assert_eq!(page.text("#gap-target"), "of 0.500 mm");
        page.until("/^0.[0-9]{3} mm$/.test(document.querySelector('#gap-depth').innerText)");
        // The ladder: each level in its colour, the present voltage as a pointer.
        for name in ["--quiet", "--seeking", "--target", "--short", "--text"] {
            let shade = shade(&mut page, name);
            page.until(&format!(
                "(() => {{ const canvas = document.querySelector('#levels'), g = canvas.getContext('2d');
                 const {{ data }} = g.getImageData(0, 0, canvas.width, canvas.height); let count = 0;
                 for (let at = 0; at < data.length; at += 4) count += {shade}.every((byte, place) => byte === data[at + place]);
                 return count > 60; }})()"
            ));
        }
        // It does not grow.
        let high = page.value("document.querySelector('#levels').clientHeight");
        page.drawn(40);
        assert_eq!(page.value("document.querySelector('#levels').clientHeight"), high);
        let size = page.value("parseFloat(getComputedStyle(document.querySelector('#verdict')).fontSize)");
        assert!(size.as_f64().unwrap() >= 32.0, "{size}");
        // Whether it sparks well is said, drawn, and in sight.
        let stacked =
            "[...document.querySelectorAll('#stack div')].reduce((sum, part) => sum + parseFloat(part.style.width), 0)";
        let stacked = page.value(stacked).as_f64().unwrap();
        assert!((stacked - 100.0).abs() <= 0.01, "{stacked}");
        page.until("/^Sparks well: [0-9]+ % of all pulses$/.test(document.querySelector('#verdict').innerText)");
        for (id, like) in [
            ("kept-what", "voltage, set point 65.0 V"),
            ("kept", "[0-9.]+ V"),
            ("hazard", "[0-9.]+ ± [0-9.]+ .ms"),
            ("sparks", "[0-9.]+ .ms(, missing now)?"),
            ("distance", "beyond its range"),
            ("age", "less than 1 ms ago"),
            ("notch", "50.00 Hz, fixed"),
            ("delayed", "[0-9]{3,} pulses ignited in [0-9.]+ s; pulses an octave"),
        ] {
            page.until(&format!("/^{like}$/.test(document.querySelector('#{id}').innerText)"));
            let old = page.value(&format!("document.querySelector('#{id}').classList.contains('old')"));
            assert_eq!(old, false, "{id}");
        }
        // Bars of the histogram, in the colour of the traces.
        let bars = "(() => { const canvas = document.querySelector('#delays'), g = canvas.getContext('2d');
            const probe = g.fillStyle; g.fillStyle = getComputedStyle(canvas).getPropertyValue('--trace').trim();
            const [r, gr, b] = g.fillStyle.match(/[0-9a-f]{2}/g).map((two) => parseInt(two, 16)); g.fillStyle = probe;
            const { data } = g.getImageData(0, 0, canvas.width, canvas.height); let count = 0;
            for (let at = 0; at < data.length; at += 4) count += data[at] === r && data[at + 1] === gr && data[at + 2] === b;
            return count; })()";
        assert!(page.value(bars).as_f64().unwrap() > 1000.0, "{:?}", page.value(bars));
        if wide == 1280 {
            let bottom = page.value("document.querySelector('#gap').getBoundingClientRect().bottom + scrollY");
            assert!(bottom.as_f64().unwrap() <= 800.0, "it does not fit a screen of 1280 by 800: {bottom}");
        }
        page.picture(name);
        // Without pulses nothing of that is of now.
        page.click("#stop");
        for id in ["hazard", "sparks", "distance", "age", "kept"] {
            page.until(&format!("/at [0-9:]{{8}}$/.test(document.querySelector('#{id}').innerText)"));
        }
        page.until("/^No pulses now. At [0-9:]{8}: /.test(document.querySelector('#verdict').innerText)");
    }
}

#[test]
fn the_scope_records_an_erosion() {
    for (wide, dark, name) in [(1280, false, "scope-light"), (800, true, "scope-dark")] {
        let rig = Rig::new();
        let desk = Desk::new(&rig.connection());
        let Some(mut page) = Browser::at(&desk, wide, dark) else { return };
        page.bore(0.5);
        page.view("scope");
        page.click("#slow");
        page.click("#arm");
        page.until("document.querySelector('#recorded').innerText === '256 samples, one every 1 ms.'");
        // In one pane, chosen by their names and units.
        page.until("document.querySelectorAll('#records canvas').length === 1");
        let chosen = page
            .value("[...document.querySelectorAll('#record [name=signals]')].map((field) => field.value).join('; ')");
        assert_eq!(
            chosen,
            "Gap.Voltage, V; Gap.Setpoint, V; Position actual value, counts; Path queue.Signed feed, um/s"
        );
        let captions = page.text("#records");
        assert!(captions.contains("Gap.Voltage, V") && captions.contains("um/s"), "{captions}");
        let drawn = "[...document.querySelectorAll('#records canvas')].every((canvas) => canvas.width > 100
            && canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some((byte) => byte))";
        page.until(drawn);
        page.picture(name);
        let text = page.download("#scope-csv", "scope-node-1.csv");
        assert_eq!(text.lines().count(), 257, "{text}");
        assert!(text.lines().skip(1).all(|line| line.split(',').nth(2) == Some("65")), "the set point: {text}");
        page.value("document.querySelector('#record [name=signals]').value = '1008'");
        page.click("#arm");
        page.until("document.querySelector('#scope-said').innerText.startsWith('1008: must be an object')");
        assert_eq!(page.text("#recorded"), "256 samples, one every 1 ms.", "the record before stays");
        zoomed(&mut page);
        // A record that was saved is shown again; what is none says why.
        let open = |page: &mut Browser, name: &str, text: &str| {
            page.value(&format!(
                "(() => {{ const all = new DataTransfer(); all.items.add(new File([{}], '{name}'));
                 const field = document.querySelector('#scope-open'); field.files = all.files; field.onchange({{ target: field }}); }})()",
                json!(text)
            ));
        };
        open(&mut page, "saved.csv", &text);
        page.until("document.querySelector('#recorded').innerText === '256 samples of saved.csv.'");
        page.until("document.querySelector('#records').innerText.includes('Gap.Voltage, V')");
        open(&mut page, "comma.csv", "time [ms],\"Gap senses.Hazard, standard deviation [%]\"\n0,1\n1,2\n");
        page.until("document.querySelector('#records').innerText.includes('Gap senses.Hazard, standard deviation, %')");
        open(&mut page, "saved.csv", &text);
        page.until("document.querySelector('#recorded').innerText === '256 samples of saved.csv.'");
        open(&mut page, "broken.csv", "time [ms],a [V]\n0,1\n1,x\n");
        page.until("document.querySelector('#scope-said').innerText === 'broken.csv: line 3: must have 2 numbers'");
        assert_eq!(page.text("#recorded"), "256 samples of saved.csv.");
    }
}

#[test]
fn the_page_shows_servo_ticks_around_a_fault_and_what_the_head_has_kept_of_it() {
    for (dark, name) in [(false, "fast-light"), (true, "fast-dark")] {
        let rig = Rig::new();
        let desk = Desk::new(&rig.connection());
        let Some(mut page) = Browser::at(&desk, 1280, dark) else { return };
        page.bore(0.5);
        page.view("scope");
        page.until("document.querySelectorAll('#ticks input:checked').length === 8");
        assert_eq!(page.text("#span"), "25.6 ms", "that is how much fits");
        assert!(page.value("document.querySelector('#ticks input:not(:checked)').disabled").as_bool().unwrap());
        page.value("document.querySelector('#record-fast [name=trigger]').value = 'fault'");
        page.click("#arm-fast");
        page.until("document.querySelector('#recorded').innerText.startsWith('Waiting')");
        // The head records what comes before the fault, 12.8 ms, while it says twice more where it is.
        for _ in 0..2 {
            let place = page.value("document.querySelector('#position').textContent");
            page.until(&format!("document.querySelector('#position').textContent !== {place}"));
        }
        rig.happen("stop.open", 1.0);
        page.until(
            "document.querySelector('#recorded').innerText === '512 samples, one every 0.05 ms. Begun by: fault: emergency stop.'",
        );
        // A pane a unit, and the states above them.
        page.until("document.querySelectorAll('#records canvas').length === 6");
        for caption in
            ["gap voltage, V", "set point, mm", "following error, um", "duty, %", "current, mA", "velocity, mm/s"]
        {
            assert!(page.text("#records").contains(caption), "{caption}: {}", page.text("#records"));
        }
        page.picture(name);
        let text = page.download("#scope-csv", "scope-node-1.csv");
        let times: Vec<&str> = text.lines().skip(1).map(|line| line.split(',').next().unwrap()).collect();
        assert_eq!((times[0], times[256], times.len()), ("-12.8", "0", 512));
        // By itself, and without command.
        page.click("#snapshot");
        page.until(
            "/^[0-9]+ samples, one every 2 ms. Begun by: fault: emergency stop.$/.test(document.querySelector('#recorded').innerText)",
        );
        page.picture(&format!("{name}-fault"));
    }
}

/// Drags a tenth of the width of the record: it is shown that much larger; a double click shows all of it. A click is a mark, from
/// which differences are measured.
fn zoomed(page: &mut Browser) {
    page.value("document.querySelector('#records').scrollIntoView()");
    let place = page.value(
        "(() => { const at = document.querySelector('#records .u-over').getBoundingClientRect();
         return [at.left, at.top, at.width, at.height]; })()",
    );
    let [left, top, width, height]: [f64; 4] = std::array::from_fn(|side| place[side].as_f64().unwrap());
    let mouse = |page: &mut Browser, kind: &str, share: f64, clicks: i32| {
        let (x, y) = (left + share * width, top + 0.5 * height);
        let button = if kind == "mouseMoved" && clicks == 0 { "none" } else { "left" };
        page.call(
            "Input.dispatchMouseEvent",
            json!({ "type": kind, "x": x, "y": y, "button": button, "clickCount": clicks, "buttons": i32::from(button == "left") }),
        );
    };
    let seen = "document.querySelector('#records .u-legend').innerText";
    let at = |page: &mut Browser, share: f64| -> f64 {
        page.value(&format!(
            "document.querySelector('#records .u-over').dispatchEvent(new MouseEvent('mousemove',
            {{ clientX: {}, clientY: {}, bubbles: true }}))",
            left + share * width,
            top + 0.5 * height
        ));
        let text = page.value("new Promise((done) => setTimeout(() => done(document.querySelector('#records .u-series:first-child .u-value').textContent), 50))");
        text.as_str().unwrap().trim_end_matches(" ms").parse().unwrap()
    };
    let before = at(page, 0.9) - at(page, 0.1);
    assert!((before - 204.0).abs() < 8.0, "{before}");
    mouse(page, "mousePressed", 0.4, 1);
    mouse(page, "mouseMoved", 0.45, 1);
    mouse(page, "mouseMoved", 0.5, 1);
    mouse(page, "mouseReleased", 0.5, 1);
    page.drawn(3);
    let zoomed = at(page, 0.9) - at(page, 0.1);
    assert!((zoomed - 20.4).abs() < 3.0, "{zoomed}: {}", page.value(seen));
    for count in [1, 2] {
        mouse(page, "mousePressed", 0.5, count);
        mouse(page, "mouseReleased", 0.5, count);
    }
    page.drawn(3);
    let whole = at(page, 0.9) - at(page, 0.1);
    assert!((whole - 204.0).abs() < 8.0, "{whole}");
    mouse(page, "mousePressed", 0.2, 1);
    mouse(page, "mouseReleased", 0.2, 1);
    at(page, 0.6);
    page.until("/^From the mark: .10[0-9] ms; Gap.Voltage [+-][0-9.]+ V;/.test(document.querySelector('#records-note').innerText)");
}

#[test]
fn a_place_with_a_hole_is_asked_about_in_the_page() {
    for (wide, dark, name) in [(1280, false, "asks-light"), (800, true, "asks-dark")] {
        let rig = Rig::new();
        let desk = Desk::new(&rig.connection());
        let Some(mut page) = Browser::at(&desk, wide, dark) else { return };
        page.bore(0.002);
        page.until("document.querySelector('#doing').innerText.startsWith('Bored: ')");
        assert_eq!(page.value("document.querySelector('#asks').hidden"), true);
        let deepest = rig.truth().deepest;
        page.click("#begin");
        page.until("!document.querySelector('#asks').hidden");
        let asks = page.text("#asks");
        assert!(asks.contains("a hole was begun: its surface is at 1.99"), "{asks}");
        assert_eq!((rig.truth().state, rig.truth().deepest), (State::Disabled, deepest), "nothing has moved");
        page.picture(name);
        page.value("document.querySelector('[name=depth]').value = 0.004");
        page.click("#continue");
        page.until("document.querySelector('#doing').innerText.includes(' of 0.004 mm in ')");
        let surface: f64 = asks.split("surface is at ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        let deep = rig.truth().deepest - (surface * 1e3).round() as i64;
        assert!((4..10).contains(&deep), "from the first surface: {deep} um");
        assert_eq!(page.value("document.querySelector('#asks').hidden"), true);
    }
}

#[test]
fn what_is_not_measured_now_is_grey_and_says_of_when_it_is() {
    for (wide, dark, name) in [(1280, false, "old-light"), (800, true, "old-dark")] {
        let mut rig = Rig::new();
        let desk = Desk::new(&rig.connection());
        let Some(mut page) = Browser::at(&desk, wide, dark) else { return };
        let old = |id: &str, begins: &str| {
            format!(
                "document.querySelector('#{id}').classList.contains('old')
                 && /^{begins}[^]*at [0-9:]{{8}}$/.test(document.querySelector('#{id}').innerText)"
            )
        };
        let live = |id: &str| format!("!document.querySelector('#{id}').classList.contains('old')");
        page.bore(0.5);
        for id in ["gap-now", "feed", "position", "state"] {
            page.until(&live(id));
        }
        page.view("heads");
        page.until("document.querySelector('#now-1').innerText.startsWith('eroding, at 2.')");
        // Disabled, pulses off: neither gap nor feed are measured, and the position is. The depth is that of the hole.
        page.view("run");
        page.click("#stop");
        page.until("document.querySelector('#state').innerText === 'disabled'");
        for (id, begins) in [("gap-now", "[0-9.]+ V"), ("feed", "-?[0-9]+ um.s")] {
            page.until(&old(id, begins));
        }
        assert_eq!(page.value(&live("position")), true);
        page.until("/^-?[0-9.]+ mm$/.test(document.querySelector('#depth').innerText)");
        page.picture(&format!("{name}-disabled"));
        page.value("document.querySelector('[name=depth]').value = 0.5");
        page.click("#begin");
        page.until("!document.querySelector('#asks').hidden");
        page.click("#continue");
        page.until("document.querySelector('#state').innerText === 'eroding'");
        page.until(&live("gap-now"));
        // The bus is gone.
        rig.pull();
        for (id, begins) in
            [("state", "eroding"), ("gap-now", "[0-9.]+ V"), ("position", "[0-9.]+ mm"), ("now-1", "eroding")]
        {
            if id == "now-1" {
                page.picture(name);
                page.view("heads");
            }
            page.until(&old(id, begins));
        }
        page.picture(&format!("{name}-heads"));
    }
}

#[test]
fn the_escape_key_stops_the_head_from_any_view() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.bore(0.5);
    page.view("settings");
    page.key("Escape", 27, "");
    page.until("document.querySelector('#state').innerText === 'disabled'");
    let truth = rig.truth();
    assert_eq!((truth.state, truth.pulses), (State::Disabled, false));
}

#[test]
fn escape_in_a_text_field_takes_back_what_was_typed_and_enter_moves_nothing() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.view("run");
    page.command();
    for (view, field) in [("run", "#bore [name=depth]"), ("motor", "#identify [name=at]"), ("motor", "#tune [name=at]")]
    {
        page.view(view);
        page.value(&format!("document.querySelector('{field}').focus()"));
        page.key("1", 49, "1");
        page.key("Enter", 13, "\r");
        page.until(&format!("document.querySelector('{field}').value.includes('1')"));
        // The next request is answered after whatever Enter has asked for.
        page.until("document.activeElement === document.body");
        assert_eq!(page.value("document.querySelector('#in-progress').hidden"), true, "{field}");
        assert_eq!(rig.truth().state, State::Disabled, "{field}");
    }
    page.view("run");
    page.value("document.querySelector('#bore [name=depth]').value = '0.5'");
    page.click("#begin");
    rig.until(|truth| truth.state == State::Eroding);
    // Another page watches: its search is no STOP.
    let Some(mut watches) = Browser::at(&desk, 1280, false) else { return };
    watches.view("settings");
    watches.value("document.querySelector('#search').focus()");
    watches.key("g", 71, "g");
    watches.until("document.querySelector('#search').value === 'g'");
    watches.key("Escape", 27, "");
    watches.until("document.querySelector('#search').value === '' && document.activeElement === document.body");
    let truth = rig.truth();
    assert!(truth.pulses && truth.state == State::Eroding, "{truth:?}");
    watches.key("Escape", 27, "");
    rig.until(|truth| truth.state == State::Disabled && !truth.pulses);
}

#[test]
fn run_says_whose_hole_it_is_acts_on_that_head_and_stop_stops_both() {
    let rig = Rig::with_second(2);
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.until("document.querySelectorAll('#found button').length === 2");
    page.value("document.querySelectorAll('#found button')[1].click()");
    page.until("document.querySelector('#head').innerText === 'node 2'");
    page.bore(0.5);
    rig.until_of(1, |truth| truth.state == State::Eroding);
    page.until("document.querySelector('#whose').hidden");
    page.view("heads");
    page.value("document.querySelectorAll('#found button')[0].click()");
    page.until("document.querySelector('#head').innerText === 'node 1'");
    page.view("run");
    page.until("document.querySelector('#in-progress').innerText.startsWith('In progress: a hole of node 2.')");
    page.until("document.querySelector('#whose').innerText === 'These buttons act on node 2; chosen is node 1.'");
    page.picture("run-of-another-head");
    page.click("[data-request=pause]");
    rig.until_of(1, |truth| truth.state == State::HoldingPosition && !truth.pulses);
    page.click("[data-request=go]");
    rig.until_of(1, |truth| truth.state == State::Eroding && truth.pulses);
    page.key("Escape", 27, "");
    rig.until_of(1, |truth| truth.state == State::Disabled && !truth.pulses);
    page.until("document.querySelector('#notice').innerText.includes('node 1: the head is disabled, pulses are off; node 2: the head is disabled')");
    page.until("document.querySelector('#in-progress').hidden && document.querySelector('#whose').hidden");
    page.picture("stopped-two-heads");
}

#[test]
fn a_browser_that_is_killed_ends_in_the_heads_own_retreat() {
    let rig = Rig::new();
    let desk = Desk::with(&rig.connection(), &["--unwatched", "retreat"]);
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.bore(0.5);
    drop(page);
    let truth = rig.until(|truth| truth.fault.is_some() && !truth.reacting);
    assert_eq!((truth.fault, truth.pulses), (Some(Fault::HostSilent), false));
}

#[test]
fn a_hole_goes_on_through_reloads_and_a_page_that_was_asleep_and_commands_again_by_itself() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.bore(0.5);
    for _ in 0..3 {
        let made = rig.truth().made.spark;
        page.reload();
        page.until("document.querySelector('#command').innerText === 'Release command'");
        page.until("document.querySelector('#state').innerText === 'eroding'");
        page.until("document.querySelector('#target').textContent.trim() === 'of 0.500 mm;'");
        rig.until(|truth| truth.made.spark > made + 1000);
    }
    // Longer than a session may be silent, shorter than the time until a pause.
    page.value("(() => { const end = Date.now() + 3000; while (Date.now() < end); })()");
    page.until("document.querySelector('#command').innerText === 'Release command'");
    let truth = rig.truth();
    assert_eq!((truth.state, truth.pulses, truth.fault), (State::Eroding, true, None));
    // It commands in truth.
    page.click("[data-request=pause]");
    rig.until(|truth| !truth.pulses && truth.state == State::HoldingPosition);
    page.click("#stop");
}

#[test]
fn a_hole_whose_browser_was_killed_is_gone_on_with_by_one_click_in_another() {
    let rig = Rig::new();
    let desk = Desk::with(&rig.connection(), &["--unwatched-after", "2"]);
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.bore(0.5);
    drop(page);
    let truth = rig.until(|truth| !truth.pulses && truth.position < 1850);
    assert_eq!(truth.fault, None);
    for (wide, dark, name) in [(1280, false, "paused-light"), (800, true, "paused-dark")] {
        let Some(mut page) = Browser::at(&desk, wide, dark) else { return };
        page.until("!document.querySelector('#paused').hidden");
        page.view("run");
        page.picture(name);
        assert!(!rig.truth().pulses, "not by itself");
        if dark {
            page.click("#go-on");
            page.until("document.querySelector('#state').innerText === 'eroding'");
            page.until("document.querySelector('#paused').hidden");
            let truth = rig.truth();
            assert_eq!((truth.pulses, truth.fault), (true, None));
            page.click("#stop");
        }
    }
}

#[test]
fn a_bus_that_was_gone_is_found_again_and_the_page_says_since_when() {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let mut rig = Rig::at(&port);
    let desk = Desk::new(&rig.connection());
    let Some(mut page) = Browser::at(&desk, 1280, false) else { return };
    page.until("document.querySelector('#state').innerText === 'disabled'");
    rig.pull();
    page.until("/^The bus has been gone since [0-9:]{8} .[1-9][0-9]* s.. It is tried again/.test(document.querySelector('#lost').innerText)");
    page.until("document.querySelector('#state').classList.contains('old')");
    // Also in a page that comes later.
    page.reload_without_heads();
    page.until("document.querySelector('#lost').innerText.startsWith('The bus has been gone since ')");
    drop(rig);
    let rig = Rig::at(&port);
    page.until("/^The bus is there. It was gone from [0-9:]{8} to [0-9:]{8}/.test(document.querySelector('#notice').innerText)");
    page.until("document.querySelector('#lost').hidden && document.querySelector('#state').innerText === 'disabled'");
    page.bore(0.002);
    page.until("document.querySelector('#doing').innerText.startsWith('Bored: ')");
    assert_eq!(rig.truth().fault, None);
}

#[test]
fn every_view_fits_light_and_dark_and_has_stop_in_sight() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut grounds = Vec::new();
    for (wide, dark) in [(1280, false), (800, true)] {
        let Some(mut page) = Browser::at(&desk, wide, dark) else { return };
        for view in ["heads", "bring-up", "run", "gap", "scope", "settings", "log"] {
            page.view(view);
            if view == "settings" {
                page.until("document.querySelectorAll('#list tr').length > 100");
            }
            let over = page.value("document.documentElement.scrollWidth - innerWidth").as_i64().unwrap();
            assert!(over <= 0, "{view}, {wide} wide: {over} pixels too wide");
            let stop = page.value("(() => { const at = document.querySelector('#stop').getBoundingClientRect();
                return at.top >= 0 && at.left >= 0 && at.right <= innerWidth && at.bottom <= innerHeight && at.width > 40; })()");
            assert_eq!(stop, true, "{view}, {wide} wide: STOP is out of sight");
            // Also where a long list has been scrolled through.
            page.value("scrollTo(0, document.body.scrollHeight)");
            let still = page.value("document.querySelector('#stop').getBoundingClientRect().top >= 0");
            assert_eq!(still, true, "{view}, {wide} wide: STOP scrolls away");
        }
        grounds.push(page.value("getComputedStyle(document.body).backgroundColor"));
    }
    assert_ne!(grounds[0], grounds[1], "light and dark");
}
