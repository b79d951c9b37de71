// The viewer of traces: which entrants and episode, the window of time, and the cursor that reads values.
(() => {
  const data = JSON.parse(document.getElementById("episodes").textContent), box = document.getElementById("viewer");
  data.series = data.series.map(Traces.unpacked);
  const frame = box.querySelector(".traces"), controls = box.elements, table = box.querySelector("table");
  const list = box.querySelector("fieldset"), STEP = 1000, LEAST = 0.002;
  let track, episodes = [], whole = 1, from = 0, to = 1, cursor = null, view = null, asked = false;

  const kind = () => controls.kind.value;
  const made = (name, text) => Object.assign(document.createElement(name), {textContent: text});

  function chooseTrack() {
    track = data.tracks.find(t => !controls.track || t.name === controls.track.value);
    const kept = new Set([...list.querySelectorAll("input:checked")].map(i => i.value)), known = track.entrants.some(who => kept.has(who.name));
    list.replaceChildren(made("legend", "Entrants"), ...track.entrants.map(who => {
      const label = made("label", ""), tick = made("input", ""), key = made("span", "");
      Object.assign(tick, {type: "checkbox", name: "who", value: who.name, checked: known ? kept.has(who.name) : who.ticked});
      key.className = "key"; key.style.background = who.colour;
      label.append(tick, " ", key, who.name);
      return label;
    }));
    chooseEpisodes();
  }

  function chooseEpisodes() {
    const ticked = new Set([...list.querySelectorAll("input:checked")].map(i => i.value)), before = whole;
    episodes = track.entrants.filter(who => ticked.has(who.name)).map(who => Traces.opened(data, who, kind())).filter(e => e);
    whole = Math.max(0, ...episodes.map(e => e.time.at(-1))) || before;
    if (to === before || to > whole) to = whole;
    if (from >= to) from = 0;
    draw();
  }

  function draw() {
    const width = Math.max(frame.clientWidth, 260);
    view = Traces.drawing(episodes, data.units, from, to, width);
    frame.innerHTML = view.svg;
    controls.from.value = STEP * from / whole; controls.to.value = STEP * to / whole;
    controls.from.setAttribute("aria-valuetext", `${from.toFixed(2)} s`); controls.to.setAttribute("aria-valuetext", `${to.toFixed(2)} s`);
    const lines = episodes[0] ? episodes[0].tension.map(([label], k) => `${label} ${["solid", "dashed", "dotted", "dash-dotted"][k % 4]}`) : [];
    box.querySelector("figcaption").textContent = episodes.length
      ? `The ${kind()} episode. The reference is dashed in the ink of the page${lines.length > 1 ? `; tensions: ${lines.join(", ")}` : ""}. A red cross marks where an episode failed.`
      : "No entrant is chosen.";
    read();
  }

  function read() {
    const at = cursor === null ? from : Math.min(Math.max(cursor, from), to), line = frame.querySelector("[data-part=cursor]");
    line.setAttribute("transform", `translate(${view.x(at).toFixed(1)})`);
    const {output, tension, command} = data.units, places = [...new Set(episodes.flatMap(e => e.tension.map(([label]) => label)))];
    const heads = [["reference", output], ["output", output], ["error", output], ...places.map(place => [`tension, ${place}`, tension]),
      ...(episodes.some(e => e.command) ? [["command", command]] : [])];
    const row = made("tr", "");
    row.append(made("th", "controller"), ...heads.map(([name, unit]) => { const th = made("th", name); th.append(made("small", unit)); return th; }));
    table.tHead.replaceChildren(row);
    table.tBodies[0].replaceChildren(...episodes.map(e => values(e, at, places, heads.length)));
    table.caption.textContent = `Values at ${at.toFixed(2)} s`;
  }

  function values(e, at, places, count) {
    const row = made("tr", ""), name = made("td", ""), key = made("span", ""), over = at > e.time.at(-1) + 1e-6;
    key.className = "key"; key.style.background = e.colour; name.className = "name"; name.append(key, e.name);
    if (e.failed) { const bad = made("small", `failed at ${e.time.at(-1).toFixed(2)} s`); bad.className = "bad"; name.append(bad); }
    const k = Traces.nearest(e.time, at), tension = place => (e.tension.find(([label]) => label === place) || [])[1];
    const found = [e.reference, e.output, e.error, ...places.map(tension), e.command].slice(0, count);
    row.append(name, ...found.map(series => made("td", over || !series || series[k] === null ? "–" : shown(series[k]))));
    return row;
  }

  const shown = value => value === 0 ? "0" : (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e6 ? value.toExponential(2) : Number(value.toPrecision(4)).toString()).replace("-", "−");

  // a window that is no smaller than a few samples and within the episode
  function zoom(a, b) {
    const least = LEAST * whole;
    if (b - a < least) { const middle = (a + b) / 2; a = middle - least / 2; b = middle + least / 2; }
    const length = Math.min(b - a, whole);
    from = Math.min(Math.max(a, 0), whole - length); to = from + length;
    if (to > whole * (1 - 1e-9)) to = whole;
    if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; draw(); }); }
  }
  const point = t => { cursor = Math.min(Math.max(t, from), to); read(); };

  // pointers: a mouse drags a window, one finger moves the cursor, two fingers pinch
  const down = new Map();
  let start = null, pinch = null;
  const time = event => view.time(event.clientX - frame.getBoundingClientRect().left);
  frame.addEventListener("pointerdown", event => {
    down.set(event.pointerId, event.clientX);
    frame.setPointerCapture(event.pointerId);
    if (event.pointerType !== "touch") start = time(event);
    if (down.size === 2) { start = null; pinch = [...down.keys()].map(id => [id, view.time(down.get(id) - frame.getBoundingClientRect().left)]); }
    if (down.size === 1) point(time(event));
  });
  frame.addEventListener("pointermove", event => {
    if (down.has(event.pointerId)) down.set(event.pointerId, event.clientX);
    if (pinch && down.size === 2) return pinched();
    const now = time(event);
    if (start !== null) {
      const [a, b] = [start, now].map(t => view.x(Math.min(Math.max(t, from), to))).sort((p, q) => p - q), chosen = frame.querySelector("[data-part=chosen]");
      chosen.setAttribute("x", a); chosen.setAttribute("width", b - a);
    }
    point(now);
  });
  // the times that were under both fingers stay under them
  function pinched() {
    const edge = frame.getBoundingClientRect(), [p, q] = pinch.map(([id]) => down.get(id) - edge.left), [s, t] = pinch.map(([, at]) => at);
    if (Math.abs(p - q) < 10) return;
    const scale = (t - s) / (q - p);
    if (scale > 0) zoom(s + (view.left - p) * scale, s + (view.right - p) * scale);
  }
  function up(event) {
    const end = time(event);
    down.delete(event.pointerId);
    if (pinch) { if (!down.size) pinch = null; return; }
    if (start !== null && Math.abs(view.x(end) - view.x(start)) > 8) zoom(...[start, end].map(t => Math.min(Math.max(t, from), to)).sort((a, b) => a - b));
    start = null;
    frame.querySelector("[data-part=chosen]").setAttribute("width", 0);
  }
  frame.addEventListener("pointerup", up);
  frame.addEventListener("pointercancel", event => { down.delete(event.pointerId); start = pinch = null; frame.querySelector("[data-part=chosen]").setAttribute("width", 0); });
  frame.addEventListener("dblclick", () => zoom(0, whole));

  frame.addEventListener("keydown", event => {
    const at = cursor ?? from, step = (event.shiftKey ? 10 : 1) * (to - from) / 200, half = (to - from) / 2;
    const keys = {
      ArrowLeft: () => point(at - step), ArrowRight: () => point(at + step), Home: () => point(from), End: () => point(to),
      "+": () => zoom(at - half / 2, at + half / 2), "=": () => zoom(at - half / 2, at + half / 2), "-": () => zoom(at - 2 * half, at + 2 * half),
      "0": () => zoom(0, whole), Escape: () => zoom(0, whole),
    };
    if (keys[event.key] && !event.ctrlKey && !event.metaKey && !event.altKey) { event.preventDefault(); keys[event.key](); }
  });

  box.addEventListener("input", event => {
    const {name} = event.target;
    if (name === "track") chooseTrack();
    else if (name === "from") zoom(Math.min(event.target.value / STEP * whole, to - LEAST * whole), to);
    else if (name === "to") zoom(from, Math.max(event.target.value / STEP * whole, from + LEAST * whole));
    else chooseEpisodes();
  });
  controls.whole.addEventListener("click", () => zoom(0, whole));
  box.addEventListener("submit", event => event.preventDefault());
  box.hidden = false;
  chooseTrack();
  new ResizeObserver(() => { if (view && Math.abs(frame.clientWidth - frame.firstChild.clientWidth) > 1) draw(); }).observe(frame);
})();
