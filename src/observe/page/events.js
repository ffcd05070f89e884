// The events that the page knows: the last ones of the gateway, older ones on request, and the list of them by level.

import { badge } from "./states.js";
import { Hint, clock, day, element, withoutHint } from "./text.js";
import { english, known, t } from "./words.js";

export const TONES = { info: "off", warning: "warn", error: "bad" };
// The levels that the list shows, by button.
const FILTERS = [
  ["events_all", ["info", "warning", "error"]],
  ["events_warnings", ["warning", "error"]],
  ["events_errors", ["error"]],
];

let shown = "";
// null until they are requested.
let older = null;
let newest = [];
let [[, levels]] = FILTERS;
let hintsAbove = new Set();
let at = new Date();
// Older events stay in the list for as long as its button says.
const OLDER_MS = 24 * 3600 * 1000;

const same = (one, other) => one.at === other.at && one.text === other.text;

function item(event, now, hints) {
  const time = new Date(event.at);
  const when = day(time) === day(now) ? clock(time) : `${day(time).slice(5)} ${clock(time)}`;
  const level = element("span", { className: "badge" });
  badge(level, TONES[event.level] ?? "off", known("level", event.level));
  const hint = new Hint();
  hint.showOnce(event.data?.hint, hints);
  return element("li", {}, element("time", { dateTime: event.at, title: event.at }, when), level,
    element("span", { className: "text" }, english(element("span", {}, withoutHint(event.text, event.data?.hint))), hint.root));
}

function draw(list) {
  const all = [...older ?? [], ...newest].filter(({ level }) => levels.includes(level));
  const last = all.at(-1);
  const mark = [all.length, last?.at, last?.text, levels.length, ...hintsAbove].join("\n");
  if (mark === shown) return;
  shown = mark;
  // A hint is shown once, at the newest event that has it.
  const hints = new Set(hintsAbove);
  const rows = all.reverse().map((event) => item(event, at, hints));
  list.replaceChildren(...rows.length ? rows : [element("li", { className: "none" }, t("events_none"))]);
}

// `hints` has the hints that are on the screen already.
export function showEvents(list, events, now, hints) {
  if (older) {
    older.push(...newest.filter((event) => !events.some((other) => same(event, other))));
    older = older.filter((event) => now - new Date(event.at) < OLDER_MS);
  }
  [newest, at, hintsAbove] = [events, now, hints];
  draw(list);
}

// Those before the first that the gateway shows by itself.
export function showOlder(list, events) {
  const first = newest.length ? events.findIndex((event) => same(event, newest[0])) : -1;
  older = first < 0 ? events.filter((event) => !newest.some((other) => same(event, other))) : events.slice(0, first);
  draw(list);
}

export function addFilters(group, list) {
  const buttons = FILTERS.map(([key, some]) => {
    const button = element("button", { type: "button", className: "small" }, t(key));
    button.setAttribute("aria-pressed", levels === some);
    button.addEventListener("click", () => {
      levels = some;
      buttons.forEach((one) => one.setAttribute("aria-pressed", one === button));
      draw(list);
    });
    return button;
  });
  group.append(...buttons);
}

// Whether no event is missing between those that were read at a moment and the last ones of the gateway.
export const isComplete = (seconds) => newest.length === 0 || new Date(newest[0].at).getTime() / 1000 <= seconds;

// The known events since a moment, with those that arrived after `earlier` was read.
export function since(seconds, earlier) {
  const isNew = (event) => !earlier.some((other) => same(event, other));
  return [...earlier, ...newest.filter(isNew)].filter((event) => new Date(event.at).getTime() / 1000 >= seconds);
}
