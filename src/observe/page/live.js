// Follows the gateway's live stream, and says when it no longer does.

import { SIGNS, alarmCount } from "./states.js";
import { clock, offset, showIn } from "./text.js";
import { t } from "./words.js";

const SILENT_AFTER_MS = 3500;
const RETRY_MS = 2000;
// An attempt on a dead path may hang for minutes; another one may find a way that has come back.
const GIVE_UP_MS = 10000;

const title = document.title;
const icon = document.querySelector("link[rel=icon]");
// There is an icon with each number up to this one; the last means as many or more.
const MOST_ON_ICON = 9;
// Stylesheets show these beside what is old.
document.documentElement.style.setProperty("--old", JSON.stringify(t("old")));
document.documentElement.style.setProperty("--last-known", JSON.stringify(t("last_known")));
const opened = new Date();

// The gateway accepts this number of a page on every computer, and shows its last page.
const LAST_PAGE = 1000000;
// A machine with many devices has pages. The address of this page has the number of its own.
const asked = parseInt(new URLSearchParams(location.search).get("page"), 10) || 1;
export const page = Math.min(LAST_PAGE, Math.max(1, asked));

let stream = null;
let tried = 0;
let lastHeard = null;
let last = null;
let lost = false;
let drawn = null;

// The number of alarms is seen on a tab that is not open: in its title and its icon.
function mark(alarms) {
  const count = alarms ? `(${alarms}) ` : "";
  const whole = (lost ? `${t("no_connection")} · ` : count) + title;
  if (document.title !== whole) document.title = whole;
  const file = alarms ? `page/icon-${Math.min(alarms, MOST_ON_ICON)}.svg` : "page/icon.svg";
  if (icon.getAttribute("href") !== file) icon.setAttribute("href", file);
}

// What the page has drawn belongs to one gateway with one profile. After a restart with another program or other axes,
// figures of the former ones would stay as if they were live.
const shape = ({ version, machine, page: own, axes, signals, outputs, devices, buses }) =>
  JSON.stringify([version, machine, own?.of, ...[axes, signals, outputs, devices, buses].map((all) => all.map(({ name, label }) => [name, label]))]);

// A stream does not say why it ended. Whoever is no longer signed in gets the page to do so.
async function signInAgain() {
  const response = await fetch("api/status", { method: "HEAD" }).catch(() => null);
  if (response?.status === 401) location.reload();
}

// `show(status)` once a second; `setLost(sentence, stopped)` when nothing comes any more, and `setLost(null)` when it does
// again. A gateway that was stopped has said so.
export function follow(show, setLost) {
  const change = (now) => {
    lost = now;
    document.body.classList.toggle("stale", now);
    mark(last ? alarmCount(last) : 0);
    if (!now) return setLost(null);
    const since = lastHeard ?? opened;
    const time = `${clock(since)} ${offset(since)}`;
    const stopped = last?.stopping ?? false;
    const sentence = t(stopped ? "was_stopped" : "lost_since", { time });
    const figures = t(lastHeard ? "figures_old" : "figures_none");
    setLost(`${SIGNS[stopped ? "off" : "bad"]} ${sentence} ${figures}`, stopped);
  };

  const connect = () => {
    stream?.close();
    tried = Date.now();
    stream = new EventSource(`api/live?page=${page}`);
    stream.addEventListener("status", (event) => {
      last = JSON.parse(event.data);
      drawn ??= shape(last);
      if (drawn !== shape(last)) return location.reload();
      lastHeard = new Date();
      showIn(last.zone);
      if (lost) change(false);
      mark(alarmCount(last));
      show(last);
      // The bench of the page measures until here.
      if (performance.getEntriesByName("figures").length === 0) performance.mark("figures");
    });
    // A browser gives up by itself after some kinds of failure; coming back is decided here.
    stream.addEventListener("error", () => {
      stream.close();
      change(true);
      signInAgain();
      setTimeout(connect, RETRY_MS);
    });
  };

  // A broken network path closes nothing: silence counts as lost too.
  const listenForSilence = () => {
    const since = lastHeard ?? opened;
    if (!lost && Date.now() - since.getTime() > SILENT_AFTER_MS) {
      change(true);
      connect();
    } else if (lost && Date.now() - tried > GIVE_UP_MS) {
      connect();
    }
  };

  document.addEventListener("visibilitychange", listenForSilence);
  setInterval(listenForSilence, 500);
  connect();
}
