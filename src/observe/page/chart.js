// One chart: lines, limits, the states of an axis as bands, and events as marks. The legend has the last values.

import { TONES } from "./events.js";
import { SIGNS } from "./states.js";
import { clock, day, element, fixed, level, quantity, say, signed, svg, zoneName } from "./text.js";
import { english, t } from "./words.js";

const HEIGHT = 250;
// The nearest mark is named if the cursor is at most this far away, in pixels.
const NEAR = 12;
// Least distance of two times below the chart, in pixels: without and with their seconds.
const TICK_SPACE = 50;
const TICK_SPACE_SECONDS = 75;
const COLOURS = ["--line-1", "--line-2", "--line-3", "--line-4", "--line-5", "--line-6", "--line-7", "--line-8"];
const FONT = '12px system-ui, "DejaVu Sans", sans-serif';

const variable = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const colourOf = ({ colour, index }) => colour ?? COLOURS[index % COLOURS.length];
const at = (seconds) => `${day(new Date(seconds * 1000))} ${clock(new Date(seconds * 1000))}`;

function tick(splits, place, step) {
  const date = new Date(splits[place] * 1000);
  const its = day(date).slice(5);
  if (step >= 86400) return its;
  const before = place ? day(new Date(splits[place - 1] * 1000)).slice(5) : "";
  return clock(date, step < 60) + (before === its ? "" : `\n${its}`);
}

// A distance at which times would have seconds is that of times with seconds.
const tickSpace = (_, __, from, to, width) => (((to - from) / width) * TICK_SPACE < 60 ? TICK_SPACE_SECONDS : TICK_SPACE);

function key(line) {
  const stroke = svg("line", { x1: 1, x2: 27, y1: 6, y2: 6, "stroke-dasharray": line.dash.join(" "), "stroke-width": line.width });
  stroke.style.stroke = `var(${colourOf(line)})`;
  const drawing = svg("svg", { class: "key", width: 28, height: 12, "aria-hidden": "true" });
  drawing.append(stroke);
  return drawing;
}

export class Chart {
  // `group` has `id`, `title`, `unit`, `lines` of `{ column, label, dash, width, colour or index }`; `zoom(from, to)` and
  // `whole()` are called for the mouse.
  constructor(group, zoom, whole) {
    Object.assign(this, { group, zoom, whole });
    this.past = { bands: [], marks: [], dots: [], limit: null, moment: null };
    this.now = null;
    this.values = group.lines.map(() => element("b", {}, "–"));
    const items = group.lines.map((line, place) => element("li", {}, key(line), element("span", {}, line.label), " ", this.values[place]));
    this.limit = element("li", { hidden: true });
    this.dots = element("li", { hidden: true }, element("span", { className: "dot-key", ariaHidden: "true" }, "●"), t("residual_dots"));
    this.states = element("li", { className: "states", hidden: true });
    this.time = element("span", { className: "quiet" });
    this.event = english(element("span"));
    this.box = element("div", { className: "canvas", role: "img", ariaLabel: group.title });
    this.root = element("figure", { className: "chart", id: `chart-${group.id}`, tabIndex: -1 },
      element("figcaption", {}, element("h3", {}, group.title), this.time),
      element("ul", { className: "legend" }, ...items, this.limit, this.dots, this.states),
      this.box,
      element("p", { className: "at" }, this.event));
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(this.box);
  }

  size() {
    return { width: Math.max(200, this.box.clientWidth), height: HEIGHT };
  }

  // `data` is uPlot's: times, and a list of values for each line. `past` has bands, marks, dots, limit and moment.
  show(data, past, from, to) {
    this.past = past;
    this.data = data;
    this.plot ??= new uPlot(this.options(), [[]], this.box);
    this.plot.batch(() => {
      this.plot.setData(data, false);
      this.plot.setScale("x", { min: from, max: to });
    });
    this.limit.hidden = past.limit === null;
    say(this.limit, past.limit === null ? "" : t("limits_at", { um: level(past.limit) }));
    this.dots.hidden = past.dots.length === 0;
    const words = new Map(past.bands.map(({ word, tone }) => [word, tone]));
    this.states.hidden = words.size === 0;
    this.states.replaceChildren(...[...words].map(([word, tone]) =>
      element("span", { className: "badge", "data-tone": tone }, `${SIGNS[tone]} ${word}`)));
    this.name(null);
  }

  // Takes the values of now, one for each line; null if the chart ends before now.
  live(now) {
    this.now = now;
    if (this.plot && (this.plot.cursor.idx ?? null) === null) this.name(null);
  }

  // Shows the values at this place of the data, or the last ones, and the event that is nearest there. The data has the
  // smallest and the largest value of an interval; the last value is that of now, if the chart reaches until now.
  name(place) {
    const texts = this.group.lines.map(({ unit }, index) => {
      const values = this.data[index + 1];
      const last = () => (this.now ? this.now[index] : values.findLast((one) => one !== null && one !== undefined));
      const value = place === null ? last() : values[place];
      return value === null || value === undefined ? "–" : unit === "um" ? `${signed(value, 1)} µm` : quantity(value, unit);
    });
    this.values.forEach((node, index) => say(node, texts[index]));
    say(this.time, place === null ? t("last_values") : at(this.data[0][place]));
    const { left } = this.plot.cursor;
    const near = left >= 0 && place !== null ? this.past.marks
      .map((mark) => [Math.abs(this.plot.valToPos(mark.at, "x") - left), mark])
      .filter(([distance]) => distance <= NEAR)
      .sort(([one], [other]) => one - other)[0]?.[1] : this.past.moment?.chart === this ? this.past.moment : null;
    say(this.event, near ? `${at(near.at)} ${near.text}` : "");
    if (place !== null) return;
    this.box.ariaLabel = `${this.group.title}: ${this.group.lines.map(({ label }, index) => `${label} ${texts[index]}`).join(", ")}`;
  }

  destroy() {
    this.plot?.destroy();
    this.plot = null;
  }

  range(low, high) {
    const { dots, limit } = this.past;
    const least = this.group.unit === "um" ? 2 : 1;
    const { min: from, max: to } = this.plot?.scales.x ?? {};
    const seen = dots.filter(([time]) => time >= from && time <= to).map(([, value]) => value);
    const all = [low, high, ...seen].filter((value) => value !== null && Number.isFinite(value));
    let [min, max] = all.length && low <= high ? [Math.min(...all), Math.max(...all)] : [0, 0];
    // A limit is in sight when the values come near it.
    if (limit !== null && max > 0.7 * limit) max = Math.max(max, limit);
    if (limit !== null && min < -0.7 * limit) min = Math.min(min, -limit);
    const more = Math.max((least - (max - min)) / 2, (max - min) * 0.08);
    return [min - more, max + more];
  }

  options() {
    const axis = () => ({ stroke: variable("--quiet"), font: FONT, grid: { stroke: variable("--line"), width: 1 }, ticks: { stroke: variable("--line") } });
    const { lines, unit } = this.group;
    return {
      ...this.size(),
      tzDate: (seconds) => uPlot.tzDate(new Date(seconds * 1000), zoneName()),
      scales: { x: { time: true, auto: false }, y: { range: (_, min, max) => this.range(min, max) } },
      axes: [
        { ...axis(), space: tickSpace, values: (_, splits, __, ___, step) => splits.map((split, place) => tick(splits, place, step)) },
        {
          ...axis(), size: 52, label: quantity(0, unit).split(" ")[1], labelSize: 18, labelFont: FONT,
          values: (_, splits, __, ___, step) => splits.map((split) => fixed(split, step < 1 ? 1 : 0)),
        },
      ],
      series: [{}, ...lines.map((line) => ({ stroke: variable(colourOf(line)), width: line.width, dash: line.dash, points: { show: false } }))],
      cursor: { drag: { x: true, y: false, setScale: false }, sync: { key: "past" }, bind: { dblclick: () => () => this.whole() } },
      legend: { show: false },
      hooks: {
        drawClear: [(plot) => this.drawBehind(plot)],
        draw: [(plot) => this.drawAbove(plot)],
        setCursor: [(plot) => this.plot && this.name(plot.cursor.idx ?? null)],
        setSelect: [(plot) => this.select(plot)],
      },
    };
  }

  // The bands of states, with their word where it fits.
  drawBehind(plot) {
    const { ctx, bbox } = plot;
    const ratio = devicePixelRatio;
    ctx.save();
    ctx.font = `${12 * ratio}px system-ui, sans-serif`;
    ctx.textBaseline = "top";
    ctx.textAlign = "left";
    for (const { from, to, tone, word } of this.past.bands) {
      const [left, right] = [from, to].map((time) => Math.max(bbox.left, Math.min(bbox.left + bbox.width, plot.valToPos(time, "x", true))));
      if (right <= left) continue;
      ctx.fillStyle = variable(`--${tone}-ground`);
      ctx.fillRect(left, bbox.top, Math.max(ratio, right - left), bbox.height);
      ctx.fillStyle = variable(`--${tone}`);
      if (ctx.measureText(word).width + 8 * ratio < right - left) ctx.fillText(word, left + 4 * ratio, bbox.top + 3 * ratio);
    }
    ctx.restore();
  }

  // Limits, measured residual errors, marks of events, and the moment of an alarm.
  drawAbove(plot) {
    const { ctx, bbox } = plot;
    const ratio = devicePixelRatio;
    const bottom = bbox.top + bbox.height;
    const { limit, dots, marks, moment } = this.past;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    const line = (points, colour, dash) => {
      ctx.strokeStyle = variable(colour);
      ctx.lineWidth = 1.5 * ratio;
      ctx.setLineDash(dash.map((part) => part * ratio));
      ctx.beginPath();
      points.forEach(([x, y]) => ctx.lineTo(x, y));
      ctx.stroke();
    };
    for (const value of limit === null ? [] : [-limit, limit]) {
      const y = plot.valToPos(value, "y", true);
      line([[bbox.left, y], [bbox.left + bbox.width, y]], "--bad", [8, 3, 2, 3]);
    }
    ctx.fillStyle = variable("--left");
    for (const [time, value] of dots) {
      ctx.beginPath();
      ctx.arc(plot.valToPos(time, "x", true), plot.valToPos(value, "y", true), 4 * ratio, 0, 2 * Math.PI);
      ctx.fill();
    }
    for (const mark of marks) {
      const x = plot.valToPos(mark.at, "x", true);
      const size = (mark.level === "error" ? 6 : 5) * ratio;
      ctx.fillStyle = variable(`--${TONES[mark.level] ?? "off"}`);
      ctx.beginPath();
      // As everywhere: a square is an error, a triangle a warning, a circle anything else.
      if (mark.level === "error") ctx.rect(x - size, bottom - 2 * size, 2 * size, 2 * size);
      else if (mark.level === "warning") [[-size, 0], [size, 0], [0, -2 * size]].forEach(([dx, dy]) => ctx.lineTo(x + dx, bottom + dy));
      else ctx.arc(x, bottom - size, size * 0.8, 0, 2 * Math.PI);
      ctx.fill();
    }
    if (moment !== null) {
      const x = plot.valToPos(moment.at, "x", true);
      line([[x, bbox.top], [x, bottom]], "--text", [4, 3]);
    }
    ctx.restore();
  }

  // The part over which the mouse was drawn is enlarged.
  select(plot) {
    const { left, width } = plot.select;
    if (width < 5) return;
    const [from, to] = [left, left + width].map((place) => plot.posToVal(place, "x"));
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.zoom(from, to);
  }
}
