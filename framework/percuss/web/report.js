"use strict";
// The charts with what their reader chooses, and the table of the runs. Text of the study reaches the page as text alone.

const page = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const rows = page.rows.row.map((_, k) => Object.fromEntries(Object.entries(page.rows).map(([name, values]) => [name, values[k]])));
const prefersDark = matchMedia("(prefers-color-scheme: dark)");
const views = {};
let active = rows; // those that pass the filters
let picked = page.first; // those whose forces are drawn
let drawn = Promise.resolve(); // once all is drawn that was to be drawn
const stale = new Set(); // charts that are to be drawn anew when they are seen

// ---------------------------------------------------------------------------------------------- charts

/** A chart with values in the places of its marks. */
function filled(chart, marks) {
  return JSON.parse(JSON.stringify(chart).replace(/"\$(\w+)"|\$(\w+)/g, (_, whole, part) => (whole ? JSON.stringify(marks[whole]) : marks[part])));
}

/** The marks of a column at one side of a chart. */
function sideMarks(side, name) {
  return Object.fromEntries(Object.entries(page.axes[name]).map(([key, value]) => [`${side}_${key}`, value]));
}

/** Draw a chart; it stands in as many columns as there is room for. */
async function draw(id, data, marks, panels = 1, least = 380) {
  const [wide, look] = [$(id).clientWidth, page.looks[prefersDark.matches ? "dark" : "light"]];
  const bare = ["best", "map"].includes(id);
  const beside = wide > 800 && !bare;
  const room = wide - (beside ? 270 : bare ? 40 : 0); // without a legend, or the menu that stands at the right
  const columns = Math.max(1, Math.min(panels, Math.floor(room / least)));
  const width = Math.floor(room / columns) - (id === "best" ? 24 : 74);
  const legend = { ...look.config.legend, orient: beside ? "right" : "bottom", columns: 1 };
  const size = { columns, width: id === "map" ? Math.min(width, 420) : width, height: Math.min(300, 0.75 * width), best_scale: { ...marks.y_scale, range: [0, 0.68 * width] } };
  const spec = { ...filled(page.charts[id], { ...look.marks, ...marks, ...size }), datasets: data, config: { ...look.config, legend } };
  views[id]?.finalize();
  const actions = { export: true, source: false, compiled: false, editor: false };
  const renderer = rows.length > 2000 ? "canvas" : "svg"; // marks of many runs are drawn faster on a canvas
  views[id] = await vegaEmbed($(id), spec, { ast: true, renderer, actions, downloadFileName: id, logLevel: 1 });
  views[id].view.addEventListener("click", (_, item) => Number.isInteger(item?.datum?.row) && pick(item.datum.row, true));
}

/** What each chart takes of the choices: its data, its marks, and its number of panels. */
const charts = {
  best: () => [shown(), { ...measured(), ...sideMarks("x", $("measure").value) }, countOf("case"), 500],
  work: () => [shown(), { ...measured(), ...sideMarks("x", $("work_x").value) }, countOf("case")],
  vary: () => [shown(), { ...measured(), ...sideMarks("x", $("vary_x").value) }, $("vary_x").value === "case" ? 1 : countOf("case")],
  profile: () => {
    const { lines, label } = profileNow();
    return [{ profile: lines }, { profile_label: label }];
  },
  force: () => forces(),
  map: () => {
    const value = $("map_v").value || $("measure").value;
    const statistic = $("map_v").value ? "mean" : measured().statistic;
    return [shown(), { ...sideMarks("v", value), statistic, ...sideMarks("x", $("map_x").value), ...sideMarks("y", $("map_y").value) }, countOf("case") * countOf("pair"), 260];
  },
};
const shown = () => ({ rows: active.map((row) => ({ ...row })) }); // each chart computes fields of its own
const countOf = (name) => new Set(active.map((row) => row[name])).size;

const profileNow = () => page.profiles[`${$("measure").value}|${$("statistic").value}`];

/** The marks of the measure: a smaller value of one that ranks nothing is not better, and has no best run. */
function measured() {
  const marks = sideMarks("y", $("measure").value);
  return { ...marks, statistic: marks.y_ranked === "true" ? $("statistic").value : "median" };
}

function paint(id) {
  if (!stale.delete(id)) return;
  drawn = drawn.then(() => draw(id, ...charts[id]()));
}

/** Drawing takes most of the time: each chart is drawn when it comes near to what is seen of the page. */
const near = new IntersectionObserver((seen) => seen.filter((one) => one.isIntersecting).forEach((one) => paint(one.target.id)), { rootMargin: "100px" });

function redraw(ids = Object.keys(charts)) {
  const profile = profileNow();
  $("profile_note").textContent = profile ? profile.note : "";
  const there = {
    best: page.measures.length, work: page.costs.length && page.measures.length, vary: page.across.length && page.measures.length,
    profile: profile?.lines.length, force: forces()[0].forces.length, map: page.mapped.length > 1,
  };
  for (const id of ids) {
    $(id).hidden = !there[id];
    $(id).parentElement.hidden = $(id).hidden && !{ force: true, profile }[id]; // these two have a note
    near.unobserve($(id));
    if ($(id).hidden) continue;
    stale.add(id);
    near.observe($(id));
  }
}

const shortText = (value) => (typeof value === "number" ? String(Number(value.toPrecision(4))) : value ?? "");

/** What tells a run from the others: its pair of methods, its case and its varied values. */
function nameOf(row) {
  const values = Object.entries(page.varied).filter(([, field]) => rows[row][field] !== null && rows[row][field] !== "");
  return [rows[row].pair, ...values.map(([name, field]) => `${name.split(".").pop()}=${shortText(rows[row][field])}`)].join(" ");
}

/** The forces of the picked runs: each has the colour of its pair, and dashes of its own. */
function forces() {
  const known = picked.filter((row) => page.histories[row]);
  const forces = [];
  for (const row of known) {
    for (const [contact, lines] of Object.entries(page.histories[row])) {
      lines.forEach(([time, force], k) => time.forEach((t, n) => forces.push({ row, run: k ? "exact" : nameOf(row), contact, time: t, force: force[n] })));
    }
  }
  const { colours, dashes } = page.looks[prefersDark.matches ? "dark" : "light"].marks;
  const pair = (row) => page.pairs.indexOf(rows[row].pair);
  const isFirst = (row, n) => !known.slice(0, n).some((other) => pair(other) === pair(row));
  const marks = {
    runs: ["exact", ...known.map(nameOf)],
    run_colours: ["#9a9a9a", ...known.map((row) => colours[pair(row)])],
    run_dashes: [[1, 0], ...known.map((row, n) => dashes[(isFirst(row, n) ? pair(row) : n + 1) % dashes.length])],
  };
  return [{ forces }, marks, new Set(forces.map(({ contact }) => contact)).size];
}

/** Show a run: its force where one was kept, its row, and the command that makes it alone. */
function pick(row, fromChart = false) {
  const before = picked;
  const chosen = before === page.first ? [] : before;
  picked = chosen.includes(row) ? chosen.filter((other) => other !== row) : [...chosen, row].slice(-page.most_forces);
  for (const changed of new Set([...before, ...picked])) table.getRow(changed).reformat();
  $("chosen").textContent = `${nameOf(row)} (${rows[row].case}, ${rows[row].status})${page.histories[row] ? "" : ": this page has no force of it"}. This command makes the run alone:`;
  $("command").textContent = `${page.command} ${rows[row].key}`;
  $("command").hidden = false;
  if (fromChart) $(page.histories[row] ? "force" : "chosen").scrollIntoView({ behavior: "smooth", block: "nearest" });
  redraw(["force"]);
}

// ---------------------------------------------------------------------------------------------- table

/** Whether a number fits 0.5, <1e-3, >=2 or 0.1..0.5. */
function fits(value, wanted) {
  const [low, high] = wanted.split("..").map(Number);
  if (high !== undefined) return value >= low && value <= high;
  const [, sign, text] = /^(<=|>=|<|>|=)?(.*)$/.exec(wanted);
  const bound = Number(text);
  const near = Math.abs(value - bound) <= 1e-6 * Math.abs(bound);
  return { "<": value < bound, ">": value > bound, "<=": value <= bound || near, ">=": value >= bound || near }[sign] ?? near;
}

function passes(wanted, value, { number, varied }) {
  const text = wanted.replaceAll(" ", "");
  if (value === null || value === "") return varied;
  if (number) return fits(value, text);
  return wanted.startsWith("=") ? value === wanted.slice(1) : value.toLowerCase().includes(wanted.toLowerCase());
}

const escaped = (text) => String(text).replace(/[&<>"']/g, (letter) => `&#${letter.charCodeAt(0)};`);
const table = new Tabulator("#table", {
  data: rows, index: "row", height: 440, layout: "fitDataFill", nestedFieldSeparator: false, placeholder: "No run passes these filters",
  rowFormatter: (row) => row.getElement().classList.toggle("picked", picked.includes(row.getData().row)),
  columnDefaults: { headerWordWrap: true, headerFilter: "input", minWidth: 100, maxWidth: 330 },
  columns: page.columns.map((column) => ({
    title: `<span title="${escaped(column.what)}">${escaped(column.title)}</span>`, titleDownload: column.name, field: column.field, sorter: column.number ? "number" : "string",
    sorterParams: { alignEmptyValues: "bottom" }, hozAlign: column.number ? "right" : "left", frozen: innerWidth > 900 && column.names,
    headerFilterPlaceholder: column.number ? "> < .." : "contains", headerFilterFunc: (wanted, value) => passes(wanted, value, column),
    formatter: (cell) => escaped(shortText(cell.getValue())), accessorDownload: (_, row) => row[column.raw],
  })),
});
table.on("rowClick", (_, row) => pick(row.getData().row));
table.on("dataFiltered", (filters, kept) => {
  if (kept.length === rows.length && active.length === rows.length) return;
  active = kept.map((row) => rows[row.getData().row]);
  $("count").textContent = `${active.length} of ${rows.length} rows`;
  for (const chosen of document.querySelectorAll("#filters select")) chosen.value = filters.find(({ field }) => field === chosen.name)?.value ?? "";
  redraw();
});
$("clear").addEventListener("click", () => table.clearHeaderFilter());
$("csv").addEventListener("click", () => table.download("csv", "runs.csv"));

// ---------------------------------------------------------------------------------------------- choices

function fill(select, options, place = 0) {
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  select.selectedIndex = options.length > place ? place : 0;
}

const named = (names) => names.map((name) => [name, page.axes[name].label]);
fill($("measure"), named(page.measures));
fill($("work_x"), named(page.costs));
fill($("vary_x"), named(page.across));
fill($("map_x"), named(page.mapped));
fill($("map_y"), named(page.mapped), 1);
$("statistic").value = page.statistic;
for (const select of document.querySelectorAll("#charts select")) select.addEventListener("change", () => redraw());
for (const [name, field, values] of page.filters) {
  const [label, select] = [document.createElement("label"), document.createElement("select")];
  select.name = field;
  fill(select, [["", "all"], ...values.map((value) => [typeof value === "number" ? value : `=${value}`, shortText(value)])]);
  select.addEventListener("change", () => table.setHeaderFilterValue(field, select.value));
  label.append(`${name} `, select);
  $("filters").append(label);
}
$("force_note").textContent = page.force_note;
$("count").textContent = `${rows.length} rows`;
prefersDark.addEventListener("change", () => redraw());
let width = innerWidth;
addEventListener("resize", () => {
  if (innerWidth === width) return;
  width = innerWidth;
  redraw();
});
redraw();
table.on("tableBuilt", () => setTimeout(() => drawn.then(() => (document.documentElement.dataset.ready = "yes"))));
