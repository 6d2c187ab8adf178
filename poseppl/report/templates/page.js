(function () {
  "use strict";
  // Plotly reads a few HTML tags in texts: what comes from a result is escaped here, and nowhere else.
  const escape = (key, value) =>
    typeof value !== "string" || key === "hovertemplate" ? value : value.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const read = (id) => JSON.parse(document.getElementById(id)?.textContent ?? "null", escape);
  const charts = read("charts-data");
  const poses = read("pose-data");
  const element = (id) => document.getElementById(id);
  const colors = { mean: "#1f6f8b", draw: "#6db3c9", observed: "#e4572e", truth: "#1b1b1e", grid: "#e7e9ec", missing: "#eceef1" };
  const config = { responsive: true, displayModeBar: false };
  const axis = { gridcolor: colors.grid, linecolor: colors.grid, zeroline: false };
  const theme = {
    layout: {
      font: { family: "system-ui, sans-serif", size: 12, color: "#22262b" }, paper_bgcolor: "white", plot_bgcolor: "white", hovermode: "x unified",
      margin: { l: 60, r: 16, t: 20, b: 44 }, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, xaxis: axis, yaxis: axis,
    },
  };

  const logarithm = (row) => row.map((value) => (value === null ? null : Math.log10(Math.max(value, 1e-300))));

  function draw(place, chart) {
    for (const trace of chart.data) if (trace.meta === "log10") trace.z = trace.customdata.map(logarithm);
    const behind = chart.data.some((trace) => trace.type === "heatmap") ? { plot_bgcolor: colors.missing } : {};
    return Plotly.react(place, chart.data, Object.assign({ template: theme }, behind, chart.layout), config);
  }

  // A chart is drawn where it has a place; one of several is chosen by its select.
  for (const place of document.querySelectorAll("[data-chart]")) {
    const chart = charts[place.dataset.chart];
    const select = document.querySelector('[data-choose="' + place.id + '"]');
    const show = () => draw(place, select ? chart[select.value] : chart);
    show();
    if (select) select.addEventListener("change", show);
    if (poses && "frames" in place.dataset) {
      place.on("plotly_click", (event) => {
        showFrame(nearest(event.points[0].x));
        element("poses").scrollIntoView({ behavior: "smooth" });
      });
    }
  }

  // One broken line through all edges of skeletons, per axis.
  function skeletons(samples, axes) {
    const path = Array.from({ length: axes }, () => []);
    for (const points of samples) for (const [a, b] of poses.edges) for (let k = 0; k < axes; k++) path[k].push(points[a][k], points[b][k], null);
    return path;
  }

  const columns = (points, axes) => Array.from({ length: axes }, (_, k) => points.map((point) => point[k]));
  const trace = ([x, y, z], more) => Object.assign(z ? { type: "scatter3d", z } : { type: "scatter" }, { mode: "lines", x, y, hoverinfo: "skip" }, more);

  function drawSpace(index) {
    const space = poses.space;
    const doubts = space.doubts && space.doubts.reasons[index];
    const why = poses.markers.map((name, k) => (doubts && doubts[k] >= 0 ? name + ": " + space.doubts.words[doubts[k]] : name));
    const doubted = poses.markers.map((name, k) => (doubts && doubts[k] >= 0 ? colors.observed : colors.mean));
    const data = [
      trace(skeletons(space.draws[index], 3), { name: "posterior draws", opacity: 0.45, line: { color: colors.draw, width: 1.5 } }),
      trace(skeletons([space.mean[index]], 3), { name: "posterior mean", line: { color: colors.mean, width: 7 } }),
      trace(columns(space.mean[index], 3), {
        name: "joints", mode: "markers", showlegend: false, text: why, hoverinfo: "text+x+y+z",
        marker: { color: doubted, size: doubted.map((color) => (color === colors.mean ? 3.5 : 7)) },
      }),
    ];
    if (space.truth) data.push(trace(skeletons([space.truth[index]], 3), { name: "truth", line: { color: colors.truth, width: 4 } }));
    const ghosts = space.ghosts && space.ghosts.masses[index].filter((mass) => mass > 0);
    if (ghosts && ghosts.length > 1) ghosts.forEach((mass, k) => {
      const line = { color: space.ghosts.colors[k], width: 2 + 6 * mass };
      data.push(trace(skeletons([space.ghosts.markers[index][k]], 3), { name: "mode " + (k + 1) + ", " + Math.round(100 * mass) + " %", line }));
    });
    const side = (k, title) => ({
      title: { text: title }, range: [space.centre[index][k] - space.reach, space.centre[index][k] + space.reach],
      gridcolor: colors.grid, backgroundcolor: "white", nticks: 5, tickfont: { size: 10 }, zeroline: false, showspikes: false,
    });
    const camera = { eye: { x: 0.82, y: -1.6, z: 0.4 } };
    const scene = { uirevision: "keep", aspectmode: "cube", camera, xaxis: side(0, "x, mm"), yaxis: side(1, "y, mm"), zaxis: side(2, "z, mm") };
    draw("space", { data, layout: { uirevision: "keep", margin: { l: 0, r: 0, t: 0, b: 0 }, legend: { x: 0, y: 1, orientation: "h" }, scene } });
  }

  function drawImage(index) {
    const image = poses.image;
    const camera = Number(element("camera").value || 0);
    const mean = image.mean[index][camera];
    const data = [
      trace(skeletons(image.draws[index].map((cameras) => cameras[camera]), 2), { name: "posterior draws", opacity: 0.45, line: { color: colors.draw, width: 1 } }),
      trace(skeletons([mean], 2), { name: "posterior mean", line: { color: colors.mean, width: 3 } }),
    ];
    if (!poses.edges.length) data.push(trace(columns(mean, 2), { name: "mean", mode: "markers", marker: { color: colors.mean } }));
    if (image.observed) {
      const marker = { symbol: "circle-open", size: 10, color: colors.observed, line: { width: 2 } };
      data.push(trace(columns(image.observed[index][camera], 2), { name: "observed", mode: "markers", text: poses.markers, hoverinfo: "text", marker }));
    }
    const [x, y] = image.centre[index][camera].map((value) => [value - image.reach[camera], value + image.reach[camera]]);
    const yaxis = { range: image.down[camera] ? y.reverse() : y, scaleanchor: "x", nticks: 6 };
    draw("image", { data, layout: { margin: { l: 44, r: 8, t: 8, b: 32 }, hovermode: "closest", xaxis: { range: x, nticks: 5 }, yaxis } });
  }

  function showFrame(index) {
    element("slider").value = String(index);
    element("frame").textContent = "frame " + poses.frames[index];
    if (poses.space) drawSpace(index);
    if (poses.image) drawImage(index);
  }

  function nearest(frame) {
    const distances = poses.frames.map((value) => Math.abs(value - frame));
    return distances.indexOf(Math.min(...distances));
  }

  if (poses) {
    const slider = element("slider");
    let timer = null;
    for (const [id, event] of [["slider", "input"], ["camera", "change"]]) element(id).addEventListener(event, () => showFrame(Number(slider.value)));
    element("play").addEventListener("click", () => {
      element("play").textContent = timer === null ? "Pause" : "Play";
      if (timer !== null) timer = clearInterval(timer) ?? null;
      else timer = setInterval(() => showFrame((Number(slider.value) + 1) % poses.frames.length), 120);
    });
    showFrame(Math.floor(poses.frames.length / 2));
  }
  document.documentElement.dataset.ready = "yes";
})();
