"use strict";
// The page's data, the table of runs, the filters. Text of the study reaches the page as text alone.

const page = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const MOST_PRINTED = 40;
const NAMES = ["case", "integrator", "contact"];

function unpacked(text, kind) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
  return new { "<f4": Float32Array, "<f8": Float64Array, "<u2": Uint16Array, "<i2": Int16Array }[kind](bytes.buffer);
}

/** Shares are fractions in the data and per cent on the page: `raw` are the numbers of the study, `values` those shown. */
const columns = page.columns.map((column) => {
  if (column.kind !== "text") {
    const raw = unpacked(column.data, column.kind);
    // Bins: their places on an axis, and the bin of each row, -1 for a row without one.
    const bins = column.bins && { places: column.bins.places, of: unpacked(column.bins.of, "<i2") };
    return { ...column, raw, values: column.scale ? raw.map((value) => column.scale * value) : raw, bins };
  }
  const codes = unpacked(column.data, "<u2");
  return { ...column, codes, bins: { places: column.levels.map((_, k) => k), of: codes } };
});
const column = Object.fromEntries(columns.map((field) => [field.name, field]));
const textAt = (field, row) => (field.kind === "text" ? field.levels[field.codes[row]] : numberText(field.values[row]));
const methodOf = new Int32Array(page.rows);
for (let row = 0; row < page.rows; row++) {
  methodOf[row] = page.methods.indexOf(`${textAt(column.integrator, row)} + ${textAt(column.contact, row)}`);
}
/** What became of a run: done, unstable, or lost in some other way; an empty text for a run that is still to be made. */
const outcomeOf = (row) => column.status.outcomes[column.status.codes[row]];
const isDone = (row) => outcomeOf(row) === "done";
const isMade = (row) => outcomeOf(row) !== "";
/** Rows that were added to those drawn as nothing beats them: they are in no median, which they would improve. */
const added = new Set(page.added);
/** Whether no run of a method has a varied value: its runs are the same at each value of it. */
const lacks = (method, field) => (page.lacking[field.name] || []).includes(page.methods[method]);
const shortName = (field) => field.label.split(".").pop();

let active = Array.from({ length: page.rows }, (_, row) => row);
const hidden = new Set();
const picked = [];
let marked = null; // the row that was asked for last and has no history to show

// ---------------------------------------------------------------------------------------------- words

const RAISED = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };

function numberText(value, digits = 4) {
  if (value === null || value === undefined || Number.isNaN(value)) return "";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const size = Math.abs(value);
  if (value === 0 || (size >= 1e-3 && size < 1e6)) return String(Number(value.toPrecision(digits))).replace("-", "−");
  const [head, power] = value.toExponential(digits - 1).split("e");
  const raised = String(Number(power)).replace(/./g, (letter) => RAISED[letter]);
  const factor = String(Number(head)).replace("-", "−");
  return factor === "1" ? `10${raised}` : `${factor}×10${raised}`;
}

function escaped(text) {
  return String(text).replace(/[&<>"']/g, (letter) => `&#${letter.charCodeAt(0)};`);
}

function element(tag, text = "", attributes = {}) {
  const made = document.createElement(tag);
  made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

/** A text of the table as it is read: a number among words is rounded as any other number. */
function labelOf(text) {
  return text !== "" && Number.isFinite(Number(text)) ? numberText(Number(text)) : text;
}

/** What tells a run from the others: case, method, varied values. */
function nameOf(row) {
  const cases = column.case.levels.length > 1 ? [textAt(column.case, row)] : [];
  const values = columns
    .filter((field) => field.role === "varied" && textAt(field, row) !== "")
    .map((field) => `${shortName(field)} = ${labelOf(textAt(field, row))}`);
  return [page.methods[methodOf[row]], ...cases, ...values].join(", ");
}

// ---------------------------------------------------------------------------------------------- commands

/** The command that makes the run of a row alone. */
const commandOf = (row) => `${page.command} ${textAt(column.key, row)}`;

function showCommand(row) {
  $("alone").hidden = false;
  $("alone-note").textContent = `Where the study was started, this command makes one run: ${nameOf(row)}`;
  $("command").textContent = commandOf(row);
  $("copied").textContent = "";
}

async function copyCommand() {
  let done = true;
  try {
    await navigator.clipboard.writeText($("command").textContent);
  } catch {
    // Not every browser gives a page that is a file access to the clipboard: the text is selected all the same.
    getSelection().selectAllChildren($("command"));
    done = document.execCommand("copy");
  }
  $("copied").textContent = done ? "Copied." : "It is selected: copy it from there.";
}

// ---------------------------------------------------------------------------------------------- looks

const LIGHT = { ink: "#1a1a1a", soft: "#5a5a5a", grid: "#e4e4e4", paper: "#ffffff", alarm: "#b33a00", exact: "#9a9a9a", swap: {} };
const DARK = {
  ink: "#e8e8e8", soft: "#a9aeb4", grid: "#2b3035", paper: "#15181b", alarm: "#ff8f57", exact: "#8d949b",
  swap: { "#0072B2": "#3f8fe0", "#009E73": "#17b98a", "#D55E00": "#ff7b29", "#56B4E9": "#9ad8ff", "#CC79A7": "#e59ac4", "#000000": "#ffffff" }, // dark colours are lost on a dark page
};
const prefersDark = matchMedia("(prefers-color-scheme: dark)");
let printing = false;
const looks = () => (prefersDark.matches && !printing ? DARK : LIGHT);

const SHAPES = { circle: "circle", square: "rect", triangle: "triangle", diamond: "diamond" };
const OUTLINES = {
  circle: '<circle cx="17" cy="7" r="4.5"/>', square: '<path d="M12.5 2.5h9v9h-9z"/>',
  triangle: '<path d="M17 2l5 9.5h-10z"/>', diamond: '<path d="M17 1l5 6-5 6-5-6z"/>',
};

/** The colour, mark and dashes of the k-th line. */
function style(k) {
  const { colour, mark, dash } = page.styles[k];
  return { colour: looks().swap[colour] || colour, shape: mark.replace("open ", ""), open: mark.startsWith("open"), dash };
}

/** The dashes of a line of some width in pixels. */
const dashOf = (dash, width) => (dash.length ? dash.map((length) => length * width) : "solid");

function swatch({ colour, shape, open, dash, width = 2 }) {
  const holder = document.createElement("template");
  const view = width ? "0 0 34 14" : "9 0 16 14"; // a mark without a line is narrower
  holder.innerHTML = `<svg width="${width ? 34 : 16}" height="14" viewBox="${view}" aria-hidden="true"><path d="M0 7h34" stroke="${colour}" stroke-width="${width}"
    stroke-dasharray="${dash.map((length) => length * width).join(" ")}"/><g fill="${open ? looks().paper : colour}" stroke="${colour}" stroke-width="1.5">${OUTLINES[shape] ?? ""}</g></svg>`;
  return holder.content.firstChild;
}

/** The legend of the methods, beside each chart that has one; a click hides a method in all charts. */
function drawLegend() {
  for (const legend of document.querySelectorAll(".legend.methods")) {
    const entries = page.methods.map((method, k) => {
      const entry = element("button", "", { type: "button", "aria-pressed": String(!hidden.has(k)) });
      entry.append(swatch(style(k)), element("span", method));
      entry.addEventListener("click", () => {
        if (!hidden.delete(k)) hidden.add(k);
        redraw();
        noteChange("methods");
      });
      return entry;
    });
    legend.replaceChildren(...entries);
  }
}

// ---------------------------------------------------------------------------------------------- table

/** Whether a number fits 0.5, <1e-3, >=2 or 0.1..0.5. */
function fits(value, wanted) {
  const text = wanted.replace(/\s|−/g, (letter) => (letter === "−" ? "-" : ""));
  const span = text.split("..").map(Number);
  if (span.length === 2 && !span.some(Number.isNaN)) return value >= span[0] && value <= span[1];
  const match = /^(<=|>=|<|>|=)?([-+.\de]+)$/i.exec(text);
  if (!match || Number.isNaN(Number(match[2]))) return numberText(value).includes(wanted);
  const bound = Number(match[2]);
  const near = Math.abs(value - bound) <= 1e-6 * Math.abs(bound);
  return { "<": value < bound, ">": value > bound, "<=": value <= bound || near, ">=": value >= bound || near }[match[1]] ?? near;
}

function passes(wanted, value, numeric) {
  const text = wanted.trim();
  if (text === "") return true;
  if (value === null || value === undefined) return false;
  if (numeric) return fits(value, text);
  return text.startsWith("=") ? value === text.slice(1) : value.toLowerCase().includes(text.toLowerCase());
}

function tableColumn(field, k) {
  const numeric = field.kind !== "text";
  const sample = numeric ? 9 : Math.max(...field.levels.map((level) => level.length));
  const shared = {
    title: escaped(field.label).replace(/[._]/g, "$&<wbr>"), field: `c${k}`, headerFilter: "input", headerFilterPlaceholder: numeric ? "> < .." : "contains",
    headerFilterFunc: (wanted, value, line) => (field.role === "varied" && lacks(methodOf[line.i], field)) || passes(String(wanted), value, numeric),
    width: Math.min(Math.max(8 * sample + 28, numeric ? 112 : 100, Math.min(5 * field.label.length + 44, 170)), 330),
  };
  const none = (cell) => (field.role === "varied" && lacks(methodOf[cell.getRow().getData().i], field) ? `no ${shortName(field)}` : "");
  if (!numeric) return { ...shared, formatter: field.name === "status" ? statusCell : (cell) => escaped(field.role === "varied" ? labelOf(cell.getValue()) || none(cell) : cell.getValue()) };
  return {
    ...shared, hozAlign: "right", sorter: "number", sorterParams: { alignEmptyValues: "bottom" },
    formatter: (cell) => escaped(numberText(cell.getValue()) || none(cell)),
  };
}

const COPY = { title: "command", field: "command", headerSort: false, width: 92, formatter: () => element("button", "copy", { type: "button", class: "copy" }) };

/** The columns of the table; those that name a run stay in sight as long as they leave half of it to the others. */
function tableColumns() {
  const made = shownColumns.map(([field, k]) => tableColumn(field, k));
  const names = shownColumns.filter(([field]) => NAMES.includes(field.name)).length;
  let room = $("table").clientWidth / 2;
  for (const name of made.slice(0, names)) {
    room -= name.width;
    if (room < 0) break;
    name.frozen = true;
  }
  made.splice(names, 0, COPY);
  return made;
}

function statusCell(cell) {
  const made = element("span", cell.getValue());
  if (cell.getValue() !== "done") made.className = "alarm";
  return made;
}

function tableRows() {
  return active.map((row) => {
    const line = { i: row };
    columns.forEach((field, k) => {
      const value = field.kind === "text" ? textAt(field, row) : field.values[row];
      line[`c${k}`] = Number.isNaN(value) ? null : value;
    });
    return line;
  });
}

const shownColumns = columns
  .map((field, k) => [field, k])
  .filter(([field]) => (field.kind === "text" ? field.levels.some((level) => level !== "") : field.values.some((v) => !Number.isNaN(v))));

const table = new Tabulator("#table", {
  data: tableRows(), index: "i", height: 440, layout: "fitDataFill", nestedFieldSeparator: false,
  columnDefaults: { headerWordWrap: true },
  columns: tableColumns(), placeholder: "No run passes these filters",
  rowFormatter: (row) => row.getElement().classList.toggle("picked", picked.includes(row.getData().i) || row.getData().i === marked),
});
table.on("rowClick", (event, row) => {
  if (!event.target.closest(".copy")) return pick(row.getData().i);
  showCommand(row.getData().i);
  copyCommand();
});
table.on("dataSorted", () => noteChange("order"));
table.on("dataFiltered", (_, rows) => {
  showFilters();
  noteChange("filters");
  if (rows.length === page.rows && active.length === page.rows) return; // Tabulator filters at the start too, when all is drawn
  active = rows.map((row) => row.getData().i);
  count();
  drawStudy();
});
table.on("tableBuilt", () => {
  count();
  beginAddress();
  document.documentElement.dataset.ready = "yes";
});

function count() {
  const all = page.rows.toLocaleString("en");
  const of = page.seed === null ? "" : ` of the ${page.total.toLocaleString("en")} of the study: a sample and the best`;
  $("count").textContent = active.length < page.rows ? `${active.length.toLocaleString("en")} of ${all} rows${of}` : `${all} rows${of}`;
}

$("clear").addEventListener("click", () => {
  for (const box of document.querySelectorAll("#filters select")) box.value = "";
  table.clearHeaderFilter();
});

$("copy").addEventListener("click", copyCommand);

$("csv").addEventListener("click", () => {
  const quoted = (text) => (/[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const raw = (field, row) => (field.kind === "text" ? textAt(field, row) : Number.isNaN(field.raw[row]) ? "" : String(field.raw[row]));
  const lines = table.getRows("active").map((row) => columns.map((field) => quoted(raw(field, row.getData().i))).join(","));
  const text = [columns.map((field) => quoted(field.name)).join(","), ...lines, ""].join("\n");
  const link = element("a", "", { download: "runs.csv", href: URL.createObjectURL(new Blob([text], { type: "text/csv" })) });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
});

/** A choice above the charts for every case and every varied value that has few values; it sets the table's filter. */
function drawFilters() {
  for (const [field, k] of shownColumns) {
    if (field.name !== "case" && field.role !== "varied") continue;
    const values = field.kind === "text" ? field.levels : [...new Set(field.values)].filter((v) => !Number.isNaN(v)).sort((a, b) => a - b);
    if (values.length < 2 || values.length > 16) continue;
    const chosen = element("select", "", { "data-field": `c${k}` });
    chosen.append(element("option", "all", { value: "" }));
    for (const value of values) {
      chosen.append(element("option", field.kind === "text" ? value : numberText(value), { value: field.kind === "text" ? `=${value}` : value }));
    }
    chosen.addEventListener("change", () => table.setHeaderFilterValue(`c${k}`, chosen.value));
    const label = element("label", `${field.label} `);
    label.append(chosen);
    $("filters").append(label);
  }
}

/** Let the choices above the charts show what the table is filtered by. */
function showFilters() {
  const filters = new Map(table.getHeaderFilters().map(({ field, value }) => [field, String(value)]));
  for (const chosen of document.querySelectorAll("#filters select")) {
    chosen.value = filters.get(chosen.dataset.field) ?? ""; // empty where a filter of the table is none of its choices
  }
}

/** A box for each column of the table, to show it or not. */
function drawColumnChoice() {
  const boxes = table.getColumns().map((shown) => {
    const { field, title } = shown.getDefinition();
    const box = element("input", "", { type: "checkbox", "data-field": field });
    box.checked = true;
    box.addEventListener("change", () => {
      setShown(shown, box.checked);
      noteChange("columns");
    });
    const label = element("label");
    label.append(box, ` ${field === COPY.field ? title : columns[Number(field.slice(1))].label}`);
    return label;
  });
  const all = element("button", "Show all", { type: "button" });
  all.addEventListener("click", () => {
    for (const shown of table.getColumns()) setShown(shown, true);
    noteChange("columns");
  });
  document.querySelector("#columns .controls").replaceChildren(...boxes, all);
}

function setShown(shown, on) {
  document.querySelector(`#columns input[data-field="${shown.getField()}"]`).checked = on;
  if (shown.isVisible() !== on) shown[on ? "show" : "hide"]();
}

/** On paper the first rows, as sorted and filtered, in the columns that tell most. */
function drawPrinted() {
  const wanted = ["force_error_l1", "noise", "penetration", "peak_force", "energy_max", "node_steps"];
  const chosen = shownColumns
    .map(([field]) => field)
    .filter((field) => ["integrator", "contact", "status"].includes(field.name) || field.role === "varied" || wanted.includes(field.name)
      || (field.name === "case" && field.levels.length > 1));
  const rows = table.getRows("active").slice(0, MOST_PRINTED).map((row) => row.getData().i);
  const made = element("table", "", { class: "plain" });
  const head = element("tr");
  head.append(...chosen.map((field) => element("th", field.label.split(".").pop())));
  made.createTHead().append(head); // stands again on every sheet
  for (const row of rows) {
    const line = element("tr");
    line.append(...chosen.map((field) => element("td", textAt(field, row))));
    made.append(line);
  }
  const words = active.length > rows.length ? `The first ${rows.length} of ${active.length.toLocaleString("en")} rows.` : "";
  $("printed").replaceChildren(element("p", words), made);
}
