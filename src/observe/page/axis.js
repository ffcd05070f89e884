// One card for each axis: its value, where it stands in its limit, and what the guard did.

import { Learned } from "./learned.js";
import { Probe } from "./probe.js";
import { Sign } from "./sign.js";
import { axisState, badge, expected, standsIn, verified } from "./states.js";
import { Hint, element, fixed, say, signed, span, titled } from "./text.js";
import { english, known, t } from "./words.js";

const STAGES = ["limit", "deadband", "step", "rate", "round"];

class Card {
  constructor(axis, command) {
    const { name } = axis;
    this.state = element("span", { className: "badge" });
    this.value = element("span", { className: "figure" });
    this.expected = element("span", { className: "expected", title: t("expected_title") });
    this.stands = element("span", { className: "quiet" });
    this.raw = element("dd");
    this.model = element("dd");
    this.armed = element("dd");
    this.levels = element("dd");
    this.levelsRow = element("div", { className: "all" }, element("dt", {}, t("levels")), this.levels);
    this.does = element("span");
    this.why = english(element("span"));
    this.hint = new Hint();
    this.asked = element("span");
    const cancel = element("button", { type: "button", ariaLabel: t("cancel_axis", { axis: name }) }, t("cancel"));
    cancel.addEventListener("click", () => command("cancel", name));
    this.cancel = cancel;
    this.waiting = element("p", { className: "waiting" }, this.asked, cancel);
    this.stages = STAGES.map((stage) => element("li", { title: known("guard_does", stage) }, known("guard", stage)));
    this.bar = new Bar();
    this.probe = new Probe();
    this.sign = new Sign(name, command);
    this.learned = new Learned(name, command);
    this.root = element("article", { className: "card axis" },
      element("div", { className: "row" }, element("h2", {}, titled(t("axis", { names: name }), axis)), this.state),
      element("p", { className: "why" }, this.does, " ", this.why, this.hint.root),
      this.waiting,
      element("p", { className: "cz" }, element("abbr", { title: t("cz_title") }, "Cz"), " ",
        this.value, " ", element("span", { className: "unit" }, "µm"), " ", this.expected, " ", this.stands),
      this.bar.root,
      element("dl", { className: "facts" },
        element("div", {}, element("dt", {}, t("raw")), this.raw),
        element("div", { className: "wide" }, element("dt", {}, t("model")), this.model),
        element("div", {}, element("dt", {}, t("writing")), this.armed),
        this.levelsRow),
      element("p", { className: "label" }, t("guard"), " ", element("span", { className: "quiet" }, t("guard_legend"))),
      element("ol", { className: "chain", ariaLabel: t("guard_stages") }, ...this.stages),
      this.sign.root,
      this.learned.root,
      this.probe.root);
  }

  show(axis, status) {
    const [tone, name, sentence] = axisState(axis, status);
    const uneasy = tone === "good" && (axis.warned || axis.extrapolating || axis.probe?.worse);
    badge(this.state, uneasy ? "warn" : tone, name);
    const warned = axis.warned ? t("warned", { um: fixed(axis.warn_um, 0) }) : "";
    const stands = standsIn(axis, status);
    const why = [stands || axis.cause || axis.extrapolating?.text, warned].filter(Boolean).join("; ");
    this.why.lang = stands ? document.documentElement.lang : "en";
    say(this.does, why ? `${sentence}:` : sentence);
    say(this.why, why);
    this.hint.show(axis.hint);
    this.waiting.hidden = axis.waiting === null;
    if (axis.waiting) say(this.asked, t("asked", { by: axis.waiting.asked, span: span(axis.waiting.expires_s) }));
    const levels = [
      axis.warn_um === null ? "" : t("warns_beyond", { um: fixed(axis.warn_um, 0) }),
      axis.error_um === null ? "" : t("off_beyond", { um: fixed(axis.error_um, 0) }),
    ].filter(Boolean).join(", ");
    this.levelsRow.hidden = levels === "";
    say(this.levels, levels);
    say(this.value, signed(axis.verified_um, 1));
    say(this.expected, expected(axis));
    say(this.stands, verified(axis));
    say(this.raw, axis.raw_um === null ? t("nothing") : `${signed(axis.raw_um, 2)} µm`);
    say(this.model, axis.model ?? t("none"));
    say(this.armed, t(status.dry_run ? "nothing_dry_run" : axis.armed ? "armed" : "not_armed"));
    this.stages.forEach((node, index) => {
      const acted = axis.acted.includes(STAGES[index]);
      node.classList.toggle("acted", acted);
      say(node, `${acted ? "●" : "○"} ${known("guard", STAGES[index])}`);
    });
    this.bar.show(axis);
    this.sign.show(axis);
    this.learned.show(axis.learned);
    this.probe.show(axis.probe);
  }
}

class Bar {
  constructor() {
    this.fill = element("div", { className: "fill" });
    this.wish = element("div", { className: "wish", title: t("raw") });
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
    // The value that was verified in the control; never the target.
    const held = axis.verified_um;
    const end = place(held ?? 0);
    this.fill.hidden = held === null;
    this.fill.style.left = `${Math.min(50, end)}%`;
    this.fill.style.width = `${Math.abs(end - 50)}%`;
    this.wish.hidden = axis.raw_um === null;
    this.wish.style.left = `${place(axis.raw_um ?? 0)}%`;
    say(this.low, `${signed(-axis.limit_um, 0)}`);
    say(this.high, `${signed(axis.limit_um, 0)} µm`);
    this.track.ariaLabel = held === null
      ? verified(axis)
      : t("of_limit", { um: signed(held, 1), limit: fixed(axis.limit_um, 0) });
  }
}

const cards = new Map();

// Commands are given by `command(word, axis)`.
export function showAxes(root, status, command) {
  for (const axis of status.axes) {
    if (!cards.has(axis.name)) {
      const card = new Card(axis, command);
      cards.set(axis.name, card);
      root.append(card.root);
    }
    cards.get(axis.name).show(axis, status);
  }
}

export function enableAxes(may) {
  for (const card of cards.values()) {
    card.cancel.disabled = !may;
    card.sign.enable(may);
    card.learned.enable(may);
  }
}
