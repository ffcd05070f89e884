// The learned model of an axis: which model it follows, what the candidate would have left, and the buttons to adopt it or to return.

import { element, fixed, say } from "./text.js";
import { t } from "./words.js";

const modelName = (name) => name || t("profile_model");

function gain({ since, days, touches, in_use_um: inUse, candidate_um: left, model }) {
  if (inUse === null) return t("candidate_unjudged", { model });
  return t("candidate_gain", { model, since, days, touches, left: fixed(left, 1), before: fixed(inUse, 1) });
}

export class Learned {
  constructor(name, command) {
    const button = (key, word) => {
      const made = element("button", { type: "button" }, t(key));
      made.addEventListener("click", () => command(word, name));
      return made;
    };
    this.follows = element("span");
    this.candidate = element("span");
    this.adopt = button("adopt", "adopt");
    this.back = button("adopt_back", "adopt-back");
    this.root = element("p", { className: "waiting learned", hidden: true },
      this.follows, " ", this.candidate, " ", this.adopt, this.back);
  }

  show(learned) {
    this.root.hidden = !learned;
    if (!learned) return;
    const { adopted, before, waiting, auto, candidate } = learned;
    const waits = waiting === null ? "" : t("adoption_waits", { model: modelName(waiting) });
    say(this.follows, [t("follows_model", { model: modelName(adopted) }), waits].filter(Boolean).join(" "));
    const judged = candidate && candidate.model !== adopted ? gain(candidate) : t("no_candidate");
    say(this.candidate, candidate?.better && auto ? `${judged} ${t("adopts_itself")}` : judged);
    this.adopt.hidden = !candidate?.better || waiting !== null;
    this.back.hidden = before === null && waiting === null;
    say(this.back, t(waiting === null ? "adopt_back" : "adoption_withdraw"));
  }

  enable(may) {
    this.adopt.disabled = !may;
    this.back.disabled = !may;
  }
}
