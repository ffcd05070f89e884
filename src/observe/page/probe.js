// What probings taught an axis: the last one, the correction, and the residuals with the level at which people are warned. And whether
// they show that the model is worse than no compensation.

import { worse } from "./measured.js";
import { clock, day, element, fixed, say, signed, svg } from "./text.js";
import { t } from "./words.js";

const HEIGHT = 90;
const LEFT = 46;
const RIGHT = 10;
const EDGE = 12;

const stamp = (text) => `${day(new Date(text)).slice(5)} ${clock(new Date(text), false)}`;

export class Probe {
  constructor() {
    this.correction = element("dd");
    this.last = element("dd");
    this.gains = element("dd");
    this.compared = element("dd");
    this.svg = svg("svg", { role: "img", height: HEIGHT });
    this.figure = element("figure", { className: "chart residuals" },
      element("figcaption", {}, element("span", {}, t("residuals")),
        element("span", { className: "quiet" }, "µm")),
      this.svg);
    this.changed = element("div", { className: "all" }, element("dt", {}, t("gains_changed")), this.gains);
    this.comparison = element("div", { className: "all worse" }, element("dt", {}, t("comparison")), this.compared);
    this.root = element("div", { className: "probe", role: "group", ariaLabel: t("probe"), hidden: true },
      element("dl", { className: "facts" },
        element("div", {}, element("dt", {}, t("correction")), this.correction),
        element("div", { className: "wide" }, element("dt", {}, t("last_probing")), this.last),
        this.comparison,
        this.changed),
      this.figure);
    new ResizeObserver(() => this.draw()).observe(this.figure);
  }

  show(probe) {
    this.root.hidden = !probe;
    if (!probe) return;
    say(this.correction, t("of_limit", { um: signed(probe.correction_um, 2), limit: fixed(probe.limit_um, 0) }));
    const { last } = probe;
    const learned = last?.refused
      ? t("not_learned", { why: last.refused }) : t("residual", { um: signed(last?.residual_um, 1) });
    say(this.last, last
      ? `${stamp(last.at)}: ${t("probed", { um: signed(last.error_um, 1), cz: signed(last.acting_um, 1) })}; ${learned}`
      : t("none_yet"));
    this.comparison.hidden = !probe.worse;
    say(this.compared, probe.worse ? worse(probe.worse) : "");
    this.changed.hidden = probe.gains.length === 0;
    say(this.gains, probe.gains.map((gain) => `${gain.signal} ${signed(100 * gain.change, 1)} %`).join(", "));
    const mark = JSON.stringify([probe.history, probe.warn_um]);
    if (mark === this.mark) return;
    [this.mark, this.probe] = [mark, probe];
    this.figure.hidden = probe.history.length === 0;
    this.draw();
  }

  draw() {
    const width = this.figure.clientWidth;
    if (!width || !this.probe?.history.length) return;
    const { history, warn_um: warn } = this.probe;
    const reach = Math.max(1, warn ?? 0, ...history.map(([, residual]) => Math.abs(residual)));
    const y = (value) => HEIGHT / 2 - (value / reach) * (HEIGHT / 2 - EDGE);
    const x = (place) => LEFT + ((place + 0.5) / history.length) * (width - LEFT - RIGHT);
    const across = { x1: LEFT, x2: width - RIGHT };
    const parts = [svg("line", { class: "zero", ...across, y1: y(0), y2: y(0) })];
    for (const value of [-reach, 0, reach]) {
      parts.push(svg("text", { x: LEFT - 6, y: y(value) + 4, "text-anchor": "end" }, signed(value, reach < 10 ? 1 : 0)));
    }
    for (const level of warn === null ? [] : [-warn, warn]) {
      parts.push(svg("line", { class: "limit", ...across, y1: y(level), y2: y(level) }));
    }
    history.forEach(([at, residual], place) => {
      const beyond = warn !== null && Math.abs(residual) > warn;
      const dot = svg("circle", { class: beyond ? "beyond" : "cz", cx: x(place), cy: y(residual), r: beyond ? 4 : 3 });
      dot.append(svg("title", {}, `${stamp(at)}: ${signed(residual, 1)} µm`));
      parts.push(dot);
    });
    this.svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    const last = history.at(-1)[1];
    this.svg.setAttribute("aria-label", `${t("residuals")}: ${signed(last, 1)} µm`);
    this.svg.replaceChildren(...parts);
  }
}
