// All sensors of a hand as small tiles; a click on one opens its own page.

import { drawCamera } from './camera.js';
import { Link } from './link.js';
import { drawMap } from './map.js';
import { pictureOf, takeApart } from './packet.js';
import { newtons } from './panels.js';
import { Scales } from './scale.js';
import { OLD_S, hostOf, statusOf } from './status.js';
import { drawSurface, takeCells } from './surface.js';

const GAIN = 50; // of the motion arrows
const $ = (id) => document.getElementById(id);

/** '+0.500'; a number that rounds to zero has no minus sign. */
function signed(value, digits) {
  if (value === null) return '–';
  const size = Math.abs(value).toFixed(digits);
  return `${value < 0 && Number(size) ? '−' : '+'}${size}`;
}

class Tile {
  constructor(name) {
    this.name = name;
    this.place = $('tile').content.cloneNode(true).firstElementChild;
    this.place.href = `/?${new URLSearchParams({ sensor: name })}`;
    this.find('name').textContent = name;
    $('tiles').append(this.place);
    this.fields = null;
    this.at = 0;
    this.scales = new Scales();
    this.link = new Link((buffer) => this.take(buffer), () => this.watch(), name);
  }

  find(part) {
    return this.place.querySelector(`.${part}`);
  }

  async take(buffer) {
    const packet = takeApart(buffer);
    const bitmap = await pictureOf(packet);
    Object.assign(this, { fields: packet.fields, at: performance.now() });
    requestAnimationFrame(() => {
      try {
        this.draw(packet, bitmap);
        this.watch();
      } finally {
        this.link.drawn(); // else one packet that cannot be drawn would be the last
      }
    });
  }

  draw({ fields, bins, cells, motion }, bitmap) {
    if (bitmap) drawCamera(this.find('camera'), bitmap, fields.motion, motion, GAIN);
    bitmap?.close();
    const { force } = fields, { scales } = this;
    const field = fields.surface ? takeCells(fields.surface, cells) : null;
    scales.fit(force, bins, field);
    if (field) drawSurface(this.find('map'), field, force?.contacts ?? [], scales.pressure.full, scales.shear.full);
    else drawMap(this.find('map'), force, bins, scales.bins.full);
  }

  /** Seconds since the capture of the shown force. */
  get age() {
    return this.fields?.force ? this.fields.age_s + (performance.now() - this.at) / 1000 : Infinity;
  }

  get isLive() {
    return this.link.open && this.age < OLD_S;
  }

  watch() {
    if (!this.link) return; // not connected yet
    const [status, word, reason] = statusOf(this.fields, this.age, this.isLive, this.link);
    const trusted = this.isLive && this.fields.force.status !== 'invalid';
    this.place.dataset.status = status;
    this.place.classList.toggle('stale', !this.isLive);
    this.find('host').textContent = hostOf(this.fields);
    this.find('word').textContent = word;
    this.find('reason').textContent = reason;
    this.find('total').textContent = `${newtons(trusted ? this.fields.force.total_n : null)} N`;
  }
}

/** The last sum if it is recent enough, and the missing sensors. */
function showHand(tiles) {
  const live = tiles.filter((tile) => tile.isLive);
  const latest = live.map(({ fields }) => fields).sort((a, b) => (b.hand?.stamp_s ?? 0) - (a.hand?.stamp_s ?? 0))[0];
  const hand = latest?.hand && latest.force.stamp_s - latest.hand.stamp_s < OLD_S ? latest.hand : null;
  const parts = hand?.force_n.map((each, axis) => `${'xyz'[axis]} ${signed(each, 3)}${hand.force_sigma_n ? ` ± ${newtons(hand.force_sigma_n[axis])}` : ''}`);
  $('frame').textContent = hand?.frame ?? 'the hand';
  $('force').textContent = parts?.join('   ') ?? '–';
  $('moment').textContent = hand?.moment_n_mm.map((each, axis) => `${'xyz'[axis]} ${signed(each, 1)}`).join('   ') ?? '–';
  $('slips').textContent = hand?.slips_first ? firstToSlip(hand.slips_first) : '–';
  const missing = tiles.filter((tile) => !tile.isLive || hand?.missing.includes(tile.name)).map(({ name }) => name);
  const summed = missing.length ? `missing: ${missing.join(', ')}` : `all ${tiles.length} sensors`;
  $('missing').textContent = live.length && !hand ? 'no sum: nothing comes on hand_wrench' : summed;
  $('missing').classList.toggle('some', missing.length > 0 || !hand);
}

function firstToSlip({ sensor, margin, sigma }) {
  if (margin === null) return '–';
  return `${sensor}, margin ${margin.toFixed(2)}${sigma === null ? '' : ` ± ${sigma.toFixed(2)}`}`;
}

const { names, left_out: leftOut } = await (await fetch('/sensors')).json();
$('left-out').textContent = leftOut.map((each) => `left out: ${each}`).join('\n');
const tiles = names.map((name) => new Tile(name));
setInterval(() => {
  tiles.forEach((tile) => tile.watch());
  showHand(tiles);
}, 100);
