// Elements of the page. Texts become text, never markup.

/** The element with an id. */
export const byId = (id) => document.getElementById(id);

/** A new element with attributes and children: elements, or texts. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/**
 * Fills a fieldset with radio buttons, one for each `{ value, label, key }`, and calls
 * `choose` with the value of the one that the user picks. `key` is shown before the label.
 */
export function fillRadios(fieldset, options, chosen, choose) {
  const labels = options.map(({ value, label, key }) => {
    const input = element("input", { type: "radio", name: fieldset.id, value });
    input.checked = value === chosen;
    input.addEventListener("change", () => choose(value));
    const hint = key ? [element("kbd", { "aria-hidden": "true" }, key)] : [];
    return element("label", {}, input, ...hint, element("span", {}, label));
  });
  fieldset.replaceChildren(fieldset.querySelector("legend"), ...labels);
}

/** Marks the radio button with a value. */
export function checkRadio(fieldset, value) {
  for (const input of fieldset.querySelectorAll("input")) input.checked = input.value === value;
}
