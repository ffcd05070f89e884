// The guided check of an axis's sign with a dial gauge: prepare, move, look, answer.

import { bothTimes, element, say, span } from "./text.js";
import { english, known, t } from "./words.js";

const WAYS = ["sign-plus", "sign-minus", "sign-none"];

export class Sign {
  constructor(name, command) {
    const button = (key, act) => {
      const made = element("button", { type: "button" }, t(key));
      made.addEventListener("click", act);
      return made;
    };
    this.prepares = false;
    this.text = element("span");
    this.reason = english(element("span"));
    this.begin = button("sign", () => { this.prepares = true; this.arrange(null); });
    this.move = button("sign_move", () => { this.prepares = false; this.arrange(null); command("sign", name); });
    this.ways = WAYS.map((way) => button(way, () => command(way, name)));
    this.cancel = button("cancel", () => {
      if (this.axis?.sign) command("cancel", name);
      this.prepares = false;
      this.arrange(null);
    });
    this.root = element("p", { className: "waiting" }, this.text, " ", this.reason, " ",
      this.begin, this.move, ...this.ways, this.cancel);
    this.name = name;
  }

  show(axis) {
    this.axis = axis;
    // A check that runs is prepared, and an axis that was disarmed meanwhile cannot be checked.
    if (axis.sign || !this.may()) this.prepares = false;
    this.root.hidden = !this.may() && !axis.sign_checked;
    this.arrange(axis.sign);
  }

  // An axis without a model is armed by the check itself.
  may() {
    return Boolean(this.axis?.armed || this.axis?.has_model === false);
  }

  // A check that was requested waits until the axis compensates.
  waits(sign) {
    return Boolean(sign && !sign.there && this.axis?.why);
  }

  arrange(sign) {
    this.begin.hidden = this.prepares || Boolean(sign) || !this.may();
    this.move.hidden = !this.prepares || Boolean(sign);
    this.ways.forEach((way) => (way.hidden = !sign?.there));
    this.cancel.hidden = !this.prepares && !sign;
    say(this.reason, this.waits(sign) ? this.axis.cause : "");
    say(this.text, this.sentence(sign));
    // A wrong sign stays in sight: every µm makes the error larger.
    const isWrong = !sign && !this.prepares && (this.axis?.sign_checked?.[1] ?? "plus") !== "plus";
    if (isWrong) this.text.dataset.tone = "bad";
    else delete this.text.dataset.tone;
  }

  sentence(sign) {
    if (this.waits(sign)) return t("sign_waits");
    if (sign) return sign.there ? t("sign_which", { span: span(sign.expires_s) }) : t("sign_moving");
    if (this.prepares) return t("sign_prepare", { axis: this.name });
    const last = this.axis?.sign_checked;
    return last ? t("sign_last", { when: bothTimes(new Date(last[0]))[0], moved: known("sign_found", last[1]) }) : t("sign_never");
  }

  enable(may) {
    [this.begin, this.move, this.cancel, ...this.ways].forEach((button) => (button.disabled = !may));
  }
}
