// Views of the chart that an operator keeps under the keys 1 to 9: place, zoom, theme, layers and filter, in this browser.

import { fromQuery, toQuery } from './state.js';

const KEPT = ['lat', 'lon', 'zoom', 'theme', 'layers', 'gain', 'afterglow', 'minutes', 'filter', 'sort'];
const name = (number) => `coastwatch.view.${number}`;

/** The query of what a view keeps of a state. */
export function viewOf(state) {
  const plain = fromQuery('');
  for (const key of KEPT) plain[key] = state[key];
  return toQuery(plain);
}

/** Puts a kept view into a state. Args: query: of `viewOf`. */
export function restore(state, query) {
  const found = fromQuery(query);
  for (const key of KEPT) state[key] = found[key];
}

/** Keeps the view of now under a number. */
export function keepView(app, number) {
  const { lat, lng } = app.map.getCenter().wrap();
  localStorage.setItem(name(number), viewOf({ ...app.state, lat, lon: lng, zoom: app.map.getZoom() }));
  app.say(`View ${number} is kept.`);
}

/** Shows the view that is kept under a number. */
export function showView(app, number) {
  const query = localStorage.getItem(name(number));
  if (query === null) {
    app.say(`There is no view ${number}: Shift and ${number} keep one.`);
    return;
  }
  restore(app.state, query);
  app.viewChanged();
}
