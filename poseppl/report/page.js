(function () {
  "use strict";
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const charts = read("charts-data");
  const poses = read("pose-data");
  const coordinates = read("coordinate-data");
  const colors = { mean: "#1f6f8b", draw: "#6db3c9", band: "#cfe6ee", observed: "#e4572e", truth: "#1b1b1e", grid: "#e7e9ec" };
  const config = { responsive: true, displayModeBar: false };
  const font = { family: "system-ui, sans-serif", size: 12, color: "#22262b" };
  const element = (id) => document.getElementById(id);

  // One broken line through all edges of a skeleton, per axis.
  function skeleton(points, edges, axes) {
    const path = Array.from({ length: axes }, () => []);
    for (const [a, b] of edges) {
      for (let k = 0; k < axes; k++) path[k].push(points[a][k], points[b][k], null);
    }
    return path;
  }

  function skeletons(samples, edges, axes) {
    const path = Array.from({ length: axes }, () => []);
    for (const points of samples) {
      const one = skeleton(points, edges, axes);
      for (let k = 0; k < axes; k++) for (const value of one[k]) path[k].push(value);
    }
    return path;
  }

  const column = (points, k) => points.map((point) => point[k]);

  function drawSpace(index) {
    const space = poses.space;
    const place = ([x, y, z], more) => Object.assign({ type: "scatter3d", mode: "lines", x, y, z, hoverinfo: "skip" }, more);
    const mean = space.mean[index];
    const data = [
      place(skeletons(space.draws[index], poses.edges, 3), { name: "posterior draws", opacity: 0.45, line: { color: colors.draw, width: 1.5 } }),
      place(skeleton(mean, poses.edges, 3), { name: "posterior mean", line: { color: colors.mean, width: 7 } }),
      place([0, 1, 2].map((k) => column(mean, k)), {
        name: "joints", mode: "markers", showlegend: false, text: poses.markers.map((name) => name.replace(/&/g, "&amp;").replace(/</g, "&lt;")),
        hoverinfo: "text+x+y+z", marker: { color: colors.mean, size: 3.5 },
      }),
    ];
    if (space.truth) data.push(place(skeleton(space.truth[index], poses.edges, 3), { name: "truth", line: { color: colors.truth, width: 4 } }));
    const axis = (k, title) => ({
      title: { text: title }, range: [space.centre[index][k] - space.reach, space.centre[index][k] + space.reach],
      gridcolor: colors.grid, backgroundcolor: "white", nticks: 5, tickfont: { size: 10 }, zeroline: false, showspikes: false,
    });
    Plotly.react("space", data, {
      uirevision: "keep", margin: { l: 0, r: 0, t: 0, b: 0 }, font, paper_bgcolor: "white", legend: { x: 0, y: 1, orientation: "h" },
      scene: {
        uirevision: "keep", aspectmode: "cube", camera: { eye: { x: 0.82, y: -1.6, z: 0.4 } },
        xaxis: axis(0, "x, mm"), yaxis: axis(1, "y, mm"), zaxis: axis(2, "z, mm"),
      },
    }, config);
  }

  function drawImage(index) {
    const image = poses.image;
    const camera = Number(element("camera").value || 0);
    const flat = ([x, y], more) => Object.assign({ type: "scatter", mode: "lines", x, y, hoverinfo: "skip" }, more);
    const names = poses.markers.map((name) => name.replace(/&/g, "&amp;").replace(/</g, "&lt;"));
    const data = [
      flat(skeletons(image.draws[index].map((cameras) => cameras[camera]), poses.edges, 2), { name: "posterior draws", opacity: 0.45, line: { color: colors.draw, width: 1 } }),
      flat(skeleton(image.mean[index][camera], poses.edges, 2), { name: "posterior mean", line: { color: colors.mean, width: 3 } }),
    ];
    if (!poses.edges.length) {
      data.push(flat([0, 1].map((k) => column(image.mean[index][camera], k)), { name: "mean", mode: "markers", marker: { color: colors.mean } }));
    }
    if (image.observed) {
      const seen = image.observed[index][camera];
      data.push(flat([column(seen, 0), column(seen, 1)], {
        name: "observed", mode: "markers", text: names, hoverinfo: "text",
        marker: { symbol: "circle-open", size: 10, color: colors.observed, line: { width: 2 } },
      }));
    }
    const centre = image.centre[index][camera];
    const reach = image.reach[camera];
    const range = [centre[1] - reach, centre[1] + reach];
    Plotly.react("image", data, {
      margin: { l: 44, r: 8, t: 8, b: 32 }, font, legend: { x: 0, y: 1.0, yanchor: "bottom", orientation: "h" }, paper_bgcolor: "white", plot_bgcolor: "white",
      xaxis: { range: [centre[0] - reach, centre[0] + reach], gridcolor: colors.grid, zeroline: false, nticks: 5 },
      yaxis: { range: image.down[camera] ? range.reverse() : range, gridcolor: colors.grid, zeroline: false, scaleanchor: "x", nticks: 6 },
    }, config);
  }

  function show(index) {
    element("slider").value = String(index);
    element("frame").textContent = "frame " + poses.frames[index];
    if (poses.space) drawSpace(index);
    if (poses.image) drawImage(index);
  }

  function nearest(frame) {
    let best = 0;
    poses.frames.forEach((value, i) => { if (Math.abs(value - frame) < Math.abs(poses.frames[best] - frame)) best = i; });
    return best;
  }

  function startPoses() {
    const slider = element("slider");
    let timer = null;
    const stop = () => { clearInterval(timer); timer = null; element("play").textContent = "Play"; };
    slider.addEventListener("input", () => show(Number(slider.value)));
    element("camera").addEventListener("change", () => show(Number(slider.value)));
    element("play").addEventListener("click", () => {
      if (timer !== null) { stop(); return; }
      element("play").textContent = "Pause";
      timer = setInterval(() => show((Number(slider.value) + 1) % poses.frames.length), 120);
    });
    show(Math.floor(poses.frames.length / 2));
  }

  function drawCoordinate() {
    const which = Number(element("coordinate").value);
    const x = coordinates.frames;
    const data = [];
    if (coordinates.low) {
      data.push({ x, y: coordinates.low[which], mode: "lines", line: { width: 0 }, showlegend: false, hoverinfo: "skip" });
      data.push({ x, y: coordinates.high[which], mode: "lines", line: { width: 0 }, fill: "tonexty", fillcolor: colors.band, name: "central 90 %" });
    }
    data.push({ x, y: coordinates.mean[which], mode: x.length > 1 ? "lines" : "markers", line: { color: colors.mean, width: 2 }, name: "posterior mean" });
    if (coordinates.truth) data.push({ x, y: coordinates.truth[which], mode: x.length > 1 ? "lines" : "markers", line: { color: colors.truth, width: 1.5 }, name: "truth" });
    Plotly.react("coordinate-chart", data, {
      height: 300, margin: { l: 60, r: 16, t: 12, b: 44 }, font, hovermode: "x unified", legend: { orientation: "h", y: 1.02, yanchor: "bottom" },
      xaxis: { title: { text: "frame" }, gridcolor: colors.grid, zeroline: false }, yaxis: { gridcolor: colors.grid, zeroline: false, automargin: true },
    }, config);
  }

  for (const [name, chart] of Object.entries(charts)) {
    Plotly.newPlot("chart-" + name, chart.data, chart.layout, config);
    if (poses && !["coverage", "predictions"].includes(name)) {
      element("chart-" + name).on("plotly_click", (event) => {
        show(nearest(event.points[0].x));
        element("poses").scrollIntoView({ behavior: "smooth" });
      });
    }
  }
  if (poses) startPoses();
  element("coordinate").addEventListener("change", drawCoordinate);
  drawCoordinate();
  document.documentElement.dataset.ready = "yes";
})();
