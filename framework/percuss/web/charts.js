// The charts: each is drawn anew, whole, whenever rows, choices, looks or its width change.

const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const CROSS = "path://M-1,-0.7L-0.7,-1L0,-0.3L0.7,-1L1,-0.7L0.3,0L1,0.7L0.7,1L0,0.3L-0.7,1L-1,0.7L-0.3,0Z";
const BAR = "path://M-1,-0.16h2v0.32h-2z";
const STAYED = "share of runs that stayed stable";
const DISTINCT = 40;
const BINS = 24;
const [MAP_DISTINCT, MAP_BINS] = [16, 12];
const ROUND_OFF = 1e-10;
const PAPER_WIDTH = 680;
const MOST_PANELS = 12;
const charts = {};

const varying = columns
  .filter((one) => one.role === "varied" && distinct(one).length > 1)
  .sort((a, b) => (a.kind === "text") - (b.kind === "text")); // numbers first: they make lines
const measures = columns.filter((one) => one.role === "measure");
const sorts = ["case", "integrator", "contact"].map((name) => column[name]).filter((one) => one && one.levels.length > 1);

function distinct(one, rows) {
  if (one.kind === "text") return one.levels.map((_, k) => k);
  const found = new Set(rows ? rows.map((row) => one.values[row]) : one.values);
  return [...found].filter(Number.isFinite).sort((a, b) => a - b);
}

const visible = (rows) => rows.filter((row) => !hidden.has(methodOf[row]));
const whole = () => page.seed !== null && active.length === page.rows;

function quantile(sorted, share) {
  const place = (sorted.length - 1) * share;
  const low = Math.floor(place);
  return sorted[low] + (place - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
}

/** The places on an axis of the values of a column and the place of each row, as one of them; few values are not binned. */
function binned(one, rows, log, most = DISTINCT, bins = BINS) {
  if (one.kind === "text") return { places: distinct(one), labels: one.levels.map((level) => level || "none"), of: (row) => one.codes[row] };
  const values = distinct(one, rows);
  if (values.length <= most) {
    const where = new Map(values.map((value, k) => [value, k]));
    return { places: values, labels: values.map((value) => told(value, 3)), of: (row) => where.get(one.values[row]) ?? -1 };
  }
  const good = log ? values.filter((value) => value > 0) : values;
  const scale = (value) => (log ? Math.log10(value) : value);
  const [low, high] = [scale(good[0]), scale(good[good.length - 1])];
  const middles = Array.from({ length: bins }, (_, k) => low + ((k + 0.5) / bins) * (high - low));
  const places = middles.map((middle) => (log ? 10 ** middle : middle));
  const of = (row) => {
    const value = scale(one.values[row]);
    return Number.isFinite(value) ? Math.min(bins - 1, Math.max(0, Math.floor(((value - low) / (high - low)) * bins))) : -1;
  };
  return { places, labels: places.map((place) => told(place, 2)), of };
}

// ---------------------------------------------------------------------------------------------- axes

/** Ticks of a logarithmic axis between two powers of ten, as powers: decades, or 1 2 5, or round numbers. */
function powersBetween(low, high) {
  const out = [];
  const span = high - low;
  if (span > 0.35) {
    const step = Math.max(1, Math.ceil(span / 7));
    const within = span > 3 ? [1] : span > 1.2 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 7];
    for (let power = Math.floor(low); power <= high; power += 1) {
      if (span > 3 && power % step !== 0) continue;
      out.push(...within.map((factor) => power + Math.log10(factor)));
    }
  } else {
    const [from, to] = [10 ** low, 10 ** high];
    const rough = 10 ** Math.floor(Math.log10((to - from) / 4 || 1e-300));
    const step = [1, 2, 5, 10].map((factor) => factor * rough).find((one) => (to - from) / one <= 6) || to - from;
    for (let k = Math.ceil(from / step); k * step <= to && out.length < 12; k++) out.push(Math.log10(k * step));
  }
  return out.filter((power) => power >= low - 1e-9 && power <= high + 1e-9);
}

function axis(words, extent, { log = false, labels = null, gap = 30, horizontal = false, ticks = null } = {}) {
  const look = looks();
  const [low, high] = extent;
  const room = labels ? 0.5 : (high - low || Math.abs(high) * 0.1 || 1) * 0.05;
  const ends = [low - room, high + room];
  const given = labels ? labels.map((_, k) => k) : ticks || (log ? powersBetween(...ends) : undefined);
  const formatter = labels ? (value) => labels[value] ?? "" : (value) => told(log ? 10 ** value : value, 3);
  const small = { color: look.soft, fontSize: 12 };
  return {
    type: "value", min: ends[0], max: ends[1], name: words, nameLocation: "middle", nameGap: gap,
    nameTextStyle: { color: look.ink, fontSize: 13 }, axisLine: { show: true, onZero: false, lineStyle: { color: look.soft } },
    axisTick: { show: true, customValues: given },
    axisLabel: {
      ...small, formatter, hideOverlap: true, customValues: given, showMinLabel: Boolean(given), showMaxLabel: Boolean(given),
      ...(horizontal && labels ? { width: 110, overflow: "truncate", rotate: labels.join("").length > 44 ? 30 : 0 } : {}),
    },
    splitLine: { show: !labels, lineStyle: { color: look.grid } },
  };
}

function extentOf(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low <= high ? [low, high] : [0, 1];
}

/** After zooming into a logarithmic axis its ticks are set for what is seen. */
function followZoom(chart, logs) {
  chart.off("datazoom");
  chart.on("datazoom", () => {
    const update = {};
    for (const [name, log] of Object.entries(logs)) {
      if (!log) continue;
      const customValues = powersBetween(...chart.getModel().getComponent(name).axis.scale.getExtent());
      update[name] = { axisTick: { customValues }, axisLabel: { customValues } };
    }
    chart.setOption(update);
  });
}

// ---------------------------------------------------------------------------------------------- drawing

function show(id, option, { height = null } = {}) {
  const holder = $(id);
  const renderer = printing ? "svg" : "canvas";
  const old = charts[id];
  if (height !== null) holder.style.height = `${height}px`;
  if (old && old.renderer !== renderer) old.chart.dispose();
  if (!old || old.renderer !== renderer) {
    const size = printing ? { width: PAPER_WIDTH } : {};
    charts[id] = { renderer, chart: echarts.init(holder, null, { renderer, devicePixelRatio: Math.max(2, devicePixelRatio), ...size }) };
    charts[id].chart.on("click", ({ data }) => {
      const row = Array.isArray(data) ? data[2] : data && data.row;
      if (Number.isInteger(row)) pick(row, true);
    });
  }
  const chart = charts[id].chart;
  chart.resize(printing ? { width: PAPER_WIDTH, height: height ?? undefined } : { height: height ?? undefined });
  const textStyle = { color: looks().ink, fontFamily: getComputedStyle(document.body).fontFamily };
  chart.setOption({ animation: false, backgroundColor: "transparent", textStyle, ...option }, { notMerge: true });
  return chart;
}

const coarse = matchMedia("(pointer: coarse)").matches;

function tools(id) {
  if (printing) return { show: false };
  const zoom = coarse ? {} : { dataZoom: { title: { zoom: "zoom into a box", back: "back" }, filterMode: "none" }, restore: { title: "whole" } };
  return {
    right: 4, top: 0, itemSize: 14, iconStyle: { borderColor: looks().soft },
    feature: { ...zoom, saveAsImage: { title: "save as png", name: id, backgroundColor: looks().paper, pixelRatio: 3 } },
  };
}

function say(id, words, { height = null } = {}) {
  show(id, { title: { text: words, left: "center", top: "middle", textStyle: { color: looks().soft, fontSize: 14, fontWeight: "normal", width: $(id).clientWidth - 40, overflow: "break" } } }, { height });
}

const grid = { left: 64, right: 18, top: 30, bottom: 52 };

/** Points of one method, with the row behind the coordinates for clicks. */
function points(k, data, name) {
  const { colour, symbol } = style(k);
  const [many, very] = [data.length > 400, data.length > 1500];
  // small and pale, an open mark would be a white speck
  const mark = many ? symbol.replace("empty", "").toLowerCase() : symbol;
  return {
    type: "scatter", name, data, symbol: mark, symbolSize: very ? 4 : many ? 5 : 8, z: 3, cursor: "pointer",
    itemStyle: { color: colour, borderColor: colour, opacity: very || page.rows > 3000 ? 0.25 : many ? 0.5 : 0.85 }, emphasis: { itemStyle: { opacity: 1, borderWidth: 2 } },
  };
}

function line(k, data, extra = {}) {
  const { colour, dash } = style(k);
  return {
    type: "line", data, symbol: "none", silent: true, z: 4, lineStyle: { color: colour, width: 2, type: dash.length ? dash : "solid" },
    itemStyle: { color: colour }, ...extra,
  };
}

function tipOfRun(row, ...pairs) {
  const lines = [nameOf(row), ...pairs.map(([words, value]) => `${words}: ${told(value)}`)];
  return lines.map(escaped).join("<br>");
}

/** How many runs are not drawn and why, in words. */
function missing(gone, zero) {
  const parts = [];
  if (zero) parts.push(`${zero.toLocaleString("en")} runs at zero (or below 10⁻¹⁰ of the largest) have no place on a logarithmic axis.`);
  if (gone) parts.push(`${gone.toLocaleString("en")} runs lack one of the two values.`);
  return parts.join(" ");
}

/** What is not above this is zero but for round-off. */
const floorOf = (values) => ROUND_OFF * Math.max(0, extentOf(values.filter(Number.isFinite))[1]);

/** Split rows into those with a place on the axes, and counts of the rest. */
function placed(rows, xOf, yOf, logX, logY) {
  let [gone, zero] = [0, 0];
  const data = page.methods.map(() => []);
  const [lowX, lowY] = [logX ? floorOf(rows.map(xOf)) : -Infinity, logY ? floorOf(rows.map(yOf)) : -Infinity];
  for (const row of rows) {
    const [x, y] = [xOf(row), yOf(row)];
    if (!Number.isFinite(x) || !Number.isFinite(y)) gone += 1;
    else if (x <= lowX || y <= lowY) zero += 1;
    else data[methodOf[row]].push([logX ? Math.log10(x) : x, logY ? Math.log10(y) : y, row]);
  }
  return { data, words: missing(gone, zero) };
}

function drawWork() {
  const [y, x] = [column[$("work-y").value], column[$("work-x").value]];
  if (!x || !y) return say("work", "No cost was recorded.");
  const log = $("work-log").checked;
  const { data, words } = placed(visible(active).filter(isDone), (row) => x.values[row], (row) => y.values[row], log, log);
  const stored = whole() && page.fronts[`${y.name}|${x.name}`];
  const fronts = page.methods.map((method, k) => {
    if (hidden.has(k)) return [];
    if (!stored || !stored[method]) return frontOf(data[k]);
    const both = unpacked(stored[method], "<f4");
    const half = both.length / 2;
    return Array.from({ length: half }, (_, j) => [both[j], both[j + half]].map((v) => (log ? Math.log10(v) : v)));
  });
  const all = [...data.flat(), ...fronts.flat()];
  if (!all.length) {
    $("work-note").textContent = words;
    return say("work", "No run with both values passes the filters.");
  }
  const series = page.methods.flatMap((method, k) => [points(k, data[k], method), line(k, fronts[k])]);
  const chart = show("work", {
    grid, toolbox: tools("work-precision"), series,
    xAxis: axis(x.label, extentOf(all.map((one) => one[0])), { log, gap: 30 }),
    yAxis: axis(y.label, extentOf(all.map((one) => one[1])), { log, gap: 48 }),
    tooltip: tooltip(({ data: [, , row] }) => tipOfRun(row, [y.label, y.values[row]], [x.label, x.values[row]])),
  });
  followZoom(chart, { xAxis: log, yAxis: log });
  $("work-note").textContent = `${scope(Boolean(stored), "Lines")} ${words}`;
}

function tooltip(formatter) {
  const look = looks();
  return {
    trigger: "item", confine: true, formatter, backgroundColor: look.paper, borderColor: look.soft, textStyle: { color: look.ink, fontSize: 13 },
    extraCssText: "max-width:330px;white-space:normal;overflow-wrap:anywhere",
  };
}

/** Of a sampled study: whether what is drawn is that of all rows or of the sample. */
function scope(all, what) {
  if (page.seed === null) return "";
  return all ? `Points are the sample, ${what.toLowerCase()} are of all ${page.total.toLocaleString("en")} rows.` : `Points and ${what.toLowerCase()} are of the sample.`;
}

function frontOf(data) {
  const out = [];
  let best = Infinity;
  for (const [x, y] of [...data].sort((a, b) => a[0] - b[0] || a[1] - b[1])) {
    if (y < best) out.push([x, (best = y)]);
  }
  return out;
}

function drawVaried() {
  const [y, x] = [column[$("vary-y").value], column[$("vary-x").value]];
  if (!x || !y) return say("vary", "Nothing was varied.");
  const words = x.kind === "text";
  const wanted = $("vary-log").checked;
  const [logX, logY] = [wanted && !words && Boolean(x.log || x.name === "refine"), wanted && Boolean(y.log)];
  const rows = visible(active).filter(isDone);
  const present = page.methods.map((_, k) => k).filter((k) => !hidden.has(k));
  // methods stand beside each other where the axis holds words
  const beside = (k) => (words ? (0.64 * (present.indexOf(k) - (present.length - 1) / 2)) / Math.max(present.length, 1) : 0);
  const xOf = (row) => (words ? x.codes[row] + beside(methodOf[row]) : x.values[row]);
  const level = words ? [] : levels(x, y, rows, logY);
  const across = rows.filter((row) => !level[methodOf[row]]);
  const { data, words: missed } = placed(across, xOf, (row) => y.values[row], logX, logY);
  const said = level.some(Boolean) ? `A method without this value is a level line at its median. ${missed}` : missed;
  const stored = whole() && page.bands[`${y.name}|${x.name}`];
  const lowest = floorOf(rows.map((row) => y.values[row]));
  const put = ([place, ...values]) => [logX ? Math.log10(place) : place, ...values.map((v) => (logY ? Math.log10(Math.max(v, lowest)) : v))];
  const bands = page.methods.map((method, k) => {
    if (hidden.has(k)) return [];
    const found = stored ? storedBand(stored[method]) : bandOf(x, y, data[k].map((one) => one[2]), logX, beside(k));
    return found.filter(([place, , middle]) => Number.isFinite(middle) && (!logX || place > 0) && (!logY || middle > lowest)).map(put);
  });
  const all = data.flat();
  if (!all.length) {
    $("vary-note").textContent = said;
    return say("vary", "No run with both values passes the filters.");
  }
  const values = words ? [] : distinct(x, rows);
  const ticks = values.length && values.length <= 8 ? values.map((value) => (logX ? Math.log10(value) : value)).filter(Number.isFinite) : null;
  const spread = words ? [0, x.levels.length - 1] : extentOf(all.map((one) => one[0]));
  const flat = (k) => (level[k] ? [line(k, spread.map((place) => [place, level[k][0]]))] : []);
  const series = page.methods.flatMap((method, k) => [points(k, data[k], method), ...bandSeries(k, bands[k], words), ...flat(k)]);
  const chart = show("vary", {
    grid: words ? { ...grid, bottom: 76 } : grid, toolbox: tools("varied"), series,
    xAxis: axis(x.label, spread, { log: logX, labels: words ? x.levels.map((level) => level || "none") : null, gap: words ? 54 : 30, horizontal: true, ticks }),
    yAxis: axis(y.label, extentOf([...all.map((one) => one[1]), ...level.filter(Boolean).flat()]), { log: logY, gap: 48 }),
    tooltip: tooltip(({ data: [, , row] }) => tipOfRun(row, [y.label, y.values[row]])),
  });
  followZoom(chart, { xAxis: logX, yAxis: logY });
  $("vary-note").textContent = `${scope(Boolean(stored), "Medians and bands")} ${said} ${x.name === "refine" && logX && logY ? ordersOf(bands) : ""}`;
}

/** Over the mesh the slope of a line through the medians of each method is its observed order. */
function ordersOf(bands) {
  const orders = bands.map((band, k) => {
    if (band.length < 2) return "";
    const [x, y] = [0, 2].map((place) => band.reduce((sum, one) => sum + one[place], 0) / band.length);
    const slope = band.reduce((sum, one) => sum + (one[0] - x) * (one[2] - y), 0) / band.reduce((sum, one) => sum + (one[0] - x) ** 2, 0);
    return `${page.methods[k]} ${told(-slope, 2)}`;
  });
  const known = orders.filter(Boolean);
  return known.length ? `Observed orders, fitted to the medians: ${known.join("; ")}.` : "";
}

/** The median of each method none of whose runs has the varied value: [median], or nothing. */
function levels(x, y, rows, log) {
  return page.methods.map((_, k) => {
    const own = rows.filter((row) => methodOf[row] === k);
    if (!own.length || own.some((row) => Number.isFinite(x.values[row]))) return null;
    const known = own.map((row) => y.values[row]).filter((v) => Number.isFinite(v) && (!log || v > 0)).sort((a, b) => a - b);
    return known.length ? [log ? Math.log10(quantile(known, 0.5)) : quantile(known, 0.5)] : null;
  });
}

function storedBand(text) {
  if (!text) return [];
  const all = unpacked(text, "<f4");
  const n = all.length / 4;
  return Array.from({ length: n }, (_, j) => [all[j], all[j + n], all[j + 2 * n], all[j + 3 * n]]);
}

function bandOf(x, y, rows, log, offset) {
  const bins = binned(x, rows, log);
  const groups = bins.places.map(() => []);
  for (const row of rows) if (bins.of(row) >= 0) groups[bins.of(row)].push(y.values[row]);
  return groups.flatMap((group, j) => {
    if (!group.length) return [];
    group.sort((a, b) => a - b);
    return [[bins.places[j] + offset, quantile(group, 0.1), quantile(group, 0.5), quantile(group, 0.9)]];
  });
}

function bandSeries(k, band, words) {
  const { colour, symbol } = style(k);
  if (words) {
    // no line joins words: a bar from the tenth to the ninetieth of a hundred, and the median across it
    return band.flatMap(([x, low, middle, high]) => [
      line(k, [[x, low], [x, high]], { lineStyle: { color: colour, width: 3, opacity: 0.5 } }),
      { ...line(k, [[x, middle]]), symbol: "rect", symbolSize: [18, 3] },
    ]);
  }
  const edges = { symbol: "none", lineStyle: { width: 0 }, stackStrategy: "all", stack: `band${k}`, z: 2 };
  const wide = band.some(([, low, , high]) => high > low);
  const area = wide
    ? [
        line(k, band.map(([x, low]) => [x, low]), edges),
        line(k, band.map(([x, low, , high]) => [x, high - low]), { ...edges, areaStyle: { color: colour, opacity: 0.16 } }),
      ]
    : [];
  return [...area, line(k, band.map(([x, , middle]) => [x, middle]), { symbol: band.length > 1 ? "none" : symbol })];
}

// ---------------------------------------------------------------------------------------------- map

const mixed = (share) => {
  const place = Math.min(Math.max(share, 0), 1) * (CIVIDIS.length - 1);
  const low = Math.min(Math.floor(place), CIVIDIS.length - 2);
  const part = (text, k) => parseInt(text.slice(1 + 2 * k, 3 + 2 * k), 16);
  const both = [0, 1, 2].map((k) => Math.round(part(CIVIDIS[low], k) + (place - low) * (part(CIVIDIS[low + 1], k) - part(CIVIDIS[low], k))));
  return `rgb(${both.join(",")})`;
};

function cellsOf(k, rows, x, y, value) {
  const cells = new Map();
  for (const row of rows) {
    if (methodOf[row] !== k) continue;
    const [i, j] = [x.of(row), y.of(row)];
    if (i < 0 || j < 0) continue;
    const key = j * x.places.length + i;
    if (!cells.has(key)) cells.set(key, { i, j, values: [], counts: {}, row });
    const cell = cells.get(key);
    const status = textAt(column.status, row);
    cell.counts[status] = (cell.counts[status] || 0) + 1;
    if (status === "done") {
      if (value && Number.isFinite(value.values[row])) cell.values.push(value.values[row]);
      cell.row = row;
    }
  }
  for (const cell of cells.values()) {
    const { done = 0, unstable = 0 } = cell.counts;
    cell.values.sort((a, b) => a - b);
    cell.value = value ? quantile(cell.values, 0.5) : done / (done + unstable);
  }
  return [...cells.values()];
}

function drawMap() {
  const [x, y] = [column[$("map-x").value], column[$("map-y").value]];
  const value = column[$("map-v").value];
  const rows = visible(active);
  const shown = page.methods.map((_, k) => k).filter((k) => rows.some((row) => methodOf[row] === k)).slice(0, MOST_PANELS);
  if (!x || !y || x === y || !shown.length) {
    $("map-scale").replaceChildren();
    return say("map", x && y && x !== y ? "No run passes the filters." : "A map needs two different varied values.", { height: 120 });
  }
  const stored = whole() ? storedMap(x, y) : null;
  const few = page.seed === null ? [DISTINCT, BINS] : [MAP_DISTINCT, MAP_BINS];
  const bins = stored ? stored.bins : [binned(x, rows, x.log, ...few), binned(y, rows, y.log, ...few)];
  const every = shown.map((k) => ({ k, cells: stored ? stored.cells(k, value) : cellsOf(k, rows, ...bins, value) }));
  const panels = every.filter(({ cells }) => cells.length);
  if (!panels.length) return say("map", "No run has both values.", { height: 120 });
  const log = Boolean(value && value.log);
  const known = panels.flatMap(({ cells }) => cells.map((cell) => cell.value)).filter((v) => Number.isFinite(v) && (!log || v > 0));
  const ends = value ? extentOf(known) : [0, 1];
  const scale = (v) => (log ? Math.log10(v) : v);
  const share = (v) => (ends[1] > ends[0] ? (scale(Math.max(v, ends[0])) - scale(ends[0])) / (scale(ends[1]) - scale(ends[0])) : 0.5);
  const words = value ? `median ${value.label}` : STAYED;
  drawMapPanels(panels, x, y, bins, share, words);
  drawScale(words, known.length ? ends : null, panels, bins[0].places.length * bins[1].places.length);
  const bare = every.filter(({ cells }) => !cells.length).map(({ k }) => page.methods[k]);
  const lacking = bare.length ? `Without these two values, and not on the map: ${bare.join(", ")}. ` : "";
  const left = shown.length === MOST_PANELS && page.methods.length > MOST_PANELS ? `The first ${MOST_PANELS} methods are shown. ` : "";
  $("map-note").textContent = lacking + left + (page.seed === null ? "" : stored ? `The map is of all ${page.total.toLocaleString("en")} rows.` : "The map is of the sample.");
}

/** Of a sampled study the map of all its rows over two varied values, whichever of them lies across. */
function storedMap(x, y) {
  const turned = !page.maps[`${x.name}|${y.name}`];
  const found = page.maps[turned ? `${y.name}|${x.name}` : `${x.name}|${y.name}`];
  if (!found) return null;
  const places = [unpacked(found.across, "<f4"), unpacked(found.up, "<f4")];
  const bins = places.map((one) => ({ places: [...one], labels: Array.from(one, (place) => told(place, 2)) }));
  const cells = (k, value) => {
    const method = found.methods[page.methods[k]];
    const [done, unstable, other] = [method.done, method.unstable, method.other].map((text) => unpacked(text, "<f4"));
    const medians = value && method[value.name] ? unpacked(method[value.name], "<f4") : null;
    return Array.from(done, (_, at) => at).flatMap((at) => {
      const counts = { done: done[at], unstable: unstable[at], "refused or failed": other[at] };
      for (const [kind, many] of Object.entries(counts)) if (!many) delete counts[kind];
      if (!Object.keys(counts).length) return [];
      const [i, j] = [at % places[0].length, Math.floor(at / places[0].length)];
      const share = done[at] / (done[at] + unstable[at]);
      return [{ i: turned ? j : i, j: turned ? i : j, counts, value: value ? (medians ? medians[at] : NaN) : share }];
    });
  };
  return { bins: turned ? bins.reverse() : bins, cells };
}

function drawMapPanels(panels, x, y, bins, share, words) {
  const look = looks();
  const width = printing ? PAPER_WIDTH : $("map").clientWidth;
  const across = Math.max(1, Math.min(panels.length, 4, Math.floor(width / 290)));
  const [left, right, top, bottom, high] = [64, 14, 46, 62, 330];
  const tall = Math.ceil(panels.length / across) * high;
  const each = width / across;
  const [inside, up] = [Math.min(each - left - right, 520), high - top - bottom];
  const size = [inside / bins[0].places.length, up / bins[1].places.length];
  const option = { grid: [], xAxis: [], yAxis: [], series: [], title: [] };
  panels.forEach(({ k, cells }, n) => {
    const [gx, gy] = [(n % across) * each + left, Math.floor(n / across) * high + top];
    option.grid.push({ left: gx, top: gy, width: inside, height: up });
    option.title.push({
      text: page.methods[k].replace(" + ", "\n+ "), left: gx - 4, top: gy - 42,
      textStyle: { color: look.ink, fontSize: 13, lineHeight: 16, fontWeight: "bold", width: inside, overflow: "truncate" },
    });
    const category = { type: "category", axisTick: { show: false }, axisLine: { lineStyle: { color: look.soft } }, splitLine: { show: false }, nameLocation: "middle", nameTextStyle: { color: look.ink, fontSize: 12 } };
    const label = { color: look.soft, fontSize: 11, hideOverlap: true, width: 90, overflow: "truncate" };
    option.xAxis.push({ ...category, gridIndex: n, data: bins[0].labels, name: x.label, nameGap: 34, axisLabel: label });
    option.yAxis.push({ ...category, gridIndex: n, data: bins[1].labels, name: n % across ? "" : y.label, nameGap: 48, axisLabel: { ...label, width: 44 } });
    option.series.push(...mapSeries(cells, n, size, share, look));
  });
  const tell = ({ data: { cell } }) => {
    const counts = Object.entries(cell.counts).map(([status, many]) => `${many} ${status}`).join(", ");
    const value = Number.isFinite(cell.value) ? [`${words}: ${told(cell.value)}`] : [];
    return [`${x.label}: ${bins[0].labels[cell.i]}`, `${y.label}: ${bins[1].labels[cell.j]}`, ...value, counts].map(escaped).join("<br>");
  };
  show("map", { ...option, tooltip: tooltip(tell), toolbox: { show: false } }, { height: tall });
}

function mapSeries(cells, n, [wide, high], share, look) {
  const at = (cell) => ({ value: [cell.i, cell.j], row: cell.row, cell });
  const shared = { type: "scatter", xAxisIndex: n, yAxisIndex: n, cursor: "pointer" };
  const filled = cells.filter((cell) => Number.isFinite(cell.value));
  const small = Math.max(5, 0.5 * Math.min(wide, high, 30));
  const cross = cells.filter((cell) => cell.counts.unstable);
  const bar = cells.filter((cell) => !cell.counts.done && !cell.counts.unstable);
  return [
    {
      ...shared, symbol: "rect", symbolSize: [Math.max(wide - 1, 1), Math.max(high - 1, 1)], z: 2,
      data: filled.map((cell) => ({ ...at(cell), itemStyle: { color: mixed(share(cell.value)), opacity: 1 } })),
    },
    {
      ...shared, symbol: CROSS, symbolSize: small, z: 3,
      data: cross.map((cell) => ({
        ...at(cell),
        itemStyle: Number.isFinite(cell.value) ? { color: "#ffffff", borderColor: "#000000", borderWidth: 0.7, opacity: 1 } : { color: look.alarm, opacity: 1 },
      })),
    },
    { ...shared, symbol: BAR, symbolSize: [small, small / 4], z: 3, itemStyle: { color: look.soft }, data: bar.map(at) },
  ];
}

function drawScale(words, ends, panels, filled) {
  const made = [element("span", words)];
  if (ends) {
    const ramp = element("span", "", { class: "ramp" });
    ramp.style.background = `linear-gradient(90deg, ${CIVIDIS.join(",")})`;
    const range = element("span");
    range.append(told(ends[0], 3), ramp, told(ends[1], 3));
    made.push(range);
  }
  const cells = panels.flatMap((panel) => panel.cells);
  const entry = (mark, text) => {
    const both = element("span");
    both.append(element("b", mark), ` ${text}`);
    return both;
  };
  if (cells.some((cell) => cell.counts.unstable)) made.push(entry("✕", "unstable, at least one run"));
  if (cells.some((cell) => !cell.counts.done && !cell.counts.unstable)) made.push(entry("–", "refused or failed"));
  if (panels.some((panel) => panel.cells.length < filled)) made.push(element("span", "blank: no run"));
  $("map-scale").replaceChildren(...made);
}

// ---------------------------------------------------------------------------------------------- forces

function pick(row, from = false) {
  const at = picked.indexOf(row);
  if (at >= 0 && !from) picked.splice(at, 1);
  else if (at < 0) picked.push(row);
  if (picked.length > MOST_PICKED) reformat(picked.shift());
  reformat(row);
  drawForce();
  if (from) $("force").closest("figure").scrollIntoView({ behavior: "smooth", block: "nearest" });
}

function reformat(row) {
  const found = table.getRow(row);
  if (found) found.reformat();
}

function pairs([time, force]) {
  const [x, y] = [unpacked(time, "<f4"), unpacked(force, "<f4")];
  return Array.from(x, (t, k) => [t, y[k]]);
}

function drawForce() {
  if (!Object.keys(page.histories).length) {
    $("force-note").textContent = "This study kept no histories.";
    for (const id of ["force", "force-legend", "unpick"]) $(id).hidden = true;
    return;
  }
  const [series, entries] = [[], []];
  const exact = new Set();
  const bare = picked.filter((row) => !page.histories[row]);
  picked.forEach((row, n) => {
    const history = page.histories[row];
    if (!history) return;
    const { colour, dash } = style(n);
    const words = nameOf(row) + (isDone(row) ? "" : ` (${textAt(column.status, row)})`);
    const what = textAt(column.case, row);
    if (history.exact.length && !exact.has(what)) {
      exact.add(what);
      const look = { color: looks().exact, width: 5 };
      series.push(...history.exact.map((one) => ({ type: "line", name: `exact, ${what}`, data: pairs(one), symbol: "none", z: 1, lineStyle: look, itemStyle: { color: look.color } })));
      entries.push([{ colour: look.color, dash: [], width: 5 }, `exact, ${what}`]);
    }
    history.force.forEach((one, contact) => {
      const name = history.force.length > 1 ? `${words}, ${history.contacts[contact] ?? `contact ${contact + 1}`}` : words;
      series.push({
        type: "line", name, data: pairs(one), symbol: "none", z: 3, itemStyle: { color: colour },
        lineStyle: { color: colour, width: contact ? 1 : 2, type: dash.length ? dash : "solid" },
      });
    });
    entries.push([{ colour, dash }, words]);
  });
  $("force-legend").replaceChildren(
    ...entries.map(([look, words]) => {
      const entry = element("span", "", { class: "entry" });
      entry.append(swatch(look), element("span", words));
      return entry;
    }),
  );
  $("force-note").textContent = forceNote(bare);
  if (!series.length) return say("force", bare.length ? "No history of this run is in the page." : "No run is chosen.", { height: 90 });
  const all = series.flatMap((one) => one.data);
  show("force", {
    grid: { left: 74, right: 18, top: 30, bottom: 48 }, toolbox: tools("force"), series,
    xAxis: axis("time", extentOf(all.map((one) => one[0])), { gap: 28 }),
    yAxis: { ...axis("contact force", boundOf(series), { gap: 56 }) },
    tooltip: { ...tooltip(tipOfTime), trigger: "axis" },
  }, { height: 340 });
}

/** Keep what the exact force tells, or the runs that are done, from being flattened by a run that ran away. */
function boundOf(series) {
  const sound = series.filter((one) => !one.name.includes("(unstable)"));
  return extentOf((sound.length ? sound : series).flatMap((one) => one.data.map((pair) => pair[1])));
}

function tipOfTime(items) {
  const lines = items.slice(0, 8).map(({ seriesName, data }) => `${escaped(seriesName)}: <b>${escaped(told(data[1]))}</b>`);
  return [`time ${escaped(told(items[0].axisValue))}`, ...lines].join("<br>");
}

function forceNote(bare) {
  const kept = Object.keys(page.histories).length;
  if (!bare.length) return `The page has the histories of ${kept} runs; it begins with the least force error of each method, and shows ${MOST_PICKED} at most.`;
  const keys = column.key ? ` (${bare.map((row) => textAt(column.key, row)).join(", ")})` : "";
  return `No history in the page of ${bare.length === 1 ? "one chosen run" : `${bare.length} chosen runs`}${keys}; it has those of ${kept} runs.`;
}

/** The run of least error of each method in one case, so that something is seen before anything is chosen. */
function pickFirst() {
  const rows = Object.keys(page.histories).map(Number);
  const error = column.force_error_l1;
  const best = new Map();
  for (const row of rows) {
    const method = methodOf[row];
    if (!isDone(row) || column.case.codes[row] !== column.case.codes[rows[0]]) continue;
    if (!best.has(method) || (error && error.values[row] < error.values[best.get(method)])) best.set(method, row);
  }
  picked.push(...[...best.values()].slice(0, 4));
}

// ---------------------------------------------------------------------------------------------- the whole

function drawStudy() {
  drawWork();
  drawVaried();
  drawMap();
}

function fill(id, choices, chosen) {
  const known = choices.filter(Boolean);
  $(id).replaceChildren(...known.map(([value, words]) => element("option", words, { value })));
  const wanted = known.find(([value]) => value === chosen) || known[0];
  if (wanted) $(id).value = wanted[0];
  $(id).addEventListener("change", drawStudy);
}

function start() {
  const named = (ones) => ones.map((one) => [one.name, one.label]);
  const results = measures.filter((one) => !page.costs.includes(one.name));
  fill("work-y", named(results), "force_error_l1");
  fill("work-x", page.costs.map((name) => [name, column[name].label]), "seconds");
  fill("vary-y", named(measures), "force_error_l1");
  fill("vary-x", named([...varying, ...sorts]));
  const places = named([...varying, ...sorts.filter((one) => one.name === "case")]);
  fill("map-v", [...named(measures), ["", STAYED]], "force_error_l1");
  fill("map-x", places);
  fill("map-y", places, (places[1] || [""])[0]);
  $("map").closest("figure").hidden = places.length < 2;
  for (const id of ["work-log", "vary-log"]) $(id).addEventListener("change", drawStudy);
  $("unpick").addEventListener("click", () => {
    for (const row of picked.splice(0)) reformat(row);
    drawForce();
  });
  drawFilters();
  pickFirst();
  redraw();
}

function redraw() {
  drawLegend();
  drawStudy();
  drawForce();
}

let folded = [];

function toPaper(on) {
  if (on === printing) return;
  printing = on;
  if (on) {
    folded = [...document.querySelectorAll("details:not([open])")];
    drawPrinted();
  }
  for (const one of folded) one.open = on;
  redraw();
}

addEventListener("beforeprint", () => toPaper(true));
addEventListener("afterprint", () => toPaper(false));
prefersDark.addEventListener("change", redraw);

let waiting = 0;
let width = document.body.clientWidth;
addEventListener("resize", () => {
  if (printing || document.body.clientWidth === width) return; // a phone's bars come and go
  width = document.body.clientWidth;
  clearTimeout(waiting);
  waiting = setTimeout(redraw, 120);
});
start();
