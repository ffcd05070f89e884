// Reads values from the gateway's logs, one request at a time: the gateway reads its logs for few clients at once.

const AGAIN_MS = [1000, 2000, 4000, 8000];
// The gateway reads for one minute at most. A path that is dead must not keep the next request waiting for ever.
const PATIENCE_MS = 75000;
// Largest number of columns that one request may name.
export const MOST_COLUMNS = 64;

let turn = Promise.resolve();

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

// A gateway that reads for others already answers 503, and has time again in a moment.
async function request(path) {
  for (const wait of [...AGAIN_MS, 0]) {
    const response = await fetch(path, { signal: AbortSignal.timeout(PATIENCE_MS) });
    if (response.status !== 503 || wait === 0) return response;
    await pause(wait);
  }
}

// Calls `request` after those before it, and returns its response. `stillNeeded` returns false if no one waits any more.
export function inTurn(path, stillNeeded = () => true) {
  const mine = turn.then(() => (stillNeeded() ? request(path) : null));
  turn = mine.catch(() => null);
  return mine;
}

const moment = (seconds) => new Date(seconds * 1000).toISOString();

// The query of a span, which ends at `to`; both in seconds since 1970.
export function query(from, to, columns) {
  return new URLSearchParams({ from: moment(from), to: moment(to), columns: columns.slice(0, MOST_COLUMNS).join(",") });
}

// Divides groups of columns over as few requests as possible. The columns of one group stay together.
export function packed(groups) {
  const requests = [];
  for (const group of groups.map((columns) => columns.slice(0, MOST_COLUMNS))) {
    const last = requests.at(-1);
    if (last && last.length + group.length <= MOST_COLUMNS) last.push(...group);
    else requests.push([...group]);
  }
  return requests;
}

// A course from the gateway as one list of points for each column: `{ time, min, max }`, all of the same length.
export function byColumn({ time, columns }) {
  return new Map(columns.map(({ name, min, max }) => [name, { time, min, max }]));
}

// Puts the smallest and the largest value of each interval, `[low, high]`, into the order in which they are drawn: the one that
// is nearer to the value before comes first. A falling line then has no steps, and ends at its last value.
export function inOrder(pairs) {
  let before = null;
  return pairs.map(([low, high]) => {
    const falls = before !== null && low !== null && Math.abs(high - before) < Math.abs(low - before);
    const pair = falls ? [high, low] : [low, high];
    before = pair[1];
    return pair;
  });
}
