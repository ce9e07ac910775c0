// Builds elements of the page. Text from ships goes in as text nodes, never as HTML.

/** The element of the page with this id. */
export const byId = (id) => document.getElementById(id);

/**
 * Makes an element.
 * @param {string} tag
 * @param {object} properties `on...` are listeners, others attributes; false, null and undefined are left out
 * @param {...(Node|string|null|false)} children
 */
export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === false || value === null || value === undefined) continue;
    if (name.startsWith('on')) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? '' : String(value));
  }
  made.append(...children.flat().filter((child) => child !== null && child !== false && child !== undefined));
  return made;
}

/** Replaces what an element holds. */
export const fill = (target, ...children) => target.replaceChildren(...children.flat().filter(Boolean));

/** Rows of a list of names and values. */
export const pairs = (rows) =>
  element('dl', {}, rows.filter(Boolean).map(([name, value]) => [element('dt', {}, name), element('dd', {}, value)]).flat());
