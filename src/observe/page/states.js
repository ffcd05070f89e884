// A sign, a tone, a word and a sentence for every state. The sign and the text carry the meaning, the tone repeats it.

import { worse } from "./measured.js";
import { clock, day, fixed, level, listed, say, signed, span } from "./text.js";
import { known, t } from "./words.js";

export const SIGNS = { good: "●", warn: "▲", bad: "■", off: "○" };

// The tone of a decision's state, for the past; the gateway names the tone of the present. Waiting is over by then.
const TONE_OF = { active: "good", degraded: "warn", holding: "warn", waiting: "off", ramping: "bad", zeroed: "bad", off: "off" };

export const toneOf = (state) => TONE_OF[state] ?? "off";

// What is shown follows from what is decided and what was verified; the gateway says which.
const stateOf = (axis) => axis.shown;

// The model requests more than the limit of the axis, so that Cz no longer follows it.
const isAtLimit = ({ shown, acted }) => (shown === "active" || shown === "degraded") && acted.includes("limit");

// What is done, in words; with the verified value where that is what matters.
function does(axis) {
  if (axis.shown === "active" && isAtLimit(axis)) return t("at_limit", { um: level(axis.limit_um) });
  if (axis.shown === "unreachable" && axis.verified_um !== null) {
    return t("last_verified", { um: signed(axis.verified_um, 1), span: span(axis.verified_age_s) });
  }
  if (axis.shown === "sign-check" && axis.sign) return t("on_purpose", { um: signed(axis.sign.by_um, 1) });
  return known("does", axis.shown);
}

// What an axis does because the gateway was asked to stop is no fault, unless its control cannot be asked.
// In a dry run nothing is written: no axis compensates.
export function axisState(axis, status) {
  if (status.dry_run && axis.shown === "active") {
    return ["off", t("dry_run"), isAtLimit(axis) ? does(axis) : t("would_follow")];
  }
  const tone = status.stopping && axis.shown !== "unreachable" ? "off" : axis.tone;
  return [tone, known("state", axis.shown), does(axis)];
}

// The age of the figure that was verified in the control.
export function verified(axis) {
  return axis.verified_um === null ? t("not_verified") : t("verified_ago", { span: span(axis.verified_age_s) });
}

// The target of an armed axis, which may never arrive. Empty for an axis that writes nothing.
export const target = (axis) => (axis.armed ? `${signed(axis.cz_um, 1)} µm` : "");

// The gateway's cause of an axis without a model.
const NO_MODEL = "no model yet";

// Why an axis does not simply follow its model; empty if it does.
export function cause(axis, status) {
  const warned = axis.warned ? t("warned", { um: level(axis.warn_um) }) : "";
  // The state says already that there is no model.
  const own = axis.shown === "unmodelled" && axis.cause === NO_MODEL ? "" : axis.cause;
  const reason = standsIn(axis, status) || own || axis.extrapolating?.text;
  const beyond = isAtLimit(axis) && axis.raw_um !== null ? t("model_requests", { um: signed(axis.raw_um, 1) }) : "";
  const poor = axis.probe?.worse ? worse(axis.probe.worse) : "";
  return [reason, beyond, warned, poor].filter(Boolean).join("; ");
}

// An axis that follows its model may still need a look.
export function cardTone(axis, tone) {
  return tone === "good" && (isAtLimit(axis) || axis.warned || axis.extrapolating || axis.probe?.worse) ? "warn" : tone;
}

// How wrong Cz is expected to be, where it is what the model asks for: not at its limit, and not on its way there.
const ELSEWHERE = ["limit", "step", "rate"];

export function expected(axis) {
  const follows = axis.shown === "active" || axis.shown === "degraded";
  if (!follows || axis.expected_um === null || ELSEWHERE.some((stage) => axis.acted.includes(stage))) return "";
  const um = fixed(axis.expected_um, 1);
  return axis.expected_touches ? t("expected_touches", { um, count: axis.expected_touches }) : t("expected", { um });
}

// Of which sensor the others say what it would read, and since when; empty where the axis waits for something else.
export function standsIn({ state, stood_in: found }, { now }) {
  if (state !== "degraded" || !found) return "";
  const at = new Date(found.since);
  const time = day(at) === day(new Date(now)) ? clock(at, false) : `${day(at)} ${clock(at, false)}`;
  const others = found.others === 1 ? t("one_other") : t("some_others", { count: found.others });
  return t(found.frozen ? "stood_in_frozen" : "stood_in_lost", { signal: found.signal, others, time });
}

const OUTPUT = {
  verified: "good", unverified: "warn", unknown: "off", interlocked: "warn", foreign: "bad", off: "off",
};

export const outputTone = (state) => OUTPUT[state] ?? "warn";

export function badge(node, tone, word) {
  if (node.dataset.tone !== tone) node.dataset.tone = tone;
  say(node, `${SIGNS[tone]} ${word}`);
}

// The number of all alarms. A machine with pages of devices sends only the most urgent ones.
export const alarmCount = ({ alarms, whole }) => whole?.alarm_count ?? alarms.length;

const URGENCY = ["error", "warning", "info"];

// Alarms with the most urgent ones first: errors, those that nobody has seen, then the newest.
export function byUrgency(alarms) {
  const rank = ({ level, acknowledged }) => URGENCY.indexOf(level) + (acknowledged ? 0.5 : 0);
  return [...alarms].sort((one, other) => rank(one) - rank(other) || (one.since < other.since ? 1 : -1));
}

// In which order an axis speaks for the machine.
const WORST = ["unreachable", "zeroed", "ramping", "holding", "sign-check", "degraded", "waiting"];

// The one word for the machine, and the sentence below it.
export function overall(page) {
  const status = { ...page, ...page.whole };
  const inState = (state) => status.axes.filter((axis) => stateOf(axis) === state);
  const names = (axes) => t(axes.length === 1 ? "axis" : "axes", { names: listed(axes, status.whole) });
  const worst = WORST.find((state) => inState(state).length);
  const [off, unmodelled] = [inState("off"), inState("unmodelled")];
  const why = (state) => {
    const reason = inState(state).map((axis) => standsIn(axis, status) || axis.cause).find((text) => text) ?? "";
    const sentence = inState(state).length === 1 ? does(inState(state)[0]) : known("does", state);
    return `${names(inState(state))}: ${sentence}${reason ? ` (${reason})` : ""}.`;
  };
  const foreign = status.outputs.find((output) => output.state === "foreign");
  if (status.stopping) return ["off", known("state", worst ?? "off"), t("stopping")];
  const problem = (() => {
    const others = foreign ? t("foreign", { output: foreign.name }) : "";
    if (foreign || inState(worst)[0]?.tone === "bad") {
      const word = worst && worst !== "waiting" ? known("state", worst) : t("foreign_word");
      return ["bad", word, [worst ? why(worst) : "", others].filter(Boolean).join(" ")];
    }
    return worst && worst !== "waiting" ? ["warn", known("state", worst), why(worst)] : null;
  })();
  if (status.dry_run) return ["off", t("dry_run"), `${t("dry_run_does")} ${problem ? problem[2] : ""}`.trim()];
  if (problem) return problem;
  if (worst) return ["warn", known("state", worst), why(worst)];
  if (off.length + unmodelled.length === status.axes.length) return ["off", known("state", "off"), t("not_armed_sentence")];
  const rest = [off, unmodelled].filter((axes) => axes.length)
    .map((axes) => ` ${names(axes)}: ${known("state", stateOf(axes[0]))}.`).join("");
  return [status.axes.some(isAtLimit) ? "warn" : "good", known("state", "active"), needs(status) + rest];
}

function needs(status) {
  const lost = status.lost ?? status.devices.filter((device) => device.state !== "ok").length;
  const bad = status.bad ?? status.signals.filter((signal) => signal.quality !== "good").length;
  const limited = status.axes.filter(isAtLimit);
  const lacks = [
    limited.length ? t("axes_at_limit", { names: listed(limited, status.whole) }) : "",
    lost ? t("lacks_devices", { count: lost }) : "",
    bad ? t("lacks_signals", { count: bad }) : "",
  ];
  const parts = lacks.filter(Boolean).join(t("and"));
  return parts ? t("follows_but", { parts }) : t("follows");
}
