// The faults that have not ended, and whether a person has seen them.

import { TONES } from "./events.js";
import { alarmCount, badge, byUrgency } from "./states.js";
import { Hint, clock, day, element, say, withoutHint } from "./text.js";
import { english, known, t } from "./words.js";

// The charts of this page.
const HERE = "#past";

const rows = new Map();

class Row {
  constructor(alarm, acts) {
    this.level = element("span", { className: "badge" });
    this.since = element("time", { dateTime: alarm.since, title: alarm.since });
    this.text = english(element("span", { className: "text" }));
    this.hint = new Hint();
    this.seen = element("small");
    this.link = element("a", { href: HERE, className: "moment" }, t("in_chart"));
    this.link.addEventListener("click", (event) => {
      // The chart is on another page. (`search` would be that of this page for a link within it.)
      if (this.link.getAttribute("href") !== HERE) return;
      event.preventDefault();
      acts.lookAt(alarm);
    });
    this.button = element("button", { type: "button", className: "small" }, t("acknowledge"));
    this.button.addEventListener("click", () => acts.acknowledge(alarm.id));
    this.root = element("li", {}, this.level, this.since, this.link,
      element("span", { className: "what" }, this.text, this.hint.root, this.seen), this.button);
  }

  show({ id, level, since, text, hint, acknowledged }, { now, whole }, may, hints) {
    const [at, today] = [new Date(since), day(new Date(now))];
    const tone = TONES[level] ?? "off";
    if (this.root.dataset.level !== tone) this.root.dataset.level = tone;
    badge(this.level, tone, known("level", level));
    say(this.since, day(at) === today ? clock(at) : `${day(at).slice(5)} ${clock(at)}`);
    say(this.text, withoutHint(text, hint));
    const elsewhere = whole?.alarm_pages[id];
    this.link.setAttribute("href", elsewhere ? `?${new URLSearchParams({ page: elsewhere, alarm: id })}` : HERE);
    this.link.ariaLabel = `${t("in_chart")}: ${this.text.textContent}`;
    this.hint.showOnce(hint, hints);
    say(this.seen, acknowledged ? t("acknowledged", { by: acknowledged.by, time: clock(new Date(acknowledged.at)) }) : "");
    this.root.classList.toggle("seen", acknowledged !== null);
    this.button.hidden = acknowledged !== null;
    this.button.disabled = !may;
  }
}

// `acts` has `acknowledge(id)` and `lookAt(alarm)`; `hints` gets the hints that are shown.
export function showAlarms(section, status, acts, may, hints) {
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
  byUrgency(alarms).forEach((alarm, place) => {
    if (!rows.has(key(alarm))) rows.set(key(alarm), new Row(alarm, acts));
    const row = rows.get(key(alarm));
    // A row in its place is not moved: that would take the focus from its button.
    if (list.children[place] !== row.root) list.insertBefore(row.root, list.children[place] ?? null);
    row.show(alarm, status, may, hints);
  });
  const left = alarmCount(status) - alarms.length;
  const more = section.querySelector("#alarms-more");
  more.hidden = left === 0;
  say(more, t("alarms_more", { count: left }));
}

export function enableAlarms(may) {
  rows.forEach((row) => (row.button.disabled = !may));
}
