// Follows the gateway's live stream, shows what it says, and says when it no longer does.

import { enableAxes, showAxes } from "./axis.js";
import { showEvents, showOlder, showTables } from "./tables.js";
import { SIGNS, clock, day, overall, say, span } from "./text.js";

const SILENT_AFTER_MS = 3500;
const RETRY_MS = 2000;
// An attempt on a dead path may hang for minutes; another one may find a way that has come back.
const GIVE_UP_MS = 10000;
// What the gateway has not begun by then is never done: it sees that nobody waits any more.
const PATIENCE_MS = 5000;
const LOST_TITLE = "no connection · ";

const by = (id) => document.getElementById(id);
const buttons = [...document.querySelectorAll(".buttons button")];
const mayCommand = document.querySelector(".buttons").dataset.may === "true";
const title = document.title;
const opened = new Date();

let stream = null;
let tried = 0;
let lastHeard = null;
let lost = false;

// The token has become a cookie; it need not stay in the address bar and the history.
if (location.search) history.replaceState(null, "", location.pathname);

function show(status) {
  const [tone, word, sentence] = overall(status);
  by("overall").dataset.tone = tone;
  say(by("overall").querySelector(".sign"), SIGNS[tone]);
  say(by("word"), word);
  say(by("sentence"), sentence);
  const now = new Date(status.now);
  say(by("machine-time"), `${day(now)} ${clock(now)}`);
  say(by("clock-word"), status.clock);
  say(by("machine-on"), status.machine_on_s === null ? "not on" : span(status.machine_on_s));
  say(by("uptime"), span(status.uptime_s));
  showAxes(by("axes"), status, send);
  showTables(status);
  showEvents(by("events"), status.events, now);
}

function heard(event) {
  const status = JSON.parse(event.data);
  lastHeard = new Date();
  if (lost) setLost(false);
  show(status);
  enable(mayCommand);
}

function enable(may) {
  buttons.forEach((button) => (button.disabled = !may));
  enableAxes(may);
}

function setLost(now) {
  lost = now;
  document.body.classList.toggle("stale", now);
  by("lost").hidden = !now;
  document.title = (now ? LOST_TITLE : "") + title;
  if (!now) return;
  enable(false);
  const since = lastHeard ?? opened;
  say(by("lost"), `${SIGNS.bad} No connection to the gateway since ${clock(since)}. ` +
    (lastHeard ? "The figures below are old." : "There are no figures yet."));
}

function connect() {
  stream?.close();
  tried = Date.now();
  stream = new EventSource("/api/live");
  stream.addEventListener("status", heard);
  // A browser gives up by itself after some kinds of failure; coming back is decided here.
  stream.addEventListener("error", () => {
    stream.close();
    setLost(true);
    setTimeout(connect, RETRY_MS);
  });
}

// A broken network path closes nothing: silence counts as lost too.
function listenForSilence() {
  const since = lastHeard ?? opened;
  const silent = Date.now() - since.getTime() > SILENT_AFTER_MS;
  if (!lost && silent) {
    setLost(true);
    connect();
  } else if (lost && Date.now() - tried > GIVE_UP_MS) {
    connect();
  }
}

const QUESTIONS = {
  arm: ["Arm the axes?", "The gateway will write offsets to the machine. It starts from what stands there now.", "Arm"],
  disarm: ["Disarm the axes?", "The gateway will write no more. What stands in the machine stays there.", "Disarm"],
  zero: ["Take the present state as zero?",
    "Temperatures are compared with now from here on. Do this on a machine that is cold and rested.", "Zero"],
};

function ask(command) {
  const [heading, text, yes] = QUESTIONS[command];
  const dialog = by("question");
  say(by("question-title"), heading);
  say(by("question-text"), text);
  say(by("question-yes"), yes);
  dialog.returnValue = "no";
  dialog.showModal();
  dialog.addEventListener("close", () => dialog.returnValue === "yes" && send(command), { once: true });
}

async function send(command, axis) {
  const answer = by("answer");
  say(answer, "…");
  const only = axis ? `?axis=${encodeURIComponent(axis)}` : "";
  try {
    const response = await fetch(`/api/${command}${only}`, {
      method: "POST",
      headers: { "isotherm-way": "page" },
      signal: AbortSignal.timeout(PATIENCE_MS),
    });
    const text = await response.text();
    const json = response.headers.get("content-type")?.startsWith("application/json");
    const sentence = json ? JSON.parse(text).answer : text.trim();
    answer.dataset.tone = response.status === 202 ? "warn" : response.ok ? "good" : "bad";
    say(answer, `${clock(new Date())} ${command}: ${sentence}`);
  } catch {
    answer.dataset.tone = "bad";
    say(answer, `${clock(new Date())} ${command}: no answer within ${PATIENCE_MS / 1000} s; not known whether it was done.`);
  }
}

async function older() {
  const button = by("older");
  button.disabled = true;
  try {
    const response = await fetch("/api/events?since=24h");
    showOlder(by("events"), (await response.json()).events);
    button.hidden = true;
  } catch {
    button.disabled = false;
  }
}

by("older").addEventListener("click", older);
buttons.forEach((button) => button.addEventListener("click", () => ask(button.dataset.command)));
document.addEventListener("visibilitychange", listenForSilence);
setInterval(listenForSilence, 500);
connect();
