// The force per bin in newtons, with its colour bar, and the contacts.

import { drawAxes, drawBar, framed, lookOf } from './axes.js';
import { fitted, MARK, stroked } from './canvas.js';
import { colour, ink } from './palette.js';

const SHOWN = 0.005; // N: smaller forces would print as 0.00,
const SHOWN_SHARE = 0.04; // or, on a small scale with a third digit, as noise
const FINE = 0.1; // N: full scale below which a third digit is shown
const BORDER = '#2b2640'; // between bins

/** Draws `bins` [N] of a force as received from the node. */
export function drawMap(canvas, force, bins, fullScale) {
  const { context, width, height } = fitted(canvas);
  const rows = force?.rows ?? 9, cols = force?.cols ?? 9;
  const frame = framed(width, height, cols, rows); // in bins, which are drawn as squares
  const grid = { ...frame, cell: frame.scale, rows, cols };
  const look = lookOf(canvas);
  drawBins(context, grid, bins, fullScale);
  if (force) drawAxes(context, frame, force.bin_mm.map((mm) => frame.scale / mm), force.origin_mm, look);
  if (force) drawContacts(context, grid, force);
  writeBins(context, grid, bins, fullScale, look);
  drawBar(context, frame, fullScale, 'N', (share) => colour(share, 1), look);
}

function drawBins(context, { left, top, cell, rows, cols }, bins, fullScale) {
  context.fillStyle = BORDER;
  context.fillRect(left - 0.5, top - 0.5, cell * cols + 1, cell * rows + 1);
  for (let index = 0; index < rows * cols; index += 1) {
    context.fillStyle = colour(bins.length ? bins[index] : 0, fullScale);
    context.fillRect(left + (index % cols) * cell + 0.5, top + Math.floor(index / cols) * cell + 0.5, cell - 1, cell - 1);
  }
}

function writeBins(context, { left, top, cell, rows, cols }, bins, fullScale, look) {
  const size = Math.min(16, cell * 0.36);
  if (size < 8) return;
  context.font = `600 ${size}px ${look.font}`;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  const least = Math.min(SHOWN, SHOWN_SHARE * fullScale), digits = fullScale <= FINE ? 3 : 2;
  for (let index = 0; index < Math.min(bins.length, rows * cols); index += 1) {
    if (!(Math.abs(bins[index]) >= least)) continue;
    context.fillStyle = ink(bins[index], fullScale);
    const text = bins[index].toFixed(digits).replace(/^(-?)0/, '$1').replace('-', '−');
    context.fillText(text, left + ((index % cols) + 0.5) * cell, top + (Math.floor(index / cols) + 0.5) * cell);
  }
}

function drawContacts(context, { left, top, cell }, force) {
  for (const contact of force.contacts) {
    if (contact.x_mm === null || contact.y_mm === null) continue;
    const x = left + ((contact.x_mm - force.origin_mm[0]) / force.bin_mm[0]) * cell;
    const y = top + ((contact.y_mm - force.origin_mm[1]) / force.bin_mm[1]) * cell;
    const radius = Math.max(0.62 * cell, ((contact.sigma_mm ?? 0) * 1.645 * cell) / force.bin_mm[0]);
    const path = new Path2D();
    path.arc(x, y, radius, 0, 2 * Math.PI);
    for (const [ax, ay] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      path.moveTo(x + ax * radius, y + ay * radius);
      path.lineTo(x + ax * (radius + 7), y + ay * (radius + 7));
    }
    stroked(context, path, 4.5, 2, MARK);
  }
}
