// The charts: each is drawn anew, whole, whenever rows, choices, looks or its width change.

const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const CROSS = "path://M-1,-0.7L-0.7,-1L0,-0.3L0.7,-1L1,-0.7L0.3,0L1,0.7L0.7,1L0,0.3L-0.7,1L-1,0.7L-0.3,0Z";
const BAR = "path://M-1,-0.16h2v0.32h-2z";
const PAPER_WIDTH = 680;
const MOST_PANELS = 12;
const LOG_BOXES = ["work-logx", "work-logy", "vary-logx", "vary-logy"];
const charts = {};

const visible = (rows) => rows.filter((row) => !hidden.has(methodOf[row]));
const whole = () => page.seed !== null && active.length === page.rows;

function quantile(sorted, share) {
  const place = (sorted.length - 1) * share;
  const low = Math.floor(place);
  return sorted[low] + (place - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
}

const labelsOf = (side, bins) => (side.kind === "text" ? side.levels.map((level) => level || "none") : bins.places.map((place) => numberText(place, 3)));

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
    const step = [1, 2, 5, 10].map((factor) => factor * rough).find((width) => (to - from) / width <= 6) || to - from;
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
  const formatter = labels ? (value) => labels[value] ?? "" : (value) => numberText(log ? 10 ** value : value, 3);
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

let near = 300; // pixels: a chart is painted once it is no farther from what is seen of the page
const unpainted = new Map(); // what each chart is to show next
const watcher = new IntersectionObserver(
  (entries) => entries.filter(({ isIntersecting }) => isIntersecting).forEach(({ target }) => paint(target.id)),
  { rootMargin: `${near}px` },
);
for (const holder of document.querySelectorAll(".chart")) watcher.observe(holder);

function isNear(holder) {
  const { top, bottom } = holder.getBoundingClientRect();
  return top <= innerHeight + near && bottom >= -near;
}

/** Give a chart what it is to show: it is painted at once only where it is seen, as that takes most of the time. */
function show(id, option, { height = null, then = null } = {}) {
  const holder = $(id);
  if (height !== null) holder.style.height = `${height}px`;
  unpainted.set(id, { option, height, then });
  if (printing || isNear(holder)) paint(id);
}

function paint(id) {
  if (!unpainted.has(id)) return;
  const { option, height, then } = unpainted.get(id);
  unpainted.delete(id);
  const holder = $(id);
  const renderer = printing ? "svg" : "canvas";
  const old = charts[id];
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
  if (then) then(chart);
}

const coarse = matchMedia("(pointer: coarse)").matches;

function tools(id, zooms = true) {
  if (printing) return { show: false };
  const zoom = coarse || !zooms ? {} : { dataZoom: { title: { zoom: "zoom into a box", back: "back" }, filterMode: "none" }, restore: { title: "whole" } };
  return {
    right: 4, top: 0, itemSize: 14, iconStyle: { borderColor: looks().soft },
    feature: { ...zoom, saveAsImage: { title: "save as png", name: id, backgroundColor: looks().paper, pixelRatio: 3 } },
  };
}

function say(id, words, { height = null } = {}) {
  show(id, { title: { text: words, left: "center", top: "middle", textStyle: { color: looks().soft, fontSize: 14, fontWeight: "normal", width: $(id).clientWidth - 40, overflow: "break" } } }, { height });
}

const grid = { left: 64, right: 18, top: 30, bottom: 52 };

/** The mark of a method as ECharts names it; small and pale among many, an open mark would be a white speck. */
function symbolOf(k, filled = false) {
  const { shape, open } = style(k);
  const name = SHAPES[shape];
  return open && !filled ? `empty${name[0].toUpperCase()}${name.slice(1)}` : name;
}

/** Points of one method, with the row behind the coordinates for clicks. */
function points(k, data, name) {
  const { colour } = style(k);
  const [many, very] = [data.length > 400, data.length > 1500];
  return {
    type: "scatter", name, data, symbol: symbolOf(k, many), symbolSize: very ? 4 : many ? 5 : 8, z: 3, cursor: "pointer",
    itemStyle: { color: colour, borderColor: colour, opacity: very || page.rows > 3000 ? 0.25 : many ? 0.5 : 0.85 }, emphasis: { itemStyle: { opacity: 1, borderWidth: 2 } },
  };
}

function line(k, data, extra = {}) {
  const { colour, dash } = style(k);
  return {
    type: "line", data, symbol: "none", silent: true, z: 4, lineStyle: { color: colour, width: 2, type: dashOf(dash, 2) },
    itemStyle: { color: colour }, ...extra,
  };
}

/** What a click on the point of a run does. */
const clickWords = (row) => (page.histories[row] ? "A click shows its force." : "No force was kept of it; a click shows its row.");

function tipOfRun(row, ...pairs) {
  const lines = [nameOf(row), ...pairs.map(([words, value]) => `${words}: ${numberText(value)}`), clickWords(row)];
  return lines.map(escaped).join("<br>");
}

const counted = (many, what) => `${many.toLocaleString("en")} ${what}${many === 1 ? "" : "s"}`;

const wishes = {}; // for each box and column, what the user chose

/** Set a box to what its axis is, and return it. */
function logBox(id, axisOf, byDefault) {
  $(id).disabled = axisOf.no_log !== "";
  $(id).checked = !axisOf.no_log && (wishes[`${id} ${axisOf.name}`] ?? byDefault);
  $(id).dataset.column = axisOf.name;
  $(`${id}-why`).textContent = axisOf.no_log ? `(no: ${axisOf.no_log})` : "";
  return $(id).checked;
}

/** The place of a value on an axis; what is below the lower end of a logarithmic axis is drawn at it. */
const onAxisOf = (value, log, edge) => (log ? Math.log10(Math.max(value, edge)) : value);

/** How many values are drawn at the edge of a logarithmic axis. */
function atEdge(values, log, edge) {
  if (!log) return "";
  const many = values.filter((value) => value < edge).length;
  return many ? `${counted(many, "run")} below 10⁻¹⁰ of the largest ${many === 1 ? "is" : "are"} drawn at the lower edge.` : "";
}

/** Split rows by method into points with a place on the axes, and tell of the others. */
function placed(rows, xOf, yOf, logX, logY, edge) {
  let gone = 0;
  const data = page.methods.map(() => []);
  for (const row of rows) {
    const [x, y] = [xOf(row), yOf(row)];
    if (!Number.isFinite(x) || !Number.isFinite(y)) gone += 1;
    else data[methodOf[row]].push([logX ? Math.log10(x) : x, onAxisOf(y, logY, edge), row]);
  }
  return { data, words: gone ? `${counted(gone, "run")} that ${gone === 1 ? "is" : "are"} done ${gone === 1 ? "lacks" : "lack"} one of the two values, and ${gone === 1 ? "is" : "are"} neither drawn nor ranked.` : "" };
}

/** The grids of some panels beside and below each other in a chart. */
function gridOfPanels(id, number, { least = 330, most = 4, left = 64, right = 14, top = 34, bottom = 56, high = 300, widest = Infinity } = {}) {
  const width = printing ? PAPER_WIDTH : $(id).clientWidth;
  const across = Math.max(1, Math.min(number, most, Math.floor(width / least)));
  const each = width / across;
  const inside = Math.min(each - left - right, widest);
  const panels = Array.from({ length: number }, (_, n) => ({ left: (n % across) * each + left, top: Math.floor(n / across) * high + top, width: inside, height: high - top - bottom }));
  return { panels, across, inside, up: high - top - bottom, tall: Math.ceil(number / across) * high };
}

function drawWork() {
  const [y, x] = [column[$("work-y").value], column[$("work-x").value]];
  if (!x || !y) {
    for (const id of ["work-logx", "work-logy"]) $(id).disabled = true;
    return say("work", x ? "No measure was recorded." : "No cost was recorded: measure node_steps, seconds.march or steps.");
  }
  const rows = visible(active).filter(isDone);
  const both = rows.filter((row) => Number.isFinite(x.values[row]) && Number.isFinite(y.values[row]));
  const log = [logBox("work-logx", x, page.charts.work.across[x.name]), logBox("work-logy", y, page.charts.work.up[y.name])];
  const cases = [...new Set(both.map((row) => column.case.codes[row]))].sort((a, b) => a - b);
  const { words } = placed(rows, (row) => x.values[row], (row) => y.values[row]);
  if (!cases.length) {
    $("work-note").textContent = words;
    return say("work", "No run with both values passes the filters.", { height: 380 });
  }
  const ranked = page.ranked.includes(y.name);
  const heights = both.map((row) => y.values[row]);
  const drawn = cases.slice(0, MOST_PANELS).map((code) => workPanel(both.filter((row) => column.case.codes[row] === code), x, y, log, ranked));
  const alone = column.case.levels.length === 1;
  const { panels, across, tall } = gridOfPanels("work", drawn.length);
  const option = drawn.length === 1 ? { grid: { ...grid, top: alone ? grid.top : 40 } } : { grid: panels };
  const tip = ({ data: [, , row] }) => tipOfRun(row, [y.label, y.values[row]], [x.label, x.values[row]]);
  show("work", {
    ...option, toolbox: { ...tools("work-precision", drawn.length === 1) }, tooltip: tooltip(tip),
    title: alone ? [] : drawn.map((_, n) => titleOf(column.case.levels[cases[n]], drawn.length === 1 ? { left: grid.left, top: 10, width: 400 } : { ...panels[n], top: panels[n].top - 4 })),
    series: drawn.flatMap(({ series }, n) => series.map((item) => ({ ...item, xAxisIndex: n, yAxisIndex: n }))),
    xAxis: drawn.map(({ all }, n) => ({ ...axis(x.label, extentOf(all.map((item) => item[0])), { log: log[0], gap: 30 }), gridIndex: n })),
    yAxis: drawn.map(({ all }, n) => ({ ...axis(n % across ? "" : y.label, extentOf(all.map((item) => item[1])), { log: log[1], gap: 48 }), gridIndex: n })),
  }, {
    height: drawn.length === 1 ? 380 : tall,
    then: (chart) => (drawn.length === 1 ? followZoom(chart, { xAxis: log[0], yAxis: log[1] }) : chart.off("datazoom")),
  });
  const left = cases.length > drawn.length ? `The first ${drawn.length} of ${cases.length} cases are drawn; choose one above. ` : "";
  const unranked = ranked ? "" : `No lines: less ${y.label} is not better. `;
  $("work-note").textContent = `${left}${unranked}${scopeOfBest()} ${atEdge(heights, log[1], y.edge)} ${words}`;
}

/** The points of one case and the lines of the best, of each method and of all that are no references. */
function workPanel(rows, x, y, log, ranked) {
  const { data } = placed(rows, (row) => x.values[row], (row) => y.values[row], ...log, y.edge);
  const compete = data.filter((_, k) => !page.references.includes(page.methods[k])).flat();
  const raw = (points) => frontOf(points.map(([, , row]) => [x.values[row], y.values[row]])).map(([a, b]) => [log[0] ? Math.log10(a) : a, onAxisOf(b, log[1], y.edge)]);
  const best = { type: "line", data: raw(compete), symbol: "none", silent: true, z: 1, lineStyle: { color: looks().exact, width: 8, opacity: 0.35 } };
  const series = page.methods.flatMap((method, k) => [points(k, data[k], method), ...(ranked ? [line(k, raw(data[k]))] : [])]);
  return { all: data.flat(), series: ranked ? [best, ...series] : series };
}

function titleOf(text, { left, top, width }) {
  return { text, left: left - 4, top: top - 24, textStyle: { color: looks().ink, fontSize: 13, fontWeight: "bold", width, overflow: "truncate" } };
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
  return all ? `Points are the sample and the best runs, ${what.toLowerCase()} are of all ${page.total.toLocaleString("en")} rows.` : `Points are the sample and the best runs that pass the filters, ${what.toLowerCase()} are of the sample.`;
}

/** The lines of the best need no other rows than those of the page, which has all that could be on them. */
function scopeOfBest() {
  if (page.seed === null) return "";
  const all = page.total.toLocaleString("en");
  return active.length === page.rows ? `Points are the sample and the best runs, lines are of all ${all} rows.` : "Points and lines are of the rows of this page that pass the filters.";
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
  if (!x || !y) {
    for (const id of ["vary-logx", "vary-logy"]) $(id).disabled = true;
    return say("vary", "Nothing was varied.");
  }
  const words = x.kind === "text";
  const made = visible(active).filter(isMade);
  const rows = made.filter(isDone);
  const level = page.methods.map((_, k) => !words && lacks(k, x));
  const measured = rows.filter((row) => Number.isFinite(y.values[row]));
  const logX = logBox("vary-logx", x, page.charts.varied.across[x.name]);
  const heights = measured.filter((row) => words || level[methodOf[row]] || Number.isFinite(x.values[row])).map((row) => y.values[row]);
  const logY = logBox("vary-logy", y, page.charts.varied.up[y.name]);
  const present = page.methods.map((_, k) => k).filter((k) => !hidden.has(k));
  // methods stand beside each other where the axis holds words
  const beside = (k) => (words ? (page.spread * (present.indexOf(k) - (present.length - 1) / 2)) / Math.max(present.length, 1) : 0);
  const xOf = (row) => (words ? x.codes[row] + beside(methodOf[row]) : x.values[row]);
  const { data, words: missed } = placed(rows.filter((row) => !level[methodOf[row]]), xOf, (row) => y.values[row], logX, logY, y.edge);
  const stored = whole() && page.bands[`${y.name}|${x.name}`];
  const drawn = made.filter((row) => !added.has(row));
  const bands = page.methods.map((method, k) => {
    if (hidden.has(k)) return [];
    if (stored) return storedBand(stored[method], beside(k));
    return bandOf(x, y, drawn.filter((row) => methodOf[row] === k), beside(k), level[k]);
  });
  const put = ([place, low, middle, high, ...many]) => [logX ? Math.log10(place) : place, ...[low, middle, high].map((v) => onAxisOf(v, logY, y.edge)), ...many, middle];
  const full = bands.map((band) => band.filter((item) => item[4] > 0));
  const onAxis = full.map((band) => band.filter(([place]) => Number.isFinite(place)).map(put));
  const filled = full.filter((band) => band.length).length <= page.most_bands;
  const levels = full.map((band) => band.filter(([place]) => !Number.isFinite(place)).map(put)[0]);
  const leveled = present.filter((k) => levels[k]);
  // their names stand beside each other, as the lines may lie on each other
  const middle = (k) => spread[0] + ((leveled.indexOf(k) + 1) / (leveled.length + 1)) * (spread[1] - spread[0]);
  const all = [...data.flat(), ...onAxis.flat().map(([place, , middle]) => [place, middle])];
  if (!all.length && !levels.some(Boolean)) {
    $("vary-note").textContent = missed;
    return say("vary", "No run with both values passes the filters.");
  }
  const ticks = x.ticks.length ? x.ticks.map((value) => (logX ? Math.log10(value) : value)) : null;
  const spread = words ? [0, x.levels.length - 1] : extentOf(all.map((item) => item[0]));
  const labels = words ? x.levels.map((level) => labelOf(level) || `no ${shortName(x)}`) : null;
  const counts = ([, , , , have, of]) => (have < of ? `median of ${have} of ${of} runs, the others lost` : `median of ${counted(of, "run")}`);
  const tipOfMedian = (k, item, where) => [page.methods[k], where, `${y.label}: ${numberText(item[6])}`, counts(item)].map(escaped).join("<br>");
  const series = page.methods.flatMap((method, k) => [
    points(k, data[k], method), ...bandSeries(k, onAxis[k], words, filled),
    ...rings(k, onAxis[k].filter((item) => item[4] < item[5]), (item) => tipOfMedian(k, item, words ? "" : `${x.label}: ${numberText(logX ? 10 ** item[0] : item[0])}`)),
    ...(levels[k] ? levelSeries(k, levels[k], spread, middle(k), `no ${shortName(x)}`, tipOfMedian(k, levels[k], `no ${shortName(x)}: the same at each value`)) : []),
  ]);
  const ends = [...all.map((item) => item[1]), ...levels.filter(Boolean).flatMap((item) => [item[1], item[2], item[3]])];
  show("vary", {
    grid: words ? { ...grid, bottom: 76 } : grid, toolbox: tools("varied"), series,
    xAxis: axis(x.label, spread, { log: logX, labels, gap: words ? 54 : 30, horizontal: true, ticks }),
    yAxis: axis(y.label, extentOf(ends), { log: logY, gap: 48 }),
    tooltip: tooltip(({ data: point }) => point.tip || tipOfRun(point[2], [y.label, y.values[point[2]]])),
  }, { then: (chart) => followZoom(chart, { xAxis: logX, yAxis: logY }) });
  const cases = new Set(made.map((row) => column.case.codes[row])).size;
  const notes = [
    scope(Boolean(stored), "Medians and bands"),
    cases > 1 ? `Medians are over the runs of ${cases} cases together; choose one above.` : "",
    lostWords(bands.flat()), atEdge(heights, logY, y.edge), missed,
    cases === 1 && x.name === "refine" && logX && logY ? ordersOf(onAxis) : "",
  ];
  $("vary-note").textContent = notes.filter(Boolean).join(" ");
}

/** How many of the runs behind some medians have no part in them. */
function lostWords(band) {
  const [have, of] = [4, 5].map((place) => band.reduce((sum, item) => sum + item[place], 0));
  return of > have ? `${(of - have).toLocaleString("en")} of ${counted(of, "run")} were lost or have no such number, and are in no median; at a ring some were.` : "";
}

/** Over the mesh the slope of a line through the medians of each method is its observed order. */
function ordersOf(bands) {
  const orders = bands.map((band, k) => {
    if (band.length < 2) return "";
    const [x, y] = [0, 2].map((place) => band.reduce((sum, item) => sum + item[place], 0) / band.length);
    const slope = band.reduce((sum, item) => sum + (item[0] - x) * (item[2] - y), 0) / band.reduce((sum, item) => sum + (item[0] - x) ** 2, 0);
    return `${page.methods[k]} ${numberText(-slope, 2)}`;
  });
  const fitted = orders.filter(Boolean);
  return fitted.length ? `Observed orders, fitted to the medians: ${fitted.join("; ")}.` : "";
}

function storedBand(text, offset) {
  if (!text) return [];
  const all = unpacked(text, "<f4");
  const n = all.length / 6;
  return Array.from({ length: n }, (_, j) => Array.from({ length: 6 }, (_, part) => all[j + part * n] + (part ? 0 : offset)));
}

/** Place, quantiles, number of values and number of runs of each bin; one bin without place for a method that lacks x. */
function bandOf(x, y, rows, offset, level) {
  const bins = level ? { places: [NaN] } : x.bins;
  const groups = bins.places.map(() => ({ values: [], of: 0 }));
  for (const row of rows) {
    const group = groups[level ? 0 : bins.of[row]];
    if (!group) continue;
    group.of += 1;
    if (isDone(row) && Number.isFinite(y.values[row])) group.values.push(y.values[row]);
  }
  return groups.flatMap(({ values, of }, j) => {
    if (!of) return [];
    values.sort((a, b) => a - b);
    return [[bins.places[j] + offset, quantile(values, 0.1), quantile(values, 0.5), quantile(values, 0.9), values.length, of]];
  });
}

/** Rings around the medians over fewer runs than were made. */
function rings(k, band, tip) {
  const { colour } = style(k);
  const data = band.map((item) => ({ value: [item[0], item[2]], tip: tip(item) }));
  return [{ type: "scatter", name: "ring", data, symbol: "circle", symbolSize: 13, z: 5, itemStyle: { color: "transparent", borderColor: colour, borderWidth: 2 } }];
}

/** A level line for a method that has no such option, and what it lacks at one place of it. */
function levelSeries(k, [, low, middle, high], [from, to], place, words, tip) {
  const { colour } = style(k);
  const mark = { value: [place, middle], tip, label: { show: true, position: "top", formatter: words, color: looks().ink, fontSize: 12 } };
  const edge = (height) => line(k, [[from, height], [to, height]], { lineStyle: { color: colour, width: 1, opacity: 0.5 } });
  return [
    ...(high > low ? [edge(low), edge(high)] : []),
    line(k, [[from, middle], [to, middle]]),
    { type: "scatter", name: "level", data: [mark], symbol: symbolOf(k), symbolSize: 9, z: 5, itemStyle: { color: colour } },
  ];
}

function bandSeries(k, band, words, filled) {
  const { colour } = style(k);
  if (words) {
    // no line joins words: a bar from the tenth to the ninetieth of a hundred, and the median across it
    return band.flatMap(([x, low, middle, high]) => [
      line(k, [[x, low], [x, high]], { lineStyle: { color: colour, width: 3, opacity: 0.5 } }),
      { ...line(k, [[x, middle]]), symbol: "rect", symbolSize: [18, 3] },
    ]);
  }
  const edges = { symbol: "none", lineStyle: { width: 0 }, stackStrategy: "all", stack: `band${k}`, z: 2 };
  const wide = filled && band.some(([, low, , high]) => high > low);
  const area = wide
    ? [
        line(k, band.map(([x, low]) => [x, low]), edges),
        line(k, band.map(([x, low, , high]) => [x, high - low]), { ...edges, areaStyle: { color: colour, opacity: 0.16 } }),
      ]
    : [];
  return [...area, line(k, band.map(([x, , middle]) => [x, middle]), { symbol: band.length > 1 ? "none" : symbolOf(k) })];
}

// ---------------------------------------------------------------------------------------------- profile

function drawProfile() {
  const profile = page.profiles[$("profile-v").value];
  if (!profile) return;
  $("profile-note").textContent = profile.note;
  if (profile.empty) return say("profile", profile.empty, { height: 120 });
  const series = page.methods.flatMap((method, k) => {
    if (hidden.has(k) || !profile.lines[method]) return [];
    const [factors, shares] = profile.lines[method].map((part) => unpacked(part, "<f4"));
    return [line(k, Array.from(factors, (factor, n) => [Math.log10(factor), shares[n]]), { name: method, step: "end" })];
  });
  show("profile", {
    grid, toolbox: tools("performance-profile", false), series,
    xAxis: axis(profile.label, [0, Math.log10(profile.end)], { log: true }),
    yAxis: axis("share of problems", [0, 1], { gap: 48 }),
    tooltip: { ...tooltip(tipOfProfile), trigger: "axis" },
  }, { height: 340 });
}

function tipOfProfile(items) {
  const last = new Map(items.map(({ seriesName, data }) => [seriesName, data]));
  return [`within ${escaped(numberText(10 ** items[0].axisValue, 3))} times the best`, ...[...last].map(([name, data]) => `${escaped(name)}: <b>${escaped(numberText(data[1], 3))}</b>`)].join("<br>");
}

// ---------------------------------------------------------------------------------------------- map

const mixed = (share) => {
  const place = Math.min(Math.max(share, 0), 1) * (CIVIDIS.length - 1);
  const low = Math.min(Math.floor(place), CIVIDIS.length - 2);
  const part = (text, k) => parseInt(text.slice(1 + 2 * k, 3 + 2 * k), 16);
  const both = [0, 1, 2].map((k) => Math.round(part(CIVIDIS[low], k) + (place - low) * (part(CIVIDIS[low + 1], k) - part(CIVIDIS[low], k))));
  return `rgb(${both.join(",")})`;
};

/** The cells of a map for one method: its runs by what became of them, and the median over those that have the value. */
function cellsOf(k, rows, x, y, value) {
  const cells = new Map();
  for (const row of rows) {
    if (methodOf[row] !== k) continue;
    const [i, j] = [x.of ? x.of[row] : 0, y.of ? y.of[row] : 0];
    if (i < 0 || j < 0) continue;
    const key = j * x.places.length + i;
    if (!cells.has(key)) cells.set(key, { i, j, values: [], counts: {}, row });
    const cell = cells.get(key);
    const outcome = outcomeOf(row);
    cell.counts[outcome] = (cell.counts[outcome] || 0) + 1;
    if (outcome === "done") {
      if (value && Number.isFinite(value.values[row])) cell.values.push(value.values[row]);
      // a click shows a run that is done, and one whose force was kept rather than another
      if (!isDone(cell.row) || (page.histories[row] && !page.histories[cell.row])) cell.row = row;
    }
  }
  for (const cell of cells.values()) {
    cell.values.sort((a, b) => a - b);
    finishCell(cell, value, value ? quantile(cell.values, 0.5) : NaN, value ? cell.values.length : null);
  }
  return [...cells.values()];
}

/** Give a cell its value, and of how many of its runs that is. */
function finishCell(cell, value, median, measured) {
  const { done = 0, unstable = 0 } = cell.counts;
  cell.made = Object.values(cell.counts).reduce((sum, many) => sum + many, 0);
  cell.measured = value ? measured : done + unstable;
  cell.value = value ? median : done / (done + unstable);
  return cell;
}

/** The cells of a map along one side: those of the column, or a single one for a method that has no such value. */
function sideOf(k, side) {
  return lacks(k, side) ? { places: [0], labels: [`no ${shortName(side)}`] } : { ...side.cells, labels: labelsOf(side, side.cells) };
}

function drawMap() {
  const [x, y] = [column[$("map-x").value], column[$("map-y").value]];
  const value = column[$("map-v").value];
  const rows = visible(active).filter(isMade).filter((row) => !added.has(row));
  const present = page.methods.map((_, k) => k).filter((k) => rows.some((row) => methodOf[row] === k));
  const shown = present.slice(0, MOST_PANELS);
  if (!x || !y || x === y || !shown.length) {
    $("map-scale").replaceChildren();
    return say("map", x && y && x !== y ? "No run passes the filters." : "A map needs two different varied values.", { height: 120 });
  }
  const stored = whole() ? storedMap(x, y) : null;
  const every = shown.map((k) => {
    const bins = [sideOf(k, x), sideOf(k, y)];
    return { k, bins, cells: stored ? stored(k, value) : cellsOf(k, rows, ...bins, value) };
  });
  const panels = every.filter(({ cells }) => cells.length);
  if (!panels.length) return say("map", "No run has both values.", { height: 120 });
  const drawn = panels.flatMap(({ cells }) => cells.map((cell) => cell.value)).filter(Number.isFinite);
  const log = Boolean(value && page.charts.varied.up[value.name]);
  const ends = value ? extentOf(drawn) : [0, 1];
  const scale = (v) => (log ? Math.log10(v) : v);
  const share = (v) => (ends[1] > ends[0] ? (scale(v) - scale(ends[0])) / (scale(ends[1]) - scale(ends[0])) : 0.5);
  const words = value ? `median ${value.label}` : page.stayed;
  const roomy = drawMapPanels(panels, x, y, share, words, value);
  drawScale(words + (log ? " (logarithmic)" : ""), drawn.length ? ends : null, panels, roomy, value);
  const bare = every.filter(({ cells }) => !cells.length).map(({ k }) => page.methods[k]);
  const lacking = bare.length ? `No run with both values: ${bare.join(", ")}. ` : "";
  const left = present.length > MOST_PANELS ? `The first ${MOST_PANELS} of ${present.length} methods are shown. ` : "";
  const lost = panels.flatMap(({ cells }) => cells).reduce((sum, cell) => sum + cell.made - (value ? cell.measured : cell.counts.done || 0), 0);
  const made = panels.flatMap(({ cells }) => cells).reduce((sum, cell) => sum + cell.made, 0);
  const partial = lost ? `${lost.toLocaleString("en")} of the ${counted(made, "run")} on the map ${value ? "have no such number, and are in no median" : "are not done"}. ` : "";
  const cases = new Set(rows.map((row) => column.case.codes[row])).size;
  const together = value && cases > 1 && x.name !== "case" && y.name !== "case" ? `Medians are over the runs of ${cases} cases together; choose one above. ` : "";
  $("map-note").textContent = lacking + left + partial + together + (page.seed === null ? "" : stored ? `The map is of all ${page.total.toLocaleString("en")} rows.` : "The map is of the sample.");
}

/** Of a sampled study the cells of a map of all its rows over two varied values, whichever of them lies across. */
function storedMap(x, y) {
  const turned = !page.maps[`${x.name}|${y.name}`];
  const methods = page.maps[turned ? `${y.name}|${x.name}` : `${x.name}|${y.name}`];
  if (!methods) return null;
  const across = turned ? y : x;
  return (k, value) => {
    const method = methods[page.methods[k]];
    if (!method) return [];
    const part = (name) => (method[name] ? unpacked(method[name], "<f4") : null);
    const kinds = page.outcomes.map(([name, outcome]) => [outcome, part(name)]);
    const [medians, measured] = value ? [part(value.name), part(`${value.name}|known`)] : [null, null];
    const wide = lacks(k, across) ? 1 : across.cells.places.length;
    return Array.from(kinds[0][1], (_, at) => at).flatMap((at) => {
      const counts = Object.fromEntries(kinds.map(([outcome, many]) => [outcome, many[at]]).filter(([, many]) => many));
      if (!Object.keys(counts).length) return [];
      const [i, j] = [at % wide, Math.floor(at / wide)];
      const cell = { i: turned ? j : i, j: turned ? i : j, counts };
      return [finishCell(cell, value, medians ? medians[at] : NaN, medians ? (measured ? measured[at] : counts.done || 0) : 0)];
    });
  };
}

/** Draw the panels, and return whether there was room for the counts of runs in the cells. */
function drawMapPanels(panels, x, y, share, words, value) {
  const look = looks();
  const { panels: grids, across, inside, up, tall } = gridOfPanels("map", panels.length, { least: 290, top: 46, bottom: 62, high: 330, widest: 520 });
  const option = { grid: grids, xAxis: [], yAxis: [], series: [], title: [] };
  let roomy = false;
  panels.forEach(({ k, bins, cells }, n) => {
    option.title.push({
      text: page.methods[k].replace(" + ", "\n+ "), left: grids[n].left - 4, top: grids[n].top - 42,
      textStyle: { color: look.ink, fontSize: 13, lineHeight: 16, fontWeight: "bold", width: inside, overflow: "truncate" },
    });
    const category = { type: "category", axisTick: { show: false }, axisLine: { lineStyle: { color: look.soft } }, splitLine: { show: false }, nameLocation: "middle", nameTextStyle: { color: look.ink, fontSize: 12 } };
    const label = { color: look.soft, fontSize: 11, hideOverlap: true, width: 90, overflow: "truncate" };
    option.xAxis.push({ ...category, gridIndex: n, data: bins[0].labels, name: x.label, nameGap: 34, axisLabel: label });
    option.yAxis.push({ ...category, gridIndex: n, data: bins[1].labels, name: n % across ? "" : y.label, nameGap: 48, axisLabel: { ...label, width: 44 } });
    const size = [inside / bins[0].places.length, up / bins[1].places.length];
    const fits = size[0] >= 30 && size[1] >= 14;
    roomy ||= fits && cells.some(isPartial);
    option.series.push(...mapSeries(cells, n, size, share, look, fits));
  });
  const tip = ({ data: { cell }, seriesIndex }) => {
    const { bins } = panels[option.series[seriesIndex].xAxisIndex];
    const counts = Object.entries(cell.counts).map(([status, many]) => `${many} ${status}`).join(", ");
    const over = cell.measured < cell.made ? ` (of ${cell.measured} of ${cell.made} runs)` : ` (of ${counted(cell.made, "run")})`;
    const valueWords = Number.isFinite(cell.value) ? [`${words}: ${numberText(cell.value)}${over}`] : cell.counts.done ? [`${words}: no number of ${counted(cell.made, "run")}`] : [];
    const click = Number.isInteger(cell.row) ? [cell.made > 1 ? `A click shows one run of the cell. ${clickWords(cell.row)}` : clickWords(cell.row)] : [];
    return [`${x.label}: ${bins[0].labels[cell.i]}`, `${y.label}: ${bins[1].labels[cell.j]}`, ...valueWords, counts, ...click].map(escaped).join("<br>");
  };
  show("map", { ...option, tooltip: tooltip(tip), toolbox: { show: false } }, { height: tall });
  return roomy;
}

const hasValue = (cell) => Number.isFinite(cell.value);
/** Whether the value of a cell is that of some of its runs only. */
const isPartial = (cell) => hasValue(cell) && (cell.measured < cell.made || cell.counts.done < cell.made || !cell.counts.done);
const countOf = (cell) => `${Math.min(cell.measured, cell.counts.done || 0)}/${cell.made}`;

function mapSeries(cells, n, [wide, high], share, look, fits) {
  const at = (cell) => ({ value: [cell.i, cell.j], row: cell.row, cell });
  const shared = { type: "scatter", xAxisIndex: n, yAxisIndex: n, cursor: cells.some((cell) => Number.isInteger(cell.row)) ? "pointer" : "default" };
  const small = Math.max(5, 0.5 * Math.min(wide, high, 30));
  const bare = cells.filter((cell) => !hasValue(cell));
  const onColour = { color: "#ffffff", borderColor: "#000000", borderWidth: 0.7, opacity: 1 };
  const label = (cell) => ({ show: true, formatter: countOf(cell), fontSize: 11, color: share(cell.value) > 0.55 ? "#000000" : "#ffffff" });
  return [
    {
      ...shared, symbol: "rect", symbolSize: [Math.max(wide - 1, 1), Math.max(high - 1, 1)], z: 2,
      data: cells.filter(hasValue).map((cell) => ({ ...at(cell), itemStyle: { color: mixed(share(cell.value)), opacity: 1 }, ...(fits && isPartial(cell) ? { label: label(cell) } : {}) })),
    },
    {
      ...shared, symbol: CROSS, symbolSize: small, z: 3,
      data: [
        ...bare.filter((cell) => cell.counts.unstable).map((cell) => ({ ...at(cell), itemStyle: { color: look.alarm, opacity: 1 } })),
        ...(fits ? [] : cells.filter(isPartial)).map((cell) => ({ ...at(cell), itemStyle: onColour })),
      ],
    },
    { ...shared, symbol: BAR, symbolSize: [small, small / 4], z: 3, itemStyle: { color: look.soft, opacity: 1 }, data: bare.filter((cell) => !cell.counts.done && !cell.counts.unstable).map(at) },
    { ...shared, symbol: "emptyCircle", symbolSize: small, z: 3, itemStyle: { color: look.soft, borderColor: look.soft, opacity: 1 }, data: bare.filter((cell) => cell.counts.done && !cell.counts.unstable).map(at) },
  ];
}

function drawScale(words, ends, panels, roomy, value) {
  const made = [element("span", words)];
  if (ends) {
    const ramp = element("span", "", { class: "ramp" });
    ramp.style.background = `linear-gradient(90deg, ${CIVIDIS.join(",")})`;
    const range = element("span");
    range.append(numberText(ends[0], 3), ramp, numberText(ends[1], 3));
    made.push(range);
  }
  const cells = panels.flatMap((panel) => panel.cells);
  const entry = (mark, text) => {
    const both = element("span");
    both.append(element("b", mark), ` ${text}`);
    return both;
  };
  const partial = cells.find(isPartial);
  const what = value ? "the median is that of the others" : "they are not done";
  if (partial && roomy) made.push(entry(countOf(partial), `done ${value ? "and in the median" : ""} of all runs of the cell; some were lost`));
  else if (partial) made.push(entry("✕", `in a colour: some runs of the cell were lost, ${what}`));
  if (cells.some((cell) => !hasValue(cell) && cell.counts.unstable)) made.push(entry("✕", "unstable: no run of the cell has a number"));
  if (cells.some((cell) => !hasValue(cell) && !cell.counts.done && !cell.counts.unstable)) made.push(entry("–", "refused, failed or lost, all runs of the cell"));
  if (cells.some((cell) => !hasValue(cell) && cell.counts.done && !cell.counts.unstable)) made.push(entry("○", "done, without this number"));
  if (panels.some(({ cells: own, bins }) => own.length < bins[0].places.length * bins[1].places.length)) made.push(element("span", "blank: no run"));
  $("map-scale").replaceChildren(...made);
}

// ---------------------------------------------------------------------------------------------- forces

/** Show a run: its force, or where none was kept its row in the table, which says all that is known of it. */
function pick(row, from = false) {
  pickRow(row, from);
  showCommand(row);
  noteChange("runs");
}

function pickRow(row, from) {
  const before = marked;
  marked = page.histories[row] ? null : row;
  if (before !== null) reformat(before);
  if (marked !== null) {
    reformat(row);
    drawForce();
    if (from) showRow(row);
    return;
  }
  const at = picked.indexOf(row);
  if (at >= 0 && !from) picked.splice(at, 1);
  else if (at < 0) picked.push(row);
  if (picked.length > page.most_forces) reformat(picked.shift());
  reformat(row);
  drawForce();
  if (from) $("force").closest("figure").scrollIntoView({ behavior: "smooth", block: "nearest" });
}

/** Choose the runs whose forces are shown, and the row that is marked as none was kept of it. */
function setPicked(rows, row) {
  const before = [...picked.splice(0), marked];
  picked.push(...rows);
  marked = row;
  for (const changed of new Set([...before, ...picked, marked])) if (changed !== null) reformat(changed);
}

function showRow(row) {
  $("table").scrollIntoView({ block: "center" });
  table.scrollToRow(row, "center", true).catch(() => {}); // a row that a filter hides is not there
}

function reformat(row) {
  const line = table.getRow(row);
  if (line) line.reformat();
}

function pairs([time, force]) {
  const [x, y] = [unpacked(time, "<f4"), unpacked(force, "<f4")];
  return Array.from(x, (t, k) => [t, y[k]]);
}

function drawForce() {
  if (!Object.keys(page.histories).length) {
    $("force-note").textContent = `This study kept no histories.${markedWords()}`;
    for (const id of ["force", "force-legend", "unpick"]) $(id).hidden = true;
    return;
  }
  const [series, entries] = [[], []];
  const exact = new Set();
  picked.forEach((row, n) => {
    const history = page.histories[row];
    const { colour, dash } = style(n);
    const words = nameOf(row) + (isDone(row) ? "" : ` (${textAt(column.status, row)})`);
    const what = textAt(column.case, row);
    if (history.exact.length && !exact.has(what)) {
      exact.add(what);
      const look = { color: looks().exact, width: 5 };
      series.push(...history.exact.map((item) => ({ type: "line", name: `exact, ${what}`, data: pairs(item), symbol: "none", z: 1, lineStyle: look, itemStyle: { color: look.color } })));
      entries.push([{ colour: look.color, dash: [], width: 5 }, `exact, ${what}`]);
    }
    history.force.forEach((item, contact) => {
      const name = history.force.length > 1 ? `${words}, ${history.contacts[contact] ?? `contact ${contact + 1}`}` : words;
      series.push({
        type: "line", name, data: pairs(item), symbol: "none", z: 3, itemStyle: { color: colour },
        lineStyle: { color: colour, width: contact ? 1 : 2, type: dashOf(dash, contact ? 1 : 2) },
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
  $("force-note").textContent = forceNote();
  if (!series.length) return say("force", "No run is chosen.", { height: 90 });
  const all = series.flatMap((item) => item.data);
  show("force", {
    grid: { left: 74, right: 18, top: 30, bottom: 48 }, toolbox: tools("force"), series,
    xAxis: axis("time", extentOf(all.map((item) => item[0])), { gap: 28 }),
    yAxis: { ...axis("contact force", boundOf(series), { gap: 56 }) },
    tooltip: { ...tooltip(tipOfTime), trigger: "axis" },
  }, { height: 340 });
}

/** Keep what the exact force tells, or the runs that are done, from being flattened by a run that ran away. */
function boundOf(series) {
  const sound = series.filter((item) => !item.name.includes("(unstable)"));
  return extentOf((sound.length ? sound : series).flatMap((item) => item.data.map((pair) => pair[1])));
}

function tipOfTime(items) {
  const lines = items.slice(0, 8).map(({ seriesName, data }) => `${escaped(seriesName)}: <b>${escaped(numberText(data[1]))}</b>`);
  return [`time ${escaped(numberText(items[0].axisValue))}`, ...lines].join("<br>");
}

/** What is said of a run that was asked for and has no history to show. */
function markedWords() {
  if (marked === null) return "";
  const key = column.key ? ` (${textAt(column.key, marked)})` : "";
  return ` No history is in the page of the run asked for last${key}: ${nameOf(marked)}. Its row is marked in the table.`;
}

function forceNote() {
  const kept = Object.keys(page.histories).length;
  return `The page has the histories of ${counted(kept, "run")}; ${firstWords} ${page.most_forces} at most are shown.${markedWords()}`;
}

let firstWords = "";

/** The run of least error of each method in one case, so that something is seen before anything is chosen. */
function pickFirst() {
  const rows = Object.keys(page.histories).map(Number).filter(isDone);
  const error = column.force_error_l1;
  const ranked = rows.filter((row) => error && Number.isFinite(error.values[row]));
  firstWords = ranked.length ? "it begins with the least force error of each method in one case." : rows.length ? "no force error is known, and it begins with the first run of each method." : "";
  const best = new Map();
  // a run without a true error is not ranked among those that have one
  for (const row of ranked.length ? ranked : rows) {
    const method = methodOf[row];
    if (column.case.codes[row] !== column.case.codes[(ranked.length ? ranked : rows)[0]]) continue;
    if (!best.has(method) || (ranked.length && error.values[row] < error.values[best.get(method)])) best.set(method, row);
  }
  picked.push(...[...best.values()].slice(0, 4));
}

// ---------------------------------------------------------------------------------------------- the whole

function drawStudy() {
  drawWork();
  drawVaried();
  drawMap();
  drawProfile();
}

/** Fill a box with the names of columns, and choose one of them. */
function fill(id, names, place = 0) {
  $(id).replaceChildren(...names.map((name) => element("option", name ? column[name].label : page.stayed, { value: name })));
  if (names.length) $(id).value = names[place] ?? names[0];
  $(id).addEventListener("change", () => {
    drawStudy();
    noteChange(id);
  });
}

/** Show the table of pairs and cases of the chosen measure. */
function showPairs() {
  for (const item of document.querySelectorAll(".overview")) item.hidden = item.dataset.measure !== $("pairs-v").value;
}

function start() {
  const { work, varied, mapped } = page.charts;
  fill("work-y", Object.keys(work.up));
  fill("work-x", Object.keys(work.across));
  fill("vary-y", Object.keys(varied.up));
  fill("vary-x", Object.keys(varied.across));
  fill("map-v", [...Object.keys(varied.up), ""]);
  fill("map-x", mapped);
  fill("map-y", mapped, 1);
  $("map").closest("figure").hidden = mapped.length < 2;
  fill("pairs-v", page.ranked);
  fill("profile-v", page.ranked);
  $("pairs").hidden = !document.querySelector(".overview");
  $("profiles").hidden = !Object.keys(page.profiles).length;
  $("pairs-v").addEventListener("change", showPairs);
  showPairs();
  for (const id of LOG_BOXES) {
    $(id).addEventListener("change", () => {
      wishes[`${id} ${$(id).dataset.column}`] = $(id).checked;
      drawStudy();
      noteChange(id);
    });
  }
  $("unpick").addEventListener("click", () => {
    setPicked([], null);
    drawForce();
    noteChange("runs");
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
    folded = [...document.querySelectorAll("details:not([open], .file)")];
    drawPrinted();
  }
  for (const item of folded) item.open = on;
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
