// The camera image with the motion of each region as an arrow, both of the same instant.

import { fitted } from './canvas.js';

const LEAST_PX = 0.05; // of motion: shorter arrows would only be noise
const LEAST_CONFIDENCE = 0.15;
const HEAD = 0.38;

/** Draws; returns the longest motion in pixels of the image. */
export function drawCamera(canvas, bitmap, motion, arrows, gain) {
  const { context, width, height } = fitted(canvas);
  if (!bitmap) return NaN;
  const scale = Math.min(width / bitmap.width, height / bitmap.height);
  const [across, down] = [bitmap.width * scale, bitmap.height * scale];
  const [left, top] = [(width - across) / 2, (height - down) / 2];
  context.save();
  context.beginPath();
  context.roundRect(left, top, across, down, 6);
  context.clip();
  context.drawImage(bitmap, left, top, across, down);
  const longest = motion ? drawArrows(context, motion, arrows, gain, { left, top, across, down }) : NaN;
  context.restore();
  return longest;
}

function drawArrows(context, motion, arrows, gain, frame) {
  const [perPx, perPy] = [frame.across / motion.width_px, frame.down / motion.height_px];
  const [stepX, stepY] = [frame.across / motion.cols, frame.down / motion.rows];
  const path = new Path2D();
  let longest = 0;
  for (let index = 0; index < motion.rows * motion.cols; index += 1) {
    const [dx, dy, confidence] = [arrows[3 * index], arrows[3 * index + 1], arrows[3 * index + 2]];
    if (!(confidence >= LEAST_CONFIDENCE)) continue;
    const length = Math.hypot(dx, dy);
    longest = Math.max(longest, length);
    const x = frame.left + ((index % motion.cols) + 0.5) * stepX;
    const y = frame.top + (Math.floor(index / motion.cols) + 0.5) * stepY;
    addArrow(path, x, y, length >= LEAST_PX ? dx * gain * perPx : 0, length >= LEAST_PX ? dy * gain * perPy : 0);
  }
  context.lineCap = context.lineJoin = 'round';
  context.lineWidth = 4;
  context.strokeStyle = 'rgba(0, 0, 0, 0.55)';
  context.stroke(path);
  context.lineWidth = 1.8;
  context.strokeStyle = '#5be0ff';
  context.stroke(path);
  return longest;
}

function addArrow(path, x, y, dx, dy) {
  path.moveTo(x, y);
  path.lineTo(x + dx, y + dy);
  const length = Math.hypot(dx, dy);
  if (length < 2) return;
  const reach = Math.min(7, length * HEAD) / length;
  for (const side of [0.6, -0.6]) {
    path.moveTo(x + dx, y + dy);
    path.lineTo(x + dx - reach * (dx - side * dy), y + dy - reach * (dy + side * dx));
  }
}
