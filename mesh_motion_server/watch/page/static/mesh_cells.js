// Cells of the drawn mesh, which may be from an earlier step than the other data of the session.

const WORST = 10;

/** Numbers of the worst drawn cells, the worst first; inverted cells come before all others. */
export function worstDrawn({ quality, inverted }) {
  const rank = (cell) => (inverted[cell] ? -10 : 0) + quality[cell];
  const worst = [];
  for (let cell = 0; cell < quality.length; cell++) {
    if (worst.length === WORST && rank(cell) >= rank(worst[WORST - 1])) continue;
    worst.push(cell);
    worst.sort((a, b) => rank(a) - rank(b));
    worst.length = Math.min(WORST, worst.length);
  }
  return worst;
}

/** Centres of cells, in units of the view: the means of the nodes of their triangles. */
export function centresDrawn({ triangles, owners, points }, cells) {
  const nodes = new Map(cells.map((cell) => [cell, new Set()]));
  for (let t = 0; t < owners.length; t++) for (let c = 0; c < 3; c++) nodes.get(owners[t])?.add(triangles[3 * t + c]);
  const mean = (found, k) => found.reduce((sum, node) => sum + points[3 * node + k], 0) / found.length;
  return [...nodes.values()].filter((found) => found.size).map((found) => [0, 1, 2].map((k) => mean([...found], k)));
}

/** The number of the cell with the client's name; -1 if it is not drawn. */
export const numberDrawn = ({ types, kind, partition, local }, cell) => local.findIndex((id, k) => id === cell.cell && partition[k] === cell.partition && types[kind[k]] === cell.type);
