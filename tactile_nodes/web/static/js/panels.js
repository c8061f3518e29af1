// Numbers, words and tables. Each has a fixed place from the start, so that the layout does not move.

const $ = (id) => document.getElementById(id);
const CONTACTS = 4;
const FRAME_MS = 1000 / 60; // full length of the latency bars: one frame at 60 Hz
const NONE = '–';

/** 0.730, 12.34, −0.004: as many digits as fit, without a negative zero. */
export function newtons(force) {
  if (force === null || force === undefined || !Number.isFinite(force)) return NONE;
  const text = force.toFixed(Math.abs(force) < 9.9995 ? 3 : 2);
  return Number(text) === 0 ? text.replace('-', '') : text.replace('-', '−');
}

const fixed = (value, digits) => (value === null || value === undefined ? NONE : value.toFixed(digits).replace(/^-(?=[0.]*$)/, '').replace('-', '−'));

function say(id, text) {
  const place = $(id);
  if (place.textContent !== text) place.textContent = text;
}

function element(tag, text, className) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}

/** Status as word and reason; `stale` dims outdated values. */
export function showStatus(status, word, reason, stale) {
  document.body.dataset.status = status;
  document.body.classList.toggle('stale', stale);
  say('status', word);
  say('reason', reason);
  $('reason').title = reason;
}

/** Total, its standard deviation, and the truth if it is known. */
export function showTotal(force, truth, isLive, age) {
  const trusted = isLive && force !== null && force.status !== 'invalid';
  say('total', trusted ? newtons(force.total_n) : NONE);
  if (!isLive && force) {
    say('sigma', `last ${newtons(force.total_n)} N, ${age.toFixed(0)} s ago`);
    say('truth', ' ');
    return;
  }
  say('sigma', trusted && force.sigma_n !== null ? `± ${newtons(force.sigma_n)} N` : ' ');
  say('truth', trusted && truth ? `true ${newtons(truth.total_n)} N` : ' ');
}

/** The highest pressure of a field, or the largest bin, and whether it is above the colour scale. */
export function showMap(force, field, isLive, fullScale) {
  const trusted = isLive && force !== null && force.status !== 'invalid';
  const most = field ? field.pressure.reduce((high, each) => Math.max(high, each || 0), 0) : force?.peak_n;
  say('map-title', field ? 'Pressure and shear' : 'Force on each bin');
  say('peak-word', field ? 'highest' : 'largest');
  say('peak', !trusted ? NONE : field ? most.toPrecision(3) : newtons(most));
  say('peak-unit', field ? 'kPa' : 'N');
  $('peak').classList.toggle('over', trusted && most > fullScale);
  $('scale').hidden = Boolean(field);
  $('pressure-scale').hidden = !field;
}

/** Net shear with direction, torsion, and how the motion was explained; empty if the model does not estimate shear. */
export function showNet(net, isLive) {
  const known = isLive && net ? net : null;
  $('net').hidden = !known?.explanation && (known?.shear_n ?? null) === null;
  if ($('net').hidden) return;
  say('shear', withSigma(newtons(known.shear_n), newtons(known.shear_sigma_n), 'N'));
  $('shear-way').hidden = !(known.shear_n > 2 * (known.shear_sigma_n ?? 0));
  $('shear-way').style.transform = `rotate(${(known.direction_deg ?? 0).toFixed(0)}deg)`;
  say('torsion', withSigma(fixed(known.torsion_n_mm, 1), fixed(known.torsion_sigma_n_mm, 1), 'N mm'));
  say('explanation', known.explanation || NONE);
}

const withSigma = (value, sigma, unit) => (value === NONE ? NONE : `${value}${sigma === NONE ? '' : ` ± ${sigma}`} ${unit}`);

/** The strongest contacts, strongest first. */
export function showContacts(force, isLive) {
  const known = isLive && force.status !== 'invalid';
  const found = known ? force.contacts : [];
  $('contacts').parentElement.classList.toggle('sheared', found.some((each) => each.shear_n[0] !== null));
  const nothing = known ? 'nothing touches' : NONE;
  const rows = Array.from({ length: CONTACTS }, (_, index) => contactRow(index, found[index], found.length || index ? ' ' : nothing));
  $('contacts').replaceChildren(...rows);
}

function contactRow(index, contact, otherwise) {
  const row = element('tr');
  if (!contact) {
    row.append(element('td', otherwise, 'none'), ...Array.from({ length: 4 }, (_, cell) => element('td', '', cell > 1 ? 'more' : '')));
    return row;
  }
  const place = element('td', `${fixed(contact.x_mm, 2)}, ${fixed(contact.y_mm, 2)}`);
  const force = element('td', newtons(contact.force_n));
  if (contact.sigma_mm !== null) place.append(element('i', ` ± ${fixed(contact.sigma_mm, 2)}`));
  if (contact.sigma_n !== null) force.append(element('i', ` ± ${newtons(contact.sigma_n)}`));
  const shear = contact.shear_n[0] === null ? NONE : newtons(Math.hypot(...contact.shear_n));
  const more = [shear, fixed(contact.torsion_n_mm, 2)].map((text) => element('td', text, 'more'));
  row.append(element('td', `${index + 1}`), place, force, ...more);
  return row;
}

/** Rates, latencies, nodes, model: values that are updated twice a second. */
export function showSlow(slow, updates, isLive) {
  const namespace = slow.namespace === '/' ? '' : slow.namespace;
  say('namespace', namespace ? ` ${namespace}` : '');
  document.title = `Live view ${namespace || '– tactile_nodes'}`;
  say('fps', isLive ? fixed(slow.rates.arriving_hz, 1) : NONE);
  say('updates', `${updates}`);
  const { lost, skipped, malformed } = slow.rates;
  const damaged = malformed ? `, ${malformed} malformed` : '';
  say('losses', `${lost} lost in transit, ${skipped} skipped by the sender${damaged}`);
  showStages(slow.latency_ms);
  showProvenance(slow.provenance, slow.calibration);
  showNodes(slow.health, slow.logs, slow.recording);
}

function showStages(stages) {
  const rows = stages.map(([stage, median, most]) => {
    const row = element('tr');
    const bar = element('span', undefined, 'bar');
    for (const [name, value] of [['p99', most], ['p50', median]]) {
      const part = element('span', undefined, name);
      part.style.transform = `scaleX(${Math.min(1, (value ?? 0) / FRAME_MS)})`;
      bar.append(part);
    }
    const cell = element('td');
    cell.append(bar);
    row.append(element('td', stage), cell, element('td', fixed(median, 2)), element('td', fixed(most, 2)));
    return row;
  });
  $('stages').replaceChildren(...rows);
}

function showProvenance(known, calibration) {
  const entries = [
    ['model', known.model && `${known.model} (${known.model_id})`],
    ['gel', known.gel],
    ['calibration', calibrated(known, calibration), calibration?.level, calibration?.text],
    ['rest image', known.reference_id],
  ];
  if (known.tare_id) entries.push(['tare', known.tare_id]);
  $('provenance').replaceChildren(...entries.map(([name, text, className, title]) => {
    const pair = element('div');
    pair.append(element('dt', name), element('dd', text || NONE, className));
    pair.title = title ?? '';
    return pair;
  }));
}

/** Id and validity of the calibration; a model that is its own calibration has no id. */
function calibrated(known, state) {
  const label = [known.calibration_id, state?.level].filter(Boolean).join(', ');
  return label || (known.model ? 'none' : '');
}

/** Each node, and the last warning; the recorder's text on its bag is already below its button. */
function showNodes(health, logs, recording) {
  const isOfBag = (text) => Boolean(recording?.bag) && text.includes(recording.text);
  $('nodes').replaceChildren(...health.map((entry) => {
    const row = element('li');
    const level = entry.silent_s !== null ? 'stale' : entry.level;
    const text = entry.silent_s !== null ? `silent for ${entry.silent_s.toFixed(0)} s` : entry.text || entry.level;
    row.append(element('span', undefined, `lamp ${level}`), element('span', entry.node.split('/').at(-1)));
    if (level !== 'ok') row.append(element('span', isOfBag(text) ? 'see the bag, on the right' : text));
    row.title = `${entry.node}, ${level}: ${text}`;
    return row;
  }));
  const last = element('li', logs.findLast((text) => !isOfBag(text)) ?? 'none');
  last.title = logs.join('\n');
  $('logs').replaceChildren(last);
}
