// The force field: pressure as a smooth map, shear as arrows, and the outlines of contacts.

import { drawAxes, drawBar, framed, lookOf, ticks } from './axes.js';
import { addArrow, fitted, HALO, MARK, stroked } from './canvas.js';
import { colour, colourPixels } from './palette.js';
import { contour, finer } from './smooth.js';

const FINE = 180; // pixels of the map along its longer side, which the canvas then enlarges
const OUTLINE_FINER = 3;
const ARROWS = 18; // at most, along each side
const LONGEST = 1.3; // length of a full-scale arrow, in distances between arrows
const LEAST = 0.06; // of the full scale: shorter arrows would only be noise
const SIDE = 4; // numbers per cell

const BESIDE = 20; // px
const GRID = 'rgba(255, 255, 255, 0.09)';

const drawn = document.createElement('canvas');

/** The numbers of a packet's cells, and mean shear over blocks with x and y of their middles in mm. */
export function takeCells(shape, cells) {
  const count = shape.rows * shape.cols;
  const part = (number) => Float32Array.from({ length: count }, (_, cell) => cells[SIDE * cell + number]);
  const [pressure, alongX, alongY, outline] = [part(0), part(1), part(2), part(3)];
  return { ...shape, pressure, outline, arrows: blockMeans(shape, alongX, alongY) };
}

function blockMeans({ rows, cols, cell_mm: [width, height], origin_mm: [fromX, fromY] }, alongX, alongY) {
  const size = Math.ceil(Math.max(rows, cols) / ARROWS);
  const found = [];
  for (let row = 0; row < rows; row += size) {
    for (let col = 0; col < cols; col += size) {
      const [down, right] = [Math.min(rows, row + size), Math.min(cols, col + size)];
      let x = 0, y = 0;
      for (let r = row; r < down; r += 1) {
        for (let c = col; c < right; c += 1) {
          x += alongX[r * cols + c] || 0;
          y += alongY[r * cols + c] || 0;
        }
      }
      const cells = (down - row) * (right - col);
      found.push({ x: fromX + ((col + right) / 2) * width, y: fromY + ((row + down) / 2) * height, dx: x / cells, dy: y / cells });
    }
  }
  return { spacing: size * width, found };
}

/** Draws a field, with full scales in kPa, and the contacts of its force. */
export function drawSurface(canvas, field, contacts, pressureScale, shearScale) {
  const { context, width, height } = fitted(canvas);
  const { rows, cols, cell_mm: [cellX, cellY], origin_mm: origin } = field;
  const frame = framed(width, height, cols * cellX, rows * cellY);
  const look = lookOf(canvas);
  context.save();
  context.beginPath();
  context.rect(frame.left, frame.top, frame.across, frame.down);
  context.clip();
  drawPressure(context, field, frame, pressureScale);
  drawGrid(context, frame, origin);
  drawOutlines(context, field, frame);
  drawShear(context, field.arrows, frame, origin, shearScale);
  drawPlaces(context, contacts, frame, origin, look);
  context.restore();
  drawAxes(context, frame, [frame.scale, frame.scale], origin, look);
  drawBar(context, frame, pressureScale, 'kPa', (share) => colour(share, 1), look);
  drawLegend(context, frame, field.arrows.spacing * frame.scale * LONGEST, shearScale, look);
}

function drawPressure(context, { pressure, rows, cols }, frame, fullScale) {
  const fine = finer(pressure, rows, cols, Math.max(1, Math.round(FINE / Math.max(rows, cols))));
  [drawn.width, drawn.height] = [fine.cols, fine.rows];
  const onto = drawn.getContext('2d');
  const image = onto.createImageData(fine.cols, fine.rows);
  colourPixels(fine.values, fullScale, new Uint32Array(image.data.buffer));
  onto.putImageData(image, 0, 0);
  context.imageSmoothingEnabled = true;
  context.imageSmoothingQuality = 'high';
  context.drawImage(drawn, frame.left, frame.top, frame.across, frame.down);
}

function drawGrid(context, { left, top, across, down, scale }, [fromX, fromY]) {
  context.fillStyle = GRID;
  for (const mm of ticks(fromX, fromX + across / scale)) context.fillRect(Math.round(left + (mm - fromX) * scale), top, 1, down);
  for (const mm of ticks(fromY, fromY + down / scale)) context.fillRect(left, Math.round(top + (mm - fromY) * scale), across, 1);
}

function drawOutlines(context, { outline, rows, cols }, { left, top, across, down }) {
  const fine = finer(outline, rows, cols, OUTLINE_FINER);
  stroked(context, contour(fine, 1, left, top, across / fine.cols, down / fine.rows), 3.2, 1.4, MARK);
}

function drawShear(context, { spacing, found }, { left, top, scale }, [fromX, fromY], fullScale) {
  const path = new Path2D();
  const long = (spacing * scale * LONGEST) / fullScale;
  for (const { x, y, dx, dy } of found) {
    if (!(Math.hypot(dx, dy) >= LEAST * fullScale)) continue;
    const [right, down] = [dx * long, dy * long];
    addArrow(path, left + (x - fromX) * scale - right / 2, top + (y - fromY) * scale - down / 2, right, down);
  }
  stroked(context, path, 4.2, 2, '#ffffff');
}

/** The numbers of the contacts, as in the table, beside their centres; a single contact has none. */
function drawPlaces(context, contacts, { left, top, scale }, [fromX, fromY], look) {
  context.font = `650 13px ${look.font}`;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  contacts.forEach((contact, index) => {
    if (contact.x_mm === null || contact.y_mm === null || contacts.length < 2) return;
    const x = left + (contact.x_mm - fromX) * scale + BESIDE, y = top + (contact.y_mm - fromY) * scale - BESIDE;
    context.beginPath();
    context.arc(x, y, 8, 0, 2 * Math.PI);
    context.fillStyle = HALO;
    context.fill();
    context.fillStyle = MARK;
    context.fillText(`${index + 1}`, x, y + 0.5);
  });
}

/** An arrow of full-scale length, below the colour bar. */
function drawLegend(context, { top, down, end }, long, fullScale, look) {
  const y = top + down + 25;
  context.fillStyle = look.dim;
  context.font = `11.5px ${look.font}`;
  context.textBaseline = 'middle';
  context.textAlign = 'right';
  context.fillText(`shear ${fullScale} kPa`, end - long - 6, y);
  const path = new Path2D();
  addArrow(path, end - long, y, long, 0);
  context.lineWidth = 2;
  context.strokeStyle = look.dim;
  context.stroke(path);
}
