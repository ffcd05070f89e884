// Shows what the gateway says, and gives it commands.

import { enableAlarms, showAlarms } from "./alarms.js";
import { enableAxes, showAxes } from "./axis.js";
import { enableCommands, listen, mayCommand, showCommands } from "./commands.js";
import { addFilters, showEvents, showOlder } from "./events.js";
import { follow, page } from "./live.js";
import { lookAt, showPast } from "./past.js";
import { keep } from "./recent.js";
import { SIGNS, alarmCount, overall } from "./states.js";
import { drawAgain, drawSignals, showOverridden, showTables } from "./tables.js";
import { bothTimes, clock, element, say, span } from "./text.js";
import { known, t } from "./words.js";

// What the gateway has not begun by then is never done: it sees that nobody waits any more.
const PATIENCE_MS = 5000;
// A new answer is in sight wherever its button is, and returns to the commands after this time.
const FRESH_MS = 15000;
let fresh = null;

const by = (id) => document.getElementById(id);

function show(status) {
  const [tone, word, sentence] = overall(status);
  by("overall").dataset.tone = tone;
  say(by("overall").querySelector(".sign"), SIGNS[tone]);
  say(by("word"), word);
  say(by("sentence"), sentence);
  const count = alarmCount(status);
  say(by("alarm-count"), count ? t("alarms_count", { count }) : t("alarms_none"));
  const now = new Date(status.now);
  const [here, utc] = bothTimes(now);
  say(by("machine-time"), here);
  say(by("utc"), utc);
  say(by("clock-word"), known("clock", status.clock));
  say(by("machine-on"), status.machine_on_s === null ? t("machine_not_on") : span(status.machine_on_s));
  say(by("uptime"), span(status.uptime_s));
  keep(status, drawAgain);
  // A hint is shown once on a screen: at its alarm, else at its axis, else at its newest event.
  const hints = new Set();
  showAlarms(by("alarms"), status, acts, mayCommand, hints);
  showAxes(by("axes"), status, send, hints);
  showPages(status);
  showCommands(status);
  showPast(status);
  lookAtSelected(status);
  showTables(status);
  drawSignals(status);
  showOverridden(status);
  showEvents(by("events"), status.events, now, hints);
  enable(mayCommand && !status.stopping);
}

// The links to the pages of a machine with many devices.
function showPages({ page: { number, of } }) {
  const pages = by("pages");
  pages.hidden = of === 1;
  if (pages.hidden || pages.querySelector("a")) return;
  for (let link = 1; link <= of; link += 1) {
    pages.append(" ", element("a", { href: `?page=${link}`, ariaCurrent: link === number ? "page" : null }, link));
  }
}

// The address names an alarm that was selected on another page. Its chart is shown once.
function lookAtSelected({ alarms }) {
  const selected = new URLSearchParams(location.search).get("alarm");
  if (selected === null) return;
  history.replaceState(null, "", `?page=${page}`);
  const alarm = alarms.find(({ id }) => id === selected);
  if (alarm) lookAt(alarm);
}

function enable(may) {
  enableCommands(may);
  enableAxes(may);
  enableAlarms(may);
}

function setLost(sentence, stopped) {
  by("lost").hidden = sentence === null;
  if (sentence === null) return;
  enable(false);
  by("lost").classList.toggle("stopped", stopped);
  say(by("lost"), sentence);
}

const acts = {
  acknowledge: (alarm) => send("acknowledge", null, alarm),
  lookAt,
};

async function send(command, axis, alarm) {
  const answer = by("answer");
  say(answer, "…");
  const only = axis ? `?axis=${encodeURIComponent(axis)}` : alarm ? `?alarm=${encodeURIComponent(alarm)}` : "";
  const said = (tone, sentence) => {
    answer.dataset.tone = tone;
    say(answer, `${clock(new Date())} ${t(command)}: ${sentence}`);
    answer.classList.add("fresh");
    clearTimeout(fresh);
    fresh = setTimeout(() => answer.classList.remove("fresh"), FRESH_MS);
  };
  try {
    const response = await fetch(`api/${command}${only}`, {
      method: "POST",
      headers: { "isotherm-way": "page" },
      signal: AbortSignal.timeout(PATIENCE_MS),
    });
    const text = await response.text();
    const json = response.headers.get("content-type")?.startsWith("application/json");
    const sentence = json ? JSON.parse(text).answer : text.trim();
    said(response.status === 202 ? "warn" : response.ok ? "good" : "bad", sentence);
  } catch {
    said("bad", t("no_answer", { s: PATIENCE_MS / 1000 }));
  }
}

async function older() {
  const button = by("older");
  button.disabled = true;
  try {
    const response = await fetch("api/events?since=24h");
    showOlder(by("events"), (await response.json()).events);
    button.hidden = true;
  } catch {
    button.disabled = false;
  }
}

by("older").addEventListener("click", older);
addFilters(by("event-filter"), by("events"));
listen(send);
follow(show, setLost);
