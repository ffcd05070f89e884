// What was: Cz, what the models asked for, and temperatures, from the gateway's own logs, however long the page is open.

import { clock, day, element, fixed, labelled, quantity, say, zoneName } from "./text.js";
import { t } from "./words.js";

const SPANS = [["1h", 3600], ["8h", 8 * 3600], ["24h", 86400], ["7d", 7 * 86400], ["30d", 30 * 86400]];
const SHORTEST_S = 10;
const LONGEST_S = 400 * 86400;
const REFRESH_MS = 10000;
const HEIGHT = 240;
const COLOURS = ["#0b7fab", "#d1495b", "#2a9d5c", "#b7791f", "#8064c8", "#c2469a", "#3d8b99", "#7a8790"];

const by = (id) => document.getElementById(id);
// `to` is null where it is now; `at` is the gateway's now, in seconds.
const view = { span: 8 * 3600, to: null, at: null };
let lines = null;
let charts = [];
let asked = 0;
let refreshed = 0;

const spans = new Map(SPANS.map(([name, span]) => {
  const button = element("button", { type: "button", className: "small" }, t(`past_${name}`));
  button.addEventListener("click", () => look(span, null));
  return [span, button];
}));

const end = () => view.to ?? view.at;
const tools = [
  ["past_earlier", "◀", () => look(view.span, end() - view.span / 2)],
  ["past_later", "▶", () => look(view.span, end() + view.span / 2)],
  ["past_nearer", "+", () => look(view.span / 2, view.to && end() - view.span / 4)],
  ["past_further", "−", () => look(view.span * 2, view.to && end() + view.span / 2)],
].map(([name, sign, act]) => {
  const button = element("button", { type: "button", className: "small", title: t(name), ariaLabel: t(name) }, sign);
  button.addEventListener("click", act);
  return button;
});

function look(span, to) {
  view.span = Math.min(LONGEST_S, Math.max(SHORTEST_S, span));
  view.to = to === null || to >= view.at ? null : to;
  load();
}

// Which columns there are is known from the first status.
export function showPast(status) {
  view.at = new Date(status.now).getTime() / 1000;
  if (lines === null) {
    by("past-tools").append(...spans.values(), ...tools);
    const ofAxis = (axis, index) => [
      ["cz", "Cz", []], ["raw", t("raw"), [5, 4]],
      ...axis.truth ? [["error", t("true_error"), [2, 3], 1], ["left", t("true_left"), [9, 3], 2]] : [],
    ].map(([column, title, dash, truth]) =>
      ({ column: `${axis.name}_${column}_um`, label: `${title} ${labelled(axis)}`, unit: "um", dash, index, truth }));
    const temperatures = status.signals.filter(({ unit }) => unit === "degC" || unit === "K");
    lines = [
      status.axes.filter((axis) => !axis.release).flatMap(ofAxis),
      temperatures.map((signal, index) => ({ column: signal.name, label: labelled(signal), unit: signal.unit, dash: [], index })),
    ].filter((one) => one.length);
    load();
  } else if (view.to === null && !document.hidden && Date.now() - refreshed > Math.max(REFRESH_MS, view.span)) {
    load();
  }
}

async function load() {
  refreshed = Date.now();
  const mine = (asked += 1);
  spans.forEach((button, span) => button.setAttribute("aria-pressed", view.to === null && span === view.span));
  const moment = (seconds) => new Date(seconds * 1000).toISOString();
  const columns = (some) => some.map(({ column }) => column).slice(0, 64).join(",");
  const question = new URLSearchParams({ from: moment(end() - view.span), to: moment(end()) });
  // Only a virtual machine knows the truth, and it has no rows beside those of the log.
  question.set("columns", columns(lines.flat().filter(({ truth }) => !truth)));
  by("past-download").href = `api/history.csv?${question}`;
  question.set("columns", columns(lines.flat()));
  question.set("points", Math.max(100, Math.min(1000, by("past-charts").clientWidth)));
  try {
    const response = await fetch(`api/history?${question}`);
    const course = response.ok ? await response.json() : null;
    if (mine !== asked) return;
    const note = course === null ? (await response.text()).trim() : course.rows ? "" : t("past_nothing");
    by("past-note").lang = course === null ? "en" : "";
    say(by("past-note"), note);
    if (course) draw(course);
  } catch {
    if (mine === asked) say(by("past-note"), t("no_connection"));
  }
}

// The smallest and the largest value of a stretch stand at the same time: a line through both loses no peak.
function data(course, group) {
  const of = new Map(course.columns.map((column) => [column.name, column]));
  const twice = (one, other) => one.flatMap((value, place) => [value, other[place]]);
  const empty = course.time.map(() => null);
  const columns = group.map(({ column }) => of.get(column) ?? { min: empty, max: empty });
  return [twice(course.time, course.time), ...columns.map(({ min, max }) => twice(min, max))];
}

function draw(course) {
  if (!charts.length) charts = lines.map((group) => new uPlot(options(group), [[]], by("past-charts")));
  const [from, to] = [end() - view.span, end()];
  charts.forEach((chart, place) => {
    chart.setSize({ width: by("past-charts").clientWidth, height: HEIGHT });
    chart.setData(data(course, lines[place]), false);
    chart.setScale("x", { min: from, max: to });
  });
}

function options(group) {
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
  const axis = () => ({ stroke: colour("--quiet"), grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line") } });
  const least = group[0].unit === "um" ? 2 : 1;
  const range = (_, min, max) => {
    if (min === null || min > max) return [-least / 2, least / 2];
    const more = Math.max((least - (max - min)) / 2, (max - min) * 0.08);
    return [min - more, max + more];
  };
  const at = (seconds) => (seconds === null || seconds === undefined ? "–" : `${day(new Date(seconds * 1000))} ${clock(new Date(seconds * 1000))}`);
  return {
    width: by("past-charts").clientWidth,
    height: HEIGHT,
    tzDate: (seconds) => uPlot.tzDate(new Date(seconds * 1000), zoneName()),
    scales: { x: { time: true, auto: false }, y: { range } },
    axes: [
      { ...axis(), values: (_, splits, __, ___, step) => splits.map((split, place) => tick(splits, place, step)) },
      { ...axis(), size: 60, values: (_, splits, __, ___, step) => splits.map((split) => fixed(split, step < 1 ? 1 : 0)), label: quantity(0, group[0].unit).split(" ")[1], labelSize: 20 },
    ],
    series: [
      { label: t("machine_time"), value: (_, seconds) => at(seconds) },
      ...group.map(({ label, dash, index, truth, unit }) => ({
        label, dash, stroke: dash.length && !truth ? colour("--text") : COLOURS[(index + (truth ?? 0)) % COLOURS.length], width: dash.length ? 1.3 : 2, points: { show: false },
        value: (_, value) => (value === null || value === undefined ? "–" : quantity(value, unit)),
      })),
    ],
    cursor: {
      drag: { x: true, y: false, setScale: false },
      sync: { key: "past" },
      bind: { dblclick: () => () => look(8 * 3600, null) },
    },
    legend: { markers: { dash: (chart, line) => (chart.series[line].dash?.length ? "dashed" : "solid") } },
    hooks: { setSelect: [zoom] },
  };
}

function tick(splits, place, step) {
  const date = new Date(splits[place] * 1000);
  const its = day(date).slice(5);
  if (step >= 86400) return its;
  const before = place ? day(new Date(splits[place - 1] * 1000)).slice(5) : "";
  return clock(date, step < 60) + (before === its ? "" : `\n${its}`);
}

// What was drawn over with the mouse is looked at closely.
function zoom(chart) {
  const { left, width } = chart.select;
  if (width < 5) return;
  const [from, to] = [left, left + width].map((place) => chart.posToVal(place, "x"));
  chart.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
  look(to - from, to);
}

new ResizeObserver(() => charts.forEach((chart) => chart.setSize({ width: by("past-charts").clientWidth, height: HEIGHT })))
  .observe(by("past-charts"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  charts.forEach((chart) => chart.destroy());
  charts = [];
  if (lines) load();
});
