// What was measured of an axis: its residual error, and how much of today it was in its limits.

import { clock, day, fixed, signed } from "./text.js";
import { t } from "./words.js";

// The residual error, in µm, with where it comes from. null if nobody measures it.
export function residual({ truth, probe }) {
  if (truth) return { um: truth.left_um, at: null };
  const last = probe?.last;
  return last && last.residual_um !== null && last.residual_um !== undefined ? { um: last.residual_um, at: last.at } : null;
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
  if (found === null || found.um === null) return t("not_measured");
  if (found.at === null) return `${signed(found.um, 1)} µm`;
  const at = new Date(found.at);
  const time = day(at) === day(now) ? clock(at, false) : `${day(at).slice(5)} ${clock(at, false)}`;
  return t("residual_at", { um: signed(found.um, 1), time });
}

export function withinText(axis, now) {
  const found = withinToday(axis, now);
  return found === null ? "" : t("within_today", { percent: found.percent, count: found.count, um: fixed(found.um, 1) });
}
