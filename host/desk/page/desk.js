// The page of the desk: views over one WebSocket. What a head means comes in words and units from the program.

import { Bode, Chart, Histogram, Ladder, seen } from "./plots.js";

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") ?? "";

// Colours of the states, by their number (2000h:1): what moves without pulses, what erodes, what goes back, what waits, what is wrong.
const SHADES = { 3: "--seeking", 4: "--eroding", 5: "--retreating", 7: "--holding", 8: "--fault", 11: "--eroding", 13: "--jumping" };
const SEEKING = 3, AT_REST = [0, 2, 6], LED = [3, 4, 5, 11, 13];
let states = {};
const shade = (state) => SHADES[state] ?? (AT_REST.includes(state) ? "--idle" : "--moving");

// The last bore, as the program keeps it and as it goes on.
let bored = null;
const chart = new Chart($("chart"), [
  { height: () => tall(0.42), down: true, strip: true, ranges: { mm: depths },
    signals: [{ name: "Depth", unit: "mm", colour: "--trace", digits: 3 }, { name: "target", unit: "mm", colour: "--target", digits: 3, dash: [6, 4] }] },
  { height: () => tall(0.3), ranges: { V: volts },
    signals: [{ name: "Gap voltage", unit: "V", colour: "--trace" }, { name: "set point", unit: "V", colour: "--target", dash: [6, 4] }] },
  { height: () => tall(0.28), ranges: { "um/s": feeds }, signals: [{ name: "Feed", unit: "um/s", colour: "--trace", digits: 0 }] },
], { named: (state) => [states[state] ?? `state ${state}`, shade(state)], note: $("chart-note") });

// The plots end with the window, and are never too low to read.
function tall(share) {
  const room = innerHeight - ($("chart").getBoundingClientRect().top + scrollY) - 3 * 26 - 44;
  return Math.max(90, Math.floor(share * Math.max(330, room)));
}

// The scale of the hole: a way home does not make it a flat line.
function depths(u) {
  const deep = Math.max(bored?.target ?? 0, bored?.deepest ?? 0, 0.002);
  const whole = [-Math.max(0.06 * deep, 0.02), 1.06 * deep];
  if (!chart.zoom && chart.last === null) return whole;
  const [low, high] = seen(u, 1);
  if (low === null || high < whole[0]) return whole;
  const pad = Math.max(0.1 * (high - low), 0.001);
  return [Math.max(whole[0], low - pad), Math.min(whole[1], high + pad)];
}

function volts(u, min, max) {
  return [0, 1.1 * Math.max(max ?? 0, 20)];
}

function feeds(u) {
  // A seek is fast, and of no interest beside the feed in the hole.
  const [low, high] = seen(u, 1, (place) => bored?.points[place]?.[1] !== SEEKING);
  const [least, most] = [Math.min(low ?? 0, -20), Math.max(high ?? 0, 20)];
  return [1.1 * least, 1.1 * most];
}

const histogram = new Histogram($("delays")), levels_now = new Ladder($("levels"));
// Colours of the levels, from the open circuit down.
const RUNGS = ["--quiet", "--seeking", "--target", "--short"];
// Gap voltages of the last ten seconds, with their time.
let lately = [];

let socket = null;
let me = 0, commander = null, node = null;
let asked = new Map(), next = 1;
let again = 0, lines = [], file = null, differences = null;
let drawn = false, scope = null, kept = null;
let signals = [], events = [];
// What was typed in a setting and refused, and why.
const typed = new Map();
// When what is put was measured, if not now.
let measured_at = null;
// Since when there is no bus, ms since 1970. Since when this page has asked for command again.
let bus_lost = null, again_s = 30, retaken = false;
// Whether the head is homed, and a hole that waits in it is offered.
let homed = null, offered = false;
// The activity in progress, { node, what }: whose it is whichever head is chosen.
let run = null;
// Heads of the last scan: who they are, by node.
let heads = new Map();
// What was measured last, and when, by the id of its place.
const measured = new Map();
// Places of what a head measures.
const LIVE = ["state", "position", "jog-position", "depth", "gap-now", "wanted", "feed", "time", "left", "shorts", "doing",
  "row", "beside", "gap-volts", "gap-feed", "looks", "gap-depth", "gap-left", "kept", "hazard", "sparks", "distance", "age", "notch", "delayed"];

// Puts what is measured now in its place. Where nothing is (null) the last value stays, grey, and says of when it is.
function put(id, text) {
  const place = $(id);
  if (!place) return;
  if (text !== null) {
    measured.set(id, { text, at: measured_at ?? new Date() });
    place.textContent = text;
  } else if (!place.classList.contains("old")) {
    const last = measured.get(id);
    place.textContent = last?.text ?? "-";
    if (last) {
      const comma = item("span", ", "), when = item("small", `at ${clock(last.at)}`);
      comma.className = "comma";
      when.className = "when";
      place.append(comma, when);
    }
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
    $("state").style.removeProperty("background");
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
    bus_lost = null;
    lost("No connection to the program, or it refuses this page. The program pauses a hole that nobody commands; when the program is lost, the head retreats by itself.");
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

// A button's request: what is refused is shown in its view; without a view, below the header.
function want(what, view = null) {
  if (view) say(view, "");
  return ask(what).catch((error) => {
    if (view) say(view, error.message, true);
    else notice(error.message);
    throw error;
  });
}

function take(message) {
  if (message.beat) {
    // Not by a timer: those of a page in the background are slowed down.
    if (commander === me) {
      socket.send(JSON.stringify({ id: 0, do: "beat" }));
      keep_command();
    }
  } else if (message.id) {
    const waiting = asked.get(message.id);
    asked.delete(message.id);
    if (message.error !== undefined) waiting?.fail(Object.assign(new Error(message.error), { asks: message.asks }));
    else waiting?.done(message.ok);
  } else if (message.welcome) {
    const { you, log, bus } = message.welcome;
    me = you;
    commander = message.welcome.commander;
    again_s = message.welcome.again_s;
    bus_is_lost(message.welcome.bus_lost);
    run_is(message.welcome.run);
    take_again();
    $("bus").textContent = bus;
    $("lost").hidden = bus_lost === null;
    states = message.welcome.states;
    events = log;
    logged();
    show();
    scan();
    last_bore();
    ask({ do: "signals" }).then(name_signals, () => {});
  } else if ("commander" in message) {
    commander = message.commander;
    // Another session commands now: this one does not come back by itself.
    if (commander !== null && commander !== me) sessionStorage.removeItem("commanded");
    take_again();
    show();
  } else if ("run" in message) {
    run_is(message.run);
  } else if (message.sample) {
    does(message.sample);
    if (message.sample.node === node) sample(message.sample, message.point);
  } else if (message.progress) {
    does(message.progress.sample);
    if (message.progress.sample.node === node) progress(message.progress, message.point);
  } else if (message.record) {
    if (message.record.node === node) bore_is(message.record);
  } else if (message.gap) {
    if (message.gap.node === node) gap(message.gap);
  } else if (message.bring_up) {
    if (message.bring_up.sample.node === node) bring_up(message.bring_up);
  } else if (message.jog) {
    if (message.jog.sample.node === node) {
      sample(message.jog.sample);
      tell("jog-doing", message.jog.doing);
    }
  } else if (message.jogged) {
    if (message.node === node) {
      tell("jog-doing", "not enabled");
      if (message.jogged.failed) say("run", message.jogged.said, true);
    }
  } else if (message.identify) {
    if (message.identify.sample.node === node) {
      sample(message.identify.sample);
      tell("identify-doing", message.identify.doing);
    }
  } else if (message.identified) {
    if (message.node === node) identified(message.identified);
  } else if (message.tune) {
    if (message.tune.sample.node === node) {
      sample(message.tune.sample);
      tell("tune-doing", message.tune.doing);
    }
  } else if (message.tuned) {
    if (message.node === node) tuned(message.tuned);
  } else if (message.brought_up) {
    brought_up(message.brought_up);
  } else if (message.event) {
    events.push(message.event);
    if (events.length > 1000) events.shift();
    if (!$("log").hidden) logged();
  } else if (message.ended) {
    if (message.node === node) ended(message.ended);
  } else if (message.gone) {
    gone(message.gone.node);
    if (message.gone.node === node) lost(message.gone.why);
  } else if (message.bus_lost) {
    bus_is_lost(message.bus_lost);
  } else if (message.bus) {
    // It was not there, or has come back.
    if (message.since !== null) notice(`The bus is there. It was gone from ${clock(new Date(message.since))} to ${clock(new Date())}.`);
    bus_is_lost(null);
    scan();
  } else if (message.error) {
    notice(message.error);
  }
}

// When this page has commanded last. A page that is loaded again, or was asleep, takes command again within that time, where no other
// has it meanwhile; sessionStorage is this tab's alone.
function keep_command() {
  const now = Date.now();
  if (now - Number(sessionStorage.getItem("commanded") ?? 0) > 500) sessionStorage.setItem("commanded", now);
}

function take_again() {
  const last = Number(sessionStorage.getItem("commanded") ?? 0);
  if (commander !== null || retaken || Date.now() - last > 1000 * again_s) return;
  retaken = true;
  ask({ do: "command", take: true }).catch(() => {}).finally(() => { retaken = false; });
}

// Whose activity is in progress stands above every view, and on the buttons that act on it.
function run_is(now) {
  run = now;
  $("in-progress").hidden = run === null;
  if (run) $("in-progress").firstElementChild.textContent = `In progress: ${run.what} of node ${run.node}.`;
  show();
}

function bus_is_lost(since) {
  bus_lost = since;
  if (since === null) $("lost").hidden = true;
  else lost();
}

function lost(why = null) {
  if (bus_lost !== null) {
    const seconds = Math.max(0, Math.round((Date.now() - bus_lost) / 1000));
    why = `The bus has been gone since ${clock(new Date(bus_lost))} (${lasts(seconds)}). It is tried again every second. A head that was boring retreats by itself.`;
  }
  $("lost").textContent = why;
  $("lost").hidden = false;
}

// What a view has to say stands in that view.
function say(view, text, bad = false) {
  const place = $(`${view}-said`);
  place.textContent = text;
  place.classList.toggle("wrong", bad);
}

// What belongs to no view: the answer to a button of the header.
function notice(text, bad = false) {
  $("notice").firstElementChild.textContent = text;
  $("notice").classList.toggle("bad", bad);
  $("notice").hidden = false;
}

function show() {
  const mine = commander === me;
  $("command").textContent = mine ? "Release command" : "Take command";
  $("command").disabled = !mine && commander !== null;
  $("session").textContent = mine ? "This session has command."
    : commander === null ? "No session has command." : `Session ${commander} has command; this session watches.`;
  document.body.classList.toggle("watching", !mine);
  const commands = "#name, #bore input, #bore textarea, #bore button, #asks button, #generator-set, [data-request], #jog button, #identify button, #identify input, #take-over, #tune button, #tune input, #tune-rows button, #up-begin, #up-check, #up-report, #arm, #arm-fast, #reset, #save, #import, #list input, #list select";
  for (const button of document.querySelectorAll(commands)) {
    // A bus with new heads alone has none that is chosen.
    button.disabled = !mine || node === null && button.id !== "name";
  }
  // Requests act on the head of the activity in progress; what moves a head by hand, only on the chosen one.
  const other = run !== null && run.node !== node;
  $("choose-run").hidden = !other || !heads.has(run.node);
  $("whose").hidden = !other;
  if (other) $("whose").textContent = `These buttons act on node ${run.node}; chosen is node ${node}.`;
  for (const button of document.querySelectorAll("[data-step], #up-check")) button.disabled ||= other;
  // The program has its own.
  if (program.value.trim()) $("bore").elements.depth.disabled = true;
}

async function scan() {
  $("found").replaceChildren(item("li", "Scanning ..."));
  clearTimeout(again);
  const found = await want({ do: "heads" }, "heads").catch(() => null) ?? [];
  const list = found.map(({ node: id, identity, why_not }) => {
    const line = item("li", "");
    if (!identity) {
      line.append(why_not);
      return line;
    }
    const choose = item("button", `Node ${id}`);
    choose.className = "main";
    choose.onclick = () => choose_head(id, identity);
    const place = item("span", "");
    place.id = `now-${id}`;
    const who = `${identity.name}, hardware ${identity.hardware}, software ${identity.software}, serial number ${identity.serial}`;
    line.append(choose, item("span", who), place);
    return line;
  });
  $("found").replaceChildren(...list.length ? list : [item("li", "No node answers: check power and bit rate of the heads.")]);
  const there = found.filter((one) => one.identity);
  heads = new Map(there.map((one) => [one.node, one.identity]));
  // One that is switched on later is found without a hand.
  name_nodes([...heads.keys()]);
  if (!there.length) again = setTimeout(scan, 3000);
  for (const one of there) does(one.now);
  if (there.length && !heads.has(node)) choose_head(there[0].node, there[0].identity);
  show();
}

// What a head does, in the list of heads.
function does({ node: id, state, homed, position_mm, fault_number, fault }) {
  put(`now-${id}`, `${state}, ${homed ? `at ${position_mm.toFixed(3)} mm` : "not homed"}${fault_number ? `; ${fault}` : ""}`);
}

function choose_head(id, identity) {
  if (node === id) return;
  node = id;
  if (!$("motor").hidden) {
    found_last();
    tuned_last();
  }
  lines = [];
  differences = null;
  bored = kept = null;
  typed.clear();
  $("asks").hidden = true;
  // What belongs to the head before.
  for (const id of LIVE) {
    measured.delete(id);
    put(id, null);
  }
  tell("doing", "No hole in progress.");
  for (const id of ["row-row", "beside-row", "paused", "generator"]) $(id).hidden = true;
  $("progress").value = 0;
  $("gap-target").textContent = "no hole in progress";
  $("head").textContent = `node ${id}`;
  $("head").title = `${identity.name}, serial number ${identity.serial}`;
  for (const id of ["depth", "target", "electrode"]) $(id).textContent = id === "depth" ? "-" : "";
  chart.set([], []);
  homed = null;
  last_bore();
  show();
  if (location.hash === "#settings") read();
}

function sample(now, point = null) {
  put("state", now.state);
  $("state").style.background = `var(${shade(now.state_number)})`;
  $("fault").hidden = now.fault_number === 0;
  $("fault").firstElementChild.textContent = `Fault: ${now.fault}`;
  for (const id of ["position", "jog-position"]) put(id, now.homed ? `${now.position_mm.toFixed(3)} mm` : "not homed");
  const deep = now.surface_mm === null || !now.homed ? null : now.position_mm - now.surface_mm;
  $("electrode").textContent = deep === null ? "surface not known" : deep < 0 ? `electrode ${(-deep).toFixed(3)} mm above the work`
    : `electrode ${deep.toFixed(3)} mm deep`;
  put("gap-now", now.gap_v === null ? null : `${now.gap_v.toFixed(1)} V`);
  put("wanted", `${now.setpoint_v.toFixed(1)} V`);
  if (bus_lost === null) $("lost").hidden = true;
  if (now.homed !== homed) {
    homed = now.homed;
    // It is being gone on with, or was homed by another program: then it is asked about when something is to be bored.
    if (homed && offered) {
      offered = false;
      $("asks").hidden = true;
    }
    if (!homed) offer();
  }
  put("feed", now.feed_um_s === null ? null : `${now.feed_um_s.toFixed(0)} um/s`);
  put("shorts", now.shorts);
  if (point && bored) {
    bored.points.push(point);
    deepens(point);
    deepest();
    // Points come 25 times a second; the eye needs less.
    if (!drawn) setTimeout(draw, 200);
    drawn = true;
  }
}

// The last bore of the head, from the program: it is there whoever has seen it.
function last_bore() {
  if (node === null) return;
  const of = node;
  ask({ do: "record", node }).then((record) => { if (record && of === node) bore_is(record); }, () => {});
}

// A hole that waits in the head since a power cut or a new home is offered, whoever has bored it.
function offer() {
  const of = node;
  ask({ do: "waits", node }).then((why) => {
    if (of !== node || (!why && !offered)) return;
    offered = why !== null;
    $("asks").firstElementChild.textContent = why ?? "";
    $("continue").hidden = false;
    $("asks").hidden = why === null;
  }, () => {});
}

function bore_is(record) {
  // Until the head has a surface, what pulses began at.
  const first = record.points.find(([, state]) => LED.includes(state));
  bored = { points: record.points, run: record.run, surface: record.surface_mm ?? first?.[2] ?? 0, target: record.target_mm, deepest: 0 };
  record.points.forEach(deepens);
  deepest();
  if (record.gap) {
    const [at, gap] = record.gap;
    if (kept === null || kept.at < at) kept = { at: new Date(at), gap };
  }
  if (record.ended) ended(record.ended);
  draw();
}

// Only where the gap leads: the way home is not of the hole.
function deepens([, state, position]) {
  if (LED.includes(state)) bored.deepest = Math.max(bored.deepest, position - bored.surface);
}

function deepest() {
  tell("depth", `${bored.deepest.toFixed(3)} mm`);
  $("target").textContent = bored.target === null ? "" : `of ${bored.target.toFixed(3)} mm; `;
}

function draw() {
  drawn = false;
  if ($("run").hidden) return;
  const points = bored?.points ?? [];
  const column = (place) => points.map((point) => point[place]);
  let work = false;
  const depth = points.map(([, state, position]) => (work ||= LED.includes(state)) ? position - bored.surface : null);
  const target = bored?.target ?? null;
  chart.set(column(0), [depth, points.map(() => target), column(3), column(4), column(5)], column(1));
}

function progress(run, point) {
  $("asks").hidden = true;
  sample(run.sample, point);
  if (bored && run.deepest_mm !== null) {
    bored.target = run.target_mm;
    bored.deepest = Math.max(bored.deepest, run.deepest_mm);
  }
  $("depth-what").textContent = "Depth, by the electrode";
  put("doing", run.said);
  $("paused").hidden = !run.unwatched;
  tell("depth", run.deepest_mm === null ? "-" : `${run.deepest_mm.toFixed(3)} mm`);
  $("target").textContent = `of ${run.target_mm.toFixed(3)} mm; `;
  $("progress").value = run.share ?? 0;
  $("row-row").hidden = run.row === null;
  put("row", run.row && `${run.row.number} of ${run.row.of}, ${run.row.name}`);
  $("generator").hidden = !run.row?.waits;
  if (run.row?.waits) $("generator").querySelector("span").textContent = `${run.row.generator} (row ${run.row.number}, ${run.row.name})`;
  $("beside-row").hidden = run.beside_mm === null;
  put("beside", run.beside_mm && run.beside_mm.map((mm) => mm.toFixed(3)).join(", ") + " mm");
  put("time", run.seconds > 0 ? lasts(run.seconds) : null);
  for (const id of ["left", "gap-left"]) {
    if (run.left_s !== null) put(id, lasts(run.left_s));
    else if (measured.has(id)) put(id, null);
    else $(id).textContent = "-";
  }
  tell("gap-depth", run.deepest_mm === null ? "-" : `${run.deepest_mm.toFixed(3)} mm`);
  $("gap-target").textContent = `of ${run.target_mm.toFixed(3)} mm`;
}

// A duration: 45 s, 3 min 20 s, 2 h 5 min.
function lasts(seconds) {
  const whole = Math.round(seconds);
  if (whole < 120) return `${whole} s`;
  if (whole < 7200) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor(whole % 3600 / 60)} min`;
}

// A number with at least three digits.
function digits(number) {
  const exact = Math.abs(number) < 10 ? 2 : Math.abs(number) < 100 ? 1 : 0;
  return number.toFixed(exact);
}

function gap(now) {
  if (now.whole || (now.pulses && now.volts !== null && !kept?.gap.whole)) kept = { at: new Date(), gap: now };
  if ($("gap").hidden) return;
  const { volts, quality, ladder, feed_um_s, levels } = now;
  put("gap-volts", volts === null ? null : `${volts.toFixed(1)} V, ${quality}`);
  if (volts === null) $("gap-quality").textContent = `: ${quality}, not valid now`;
  else $("gap-quality").textContent = "";
  put("gap-feed", feed_um_s === null ? null : `${feed_um_s.toFixed(0)} um/s`);
  // Without pulses the last ones stay, grey, with their time.
  const old = !now.pulses && kept !== null, { pulses, shares, verdict, good, pulse_count, no_pulse_percent, delays, controlled } = old ? kept.gap : now;
  for (const id of ["shares", "stack", "verdict"]) $(id).classList.toggle("old", old);
  $("ladder").classList.remove("old");
  $("verdict").textContent = old ? `No pulses now. At ${clock(kept.at)}: ${verdict}` : verdict;
  $("verdict").classList.toggle("good", good === true);
  $("verdict").classList.toggle("poor", good === false);
  const at = performance.now();
  lately = volts === null ? [] : [...lately.filter(([then]) => at - then < 10_000), [at, volts]];
  const band = lately.length ? [Math.min(...lately.map(([, value]) => value)), Math.max(...lately.map(([, value]) => value))] : null;
  levels_now.show(ladder.map((rung, place) => ({ ...rung, colour: RUNGS[place] })), volts, band);
  // The same for who does not see pictures.
  $("ladder").replaceChildren(...ladder.map((rung) => bar(rung.what, rung.from, rung.volts)));
  $("shares").replaceChildren(...shares.map((share) => bar(share.what, "", share.percent, share.what)));
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
  put("looks", !pulses ? "no pulses in the last 0.2 s"
    : `of ${pulse_count === null ? "all" : `all ${pulse_count}`} pulses since the last look`
    + (no_pulse_percent > 0 ? `; ${no_pulse_percent} % of the milliseconds had none` : ""));
  if (old && !measured.has("hazard")) {
    // A page that was not there then.
    measured_at = kept.at;
    sensed(kept.gap.senses, controlled);
    measured_at = null;
  }
  sensed(now.senses, now.controlled);
  delayed(delays, old);
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
function delayed(delays, old) {
  const total = delays?.counts.reduce((sum, count) => sum + count, 0) ?? 0;
  $("delays").classList.toggle("old", old);
  put("delayed", total && !old ? `${total} pulses ignited in ${delays.seconds.toFixed(1)} s; pulses an octave` : null);
  histogram.show(delays?.counts ?? [], delays?.ends_us ?? []);
}

// A row with a value, and as a bar of so many percent.
function bar(what, from, value, kind = null) {
  const row = item("tr", "");
  const name = item("td", what);
  if (from) name.append(item("small", from));
  const room = item("td", "");
  if (kind) {
    const shade = item("div", "");
    shade.className = `bar ${kind}`;
    shade.style.width = `${Math.max(0, value ?? 0)}%`;
    room.append(shade);
  }
  row.append(name, item("td", value === null ? "not known" : value.toFixed(1)), room);
  return row;
}

// A signal as a person reads it: its name and its unit.
const named = (key, unit) => (unit ? `${key}, ${unit}` : key);

// Signals of the servo tick: those of a new page.
const CHOSEN = ["position", "set_point", "following_error", "velocity", "duty", "current", "gap_voltage", "state"];

function name_signals({ ticks, objects }) {
  if (!$("ticks").children.length) {
    $("ticks").replaceChildren(...ticks.map(([name, unit, what]) => {
      const label = item("label", ` ${named(name.replaceAll("_", " "), unit)}`), box = document.createElement("input");
      Object.assign(box, { type: "checkbox", name: "signals", value: name, checked: CHOSEN.includes(name) });
      label.title = what;
      label.prepend(box);
      return label;
    }));
    choose_ticks();
  }
  signals = objects.map(([address, key, unit]) => ({ address, text: named(key, unit) }));
  $("signals").replaceChildren(...signals.map(({ address, text }) => {
    const option = new Option(address);
    option.value = text;
    return option;
  }));
  const fields = [...document.querySelectorAll("#record [name=signals]")];
  if (fields.every((field) => !field.value)) {
    ["2005h:1", "2005h:5", "6064h:0", "2004h:7"].forEach((address, place) => {
      fields[place].value = signals.find((signal) => signal.address === address)?.text ?? address;
    });
  }
}

const COLOURS = ["--trace", "--target", "--third", "--fourth"];

// What was chosen of the servo tick, and what follows from it: eight at the most, the signals to compare, the time that fits.
function choose_ticks() {
  const form = $("record-fast"), boxes = [...form.querySelectorAll("[name=signals]")], chosen = boxes.filter((box) => box.checked);
  boxes.forEach((box) => { box.disabled = !box.checked && chosen.length >= 8; });
  const of = form.elements.of, before = of.value;
  of.replaceChildren(...chosen.map((box) => new Option(box.parentElement.textContent.trim(), box.value)));
  if (chosen.some((box) => box.value === before)) of.value = before;
  const compares = ["rises", "falls"].includes(form.elements.trigger.value);
  form.querySelectorAll(".levels").forEach((label) => { label.hidden = !compares; });
  const ms = chosen.length ? Math.floor(4096 / chosen.length) * Number(form.elements.every.value) : 0;
  $("span").textContent = chosen.length ? `${+ms.toPrecision(3)} ms` : "choose a signal";
}

function speed() {
  $("record-fast").hidden = !$("fast").checked;
  $("record").hidden = $("fast").checked;
  scope?.draw();
}

// Heads that can be recorded side by side: only where there are several.
function name_nodes(nodes) {
  $("on-heads").hidden = nodes.length < 2;
  $("on-heads").replaceChildren("Heads: ", ...nodes.map((one) => {
    const label = item("label", ` ${one}`), box = document.createElement("input");
    Object.assign(box, { type: "checkbox", name: "nodes", value: one, checked: one === node });
    label.prepend(box);
    return label;
  }));
}

async function record_fast(submit) {
  submit.preventDefault();
  const form = new FormData($("record-fast"));
  const nodes = $("on-heads").hidden ? [node] : form.getAll("nodes").map(Number);
  if (!form.getAll("signals").length) return say("scope", "Choose a signal first.", true);
  const plan = {
    signals: form.getAll("signals"), every_ms: Number(form.get("every")), trigger: form.get("trigger"), level: Number(form.get("level")),
    of: ["rises", "falls"].includes(form.get("trigger")) ? form.get("of") : null, before: Number(form.get("before")), wait_s: Number(form.get("wait")),
  };
  const before = $("recorded").textContent;
  $("recorded").textContent = "Waiting for the trigger, or recording.";
  const done = await want({ do: "fast", nodes: nodes.length ? nodes : [node], plan }, "scope").catch(() => null);
  if (done) show_ticks(done, `scope-node-${nodes.join("-")}.csv`);
  else $("recorded").textContent = before;
}

async function show_snapshot() {
  const done = await want({ do: "snapshot", node }, "scope").catch(() => undefined);
  if (done === null) say("scope", "The head has no snapshot: no fault since its power came.");
  else if (done) show_ticks(done, `fault-node-${node}.csv`);
}

function show_ticks({ record: { every_ms, before, begun, signals: recorded }, csv }, name) {
  const samples = recorded[0].values.length;
  show_record(Array.from({ length: samples }, (_, place) => +((place - before) * every_ms).toFixed(2)), recorded, before > 0 || begun !== "at once");
  $("recorded").textContent = `${samples} samples, one every ${every_ms} ms. Begun by: ${begun}.`;
  save("scope-csv", name, "text/csv", csv);
  $("scope-file").hidden = false;
}

async function record(submit) {
  submit.preventDefault();
  const form = new FormData($("record"));
  const address = (text) => signals.find((signal) => signal.text === text)?.address ?? text;
  const plan = {
    signals: form.getAll("signals").map((text) => text.trim()).filter((text) => text).map(address),
    every_ms: Number(form.get("every")),
    trigger: form.get("trigger"),
    level: Number(form.get("level")),
    wait_s: Number(form.get("wait")),
  };
  const before = $("recorded").textContent;
  $("recorded").textContent = "Waiting for the trigger, or recording.";
  const done = await want({ do: "scope", node, plan }, "scope").catch(() => null);
  if (!done) {
    $("recorded").textContent = before;
    return;
  }
  const { every_ms, signals: recorded } = done.record;
  show_record(recorded[0].values.map((value, place) => place * every_ms), recorded, false, true);
  $("recorded").textContent = `${recorded[0].values.length} samples, one every ${every_ms} ms.`;
  save("scope-csv", `scope-node-${node}.csv`, "text/csv", done.csv);
  $("scope-file").hidden = false;
}

// Draws a record: times, ms, and { key, unit, values } of each signal. In one pane, or in one for each unit with states as a strip above.
// `marked`: differences are measured from the trigger, time 0.
function show_record(times, recorded, marked = false, one = recorded.length <= COLOURS.length) {
  scope?.close();
  const digits = (values) => Math.max(...values.map(Math.abs)) < 10 ? 3 : 1;
  const strip = one ? undefined : recorded.find(({ key }) => key === "state"), drawn = recorded.filter((signal) => signal !== strip);
  const units = one || !drawn.length ? [null] : [...new Set(drawn.map(({ unit }) => unit))];
  const panes = units.map((unit) => drawn.filter((signal) => unit === null || signal.unit === unit));
  const room = () => innerHeight - ($("records").getBoundingClientRect().top + scrollY) - 26 - 30 * panes.length;
  scope = new Chart($("records"), panes.map((pane, number) => ({
    height: () => Math.max(one ? 300 : 72, room() / panes.length),
    strip: number === 0 && strip !== undefined,
    signals: pane.map(({ key, unit, values }, place) => ({
      name: key.replaceAll("_", " "), unit, colour: COLOURS[place % COLOURS.length], digits: digits(values), scale: unit || "1",
      ...(place < COLOURS.length ? {} : { dash: [6, 4] }),
    })),
  })), { time: "ms", note: $("records-note"), named: (state) => [states[state] ?? `state ${state}`, shade(state)] });
  scope.least = times.length > 1 ? Math.min(1, times.at(-1) - times[0]) : 1;
  scope.marked = marked ? 0 : null;
  scope.set(times, panes.flat().map(({ values }) => values), strip?.values ?? []);
  $("records-note").textContent = "Drag to zoom, double click for all; click to measure from there.";
}

// A record that was saved, as the CSV file of the scope has it: time [ms], and a column for each signal.
function parse_record(text) {
  const [first, ...lines] = text.trim().split(/\r?\n/);
  // A name with a comma is quoted.
  const names = (first.match(/"[^"]*"|[^,]+/g) ?? []).map((name) => name.replaceAll('"', ""));
  const rows = lines.map((line) => line.split(",").map(Number));
  if (names[0] !== "time [ms]" || names.length < 2 || !rows.length) throw new Error("must begin with time [ms] and the names of signals");
  const wrong = rows.findIndex((row) => row.length !== names.length || !row.every(Number.isFinite));
  if (wrong >= 0) throw new Error(`line ${wrong + 2}: must have ${names.length} numbers`);
  const recorded = names.slice(1).map((name, place) => {
    const [, key, unit] = name.match(/^(.*?)(?: \[(.*)\])?$/);
    return { key, unit: unit ?? "", values: rows.map((row) => row[place + 1]) };
  });
  return [rows.map((row) => row[0]), recorded];
}

async function open_record(change) {
  const [chosen] = change.target.files;
  if (!chosen) return;
  try {
    const [times, recorded] = parse_record(await chosen.text());
    show_record(times, recorded, times[0] < 0);
    say("scope", "");
    $("recorded").textContent = `${times.length} samples of ${chosen.name}.`;
    $("scope-file").hidden = true;
  } catch (error) {
    say("scope", `${chosen.name}: ${error.message}`, true);
  }
  change.target.value = "";
}

// Has a link save a text.
function save(id, name, type, text) {
  if ($(id).href.startsWith("blob:")) URL.revokeObjectURL($(id).href);
  $(id).href = URL.createObjectURL(new Blob([text], { type }));
  $(id).download = name;
}

function ended({ outcome, failed }) {
  $("paused").hidden = $("generator").hidden = true;
  $("depth-what").textContent = "Last hole: depth, by the electrode";
  tell("gap-left", "-");
  $("gap-target").textContent = "no hole in progress";
  if (outcome) {
    tell("doing", outcome.said);
    if (bored) bored.deepest = outcome.depth_mm;
    tell("depth", `${outcome.depth_mm.toFixed(3)} mm`);
    tell("gap-depth", `${outcome.depth_mm.toFixed(3)} mm`);
    $("gap-target").textContent = `of ${outcome.target_mm.toFixed(3)} mm, last hole`;
    tell("time", lasts(outcome.seconds));
    tell("left", "-");
    $("progress").value = outcome.reached ? 1 : Math.max(0, outcome.depth_mm / outcome.target_mm);
  } else {
    tell("doing", failed);
    show_line(failed);
    tell("left", "-");
    put("time", null);
  }
}

const VERDICTS = { not_seen: "not seen", passed: "passed", failed: "FAILED" };

function bring_up({ doing, checks }) {
  $("up-doing").textContent = doing;
  $("up-files").hidden = true;
  up_list(checks);
}

let up_listed = "";

function up_list(checks) {
  // They come 20 times a second, mostly as they were.
  const text = JSON.stringify(checks);
  if (text === up_listed) return;
  up_listed = text;
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

// The newest event first.
function logged() {
  const kind = $("log-kind").value, word = $("log-word").value.toLowerCase();
  const shown = events.filter((event) => (!kind || event.kind === kind) && event.what.toLowerCase().includes(word)).reverse();
  $("events").replaceChildren(...shown.map(({ unix_ms, node: from, kind, what }) => {
    const line = item("li", "");
    line.className = kind;
    line.append(item("time", new Date(unix_ms).toLocaleTimeString("en-GB")), item("b", from ? `node ${from}` : "desk"), item("span", what));
    return line;
  }));
}

async function read() {
  if (node === null) return;
  lines = await want({ do: "settings", node }, "settings");
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
      if (typed.has(line.key)) {
        const why = item("small", `${typed.get(line.key).why}. The head has ${line.value} ${line.unit}`.trim());
        why.className = "wrong";
        value.append(why);
      }
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
  // What was refused stays in its field, with the reason beside it.
  const wrong = typed.get(line.key);
  input.value = wrong?.text ?? String(line.value);
  input.classList.toggle("wrong", wrong !== undefined);
  input.setAttribute("aria-label", line.key);
  input.onchange = async () => {
    const text = input.value;
    try {
      const written = await ask({ do: "set", node, assignments: [`${line.key}=${text}`] });
      typed.delete(line.key);
      await read();
      say("settings", `${line.key} = ${text}${written.check_again ? "; the guided check must pass again" : ""}`);
    } catch (error) {
      if (text === String(line.value)) typed.delete(line.key);
      else typed.set(line.key, { text, why: error.message });
      list();
    }
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
  if (name === "motor") {
    found_last();
    tuned_last();
  }
  if (name === "log") logged();
  if (name === "scope") scope?.draw();
  draw();
}

// What an identification has found: a row each, beside the setting.
function values_are(values) {
  const known = values.some(({ value }) => value);
  $("found-values").replaceChildren(...(known ? values : []).map(({ name, key, unit, value, uncertainty, set }) => {
    const differs = value === null || set !== null && Math.abs(set - value) > uncertainty;
    const row = document.createElement("tr");
    const found = [value?.toPrecision(4), uncertainty === 0 ? "at most" : `\u00b1 ${uncertainty.toPrecision(2)}`, unit];
    const unbound = ["not bounded", "", "", "", "take the values over"];
    const cells = [name, ...(value === null ? unbound : [...found, set === null ? "" : `${Number(set.toPrecision(5))}`, differs ? "differs" : ""])];
    row.append(...cells.map((text) => item("td", text)));
    row.title = key ?? "";
    row.classList.toggle("differs", differs);
    return row;
  }));
  $("take-over").hidden = !known;
}

function found_last() {
  values_are([]);
  if (node !== null) ask({ do: "identified", node }).then(values_are, () => {});
}

function identified({ failed, values }) {
  tell("identify-doing", "");
  if (failed) return say("motor", failed, true);
  values_are(values);
  say("motor", "Identified. The head is disabled.");
}

// What a tuning has measured: gains with their margins, the loop over frequency, a step before and after.
const bode = new Bode($("bode"));
let steps = null;

function tuning_is(outcome) {
  $("tune-table").hidden = !outcome;
  bode.show([]);
  steps?.close();
  steps = null;
  $("tune-rows").replaceChildren();
  if (!outcome) return;
  const { before, proposal, ziegler_nichols: rules, after, step_before, step_after } = outcome;
  const loops = [
    { name: "as it was", of: before, step: step_before, colour: "--trace", points: true, button: after && ["Revert", () => revert(before.gains)] },
    { name: "proposal", of: proposal, colour: "--target", dash: [6, 4], button: !after && ["Accept", () => tune("proposal")] },
    { name: "Ziegler-Nichols", of: rules, colour: "--short", dash: [2, 3], button: !after && ["Accept", () => tune("ziegler_nichols")] },
    { name: "measured again", of: after, step: step_after, colour: "--eroding", points: true },
  ].filter(({ of }) => of);
  $("tune-rows").append(...loops.map(({ name, of: { gains, margins }, step, button }) => {
    const row = document.createElement("tr");
    const low = !margins || margins.phase_deg < 45 || margins.gain_db < 6;
    const cells = [name, gains.velocity_hz.toFixed(0), gains.position_hz.toFixed(0), gains.integral_ms.toFixed(1)];
    cells.push(...(margins ? [
      `${margins.crossover_hz.toFixed(0)} Hz`, `${margins.phase_deg.toFixed(1)} \u00b1 ${margins.phase_off_deg.toFixed(1)}\u00b0`,
      `${margins.gain_db.toFixed(1)} \u00b1 ${margins.gain_off_db.toFixed(1)} dB`,
    ] : ["crosses over nowhere", "", ""]));
    const settled = step && (step.settled_ms === null ? "does not settle" : `settled after ${step.settled_ms.toFixed(1)} ms`);
    cells.push(step ? `overshoot ${step.overshoot_um.toFixed(1)} um, ${settled}` : "");
    row.append(...cells.map((text) => item("td", text)));
    row.classList.toggle("differs", low);
    row.title = low ? "below 45 degrees or 6 dB" : "";
    const cell = document.createElement("td");
    if (button) {
      const press = item("button", button[0]);
      press.onclick = button[1];
      press.disabled = commander !== me;
      cell.append(press);
    }
    row.append(cell);
    return row;
  }));
  bode.show(loops.map(({ name, of, colour, dash, points }) => ({ name, colour, dash, points, bode: of.bode })));
  stepped([["before", step_before, "--trace"], ["after", step_after, "--eroding"]].filter(([, step]) => step));
}

// Steps one over the other, as a way from where they began, um.
function stepped(all) {
  const samples = all[0][1].record, set = samples.signals.find(({ key }) => key === "set_point").values;
  const times = set.map((_, place) => +((place - samples.before) * samples.every_ms).toFixed(3));
  const way = (values) => values.map((at) => (values[0] - at) * 1000);
  const signals = [{ name: "Set point", unit: "um", colour: "--target", dash: [6, 4] }, ...all.map(([name, , shade]) => ({ name, unit: "um", colour: shade }))];
  steps = new Chart($("steps"), [{ height: 220, signals }], { time: "ms" });
  steps.set(times, [way(set), ...all.map(([, step]) => way(step.record.signals.find(({ key }) => key === "position").values))]);
}

function tuned_last() {
  tuning_is(null);
  if (node !== null) ask({ do: "tuned", node }).then(tuning_is, () => {});
}

function tuned(outcome) {
  tell("tune-doing", "");
  if (outcome.failed) return say("tune", outcome.failed, true);
  tuning_is(outcome);
  say("tune", outcome.after ? "The new gains are in force; \u201cSave in head\u201d keeps them after a reset. The head is disabled." : "Measured; nothing is written. The head is disabled.");
}

function tune(accept) {
  const fields = new FormData($("tune")), number = (name) => (fields.get(name) === "" ? null : Number(fields.get(name)));
  say("tune", "");
  want({ do: "tune", node, at_mm: number("at"), bandwidth_hz: number("bandwidth"), accept }, "tune").catch(() => {});
}

async function revert(gains) {
  const assignments = Object.entries(gains).map(([name, value]) => `servo.${name}=${value}`);
  if (await want({ do: "set", node, assignments }, "tune").catch(() => null)) say("tune", "The gains are as they were.");
}

// STOP of every head on the bus; each is named with what it is then.
function stop() {
  want({ do: "stop" }).then(({ stopped }) => {
    const silent = stopped.filter((one) => !one.stopped).map((one) => `node ${one.node} ${one.now}`);
    const all = stopped.map((one) => `node ${one.node}: ${one.now}`).join("; ");
    notice(stopped.length ? `STOP: ${all}.` : "STOP: no head answers, none was stopped: switch them off at the machine.", silent.length > 0 || !stopped.length);
  }, () => {});
}

// What text is typed in.
const is_text = (place) => place instanceof HTMLTextAreaElement || place instanceof HTMLInputElement && !["checkbox", "radio", "file", "button", "submit"].includes(place.type);

$("stop").onclick = stop;
// What a text field had when it got the focus.
let had = "";
addEventListener("focusin", ({ target }) => { had = target.value; });
// Esc is STOP, but in a text field: there it takes back what was typed, or clears a search, and leaves the field. The next one is STOP.
addEventListener("keydown", (key) => {
  if (key.key === "Escape") {
    key.preventDefault();
    if (!is_text(key.target)) return stop();
    key.target.value = key.target.type === "search" ? "" : had;
    key.target.dispatchEvent(new Event("input", { bubbles: true }));
    key.target.blur();
  } else if (key.key === "Enter" && key.target instanceof HTMLInputElement && is_text(key.target)) {
    // Enter confirms what was typed; only a button moves a head.
    key.preventDefault();
    key.target.blur();
  }
}, true);
$("command").onclick = () => {
  if (commander === me) sessionStorage.removeItem("commanded");
  want({ do: "command", take: commander !== me }).catch(() => {});
};
$("go-on").onclick = async () => {
  if (commander !== me) await want({ do: "command", take: true });
  await want({ do: "request", request: "go" });
};
setInterval(() => { if (bus_lost !== null) lost(); }, 1000);
$("reset").onclick = () => want({ do: "reset", node }).catch(() => {});
$("choose-run").onclick = () => choose_head(run.node, heads.get(run.node));
$("seen").onclick = () => { $("notice").hidden = true; };
$("scan").onclick = scan;
$("name").onclick = async () => {
  const named = await want({ do: "name" }, "heads").catch(() => null);
  if (!named) return;
  await scan();
  say("heads", named.length ? named.map(({ node, serial }) => `Serial number ${serial} is node ${node}.`).join(" ") : "No head waits for a node-ID.");
};
// A program takes the place of the depth.
const program = $("bore").elements.program;
let program_name = null;
program.oninput = () => {
  program_name = null;
  program.classList.remove("wrong");
  show();
};
$("program-open").onchange = async (change) => {
  const [chosen] = change.target.files;
  if (!chosen) return;
  program.value = await chosen.text();
  program.oninput();
  program_name = chosen.name;
  change.target.value = "";
};
// A table has the head make the depth row after row.
const table = $("bore").elements.table;
table.oninput = () => table.classList.remove("wrong");
$("table-open").onchange = async (change) => {
  const [chosen] = change.target.files;
  if (!chosen) return;
  table.value = await chosen.text();
  table.oninput();
  change.target.value = "";
};
$("generator-set").onclick = () => want({ do: "generator_set" }, "run").catch(() => null);
// Shows the line that is refused, of a program or a table.
function show_line(message) {
  const [, what, number] = message.match(/(program|table) line (\d+):/) ?? [];
  if (!what) return;
  const [text, around] = what === "table" ? [table, "rows"] : [program, "path"];
  const lines = text.value.split("\n"), line = Math.min(Number(number), lines.length);
  const before = lines.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
  $(around).open = true;
  text.focus();
  text.setSelectionRange(before, before + lines[line - 1].length);
}

// What is under the electrode is asked where a hole may have been begun there.
function bore(site) {
  const form = new FormData($("bore"));
  const number = (name) => (form.get(name) ? Number(form.get(name)) : null);
  $("asks").hidden = true;
  say("run", "");
  const fields = [...document.querySelectorAll("#bore input, #bore textarea")];
  for (const field of fields) field.classList.remove("wrong");
  const keys = { jump_every_ms: "jump.every_ms", jump_height_um: "jump.height_um", spark_out_ms: "end.spark_out_ms" };
  const given = Object.keys(keys).filter((name) => number(name) !== null).map((name) => [name, number(name)]);
  const text = program.value.trim() ? program.value : null;
  const hole = { depth_mm: number("depth") ?? 0, surface_mm: number("surface"), height_mm: number("height"), site, with: Object.fromEntries(given) };
  const rows = table.value.trim() ? table.value : null;
  ask({ do: "bore", node, hole, program: text, name: program_name, table: rows }).catch(({ message, asks }) => {
    if (!asks) {
      // The program names the field first.
      fields.find((field) => message.startsWith(`${keys[field.name] ?? field.name} `))?.classList.add("wrong");
      show_line(message);
      return say("run", message, true);
    }
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
  button.onclick = () => want({ do: "request", request: button.dataset.request }, "run").catch(() => {});
}
for (const button of document.querySelectorAll("[data-last]")) {
  button.onclick = () => chart.look(button.dataset.last ? Number(button.dataset.last) : null);
}
$("identify").onsubmit = (submit) => {
  submit.preventDefault();
  const at = new FormData($("identify")).get("at");
  say("motor", "");
  want({ do: "identify", node, at_mm: at === "" ? null : Number(at) }, "motor").catch(() => {});
};
$("tune").onsubmit = (submit) => {
  submit.preventDefault();
  tune("nothing");
};
$("take-over").onclick = async () => {
  const values = await want({ do: "take_over", node }, "motor").catch(() => null);
  if (!values) return;
  values_are(values);
  say("motor", "Taken over into the settings; \u201cSave in head\u201d keeps them after a reset.");
};
$("jog-begin").onclick = () => want({ do: "jog", node }, "run").catch(() => {});
$("jog-end").onclick = () => want({ do: "end_jog" }, "run").catch(() => {});
for (const button of document.querySelectorAll("[data-step]")) {
  button.onclick = () => want({ do: "step", node, by_mm: Number(button.dataset.step) }, "run").catch(() => {});
}
// What the head has stands in the empty fields.
$("more").ontoggle = async () => {
  if (!$("more").open || node === null) return;
  const all = await ask({ do: "settings", node }).catch(() => []);
  for (const [name, key] of [["jump_every_ms", "jump.every_ms"], ["jump_height_um", "jump.height_um"], ["spark_out_ms", "end.spark_out_ms"]]) {
    document.querySelector(`[name=${name}]`).placeholder = all.find((line) => line.key === key)?.value ?? "as set";
  }
};
$("log-save").onclick = () => save("log-save", "desk.log", "text/plain", [...$("events").children]
  .map((line) => [...line.children].map((part) => part.textContent).join("  ")).reverse().join("\n") + "\n");
$("log-save").href = "#log";
$("scope-open").onchange = open_record;
$("record").onsubmit = record;
$("record-fast").onsubmit = record_fast;
$("record-fast").onchange = choose_ticks;
$("fast").onchange = $("slow").onchange = speed;
$("snapshot").onclick = show_snapshot;
$("log-kind").onchange = logged;
$("log-word").oninput = logged;
$("up-begin").onclick = () => want({ do: "bring_up", node }, "bring-up").catch(() => {});
$("up-check").onclick = () => want({ do: "check", node, again: $("up-again").checked }, "bring-up").catch(() => {});
$("up-report").onclick = () => want({ do: "report" }, "bring-up").catch(() => {});
$("search").oninput = list;
$("changed").onchange = list;
$("read").onclick = () => {
  file = differences = null;
  typed.clear();
  $("import").hidden = true;
  read().catch(() => {});
};
$("save").onclick = () => want({ do: "save", node }, "settings").then(() => say("settings", "Settings saved in the head."), () => {});
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
  differences = await want({ do: "compare", node, text }, "settings").catch(() => null);
  file = differences?.length ? text : null;
  $("import").hidden = file === null;
  if (differences) say("settings", differences.length ? `${differences.length} settings differ from ${chosen.name}.` : "No difference.");
  list();
};
$("import").onclick = async () => {
  const written = await want({ do: "import", node, text: file }, "settings").catch(() => null);
  if (!written) return;
  file = differences = null;
  $("import").hidden = true;
  await read().catch(() => {});
  say("settings", `${written.changed.length} settings changed${written.check_again ? "; the guided check must pass again" : ""}.`);
};
addEventListener("hashchange", view);
view();
show();
connect();
