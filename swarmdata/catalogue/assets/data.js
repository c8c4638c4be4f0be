// Loads data files, which are scripts that call `episodes`, `chunk` or `images`, and unpacks them.
"use strict";
(() => {
  const tables = new Map(); // key of a dataset -> promise of its table
  const files = new Map(); // path of a data file -> promise of its numbers
  const waiting = new Map(); // path -> what to call with the content

  function loadScript(path) {
    return new Promise((resolve, reject) => {
      waiting.set(path, resolve);
      const script = document.createElement("script");
      script.src = swarmdata.page.root + "data/" + path;
      script.onerror = () => reject(new Error(`The file data/${path} of this catalogue is missing.`));
      document.head.append(script);
    });
  }

  const arrived = (path, content) => {
    const resolve = waiting.get(path);
    waiting.delete(path);
    if (resolve) resolve(content);
  };
  swarmdata.episodes = (key, table) => {
    // JSON has no NaN: returns that are not finite arrive as null
    const { episodes } = table;
    if (episodes.return) episodes.return = episodes.return.map((value) => (value === null ? NaN : value));
    arrived(`${key}/episodes.js`, table);
  };
  swarmdata.measured = (key, text) => arrived(`${key}/measured.js`, text);
  swarmdata.chunk = (key, number, text) => arrived(`${key}/${number}.js`, text);
  swarmdata.images = (key, number, text) => arrived(`${key}/images-${number}.js`, text);

  // Base64 of the gzip of low bytes, then high bytes, of zigzag codes: see replays/packing.py.
  async function unpack(text) {
    if (!window.DecompressionStream) {
      throw new Error("This browser cannot decompress data: it needs Chrome 80, Firefox 113 or Safari 16.4.");
    }
    const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    const half = bytes.length / 2;
    const values = new Int16Array(half);
    for (let k = 0; k < half; k++) {
      const code = bytes[k] | (bytes[half + k] << 8);
      values[k] = (code >>> 1) ^ -(code & 1);
    }
    return values;
  }

  // Turns differences back into values, column by column, in place; 16 bits wrap.
  function accumulate(values, rows, columns, order) {
    for (let pass = 0; pass < order; pass++) {
      for (let c = 0; c < columns; c++) {
        let sum = 0;
        for (let k = c * rows; k < (c + 1) * rows; k++) {
          sum += values[k];
          values[k] = sum;
          sum = values[k];
        }
      }
    }
    return values;
  }

  function numbers(path) {
    if (!files.has(path)) files.set(path, loadScript(path).then(unpack));
    return files.get(path);
  }

  function table(key) {
    if (!tables.has(key)) tables.set(key, loadScript(`${key}/episodes.js`).then((found) => complete(key, found)));
    return tables.get(key);
  }

  // The table of a result has its columns in a file of their own: see replays/measured_files.py.
  async function complete(key, found) {
    if (!found.measured) return found;
    const codes = await numbers(`${key}/measured.js`);
    const { episodes, n } = found;
    found.measured.forEach(([name, unit], c) => {
      episodes[name] = Array.from(codes.subarray(c * n, (c + 1) * n), (code) => code * unit);
    });
    if (episodes.time) episodes.time = episodes.time.map((time) => (time < 0 ? NaN : time));
    const perRun = n / episodes.policies.length;
    episodes.index = episodes.number.map((number, k) => episodes.policy[k] * perRun + number);
    episodes.length = episodes.number.map((_, k) => found.lengths[k] || 0); // known of replays
    episodes.end = episodes.end || new Array(n).fill(1);
    episodes.split = new Array(n).fill(0);
    episodes.seed = new Array(n).fill(null);
    return found;
  }

  const countColumns = (groups) => groups.reduce((sum, group) => sum + group[1], 0);

  // The arrays of one episode, by its position in the table: values[column * rows + row].
  async function arrays(key, position) {
    const found = await table(key);
    const starts = found.chunks;
    let chunk = starts.length - 1;
    while (starts[chunk] > position) chunk--;
    const values = await numbers(`${key}/${chunk}.js`);
    const nMoving = found.world ? countColumns(found.moving) : found.series.low.length;
    const nFixed = found.world ? countColumns(found.fixed) : 0;
    let first = 0;
    for (let k = starts[chunk]; k < position; k++) {
      first += (found.episodes.length[k] + 1) * nMoving + nFixed;
    }
    const rows = found.episodes.length[position] + 1;
    const end = first + rows * nMoving;
    return {
      rows,
      moving: accumulate(values.slice(first, end), rows, nMoving, 2),
      fixed: accumulate(values.slice(end, end + nFixed), 1, nFixed, 2),
    };
  }

  // Pixels of an episode's images: values[column * rows + row], a column for each pixel's color.
  async function pixels(key, position, rows) {
    const values = await numbers(`${key}/images-${position}.js`);
    return accumulate(values.slice(), rows, values.length / rows, 1);
  }

  swarmdata.data = { table, arrays, pixels };
})();
