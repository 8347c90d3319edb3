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
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    const scale = devicePixelRatio || 1;
    canvas.width = width * scale;
    canvas.height = height * scale;
    const g = canvas.getContext("2d");
    g.scale(scale, scale);
    const style = getComputedStyle(canvas);
    const colour = (name) => style.getPropertyValue(name).trim();
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
    g.font = style.font;
    g.fillStyle = colour("--quiet");
    g.strokeStyle = colour("--line");
    g.lineWidth = 1;
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
