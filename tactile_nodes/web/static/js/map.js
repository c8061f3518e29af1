// The force on each bin in newtons, with the bar of its colours, and the contacts.

import { fitted } from './canvas.js';
import { colour, ink } from './palette.js';

const LEFT = 34, BOTTOM = 34, TOP = 6, BAR_GAP = 16, BAR = 16, BAR_TEXT = 40;
const SHOWN = 0.005; // N: smaller forces would read 0.00,
const SHOWN_SHARE = 0.04; // or, on a small scale with its third digit, be noise
const FINE = 0.1; // N: a full scale of which the third digit counts
const BAR_STEPS = 64;
const BORDER = '#2b2640'; // between bins

/** Draws `bins` [N] of a force as the node tells it. */
export function drawMap(canvas, force, bins, fullScale) {
  const { context, width, height } = fitted(canvas);
  const rows = force?.rows ?? 9, cols = force?.cols ?? 9;
  const room = { across: width - LEFT - BAR_GAP - BAR - BAR_TEXT, down: height - TOP - BOTTOM };
  const cell = Math.max(1, Math.min(room.across / cols, room.down / rows));
  const whole = cell * cols + LEFT + BAR_GAP + BAR + BAR_TEXT;
  const frame = { left: LEFT + Math.max(0, (width - whole) / 2), top: TOP + Math.max(0, (room.down - cell * rows) / 2), cell, rows, cols };
  const style = getComputedStyle(canvas);
  const look = { font: style.fontFamily, dim: style.getPropertyValue('--dim'), line: style.getPropertyValue('--line') };
  drawBins(context, frame, bins, fullScale);
  if (force) drawAxes(context, frame, force, look);
  if (force) drawContacts(context, frame, force);
  writeBins(context, frame, bins, fullScale, look);
  drawBar(context, { left: frame.left + cell * cols + BAR_GAP, top: frame.top, down: cell * rows }, fullScale, look);
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

function drawAxes(context, { left, top, cell, rows, cols }, force, look) {
  const [binX, binY] = force.bin_mm, [fromX, fromY] = force.origin_mm;
  context.fillStyle = look.dim;
  context.font = `11.5px ${look.font}`;
  for (const mm of ticks(fromX, fromX + cols * binX)) {
    context.textAlign = 'center';
    context.textBaseline = 'top';
    context.fillText(label(mm), left + ((mm - fromX) / binX) * cell, top + rows * cell + 4);
  }
  for (const mm of ticks(fromY, fromY + rows * binY)) {
    context.textAlign = 'right';
    context.textBaseline = 'middle';
    context.fillText(label(mm), left - 6, top + ((mm - fromY) / binY) * cell);
  }
  context.textAlign = 'center';
  context.textBaseline = 'top';
  context.fillText('x [mm]', left + (cols * cell) / 2, top + rows * cell + 18);
  context.textAlign = 'right';
  context.fillText('y', left - 8, top);
}

function ticks(from, to) {
  const step = to - from > 24 ? 10 : to - from > 8 ? 5 : 1;
  const found = [];
  for (let mm = Math.ceil(from / step) * step; mm <= to + 1e-9; mm += step) found.push(mm);
  return found;
}

const label = (mm) => `${Object.is(mm, -0) ? 0 : mm}`.replace('-', '−');

function drawContacts(context, { left, top, cell }, force) {
  for (const contact of force.contacts) {
    if (contact.x_mm === null || contact.y_mm === null) continue;
    const x = left + ((contact.x_mm - force.origin_mm[0]) / force.bin_mm[0]) * cell;
    const y = top + ((contact.y_mm - force.origin_mm[1]) / force.bin_mm[1]) * cell;
    const radius = Math.max(0.62 * cell, ((contact.sigma_mm ?? 0) * 1.645 * cell) / force.bin_mm[0]);
    for (const [line, strength] of [[4.5, 'rgba(0, 0, 0, 0.6)'], [2, '#5be0ff']]) {
      context.lineWidth = line;
      context.strokeStyle = strength;
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      for (const [ax, ay] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        context.moveTo(x + ax * radius, y + ay * radius);
        context.lineTo(x + ax * (radius + 7), y + ay * (radius + 7));
      }
      context.stroke();
    }
  }
}

function drawBar(context, { left, top, down }, fullScale, look) {
  for (let step = 0; step < BAR_STEPS; step += 1) {
    const y = top + down * (1 - (step + 1) / BAR_STEPS);
    context.fillStyle = colour(((step + 0.5) / BAR_STEPS) * fullScale, fullScale);
    context.fillRect(left, y, BAR, down / BAR_STEPS + 1);
  }
  context.strokeStyle = look.line;
  context.lineWidth = 1;
  context.strokeRect(left + 0.5, top + 0.5, BAR - 1, down);
  context.fillStyle = look.dim;
  context.font = `11.5px ${look.font}`;
  context.textAlign = 'left';
  context.textBaseline = 'middle';
  for (const share of [0, 0.2, 0.4, 0.6, 0.8, 1]) {
    const y = Math.min(top + down - 5, Math.max(top + 5, top + down * (1 - share)));
    context.fillText(`${+(share * fullScale).toFixed(3)}${share === 1 ? ' N' : ''}`, left + BAR + 6, y);
  }
}
