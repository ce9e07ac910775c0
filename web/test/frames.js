// Writes frames of coastwatch.picture.v1, or v2 where rows have a length, for tests, from the text of the format; shares nothing with wire.js.

const COLUMNS = [['lon', 'setInt32', 4], ['lat', 'setInt32', 4], ['sog', 'setUint16', 2], ['cog', 'setUint16', 2],
  ['kind', 'setUint8', 1], ['flag', 'setUint8', 1], ['major', 'setUint8', 1], ['minor', 'setUint8', 1],
  ['angle', 'setUint8', 1], ['age', 'setUint8', 1]];

const ECHOES = [['length', 'setUint8', 1], ['width', 'setUint8', 1], ['axis', 'setUint8', 1]];
const hasEchoes = (rows) => rows.some((row) => row.length !== undefined);

function message(head, parts) {
  const size = 48 + parts.reduce((sum, { values, width }) => sum + Math.ceil((values.length * width) / 4) * 4, 0);
  const view = new DataView(new ArrayBuffer(size));
  [...'CWP1'].forEach((letter, k) => view.setUint8(k, letter.charCodeAt(0)));
  view.setUint8(4, head.echoes ? 2 : 1);
  view.setUint16(6, head.echoes ? 1 : 0, true);
  view.setUint8(5, head.kind);
  view.setUint32(8, head.seq, true);
  view.setUint32(12, head.base ?? 0, true);
  view.setFloat64(16, head.time ?? 1000, true);
  ['slots', 'changed', 'removed', 'born'].forEach((name, k) => view.setUint32(24 + 4 * k, head[name] ?? 0, true));
  view.setUint32(40, head.run, true);
  view.setUint32(44, size, true);
  let offset = 48;
  for (const { values, width, setter } of parts) {
    values.forEach((value, k) => view[setter](offset + k * width, value, true));
    offset += Math.ceil((values.length * width) / 4) * 4;
  }
  return view.buffer;
}

const words = (values) => ({ values, width: 4, setter: 'setUint32' });
const columnsOf = (rows) => [...COLUMNS.map(([name, setter, width]) => ({ values: rows.map((row) => row[name] ?? 0), width, setter })),
  ...(hasEchoes(rows) ? ECHOES : []).map(([name, setter, width]) => ({ values: rows.map((row) => row[name] ?? 255), width, setter }))];

/** @param {object[]} rows one a slot: id and columns in the units of the wire */
export const full = (head, rows) =>
  message({ kind: 1, slots: rows.length, echoes: hasEchoes(rows), ...head }, [words(rows.map((row) => row.id)), ...columnsOf(rows)]);

/** @param {object[]} rows changed ones: slot, id, `born` where the slot is new */
export function delta(head, rows, removed = []) {
  const born = rows.filter((row) => row.born);
  const counts = { echoes: hasEchoes(rows), changed: rows.length, removed: removed.length, born: born.length };
  return message({ kind: 2, ...counts, ...head }, [words(rows.map((row) => row.slot)), words(removed),
    words(born.map((row) => row.slot)), words(born.map((row) => row.id)), ...columnsOf(rows)]);
}

export const heartbeat = (head) => message({ kind: 5, ...head }, []);
