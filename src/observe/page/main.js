// Shows what the gateway says, and gives it commands.

import { enableAlarms, showAlarms } from "./alarms.js";
import { enableAxes, showAxes } from "./axis.js";
import { follow } from "./live.js";
import { showPast } from "./past.js";
import { SIGNS, overall } from "./states.js";
import { showEvents, showOlder, showOverridden, showTables } from "./tables.js";
import { bothTimes, clock, say, span } from "./text.js";
import * as which from "./which.js";
import { known, t } from "./words.js";

// What the gateway has not begun by then is never done: it sees that nobody waits any more.
const PATIENCE_MS = 5000;

const by = (id) => document.getElementById(id);
const buttons = [...document.querySelectorAll(".buttons button")];
const mayCommand = document.querySelector(".buttons").dataset.may === "true";

function show(status) {
  const [tone, word, sentence] = overall(status);
  by("overall").dataset.tone = tone;
  say(by("overall").querySelector(".sign"), SIGNS[tone]);
  say(by("word"), word);
  say(by("sentence"), sentence);
  const now = new Date(status.now);
  const [here, utc] = bothTimes(now);
  say(by("machine-time"), here);
  say(by("utc"), utc);
  say(by("clock-word"), known("clock", status.clock));
  say(by("machine-on"), status.machine_on_s === null ? t("machine_not_on") : span(status.machine_on_s));
  say(by("uptime"), span(status.uptime_s));
  showAxes(by("axes"), status, send);
  which.offer(status.axes);
  showAlarms(by("alarms"), status, acknowledge, mayCommand);
  showPast(status);
  showTables(status);
  showOverridden(status);
  showEvents(by("events"), status.events, now);
  enable(mayCommand && !status.stopping);
}

function enable(may) {
  buttons.forEach((button) => (button.disabled = !may));
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

function ask(command) {
  const dialog = by("question");
  say(by("question-title"), t(`ask_${command}`));
  say(by("question-text"), t(`ask_${command}_text`));
  say(by("question-yes"), t(command));
  which.reset();
  dialog.returnValue = "no";
  dialog.showModal();
  dialog.addEventListener("close", () => dialog.returnValue === "yes" && send(command, which.chosen()), { once: true });
}

const acknowledge = (alarm) => send("acknowledge", null, alarm);

async function send(command, axis, alarm) {
  const answer = by("answer");
  say(answer, "…");
  const only = axis ? `?axis=${encodeURIComponent(axis)}` : alarm ? `?alarm=${encodeURIComponent(alarm)}` : "";
  const said = (tone, sentence) => {
    answer.dataset.tone = tone;
    say(answer, `${clock(new Date())} ${t(command)}: ${sentence}`);
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
buttons.forEach((button) => button.addEventListener("click", () => ask(button.dataset.command)));
follow(show, setLost);
