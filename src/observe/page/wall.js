// What is read from three metres: one word for the machine, the alarms, and a figure for each axis with its limit and its last hour.

import { Bar } from "./bar.js";
import { Course } from "./course.js";
import { follow, page } from "./live.js";
import { residualText, withinToday } from "./measured.js";
import { keep } from "./recent.js";
import { SIGNS, alarmCount, axisState, byUrgency, cardTone, cause, expected, overall, target, verified } from "./states.js";
import { bothTimes, brief, element, say, signed, titled, withoutHint } from "./text.js";
import { english, t } from "./words.js";

const by = (id) => document.getElementById(id);
// More axes than this are rows of a table.
const MOST_PANELS = 4;
// A figure of more characters is set more closely.
const LONG = 5;
const axes = new Map();

// Nothing else stays in the address.
const address = page === 1 ? "?view=wall" : `?view=wall&page=${page}`;
if (location.search !== address) history.replaceState(null, "", address);

// The parts of an axis, which panel and row show in their own order.
function parts(axis) {
  return {
    name: titled(t("axis", { names: axis.name }), axis),
    figure: element("span", { className: "figure" }),
    target: element("span", { className: "target" }),
    verified: element("span", { className: "verified" }),
    expected: element("span", { className: "expected" }),
    state: element("span", { className: "state" }),
    why: english(element("span", { className: "why" })),
    residual: element("span", { className: "residual" }),
    bar: new Bar(),
    course: new Course(),
  };
}

const unit = () => element("span", { className: "unit" }, "µm");

function panel(it) {
  const root = element("section", { className: "panel" },
    element("h2", {}, it.name), element("p", { className: "says" }, it.state, " ", it.why),
    element("p", { className: "cz" }, it.figure, " ", unit()),
    element("p", { className: "second" }, it.target, " ", it.verified),
    it.bar.root, it.course.root,
    element("p", { className: "measured" }, it.residual, " ", it.expected));
  by("axes").append(root);
  return root;
}

// A phone shows the name of a column before its value.
const heads = () => [t("axis", { names: "" }).trim(), t("state"), "Cz, µm", t("target"), t("limit"), t("trend"), t("true_left")];

function row(it) {
  const cells = [[it.state, " ", it.why], [it.figure], [it.target, " ", it.verified], [it.bar.root], [it.course.root], [it.residual, " ", it.expected]];
  const root = element("tr", {}, element("th", { scope: "row" }, it.name),
    ...cells.map((children, place) => element("td", { "data-label": heads()[place + 1] }, ...children)));
  if (!by("axes").firstChild) by("axes").append(table());
  by("axes").querySelector("tbody").append(root);
  return root;
}

function table() {
  return element("table", {},
    element("thead", {}, element("tr", {}, ...heads().map((text) => element("th", { scope: "col" }, text)))),
    element("tbody"));
}

function show(axis, status, isRow) {
  if (!axes.has(axis.name)) {
    const it = parts(axis);
    axes.set(axis.name, { ...it, root: isRow ? row(it) : panel(it) });
  }
  const it = axes.get(axis.name);
  const [its, name] = axisState(axis, status);
  const tone = cardTone(axis, its);
  it.root.dataset.state = tone;
  say(it.state, `${SIGNS[tone]} ${name}`);
  const why = brief(cause(axis, status));
  say(it.why, why === name ? "" : why);
  say(it.figure, signed(axis.verified_um, 1));
  const { length } = it.figure.textContent;
  it.figure.classList.toggle("long", length > LONG);
  it.figure.style.setProperty("--characters", length);
  say(it.target, target(axis) ? `${isRow ? "" : `${t("target")} `}${target(axis)}` : "");
  say(it.verified, verified(axis));
  say(it.expected, expected(axis));
  const now = new Date(status.now);
  const within = withinToday(axis, now);
  const error = [residualText(axis, now), within === null ? "" : `${t("in_limits")}: ${within.percent} %`].filter(Boolean).join(" · ");
  say(it.residual, isRow ? error : `${t("true_left")}: ${error}`);
  it.bar.show(axis);
  it.course.show(axis, status);
}

// The most urgent alarm and the number of them: a wall has no room for all.
function alarms(status) {
  const count = alarmCount(status);
  by("alarms").hidden = count === 0;
  if (count === 0) return;
  say(by("alarm-count"), t("alarms_count", { count }));
  const [{ text, hint }] = byUrgency(status.alarms);
  say(by("alarm-text"), withoutHint(text, hint));
}

follow((status) => {
  const [tone, word, sentence] = overall(status);
  document.body.dataset.tone = tone;
  say(by("word"), `${SIGNS[tone]} ${word}`);
  say(by("sentence"), sentence);
  say(by("time"), bothTimes(new Date(status.now)).filter(Boolean).join(" · "));
  alarms(status);
  keep(status);
  const isRow = status.axes.length > MOST_PANELS;
  by("axes").dataset.count = status.axes.length;
  by("axes").classList.toggle("many", isRow);
  status.axes.forEach((axis) => show(axis, status, isRow));
}, (sentence, stopped) => {
  by("lost").hidden = sentence === null;
  if (sentence === null) return;
  say(by("lost"), sentence);
  document.body.dataset.tone = stopped ? "off" : "lost";
  if (!stopped) say(by("word"), t("no_connection"));
});
