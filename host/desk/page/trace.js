// A trace on a canvas: the last minute of values as they come, or a record from its begin; the scale as they need it.

const MINUTE_MS = 60_000;
const MARGIN = { left: 56, right: 8, top: 8, bottom: 20 };

export class Trace {
  constructor(canvas, least) {
    this.canvas = canvas;
    // The scale spans this much at the least: noise does not fill the picture.
    this.least = least;
    this.points = [];
    this.target = null;
    this.span = MINUTE_MS;
    // When the newest point is not of now: of when.
    this.until = null;
    // A record is shown whole, and its time is that since its begin.
    this.record = false;
    const draw = () => this.draw();
    const resized = new ResizeObserver(draw), scheme = matchMedia("(prefers-color-scheme: dark)");
    resized.observe(canvas);
    scheme.addEventListener("change", draw);
    // One that is not shown any more keeps nothing alive.
    this.close = () => {
      resized.disconnect();
      scheme.removeEventListener("change", draw);
    };
  }

  add(at, value) {
    // Nothing measured is a gap in the line; its time goes on.
    if (!Number.isFinite(value)) value = null;
    const last = this.points.at(-1);
    if (last && at < last.at) this.points = [];
    this.points.push({ at, value });
    while (this.points[0].at < at - this.span) this.points.shift();
  }

  show(values, every) {
    this.record = true;
    this.span = Math.max(1, (values.length - 1) * every);
    this.points = values.map((value, place) => ({ at: place * every, value }));
    this.draw();
  }

  clear() {
    this.points = [];
  }

  draw() {
    const { canvas, points } = this;
    const made = prepare(canvas);
    if (!made) return;
    const { g, width, height, colour } = made;
    const values = points.map((point) => point.value).filter((value) => value !== null);
    if (!values.length) values.push(this.target ?? 0);
    // A short spike does not decide the scale: it is cut off.
    values.sort((a, b) => a - b);
    const spikes = this.record ? 0 : Math.floor(values.length / 50);
    let low = values[spikes], high = values.at(-1 - spikes);
    if (this.target !== null) [low, high] = [Math.min(low, this.target), Math.max(high, this.target)];
    const lack = Math.max(this.least - (high - low), 0.1 * (high - low));
    low -= lack / 2;
    high += lack / 2;
    const step = nice((high - low) / 4);
    const end = points.length ? points.at(-1).at : this.span;
    const x = (at) => MARGIN.left + (1 - (end - at) / this.span) * (width - MARGIN.left - MARGIN.right);
    const y = (value) => MARGIN.top + (high - value) / (high - low) * (height - MARGIN.top - MARGIN.bottom);
    g.textAlign = "right";
    g.textBaseline = "middle";
    const digits = Math.max(0, -Math.floor(Math.log10(step)));
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      line(g, MARGIN.left, y(value), width - MARGIN.right, y(value));
      g.fillText((Math.abs(value) < step / 2 ? 0 : value).toFixed(digits), MARGIN.left - 6, y(value));
    }
    g.textAlign = "center";
    for (let part = 0; part <= 6; part++) {
      const back = part * this.span / 6;
      const text = this.record ? `${(this.span - back).toFixed(0)} ms` : part ? `-${(back / 1000).toFixed(0)} s` : this.until ?? "now";
      g.fillText(text, Math.min(x(end - back), width - 32), height - 8);
    }
    if (this.target !== null) {
      g.strokeStyle = colour("--target");
      g.setLineDash([6, 4]);
      line(g, MARGIN.left, y(this.target), width - MARGIN.right, y(this.target));
      g.setLineDash([]);
    }
    g.beginPath();
    g.rect(MARGIN.left, 0, width - MARGIN.left - MARGIN.right, height - MARGIN.bottom);
    g.clip();
    g.strokeStyle = colour("--trace");
    g.lineWidth = 1.5;
    g.beginPath();
    let after = false;
    for (const point of points) {
      if (point.value !== null) {
        if (after) g.lineTo(x(point.at), y(point.value));
        else g.moveTo(x(point.at), y(point.value));
      }
      after = point.value !== null;
    }
    g.stroke();
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
    const made = prepare(canvas);
    if (!made || !counts.length) return;
    const { g, width, height, colour } = made;
    // The first bin begins at 0, and the last has no end: as wide as the octave's half that they would be.
    const edges = [ends[0] / 1.5, ...ends.slice(0, -1), ends.at(-2) * 4 / 3].map(Math.log2);
    const density = counts.map((count, bin) => count / (edges[bin + 1] - edges[bin]));
    const most = Math.max(4, ...density);
    const wide = width - MARGIN.left - MARGIN.right, base = height - MARGIN.bottom;
    const x = (octave) => MARGIN.left + (octave - edges[0]) / (edges.at(-1) - edges[0]) * wide;
    const y = (count) => base - count / most * (base - MARGIN.top);
    g.textAlign = "right";
    g.textBaseline = "middle";
    const step = Math.max(1, nice(most / 3));
    for (let count = 0; count <= most; count += step) {
      line(g, MARGIN.left, y(count), width - MARGIN.right, y(count));
      g.fillText(count, MARGIN.left - 6, y(count));
    }
    g.textAlign = "center";
    for (const [us, text] of [[1, "1 us"], [10, "10 us"], [100, "100 us"], [1000, "1 ms"], [10_000, "10 ms"]]) {
      const at = x(Math.log2(us));
      line(g, at, base, at, base + 4);
      g.fillText(text, at, height - 8);
    }
    g.fillStyle = colour("--trace");
    density.forEach((count, bin) => g.fillRect(x(edges[bin]), y(count), x(edges[bin + 1]) - x(edges[bin]) - 0.5, base - y(count)));
  }
}

// A canvas as large as it is shown, blank; null where it is not shown.
function prepare(canvas) {
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width || !height) return null;
  const scale = devicePixelRatio || 1;
  canvas.width = width * scale;
  canvas.height = height * scale;
  const g = canvas.getContext("2d");
  g.scale(scale, scale);
  const style = getComputedStyle(canvas);
  const colour = (name) => style.getPropertyValue(name).trim();
  g.font = style.font;
  g.fillStyle = colour("--quiet");
  g.strokeStyle = colour("--line");
  g.lineWidth = 1;
  return { g, width, height, colour };
}

function line(g, x0, y0, x1, y1) {
  g.beginPath();
  g.moveTo(x0, y0);
  g.lineTo(x1, y1);
  g.stroke();
}

// 1, 2 or 5 times a power of ten.
function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return power * ([1, 2, 5].find((digit) => digit * power >= step) ?? 10);
}
