// The status of a force, as a word and a sentence, for the page of one sensor and the page of all sensors.

export const OLD_S = 0.6; // a force older than this is not shown as current
const EARLIER_S = 10; // a node that was silent so long before the data ended is not the cause
const NO_FORCE = 'No force yet: the nodes are starting, or none runs (tactile launch live starts them).';
const WORDS = { ok: 'OK', degraded: 'DEGRADED', invalid: 'INVALID' };

/** A status, its word, and a sentence about it, for data of this age in seconds that came through a link. */
export function statusOf(fields, age, isLive, link) {
  if (!link.open || link.silent) {
    if (link.refusal) return ['nodata', 'NO CONNECTION', link.refusal];
    const since = fields?.force ? `, no data for ${age.toFixed(0)} s` : '';
    return ['nodata', 'NO CONNECTION', `The live view does not respond${since}.${link.open ? '' : ' Reconnecting.'}`];
  }
  if (!fields?.force) return ['waiting', 'WAITING', complaint(fields, age) ?? NO_FORCE];
  if (!isLive) return ['nodata', 'NO DATA', `No data for ${age.toFixed(0)} s. ${complaint(fields, age) ?? ''}`.trim()];
  const touch = fields.force.in_contact ? 'Something touches.' : 'Nothing touches.';
  const { level, text } = fields.slow.calibration ?? {};
  const advice = level === 'ageing' || level === 'invalid' ? [text] : [];
  return [fields.force.status, WORDS[fields.force.status], [...fields.force.reasons, ...advice].join(' ') || touch];
}

/** 'on robot' for a sensor on another machine; '' on this machine. */
export function hostOf(fields) {
  return fields?.slow.host ? ` on ${fields.slow.host}` : '';
}

/** The worst report of a node. One that was silent long before the data ended, such as a recorder, is not the cause. */
function complaint(fields, age) {
  const health = (fields?.slow.health ?? []).filter((entry) => (entry.silent_s ?? 0) < age + EARLIER_S);
  const silent = health.filter((entry) => entry.silent_s !== null).map((entry) => entry.node);
  const of = (level) => health.filter((entry) => entry.level === level).map((entry) => `${entry.node}: ${entry.text}`);
  return of('error')[0] ?? of('warning')[0] ?? (silent.length ? `Silent: ${silent.join(', ')}.` : undefined);
}
