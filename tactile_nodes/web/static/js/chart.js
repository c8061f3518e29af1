// The total force over the last half minute, drawn by uPlot; its scale grows in steps, so that it rarely changes.

const SECONDS = 30;
const KEPT = 60;
const GAP = 0.5; // s: a longer pause is drawn as a gap
const STEPS = [0.1, 0.2, 0.5, 1, 1.5, 2, 3, 5, 7.5, 10, 15, 20, 30, 50, 100];

export class Chart {
  constructor(place) {
    this.place = place;
    this.columns = [[], [], []];
    this.hasTruth = false;
    this.build();
    new ResizeObserver(() => this.plot.setSize(this.size())).observe(place);
    matchMedia('(prefers-color-scheme: light)').addEventListener('change', () => { this.plot.destroy(); this.build(); });
  }

  /** Add [stamp in s, total, true total] of each new frame. */
  add(samples) {
    const [stamps, totals, truths] = this.columns;
    for (const [stamp, total, truth] of samples) {
      const last = stamps.at(-1);
      if (last !== undefined && stamp < last) {
        if (stamp > last - 1) continue; // received twice
        this.columns.forEach((column) => { column.length = 0; }); // a new stream has started
      } else if (last !== undefined && stamp - last > GAP) {
        stamps.push(last + GAP / 2);
        totals.push(null);
        truths.push(null);
      } else if (stamp === last) {
        continue;
      }
      stamps.push(stamp);
      totals.push(Number.isFinite(total) ? total : null);
      truths.push(Number.isFinite(truth) ? truth : null);
      this.hasTruth ||= Number.isFinite(truth);
    }
    this.forget();
  }

  forget() {
    const [stamps] = this.columns;
    const old = stamps.findIndex((stamp) => stamp > stamps.at(-1) - KEPT);
    if (old > 600) this.columns.forEach((column) => column.splice(0, old));
  }

  draw() {
    const [stamps] = this.columns;
    if (!stamps.length) return;
    const now = stamps.at(-1);
    const start = stamps.findIndex((stamp) => stamp >= now - SECONDS - 1);
    this.plot.setData(this.columns.map((column) => column.slice(Math.max(0, start))), false);
    this.plot.batch(() => {
      this.plot.setScale('x', { min: now - SECONDS, max: now });
      this.plot.setScale('y', this.range());
    });
  }

  range() {
    let least = 0, most = 0;
    for (const column of this.plot.data.slice(1)) {
      for (const force of column) {
        if (force === null) continue;
        if (force > most) most = force;
        if (force < least) least = force;
      }
    }
    const top = STEPS.find((step) => step >= most * 1.04) ?? most * 1.1;
    return { min: least < -0.04 * top ? least * 1.2 : -0.04 * top, max: top };
  }

  size() {
    return { width: Math.max(100, this.place.clientWidth), height: Math.max(80, this.place.clientHeight) };
  }

  build() {
    const style = getComputedStyle(document.documentElement);
    const paint = (name) => style.getPropertyValue(name).trim();
    const axis = {
      stroke: paint('--dim'), font: `12px ${getComputedStyle(document.body).fontFamily}`,
      grid: { stroke: paint('--line'), width: 1 }, ticks: { show: false },
    };
    const clock = (stamp) => new Date(stamp * 1000).toLocaleTimeString('en-GB');
    this.plot = new uPlot({
      ...this.size(),
      pxAlign: 0,
      legend: { show: false },
      cursor: { show: false },
      scales: { x: { time: true, auto: false }, y: { auto: false, range: (_, min, max) => [min, max] } },
      axes: [
        { ...axis, size: 26, space: 90, values: (_, splits) => splits.map(clock) },
        { ...axis, size: 46, space: 24, values: (_, splits) => splits.map((force) => `${+force.toFixed(3)}`.replace('-', '−')) },
      ],
      series: [
        {},
        { stroke: paint('--sensed'), width: 2.2, points: { show: false } },
        { stroke: paint('--true'), width: 1.5, dash: [6, 5], points: { show: false } },
      ],
    }, this.columns, this.place);
  }
}
