// The trend of an axis: Cz and the value of its model in the last hour.

import { HOUR_S, lastHour, spanOf } from "./recent.js";
import { element, say, signed } from "./text.js";
import { Trend } from "./trend.js";
import { t } from "./words.js";

// A course of less than this looks flat, in µm.
const LEAST_UM = 2;

export class Course {
  constructor() {
    this.trend = new Trend(t("trend"));
    this.change = element("span", { className: "change" });
    this.root = element("figure", { className: "course" },
      element("figcaption", {}, element("span", {}, t("trend")), " ", this.change),
      element("div", { className: "plot" }, this.trend.root));
  }

  show(axis, status) {
    const points = lastHour(`${axis.name}_cz_um`);
    const span = spanOf(status);
    const good = points.filter(([at, value]) => value !== null && at >= span.from);
    const [first, last] = [good[0], good.at(-1)];
    // What began only now has no change in an hour.
    const isWhole = first && last[0] - first[0] > 0.9 * HOUR_S;
    const change = isWhole ? t("trend_change", { um: signed(last[2] - first[1], 1) }) : "";
    say(this.change, change);
    this.trend.show({
      points,
      wished: lastHour(`${axis.name}_raw_um`),
      ...span,
      least: LEAST_UM,
      limit: axis.limit_um,
      label: `${t("trend")}: ${change || "–"}`,
    });
  }
}
