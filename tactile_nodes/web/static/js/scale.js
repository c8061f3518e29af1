// The full scale of a map where nobody chose one: it grows at once with the largest value, and shrinks when a smaller one
// has been enough for a while, so that a light touch is seen and the colours seldom change their meaning.

export const NEWTONS = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];
export const KILOPASCALS = [1, 10, 100, 1000].flatMap((ten) => [1, 1.5, 2, 3, 4, 6, 8].map((step) => step * ten));
const RESTS_S = 3;

export class Scale {
  constructor(steps) {
    this.steps = steps;
    this.full = steps[0];
    this.neededAt = 0;
  }

  /** Takes in values of a force, at its stamp in s. */
  fit(values, at) {
    const most = values.reduce((least, value) => Math.max(least, Math.abs(value) || 0), 0);
    const enough = this.steps.find((step) => step >= most) ?? this.steps.at(-1);
    const isOver = at < this.neededAt || at > this.neededAt + RESTS_S; // or another stream has begun
    if (enough < this.full && !isOver) return;
    this.full = enough;
    this.neededAt = at;
  }
}
