// The page's own words: the gateway puts those of one language into the page, by their keys.

const words = JSON.parse(document.getElementById("words").textContent);

// What stands in braces is replaced by the value of that name.
export function t(key, values = {}) {
  return (words[key] ?? key).replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
}

// Of a word that programs read, as `state.active`; one that is not known stands for itself.
export const known = (kind, word) => words[`${kind}.${word}`] ?? word;

// What the gateway says in sentences stays English, and is marked so.
export function english(node) {
  node.lang = "en";
  return node;
}
