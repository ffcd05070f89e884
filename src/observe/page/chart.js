// The course of Cz and of what the model asked for, drawn at the size it is shown in, so that its words stay readable.

import { clock, day, element, fixed, svg } from "./text.js";

const KEPT = 1800;
const HEIGHT = 190;
const LEFT = 46;
const RIGHT = 10;
const TOP = 26;
const BOTTOM = 24;
// Longer without a sample, and the line is broken: nobody knows what was in between.
const GAP_MS = 5000;
const SMALLEST_SPAN_UM = 2;

export class Chart {
  constructor() {
    this.samples = [];
    this.svg = svg("svg", { role: "img", height: HEIGHT });
    this.root = element("figure", { className: "chart" },
      element("figcaption", {},
        element("span", { className: "key cz-key" }, "Cz"),
        element("span", { className: "key raw-key" }, "model asks for"),
        element("span", { className: "quiet" }, "µm over machine time, since this page was opened")),
      this.svg);
    new ResizeObserver(() => this.draw()).observe(this.root);
  }

  add(at, axis) {
    const heard = Date.now();
    const before = this.samples.at(-1);
    if (before && at < before.at) this.samples = [];
    const broken = before !== undefined && heard - before.heard > GAP_MS;
    this.limit = axis.limit_um;
    this.samples.push({ at, heard, broken, cz: axis.cz_um, raw: axis.raw_um });
    if (this.samples.length > KEPT) this.samples.shift();
    this.draw();
  }

  draw() {
    const width = this.root.clientWidth;
    if (!width || !this.samples.length) return;
    const [from, to] = [this.samples[0].at, Math.max(this.samples.at(-1).at, this.samples[0].at + 1000)];
    const ticks = ticksFor(this.samples);
    const [low, high] = [ticks[0], ticks.at(-1)];
    const x = (at) => LEFT + ((at - from) / (to - from)) * (width - LEFT - RIGHT);
    const y = (value) => TOP + ((high - value) / (high - low)) * (HEIGHT - TOP - BOTTOM);
    const digits = ticks[1] - ticks[0] < 1 ? 1 : 0;

    const parts = [svg("text", { x: 4, y: 12 }, "µm")];
    for (const tick of ticks) {
      parts.push(svg("line", { class: tick === 0 ? "zero" : "grid", x1: LEFT, x2: width - RIGHT, y1: y(tick), y2: y(tick) }));
      parts.push(svg("text", { x: LEFT - 6, y: y(tick) + 4, "text-anchor": "end" }, fixed(tick, digits)));
    }
    const limits = [-this.limit, this.limit].filter((limit) => limit >= low && limit <= high);
    for (const limit of limits) {
      parts.push(svg("line", { class: "limit", x1: LEFT, x2: width - RIGHT, y1: y(limit), y2: y(limit) }));
    }
    const foot = HEIGHT - 6;
    const seconds = to - from < 600e3;
    const when = (at) => (to - from > 20 * 3600e3 ? `${day(new Date(at)).slice(5)} ` : "") + clock(new Date(at), seconds);
    parts.push(svg("text", { x: LEFT, y: foot }, when(from)));
    parts.push(svg("text", { x: (LEFT + width - RIGHT) / 2, y: foot, "text-anchor": "middle" }, when((from + to) / 2)));
    parts.push(svg("text", { x: width - RIGHT, y: foot, "text-anchor": "end" }, when(to)));
    parts.push(...lines(this.samples, "cz", x, y), ...lines(this.samples, "raw", x, y));
    for (const limit of limits) {
      parts.push(svg("text", { x: LEFT + 6, y: y(limit) + (limit > 0 ? 13 : -5) }, "limit"));
    }

    this.svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    this.svg.setAttribute("aria-label", `Course of Cz between ${fixed(low, digits)} and ${fixed(high, digits)} micrometres`);
    this.svg.replaceChildren(...parts);
  }
}

// One polyline for each stretch without a gap; a stretch of one sample is a dot.
function lines(samples, name, x, y) {
  const stretches = [[]];
  for (const sample of samples) {
    if (sample.broken || sample[name] === null) stretches.push([]);
    if (sample[name] !== null) stretches.at(-1).push(`${x(sample.at).toFixed(1)},${y(sample[name]).toFixed(1)}`);
  }
  return stretches.filter((points) => points.length).map((points) => {
    if (points.length > 1) return svg("polyline", { class: name, points: points.join(" ") });
    const [cx, cy] = points[0].split(",");
    return svg("circle", { class: name, cx, cy, r: 2.5 });
  });
}

// Round numbers around everything seen: about four of them, at 1, 2 or 5 of a power of ten.
function ticksFor(samples) {
  const values = samples.flatMap((sample) => [sample.cz, sample.raw]).filter((value) => value !== null);
  let [low, high] = [Math.min(...values), Math.max(...values)];
  const middle = (low + high) / 2;
  if (high - low < SMALLEST_SPAN_UM) [low, high] = [middle - SMALLEST_SPAN_UM / 2, middle + SMALLEST_SPAN_UM / 2];
  const rough = (high - low) / 4;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => power * factor >= rough * 0.999);
  const ticks = [];
  for (let count = Math.floor(low / step + 1e-9); count <= Math.ceil(high / step - 1e-9); count += 1) {
    ticks.push(Number((count * step).toFixed(6)));
  }
  return ticks;
}
