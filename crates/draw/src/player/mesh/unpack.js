
// Meshes as the page carries them: the counterpart of packed.rs, which says how they are written.

async function inflate(text) {
  const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function unpackFaces(bytes) {
  const n = bytes.length / 4, faces = new Uint32Array(n);
  for (let i = 0, last = 0; i < n; i++) {
    const z = bytes[i] | bytes[n + i] << 8 | bytes[2 * n + i] << 16 | bytes[3 * n + i] << 24;
    last += z >>> 1 ^ -(z & 1);
    faces[i] = last;
  }
  return faces;
}

/** The neighbors of each vertex that have smaller numbers: those of v are all[starts[v]] to all[starts[v + 1] - 1]. */
function lowerNeighbors(faces, count) {
  const starts = new Uint32Array(count + 1), edges = visit => {
    for (let i = 0; i < faces.length; i++) {
      const a = faces[i], b = faces[i % 3 === 2 ? i - 2 : i + 1];
      if (a !== b) visit(Math.max(a, b), Math.min(a, b));
    }
  };
  edges(high => starts[high + 1]++);
  for (let v = 0; v < count; v++) starts[v + 1] += starts[v];
  const next = starts.slice(), all = new Uint32Array(starts[count]);
  edges((high, low) => { all[next[high]++] = low; });
  return [starts, all];
}

/** Coordinates in steps from the origin of their frame, frames x vertices x 3. */
function unpackPlaces(bytes, count, frames, faces) {
  const [starts, all] = lowerNeighbors(faces, count), size = 3 * count;
  const places = new Uint16Array(frames * size), errors = new Int16Array(count);
  for (let t = 0; t < frames; t++) for (let axis = 0; axis < 3; axis++) {
    const from = 2 * (3 * t + axis) * count, to = t * size + axis;
    for (let v = 0; v < count; v++) {
      const z = bytes[from + v] | bytes[from + count + v] << 8;
      let mean = 0, first = starts[v], n = starts[v + 1] - first;
      for (let i = first; i < first + n; i++) mean += errors[all[i]];
      if (n) mean = Math.floor(mean / n);
      else if (v) mean = errors[v - 1];
      errors[v] = (z >>> 1 ^ -(z & 1)) + mean;
      const at = to + 3 * v, one = t > 0 ? places[at - size] : 0, two = t > 1 ? places[at - 2 * size] : one;
      places[at] = 2 * one - two + errors[v];
    }
  }
  return places;
}

async function unpack(source) {
  const faces = unpackFaces(await inflate(source.faces));
  const places = unpackPlaces(await inflate(source.places), source.vertices, source.frames, faces);
  return { ...source, faces, places, note: "", shown: true, loaded: -1 };
}
