// Traces of episodes as an SVG drawing: panels over one time axis. Drawn dark on light; the page turns it round in the dark.
const Traces = (() => {
  const INK = "#1f2933", SOFT = "#5b6770", LINE = "#e6eaed", BAD = "#a8321f", DASHES = ["", "5 2.5", "1.5 2", "7 2 1.5 2"];
  const escaped = text => String(text).replace(/[&<>"]/g, c => ({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"})[c]);

  // [step, first, difference, ...] as numbers; null stays where there is no value
  function unpacked([step, ...differences]) {
    const per = Math.round(1 / step);  // a whole number divides without the error of a product with 0.001
    let whole = 0;
    return differences.map(d => d === null ? null : (whole += d, step < 1 ? whole / per : whole * step));
  }

  // an entrant's episode with its series in place of their numbers, and the error
  function opened(data, who, kind) {
    const packed = who.episodes[kind];
    if (!packed) return null;
    const of = place => place === null ? null : data.series[place];
    const episode = {name: who.name, colour: who.colour, width: who.width, failed: packed.failed, likeness: packed.reference,
      time: of(packed.time), reference: of(packed.reference), output: of(packed.output), command: of(packed.command),
      tension: packed.tension.map(([label, place]) => [label, of(place)])};
    episode.error = episode.reference.map((r, k) => r === null || episode.output[k] === null ? null : r - episode.output[k]);
    return episode;
  }

  // where in rising times the one nearest to t is
  function nearest(times, t) {
    let low = 0, high = times.length - 1;
    while (high - low > 1) { const middle = (low + high) >> 1; if (times[middle] <= t) low = middle; else high = middle; }
    return t - times[low] <= times[high] - t ? low : high;
  }

  // round numbers within a range: 1, 2 or 5 times a power of ten apart
  function ticks(low, high, count) {
    const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].find(k => k * power >= rough) * power, found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
    if (found.length < 2 && count < 64) return ticks(low, high, 2 * count);  // one tick says nothing of the scale
    return found.map(value => [value, label(value, step)]);
  }

  function label(value, step) {
    const places = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return places > 5 || Math.abs(value) >= 1e6 ? value.toExponential(1) : value.toFixed(places).replace(/^-(?=[\d.]*[1-9])/, "−").replace(/^-/, "");
  }

  // what is drawn: panels with [series, colour, width, dash, times]
  function panels(episodes, units) {
    const line = (e, values, dash = "") => ({values, times: e.time, colour: e.colour, width: e.width, dash});
    const references = episodes.filter((e, k) => episodes.findIndex(o => o.likeness === e.likeness && o.time === e.time) === k);
    const found = [
      {key: "output", title: `reference and output [${units.output}]`, tall: true, lines:
        [...episodes.map(e => line(e, e.output)), ...references.map(e => ({...line(e, e.reference, "4 2"), colour: INK, width: 1.1}))]},
      {key: "error", title: `error: reference − output [${units.output}]`, lines: episodes.map(e => line(e, e.error))},
      {key: "tension", title: `tension [${units.tension}]`, lines: episodes.flatMap(e => e.tension.map(([, values], k) => line(e, values, DASHES[k % 4])))},
      {key: "command", title: `command [${units.command}]`, lines: episodes.filter(e => e.command).map(e => line(e, e.command))},
    ];
    return found.filter(panel => panel.lines.length);
  }

  // lowest and highest value within the window, with some room
  function range(lines, from, to) {
    let low = Infinity, high = -Infinity;
    for (const {values, times} of lines) {
      const first = Math.max(nearest(times, from) - 1, 0), last = Math.min(nearest(times, to) + 1, times.length - 1);
      for (let k = first; k <= last; k++) if (values[k] !== null) { low = Math.min(low, values[k]); high = Math.max(high, values[k]); }
    }
    if (low > high) [low, high] = [0, 1];
    const room = 0.06 * (high - low) || 0.05 * Math.abs(high) || 1;
    return [low - room, high + room];
  }

  // the drawing, and its frame: times to pixels and back
  function drawing(episodes, units, from, to, width) {
    const small = width < 520, left = small ? 50 : 62, right = 10, foot = 34, gap = 26;
    const x = t => left + (t - from) / (to - from) * (width - left - right);
    const parts = [];
    let top = 20;
    panels(episodes, units).forEach((panel, k) => {
      const height = panel.tall ? (small ? 150 : 200) : (small ? 90 : 115), [low, high] = range(panel.lines, from, to);
      const y = value => top + height - (value - low) / (high - low) * height, place = top;
      parts.push(`<clipPath id="panel-${k}"><rect x="${left}" y="${place}" width="${width - left - right}" height="${height}"/></clipPath>`);
      parts.push(`<text x="${left}" y="${place - 6}" fill="${INK}">${escaped(panel.title)}</text>`);
      for (const [value, text] of ticks(low, high, height / 32))
        parts.push(`<path d="M${left} ${y(value).toFixed(1)}H${width - right}" stroke="${LINE}"/><text x="${left - 5}" y="${(y(value) + 4).toFixed(1)}" text-anchor="end" fill="${SOFT}">${text}</text>`);
      for (const [t] of ticks(from, to, width / 90))
        parts.push(`<path d="M${x(t).toFixed(1)} ${place}V${place + height}" stroke="${LINE}"/>`);
      parts.push(`<g clip-path="url(#panel-${k})" fill="none" stroke-linejoin="round">`);
      for (const one of panel.lines) parts.push(`<path d="${path(one, x, y, from, to)}" stroke="${one.colour}" stroke-width="${one.width}"${one.dash ? ` stroke-dasharray="${one.dash}"` : ""}/>`);
      if (panel.key === "output" || panel.key === "error") for (const e of episodes.filter(e => e.failed)) {
        const values = e[panel.key], last = values.findLastIndex(v => v !== null);
        if (last >= 0) parts.push(`<path class="failure" d="M${(x(e.time[last]) - 5).toFixed(1)} ${(y(values[last]) - 5).toFixed(1)}l10 10m0 -10l-10 10" stroke="${BAD}" stroke-width="2.4"/>`);
      }
      parts.push("</g>");
      top += height + gap;
    });
    const end = Math.max(top - gap, 20);
    for (const [t, text] of ticks(from, to, width / 90)) parts.push(`<text x="${x(t).toFixed(1)}" y="${end + 16}" text-anchor="middle" fill="${SOFT}">${text}</text>`);
    parts.push(`<text x="${(left + width - right) / 2}" y="${end + 31}" text-anchor="middle" fill="${INK}">time [s]</text>`);
    const marks = `<rect data-part="chosen" y="20" height="${end - 20}" width="0" fill="#1b6ca8" opacity="0.18"/><path data-part="cursor" d="M0 20V${end}" stroke="${SOFT}"/>`;
    return {
      svg: `<svg viewBox="0 0 ${width} ${end + foot}" width="${width}" height="${end + foot}" font-size="12">${parts.join("")}${marks}</svg>`,
      left, right: width - right, x, time: pixel => from + (pixel - left) / (width - left - right) * (to - from),
    };
  }

  function path({values, times}, x, y, from, to) {
    const first = Math.max(nearest(times, from) - 1, 0), last = Math.min(nearest(times, to) + 1, times.length - 1);
    let text = "", pen = false;
    for (let k = first; k <= last; k++) {
      if (values[k] === null) { pen = false; continue; }
      text += `${pen ? "L" : "M"}${x(times[k]).toFixed(1)} ${y(values[k]).toFixed(1)}`;
      pen = true;
    }
    return text;
  }

  return {unpacked, opened, nearest, ticks, panels, drawing};
})();
