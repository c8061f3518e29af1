// The page: receives packets, draws the newest at the refresh rate of the screen, and never shows old values as new.

import { drawCamera } from './camera.js';
import { Chart } from './chart.js';
import { Controls } from './controls.js';
import { Link } from './link.js';
import { drawMap } from './map.js';
import { pictureOf, takeApart } from './packet.js';
import { showContacts, showMap, showNet, showSlow, showStatus, showTotal } from './panels.js';
import { Scales } from './scale.js';
import { OLD_S, hostOf, statusOf } from './status.js';
import { drawSurface, takeCells } from './surface.js';

const $ = (id) => document.getElementById(id);

const page = {
  number: 0, fields: null, at: 0, bins: new Float32Array(), motion: new Float32Array(), field: null,
  bitmap: null, imageStamp: 0, imageAt: 0, shown: [], slow: '',
};
let taken = 0;
const scales = new Scales();
const chart = new Chart($('chart'));
const sensor = new URLSearchParams(location.search).get('sensor');
const link = new Link(take, () => watch(), sensor);
$('all').hidden = sensor === null;
const controls = new Controls(link);

async function take(buffer) {
  const packet = takeApart(buffer);
  const number = (taken += 1);
  chart.add(packet.samples);
  const isNew = packet.fields.image?.stamp_s !== page.imageStamp;
  const bitmap = isNew ? await pictureOf(packet) : null;
  if (number > page.number) show(packet, bitmap, number); // picture and numbers of the same frame, or neither
  requestAnimationFrame(() => {
    try {
      draw();
    } finally {
      link.drawn(); // else one packet that cannot be drawn would be the last
    }
  });
}

function show(packet, bitmap, number) {
  Object.assign(page, { number, fields: packet.fields, bins: packet.bins, motion: packet.motion, at: performance.now() });
  page.field = packet.fields.surface ? takeCells(packet.fields.surface, packet.cells) : null;
  scales.fit(packet.fields.force, page.bins, page.field);
  if (!bitmap) return;
  page.bitmap?.close();
  Object.assign(page, { bitmap, imageStamp: packet.fields.image.stamp_s, imageAt: page.at });
}

/** Force of the brightest colour (N). */
function fullScale() {
  return Number($('scale').value) || scales.bins.full;
}

/** Pressure of the brightest colour (kPa), if there is a force field. */
function pressureScale() {
  return Number($('pressure-scale').value) || scales.pressure.full;
}

/** The force field if there is one, else the force per bin. */
function drawForce({ force }) {
  if (page.field) drawSurface($('map'), page.field, force?.contacts ?? [], pressureScale(), scales.shear.full);
  else drawMap($('map'), force, page.bins, fullScale());
}

function draw() {
  const { fields } = page;
  page.shown.push(performance.now());
  page.shown = page.shown.filter((at) => at > performance.now() - 2000);
  const longest = drawCamera($('camera'), page.bitmap, fields.motion, page.motion, Number($('gain').value));
  $('longest').textContent = Number.isFinite(longest) ? longest.toFixed(1) : '–';
  drawForce(fields);
  chart.draw();
  $('true-key').hidden = !chart.hasTruth;
  const isLive = watch();
  const slow = JSON.stringify(fields.slow);
  $('host').textContent = hostOf(fields);
  if (slow !== page.slow) showSlow(fields.slow, Math.round(page.shown.length / 2), isLive);
  page.slow = slow;
}

/** Update the age of the shown data, even if nothing arrives any more; returns whether the force is still current. */
function watch() {
  const { fields } = page;
  const since = (performance.now() - page.at) / 1000;
  const age = fields?.force ? fields.age_s + since : Infinity;
  const isLive = link.open && age < OLD_S;
  showStatus(...statusOf(fields, age, isLive, link), !isLive);
  showTotal(fields?.force ?? null, fields?.truth ?? null, isLive, age);
  showNet(fields?.force?.net ?? null, isLive);
  showMap(fields?.force ?? null, page.field, isLive, page.field ? pressureScale() : fullScale());
  showContacts(fields?.force ?? null, isLive);
  controls.show(fields?.slow, link.open);
  document.body.classList.toggle('cut', !link.open);
  if (!isLive) $('fps').textContent = '–';
  const imageAge = page.imageAt ? (performance.now() - page.imageAt) / 1000 : Infinity;
  const veil = $('camera-veil');
  veil.hidden = imageAge < 1.5;
  veil.textContent = page.imageAt ? `no image for ${imageAge.toFixed(0)} s` : 'no image yet';
  return isLive;
}

/** The last choice, if the browser lets a page store it. */
function remembered(id) {
  try {
    return localStorage.getItem(`tactile.${id}`);
  } catch {
    return null;
  }
}

function remember(id, value) {
  try {
    localStorage.setItem(`tactile.${id}`, value);
  } catch {
    // then the choice is not stored
  }
}

for (const id of ['gain', 'scale', 'pressure-scale']) {
  const kept = remembered(id);
  if ([...$(id).options].some((option) => option.value === kept)) $(id).value = kept;
  $(id).addEventListener('change', () => {
    remember(id, $(id).value);
    if (page.fields) draw();
  });
}
setInterval(watch, 250);
showContacts(null, false);
drawMap($('map'), null, page.bins, fullScale());
window.addEventListener('resize', () => page.fields && draw());
