// Shared drawing code: a canvas in screen resolution, and lines and arrows that are visible on any background.

export const MARK = '#5be0ff';
export const HALO = 'rgba(0, 0, 0, 0.6)';
const HEAD = 0.38; // of an arrow's length

/** The context of a canvas in screen pixels, scaled to CSS pixels, and its size in CSS pixels. */
export function fitted(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const ratio = window.devicePixelRatio || 1;
  const [across, down] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== across || canvas.height !== down) {
    canvas.width = across;
    canvas.height = down;
  }
  const context = canvas.getContext('2d');
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** A path as a line with a dark rim. */
export function stroked(context, path, rim, line, paint) {
  context.lineCap = context.lineJoin = 'round';
  for (const [width, style] of [[rim, HALO], [line, paint]]) {
    context.lineWidth = width;
    context.strokeStyle = style;
    context.stroke(path);
  }
}

/** Add an arrow from (x, y) to (x + dx, y + dy), in pixels. */
export function addArrow(path, x, y, dx, dy) {
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
