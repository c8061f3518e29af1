// Code of both maps of the surface: their position on the canvas, the axes in mm, and the colour bar.

const LEFT = 34, BOTTOM = 34, TOP = 6, BAR_GAP = 16, BAR = 16, BAR_TEXT = 54;
const BAR_STEPS = 64;

/** Position of a map of cols × rows cells (or mm) on a canvas in pixels; `scale` is pixels per cell (or mm). */
export function framed(width, height, across, down) {
  const room = { across: width - LEFT - BAR_GAP - BAR - BAR_TEXT, down: height - TOP - BOTTOM };
  const scale = Math.max(0.1, Math.min(room.across / across, room.down / down));
  const whole = scale * across + LEFT + BAR_GAP + BAR + BAR_TEXT;
  const left = LEFT + Math.max(0, (width - whole) / 2), top = TOP + Math.max(0, (room.down - scale * down) / 2);
  const end = left + scale * across + BAR_GAP + BAR + BAR_TEXT;
  return { left, top, across: scale * across, down: scale * down, end, scale };
}

/** Fonts and colours of the page, for text on a canvas. */
export function lookOf(canvas) {
  const style = getComputedStyle(canvas);
  return { font: style.fontFamily, dim: style.getPropertyValue('--dim'), line: style.getPropertyValue('--line') };
}

/** Axes in mm along both sides, with a scale in pixels per mm and the coordinates of the top left corner. */
export function drawAxes(context, { left, top, across, down }, [perX, perY], [fromX, fromY], look) {
  context.fillStyle = look.dim;
  context.font = `11.5px ${look.font}`;
  for (const mm of ticks(fromX, fromX + across / perX)) {
    context.textAlign = 'center';
    context.textBaseline = 'top';
    context.fillText(label(mm), left + (mm - fromX) * perX, top + down + 4);
  }
  for (const mm of ticks(fromY, fromY + down / perY)) {
    context.textAlign = 'right';
    context.textBaseline = 'middle';
    context.fillText(label(mm), left - 6, top + (mm - fromY) * perY);
  }
  context.textAlign = 'center';
  context.textBaseline = 'top';
  context.fillText('x [mm]', left + across / 2, top + down + 18);
  context.textAlign = 'right';
  context.fillText('y', left - 8, top);
}

/** Tick positions on an axis. */
export function ticks(from, to) {
  const step = to - from > 24 ? 10 : to - from > 8 ? 5 : 1;
  const found = [];
  for (let mm = Math.ceil(from / step) * step; mm <= to + 1e-9; mm += step) found.push(mm);
  return found;
}

const label = (mm) => `${Object.is(mm, -0) ? 0 : mm}`.replace('-', '−');

/** The colour bar from zero to full scale; `paint` gives the colour of a fraction of it. */
export function drawBar(context, { left, top, across, down }, fullScale, unit, paint, look) {
  const x = left + across + BAR_GAP;
  for (let step = 0; step < BAR_STEPS; step += 1) {
    context.fillStyle = paint((step + 0.5) / BAR_STEPS);
    context.fillRect(x, top + down * (1 - (step + 1) / BAR_STEPS), BAR, down / BAR_STEPS + 1);
  }
  context.strokeStyle = look.line;
  context.lineWidth = 1;
  context.strokeRect(x + 0.5, top + 0.5, BAR - 1, down);
  context.fillStyle = look.dim;
  context.font = `11.5px ${look.font}`;
  context.textAlign = 'left';
  context.textBaseline = 'middle';
  for (const share of [0, 0.2, 0.4, 0.6, 0.8, 1]) {
    const y = Math.min(top + down - 5, Math.max(top + 5, top + down * (1 - share)));
    context.fillText(`${+(share * fullScale).toFixed(3)}${share === 1 ? ` ${unit}` : ''}`, x + BAR + 6, y);
  }
}
