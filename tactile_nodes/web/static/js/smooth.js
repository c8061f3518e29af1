// Values on a grid of cells as a smooth surface, and its contour lines.

/** The grid refined by `factor` with Catmull-Rom interpolation, which passes through the value of every cell. */
export function finer(values, rows, cols, factor) {
  const across = stretched(values, rows, cols, factor, cols, 1);
  const [down, right] = [rows * factor, cols * factor];
  return { values: stretched(across, right, rows, factor, 1, right), rows: down, cols: right };
}

/** `lines` lines of `count` values; the stride is `along` within a line and `apart` between lines. */
function stretched(values, lines, count, factor, apart, along) {
  const made = new Float32Array(lines * count * factor);
  const taps = Array.from({ length: factor }, (_, phase) => cubic((phase + 0.5) / factor - 0.5));
  const longer = along === 1 ? apart * factor : apart;
  for (let place = 0; place < count; place += 1) {
    for (let phase = 0; phase < factor; phase += 1) {
      const { first, weights } = taps[phase];
      const at = weights.map((_, tap) => Math.min(count - 1, Math.max(0, place + first + tap)) * along);
      for (let line = 0; line < lines; line += 1) {
        const from = line * apart;
        made[line * longer + (place * factor + phase) * along] =
          weights[0] * values[from + at[0]] + weights[1] * values[from + at[1]] +
          weights[2] * values[from + at[2]] + weights[3] * values[from + at[3]];
      }
    }
  }
  return made;
}

/** The four cells around a place at distance `away` from the middle of a cell, and their weights. */
function cubic(away) {
  const t = away < 0 ? away + 1 : away;
  const weights = [
    ((2 - t) * t - 1) * t / 2, ((3 * t - 5) * t * t + 2) / 2, ((4 - 3 * t) * t + 1) * t / 2, (t - 1) * t * t / 2,
  ];
  return { first: away < 0 ? -2 : -1, weights };
}

/** The contour of a grid at `level`, as a path on a canvas, for cells of `across` by `down` from `left`, `top`. */
export function contour({ values, rows, cols }, level, left, top, across, down) {
  const path = new Path2D();
  const crossing = (here, there) => (level - values[here]) / (values[there] - values[here]);
  for (let row = 0; row + 1 < rows; row += 1) {
    for (let col = 0; col + 1 < cols; col += 1) {
      const [a, b] = [row * cols + col, row * cols + col + 1];
      const [c, d] = [b + cols, a + cols]; // a b above, d c below
      const inside = (values[a] > level) + 2 * (values[b] > level) + 4 * (values[c] > level) + 8 * (values[d] > level);
      if (inside === 0 || inside === 15) continue;
      const sides = [];
      if (((inside >> 1) ^ inside) & 1) sides.push([col + crossing(a, b), row]);
      if (((inside >> 2) ^ (inside >> 1)) & 1) sides.push([col + 1, row + crossing(b, c)]);
      if (((inside >> 3) ^ (inside >> 2)) & 1) sides.push([col + crossing(d, c), row + 1]);
      if (((inside >> 3) ^ inside) & 1) sides.push([col, row + crossing(a, d)]);
      for (let end = 0; end + 1 < sides.length; end += 2) {
        path.moveTo(left + (sides[end][0] + 0.5) * across, top + (sides[end][1] + 0.5) * down);
        path.lineTo(left + (sides[end + 1][0] + 0.5) * across, top + (sides[end + 1][1] + 0.5) * down);
      }
    }
  }
  return path;
}
