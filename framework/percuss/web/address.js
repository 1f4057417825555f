// The state of the page in its address: all that was chosen and differs from how the page begins, after the #.

const beginning = {}; // the choices with which the page begins
let addressed = null; // the state in the address; null until the page has begun
let lastChanged = ""; // what was changed last: further changes of it are no further steps back
let section = ""; // the part of the page that was asked for

const fieldNamed = (name) => (Object.hasOwn(column, name) ? `c${columns.indexOf(column[name])}` : null);
const nameOfField = (field) => (field === COPY.field ? "command" : columns[Number(field.slice(1))].name);
/** The word for a row in an address: the key of its run, which the same run has in a later page too. */
const wordOfRow = (row) => (column.key ? textAt(column.key, row) : String(row));

function rowOfWord(word) {
  if (!column.key) return /^\d+$/.test(word) && Number(word) < page.rows ? Number(word) : -1;
  const code = column.key.levels.indexOf(word);
  return code < 0 ? -1 : column.key.codes.indexOf(code);
}

function stateText() {
  const state = new URLSearchParams();
  if (section) state.set("at", section);
  for (const id of CHOICES) if ($(id).value !== beginning[id]) state.set(id, $(id).value);
  for (const k of hidden) state.append("without", page.methods[k]);
  for (const { field, value } of table.getHeaderFilters()) if (value !== "") state.append("only", `${nameOfField(field)}=${value}`);
  for (const { field, dir } of table.getSorters()) state.append("sort", `${dir} ${nameOfField(field)}`);
  for (const shown of table.getColumns()) if (!shown.isVisible()) state.append("fold", nameOfField(shown.getField()));
  if (chosen) for (const word of picked.length ? picked.map(wordOfRow) : [""]) state.append("run", word);
  if (marked !== null) state.set("row", wordOfRow(marked));
  return state.toString();
}

/** Write the state into the address; a second change in a row of the same kind replaces the first. */
function noteChange(kind) {
  if (addressed === null) return;
  const text = stateText();
  if (text === addressed) return;
  history[kind === lastChanged ? "replaceState" : "pushState"](null, "", `#${text}`);
  [addressed, lastChanged] = [text, kind];
}

/** Make the page what an address says; unknown names are ignored. */
function restore(address) {
  const plain = !address.includes("=");
  const state = new URLSearchParams(plain ? "" : address);
  const asked = plain ? address : state.get("at") ?? "";
  addressed = null;
  for (const id of CHOICES) {
    $(id).value = state.get(id) ?? beginning[id];
    if ($(id).selectedIndex < 0) $(id).value = beginning[id];
  }
  hidden.clear();
  for (const method of state.getAll("without")) if (page.methods.includes(method)) hidden.add(page.methods.indexOf(method));
  restoreTable(state);
  const words = state.getAll("run");
  const rows = words.map(rowOfWord).filter((row) => page.histories[row]);
  const row = state.has("row") ? rowOfWord(state.get("row")) : -1;
  chosen = words.length > 0 || row >= 0;
  if (chosen) setPicked(rows.slice(0, page.most_forces), row < 0 ? null : row);
  redraw();
  if (asked !== section && document.querySelector("main").contains($(asked))) $(asked).scrollIntoView({ behavior: "instant" });
  section = document.querySelector("main").contains($(asked)) ? asked : "";
  [addressed, lastChanged] = [stateText(), ""];
}

function restoreTable(state) {
  const folded = state.getAll("fold");
  for (const shown of table.getColumns()) setShown(shown, !folded.includes(nameOfField(shown.getField())));
  const filters = new Map();
  for (const only of state.getAll("only")) {
    const field = table.getColumns().map((shown) => shown.getField()).find((field) => only.startsWith(`${nameOfField(field)}=`));
    if (field && field !== COPY.field) filters.set(field, only.slice(nameOfField(field).length + 1));
  }
  for (const { field } of table.getHeaderFilters()) if (!filters.has(field)) table.setHeaderFilterValue(field, "");
  for (const [field, value] of filters) table.setHeaderFilterValue(field, value);
  const sorters = state.getAll("sort").map((text) => [fieldNamed(text.slice(text.indexOf(" ") + 1)), text.split(" ")[0]]);
  const known = sorters.filter(([field, dir]) => field && table.getColumn(field) && ["asc", "desc"].includes(dir));
  if (known.length) table.setSort(known.map(([name, dir]) => ({ column: name, dir })));
  else if (table.getSorters().length) table.clearSort(); // the rows stand as in the study again
}

/** Called once, when the table stands: from now on the address follows the page, and the page the address. */
function beginAddress() {
  for (const id of CHOICES) beginning[id] = $(id).value;
  drawColumnChoice();
  const address = location.hash.slice(1);
  if (address) restore(address);
  else addressed = stateText();
  addEventListener("popstate", () => restore(location.hash.slice(1)));
  document.addEventListener("click", (event) => {
    const link = event.target.closest('a[href^="#"]');
    if (!link) return;
    event.preventDefault(); // the address of the link alone would drop what was chosen
    section = link.getAttribute("href").slice(1);
    noteChange("at");
    $(section).scrollIntoView();
  });
}
