// Panes of signals over one time axis. uPlot draws them (uplot/, MIT licence): zoom by dragging, the whole by a double click,
// values under the cursor in the legend. Here: one window of time for all panes, a strip of states, a mark to measure from.

/* global uPlot */

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

const LEFT = 64, RIGHT = 12, STRIP = 26;
const SECONDS = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14_400, 36_000];

// A time of a run: 12 s, 3:20 min, 2:05 h.
function clock(seconds, step) {
  if (step < 1) return `${seconds.toFixed(Math.ceil(-Math.log10(step)))} s`;
  const two = (number) => String(Math.round(number)).padStart(2, "0");
  if (seconds < 120) return `${Math.round(seconds)} s`;
  if (seconds < 7200) return `${Math.floor(seconds / 60)}:${two(seconds % 60)} min`;
  return `${Math.floor(seconds / 3600)}:${two(seconds % 3600 / 60)} h`;
}

const number = (value, digits) => (value === null || value === undefined ? "-" : value.toFixed(digits));

// Values that are seen, without the hundredth part at each end: a spike does not decide the scale.
export function seen(u, column, counts = () => true) {
  const [from, to] = u.series[0].idxs ?? [0, 0];
  const values = u.data[column].slice(from, to + 1).filter((value, place) => value !== null && value !== undefined && counts(from + place))
    .sort((a, b) => a - b);
  const spikes = Math.floor(values.length / 100);
  return values.length ? [values[spikes], values.at(-1 - spikes)] : [null, null];
}

export class Chart {
  // panes: [{ height, signals: [{ name, unit, colour, digits, dash, scale }], ranges: { scale: function }, down, strip }];
  // time: "s" of a run, "ms" of a record. `named` gives colour and name of a state for the strip.
  constructor(host, panes, { time = "s", named = null, note = null } = {}) {
    Object.assign(this, { host, panes, time, named, note });
    this.plots = [];
    this.times = [];
    this.columns = [];
    this.states = [];
    // Seconds from the end that are shown; null: all.
    this.last = null;
    this.zoom = null;
    this.marked = null;
    this.least = 10;
    const resized = new ResizeObserver(() => this.draw()), scheme = matchMedia("(prefers-color-scheme: dark)");
    const again = () => { this.clear(); this.draw(); };
    resized.observe(host);
    scheme.addEventListener("change", again);
    this.close = () => {
      resized.disconnect();
      scheme.removeEventListener("change", again);
      this.clear();
    };
  }

  clear() {
    for (const plot of this.plots) plot.destroy();
    this.plots = [];
    this.host.replaceChildren();
  }

  // Times, one array of values for each signal of all panes, states for the strip.
  set(times, columns, states = []) {
    Object.assign(this, { times, columns, states });
    this.draw();
  }

  // What of the time is seen.
  window() {
    if (this.zoom) return this.zoom;
    const end = this.times.at(-1) ?? 0, begin = this.times[0] ?? 0;
    if (this.last !== null) return [Math.max(begin, end - this.last), Math.max(end, begin + this.least)];
    return [begin, Math.max(end, begin + this.least)];
  }

  look(seconds) {
    this.last = seconds;
    this.zoom = null;
    this.draw();
  }

  draw() {
    const width = this.host.clientWidth;
    if (!width) return;
    if (!this.plots.length) this.make(width);
    let column = 0;
    const [min, max] = this.window();
    this.busy = true;
    this.panes.forEach((pane, place) => {
      const plot = this.plots[place], height = this.height(pane);
      if (plot.width !== width || plot.height !== height) plot.setSize({ width, height });
      const columns = pane.signals.map(() => this.columns[column++] ?? []);
      plot.batch(() => {
        plot.setData([this.times, ...columns], false);
        plot.setScale("x", { min, max });
      });
    });
    this.busy = false;
  }

  height(pane) {
    return typeof pane.height === "function" ? pane.height() : pane.height;
  }

  make(width) {
    this.key = uPlot.sync(`chart-${Chart.count = (Chart.count ?? 0) + 1}`);
    this.plots = this.panes.map((pane, place) => this.pane(pane, place === this.panes.length - 1, width));
    this.plots.forEach((plot) => this.key.sub(plot));
  }

  pane(pane, lowest, width) {
    const scales = { x: { time: false } };
    const units = [...new Set(pane.signals.map((signal) => signal.scale ?? signal.unit))];
    for (const unit of units) scales[unit] = { range: pane.ranges?.[unit] ?? padded, dir: pane.down ? -1 : 1 };
    const quiet = () => colour("--quiet"), line = () => colour("--line");
    const axis = (scale, place) => ({
      scale, side: place === 0 ? 3 : 1, size: place === 0 ? LEFT : 56, show: place < 2, stroke: quiet, gap: 4,
      font: "12px system-ui, sans-serif", grid: { show: place === 0, stroke: line, width: 1 }, ticks: { show: false }, space: 16,
      ...(units.length > 1 ? { label: scale, labelSize: 18, labelFont: "12px system-ui, sans-serif" } : {}),
    });
    const x = {
      stroke: quiet, font: "12px system-ui, sans-serif", size: lowest ? 26 : 4, gap: 2, space: 80, grid: { stroke: line, width: 1 }, ticks: { show: false },
      values: (u, splits, index, space, step) => splits.map((at) => !lowest ? "" : this.time === "ms" ? `${+at.toFixed(3)} ms` : clock(at, step)),
      ...(this.time === "s" ? { incrs: SECONDS } : {}),
    };
    const digits = (signal) => signal.digits ?? 1;
    const options = {
      width, height: this.height(pane), scales,
      padding: [pane.strip ? STRIP + 4 : 6, units.length > 1 ? 4 : RIGHT, 0, 0],
      axes: [x, ...units.map(axis)],
      series: [
        { label: "time", value: (u, at) => at === null || at === undefined ? "-" : this.time === "ms" ? `${at} ms` : `${at.toFixed(1)} s` },
        ...pane.signals.map((signal) => ({
          label: signal.unit ? `${signal.name}, ${signal.unit}` : signal.name, scale: signal.scale ?? signal.unit,
          stroke: () => colour(signal.colour), width: signal.dash ? 1 : 1.5, dash: signal.dash, points: { show: false }, spanGaps: false,
          value: (u, value) => number(value, digits(signal)),
        })),
      ],
      legend: { live: true, mount: (u, element) => u.root.prepend(element) },
      cursor: { sync: { key: this.key.key }, drag: { x: true, y: false }, points: { size: 6 } },
      hooks: {
        draw: [(u) => this.over(u, pane)],
        setScale: [(u, key) => key === "x" && this.zoomed(u)],
        setCursor: [(u) => this.measure(u)],
        ready: [(u) => {
          let from = null;
          u.over.addEventListener("mousedown", (down) => { from = down.offsetX; });
          u.over.addEventListener("click", (up) => {
            if (Math.abs(up.offsetX - from) < 3) this.mark(u.posToVal(up.offsetX, "x"));
          });
          u.over.addEventListener("dblclick", () => {
            this.zoom = this.marked = null;
            this.note?.replaceChildren();
            this.draw();
          });
        }],
      },
    };
    return new uPlot(options, [[], ...pane.signals.map(() => [])], this.host);
  }

  // A person has zoomed one pane: the others follow.
  zoomed(u) {
    if (this.busy) return;
    const { min, max } = u.scales.x;
    if (min === null || min === undefined) return;
    const [begin, end] = this.window();
    if (Math.abs(min - begin) < 1e-9 && Math.abs(max - end) < 1e-9) return;
    this.zoom = [min, max];
    requestAnimationFrame(() => this.draw());
  }

  // Differences are measured from here.
  mark(at) {
    this.marked = at;
    this.plots.forEach((plot) => plot.redraw(false, false));
  }

  measure(u) {
    if (!this.note || this.marked === null || u.cursor.idx === null || u.cursor.idx === undefined) return;
    const nearest = this.times.reduce((best, at, place) => Math.abs(at - this.marked) < Math.abs(this.times[best] - this.marked) ? place : best, 0);
    const here = u.cursor.idx, signals = this.panes.flatMap((pane) => pane.signals);
    const signed = (value, digits) => `${value >= 0 ? "+" : ""}${value.toFixed(digits)}`;
    const parts = signals.flatMap(({ name, unit, digits = 1, dash }, place) => {
      const [from, to] = [this.columns[place]?.[nearest], this.columns[place]?.[here]];
      return dash || typeof from !== "number" || typeof to !== "number" ? [] : [`${name} ${signed(to - from, digits)} ${unit}`];
    });
    this.note.textContent = `From the mark: ${signed(this.times[here] - this.times[nearest], this.time === "ms" ? 0 : 1)} ${this.time}; ${parts.join("; ")}`;
  }

  // What is drawn over a pane: its strip of states, and the mark.
  over(u, pane) {
    const { ctx, bbox } = u, scale = devicePixelRatio || 1;
    const x = (at) => Math.min(bbox.left + bbox.width, Math.max(bbox.left, u.valToPos(at, "x", true)));
    ctx.save();
    if (pane.strip && this.states.length) {
      const top = bbox.top - STRIP * scale, high = (STRIP - 6) * scale;
      ctx.font = `${12 * scale}px system-ui, sans-serif`;
      ctx.textBaseline = "middle";
      ctx.textAlign = "center";
      let from = 0;
      for (let place = 1; place <= this.states.length; place++) {
        if (this.states[place] === this.states[from]) continue;
        const [name, shade] = this.named(this.states[from]);
        const left = x(this.times[from]), right = x(this.times[Math.min(place, this.states.length - 1)]);
        ctx.fillStyle = colour(shade);
        ctx.fillRect(left, top, Math.max(right - left, 1), high);
        if (ctx.measureText(name).width + 8 * scale < right - left) {
          ctx.fillStyle = colour("--on-state");
          ctx.fillText(name, (left + right) / 2, top + high / 2);
        }
        from = place;
      }
    }
    if (this.marked !== null && this.marked >= u.scales.x.min && this.marked <= u.scales.x.max) {
      ctx.strokeStyle = colour("--text");
      ctx.setLineDash([2 * scale, 3 * scale]);
      ctx.beginPath();
      ctx.moveTo(x(this.marked), bbox.top);
      ctx.lineTo(x(this.marked), bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }
}

// A tenth more than the values need; what stands still is not stretched.
function padded(u, min, max) {
  if (min === null || min === undefined) return [0, 1];
  const pad = Math.max(0.05 * (max - min), 0.01 * Math.max(Math.abs(min), Math.abs(max)), 1e-6);
  return [min - pad, max + pad];
}

// Size and phase of loops over a logarithmic frequency.
export class Bode {
  constructor(host) {
    this.host = host;
    this.loops = [];
    this.plots = [];
    new ResizeObserver(() => this.draw()).observe(host);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  // `loops`: [{ name, colour, dash, points, bode: { hz, db, deg, off_db, off_deg } }]. What was measured has a band of what it may be wrong by.
  show(loops) {
    this.loops = loops;
    this.draw();
  }

  draw() {
    for (const plot of this.plots) plot.destroy();
    this.plots = [];
    this.host.replaceChildren();
    const width = this.host.clientWidth, loops = this.loops.filter(({ bode }) => bode.hz.length);
    if (!width || !loops.length) return;
    const key = uPlot.sync("bode");
    this.plots = [["db", "dB", "off_db", 0], ["deg", "degrees", "off_deg", -180]].map(([column, unit, off, line], place) => {
      const tables = loops.flatMap(({ bode }) => {
        const bands = bode[off].length ? [-1, 1].map((sign) => [bode.hz, bode[column].map((value, at) => value + sign * bode[off][at])]) : [];
        return [[bode.hz, bode[column]], ...bands];
      });
      const series = loops.flatMap(({ name, colour: shade, dash, points, bode }) => {
        const one = { label: `${name}, ${unit}`, stroke: () => colour(shade), width: 1.5, dash, spanGaps: true, points: { show: Boolean(points), size: 5 }, value: (u, value) => number(value, 1) };
        const band = { label: "band", stroke: () => colour(shade), width: 0.5, dash: [2, 3], spanGaps: true, points: { show: false }, value: () => "" };
        return [one, ...(bode[off].length ? [band, band] : [])];
      });
      const quiet = () => colour("--quiet"), grid = { stroke: () => colour("--line"), width: 1 };
      const axis = { stroke: quiet, font: "12px system-ui, sans-serif", grid, ticks: { show: false } };
      const options = {
        width, height: 230, scales: { x: { time: false, distr: 3 }, y: { range: padded } },
        padding: [6, 34, 0, 0],
        axes: [
          { ...axis, size: 26, gap: 2, values: (u, splits) => splits.map((at) => (at === null ? "" : `${at} Hz`)) },
          { ...axis, size: LEFT, gap: 4, space: 26, label: unit, labelSize: 18, labelFont: "12px system-ui, sans-serif" },
        ],
        series: [{ label: "frequency", value: (u, at) => (at ? `${at.toFixed(1)} Hz` : "-") }, ...series],
        legend: { live: true, mount: (u, element) => u.root.prepend(element) },
        cursor: { sync: { key: key.key }, drag: { x: true, y: false } },
        hooks: { draw: [(u) => {
          const y = u.valToPos(line, "y", true), { ctx, bbox } = u;
          if (y < bbox.top || y > bbox.top + bbox.height) return;
          ctx.save();
          ctx.strokeStyle = colour("--text");
          ctx.lineWidth = devicePixelRatio || 1;
          ctx.beginPath();
          ctx.moveTo(bbox.left, y);
          ctx.lineTo(bbox.left + bbox.width, y);
          ctx.stroke();
          ctx.restore();
        }] },
      };
      const plot = new uPlot(options, uPlot.join(tables), this.host);
      plot.root.querySelectorAll(".u-legend .u-series").forEach((entry, at) => {
        if (at > 0 && series[at - 1].label === "band") entry.style.display = "none";
      });
      key.sub(plot);
      return plot;
    });
  }
}

// Voltages one above the other, from 0 to above the open circuit: levels as lines, the present voltage as a pointer, and as a band what
// it was in the last ten seconds.
export class Ladder {
  constructor(canvas) {
    this.canvas = canvas;
    this.rungs = [];
    this.volts = null;
    this.band = null;
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  // `rungs`: [{ what, volts, colour }]; `band`: lowest and highest voltage of late.
  show(rungs, volts, band) {
    Object.assign(this, { rungs, volts, band });
    this.draw();
  }

  draw() {
    const { canvas, volts, band } = this, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    const scale = devicePixelRatio || 1;
    canvas.width = width * scale;
    canvas.height = height * scale;
    const g = canvas.getContext("2d");
    g.scale(scale, scale);
    g.font = getComputedStyle(canvas).font;
    g.textBaseline = "middle";
    const rungs = this.rungs.filter((rung) => rung.volts !== null).sort((a, b) => b.volts - a.volts);
    const most = 1.08 * Math.max(10, volts ?? 0, ...rungs.map((rung) => rung.volts));
    const y = (value) => height - 10 - Math.min(1, Math.max(0, value) / most) * (height - 20);
    const left = 8, right = 58;
    g.fillStyle = colour("--back");
    g.fillRect(left, y(most), right - left, y(0) - y(most));
    if (band) {
      g.fillStyle = colour("--trace");
      g.globalAlpha = 0.25;
      g.fillRect(left, y(band[1]), right - left, Math.max(2, y(band[0]) - y(band[1])));
      g.globalAlpha = 1;
    }
    let above = -Infinity;
    for (const rung of rungs) {
      g.fillStyle = colour(rung.colour);
      g.fillRect(left, y(rung.volts) - 1.5, right - left, 3);
      // Names that would lie on each other move down.
      const at = Math.max(y(rung.volts), above + 17);
      above = at;
      g.textAlign = "left";
      g.fillText(`${rung.volts.toFixed(0)} V ${rung.what}`, right + 22, at);
    }
    if (volts !== null) {
      g.fillStyle = colour("--text");
      g.beginPath();
      g.moveTo(right - 14, y(volts));
      g.lineTo(right + 14, y(volts) - 11);
      g.lineTo(right + 14, y(volts) + 11);
      g.fill();
      g.fillRect(left, y(volts) - 1.5, right - left, 3);
    }
  }
}

// Counts in bins of a logarithmic scale, as counts an octave: the bins are not equally wide.
export class Histogram {
  constructor(canvas) {
    this.canvas = canvas;
    this.counts = [];
    this.ends = [];
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  // `ends`: where each bin ends, us; the last one has no end.
  show(counts, ends) {
    [this.counts, this.ends] = [counts, ends];
    this.draw();
  }

  draw() {
    const { canvas, counts, ends } = this;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    const scale = devicePixelRatio || 1;
    canvas.width = width * scale;
    canvas.height = height * scale;
    if (!counts.length) return;
    const g = canvas.getContext("2d");
    g.scale(scale, scale);
    g.font = getComputedStyle(canvas).font;
    g.fillStyle = colour("--quiet");
    g.strokeStyle = colour("--line");
    g.lineWidth = 1;
    const line = (x0, y0, x1, y1) => {
      g.beginPath();
      g.moveTo(x0, y0);
      g.lineTo(x1, y1);
      g.stroke();
    };
    // The first bin begins at 0, and the last has no end: as wide as the octave's half that they would be.
    const edges = [ends[0] / 1.5, ...ends.slice(0, -1), ends.at(-2) * 4 / 3].map(Math.log2);
    const density = counts.map((count, bin) => count / (edges[bin + 1] - edges[bin]));
    const most = Math.max(4, ...density);
    const wide = width - LEFT - RIGHT, top = 8, base = height - 20;
    const x = (octave) => LEFT + (octave - edges[0]) / (edges.at(-1) - edges[0]) * wide;
    const y = (count) => base - count / most * (base - top);
    g.textAlign = "right";
    g.textBaseline = "middle";
    const step = Math.max(1, nice(most / 3));
    for (let count = 0; count <= most; count += step) {
      line(LEFT, y(count), width - RIGHT, y(count));
      g.fillText(count, LEFT - 6, y(count));
    }
    g.textAlign = "center";
    for (const [us, text] of [[1, "1 us"], [10, "10 us"], [100, "100 us"], [1000, "1 ms"], [10_000, "10 ms"]]) {
      const at = x(Math.log2(us));
      line(at, base, at, base + 4);
      g.fillText(text, at, height - 8);
    }
    g.fillStyle = colour("--trace");
    density.forEach((count, bin) => g.fillRect(x(edges[bin]), y(count), x(edges[bin + 1]) - x(edges[bin]) - 0.5, base - y(count)));
  }
}

// 1, 2 or 5 times a power of ten.
function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return power * ([1, 2, 5].find((digit) => digit * power >= step) ?? 10);
}
