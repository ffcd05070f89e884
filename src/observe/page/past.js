// The history of each axis and of the temperatures, from the gateway's own logs, however long the page is open.

import { bands, marks } from "./bands.js";
import { Chart } from "./chart.js";
import { isComplete, since } from "./events.js";
import { byColumn, inOrder, inTurn, packed, query } from "./history.js";
import { element, labelled, say, titled, withoutHint } from "./text.js";
import { t } from "./words.js";

const SPANS = [["1h", 3600], ["8h", 8 * 3600], ["24h", 86400], ["7d", 7 * 86400], ["30d", 30 * 86400]];
const SHORTEST_S = 10;
const LONGEST_S = 400 * 86400;
const REFRESH_MS = 10000;
// An alarm is looked at with this much before and after it.
const AROUND_S = 1800;

const by = (id) => document.getElementById(id);
// `to` is null where it is now; `at` is the gateway's now, in seconds. `moment` is that of an alarm, which one chart names.
const view = { span: 8 * 3600, to: null, at: null, moment: null };
let status = null;
let charts = null;
let asked = 0;
let refreshed = 0;
// The events that were read for the charts: since `from`, at the gateway's time `at`.
let read = { from: Infinity, at: -Infinity, events: [] };

const spans = new Map(SPANS.map(([name, span]) => {
  const button = element("button", { type: "button", className: "small" }, t(`past_${name}`));
  button.addEventListener("click", () => lookWhole(span));
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
  return load();
}

// Looks at the last part of the past, and no longer at an alarm.
function lookWhole(span) {
  view.moment = null;
  look(span, null);
}

// Shows the moment at which an alarm began, in the chart of its axis.
export async function lookAt({ id, since: begin, text, hint }) {
  const at = new Date(begin).getTime() / 1000;
  const name = id.slice(id.lastIndexOf(" ") + 1);
  // As "axis z" and "arming of axis z"; "sensor of axis z: bed" is rather about the sensor.
  const axis = id.match(/axis ([^ :]+)$/)?.[1] ?? status.outputs.find((output) => output.name === name)?.axis;
  const about = id.match(/axis ([^ :]+):/)?.[1];
  const chart = charts.find(({ group }) => group.axis === axis)
    ?? charts.find(({ group }) => group.lines.some(({ column }) => column === name))
    ?? charts.find(({ group }) => group.axis === about) ?? charts[0];
  if (!chart) return;
  view.moment = { at, text: withoutHint(text, hint), chart };
  chart.root.scrollIntoView({ block: "center" });
  chart.root.focus({ preventScroll: true });
  await look(2 * AROUND_S, at + AROUND_S);
}

// The lines of an axis: Cz and the value of its model, and where the errors are known, those as well.
function ofAxis(axis) {
  const { name, truth } = axis;
  const line = (what, label, colour, width, dash = []) =>
    ({ column: `${name}_${what}_um`, what, label, colour, width, dash, unit: "um" });
  return {
    id: name, axis: name, title: titled(t("axis", { names: name }), axis), unit: "um",
    lines: [
      ...truth ? [{ ...line("error", t("true_error"), "--error", 1.5, [2, 3]), isTruth: true }] : [],
      line("cz", "Cz", "--accent", 2.5),
      line("raw", t("raw"), "--text", 1.3, [6, 4]),
      ...truth ? [{ ...line("left", t("true_left"), "--left", 2), isTruth: true }] : [],
    ],
  };
}

// Which columns there are is known from the first status.
function make() {
  by("past-tools").append(...spans.values(), ...tools);
  const temperatures = status.signals.filter(({ unit }) => unit === "degC" || unit === "K");
  const line = (signal, index) => ({ column: signal.name, label: labelled(signal), unit: signal.unit, dash: [], width: 2, index });
  const groups = status.axes.filter(({ release }) => !release).map(ofAxis);
  if (temperatures.length) {
    groups.push({ id: "signals-of-temperature", axis: null, title: t("temperatures"), unit: temperatures[0].unit, lines: temperatures.map(line) });
  }
  charts = groups.map((group) => new Chart(group, (from, to) => look(to - from, to), () => lookWhole(8 * 3600)));
  by("past-charts").append(...charts.map(({ root }) => root));
}

// The present values of the lines of a chart.
function present({ axis: name, lines }) {
  const axis = status.axes.find((one) => one.name === name);
  if (!axis) return lines.map(({ column }) => status.signals.find((signal) => signal.name === column)?.value ?? null);
  const of = { cz: axis.cz_um, raw: axis.raw_um, error: axis.truth?.error_um, left: axis.truth?.left_um };
  return lines.map(({ what }) => of[what] ?? null);
}

const showPresent = () => charts.forEach((chart) => chart.live(view.to === null ? present(chart.group) : null));

export function showPast(now) {
  status = now;
  view.at = new Date(now.now).getTime() / 1000;
  if (charts !== null) showPresent();
  if (charts === null) {
    make();
    load();
  } else if (view.to === null && !document.hidden && Date.now() - refreshed > Math.max(REFRESH_MS, view.span)) {
    load();
  }
}

async function load() {
  refreshed = Date.now();
  if (charts.length === 0) return;
  const mine = (asked += 1);
  const stillNeeded = () => mine === asked;
  by("past-charts").ariaBusy = "true";
  spans.forEach((button, span) => button.setAttribute("aria-pressed", view.to === null && span === view.span));
  const [from, to] = [end() - view.span, end()];
  const lines = charts.flatMap(({ group }) => group.lines);
  // Only a virtual machine knows the truth, and it has no rows beside those of the log.
  const logged = lines.filter(({ isTruth }) => !isTruth).map(({ column }) => column);
  by("past-download").href = `api/history.csv?${query(from, to, logged)}`;
  try {
    const points = Math.max(100, Math.min(1000, charts[0].size().width));
    const whole = await readValues(from, to, points, stillNeeded);
    if (whole === null) return;
    const { rows, note } = whole;
    // Logs that cover little of the span have few of its intervals. They are read again in intervals of their own time.
    const first = begin(whole.found);
    const isShort = Number.isFinite(first) && to - first > SHORTEST_S && to - first < (to - from) / 2;
    const closer = isShort ? await readValues(first - (to - from) / points, to, points, stillNeeded) : whole;
    if (closer === null) return;
    const found = closer.found.size ? closer.found : whole.found;
    by("past-note").lang = note ? "en" : document.documentElement.lang;
    say(by("past-note"), note || (rows ? "" : t("past_nothing")));
    if (found.size === 0) return;
    draw(found, from, to);
    await readEvents(from);
    if (stillNeeded()) draw(found, from, to);
  } catch {
    if (stillNeeded()) say(by("past-note"), t("no_connection"));
  } finally {
    if (stillNeeded()) by("past-charts").ariaBusy = "false";
  }
}

// Reads the values of every chart: `{ found, rows, note }`, with the course of each column. null if no one waits any more.
async function readValues(from, to, points, stillNeeded) {
  const found = new Map();
  let [rows, note] = [0, ""];
  for (const columns of packed(charts.map(({ group }) => group.lines.map(({ column }) => column)))) {
    const question = query(from, to, columns);
    question.set("points", points);
    const response = await inTurn(`api/history?${question}`, stillNeeded);
    if (response === null || !stillNeeded()) return null;
    if (!response.ok) {
      note = (await response.text()).trim();
      continue;
    }
    const course = await response.json();
    rows += course.rows;
    byColumn(course).forEach((values, name) => found.set(name, values));
  }
  return stillNeeded() ? { found, rows, note } : null;
}

// Reads the events of a longer span than was read before. The newer ones arrive with each status, and are read again only
// if more arrived meanwhile than a status has.
async function readEvents(from) {
  if (read.from <= from && isComplete(read.at)) return;
  const [begin, now] = [Math.min(from, read.from), view.at];
  const response = await inTurn(`api/events?since=${encodeURIComponent(new Date(begin * 1000).toISOString())}`);
  if (response?.ok) read = { from: begin, at: now, events: (await response.json()).events };
}

// The smallest and the largest value of an interval are drawn at the same time: a line through both loses no peak.
function data({ lines }, found) {
  const { time } = found.get(lines[0].column) ?? { time: [] };
  const empty = { min: time.map(() => null), max: time.map(() => null) };
  const drawn = ({ min, max }) => inOrder(min.map((low, place) => [low, max[place]])).flat();
  return [time.flatMap((at) => [at, at]), ...lines.map(({ column }) => drawn(found.get(column) ?? empty))];
}

// The time of the first value. A span that began before it is shown from there on.
function begin(found) {
  const firsts = [...found.values()].map(({ time, min }) => time[min.findIndex((value) => value !== null)]).filter((at) => at !== undefined);
  return Math.min(...firsts);
}

function draw(found, from, to) {
  showPresent();
  const first = begin(found);
  const isFitted = Number.isFinite(first) && view.moment === null && first - from > view.span / 50 && to - first > SHORTEST_S;
  const left = isFitted ? first : from;
  // Later events say in which state the axis was before them.
  const events = since(left, read.events);
  for (const chart of charts) {
    const axis = status.axes.find(({ name }) => name === chart.group.axis);
    chart.show(data(chart.group, found), {
      bands: axis ? bands(axis, events, left, to) : [],
      marks: marks(chart.group.axis, events, left, to),
      dots: (axis?.probe?.history ?? []).map(([at, um]) => [new Date(at).getTime() / 1000, um]),
      limit: axis?.limit_um ?? null,
      moment: view.moment,
    }, left, to);
  }
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  charts?.forEach((chart) => chart.destroy());
  if (charts) load();
});
