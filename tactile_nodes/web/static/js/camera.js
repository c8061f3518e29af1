// The camera image with the motion of each region as an arrow, both of the same frame.

import { addArrow, fitted, MARK, stroked } from './canvas.js';

const LEAST_PX = 0.05; // of motion: shorter arrows would only be noise
const LEAST_CONFIDENCE = 0.15;

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
  stroked(context, path, 4, 1.8, MARK);
  return longest;
}
