// The full scale of the map where nobody chose one: it grows at once with the largest bin, and shrinks when a smaller one
// has been enough for a while, so that a light touch is seen and the colours seldom change their meaning.

const STEPS = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100]; // N
const RESTS_S = 3;

export class Scale {
  constructor() {
    this.full = STEPS[0];
    this.neededAt = 0;
  }

  /** Takes in the bins of a force, at its stamp in s. */
  fit(bins, at) {
    const most = bins.reduce((least, force) => Math.max(least, Math.abs(force) || 0), 0);
    const enough = STEPS.find((step) => step >= most) ?? STEPS.at(-1);
    const isOver = at < this.neededAt || at > this.neededAt + RESTS_S; // or another stream has begun
    if (enough < this.full && !isOver) return;
    this.full = enough;
    this.neededAt = at;
  }
}
