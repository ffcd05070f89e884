// What is read from three metres: one word for the machine, and a figure for each axis.

import { follow } from "./live.js";
import { SIGNS, axisState, expected, overall, verified } from "./states.js";
import { bothTimes, element, say, signed, titled } from "./text.js";
import { t } from "./words.js";

const by = (id) => document.getElementById(id);
const axes = new Map();

if (location.search !== "?view=wall") history.replaceState(null, "", "?view=wall");

function panel(axis) {
  const parts = {
    figure: element("span", { className: "figure" }),
    expected: element("p", { className: "expected" }),
    verified: element("p", { className: "verified" }),
    state: element("p", { className: "state" }),
  };
  by("axes").append(element("section", {},
    element("h2", {}, titled(t("axis", { names: axis.name }), axis)),
    element("p", { className: "cz" }, parts.figure, " ", element("span", { className: "unit" }, "µm")),
    parts.verified, parts.expected, parts.state));
  axes.set(axis.name, parts);
  return parts;
}

follow((status) => {
  const [tone, word, sentence] = overall(status);
  document.body.dataset.tone = tone;
  say(by("word"), `${SIGNS[tone]} ${word}`);
  say(by("sentence"), sentence);
  say(by("time"), bothTimes(new Date(status.now)).filter(Boolean).join(" · "));
  for (const axis of status.axes) {
    const { figure, expected: within, verified: stands, state } = axes.get(axis.name) ?? panel(axis);
    const [its, name] = axisState(axis, status);
    say(figure, signed(axis.verified_um, 1));
    say(stands, verified(axis));
    say(within, expected(axis));
    say(state, `${SIGNS[its]} ${name}`);
  }
}, (sentence, stopped) => {
  by("lost").hidden = sentence === null;
  if (sentence === null) return;
  say(by("lost"), sentence);
  document.body.dataset.tone = stopped ? "off" : "lost";
  if (!stopped) say(by("word"), t("no_connection"));
});
