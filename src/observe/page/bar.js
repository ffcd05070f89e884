// Where the value stands within its limit.

import { verified } from "./states.js";
import { element, level, say, signed } from "./text.js";
import { t } from "./words.js";

export class Bar {
  constructor() {
    this.fill = element("div", { className: "fill" });
    this.wish = element("div", { className: "wish", title: t("raw") });
    this.low = element("span");
    this.high = element("span");
    this.track = element("div", { className: "track", role: "img", ariaLabel: t("limit_bar") },
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
    this.fill.classList.toggle("near", held !== null && Math.abs(held) >= 0.9 * limit);
    this.wish.hidden = axis.raw_um === null;
    this.wish.style.left = `${place(axis.raw_um ?? 0)}%`;
    say(this.low, level(-axis.limit_um));
    say(this.high, `+${level(axis.limit_um)} µm`);
    this.track.ariaLabel = held === null
      ? verified(axis)
      : t("of_limit", { um: signed(held, 1), limit: level(axis.limit_um) });
  }
}
