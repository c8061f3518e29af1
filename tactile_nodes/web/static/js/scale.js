// The automatic full scale of a map. It grows at once with the largest value, and shrinks when a smaller scale
// has been enough for a while, so that a light touch is visible and the colours rarely change their meaning.

const NEWTONS = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];
const KILOPASCALS = [1, 10, 100, 1000].flatMap((ten) => [1, 1.5, 2, 3, 4, 6, 8].map((step) => step * ten));
const RESTS_S = 3;

class Scale {
  constructor(steps) {
    this.steps = steps;
    this.full = steps[0];
    this.neededAt = 0;
  }

  /** Adapts the scale to the values of a force, at its stamp in s. */
  fit(values, at) {
    const most = values.reduce((least, value) => Math.max(least, Math.abs(value) || 0), 0);
    const enough = this.steps.find((step) => step >= most) ?? this.steps.at(-1);
    const isOver = at < this.neededAt || at > this.neededAt + RESTS_S; // or a new stream has started
    if (enough < this.full && !isOver) return;
    this.full = enough;
    this.neededAt = at;
  }
}

/** The scales of all drawings of a sensor: force per bin, and pressure and shear if there is a force field. */
export class Scales {
  bins = new Scale(NEWTONS);
  pressure = new Scale(KILOPASCALS);
  shear = new Scale(KILOPASCALS);

  /** Adapts the scales to a force, unless it is invalid. */
  fit(force, bins, field) {
    if (!force || force.status === 'invalid') return;
    this.bins.fit(bins, force.stamp_s);
    if (!field) return;
    this.pressure.fit(field.pressure, force.stamp_s);
    this.shear.fit(field.arrows.found.map(({ dx, dy }) => Math.hypot(dx, dy)), force.stamp_s);
  }
}
