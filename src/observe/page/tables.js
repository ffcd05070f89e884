// The lists: signals, outputs, devices, buses, events. A row is made once and then only its text changes.

import { badge, clock, day, element, outputTone, quantity, say, signed, span } from "./text.js";

const count = (number) => number.toLocaleString("en").replaceAll(",", "\u202f");

class Table {
  constructor(id) {
    this.body = document.querySelector(`#${id} tbody`);
    this.labels = [...document.querySelectorAll(`#${id} th`)].map((head) => head.textContent.toLowerCase());
    this.rows = new Map();
  }

  // Each cell: { text, small, tone }. A tone makes the text a badge, small stands below it.
  row(name, cells) {
    if (!this.rows.has(name)) {
      const made = cells.map((_, index) => {
        const main = element("span");
        const small = element("small");
        const cell = element(index ? "td" : "th", index ? { role: "cell" } : { scope: "row", role: "rowheader" }, main, small);
        return { cell, main, small };
      });
      this.rows.set(name, made);
      this.body.append(element("tr", { role: "row" }, ...made.map(({ cell }) => cell)));
    }
    this.rows.get(name).forEach(({ cell, main, small }, index) => {
      const { text, tone, small: below = "", figure = false } = cells[index];
      cell.classList.toggle("number", figure);
      if (figure) cell.dataset.label = this.labels[index];
      main.classList.toggle("badge", tone !== undefined);
      if (tone) badge(main, tone, text);
      else say(main, text);
      say(small, below);
    });
  }
}

// What an output writes, and in which unit.
const OUTPUTS = {
  corrected: ["corrected position", "mm"], intercept: ["K0", "µm"], slope: ["tanβ", "µm/mm"], reference: ["P0", "mm"],
};

const signals = new Table("signals");
// Of a register that an operator writes to as well: his part and ours.
function shares({ shares }) {
  return shares ? `operator ${signed(shares.base, 1)}, ours ${signed(shares.share, 1)} µm` : null;
}

const outputs = new Table("outputs");
const devices = new Table("devices");
const buses = new Table("buses");

export function showTables(status) {
  for (const signal of status.signals) {
    const good = signal.quality === "good";
    signals.row(signal.name, [
      { text: signal.name, small: signal.device },
      { text: signal.value === null ? "–" : `${quantity(signal.value, signal.unit)} ${signal.unit}`, figure: true },
      { text: good ? "good" : "not usable", tone: good ? "good" : "bad", small: good ? "" : signal.reason || signal.quality },
      { text: signal.age_s === null ? "never" : span(signal.age_s), figure: true },
    ]);
  }
  for (const output of status.outputs) {
    const [kind, unit] = OUTPUTS[output.writes] ?? ["offset", "µm"];
    const value = `${signed(output.value, unit === "µm" ? 1 : 4)} ${unit}`;
    outputs.row(output.name, [
      { text: output.name, small: `axis ${output.axis} → ${output.device}, ${output.register}` },
      { text: output.value === null ? "–" : value, small: shares(output) ?? kind, figure: true },
      { text: output.state, tone: outputTone(output.state), small: output.handshake || output.note || `${count(output.writes_done)} writes` },
      { text: output.age_s === null ? "never" : span(output.age_s), figure: true },
    ]);
  }
  for (const device of status.devices) {
    const failures = Object.entries(device.failures).filter(([, times]) => times > 0);
    const tone = device.state === "ok" ? "good" : "bad";
    devices.row(device.name, [
      { text: device.name, small: `unit ${device.unit} on ${device.bus}` },
      { text: device.state.replace("-", " "), tone, small: device.fault },
      { text: count(device.requests), figure: true },
      {
        text: count(failures.reduce((sum, [, times]) => sum + times, 0)),
        small: failures.map(([blame, times]) => `${blame}\u00a0${count(times)}`).join(", "),
        figure: true,
      },
    ]);
  }
  for (const bus of status.buses) {
    buses.row(bus.name, [
      { text: bus.name, small: bus.address },
      { text: bus.connected ? "connected" : "no connection", tone: bus.connected ? "good" : "bad" },
      { text: count(bus.cycles), figure: true },
      { text: count(bus.overruns), figure: true },
    ]);
  }
}

const LEVELS = { info: "off", warning: "warn", error: "bad" };
let shown = "";
let older = [];
let newest = [];
const same = (one, other) => one.at === other.at && one.text === other.text;

export function showEvents(list, events, now) {
  if (older.length) older.push(...newest.filter((event) => !events.some((other) => same(event, other))));
  newest = events;
  const all = [...older, ...events];
  const last = all.at(-1);
  const mark = `${all.length} ${last?.at} ${last?.text}`;
  if (mark === shown) return;
  shown = mark;
  const rows = all.map((event) => {
    const at = new Date(event.at);
    const time = day(at) === day(now) ? clock(at) : `${day(at).slice(5)} ${clock(at)}`;
    const level = element("span", { className: "badge" });
    badge(level, LEVELS[event.level] ?? "off", event.level);
    return element("li", {}, element("time", { dateTime: event.at }, time), level, element("span", { className: "text" }, event.text));
  });
  list.replaceChildren(...rows.reverse());
}

// Those before the first that the gateway shows by itself.
export function showOlder(list, events) {
  const first = newest.length ? events.findIndex((event) => same(event, newest[0])) : -1;
  older = first < 0 ? events.filter((event) => !newest.some((other) => same(event, other))) : events.slice(0, first);
  showEvents(list, newest, new Date());
}
