// The numbers of the page, and the Gaussians at any time.

// The header and the arrays of the page, as it was written by app/features/share/sampling.py.
async function readScene() {
  const header = JSON.parse(document.getElementById("header").textContent);
  const packed = Uint8Array.from(atob(document.getElementById("data").textContent), (letter) => letter.charCodeAt(0));
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(unpacked).arrayBuffer());
  const base = new Float32Array(bytes.buffer, 0, header.gaussians * 3);
  const arrays = {};
  let start = base.byteLength;
  for (const { name, width, times, size, low, high } of header.arrays) {
    const step = width * header.gaussians, count = step * times;
    const values = size === 2 ? new Uint16Array(count) : new Uint8Array(count);
    for (let i = 0; i < count; i++) {
      const change = bytes[start + i] + (size === 2 ? bytes[start + count + i] << 8 : 0);
      values[i] = change + (i >= step ? values[i - step] : 0);  // wraps around, as the differences did
    }
    arrays[name] = { values, step, times, low, unit: (high - low) / (size === 2 ? 65535 : 255) };
    start += count * size;
  }
  return { ...header, base, arrays };
}

// The two sampled times around a frame, and the share of the second.
function between(frames, frame) {
  let after = frames.findIndex((sampled) => sampled >= frame);
  if (after < 0) after = frames.length - 1;
  const before = Math.max(0, after - 1);
  const gap = frames[after] - frames[before];
  return [before, after, gap > 0 ? (frame - frames[before]) / gap : 1];
}

// One array at a frame: a function of the place of a number, interpolated in time.
function at({ values, step, times, low, unit }, [before, after, share]) {
  const first = Math.min(before, times - 1) * step, second = Math.min(after, times - 1) * step;
  return (i) => low + unit * (values[first + i] * (1 - share) + values[second + i] * share);
}

// Fill `state` (Float32Array, 16 numbers a Gaussian: centre, opacity, quaternion, scales, –, colour, –) with the scene at a frame.
function fill(state, scene, frame, shown) {
  const where = between(scene.frames, frame);
  const [means, quats, scales, opacities, colors] = ["means", "quats", "scales", "opacities", "colors"].map((name) => at(scene.arrays[name], where));
  const colour = colouring(scene, where, shown);
  for (let n = 0; n < scene.gaussians; n++) {
    const o = n * 16;
    for (let k = 0; k < 3; k++) {
      state[o + k] = scene.base[n * 3 + k] + means(n * 3 + k);
      state[o + 8 + k] = Math.exp(scales(n * 3 + k));
      state[o + 12 + k] = colors(n * 3 + k);
    }
    state[o + 3] = opacities(n);
    for (let k = 0; k < 4; k++) state[o + 4 + k] = quats(n * 4 + k);
    colour(state, o + 12, n);
  }
}

// A function that changes the colour, at `state[o …]`, of the nth Gaussian to what is to be shown.
function colouring(scene, where, shown) {
  const { high, colours, unknown } = scene.displacement;
  const moved = at(scene.arrays.displacement, where), { values: certain, step: certainties } = scene.arrays.certain;
  const { values: owners, step } = scene.arrays.owners ?? { values: [], step: 0 };
  const time = where[where[2] < 0.5 ? 0 : 1], nearest = time * step;
  const tints = scene.masks.map((mask, k) => (shown.masks && shown.hidden[k] !== true ? mask.colour : null));
  return (state, o, n) => {
    if (shown.displacement) {
      const place = 3 * Math.round(255 * Math.min(1, Math.max(0, moved(n) / high)));
      for (let k = 0; k < 3; k++) state[o + k] = (certain[time * certainties + n] ? colours[place + k] : (colours[place + k] + unknown[k]) / 2) / 255;
    }
    const tint = step > 0 && owners[nearest + n] > 0 ? tints[owners[nearest + n] - 1] : null;
    if (tint) for (let k = 0; k < 3; k++) state[o + k] += (tint[k] / 255 - state[o + k]) * MASK_OPACITY;
  };
}

const MASK_OPACITY = 0.6;

// Indices of the Gaussians, farthest first, into `order` (Uint32Array): a radix sort of the bits of their depths, which are positive floats.
function sortByDepth(order, state, view) {
  const count = order.length, depths = new Float32Array(count), bits = new Uint32Array(depths.buffer);
  for (let n = 0; n < count; n++) {
    const o = n * 16;
    depths[n] = Math.max(0, view[8] * state[o] + view[9] * state[o + 1] + view[10] * state[o + 2] + view[11]);
  }
  let from = Uint32Array.from(order.keys()), to = order.slice();
  for (const shift of [0, 16]) {
    const starts = new Uint32Array(65537);
    for (let n = 0; n < count; n++) starts[65535 - ((bits[n] >>> shift) & 65535) + 1]++;
    for (let bucket = 0; bucket < 65536; bucket++) starts[bucket + 1] += starts[bucket];
    for (let n = 0; n < count; n++) to[starts[65535 - ((bits[from[n]] >>> shift) & 65535)]++] = from[n];
    [from, to] = [to, from];
  }
  order.set(from);
}
