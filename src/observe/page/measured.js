// What was measured of an axis: its residual error, and how much of today it was in its limits.

import { clock, day, fixed, signed } from "./text.js";
import { t } from "./words.js";

// The residual error, in µm, and when it was measured; a virtual machine knows it at any time. null if nobody measures it.
// A refused probing counts for nothing. The last accepted one says what was measured with the Cz that acted; the history of
// earlier ones, what the model would have left.
export function residual({ truth, probe }) {
  if (truth) return { um: truth.left_um, at: null };
  if (probe?.last && !probe.last.refused) return { um: probe.last.error_um, at: probe.last.at };
  const last = probe?.history.at(-1);
  return last ? { um: last[1], at: last[0] } : null;
}

// The share of today's probings whose residual was within the level that warns. null without a level, or without a probing today.
export function withinToday({ probe }, now) {
  if (!probe || probe.warn_um === null) return null;
  const today = day(now);
  const found = probe.history.filter(([at]) => day(new Date(at)) === today);
  if (found.length === 0) return null;
  const within = found.filter(([, um]) => Math.abs(um) <= probe.warn_um).length;
  return { percent: Math.floor((100 * within) / found.length), count: found.length, um: probe.warn_um };
}

export function residualText(axis, now) {
  const found = residual(axis);
  if (found === null) return t("not_measured");
  if (found.at === null) return `${signed(found.um, 1)} µm`;
  const at = new Date(found.at);
  const time = day(at) === day(now) ? clock(at, false) : `${day(at).slice(5)} ${clock(at, false)}`;
  return t("residual_at", { um: signed(found.um, 1), time });
}

export function withinText(axis, now) {
  const found = withinToday(axis, now);
  return found === null ? "" : t("within_today", { percent: found.percent, count: found.count, um: fixed(found.um, 1) });
}

// That probings show the model to be worse than no compensation.
export const worse = ({ touches, with_um: left, without_um: without }) =>
  touches === 0 ? t("worse_before") : t("worse", { touches, left: fixed(left, 1), without: fixed(without, 1) });
