// Numbers and times as a person reads them; and small helpers for elements.

import { english, t } from "./words.js";

const MINUS = "\u2212";

export function fixed(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(digits);
  return (value < 0 && Number(text) !== 0 ? MINUS : "") + text.replace(".", t("decimal_mark"));
}

// A limit or level, with as many digits as the profile gives it, at most two.
export const level = (um) => fixed(um, [0, 1].find((digits) => Number.isInteger(Number((um * 10 ** digits).toFixed(6)))) ?? 2);

// With its sign always: an offset without one is half a figure.
export function signed(value, digits) {
  const text = fixed(value, digits);
  return value > 0 && /[1-9]/.test(text) ? "+" + text : text;
}

// Units as people write them, where that is not how programs do.
const UNITS = { degC: "°C", um: "µm", percent: "%", 1: "", count: "" };
const DIGITS = { degC: 2, K: 2, mm: 4, um: 1, rpm: 0, count: 0 };

// A value with its unit; what is only true or false is on or off.
export function quantity(value, unit) {
  if (value === null) return "–";
  if (unit === "bool") return t(value ? "on" : "off");
  const digits = DIGITS[unit] ?? (Math.abs(value) >= 100 ? 0 : 2);
  return `${fixed(value, digits)} ${UNITS[unit] ?? unit}`.trim();
}

export function span(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "–";
  const s = Math.floor(Math.max(0, seconds));
  if (s < 60) return t("span_s", { s });
  if (s < 3600) return t("span_min", { min: Math.floor(s / 60), s: s % 60 });
  if (s < 48 * 3600) return t("span_h", { h: Math.floor(s / 3600), min: Math.floor((s % 3600) / 60) });
  return t("span_d", { d: Math.floor(s / 86400), h: Math.floor((s % 86400) / 3600) });
}

// Times are those of the machine's zone, wherever the page is looked at.
let zone = "UTC";

export function showIn(name) {
  if (name === zone) return;
  try {
    new Intl.DateTimeFormat("en", { timeZone: name });
    zone = name;
  } catch {
    zone = "UTC";
  }
}

export const zoneName = () => zone;

const formats = new Map();

function parts(date, timeZone, extra = {}) {
  const key = timeZone + Object.keys(extra);
  if (!formats.has(key)) {
    const fields = { year: "numeric", month: "2-digit", day: "2-digit", hour: "2-digit", minute: "2-digit", second: "2-digit" };
    formats.set(key, new Intl.DateTimeFormat("en", { ...fields, ...extra, timeZone, hourCycle: "h23" }));
  }
  return Object.fromEntries(formats.get(key).formatToParts(date).map(({ type, value }) => [type, value]));
}

export function clock(date, seconds = true, timeZone = zone) {
  const { hour, minute, second } = parts(date, timeZone);
  return seconds ? `${hour}:${minute}:${second}` : `${hour}:${minute}`;
}

export function day(date, timeZone = zone) {
  const { year, month, day } = parts(date, timeZone);
  return `${year}-${month}-${day}`;
}

// UTC+2
export const offset = (date) => parts(date, zone, { timeZoneName: "shortOffset" }).timeZoneName.replace("GMT", "UTC").replace(/[+-]0$/, "");

// The machine's time with its zone, and the same in UTC; the second is empty where both are one.
export function bothTimes(date) {
  const of = (timeZone) => `${day(date, timeZone)} ${clock(date, true, timeZone)}`;
  const here = offset(date);
  return [`${of(zone)} ${here}`, here === "UTC" ? "" : `${of("UTC")} UTC`];
}

const SVG = "http://www.w3.org/2000/svg";

export function svg(name, attributes = {}, text = "") {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

export function element(name, properties = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key in made) made[key] = value;
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

// A name with what people call it.
export const labelled = ({ name, label }) => (label ? `${label} (${name})` : name);
export const titled = (title, { label }) => (label ? `${title} · ${label}` : title);

// A machine with pages of devices sends some of its axes with each page. Fewer of them are named, so that it is seen
// where there are more.
const MOST_NAMES = 4;

// The texts of some axes. `whole` has the facts about all pages, if there is more than one.
export function listed(axes, whole, text = labelled) {
  const texts = axes.map(text);
  return whole && texts.length > MOST_NAMES ? [...texts.slice(0, MOST_NAMES), "…"].join(", ") : texts.join(", ");
}

// What to do about a fault, on a line of its own.
export class Hint {
  constructor() {
    this.text = english(element("span"));
    this.root = element("small", { className: "hint" }, element("b", {}, t("to_do")), " ", this.text);
  }

  show(hint) {
    this.root.hidden = !hint;
    say(this.text, hint ?? "");
  }

  // Shows the hint unless it is already on the screen: `shown` has the hints above, and gets this one.
  showOnce(hint, shown) {
    this.show(shown.has(hint) ? null : hint);
    if (hint) shown.add(hint);
  }
}

// The first clause of a sentence, cut after five words: enough to know what it is about.
const WORDS = 5;

export function brief(text) {
  const [clause] = text.split(/; |, | \(|[。，；]/);
  const words = clause.trim().split(/\s+/);
  if (words.length <= WORDS) return words.join(" ");
  const first = words.slice(0, WORDS);
  // One word after a colon says nothing: what is before it is enough.
  if (first.at(-2).endsWith(":")) return first.slice(0, -1).join(" ").slice(0, -1);
  return `${first.join(" ")} …`;
}

// A sentence without the hint at its end.
export function withoutHint(text, hint) {
  return hint && text.endsWith(hint) ? text.slice(0, -hint.length).replace(/[:;] $/, "") : text;
}

// Writes only what changed, so that a screen reader or a selection is not disturbed every second.
export function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
