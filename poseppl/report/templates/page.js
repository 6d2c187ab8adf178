// Data, colours and charts; `page` is what other scripts of the page build on.
const page = (function () {
  "use strict";
  const dark = matchMedia("(prefers-color-scheme: dark)");
  // Colours of charts by night; the others are seen on both grounds.
  const night = {
    "#1b1b1e": "#f4f5f6", "#1f6f8b": "#6cc5e0", "#6db3c9": "#3f7f96", "#cfe6ee": "#1f4755", "#e4572e": "#ff8f66", "#e7e9ec": "#353b43",
    "#69727d": "#a7b0ba", "#22262b": "#e8eaed", white: "#1b1f24", "#882255": "#d1056b", "#e69f00": "#f9c31f", "#44aa99": "#6060fb", "#d6b0d8": "#8c59c0",
  };
  dark.addEventListener("change", () => location.reload());

  // Plotly reads a few HTML tags in texts: what comes from a result is escaped here, and nowhere else.
  const escape = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

  function nested(flat, shape) {
    if (shape.length < 2) return flat;
    const size = flat.length / shape[0];
    return Array.from({ length: shape[0] }, (_, row) => nested(flat.slice(row * size, (row + 1) * size), shape.slice(1)));
  }

  // The inverse of to_json in page.py.
  function decoded({ codes, shape, low, step }) {
    const bytes = Uint8Array.from(atob(codes), (letter) => letter.charCodeAt(0));
    const digits = 10 ** Math.max(0, Math.min(12, 1 - Math.floor(Math.log10(step))));
    const value = (code) => (code === 65535 ? null : Math.round((low + code * step) * digits) / digits);
    return nested(Array.from(new Uint16Array(bytes.buffer), value), shape);
  }

  function read(id) {
    let arrays = null; // parsed before what refers to them
    return JSON.parse(document.getElementById(id)?.textContent ?? "null", (key, value) => {
      if (typeof value === "string") return key === "hovertemplate" || key === "codes" ? value : dark.matches && night[value] ? night[value] : escape(value);
      if (key === "arrays" && arrays === null) return (arrays = value.map(decoded));
      return value && typeof value.array === "number" ? arrays[value.array] : value;
    })?.value ?? null;
  }

  const charts = read("charts-data");
  const element = (id) => document.getElementById(id);
  const named = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const lit = (color) => (dark.matches && night[color]) || color;
  const narrow = () => innerWidth < 640;
  const colors = {
    mean: lit("#1f6f8b"), draw: lit("#6db3c9"), observed: lit("#e4572e"), truth: lit("#1b1b1e"), grid: lit("#e7e9ec"), floor: named("--floor"),
    ink: named("--ink"), panel: named("--panel"), missing: named("--missing"), flesh: named("--flesh"), muted: named("--muted"),
  };
  const config = { responsive: true, displayModeBar: false };
  const axis = { gridcolor: colors.grid, linecolor: colors.grid, zeroline: false, automargin: true };
  const theme = {
    layout: {
      font: { family: "system-ui, sans-serif", size: 12, color: colors.ink }, paper_bgcolor: colors.panel, plot_bgcolor: colors.panel, hovermode: "x unified",
      margin: { l: narrow() ? 40 : 60, r: 16, t: 20, b: 44 }, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, xaxis: axis, yaxis: axis,
      hoverlabel: { bgcolor: colors.panel, font: { color: colors.ink } },
      dragmode: matchMedia("(pointer: coarse)").matches ? false : "zoom", // a finger scrolls the page
    },
  };

  const logarithm = (row) => row.map((value) => (value === null ? null : Math.log10(Math.max(value, 1e-300))));

  // Titles of panels, as long as there is room above their panel.
  function fitted(place, layout) {
    if (!layout.annotations) return {};
    const starts = Object.keys(layout).filter((key) => key.startsWith("xaxis")).map((key) => layout[key].domain?.[0] ?? 0);
    const size = narrow() ? 9 : 12, room = Math.floor((0.88 * place.clientWidth) / (new Set(starts).size || 1) / (0.56 * size));
    const short = (text) => (text.length > room ? text.slice(0, room - 1) + "…" : text);
    return { annotations: layout.annotations.map((note) => ({ ...note, font: { size, ...note.font, ...(narrow() ? { size } : {}) }, text: short(note.text) })) };
  }

  // On a narrow page the panels of a grid stand one below the other.
  function inOneColumn(layout) {
    const names = Object.keys(layout).filter((key) => /^xaxis\d*$/.test(key) && layout[key].domain);
    const columns = new Set(names.map((key) => layout[key].domain[0])).size;
    if (!narrow() || columns < 2) return layout;
    const gap = names.some((key) => layout[key].title?.text) ? 80 : 46, height = columns * layout.height, changed = { ...layout, height };
    names.forEach((x, at) => {
      const y = x.replace("xaxis", "yaxis"), domain = [1 - (at + 1) / names.length + gap / height, 1 - at / names.length];
      Object.assign(changed, { [x]: { ...layout[x], domain: [0, 1] }, [y]: { ...layout[y], domain, showticklabels: true } });
    });
    return changed;
  }

  // Each name of a legend has a line of its own on a narrow page.
  function tall(data, layout) {
    const names = layout.showlegend === false ? 0 : data.filter((trace) => trace.showlegend !== false).length;
    return narrow() && names > 4 && layout.height ? { height: layout.height + 19 * (names - 4) } : {};
  }

  function draw(place, chart) {
    for (const trace of chart.data) if (trace.meta === "log10") trace.z = trace.customdata.map(logarithm);
    const behind = chart.data.some((trace) => trace.type === "heatmap") ? { plot_bgcolor: colors.missing } : {};
    const layout = inOneColumn(chart.layout);
    return Plotly.react(place, chart.data, Object.assign({ template: theme }, behind, layout, fitted(place, layout), tall(chart.data, layout)), config);
  }

  // A chart is drawn where it has a place; one of several is chosen by its select.
  for (const place of document.querySelectorAll("[data-chart]")) {
    const chart = charts[place.dataset.chart];
    const select = document.querySelector('[data-choose="' + place.id + '"]');
    const show = () => draw(place, select ? chart[select.value] : chart);
    show();
    if (select) select.addEventListener("change", show);
  }
  document.addEventListener("DOMContentLoaded", () => (document.documentElement.dataset.ready = "yes"));
  return { colors, draw, element, narrow, read };
})();
