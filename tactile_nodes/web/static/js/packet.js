// Decodes packets (tactile_nodes/web/packet.py describes the format).

const SAMPLE_BYTES = 16;

/** JSON, sections and samples of a binary message. */
export function takeApart(buffer) {
  const view = new DataView(buffer);
  const length = view.getUint32(0, true);
  const fields = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let place = 4 + length;
  const sections = {};
  for (const [name, size] of fields.sections) {
    sections[name] = buffer.slice(place, place + size);
    place += size;
  }
  return {
    fields,
    bins: new Float32Array(sections.bins),
    cells: new Float32Array(sections.surface),
    motion: new Float32Array(sections.motion),
    jpeg: sections.image,
    samples: samplesFrom(view, place),
  };
}

/** [stamp in s, total in N, true total in N] of each frame; NaN if unknown. */
function samplesFrom(view, start) {
  const found = [];
  for (let place = start; place + SAMPLE_BYTES <= view.byteLength; place += SAMPLE_BYTES) {
    found.push([view.getFloat64(place, true), view.getFloat32(place + 8, true), view.getFloat32(place + 12, true)]);
  }
  return found;
}

/** The decoded picture of a packet; null if it has none, or if it cannot be decoded. */
export async function pictureOf({ fields, jpeg }) {
  if (!fields.image || !jpeg.byteLength) return null;
  try {
    return await createImageBitmap(new Blob([jpeg], { type: 'image/jpeg' }));
  } catch {
    return null; // the page then reports, after a while, that there is no image
  }
}
