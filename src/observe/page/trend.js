// A small line without axes: the course of the last hour.

import { inOrder } from "./history.js";
import { svg } from "./text.js";

const WIDTH = 300;
const HEIGHT = 100;
const EDGE = 6;

// Points in the order in which they are drawn: `[time, first, second]`. Both values of an interval are drawn at the same time,
// so that no peak is lost.
function ordered(points) {
  const pairs = inOrder(points.map(([, low, high]) => [low, high]));
  return points.map(([at], place) => [at, ...pairs[place]]);
}

function path(points, x, y) {
  let pen = "M";
  let text = "";
  for (const [at, first, second] of points) {
    if (first === null) {
      pen = "M";
      continue;
    }
    text += `${pen}${x(at).toFixed(1)} ${y(first).toFixed(1)}`;
    if (second !== first) text += `L${x(at).toFixed(1)} ${y(second).toFixed(1)}`;
    pen = "L";
  }
  return text;
}

export class Trend {
  constructor(label) {
    this.root = svg("svg", { class: "trend", role: "img", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", "aria-label": label });
    this.zero = svg("line", { class: "zero", x1: 0, x2: WIDTH });
    this.wish = svg("path", { class: "wish-line" });
    this.line = svg("path", { class: "line" });
    this.end = svg("path", { class: "end" });
    this.limits = [svg("line", { class: "limit", x1: 0, x2: WIDTH }), svg("line", { class: "limit", x1: 0, x2: WIDTH })];
    this.root.append(this.zero, ...this.limits, this.wish, this.line, this.end);
  }

  // Points are `[time, smallest, largest]`. The height fits the values, but is at least `least`, which may be 0.
  show({ points, wished = [], from, to, least, limit = null, label }) {
    const values = [...points, ...wished].flatMap(([, low, high]) => (low === null ? [] : [low, high]));
    this.root.setAttribute("aria-label", label);
    this.root.classList.toggle("empty", values.length === 0);
    if (values.length === 0) return [this.line, this.wish, this.end].forEach((one) => one.setAttribute("d", ""));
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const more = (Math.max(0, least - (high - low)) || (high === low ? 1 : 0)) / 2;
    const [bottom, top] = [low - more, high + more];
    const x = (at) => Math.max(0, Math.min(1, (at - from) / (to - from))) * WIDTH;
    const y = (value) => HEIGHT - EDGE - ((value - bottom) / (top - bottom)) * (HEIGHT - 2 * EDGE);
    const across = (line, value) => {
      const isIn = value !== null && value >= bottom && value <= top;
      line.setAttribute("visibility", isIn ? "visible" : "hidden");
      if (isIn) ["y1", "y2"].forEach((end) => line.setAttribute(end, y(value).toFixed(1)));
    };
    across(this.zero, limit === null ? null : 0);
    this.limits.forEach((line, place) => across(line, limit === null ? null : place ? limit : -limit));
    const drawn = ordered(points);
    this.line.setAttribute("d", path(drawn, x, y));
    this.wish.setAttribute("d", path(ordered(wished), x, y));
    const last = drawn.findLast(([, value]) => value !== null);
    // A line of no length with a round end is a dot, whatever the width of the drawing is.
    this.end.setAttribute("d", last ? `M${x(last[0]).toFixed(1)} ${y(last[2]).toFixed(1)}h.01` : "");
  }
}
