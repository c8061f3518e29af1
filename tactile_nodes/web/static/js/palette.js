// Colours of the force map: "inferno" of matplotlib (S. van der Walt and N. Smith, CC0), which is perceptually uniform and
// readable with colour blindness. 64 steps, six hexadecimal digits each.
const INFERNO =
  '00000402010a04031207051b0b072410092d150b371b0c41210c4a280b532f0a5b3609613d0965440a684a0c6b510e6c' +
  '59106e5f136e65156e6c186e721a6e781c6d7f1e6c85216b8c23699225689827669f2a63a52c60ab2f5eb1325ab73557' +
  'bf3952c43c4eca404acf4446d44842d94d3dde5238e25734e65d2fea632aed6925f06f20f3761bf57d15f78410f98b0b' +
  'fa9407fb9b06fca309fcaa0ffcb216fbba1ffac228f9c932f7d13df5d949f4e156f2e865f1ef75f3f586f6fa96fcffa4';
const STEPS = INFERNO.length / 6;
const COLOURS = Array.from({ length: STEPS }, (_, step) => `#${INFERNO.slice(6 * step, 6 * step + 6)}`);
const SMOOTH = Uint32Array.from({ length: 4 * STEPS }, (_, place) => between((place / (4 * STEPS - 1)) * (STEPS - 1)));
const LAST = SMOOTH.length - 1;
// Negative (pulling) force, which a gel under a probe cannot measure: the estimate is wrong there.
const BELOW = ['#0b1d3a', '#123a6b', '#1c5a9e', '#3f86cf'];
const NOT_FINITE = '#c026d3';
const FAINT = 0.02; // of the full scale: below, noise would make the map flicker

/** The colour at a step or between two, as the bytes red, green, blue and opacity. */
function between(place) {
  const low = Math.min(STEPS - 2, Math.floor(place));
  const channels = [1, 3, 5].map((at) => {
    const [from, to] = [low, low + 1].map((step) => parseInt(COLOURS[step].slice(at, at + 2), 16));
    return Math.round(from + (place - low) * (to - from));
  });
  return new Uint32Array(Uint8Array.of(...channels, 255).buffer)[0];
}

/** The colour of a force on a scale from 0 to `fullScale`, both in newtons. */
export function colour(force, fullScale) {
  if (!Number.isFinite(force)) return NOT_FINITE;
  const share = force / fullScale;
  if (share < -FAINT) return BELOW[Math.min(BELOW.length - 1, Math.floor(-share * BELOW.length))];
  return COLOURS[Math.max(0, Math.min(STEPS - 1, Math.floor(share * STEPS)))];
}

/** The same for many values at once, without steps: each value is a pixel of an ImageData. */
export function colourPixels(values, fullScale, pixels) {
  for (let index = 0; index < values.length; index += 1) {
    const share = values[index] / fullScale;
    pixels[index] = SMOOTH[share > 0 ? Math.min(LAST, Math.round(share * LAST)) : 0];
  }
}

/** A text colour that is readable on `colour(force, fullScale)`. */
export function ink(force, fullScale) {
  return force / fullScale > 0.62 ? '#140b2a' : '#ffffff';
}

