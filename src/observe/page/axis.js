// One card for each axis: its value, where it stands in its limit, its last hour, and what was measured of it.

import { Bar } from "./bar.js";
import { Course } from "./course.js";
import { Learned } from "./learned.js";
import { residual, residualText, withinText } from "./measured.js";
import { Probe } from "./probe.js";
import { Sign } from "./sign.js";
import { axisState, badge, cardTone, cause, expected, standsIn, target, verified } from "./states.js";
import { Hint, brief, element, level, say, signed, span, titled } from "./text.js";
import { english, known, t } from "./words.js";

const STAGES = ["limit", "deadband", "step", "rate", "round"];
// More axes than this are rows of a table, on a screen that is wide enough.
const MOST_CARDS = 4;

const row = (title, value, properties = {}) => element("div", properties, element("dt", {}, title), value);

class Card {
  constructor(axis, command, isRow) {
    const { name } = axis;
    this.state = element("span", { className: "badge" });
    this.value = element("span", { className: "figure" });
    this.target = element("dd");
    this.raw = element("dd");
    this.verified = element("span", { className: "verified" });
    this.does = element("span");
    this.why = english(element("span"));
    this.hint = new Hint();
    this.bar = new Bar();
    this.course = new Course();
    this.expected = element("p", { className: "expected", title: t("expected_title") });
    this.residual = element("dd");
    this.within = element("dd");
    this.withinRow = row(t("in_limits"), this.within);
    this.asked = element("span");
    this.cancel = element("button", { type: "button", ariaLabel: t("cancel_axis", { axis: name }) }, t("cancel"));
    this.cancel.addEventListener("click", () => command("cancel", name));
    this.waiting = element("p", { className: "waiting" }, this.asked, this.cancel);
    this.sign = new Sign(name, command);
    this.learned = new Learned(name, command);
    this.expert = new Expert();
    const more = [this.sign.root, this.learned.root];
    this.isRow = isRow;
    this.isChecked = false;
    if (isRow) this.expert.root.append(...more);
    this.root = element("article", { className: "card axis", id: `axis-${name}` },
      element("div", { className: "row" }, element("h2", {}, titled(t("axis", { names: name }), axis)), this.state),
      element("p", { className: "why" }, this.does, " ", this.why),
      element("div", { className: "now" },
        element("p", { className: "cz" }, element("abbr", { title: t("cz_title") }, "Cz"), " ",
          element("span", { className: "whole" }, this.value, " ", element("span", { className: "unit" }, "µm")), " ", this.verified),
        element("dl", { className: "next" }, row(t("target"), this.target), row(t("raw"), this.raw)),
        this.bar.root),
      this.course.root,
      element("div", { className: "error" },
        element("dl", { className: "measured" }, row(t("true_left"), this.residual), this.withinRow), this.expected),
      element("div", { className: "more" }, this.hint.root, this.waiting, ...isRow ? [] : more),
      this.expert.root);
  }

  show(axis, status, hints) {
    const [tone, name, sentence] = axisState(axis, status);
    const toned = cardTone(axis, tone);
    if (this.root.dataset.state !== toned) this.root.dataset.state = toned;
    badge(this.state, toned, name);
    const why = cause(axis, status);
    // The gateway's own sentences are English.
    const isOwn = !standsIn(axis, status) && Boolean(axis.cause || axis.extrapolating);
    const language = isOwn ? "en" : document.documentElement.lang;
    this.why.lang = language;
    say(this.does, why ? `${sentence}:` : sentence);
    say(this.why, brief(why));
    this.hint.showOnce(axis.hint, hints);
    this.waiting.hidden = axis.waiting === null;
    if (axis.waiting) say(this.asked, t("asked", { by: axis.waiting.asked, span: span(axis.waiting.expires_s) }));
    say(this.value, signed(axis.verified_um, 1));
    say(this.target, target(axis) || t("nothing"));
    say(this.raw, axis.raw_um === null ? t("nothing") : `${signed(axis.raw_um, 1)} µm`);
    say(this.verified, verified(axis));
    this.bar.show(axis);
    this.course.show(axis, status);
    say(this.expected, expected(axis));
    const now = new Date(status.now);
    say(this.residual, residualText(axis, now));
    this.residual.classList.toggle("quiet", residual(axis) === null);
    const within = withinText(axis, now);
    this.withinRow.hidden = within === "";
    say(this.within, within);
    this.sign.show(axis);
    // The question of a sign check must not stay folded.
    if (this.isRow && axis.sign && !this.isChecked) this.expert.root.open = true;
    this.isChecked = Boolean(axis.sign);
    this.learned.show(axis.learned);
    this.expert.show(axis, status, why ? `${sentence}: ${why}` : "", language);
  }
}

// What is only needed to find out why a value is as it is: cause, guard, levels and probings.
class Expert {
  constructor() {
    this.cause = english(element("dd"));
    this.causeRow = row(t("cause"), this.cause, { className: "all" });
    this.model = element("dd");
    this.armed = element("dd");
    this.levels = element("dd");
    this.levelsRow = row(t("levels"), this.levels, { className: "all" });
    this.exact = element("dd");
    this.stages = STAGES.map((stage) => element("li", { title: known("guard_does", stage) }, known("guard", stage)));
    this.probe = new Probe();
    this.root = element("details", { className: "expert" }, element("summary", {}, t("details")),
      element("dl", { className: "facts" }, this.causeRow, row(t("model"), this.model), row(t("raw"), this.exact),
        row(t("writing"), this.armed), this.levelsRow),
      element("p", { className: "label" }, t("guard"), " ", element("span", { className: "quiet" }, t("guard_legend"))),
      element("ol", { className: "chain", ariaLabel: t("guard_stages") }, ...this.stages),
      this.probe.root);
  }

  show(axis, status, why, language) {
    this.causeRow.hidden = why === "";
    this.cause.lang = language;
    say(this.cause, why);
    const levels = [
      axis.warn_um === null ? "" : t("warns_beyond", { um: level(axis.warn_um) }),
      axis.error_um === null ? "" : t("off_beyond", { um: level(axis.error_um) }),
    ].filter(Boolean).join(", ");
    this.levelsRow.hidden = levels === "";
    say(this.levels, levels);
    say(this.model, axis.model ?? t("none"));
    say(this.exact, axis.raw_um === null ? t("nothing") : `${signed(axis.raw_um, 2)} µm`);
    say(this.armed, t(status.dry_run ? "nothing_dry_run" : axis.armed ? "armed" : "not_armed"));
    this.stages.forEach((node, index) => {
      const acted = axis.acted.includes(STAGES[index]);
      node.classList.toggle("acted", acted);
      say(node, `${acted ? "●" : "○"} ${known("guard", STAGES[index])}`);
    });
    this.probe.show(axis.probe);
  }
}

const cards = new Map();

// Commands are given by `command(word, axis)`. `hints` has the hints that are on the screen already.
export function showAxes(root, status, command, hints) {
  const isRow = status.axes.length > MOST_CARDS;
  root.classList.toggle("many", isRow);
  root.dataset.count = Math.min(status.axes.length, MOST_CARDS + 1);
  for (const axis of status.axes) {
    if (!cards.has(axis.name)) {
      const card = new Card(axis, command, isRow);
      cards.set(axis.name, card);
      root.append(card.root);
    }
    cards.get(axis.name).show(axis, status, hints);
  }
}

export function enableAxes(may) {
  for (const card of cards.values()) {
    card.cancel.disabled = !may;
    card.sign.enable(may);
    card.learned.enable(may);
  }
}
