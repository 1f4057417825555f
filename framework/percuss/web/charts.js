// The charts: each is drawn anew, whole, whenever rows, choices, looks or its width change.

const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const CROSS = "path://M-1,-0.7L-0.7,-1L0,-0.3L0.7,-1L1,-0.7L0.3,0L1,0.7L0.7,1L0,0.3L-0.7,1L-1,0.7L-0.3,0Z";
const BAR = "path://M-1,-0.16h2v0.32h-2z";
const PAPER_WIDTH = 680;
const MOST_PANELS = 24;
const MOST_RANKED = 16;
const CHOICES = ["measure", "statistic", "work-x", "vary-x", "map-v", "map-x", "map-y"];
const charts = {};

const visible = (rows) => rows.filter((row) => !hidden.has(methodOf[row]));
/** What is shown of several runs of a pair: a smaller value of other measures is not better, and has no best run. */
const isRanked = (y) => page.charts.ranked.includes(y.name);
const statisticOf = (y) => (isRanked(y) ? $("statistic").value : "median");
const measure = () => column[$("measure").value];
/** The rows that medians and counts are of: the best runs that were added to a sample would improve them. */
const drawnRows = (rows) => rows.filter((row) => !added.has(row));
const casesOf = (rows) => [...new Set(rows.map((row) => column.case.codes[row]))].sort((a, b) => a - b);
const several = (values) => values.filter(Number.isFinite).sort((a, b) => a - b);

function quantile(sorted, share) {
  const place = (sorted.length - 1) * share;
  const low = Math.floor(place);
  return sorted[low] + (place - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
}

const labelsOf = (side, bins) => (side.kind === "text" ? side.levels.map((level) => level || "none") : bins.places.map((place) => numberText(place, 3)));

// ---------------------------------------------------------------------------------------------- axes

/** Ticks of an axis between two places: round numbers at equal distances, or on a logarithmic axis parts of decades. */
function ticksBetween(low, high, log) {
  const span = high - low;
  if (!log || span <= 0.35) {
    const [from, to] = log ? [10 ** low, 10 ** high] : [low, high];
    const rough = 10 ** Math.floor(Math.log10((to - from) / 4 || 1e-300));
    const step = [1, 2, 5, 10].map((factor) => factor * rough).find((width) => (to - from) / width <= 6) || to - from;
    const first = Math.ceil(from / step - 1e-9);
    const many = Math.min(Math.floor(to / step + 1e-9) - first + 1, 12);
    return Array.from({ length: Math.max(many, 0) }, (_, k) => (first + k) * step).map((value) => (log ? Math.log10(value) : value));
  }
  const out = [];
  const step = Math.max(1, Math.ceil(span / 7));
  const within = span > 3 ? [1] : span > 1.2 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 7];
  for (let power = Math.floor(low); power <= high; power += 1) {
    if (span <= 3 || power % step === 0) out.push(...within.map((factor) => power + Math.log10(factor)));
  }
  return out.filter((power) => power >= low - 1e-9 && power <= high + 1e-9);
}

/** The labels of ticks, with as many digits as it takes to tell them apart. */
function tickLabels(ticks, log) {
  for (let digits = 3; ; digits += 1) {
    const labels = ticks.map((tick) => numberText(log ? 10 ** tick : Number(tick.toPrecision(12)), digits));
    if (digits === 12 || new Set(labels).size === labels.length) return labels;
  }
}

/** Ticks and their labels as ECharts takes them. */
function ticked(ticks, log, words = null) {
  const labels = words ?? tickLabels(ticks, log);
  const near = (value) => ticks.reduce((best, tick, k) => (Math.abs(tick - value) < Math.abs(ticks[best] - value) ? k : best), 0);
  return { axisTick: { show: true, customValues: ticks }, axisLabel: { customValues: ticks, formatter: (value) => labels[near(value)] ?? "" } };
}

function axis(words, extent, { log = false, labels = null, gap = 30, horizontal = false, ticks = null } = {}) {
  const look = looks();
  const [low, high] = extent;
  const room = labels ? 0.5 : (high - low || Math.abs(high) * 0.1 || 1) * 0.05;
  const ends = [low - room, high + room];
  const { axisTick, axisLabel } = ticked(labels ? labels.map((_, k) => k) : ticks || ticksBetween(...ends, log), log, labels);
  return {
    type: "value", min: ends[0], max: ends[1], name: words, nameLocation: "middle", nameGap: gap,
    nameTextStyle: { color: look.ink, fontSize: 13 }, axisLine: { show: true, onZero: false, lineStyle: { color: look.soft } },
    axisTick,
    axisLabel: {
      ...axisLabel, color: look.soft, fontSize: 12, hideOverlap: true, showMinLabel: true, showMaxLabel: true,
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

/** After zooming into an axis its ticks are set for what is seen. */
function followZoom(chart, logs) {
  chart.off("datazoom");
  chart.on("datazoom", () => {
    const update = {};
    for (const [name, log] of Object.entries(logs)) {
      update[name] = ticked(ticksBetween(...chart.getModel().getComponent(name).axis.scale.getExtent(), log), log);
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

/** Points of one method, with the row behind the coordinates for clicks. */
function points(k, data, name) {
  const [many, very] = [data.length > 400, data.length > 1500];
  return {
    type: "scatter", name, data, ...markOf(k, many), symbolSize: very ? 4 : many ? 5 : 8, z: 3, cursor: "pointer",
    emphasis: { itemStyle: { opacity: 1, borderWidth: 2 } },
    itemStyle: { ...markOf(k, many).itemStyle, opacity: very || page.rows > 3000 ? 0.25 : many ? 0.5 : 0.85 },
  };
}

/** The mark of a method: an open one has the colour of the page inside; small among many it would be a speck. */
function markOf(k, filled = false) {
  const { colour, shape, open } = style(k);
  return { symbol: SHAPES[shape], itemStyle: { color: open && !filled ? looks().paper : colour, borderColor: colour, borderWidth: 1.5 } };
}

function line(k, data, extra = {}) {
  const { colour, dash } = style(k);
  return {
    type: "line", data, symbol: "none", silent: true, z: 4, lineStyle: { color: colour, width: 2, type: dashOf(dash, 2) },
    itemStyle: { color: colour }, ...extra,
  };
}

/** What a click on the point of a run does. */
const clickWords = (row) => (page.histories[row] ? "A click shows its force." : `${whyNoForce(row)} A click shows its row.`);
const notInPage = new Set(page.not_in_page);
const whyNoForce = (row) => (notInPage.has(row) ? "The study keeps its force, which is not in this page." : "The study keeps no force of it.");

function tipOfRun(row, ...pairs) {
  const lines = [nameOf(row), ...pairs.map(([words, value]) => `${words}: ${numberText(value)}`), clickWords(row)];
  return lines.map(escaped).join("<br>");
}

const counted = (many, what) => `${many.toLocaleString("en")} ${what}${many === 1 ? "" : "s"}`;

/** The place of a value on the axis of a column; what is below the lower end of a logarithmic axis is drawn at it. */
const onAxisOf = (value, { log, edge }) => (log ? Math.log10(Math.max(value, edge ?? 0)) : value);

/** How many values are drawn at the edge of a logarithmic axis. */
function atEdge(values, { log, edge }) {
  const many = log ? values.filter((value) => value < edge).length : 0;
  return many ? `${counted(many, "run")} below 10⁻¹⁰ of the largest ${many === 1 ? "is" : "are"} drawn at the lower edge.` : "";
}

/** The runs of each method with their places on two axes and their rows. */
function placed(rows, xOf, x, y) {
  const data = page.methods.map(() => []);
  for (const row of rows) {
    const [at, value] = [xOf(row), y.values[row]];
    if (Number.isFinite(at) && Number.isFinite(value)) data[methodOf[row]].push([onAxisOf(at, x), onAxisOf(value, y), row]);
  }
  return data;
}

function missedWords(many) {
  return many ? `${counted(many, "run")} that ${many === 1 ? "is" : "are"} done ${many === 1 ? "lacks" : "lack"} one of the two values, and ${many === 1 ? "is" : "are"} neither drawn nor ranked.` : "";
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

// ---------------------------------------------------------------------------------------------- the best

/** Of one case: for each method that made runs of it the best and the median, and what became of the others. */
function cellsOfCase(code, y) {
  const cells = page.methods.map((_, k) => ({ k, values: [], row: -1, made: 0, lost: new Map() }));
  for (const row of active) {
    if (column.case.codes[row] !== code || hidden.has(methodOf[row]) || !isMade(row)) continue;
    const cell = cells[methodOf[row]];
    const value = isDone(row) ? y.values[row] : NaN;
    if (Number.isFinite(value) && !(value >= y.values[cell.row])) cell.row = row;
    if (added.has(row)) continue;
    cell.made += 1;
    if (Number.isFinite(value)) cell.values.push(value);
    else {
      const end = isDone(row) ? "without a number" : textAt(column.status, row);
      cell.lost.set(end, (cell.lost.get(end) || 0) + 1);
    }
  }
  return cells
    .filter(({ made, row }) => made || row >= 0)
    .map((cell) => ({ ...cell, best: cell.row < 0 ? NaN : y.values[cell.row], median: cell.values.length ? quantile(several(cell.values), 0.5) : NaN }));
}

function drawBest() {
  const y = measure();
  const statistic = y && statisticOf(y);
  $("best").classList.toggle("alone", column.case.levels.length === 1);
  if (!y) return $("best").replaceChildren(element("p", "No measure was recorded.", { class: "soft" }));
  const panels = casesOf(visible(active)).slice(0, MOST_PANELS).map((code) => bestPanel(code, y, statistic));
  $("best").replaceChildren(...panels);
  const left = casesOf(visible(active)).length - panels.length;
  $("best-note").textContent = [
    isRanked(y) ? "" : `A smaller ${y.label} is not better: pairs are in the order of their medians.`,
    left > 0 ? `${left} more cases are not drawn; choose one above.` : "",
    atEdge(active.filter(isDone).map((row) => y.values[row]), y),
  ].filter(Boolean).join(" ");
}

/** One case: its pairs from the best on, each with a mark at its best run and a bar at its median. */
function bestPanel(code, y, statistic) {
  const reference = ({ k }) => page.references.includes(page.methods[k]);
  const cells = cellsOfCase(code, y).sort((a, b) => reference(a) - reference(b) || (Number.isNaN(a[statistic]) - Number.isNaN(b[statistic])) || a[statistic] - b[statistic]);
  const shown = cells.slice(0, MOST_RANKED);
  const least = shown.find((cell) => !reference(cell))?.[statistic];
  const [low, high] = extentOf(shown.flatMap(({ best, median }) => [best, median]).filter(Number.isFinite).map((value) => onAxisOf(value, y)));
  const room = (high - low || 1) * 0.06;
  const share = (value) => (100 * (onAxisOf(value, y) - low + room)) / (high - low + 2 * room);
  const panel = element("div", "", { class: "case" });
  const ranked = isRanked(y);
  panel.append(element("h3", column.case.levels[code]));
  const table = element("table", "", { class: "best" });
  const head = table.createTHead().insertRow();
  head.append(...["", "", ...(ranked ? ["best"] : []), "median", ""].map((words) => element("th", words)));
  head.cells[1].append(bestScale(low - room, high + room, y.log));
  const body = table.createTBody();
  for (const cell of shown) {
    const line = body.insertRow();
    if (ranked && Math.abs(cell[statistic] - least) <= 1e-6 * Math.abs(least) && !reference(cell)) line.className = "winner";
    const name = element("th");
    name.append(swatch({ ...style(cell.k), dash: [], width: 0 }), element("span", page.methods[cell.k]));
    const track = line.appendChild(element("td", "", { class: "track" }));
    line.prepend(name);
    if (Number.isFinite(cell.best)) track.append(bestTrack(cell, share, ranked));
    for (const value of ranked ? [cell.best, cell.median] : [cell.median]) line.append(element("td", withUnit(value, y)));
    line.append(element("td", [...cell.lost].map(([end, many]) => `${many} of ${cell.made} ${end}`).join(", "), { class: "few" }));
    if (cell.row >= 0) line.addEventListener("click", () => pick(cell.row, true));
  }
  panel.append(table);
  if (cells.length > shown.length) panel.append(element("p", `The first ${shown.length} of ${cells.length} pairs.`, { class: "note" }));
  return panel;
}

/** A value with the sign of its unit, where it is a share. */
const withUnit = (value, y) => (Number.isFinite(value) ? numberText(value, 3) + (y.scale ? " %" : "") : "");

/** The axis of a panel of the best, above its rows. */
function bestScale(low, high, log) {
  const scale = element("div", "", { class: "ticks" });
  const ticks = ticksBetween(low, high, log);
  const kept = ticks.length > 5 ? ticks.filter((_, k) => k % Math.ceil(ticks.length / 5) === 0) : ticks;
  tickLabels(kept, log).forEach((label, k) => {
    const tick = element("span", label);
    tick.style.left = `${(100 * (kept[k] - low)) / (high - low)}%`;
    scale.append(tick);
  });
  return scale;
}

function bestTrack({ k, best, median }, share, ranked) {
  const { colour } = style(k);
  const holder = element("div", "", { class: "range" });
  const [from, to] = [share(ranked ? best : median), share(Number.isFinite(median) ? median : best)];
  const bar = element("i");
  bar.style.cssText = `left:${Math.min(from, to)}%;width:${Math.abs(to - from)}%;border-color:${colour}`;
  const end = element("b");
  end.style.cssText = `left:${to}%;background:${colour}`;
  const mark = element("span");
  mark.style.left = `${from}%`;
  mark.append(swatch({ ...style(k), dash: [], width: 0 }));
  holder.append(bar, end, ...(ranked ? [mark] : []));
  return holder;
}

// ---------------------------------------------------------------------------------------------- work and precision

function drawWork() {
  const [y, x] = [measure(), column[$("work-x").value]];
  if (!x || !y) return say("work", x ? "No measure was recorded." : "No cost was recorded: measure node_steps, seconds.march or steps.");
  const rows = visible(active).filter(isDone);
  const both = rows.filter((row) => Number.isFinite(x.values[row]) && Number.isFinite(y.values[row]));
  const cases = casesOf(both);
  const words = missedWords(rows.length - both.length);
  if (!cases.length) {
    $("work-note").textContent = words;
    return say("work", "No run with both values passes the filters.", { height: 380 });
  }
  const drawn = cases.slice(0, MOST_PANELS).map((code) => workPanel(both.filter((row) => column.case.codes[row] === code), x, y));
  const { panels, across, tall } = gridOfPanels("work", drawn.length);
  const tip = ({ data: [, , row] }) => tipOfRun(row, [y.label, y.values[row]], [x.label, x.values[row]]);
  show("work", {
    grid: panels, toolbox: { ...tools("work-precision", drawn.length === 1) }, tooltip: tooltip(tip),
    title: drawn.map((_, n) => titleOf(column.case.levels[cases[n]], panels[n])),
    series: drawn.flatMap(({ series, all }, n) => [...series, ...nameSeries(series, extentOf(all.map((at) => at[0])), extentOf(all.map((at) => at[1])), panels[n])].map((item) => ({ ...item, xAxisIndex: n, yAxisIndex: n }))),
    xAxis: drawn.map(({ all }, n) => ({ ...axis(x.label, extentOf(all.map((item) => item[0])), { log: x.log, gap: 30 }), gridIndex: n })),
    yAxis: drawn.map(({ all }, n) => ({ ...axis(n % across ? "" : y.label, extentOf(all.map((item) => item[1])), { log: y.log, gap: 48 }), gridIndex: n })),
  }, {
    height: tall,
    then: (chart) => (drawn.length === 1 ? followZoom(chart, { xAxis: x.log, yAxis: y.log }) : chart.off("datazoom")),
  });
  const left = cases.length > drawn.length ? `The first ${drawn.length} of ${cases.length} cases are drawn; choose one above.` : "";
  const unranked = isRanked(y) ? "" : `No lines: a smaller ${y.label} is not better.`;
  $("work-note").textContent = [left, unranked, atEdge(both.map((row) => y.values[row]), y), words].filter(Boolean).join(" ");
}

/** The points of one case and the lines of the best, of each method and of all that are no references. */
function workPanel(rows, x, y) {
  const data = placed(rows, (row) => x.values[row], x, y);
  const all = data.flat();
  if (!isRanked(y)) return { all, series: page.methods.map((method, k) => points(k, data[k], method)) };
  const compete = data.filter((_, k) => !page.references.includes(page.methods[k])).flat();
  const raw = (points) => frontOf(points.map(([, , row]) => [x.values[row], y.values[row]])).map(([a, b]) => [onAxisOf(a, x), onAxisOf(b, y)]);
  const best = { type: "line", data: raw(compete), symbol: "none", silent: true, z: 1, lineStyle: { color: looks().exact, width: 8, opacity: 0.35 } };
  const lines = page.methods.map((method, k) => ({ ...line(k, raw(data[k])), method }));
  return { all, series: [best, ...page.methods.map((method, k) => points(k, data[k], method)), ...lines] };
}

/** The names of the methods whose front is one run: larger marks with names, from below, each above the one before. */
function nameSeries(series, [left, right], [low, high], panel) {
  const lone = series.filter(({ method, data }) => method && data.length === 1).map(({ method, data: [at] }) => ({ method, at })).sort((a, b) => a.at[1] - b.at[1]);
  let last = -Infinity;
  return lone.map(({ method, at }) => {
    const k = page.methods.indexOf(method);
    const up = ((at[1] - low) / (high - low || 1)) * panel.height;
    last = Math.max(up, last + 13);
    const side = at[0] > (left + right) / 2 ? "left" : "right";
    const label = { show: true, formatter: method, position: side, distance: 9, offset: [0, up - last], color: style(k).colour, fontSize: 11, textBorderColor: looks().paper, textBorderWidth: 3, width: panel.width * 0.8, overflow: "truncate" };
    return { type: "scatter", name: "named", data: [{ value: at, label }], ...markOf(k), symbolSize: 11, z: 5, silent: true };
  });
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

function frontOf(data) {
  const out = [];
  let best = Infinity;
  for (const [x, y] of [...data].sort((a, b) => a[0] - b[0] || a[1] - b[1])) {
    if (y < best) out.push([x, (best = y)]);
  }
  return out;
}

// ---------------------------------------------------------------------------------------------- a varied value

function drawVaried() {
  const [y, x] = [measure(), column[$("vary-x").value]];
  if (!x || !y) return say("vary", "Nothing was varied.");
  const words = x.kind === "text";
  const made = visible(active).filter(isMade);
  const together = x.name === "case";
  const cases = together ? [null] : casesOf(made);
  const present = page.methods.map((_, k) => k).filter((k) => made.some((row) => methodOf[row] === k));
  const drawn = cases.slice(0, MOST_PANELS).map((code) => variedPanel(code === null ? made : made.filter((row) => column.case.codes[row] === code), x, y, words, present));
  const shown = drawn.filter(({ heights }) => heights.length);
  const missed = missedWords(made.filter((row) => isDone(row) && !(Number.isFinite(y.values[row]) && (words || lacks(methodOf[row], x) || Number.isFinite(x.values[row])))).length);
  if (!shown.length) {
    $("vary-note").textContent = missed;
    return say("vary", "No run with both values passes the filters.");
  }
  const { panels, across, tall } = gridOfPanels("vary", shown.length, words ? { bottom: 76 } : {});
  const labels = words ? x.levels.map((level) => labelOf(level) || `no ${shortName(x)}`) : null;
  const ticks = x.ticks.length ? x.ticks.map((value) => onAxisOf(value, x)) : null;
  show("vary", {
    grid: panels, toolbox: tools("varied", shown.length === 1),
    title: together ? [] : shown.map((panel, n) => titleOf(column.case.levels[cases[drawn.indexOf(panel)]], panels[n])),
    series: shown.flatMap(({ series }, n) => series.map((item) => ({ ...item, xAxisIndex: n, yAxisIndex: n }))),
    xAxis: shown.map(({ spread }, n) => ({ ...axis(x.label, spread, { log: x.log, labels, gap: words ? 54 : 30, horizontal: true, ticks }), gridIndex: n })),
    yAxis: shown.map(({ heights }, n) => ({ ...axis(n % across ? "" : y.label, extentOf(heights), { log: y.log, gap: 48 }), gridIndex: n })),
    tooltip: tooltip(({ data: point }) => point.tip || tipOfRun(point[2], [y.label, y.values[point[2]]])),
  }, { height: tall, then: (chart) => (shown.length === 1 ? followZoom(chart, { xAxis: x.log, yAxis: y.log }) : chart.off("datazoom")) });
  const notes = [
    isRanked(y) ? "" : `Lines are medians: a smaller ${y.label} is not better.`,
    cases.length > drawn.length ? `The first ${drawn.length} of ${cases.length} cases are drawn; choose one above.` : "",
    lostWords(drawn.flatMap(({ bands }) => bands.flat())), atEdge(made.filter(isDone).map((row) => y.values[row]), y), missed,
    cases.length === 1 && x.name === "refine" && x.log && y.log ? ordersOf(drawn[0].bands.map((band) => band.filter(hasLine).map((item) => putOn(x, y, item, statisticOf(y))))) : "",
  ];
  $("vary-note").textContent = notes.filter(Boolean).join(" ");
}

const hasLine = (item) => item[5] > 0 && Number.isFinite(item[0]);

/** Place, lower end and upper end of the band, height of the line, and counts of a bin on the axes. */
function putOn(x, y, [place, best, low, median, high, have, of], statistic) {
  const chosen = statistic === "best" ? best : median;
  return { at: x.kind === "text" ? place : onAxisOf(place, x), low: onAxisOf(low, y), high: onAxisOf(high, y), height: onAxisOf(chosen, y), have, of, value: chosen };
}

/** The series of one case over one varied value, and the heights that its axis is to hold. */
function variedPanel(made, x, y, words, present) {
  const statistic = statisticOf(y);
  // methods stand beside each other where the axis holds words
  const beside = (k) => (words ? (page.spread * (present.indexOf(k) - (present.length - 1) / 2)) / Math.max(present.length, 1) : 0);
  const level = page.methods.map((_, k) => !words && lacks(k, x));
  const xOf = (row) => (words ? x.codes[row] + beside(methodOf[row]) : x.values[row]);
  const data = placed(made.filter((row) => isDone(row) && !level[methodOf[row]]), xOf, words ? { log: false } : x, y);
  const rows = statistic === "best" ? made : drawnRows(made);
  const bands = page.methods.map((_, k) => bandOf(x, y, rows.filter((row) => methodOf[row] === k), beside(k), level[k]));
  const lines = bands.map((band) => band.filter(hasLine).map((item) => putOn(x, y, item, statistic)));
  const levels = bands.map((band) => band.filter((item) => item[5] > 0 && !Number.isFinite(item[0])).map((item) => putOn(x, y, item, statistic))[0]);
  const leveled = present.filter((k) => levels[k]);
  const filled = statistic === "median" && !words && present.length <= page.most_bands;
  const ends = [...lines.flat(), ...levels.filter(Boolean)].flatMap(({ height, low, high }) => (filled ? [height, low, high] : [height]));
  const heights = [...data.flat().map((at) => at[1]), ...ends];
  // where all runs failed there is no height: the ring stands below all others
  const height = Math.min(...heights);
  const gone = bands.map((band) => band.filter((item) => item[6] && !hasLine(item) && Number.isFinite(item[0])).map((item) => ({ ...putOn(x, y, item, statistic), height })));
  const spread = words ? [0, x.levels.length - 1] : extentOf([...data.flat().map(([at]) => at), ...[...lines, ...gone].flat().map(({ at }) => at), ...x.ticks.map((tick) => onAxisOf(tick, x))]);
  const counts = ({ have, of }) => (have < of ? `${statistic} of ${have} of ${of} runs, the others failed` : `${statistic} of ${counted(of, "run")}`);
  const tipOf = (k, item, where) => [page.methods[k], where, `${y.label}: ${numberText(item.value)}`, counts(item)].map(escaped).join("<br>");
  const series = page.methods.flatMap((method, k) => [
    points(k, data[k], method), ...bandSeries(k, lines[k], words, filled),
    ...rings(k, heights.length ? gone[k] : [], ({ of }) => [method, `none of ${counted(of, "run")} has a number`].map(escaped).join("<br>")),
    ...rings(k, lines[k].filter(({ have, of }) => have < of), (item) => tipOf(k, item, words ? "" : `${x.label}: ${numberText(x.log ? 10 ** item.at : item.at)}`)),
    ...(levels[k] ? levelSeries(k, levels[k], spread, spread[0] + ((leveled.indexOf(k) + 1) / (leveled.length + 1)) * (spread[1] - spread[0]), `no ${shortName(x)}`, tipOf(k, levels[k], `no ${shortName(x)}: the same at each value`)) : []),
  ]);
  return { series, bands, spread, heights };
}

/** How many of the runs behind some lines have no part in them. */
function lostWords(band) {
  const [have, of] = [5, 6].map((place) => band.reduce((sum, item) => sum + item[place], 0));
  return of > have ? `${(of - have).toLocaleString("en")} of ${counted(of, "run")} failed or have no such number: they are in no line, and rings mark where.` : "";
}

/** Over the mesh the slope of a line of each method is its observed order. */
function ordersOf(lines) {
  const orders = lines.map((line, k) => {
    if (line.length < 2) return "";
    const [x, y] = ["at", "height"].map((part) => line.reduce((sum, item) => sum + item[part], 0) / line.length);
    const slope = line.reduce((sum, item) => sum + (item.at - x) * (item.height - y), 0) / line.reduce((sum, item) => sum + (item.at - x) ** 2, 0);
    return `${page.methods[k]} ${numberText(-slope, 2)}`;
  });
  const fitted = orders.filter(Boolean);
  return fitted.length ? `Observed orders, fitted to the lines: ${fitted.join("; ")}.` : "";
}

/** Place, best, quantiles, number of values and number of runs of each bin; one bin without place for a method that lacks x. */
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
    return [[bins.places[j] + offset, ...[0, 0.1, 0.5, 0.9].map((share) => quantile(values, share)), values.length, of]];
  });
}

/** Rings around the places at which some runs failed. */
function rings(k, items, tip) {
  const { colour } = style(k);
  const data = items.map((item) => ({ value: [item.at, item.height], tip: tip(item) }));
  return [{ type: "scatter", name: "ring", data, symbol: "circle", symbolSize: 13, z: 5, itemStyle: { color: "transparent", borderColor: colour, borderWidth: 2 } }];
}

/** A level line for a method that has no such option, and what it lacks at one place of it. */
function levelSeries(k, { height }, [from, to], place, words, tip) {
  const mark = { value: [place, height], tip, label: { show: true, position: "top", formatter: words, color: looks().ink, fontSize: 12, textBorderColor: looks().paper, textBorderWidth: 2 } };
  return [line(k, [[from, height], [to, height]]), { type: "scatter", name: "level", data: [mark], ...markOf(k), symbolSize: 9, z: 5 }];
}

function bandSeries(k, items, words, filled) {
  const { colour } = style(k);
  if (words) {
    // No line joins words: a bar holds eight of ten runs, and the chosen run stands across it.
    return items.flatMap(({ at, low, high, height }) => [
      line(k, [[at, low], [at, high]], { lineStyle: { color: colour, width: 3, opacity: 0.5 } }),
      { ...line(k, [[at, height]]), symbol: "rect", symbolSize: [18, 3] },
    ]);
  }
  const edges = { symbol: "none", lineStyle: { width: 0 }, stackStrategy: "all", stack: `band${k}`, z: 2 };
  const area = filled && items.some(({ low, high }) => high > low)
    ? [
        line(k, items.map(({ at, low }) => [at, low]), edges),
        line(k, items.map(({ at, low, high }) => [at, high - low]), { ...edges, areaStyle: { color: colour, opacity: 0.16 } }),
      ]
    : [];
  return [...area, line(k, items.map(({ at, height }) => [at, height]), { ...markOf(k), symbolSize: 7, showAllSymbol: true })];
}

// ---------------------------------------------------------------------------------------------- profile

function drawProfile() {
  const y = measure();
  const profile = y && page.profiles[`${y.name}|${statisticOf(y)}`];
  $("profiles").hidden = !profile;
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

/** The cells of a map for some rows: the runs by what became of them, and the best or the median of the value. */
function cellsOf(rows, x, y, value) {
  const cells = new Map();
  for (const row of rows) {
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
    const { done = 0, unstable = 0 } = cell.counts;
    cell.made = Object.values(cell.counts).reduce((sum, many) => sum + many, 0);
    cell.measured = value ? cell.values.length : done + unstable;
    cell.value = value ? quantile(several(cell.values), statisticOf(value) === "best" ? 0 : 0.5) : done / (done + unstable);
  }
  return [...cells.values()];
}

/** The cells of a map along one side: those of the column, or a single one for a method that has no such value. */
function sideOf(k, side) {
  return lacks(k, side) ? { places: [0], labels: [`no ${shortName(side)}`] } : { ...side.bins, labels: labelsOf(side, side.bins) };
}

function drawMap() {
  const [x, y] = [column[$("map-x").value], column[$("map-y").value]];
  const value = $("map-v").value === "measure" ? measure() : null;
  const rows = drawnRows(visible(active)).filter(isMade);
  if (!x || !y || x === y || !rows.length) {
    $("map-scale").replaceChildren();
    return say("map", x && y && x !== y ? "No run passes the filters." : "A map needs two different varied values.", { height: 120 });
  }
  const together = [x.name, y.name].includes("case");
  const every = (together ? [null] : casesOf(rows)).flatMap((code) =>
    page.methods.map((method, k) => {
      const own = rows.filter((row) => methodOf[row] === k && (code === null || column.case.codes[row] === code));
      const bins = [sideOf(k, x), sideOf(k, y)];
      const of = together || column.case.levels.length === 1 ? "" : `${column.case.levels[code]}: `;
      return { title: of + method.replace(" + ", "\n+ "), method, made: own.length, bins, cells: cellsOf(own, ...bins, value) };
    }),
  ).filter(({ made }) => made);
  const panels = every.filter(({ cells }) => cells.length).slice(0, MOST_PANELS);
  if (!panels.length) return say("map", "No run has both values.", { height: 120 });
  const drawn = panels.flatMap(({ cells }) => cells.map((cell) => cell.value)).filter(Number.isFinite);
  const log = Boolean(value && value.log);
  const ends = value ? extentOf(drawn) : [0, 1];
  const scale = (v) => (log ? Math.log10(v) : v);
  const share = (v) => (ends[1] > ends[0] ? (scale(v) - scale(ends[0])) / (scale(ends[1]) - scale(ends[0])) : 0.5);
  const words = value ? `${statisticOf(value)} ${value.label}` : page.stayed;
  const roomy = drawMapPanels(panels, x, y, share, words, value);
  drawScale(words + (log ? " (logarithmic)" : ""), drawn.length ? ends : null, panels, roomy, value);
  const cells = panels.flatMap((panel) => panel.cells);
  const made = cells.reduce((sum, cell) => sum + cell.made, 0);
  const lost = cells.reduce((sum, cell) => sum + cell.made - (value ? cell.measured : cell.counts.done || 0), 0);
  const bare = [...new Set(every.filter((panel) => !panel.cells.length).map(({ method }) => method))];
  $("map-note").textContent = [
    bare.length ? `No run with both values: ${bare.join(", ")}.` : "",
    every.length > MOST_PANELS ? `The first ${MOST_PANELS} of ${every.length} panels are drawn; choose a case above.` : "",
    lost ? `${lost.toLocaleString("en")} of the ${counted(made, "run")} on the map ${value ? "failed or have no such number" : "are not done"}.` : "",
  ].filter(Boolean).join(" ");
}

/** Draw the panels, and return whether there was room for the counts of runs in the cells. */
function drawMapPanels(panels, x, y, share, words, value) {
  const look = looks();
  const { panels: grids, across, inside, up, tall } = gridOfPanels("map", panels.length, { least: 250, top: 46, bottom: 56, high: 230, widest: 420 });
  const option = { grid: grids, xAxis: [], yAxis: [], series: [], title: [] };
  let roomy = false;
  panels.forEach(({ title, bins, cells }, n) => {
    option.title.push({
      text: title, left: grids[n].left - 4, top: grids[n].top - 42,
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
  if (partial && roomy) made.push(entry(countOf(partial), `done of all runs of the cell; some failed`));
  else if (partial) made.push(entry("✕", "in a colour: some runs of the cell failed"));
  if (cells.some((cell) => !hasValue(cell) && cell.counts.unstable)) made.push(entry("✕", "unstable: no run of the cell has a number"));
  if (cells.some((cell) => !hasValue(cell) && !cell.counts.done && !cell.counts.unstable)) made.push(entry("–", "all runs of the cell refused, failed or lost"));
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
  chosen = true;
  const before = marked;
  marked = page.histories[row] ? null : row;
  if (before !== null) reformat(before);
  if (marked === null) {
    const at = picked.indexOf(row);
    if (at >= 0 && !from) picked.splice(at, 1);
    else if (at < 0) picked.push(row);
    if (picked.length > page.most_forces) reformat(picked.shift());
  }
  reformat(row);
  drawForce();
  if (!from) return;
  if (marked !== null) showRow(row);
  else $("force").closest("figure").scrollIntoView({ behavior: "smooth", block: "nearest" });
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
  const line = table.initialized && table.getRow(row); // there are no rows before
  if (line) line.reformat();
}

function pairs([time, force]) {
  const [x, y] = [unpacked(time, "<f4"), unpacked(force, "<f4")];
  return Array.from(x, (t, k) => [t, y[k]]);
}

function drawForce() {
  if (!Object.keys(page.histories).length) {
    $("force-note").textContent = `This study kept no forces: "keep: {histories: 200}" in its file keeps 200 points of each.${markedWords()}`;
    for (const id of ["force", "force-legend", "unpick"]) $(id).hidden = true;
    return;
  }
  const entries = [];
  const panels = new Map(); // the series of each case and contact
  const used = new Set();
  picked.forEach((row, n) => {
    const history = page.histories[row];
    // A run has the look of its method, further runs of a method have looks that no method of this page has.
    const look = { ...style(used.has(methodOf[row]) ? page.methods.length + n : methodOf[row]) };
    used.add(methodOf[row]);
    const words = nameOf(row) + (isDone(row) ? "" : ` (${textAt(column.status, row)})`);
    const what = column.case.levels.length > 1 ? `${textAt(column.case, row)}: ` : "";
    history.force.forEach((item, contact) => {
      const title = what + (history.contacts[contact] ?? `contact ${contact + 1}`);
      if (!panels.has(title)) panels.set(title, []);
      const series = panels.get(title);
      const exact = history.exact[contact];
      if (exact && !series.some(({ name }) => name === "exact")) {
        series.push({ type: "line", name: "exact", data: pairs(exact), symbol: "none", z: 1, lineStyle: { color: looks().exact, width: 5 }, itemStyle: { color: looks().exact } });
      }
      series.push({ type: "line", name: words, data: pairs(item), symbol: "none", z: 3, itemStyle: { color: look.colour }, lineStyle: { color: look.colour, width: 2, type: dashOf(look.dash, 2) } });
    });
    entries.push([{ ...look, shape: "" }, words]);
  });
  const anyExact = [...panels.values()].some((series) => series[0].name === "exact");
  if (anyExact) entries.unshift([{ colour: looks().exact, dash: [], width: 5 }, "exact"]);
  $("force-legend").replaceChildren(
    ...entries.map(([look, words]) => {
      const entry = element("span", "", { class: "entry" });
      entry.append(swatch(look), element("span", words));
      return entry;
    }),
  );
  $("force-note").textContent = forceNote();
  if (!panels.size) return say("force", "No run is chosen.", { height: 90 });
  const drawn = [...panels].slice(0, MOST_PANELS);
  const { panels: grids, across, tall } = gridOfPanels("force", drawn.length, { left: 74, least: 420, most: 2 });
  show("force", {
    grid: grids, toolbox: tools("force", drawn.length === 1),
    title: drawn.map(([title], n) => titleOf(title, grids[n])),
    series: drawn.flatMap(([, series], n) => series.map((item) => ({ ...item, xAxisIndex: n, yAxisIndex: n }))),
    xAxis: drawn.map(([, series], n) => ({ ...axis("time", extentOf(series.flatMap(({ data }) => data.map(([time]) => time))), { gap: 28 }), gridIndex: n })),
    yAxis: drawn.map(([, series], n) => ({ ...axis(n % across ? "" : "contact force", boundOf(series), { gap: 56 }), gridIndex: n })),
    tooltip: { ...tooltip(tipOfTime), trigger: "axis" },
  }, { height: tall, then: (chart) => (drawn.length === 1 ? followZoom(chart, { xAxis: false, yAxis: false }) : chart.off("datazoom")) });
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
  return ` ${nameOf(marked)}${key}: ${whyNoForce(marked)} The table marks its row.`;
}

function forceNote() {
  const kept = Object.keys(page.histories).length;
  const left = page.not_in_page.length;
  const without = left ? ` The study keeps those of ${counted(left, "more run")}, the worst of each pair and case, which are not in this page.` : "";
  const first = chosen ? "" : " Shown is the best run of each pair that passes the filters, in the first case.";
  return `The page has the forces of ${counted(kept, "run")}.${without}${first} At most ${page.most_forces} are drawn.${markedWords()}`;
}

let chosen = false; // whether the user chose the runs whose forces are drawn

/** The best run of each method in the first case that passes the filters, until the user chooses runs. */
function pickBest() {
  if (chosen) return;
  const y = column[page.charts.ranked[0]];
  const rows = visible(active).filter((row) => page.histories[row] && isDone(row));
  const value = (row) => (y && Number.isFinite(y.values[row]) ? y.values[row] : Infinity);
  const best = new Map();
  for (const row of rows.filter((row) => column.case.codes[row] === casesOf(rows)[0])) {
    if (!best.has(methodOf[row]) || value(row) < value(best.get(methodOf[row]))) best.set(methodOf[row], row);
  }
  const known = [...best.values()].filter((row) => !y || value(row) < Infinity);
  setPicked((known.length ? known : [...best.values()]).sort((a, b) => value(a) - value(b)).slice(0, page.most_forces), null);
}

// ---------------------------------------------------------------------------------------------- the whole

function drawStudy() {
  drawBest();
  drawWork();
  drawVaried();
  drawMap();
  drawProfile();
  pickBest();
  drawForce();
}

/** Fill a box with the names of columns, and choose one of them. */
function fill(id, names, place = 0) {
  $(id).replaceChildren(...names.map((name) => element("option", column[name].label, { value: name })));
  if (names.length) $(id).value = names[place] ?? names[0];
}

function start() {
  const { costs, results, varied, mapped, ranked } = page.charts;
  fill("measure", [...ranked, ...results.filter((name) => !ranked.includes(name))]);
  $("statistic").value = page.statistic;
  fill("work-x", costs);
  fill("vary-x", varied);
  fill("map-x", mapped);
  fill("map-y", mapped, 1);
  $("map-v").lastElementChild.textContent = page.stayed;
  $("map").closest("figure").hidden = mapped.length < 2;
  for (const id of CHOICES) {
    $(id).addEventListener("change", () => {
      drawStudy();
      noteChange(id);
    });
  }
  $("unpick").addEventListener("click", () => {
    chosen = true;
    setPicked([], null);
    drawForce();
    noteChange("runs");
  });
  drawFilters();
  redraw();
}

function redraw() {
  drawLegend();
  drawStudy();
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
