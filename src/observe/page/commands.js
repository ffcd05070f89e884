// The commands for all axes or for one: the present state, and what each command will do.

import { element, labelled, listed, say, signed } from "./text.js";
import { t } from "./words.js";

const section = document.querySelector(".buttons");
const buttons = [...section.querySelectorAll("button")];
const dialog = document.getElementById("question");
const by = (id) => document.getElementById(id);
const choice = by("question-axis");

export const mayCommand = section.dataset.may === "true";

// The axes of the page, and those of the machine: all, or some of each kind.
let axes = [];
let every = [];
let whole;
let isDryRun = false;

const names = (some) => listed(some, whole);
const values = (some) => listed(some, whole, (axis) => `${axis.name} ${signed(axis.verified_um, 1)} µm`);

// What a command finds at these axes, and what it will do there.
function effect(command, some) {
  if (some.length === 0) return t("no_axes");
  const armed = some.filter((axis) => axis.armed);
  const [off, bare] = [true, false].map((has) => some.filter((axis) => !axis.armed && axis.has_model === has));
  if (command === "arm") {
    const without = bare.length ? t("arm_without_model", { names: names(bare) }) : "";
    const does = off.length ? t(isDryRun ? "arm_does_dry_run" : "arm_does", { names: names(off) }) : "";
    const already = armed.length ? t("arm_already", { names: names(armed) }) : "";
    return [does, without, already].filter(Boolean).join(" ");
  }
  if (command === "disarm") {
    if (armed.length === 0) return t("disarm_none");
    return isDryRun ? t("disarm_does_dry_run", { names: names(armed) }) : t("disarm_does", { values: values(armed) });
  }
  return t("zero_does", { values: values(some) });
}

// The state of the outputs, as the commands find it.
function outputs() {
  const armed = every.filter((axis) => axis.armed);
  // A machine without axes has nothing armed.
  if (armed.length === 0) return t("output_not_armed");
  if (armed.length === every.length) return t("output_armed");
  return t("output_partly", { armed: names(armed), off: names(every.filter((axis) => !axis.armed)) });
}

export function showCommands(status) {
  [axes, every] = [status, status.whole ?? status].map((part) => part.axes.filter((axis) => !axis.release));
  ({ whole } = status);
  isDryRun = status.dry_run;
  say(by("outputs-now"), outputs());
  for (const { dataset: { command } } of buttons) say(by(`does-${command}`), effect(command, every));
  // One axis alone is no choice.
  by("question-which").hidden = every.length < 2;
  if (choice.options.length !== axes.length + 1) {
    choice.replaceChildren(element("option", { value: "" }, t("every_axis")),
      ...axes.map((axis) => element("option", { value: axis.name }, labelled(axis))));
  }
  if (dialog.open) showEffect();
}

export function enableCommands(may) {
  buttons.forEach((button) => (button.disabled = !may));
}

const chosen = () => (choice.value === "" ? every : axes.filter((axis) => axis.name === choice.value));

function showEffect() {
  say(by("question-effect"), effect(dialog.dataset.command, chosen()));
}

function ask(command, send) {
  dialog.dataset.command = command;
  say(by("question-title"), t(`ask_${command}`));
  say(by("question-text"), t(`ask_${command}_text`));
  say(by("question-yes"), t(command));
  // All axes, until the operator selects one.
  choice.value = "";
  showEffect();
  dialog.returnValue = "no";
  dialog.showModal();
  dialog.addEventListener("close", () => dialog.returnValue === "yes" && send(command, choice.value || undefined), { once: true });
}

// `send(command, axis)` gives a command, after the question; without an axis, to all.
export function listen(send) {
  choice.addEventListener("change", showEffect);
  buttons.forEach((button) => button.addEventListener("click", () => ask(button.dataset.command, send)));
}
