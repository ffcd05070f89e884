// The last hour of every axis and signal: from the logs, and continued with the live values in between.

import { byColumn, inTurn, packed, query } from "./history.js";

export const HOUR_S = 3600;
const POINTS = 120;
// The logs are read again after this time of the gateway, but never more often than a browser's clock allows.
const AGAIN_S = 120;
const AGAIN_MS = 10000;
// Live values between two readings of the logs are at least this far apart.
const STEP_S = 10;

const courses = new Map();
let loadedAt = null;
let loadedMs = 0;
let isLoading = false;

const seconds = (status) => new Date(status.now).getTime() / 1000;

function columnsOf(status) {
  const axes = status.axes.filter(({ release }) => !release);
  return [
    ...axes.map(({ name, truth }) => ["cz", "raw", ...truth ? ["left"] : []].map((what) => `${name}_${what}_um`)),
    ...status.signals.map(({ name }) => [name]),
  ];
}

async function load(status, now, changed) {
  isLoading = true;
  [loadedAt, loadedMs] = [now, Date.now()];
  try {
    for (const columns of packed(columnsOf(status))) {
      const question = query(now - HOUR_S, now, columns);
      question.set("points", POINTS);
      const response = await inTurn(`api/history?${question}`);
      if (!response?.ok) continue;
      const course = await response.json();
      // The clock was set back meanwhile.
      if (loadedAt !== now) return;
      for (const [name, { time, min, max }] of byColumn(course)) {
        const later = (courses.get(name) ?? []).filter(([at]) => at > now);
        courses.set(name, [...time.map((at, place) => [at, min[place], max[place]]), ...later]);
      }
    }
    changed();
  } catch {
    // The page says itself that there is no connection.
  } finally {
    isLoading = false;
  }
}

function add(name, at, value) {
  if (!courses.has(name)) courses.set(name, []);
  const points = courses.get(name);
  const last = points.at(-1);
  if (last && last[0] >= at) return;
  const before = points.at(-2);
  if (before && at - before[0] < STEP_S) points.pop();
  points.push([at, value ?? null, value ?? null]);
  const begin = points.findIndex(([time]) => time >= at - HOUR_S);
  if (begin > 0) points.splice(0, begin);
}

// Takes the values of a status. `changed()` is called when more of the past has arrived.
export function keep(status, changed = () => {}) {
  const now = seconds(status);
  // The clock was set back, or another demo runs at this address: what was read lies in the future.
  if (loadedAt !== null && now < loadedAt) {
    courses.clear();
    [loadedAt, loadedMs] = [null, 0];
  }
  for (const axis of status.axes) {
    add(`${axis.name}_cz_um`, now, axis.cz_um);
    add(`${axis.name}_raw_um`, now, axis.raw_um);
    if (axis.truth) add(`${axis.name}_left_um`, now, axis.truth.left_um);
  }
  for (const { name, value } of status.signals) add(name, now, value);
  const isDue = loadedAt === null || now - loadedAt > AGAIN_S;
  if (isDue && !isLoading && !document.hidden && Date.now() - loadedMs > AGAIN_MS) load(status, now, changed);
}

export const lastHour = (column) => courses.get(column) ?? [];
export const spanOf = (status) => ({ from: seconds(status) - HOUR_S, to: seconds(status) });
