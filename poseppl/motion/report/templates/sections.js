// The poses: in the images and in space, moved by the slider and by keys.
(function () {
  "use strict";
  const { colors, draw, element, narrow, read } = page;
  const poses = read("pose-data");
  if (!poses) return;

  // One broken line through all edges of skeletons, per axis.
  function skeletons(samples, axes) {
    const path = Array.from({ length: axes }, () => []);
    for (const points of samples) for (const [a, b] of poses.edges) for (let k = 0; k < axes; k++) path[k].push(points[a][k], points[b][k], null);
    return path;
  }

  const columns = (points, axes) => Array.from({ length: axes }, (_, k) => points.map((point) => point[k]));
  const trace = ([x, y, z], more) => Object.assign(z ? { type: "scatter3d", z } : { type: "scatter" }, { mode: "lines", x, y, hoverinfo: "skip" }, more);
  const broken = (lines) => columns(lines.flatMap((line) => [...line, [null, null, null]]), 3);
  const plus = (a, b, factor) => a.map((value, k) => value + factor * b[k]);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

  // Surfaces of the parts: rings across their axes, from one end to the other.
  function flesh(index) {
    const { base, tip, side, radii, scales, balls } = poses.space.flesh;
    const SPOKES = 14, mesh = { x: [], y: [], z: [], i: [], j: [], k: [] };
    base[index].forEach((start, part) => {
      const along = plus(tip[index][part], start, -1), length = Math.hypot(...along), axis = along.map((value) => value / length);
      const x = side[index][part], y = cross(axis, x), [near, far] = radii[part], arc = [0, 0.2, 0.4, 0.6, 0.8, 1].map((share) => share * Math.PI / 2);
      const profile = balls[part] > 0.5
        ? [...arc.map((a) => [-near * Math.cos(a), near * Math.sin(a)]), ...arc.reverse().map((a) => [length + far * Math.cos(a), far * Math.sin(a)])]
        : [[0, 0], [0, near], [length, far], [length, 0]];
      profile.forEach(([offset, radius], ring) => {
        for (let spoke = 0; spoke < SPOKES; spoke++) {
          const angle = (2 * Math.PI * spoke) / SPOKES, next = (spoke + 1) % SPOKES, first = mesh.x.length - spoke;
          const point = plus(plus(plus(start, axis, offset), x, radius * scales[part][0] * Math.cos(angle)), y, radius * scales[part][1] * Math.sin(angle));
          if (ring) for (const corners of [[spoke, next, spoke - SPOKES], [next, next - SPOKES, spoke - SPOKES]]) ["i", "j", "k"].forEach((key, n) => mesh[key].push(first + corners[n]));
          ["x", "y", "z"].forEach((key, n) => mesh[key].push(point[n]));
        }
      });
    });
    const lighting = { ambient: 0.65, diffuse: 0.6, specular: 0.05, roughness: 0.9 };
    return { type: "mesh3d", name: "body at the mean", showlegend: true, hoverinfo: "skip", color: colors.flesh, opacity: 0.55, lighting, ...mesh };
  }

  function floor(low, high) {
    const height = poses.space.floor, lines = [], wanted = Math.max(high[0] - low[0], high[1] - low[1]) / 8;
    const power = 10 ** Math.floor(Math.log10(wanted)), step = power * [5, 2, 1].find((times) => times * power <= wanted);
    for (const [along, across] of [[0, 1], [1, 0]]) {
      for (let at = Math.ceil(low[along] / step) * step; at <= high[along]; at += step) {
        lines.push([low[across], high[across]].map((end) => { const point = [0, 0, height]; point[along] = at; point[across] = end; return point; }));
      }
    }
    return trace(broken(lines), { name: "floor", showlegend: false, line: { color: colors.floor, width: 1.5 } });
  }

  const frustum = (centre, corners) => [[...corners, corners[0]], ...corners.map((corner) => [centre, corner])];

  function around(index, low, high, room) {
    const { cameras, rays } = poses.space, found = [];
    if (poses.space.floor !== null) found.push(floor(low, high));
    if (cameras && rays && element("rays").checked) {
      const lines = rays[index].flatMap((points, c) => points.filter((point) => point[0] !== null).map((point) => [cameras.centre[c], point]));
      const color = colors.observed, shown = room ? lines : lines.map(([from, to]) => [clipped(from, to), to]);
      found.push(trace(broken(shown), { name: "observed rays", opacity: 0.35, line: { color, width: 1.5 } }));
    }
    if (cameras && room) {
      const lines = cameras.centre.flatMap((centre, c) => frustum(centre, cameras.corners[c]));
      found.push(trace(broken(lines), { name: "cameras", line: { color: colors.muted, width: 3 } }));
      found.push(trace(columns(cameras.centre, 3), { mode: "text", text: cameras.names, showlegend: false, textposition: "top center", textfont: { color: colors.ink, size: 12 } }));
    }
    return found;
  }

  // The end of a ray, as far as the close view shows it.
  function clipped(from, to) {
    const away = plus(from, to, -1), length = Math.hypot(...away);
    return plus(to, away, Math.min(1, (0.45 * poses.space.reach) / length));
  }

  function bounds(index, room) {
    const { centre, reach, cameras, floor: height } = poses.space;
    let low = centre[index].map((value) => value - reach), high = centre[index].map((value) => value + reach);
    if (!room && height !== null) [low[2], high[2]] = [Math.min(height, high[2] - 1.2 * reach), Math.max(high[2], height)];
    if (!room) return [low, high];
    for (const point of [...cameras.centre, ...cameras.corners.flat(), ...centre]) {
      low = low.map((value, k) => Math.min(value, point[k]));
      high = high.map((value, k) => Math.max(value, point[k]));
    }
    if (height !== null) low[2] = Math.min(low[2], height);
    return [low, high];
  }

  function drawSpace(index) {
    const space = poses.space, room = element("view").value === "room", [low, high] = bounds(index, room);
    const doubts = space.doubts && space.doubts.reasons[index];
    const why = poses.markers.map((name, k) => (doubts && doubts[k] >= 0 ? name + ": " + space.doubts.words[doubts[k]] : name));
    const doubted = poses.markers.map((name, k) => (doubts && doubts[k] >= 0 ? colors.observed : colors.mean));
    const data = [
      trace(skeletons(space.draws[index], 3), { name: "posterior draws", opacity: 0.45, line: { color: colors.draw, width: 1.5 } }),
      trace(skeletons([space.mean[index]], 3), { name: "posterior mean", line: { color: colors.mean, width: 7 } }),
      trace(columns(space.mean[index], 3), {
        name: "joints", mode: "markers", showlegend: false, text: why, hoverinfo: "text+x+y+z",
        marker: { color: doubted, symbol: doubted.map((color) => (color === colors.mean ? "circle" : "diamond")), size: doubted.map((color) => (color === colors.mean ? 3.5 : 7)) },
      }),
    ];
    if (!poses.edges.length) data.push(trace(columns(space.draws[index].flat(), 3), { name: "posterior draws", mode: "markers", opacity: 0.4, marker: { color: colors.draw, size: 2 } }));
    if (space.truth) data.push(trace(skeletons([space.truth[index]], 3), { name: "truth", line: { color: colors.truth, width: 4 } }));
    if (space.flesh) data.push(flesh(index));
    data.push(...around(index, low, high, room));
    const ghosts = space.ghosts && space.ghosts.masses[index].filter((mass) => mass > 0);
    if (ghosts && ghosts.length > 1) ghosts.forEach((mass, k) => {
      const line = { color: space.ghosts.colors[k], width: 2 + 6 * mass };
      data.push(trace(skeletons([space.ghosts.markers[index][k]], 3), { name: "mode " + (k + 1) + ", " + Math.round(100 * mass) + " %", line }));
    });
    const side = (k, title) => ({
      title: { text: title, font: { size: 11 } }, range: [low[k], high[k]], gridcolor: colors.grid, backgroundcolor: colors.panel, color: colors.ink,
      nticks: narrow() ? 3 : 5, tickfont: { size: 10 }, zeroline: false, showspikes: false,
    });
    const longest = Math.max(...high.map((value, k) => value - low[k])), [x, y, z] = high.map((value, k) => (value - low[k]) / longest);
    const [ahead, away, above] = room ? [1.1, -1.5, 0.75] : [0.92, -1.78, 0.5], far = narrow() ? 1.3 : 1.1;
    const camera = { eye: { x: far * ahead, y: far * away, z: far * above } };
    const scene = { uirevision: room ? "room" : "body", aspectmode: "manual", aspectratio: { x, y, z }, camera, xaxis: side(0, "x, mm"), yaxis: side(1, "y, mm"), zaxis: side(2, "z, mm") };
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

  const slider = element("slider");

  function showFrame(index) {
    slider.value = String(Math.max(0, Math.min(poses.frames.length - 1, index)));
    element("frame").textContent = "frame " + poses.frames[slider.value];
    if (poses.space) drawSpace(Number(slider.value));
    if (poses.image) drawImage(Number(slider.value));
  }

  const again = () => showFrame(Number(slider.value));
  const next = (select) => {
    select.selectedIndex = (select.selectedIndex + 1) % select.length;
    again();
  };
  let timer = null;

  function play() {
    element("play").textContent = timer === null ? "Pause" : "Play";
    if (timer !== null) timer = clearInterval(timer) ?? null;
    else timer = setInterval(() => showFrame((Number(slider.value) + 1) % poses.frames.length), 120);
  }

  slider.addEventListener("input", again);
  for (const id of ["camera", "view", "rays"]) element(id).addEventListener("change", again);
  element("play").addEventListener("click", play);
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.matches("input, select, textarea")) return;
    const step = event.shiftKey ? 10 : 1, at = Number(slider.value);
    const keys = {
      arrowleft: () => showFrame(at - step), arrowright: () => showFrame(at + step), p: play,
      c: () => element("camera").hidden || next(element("camera")), v: () => element("view").hidden || next(element("view")),
    };
    const act = keys[event.key.toLowerCase()];
    if (act) {
      act();
      event.preventDefault();
    }
  });

  const nearest = (frame) => {
    const distances = poses.frames.map((value) => Math.abs(value - frame));
    return distances.indexOf(Math.min(...distances));
  };
  for (const place of document.querySelectorAll("[data-frames]")) {
    place.on("plotly_click", (event) => {
      showFrame(nearest(event.points[0].x));
      element("poses").scrollIntoView({ behavior: "smooth" });
    });
  }
  showFrame(Math.floor(poses.frames.length / 2));
})();
