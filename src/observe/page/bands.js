// What happened to an axis in a span: the states that it was in, and the events that are marked in its chart.

import { toneOf } from "./states.js";
import { withoutHint } from "./text.js";
import { known } from "./words.js";

// Events that explain a course although they are no trouble.
const MARKED = new Set(["armed", "disarmed", "zeroed", "started", "machine-started", "probed"]);
const MOST_MARKS = 200;

const seconds = (event) => new Date(event.at).getTime() / 1000;

// The states in which the axis did not simply follow its model: `{ from, to, tone, word }`, in the order of time.
export function bands({ name, state }, events, from, to) {
  const changes = events.filter(({ kind, data }) => kind === "axis-state" && data?.axis === name && data.from !== data.to);
  const found = [];
  let [begin, was, isWell] = [from, changes[0]?.data.from ?? state, false];
  const close = (end) => {
    const tone = toneOf(was);
    // A state that the operator asked for is no trouble: the event about it says so.
    if (tone !== "good" && end > begin) found.push({ from: begin, to: end, tone: isWell ? "off" : tone, word: known("state", was) });
  };
  for (const change of changes) {
    const at = Math.min(to, Math.max(from, seconds(change)));
    close(at);
    [begin, was, isWell] = [at, change.data.to, change.level === "info"];
  }
  close(to);
  return found;
}

// The newest marked events of an axis, or of no axis: `{ at, level, text }`.
export function marks(name, events, from, to) {
  const isMarked = ({ kind, level, data }) =>
    kind !== "axis-state" && (level !== "info" || MARKED.has(kind)) && (data?.axis === undefined || data.axis === name);
  return events.filter(isMarked)
    .map((event) => ({ at: seconds(event), level: event.level, text: withoutHint(event.text, event.data?.hint) }))
    .filter(({ at }) => at >= from && at <= to)
    .slice(-MOST_MARKS);
}
