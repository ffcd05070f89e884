// One card for each axis: its value, where it stands in its limit, what the guard did, and its course.

import { Chart } from "./chart.js";
import { Probe } from "./probe.js";
import { axisState, badge, element, say, signed, fixed, span } from "./text.js";

const STAGES = [
  ["limit", "more than the limit was asked for"],
  ["deadband", "the change was too small to be made"],
  ["step", "the change was cut to the largest step"],
  ["rate", "the change was cut to the largest speed"],
  ["round", "rounded to whole counts"],
];

class Card {
  constructor(name, command) {
    this.state = element("span", { className: "badge" });
    this.value = element("span", { className: "figure" });
    this.stands = element("span", { className: "quiet" });
    this.raw = element("dd");
    this.model = element("dd");
    this.armed = element("dd");
    this.levels = element("dd");
    this.levelsRow = element("div", { className: "all" }, element("dt", {}, "Levels"), this.levels);
    this.why = element("p", { className: "why" });
    this.asked = element("span");
    const cancel = element("button", { type: "button", ariaLabel: `Cancel the request to arm axis ${name}` }, "Cancel");
    cancel.addEventListener("click", () => command("cancel", name));
    this.cancel = cancel;
    this.waiting = element("p", { className: "waiting" }, this.asked, cancel);
    this.stages = STAGES.map(([stage, title]) => element("li", { title }, stage));
    this.bar = new Bar();
    this.chart = new Chart();
    this.probe = new Probe();
    this.root = element("article", { className: "card axis" },
      element("div", { className: "row" }, element("h2", {}, `Axis ${name}`), this.state),
      this.why,
      this.waiting,
      element("p", { className: "cz" }, element("abbr", { title: "compensation value" }, "Cz"), " ",
        this.value, " ", element("span", { className: "unit" }, "µm"), " ", this.stands),
      this.bar.root,
      element("dl", { className: "facts" },
        element("div", {}, element("dt", {}, "Model asks for"), this.raw),
        element("div", { className: "wide" }, element("dt", {}, "Model in use"), this.model),
        element("div", {}, element("dt", {}, "Writing"), this.armed),
        this.levelsRow),
      element("p", { className: "label" }, "Guard: ",
        element("span", { className: "quiet" }, "● changed the last value, ○ let it pass")),
      element("ol", { className: "chain", ariaLabel: "Stages of the guard" }, ...this.stages),
      this.chart.root,
      this.probe.root);
  }

  show(axis, status) {
    const [tone, name, sentence] = axisState(axis);
    const uneasy = tone === "good" && (axis.warned || axis.extrapolating);
    badge(this.state, uneasy ? "warn" : tone, name);
    const warned = axis.warned ? `Cz lies beyond its warning level of ±${fixed(axis.warn_um, 0)} µm` : "";
    const why = [axis.why || axis.extrapolating?.text, warned].filter(Boolean).join("; ");
    say(this.why, why ? `${sentence}: ${why}` : sentence);
    this.waiting.hidden = axis.waiting === null;
    if (axis.waiting) say(this.asked, `Asked for ${axis.waiting.asked}; given up in ${span(axis.waiting.expires_s)}.`);
    const levels = [
      axis.warn_um === null ? "" : `warns beyond ±${fixed(axis.warn_um, 0)} µm`,
      axis.error_um === null ? "" : `goes off where the model asks for more than ±${fixed(axis.error_um, 0)} µm`,
    ].filter(Boolean).join(", ");
    this.levelsRow.hidden = levels === "";
    say(this.levels, levels);
    // What was verified stands there; what is wanted may still be on its way, or never arrive.
    const isKnown = axis.verified_um !== null;
    say(this.value, signed(isKnown ? axis.verified_um : axis.cz_um, 1));
    say(this.stands, isKnown
      ? `verified ${span(axis.verified_age_s)} ago; wanted ${signed(axis.cz_um, 1)} µm`
      : "wanted; nothing was verified yet");
    say(this.raw, axis.raw_um === null ? "nothing" : `${signed(axis.raw_um, 2)} µm`);
    say(this.model, axis.model ?? "none");
    say(this.armed, status.dry_run ? "nothing (dry run)" : axis.armed ? "armed" : "not armed");
    this.stages.forEach((node, index) => {
      const acted = axis.acted.includes(STAGES[index][0]);
      node.classList.toggle("acted", acted);
      say(node, `${acted ? "●" : "○"} ${STAGES[index][0]}`);
    });
    this.bar.show(axis);
    this.probe.show(axis.probe);
    this.chart.add(new Date(status.now).getTime(), axis);
  }
}

class Bar {
  constructor() {
    this.fill = element("div", { className: "fill" });
    this.wish = element("div", { className: "wish", title: "what the model asks for" });
    this.low = element("span");
    this.high = element("span");
    this.track = element("div", { className: "track", role: "img" },
      this.fill, element("div", { className: "middle" }), this.wish);
    this.root = element("div", { className: "bar" }, this.track,
      element("div", { className: "ends", ariaHidden: "true" }, this.low, element("span", {}, "0"), this.high));
  }

  show(axis) {
    const limit = axis.limit_um > 0 ? axis.limit_um : 1;
    const place = (value) => 50 + 50 * Math.max(-1, Math.min(1, value / limit));
    const end = place(axis.cz_um);
    this.fill.style.left = `${Math.min(50, end)}%`;
    this.fill.style.width = `${Math.abs(end - 50)}%`;
    this.wish.hidden = axis.raw_um === null;
    this.wish.style.left = `${place(axis.raw_um ?? 0)}%`;
    say(this.low, `${signed(-axis.limit_um, 0)}`);
    say(this.high, `${signed(axis.limit_um, 0)} µm`);
    this.track.ariaLabel = `${signed(axis.cz_um, 1)} of ±${fixed(axis.limit_um, 0)} micrometres`;
  }
}

const cards = new Map();

// Commands are given by `command(word, axis)`.
export function showAxes(root, status, command) {
  for (const axis of status.axes) {
    if (!cards.has(axis.name)) {
      const card = new Card(axis.name, command);
      cards.set(axis.name, card);
      root.append(card.root);
    }
    cards.get(axis.name).show(axis, status);
  }
}

export function enableAxes(may) {
  for (const card of cards.values()) card.cancel.disabled = !may;
}
