// Which axis a command means: all of them, or one.

import { element, labelled } from "./text.js";
import { t } from "./words.js";

const label = document.getElementById("question-which");
const choice = document.getElementById("question-axis");

// One axis alone is no choice.
export function offer(axes) {
  const names = axes.map((axis) => axis.name);
  label.hidden = names.length < 2;
  if (choice.options.length === names.length + 1) return;
  choice.replaceChildren(element("option", { value: "" }, t("every_axis")),
    ...axes.map((axis) => element("option", { value: axis.name }, labelled(axis))));
}

// All of them, until a person says another thing.
export function reset() {
  choice.value = "";
}

export const chosen = () => choice.value || undefined;
