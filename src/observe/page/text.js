// Numbers, times and states as a person reads them; and small helpers for elements.

const MINUS = "\u2212";

export function fixed(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(digits);
  return (value < 0 && Number(text) !== 0 ? MINUS : "") + text;
}

// With its sign always: an offset without one is half a figure.
export function signed(value, digits) {
  const text = fixed(value, digits);
  return value > 0 && Number(text) !== 0 ? "+" + text : text;
}

const DIGITS = { "°C": 2, "K": 2, "mm": 4, "µm": 1, "rpm": 0 };

export function quantity(value, unit) {
  const digits = DIGITS[unit] ?? (Math.abs(value) >= 100 ? 0 : 2);
  return fixed(value, digits);
}

export function span(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "–";
  const whole = Math.floor(Math.max(0, seconds));
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  if (whole < 48 * 3600) return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
  return `${Math.floor(whole / 86400)} d ${Math.floor((whole % 86400) / 3600)} h`;
}

const two = (number) => String(number).padStart(2, "0");

export function clock(date, seconds = true) {
  const time = `${two(date.getHours())}:${two(date.getMinutes())}`;
  return seconds ? `${time}:${two(date.getSeconds())}` : time;
}

export function day(date) {
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
}

// A sign, a tone, a name and a sentence for every state. The sign and the text carry the meaning, the tone repeats it.
export const SIGNS = { good: "●", warn: "▲", bad: "■", off: "○" };

const AXIS = {
  active: ["good", "compensating", "follows its model"],
  degraded: ["warn", "fallback model", "follows a fallback model"],
  holding: ["warn", "frozen", "keeps its last value"],
  ramping: ["bad", "returning to zero", "goes to zero"],
  zeroed: ["bad", "at zero", "stays at zero until all is good again"],
  waiting: ["warn", "waiting to arm", "waiting to arm"],
  off: ["off", "off", "nothing is written"],
};

export const axisState = (axis) => AXIS[axis.state] ?? ["warn", axis.state, ""];

const OUTPUT = {
  verified: "good", unverified: "warn", unknown: "off", interlocked: "warn", foreign: "bad", off: "off",
};

export const outputTone = (state) => OUTPUT[state] ?? "warn";

// The one word for the machine, and the sentence below it.
export function overall(status) {
  const inState = (...states) => status.axes.filter((axis) => states.includes(axis.state));
  const names = (axes) => (axes.length === 1 ? "Axis " : "Axes ") + axes.map((axis) => axis.name).join(", ");
  const why = (axes) => {
    const [, name, sentence] = axisState(axes[0]);
    const reason = axes.map((axis) => axis.why).find((text) => text) ?? "";
    return `${names(axes)}: ${axes.length === 1 ? sentence : name}${reason ? ` (${reason})` : ""}.`;
  };
  const foreign = status.outputs.filter((output) => output.state === "foreign");
  const failed = inState("ramping", "zeroed");
  const holding = inState("holding");
  const degraded = inState("degraded");
  const waiting = inState("waiting");
  const off = inState("off");
  const problem = (() => {
    if (failed.length) return ["bad", "fault", why(failed)];
    if (foreign.length) return ["bad", "fault", `Somebody else writes to ${foreign[0].name}.`];
    if (holding.length) return ["warn", "frozen", why(holding)];
    if (degraded.length) return ["warn", "fallback model", why(degraded)];
    return null;
  })();
  if (status.dry_run) {
    return ["off", "dry run", "Computes and shows; writes nothing." + (problem ? ` ${problem[2]}` : "")];
  }
  if (problem) return problem;
  if (waiting.length) return ["warn", "waiting to arm", why(waiting)];
  if (off.length === status.axes.length) return ["off", "off", "Not armed: nothing is written."];
  const rest = off.length ? ` ${names(off)}: off.` : "";
  return ["good", "compensating", needs(status) + rest];
}

function needs(status) {
  const lost = status.devices.filter((device) => device.state !== "ok").length;
  const bad = status.signals.filter((signal) => signal.quality !== "good").length;
  const parts = [];
  if (lost) parts.push(lost === 1 ? "1 device does not answer" : `${lost} devices do not answer`);
  if (bad) parts.push(bad === 1 ? "1 signal is not usable" : `${bad} signals are not usable`);
  return parts.length ? `Every armed axis follows its model, but ${parts.join(" and ")}.`
    : "Every armed axis follows its model.";
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

// Writes only what changed, so that a screen reader or a selection is not disturbed every second.
export function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export function badge(node, tone, word) {
  if (node.dataset.tone !== tone) node.dataset.tone = tone;
  say(node, `${SIGNS[tone]} ${word}`);
}
