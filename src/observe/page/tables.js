// The lists: signals, outputs, devices, buses. A row is made once and then only its text changes.

import { lastHour, spanOf } from "./recent.js";
import { badge, outputTone } from "./states.js";
import { element, quantity, say, signed, span, withoutHint } from "./text.js";
import { Trend } from "./trend.js";
import { known, t } from "./words.js";

// The lines of the signals are drawn again after this time: many lines every second cost a slow computer too much.
const DRAW_MS = 5000;
// A course of less than this looks flat, by unit; of other units, any change is drawn.
const LEAST = { degC: 1, K: 1, um: 2, bool: 1 };

const count = (number) => number.toLocaleString("en").replaceAll(",", "\u202f");

class Table {
  constructor(id) {
    this.body = document.querySelector(`#${id} tbody`);
    this.labels = [...document.querySelectorAll(`#${id} th`)].map((head) => head.textContent);
    this.rows = new Map();
  }

  // Each cell: { text, small, tone, drawing }. A tone makes the text a badge, small stands below it.
  row(name, cells) {
    if (!this.rows.has(name)) {
      const made = cells.map((_, index) => {
        const main = element("span");
        const small = element("small");
        const cell = element(index ? "td" : "th", index ? { role: "cell" } : { scope: "row", role: "rowheader" }, main, small);
        if (cells[index].drawing) cell.replaceChildren(cells[index].drawing);
        return { cell, main, small };
      });
      this.rows.set(name, made);
      this.body.append(element("tr", { role: "row" }, ...made.map(({ cell }) => cell)));
    }
    this.rows.get(name).forEach(({ cell, main, small }, index) => {
      const { text, tone, small: below = "", figure = false, drawing } = cells[index];
      cell.classList.toggle("drawing", drawing !== undefined);
      if (drawing) return;
      cell.classList.toggle("number", figure);
      if (figure) cell.dataset.label = this.labels[index];
      main.classList.toggle("badge", tone !== undefined);
      if (tone) badge(main, tone, text);
      else say(main, text);
      say(small, below);
    });
  }
}

// What people call it stands first, its name below.
const title = ({ name, label }, small) => ({ text: label || name, small: label ? `${name} · ${small}` : small });

// The unit of what an output writes, where that is not µm.
const OUTPUTS = { corrected: "mm", slope: "µm/mm", reference: "mm" };

const signals = new Table("signals");
// The two parts of a register that an operator writes to as well: operator offset and gateway share.
function shares({ shares }) {
  return shares ? t("shares", { base: signed(shares.base, 1), share: signed(shares.share, 1) }) : null;
}

const outputs = new Table("outputs");
const devices = new Table("devices");
const buses = new Table("buses");
const overridden = new Table("overridden");

// The cause alone: the hint stands at its alarm.
const cause = (text, { alarms }) => alarms.reduce((said, { hint }) => withoutHint(said, hint), text);

// In English as the gateway says it; elsewhere its word, with the raw value that the device sent. The sentence stands at the
// device then.
const raw = (reason) => reason.match(/\(raw [^)]+\)/)?.[0] ?? "";
const reason = ({ quality, reason }, status) =>
  document.documentElement.lang === "en" ? cause(reason, status) || quality : `${known("reason", quality)} ${raw(reason)}`.trim();

// A signal that reads well may be one that no axis believes: the others say what it would read.
function believed({ name, quality }, { axes }) {
  if (quality !== "good") return ["bad", t("not_usable")];
  const found = axes.find((axis) => axis.stood_in?.signal === name)?.stood_in;
  if (!found) return ["good", t("good")];
  return ["warn", t(found.frozen ? "frozen" : "not_believed")];
}

const trends = new Map();
let drawn = 0;

// Draws the last hour of every signal.
export function drawSignals(status) {
  if (Date.now() - drawn < DRAW_MS || document.hidden) return;
  drawn = Date.now();
  const span = spanOf(status);
  for (const { name, unit } of status.signals) {
    const points = lastHour(name);
    const values = points.flatMap(([at, low, high]) => (low === null || at < span.from ? [] : [low, high]));
    const [low, high] = [Math.min(...values), Math.max(...values)].map((value) => quantity(value, unit));
    const label = values.length ? t("trend_from_to", { low, high }) : t("past_nothing");
    trends.get(name)?.show({ points, ...span, least: LEAST[unit] ?? 0, label });
  }
}

// Draws again at once, because more of the past has arrived.
export function drawAgain() {
  drawn = 0;
}

function trendOf(name) {
  if (!trends.has(name)) trends.set(name, new Trend(t("trend")));
  return trends.get(name).root;
}

export function showTables(status) {
  for (const signal of status.signals) {
    const good = signal.quality === "good";
    const [tone, word] = believed(signal, status);
    signals.row(signal.name, [
      title(signal, signal.device),
      { text: quantity(signal.value, signal.unit), figure: true },
      { drawing: trendOf(signal.name) },
      { text: word, tone, small: good ? "" : reason(signal, status) },
      { text: signal.age_s === null ? t("never") : span(signal.age_s), figure: true },
    ]);
  }
  for (const output of status.outputs) {
    const unit = OUTPUTS[output.writes] ?? "µm";
    const value = `${signed(output.value, unit === "µm" ? 1 : 4)} ${unit}`;
    outputs.row(output.name, [
      { text: output.name, small: `${t("axis", { names: output.axis })} → ${output.device}, ${output.register}` },
      { text: output.value === null ? "–" : value, small: shares(output) ?? known("writes", output.writes), figure: true },
      {
        text: known("output", output.state),
        tone: outputTone(output.state),
        small: output.handshake || output.note || t("writes_done", { count: count(output.writes_done) }),
      },
      { text: output.age_s === null ? t("never") : span(output.age_s), figure: true },
    ]);
  }
  for (const device of status.devices) {
    const failures = Object.entries(device.failures).filter(([, times]) => times > 0);
    const tone = device.state === "ok" ? "good" : "bad";
    devices.row(device.name, [
      title(device, t("unit_on_bus", { unit: device.unit, bus: device.bus })),
      { text: known("device", device.state), tone, small: cause(device.fault, status) },
      { text: count(device.requests), figure: true },
      {
        text: count(failures.reduce((sum, [, times]) => sum + times, 0)),
        small: failures.map(([blame, times]) => `${known("blame", blame)}\u00a0${count(times)}`).join(", "),
        figure: true,
      },
    ]);
  }
  for (const bus of status.buses) {
    buses.row(bus.name, [
      { text: bus.name, small: bus.address },
      { text: t(bus.connected ? "connected" : "no_connection"), tone: bus.connected ? "good" : "bad" },
      { text: count(bus.cycles), figure: true },
      { text: count(bus.overruns), figure: true },
    ]);
  }
}

// What was set above the profile stays as long as the gateway runs.
export function showOverridden(status) {
  document.getElementById("set-above").hidden = status.overridden.length === 0;
  for (const { key, profile, now, from } of status.overridden) {
    overridden.row(key, [{ text: key }, { text: profile ?? "–" }, { text: now }, { text: from }]);
  }
}
