// Filters and sorting. The state is in the address, so that a view can be linked: #track=...&information=...&sort=-rmse
const form = document.getElementById("filter"), KEYS = ["name", "track", "information"].filter(key => form.elements[key]);
const rows = [...document.querySelectorAll("[data-name]")];
const shownNames = new Set(rows.map(row => row.dataset.name)).size;
rows.forEach((row, place) => row.place = place);  // the order by rank, to go back to
let sortKey = "";

function hide(element, hidden) { element.toggleAttribute("hidden", Boolean(hidden)); }

function filter(state) {
  const fits = row => row.dataset.name.toLowerCase().includes(state.name.toLowerCase())
    && (!state.information || row.dataset.information === state.information)
    && (!state.track || !row.dataset.track || row.dataset.track === state.track);
  rows.forEach(row => hide(row, !fits(row)));
  document.querySelectorAll("[data-track]:not([data-name])").forEach(
    element => hide(element, state.track && element.dataset.track !== state.track));
  // a heading of an information class without rows, and what figures draw of hidden entrants
  document.querySelectorAll("tr.class").forEach(head => {
    let row = head.nextElementSibling, any = false;
    for (; row && !row.classList.contains("class"); row = row.nextElementSibling) any ||= !row.hidden;
    hide(head, !any);
  });
  const visible = new Set(rows.filter(fits).map(row => NAMES.indexOf(row.dataset.name)));
  document.querySelectorAll("svg [data-entrant]").forEach(
    mark => mark.style.display = visible.has(Number(mark.dataset.entrant)) ? "" : "none");
  const tables = [...document.querySelectorAll("table")].filter(table => table.tHead && table.offsetParent);
  form.querySelector("output").textContent = KEYS.some(key => state[key])
    ? `${visible.size} of ${shownNames} entrants, ${tables.length} tables` : `${shownNames} entrants`;
}

// rows of each information class by one column, missing values last; "" is the order by rank
function sort(key) {
  const down = key.startsWith("-"), column = key.replace(/^-/, "");
  document.querySelectorAll("table.sortable").forEach(table => {
    const head = [...table.querySelectorAll("th[data-key]")].find(th => th.dataset.key === column);
    table.querySelectorAll("th[aria-sort]").forEach(th => th.removeAttribute("aria-sort"));
    if (column && !head) return;
    if (head) head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const at = head && [...head.parentNode.children].indexOf(head);
    const value = row => head.dataset.sort === "text" ? row.dataset.name : parseFloat(row.children[at].dataset.value);
    const order = (a, b) => {
      if (!head) return a.place - b.place;
      const x = value(a), y = value(b);
      if (typeof x === "string") return (down ? -1 : 1) * x.localeCompare(y);
      if (isNaN(x) || isNaN(y)) return isNaN(x) - isNaN(y);
      return (down ? -1 : 1) * (x - y) || a.place - b.place;
    };
    table.querySelectorAll("tbody").forEach(body =>
      [...body.querySelectorAll("tr[data-name]")].sort(order).forEach(row => body.appendChild(row)));
  });
}

function show() {
  const address = location.hash.slice(1), asked = new URLSearchParams(address.includes("=") ? address : "");
  KEYS.forEach(key => form.elements[key].value = asked.get(key) || "");
  sortKey = asked.get("sort") || "";
  sort(sortKey);
  filter(Object.fromEntries(KEYS.map(key => [key, form.elements[key].value])));
}

function change() {
  const asked = new URLSearchParams();
  KEYS.forEach(key => form.elements[key].value && asked.set(key, form.elements[key].value));
  if (sortKey) asked.set("sort", sortKey);
  history.replaceState(null, "", asked.size ? "#" + asked : location.pathname + location.search);
  show();
}

document.querySelectorAll("th[data-key]").forEach(th => {
  const click = () => { sortKey = sortKey === th.dataset.key ? "-" + th.dataset.key : th.dataset.key; change(); };
  th.tabIndex = 0;
  th.addEventListener("click", click);
  th.addEventListener("keydown", event => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); click(); } });
});
form.addEventListener("input", change);
form.addEventListener("submit", event => event.preventDefault());
form.addEventListener("reset", () => { sortKey = ""; setTimeout(change); });
window.addEventListener("hashchange", () => { if (!location.hash || location.hash.includes("=")) show(); });
hide(form, false);
show();
