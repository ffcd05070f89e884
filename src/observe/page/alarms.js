// What went wrong and has not come to its end; and that somebody has seen it.

import { badge } from "./states.js";
import { Hint, clock, day, element, say, withoutHint } from "./text.js";
import { english, known, t } from "./words.js";

const TONES = { info: "off", warning: "warn", error: "bad" };
const rows = new Map();

class Row {
  constructor(alarm, acknowledge) {
    this.level = element("span", { className: "badge" });
    this.since = element("time", { dateTime: alarm.since, title: alarm.since });
    this.text = english(element("span", { className: "text" }));
    this.hint = new Hint();
    this.seen = element("small");
    this.button = element("button", { type: "button", className: "small" }, t("acknowledge"));
    this.button.addEventListener("click", () => acknowledge(alarm.id));
    this.root = element("li", {}, this.since, this.level, element("span", {}, this.text, this.hint.root, this.seen), this.button);
  }

  show({ level, since, text, hint, acknowledged }, now, may) {
    const [at, today] = [new Date(since), day(now)];
    badge(this.level, TONES[level] ?? "off", known("level", level));
    say(this.since, day(at) === today ? clock(at) : `${day(at).slice(5)} ${clock(at)}`);
    say(this.text, withoutHint(text, hint));
    this.hint.show(hint);
    say(this.seen, acknowledged ? t("acknowledged", { by: acknowledged.by, time: clock(new Date(acknowledged.at)) }) : "");
    this.root.classList.toggle("seen", acknowledged !== null);
    this.button.hidden = acknowledged !== null;
    this.button.disabled = !may;
  }
}

export function showAlarms(section, status, acknowledge, may) {
  const { alarms } = status;
  section.hidden = alarms.length === 0;
  const list = section.querySelector("ol");
  const key = ({ id, since }) => `${since} ${id}`;
  const keys = new Set(alarms.map(key));
  for (const [known, row] of rows) {
    if (keys.has(known)) continue;
    row.root.remove();
    rows.delete(known);
  }
  for (const alarm of alarms) {
    if (!rows.has(key(alarm))) {
      rows.set(key(alarm), new Row(alarm, acknowledge));
      list.prepend(rows.get(key(alarm)).root);
    }
    rows.get(key(alarm)).show(alarm, new Date(status.now), may);
  }
}

export function enableAlarms(may) {
  rows.forEach((row) => (row.button.disabled = !may));
}
