// The page of the desk: views over one WebSocket. What a head means comes in words and units from the program.

import { Histogram, Trace } from "./trace.js";

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") ?? "";
const traces = {
  depth: new Trace($("trace-depth"), 0.05),
  gap: new Trace($("trace-gap"), 20),
  feed: new Trace($("trace-feed"), 20),
};

const histogram = new Histogram($("delays"));

let socket = null;
let me = 0, commander = null, node = null;
let asked = new Map(), next = 1;
let again = 0, lines = [], file = null, differences = null;
let surface = null, drawn = false, records = [];
// What was measured last, and when, by the id of its place.
const measured = new Map();
// Places of what a head measures.
const LIVE = ["state", "position", "depth", "gap-now", "wanted", "feed", "time", "left", "shorts", "doing",
  "gap-volts", "gap-feed", "looks", "gap-depth", "gap-left", "kept", "hazard", "sparks", "distance", "age", "notch", "delayed"];

// Puts what is measured now in its place. Where nothing is (null) the last value stays, grey, and says of when it is.
function put(id, text) {
  const place = $(id);
  if (!place) return;
  if (text !== null) {
    measured.set(id, { text, at: new Date() });
    place.textContent = text;
  } else if (!place.classList.contains("old")) {
    const last = measured.get(id);
    place.textContent = last ? `${last.text}, at ${clock(last.at)}` : "-";
  }
  place.classList.toggle("old", text === null);
}

// Says what is no measurement.
function tell(id, text) {
  measured.delete(id);
  $(id).classList.remove("old");
  $(id).textContent = text;
}

function clock(date) {
  return date.toLocaleTimeString("en-GB");
}

// Nothing of a head is measured any more; of all heads without a number.
function gone(from = null) {
  if (from === null || from === node) {
    for (const id of LIVE.filter((id) => measured.has(id))) put(id, null);
    for (const id of ["ladder", "shares", "stack", "verdict"]) $(id).classList.add("old");
    for (const trace of Object.values(traces)) trace.until ??= clock(new Date());
    draw();
  }
  for (const place of document.querySelectorAll("[id^=now-]")) {
    if (from === null || place.id === `now-${from}`) put(place.id, null);
  }
}

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}/session?token=${encodeURIComponent(token)}`);
  socket.onmessage = (message) => take(JSON.parse(message.data));
  socket.onclose = () => {
    lost("No connection to the program, or it refuses this page. A head that was boring retreats by itself.");
    commander = null;
    gone();
    for (const { fail } of asked.values()) fail(new Error("connection to the program lost"));
    asked.clear();
    show();
    setTimeout(connect, 1000);
  };
}

function ask(what) {
  return new Promise((done, fail) => {
    if (socket.readyState !== WebSocket.OPEN) return fail(new Error("no connection to the program"));
    asked.set(next, { done, fail });
    socket.send(JSON.stringify({ id: next++, ...what }));
  });
}

// A button's request: what is refused is shown.
function want(what) {
  return ask(what).catch((error) => {
    say(error.message);
    throw error;
  });
}

function take(message) {
  if (message.beat) {
    // Not by a timer: those of a page in the background are slowed down.
    if (commander === me) socket.send(JSON.stringify({ id: 0, do: "beat" }));
  } else if (message.id) {
    const waiting = asked.get(message.id);
    asked.delete(message.id);
    if (message.error !== undefined) waiting?.fail(Object.assign(new Error(message.error), { asks: message.asks }));
    else waiting?.done(message.ok);
  } else if (message.welcome) {
    const { you, log, bus } = message.welcome;
    me = you;
    commander = message.welcome.commander;
    $("bus").textContent = bus;
    $("lost").hidden = true;
    $("events").replaceChildren();
    log.forEach(event);
    show();
    scan();
    ask({ do: "signals" }).then((all) => $("signals").replaceChildren(...all.map(([address, key]) => new Option(key, address))), () => {});
  } else if ("commander" in message) {
    commander = message.commander;
    show();
  } else if (message.sample) {
    does(message.sample);
    if (message.sample.node === node) sample(message.sample);
  } else if (message.progress) {
    does(message.progress.sample);
    if (message.progress.sample.node === node) progress(message.progress);
  } else if (message.gap) {
    if (message.gap.node === node) gap(message.gap);
  } else if (message.bring_up) {
    if (message.bring_up.sample.node === node) bring_up(message.bring_up);
  } else if (message.brought_up) {
    brought_up(message.brought_up);
  } else if (message.event) {
    event(message.event);
  } else if (message.ended) {
    ended(message.ended);
  } else if (message.gone) {
    gone(message.gone.node);
    if (message.gone.node === node) lost(message.gone.why);
  } else if (message.bus) {
    // It was not there, or has come back.
    $("lost").hidden = true;
    scan();
  } else if (message.error) {
    say(message.error);
  }
}

function lost(why) {
  $("lost").textContent = why;
  $("lost").hidden = false;
}

function say(text) {
  $("said").textContent = text;
  tell("doing", text);
  $("up-doing").textContent = text;
}

function show() {
  const mine = commander === me;
  $("command").textContent = mine ? "Release command" : "Take command";
  $("command").disabled = !mine && commander !== null;
  $("session").textContent = mine ? "This session has command."
    : commander === null ? "No session has command." : `Session ${commander} has command; this session watches.`;
  document.body.classList.toggle("watching", !mine);
  const commands = "#bore *, #asks button, [data-request], #up-begin, #up-check, #up-report, #arm, #reset, #save, #import, #list input, #list select";
  for (const button of document.querySelectorAll(commands)) {
    button.disabled = !mine || node === null;
  }
}

async function scan() {
  $("found").replaceChildren(item("li", "Scanning ..."));
  clearTimeout(again);
  const found = await ask({ do: "heads" }).catch((error) => lost(error.message)) ?? [];
  const list = found.map(({ node: id, identity, why_not }) => {
    const line = item("li", "");
    if (!identity) {
      line.append(why_not);
      return line;
    }
    const choose = item("button", `Node ${id}`);
    choose.onclick = () => choose_head(id, identity);
    const place = item("span", "");
    place.id = `now-${id}`;
    line.append(choose, ` ${identity.name}, hardware ${identity.hardware}, software ${identity.software}, serial number ${identity.serial}: `, place);
    return line;
  });
  $("found").replaceChildren(...list.length ? list : [item("li", "No node answers: check power and bit rate of the heads.")]);
  const heads = found.filter((one) => one.identity);
  // One that is switched on later is found without a hand.
  if (!heads.length) again = setTimeout(scan, 3000);
  for (const one of heads) does(one.now);
  if (heads.length && !heads.some((one) => one.node === node)) choose_head(heads[0].node, heads[0].identity);
}

// What a head does, in the list of heads.
function does({ node: id, state, homed, position_mm, fault_number, fault }) {
  put(`now-${id}`, `${state}, ${homed ? `at ${position_mm.toFixed(3)} mm` : "not homed"}${fault_number ? `; ${fault}` : ""}`);
}

function choose_head(id, identity) {
  if (node === id) return;
  node = id;
  lines = [];
  differences = null;
  surface = null;
  $("asks").hidden = true;
  for (const id of LIVE.filter((id) => id !== "doing")) {
    measured.delete(id);
    put(id, null);
  }
  for (const id of ["left", "gap-left", "gap-depth"]) $(id).textContent = "no hole in progress";
  $("head").textContent = `node ${id}`;
  $("head").title = `${identity.name}, serial number ${identity.serial}`;
  Object.values(traces).forEach((trace) => trace.clear());
  show();
  if (location.hash === "#settings") read();
}

function sample(now) {
  put("state", now.state);
  $("state").dataset.state = now.state;
  $("fault").hidden = now.fault_number === 0;
  $("fault").firstElementChild.textContent = `Fault: ${now.fault}`;
  put("position", now.homed ? `${now.position_mm.toFixed(3)} mm` : "not homed");
  const depth = surface === null ? null : now.position_mm - surface;
  put("depth", depth === null ? null : `${depth.toFixed(3)} mm`);
  put("gap-now", now.gap_v === null ? null : `${now.gap_v.toFixed(1)} V`);
  put("wanted", `${now.setpoint_v.toFixed(1)} V`);
  $("lost").hidden = true;
  put("feed", now.feed_um_s === null ? null : `${now.feed_um_s.toFixed(0)} um/s`);
  put("shorts", now.shorts);
  const at = performance.now();
  for (const trace of Object.values(traces)) trace.until = null;
  traces.depth.add(at, depth);
  traces.gap.add(at, now.gap_v);
  traces.gap.target = now.setpoint_v;
  traces.feed.add(at, now.feed_um_s);
  if (!drawn) requestAnimationFrame(draw);
  drawn = true;
}

function draw() {
  drawn = false;
  if (!$("run").hidden) Object.values(traces).forEach((trace) => trace.draw());
}

function progress(run) {
  $("asks").hidden = true;
  if (run.depth_mm !== null && surface === null) {
    surface = run.sample.position_mm - run.depth_mm;
    traces.depth.clear();
  }
  if (run.depth_mm === null) surface = null;
  sample(run.sample);
  traces.depth.target = run.depth_mm === null ? null : run.target_mm;
  put("doing", run.said);
  $("progress").value = Math.max(0, (run.depth_mm ?? 0) / run.target_mm);
  put("time", run.seconds > 0 ? `${run.seconds.toFixed(0)} s` : null);
  for (const id of ["left", "gap-left"]) {
    if (run.left_s !== null) put(id, `${run.left_s.toFixed(0)} s`);
    else if (measured.has(id)) put(id, null);
    else $(id).textContent = "not known";
  }
  if (run.depth_mm === null) $("gap-depth").textContent = "surface not known";
  else put("gap-depth", run.depth_mm < 0 ? `${(-run.depth_mm).toFixed(3)} mm above the work; target ${run.target_mm} mm`
    : `${run.depth_mm.toFixed(3)} of ${run.target_mm} mm`);
}

// A number with at least three digits.
function digits(number) {
  const exact = Math.abs(number) < 10 ? 2 : Math.abs(number) < 100 ? 1 : 0;
  return number.toFixed(exact);
}

function gap({ volts, quality, ladder, verdict, good, shares, no_pulse_percent, levels, pulses, pulse_count, feed_um_s, senses, controlled, delays }) {
  if ($("gap").hidden) return;
  put("gap-volts", volts === null ? null : `${volts.toFixed(1)} V, ${quality}`);
  if (volts === null) $("gap-quality").textContent = `: ${quality}, not valid now`;
  else $("gap-quality").textContent = "";
  put("gap-feed", feed_um_s === null ? null : `${feed_um_s.toFixed(0)} um/s`);
  for (const id of ["ladder", "shares", "stack", "verdict"]) $(id).classList.remove("old");
  $("verdict").textContent = verdict;
  $("verdict").classList.toggle("good", good === true);
  $("verdict").classList.toggle("poor", good === false);
  const most = 1.1 * Math.max(1, volts ?? 0, ...ladder.map((rung) => rung.volts ?? 0));
  $("ladder").replaceChildren(...ladder.map((rung) => bar(rung.what, rung.from, rung.volts, most, volts)));
  $("shares").replaceChildren(...shares.map((share) => bar(share.what, "", share.percent, 100, null, share.what)));
  const order = ["spark", "open", "uncertain", "arc", "short"];
  const stacked = shares.filter((share) => share.percent > 0).sort((a, b) => order.indexOf(a.what) - order.indexOf(b.what));
  const all = stacked.reduce((sum, share) => sum + share.percent, 0);
  $("stack").replaceChildren(...stacked.map((share) => {
    const part = item("div", "");
    part.className = share.what;
    part.style.width = `${100 * share.percent / all}%`;
    part.title = `${share.what} ${share.percent.toFixed(1)} %`;
    return part;
  }));
  $("gap-levels").textContent = levels ?? "";
  $("gap-levels").hidden = levels === null;
  put("looks", !pulses ? "There were no pulses in the last 0.2 s."
    : `Of ${pulse_count === null ? "all" : `all ${pulse_count}`} pulses since the last look, five times a second, as the head classifies them.`
    + (no_pulse_percent > 0 ? ` ${no_pulse_percent} % of the milliseconds had none.` : ""));
  sensed(senses, controlled);
  delayed(delays);
}

// What the head senses beside the voltage; null of a head that does not.
function sensed(senses, controlled) {
  const { hazard_per_s = null, hazard_deviation_per_s = null, sparks_per_s = null, distance_um = null, pulse_age_ms = null } = senses ?? {};
  put("hazard", hazard_per_s === null ? null : `${digits(hazard_per_s / 1000)} ± ${digits(hazard_deviation_per_s / 1000)} /ms`);
  put("sparks", sparks_per_s === null ? null : `${digits(sparks_per_s / 1000)} /ms${senses.sparks_missing ? ", missing now" : ""}`);
  put("distance", distance_um === null ? null : senses.distance_beyond ? "beyond its range" : `${distance_um.toFixed(1)} um`);
  put("age", pulse_age_ms === null ? null : pulse_age_ms < 1 ? "less than 1 ms ago" : `${pulse_age_ms} ms ago`);
  put("notch", senses === null ? null : `${senses.notch_hz.toFixed(2)} Hz, ${senses.notch_follows ? "follows the mains" : "fixed"}`);
  if (controlled === null) {
    $("kept-what").textContent = "voltage";
    return put("kept", null);
  }
  const { what, setpoint, now, unit, error_v } = controlled;
  $("kept-what").textContent = `${what}, set point ${setpoint.toFixed(1)} ${unit}`;
  // The error is not of the same instant; of a voltage, the difference says it.
  const error = what === "voltage" || error_v === null ? "" : `, gap error ${error_v > 0 ? "+" : ""}${error_v.toFixed(1)} V`;
  put("kept", now === null ? null : `${digits(now)} ${unit}${error}`);
}

// Ignition delays of the last second.
function delayed(delays) {
  const total = delays?.counts.reduce((sum, count) => sum + count, 0) ?? 0;
  put("delayed", total ? `${total} pulses ignited in ${delays.seconds.toFixed(1)} s; pulses an octave` : null);
  histogram.show(delays?.counts ?? [], delays?.ends_us ?? []);
}

// A row with a value as a bar, and a line across it.
function bar(what, from, value, most, mark, kind = null) {
  const row = item("tr", "");
  const name = item("td", what);
  if (from) name.append(item("small", from));
  const room = item("td", "");
  const shade = item("div", "");
  shade.className = "bar";
  if (kind) shade.classList.add(kind);
  shade.style.width = `${100 * Math.max(0, value ?? 0) / most}%`;
  room.append(shade);
  if (mark !== null) {
    const line = item("div", "");
    line.className = "mark";
    line.style.left = `${100 * Math.min(1, Math.max(0, mark) / most)}%`;
    room.append(line);
  }
  row.append(name, item("td", value === null ? "not known" : value.toFixed(1)), room);
  return row;
}

async function record(submit) {
  submit.preventDefault();
  const form = new FormData($("record"));
  const plan = {
    signals: form.getAll("signals").map((text) => text.trim()).filter((text) => text),
    every_ms: Number(form.get("every")),
    trigger: form.get("trigger"),
    level: Number(form.get("level")),
    wait_s: Number(form.get("wait")),
  };
  $("recorded").textContent = "Waiting for the trigger, or recording.";
  const done = await want({ do: "scope", node, plan }).catch((error) => {
    $("recorded").textContent = error.message;
    return null;
  });
  if (!done) return;
  const { every_ms, signals } = done.record;
  const drawn = signals.map(({ key, unit, values }) => {
    const figure = item("figure", ""), canvas = item("canvas", "");
    figure.append(item("figcaption", unit ? `${key}, ${unit}` : key), canvas);
    const most = Math.max(...values.map(Math.abs), 1);
    return { figure, values, trace: new Trace(canvas, 1e-3 * most) };
  });
  records.forEach((trace) => trace.close());
  records = drawn.map(({ trace }) => trace);
  $("records").replaceChildren(...drawn.map(({ figure }) => figure));
  drawn.forEach(({ trace, values }) => trace.show(values, every_ms));
  $("recorded").textContent = `${signals[0].values.length} samples, one every ${every_ms} ms.`;
  save("scope-csv", `scope-node-${node}.csv`, "text/csv", done.csv);
  $("scope-file").hidden = false;
}

// Has a link save a text.
function save(id, name, type, text) {
  URL.revokeObjectURL($(id).href);
  $(id).href = URL.createObjectURL(new Blob([text], { type }));
  $(id).download = name;
}

function ended({ outcome, failed }) {
  surface = null;
  for (const id of ["depth", "gap-depth", "time", "left", "gap-left"]) put(id, null);
  if (outcome) {
    tell("doing", `${outcome.reached ? "Bored" : "Ended"}: electrode depth ${outcome.depth_mm.toFixed(3)} of ${outcome.target_mm} mm`
      + ` in ${outcome.seconds.toFixed(0)} s; the hole is deeper by the gap width. ${outcome.why}.`);
    $("progress").value = outcome.reached ? 1 : Math.max(0, outcome.depth_mm / outcome.target_mm);
  } else {
    tell("doing", failed);
  }
}

const VERDICTS = { not_seen: "not seen", passed: "passed", failed: "FAILED" };

function bring_up({ doing, checks }) {
  $("up-doing").textContent = doing;
  $("up-files").hidden = true;
  up_list(checks);
}

function up_list(checks) {
  $("up-list").replaceChildren(...checks.map((check) => {
    const row = item("tr", "");
    row.className = check.verdict;
    const what = item("td", check.what);
    if (check.verdict !== "passed" && check.advice) what.append(item("small", check.advice));
    const value = check.value === null ? "-" : `${check.value} ${check.unit}`.trim();
    row.append(item("td", check.step), what, item("td", value), item("td", check.allowed), item("td", VERDICTS[check.verdict]));
    return row;
  }));
}

function brought_up({ name, markdown, report, failed }) {
  $("up-doing").textContent = failed ?? (report.passed ? "All checks passed." : "Ended; not all checks passed.");
  if (failed) return;
  up_list(report.checks);
  save("up-markdown", `${name}.md`, "text/markdown", markdown);
  save("up-json", `${name}.json`, "application/json", JSON.stringify(report, null, 2));
  $("up-files").hidden = false;
}

function event({ unix_ms, node: from, what }) {
  const line = item("li", "");
  line.append(item("time", new Date(unix_ms).toLocaleTimeString("en-GB")), ` node ${from}: ${what}`);
  $("events").prepend(line);
  while ($("events").childElementCount > 1000) $("events").lastElementChild.remove();
}

async function read() {
  if (node === null) return;
  lines = await want({ do: "settings", node });
  list();
}

function list() {
  const word = $("search").value.toLowerCase();
  const other = new Map((differences ?? []).map((one) => [one.key, one]));
  $("file-column").hidden = differences === null;
  const rows = lines
    .filter((line) => differences === null || other.has(line.key))
    .filter((line) => !$("changed").checked || line.changed)
    .filter((line) => `${line.key} ${line.doc}`.toLowerCase().includes(word))
    .map((line) => {
      const row = item("tr", "");
      row.classList.toggle("changed", line.changed);
      const name = item("td", "");
      name.append(item("code", line.key), item("small", line.doc));
      const value = item("td", "");
      value.className = "value";
      value.append(field(line), ` ${line.unit}`);
      row.append(name, value);
      if (differences !== null) row.append(item("td", String(other.get(line.key).file)));
      row.append(item("td", `${line.allowed}; default ${line.default ?? "unknown"}`));
      return row;
    });
  $("list").replaceChildren(...rows);
  show();
}

function field(line) {
  const words = typeof line.value === "string" ? line.allowed.split(", ") : typeof line.value === "boolean" ? ["true", "false"] : null;
  const input = document.createElement(words ? "select" : "input");
  if (words) input.append(...words.map((word) => new Option(word, word)));
  input.value = String(line.value);
  input.setAttribute("aria-label", line.key);
  input.onchange = async () => {
    const written = await want({ do: "set", node, assignments: [`${line.key}=${input.value}`] }).catch(() => null);
    if (written) {
      $("said").textContent = `${line.key} = ${input.value}${written.check_again ? "; the guided check must pass again" : ""}`;
    }
    await read();
  };
  return input;
}

function item(name, text) {
  const element = document.createElement(name);
  element.textContent = text;
  return element;
}

function view() {
  const name = location.hash.slice(1) || "heads";
  for (const section of document.querySelectorAll("main > section")) section.hidden = section.id !== name;
  for (const link of document.querySelectorAll("nav a")) link.classList.toggle("here", link.hash === `#${name}`);
  if (name === "settings") read().catch(() => {});
  draw();
}

function stop() {
  if (node !== null) want({ do: "stop", node }).then((now) => say(now.stopped), () => {});
}

$("stop").onclick = stop;
addEventListener("keydown", (key) => {
  if (key.key === "Escape") {
    key.preventDefault();
    stop();
  }
}, true);
$("command").onclick = () => want({ do: "command", take: commander !== me }).catch(() => {});
$("reset").onclick = () => want({ do: "reset", node }).catch((error) => lost(error.message));
$("scan").onclick = scan;
// What is under the electrode is asked where a hole may have been begun there.
function bore(site) {
  const form = new FormData($("bore"));
  const number = (name) => (form.get(name) === "" ? null : Number(form.get(name)));
  surface = null;
  $("asks").hidden = true;
  const hole = { depth_mm: number("depth"), surface_mm: number("surface"), height_mm: number("height"), site };
  ask({ do: "bore", node, hole }).catch(({ message, asks }) => {
    if (!asks) return say(message);
    $("asks").firstElementChild.textContent = message;
    $("continue").hidden = !asks.begun;
    $("asks").hidden = false;
  });
}

$("bore").onsubmit = (submit) => {
  submit.preventDefault();
  bore(null);
};
$("continue").onclick = () => bore("begun");
$("new-surface").onclick = () => bore("new");
for (const button of document.querySelectorAll("[data-request]")) {
  button.onclick = () => want({ do: "request", request: button.dataset.request }).catch(() => {});
}
$("record").onsubmit = record;
$("up-begin").onclick = () => want({ do: "bring_up", node }).catch(() => {});
$("up-check").onclick = () => want({ do: "check", again: $("up-again").checked }).catch(() => {});
$("up-report").onclick = () => want({ do: "report" }).catch(() => {});
$("search").oninput = list;
$("changed").onchange = list;
$("read").onclick = () => {
  file = differences = null;
  $("import").hidden = true;
  read().catch(() => {});
};
$("save").onclick = () => want({ do: "save", node }).then(() => { $("said").textContent = "Settings saved in the head."; }, () => {});
$("export").onclick = () => {
  const link = document.createElement("a");
  link.href = `settings.toml?node=${node}&token=${encodeURIComponent(token)}`;
  link.download = `node-${node}.toml`;
  link.click();
};
$("compare").onchange = async (change) => {
  const [chosen] = change.target.files;
  if (!chosen) return;
  const text = await chosen.text();
  change.target.value = "";
  differences = await want({ do: "compare", node, text }).catch(() => null);
  file = differences?.length ? text : null;
  $("import").hidden = file === null;
  if (differences) $("said").textContent = differences.length ? `${differences.length} settings differ from ${chosen.name}.` : "No difference.";
  list();
};
$("import").onclick = async () => {
  const written = await want({ do: "import", node, text: file }).catch(() => null);
  if (!written) return;
  $("said").textContent = `${written.changed.length} settings changed${written.check_again ? "; the guided check must pass again" : ""}.`;
  $("read").onclick();
};
addEventListener("hashchange", view);
view();
show();
connect();
