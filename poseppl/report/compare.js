(function () {
  "use strict";
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const charts = read("charts-data");
  const heat = read("heat-data");
  const variance = read("variance-data");
  const element = (id) => document.getElementById(id);
  const config = { responsive: true, displayModeBar: false };
  const font = { family: "system-ui, sans-serif", size: 12, color: "#22262b" };
  const grid = "#e7e9ec";
  const missing = "#eceef1";

  // Ticks at 1, 3, 10, 30, ... between the ends of a logarithmic scale.
  function logTicks(low, high) {
    const all = [];
    const step = Math.log10(high / low) > 4 ? [1] : [1, 3];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++) {
      for (const digit of step) {
        const value = digit * 10 ** power;
        if (value >= low * 0.999 && value <= high * 1.001) all.push(value);
      }
    }
    return all;
  }

  const brief = (value) => (value >= 1e4 || value < 1e-3 ? value.toExponential(0).replace("e+", "e") : String(Number(value.toPrecision(2))));

  function colorAxis(quantity) {
    const ends = [quantity.low, quantity.high];
    const bar = { title: { text: quantity.label, side: "right" }, thickness: 12, len: 1 };
    if (quantity.log) {
      const ticks = logTicks(...ends);
      Object.assign(bar, { tickvals: ticks.map(Math.log10), ticktext: ticks.map(brief) });
    }
    // Light is good, dark is bad.
    return {
      colorscale: "YlGnBu", reversescale: !quantity.reverse, colorbar: bar,
      cmin: quantity.log ? Math.log10(ends[0]) : ends[0], cmax: quantity.log ? Math.log10(ends[1]) : ends[1],
    };
  }

  function drawHeat() {
    const quantity = heat.quantities[Number(element("quantity").value)];
    const count = heat.runs.length;
    const columns = count <= 4 ? Math.min(count, 2) : 3;
    const rows = Math.ceil(count / columns);
    const panel = Math.min(60, Math.max(8, heat.dofs.length)) * 11;
    const height = rows * (panel + 62) + 20;
    const layout = {
      height, margin: { l: 96, r: 20, t: 6, b: 26 }, font, paper_bgcolor: "white", plot_bgcolor: missing, coloraxis: colorAxis(quantity), annotations: [],
    };
    const data = [];
    const inner = height - 32;
    for (let i = 0; i < count; i++) {
      const suffix = i ? String(i + 1) : "";
      const [row, column] = [Math.floor(i / columns), i % columns];
      const width = (1 - 0.025 * (columns - 1)) / columns;
      const left = column * (width + 0.025);
      const top = 1 - (row * (panel + 62) + 26) / inner;
      const values = quantity.values[i];
      data.push({
        type: "heatmap", x: heat.frames, y: heat.dofs, customdata: values, xaxis: "x" + suffix, yaxis: "y" + suffix, coloraxis: "coloraxis",
        z: values.map((line) => line.map((v) => (v === null ? null : quantity.log ? Math.log10(Math.max(v, 1e-300)) : v))),
        hovertemplate: "%{y}, frame %{x}<br>" + quantity.label + " %{customdata}<extra>" + heat.runs[i] + "</extra>",
      });
      layout["xaxis" + suffix] = { domain: [left, left + width], anchor: "y" + suffix, showgrid: false, zeroline: false, tickfont: { size: 10 }, nticks: 6, range: heatRange() };
      layout["yaxis" + suffix] = {
        domain: [Math.max(0, top - panel / inner), top], anchor: "x" + suffix, type: "category", range: [heat.dofs.length - 0.5, -0.5],
        showticklabels: column === 0, ticks: "", tickfont: { size: 9 }, showgrid: false, dtick: heat.dofs.length > 60 ? undefined : 1,
      };
      layout.annotations.push({
        text: '<span style="color:' + heat.colors[i] + '">\u25CF</span> <b>' + heat.runs[i] + "</b>", xref: "paper", yref: "paper", x: left, y: top,
        xanchor: "left", yanchor: "bottom", showarrow: false, font: { size: 12 },
      });
      if (values.every((line) => line.every((v) => v === null))) {
        layout.annotations.push({
          text: heat.formula[i] ? "closed form: no Monte Carlo error" : "no figure", xref: "paper", yref: "paper", x: left + width / 2,
          y: top - panel / inner / 2, showarrow: false, font: { color: "#69727d" },
        });
      }
    }
    Plotly.react("heat", data, layout, config);
  }

  function heatRange() {
    const frames = heat.frames;
    const half = frames.length > 1 ? (frames[1] - frames[0]) / 2 : 0.5;
    return [frames[0] - half, frames[frames.length - 1] + half];
  }

  // Both ends of a bar of two standard errors of the logarithm.
  function bars(values, errors) {
    const factor = values.map((v, i) => (v === null || errors[i] === null ? null : Math.exp(Math.min((2 * errors[i]) / v, 12))));
    return {
      type: "data", symmetric: false, thickness: 1.2, width: 3,
      array: values.map((v, i) => (factor[i] === null ? 0 : v * (factor[i] - 1))),
      arrayminus: values.map((v, i) => (factor[i] === null ? 0 : v - v / factor[i])),
    };
  }

  function drawVariance() {
    const place = Number(element("place").value);
    const data = [];
    const methods = [...new Set(variance.methods.map((name, i) => name || variance.names[i]))];
    for (const method of methods) {
      const members = variance.names.map((_, i) => i).filter((i) => (variance.methods[i] || variance.names[i]) === method && variance.variance[place][i] !== null);
      if (!members.length) continue;
      members.sort((a, b) => variance.seconds[a] - variance.seconds[b]);
      const color = variance.colors[members[0]];
      const pick = (list) => members.map((i) => list[i]);
      const y = pick(variance.variance[place]);
      const x = pick(variance.seconds);
      const wrong = members.every((i) => variance.disqualified[i]);
      data.push({
        type: "scatter", mode: members.length > 1 ? "lines+markers" : "markers", name: method + (wrong ? " (disqualified)" : ""), x, y,
        text: members.map((i) => variance.names[i] + (variance.replicates[i] > 1 ? ", " + variance.replicates[i] + " seeds" : ", one seed")),
        hovertemplate: "%{text}<br>%{x:.3g} s a frame, variance %{y:.3g}<extra></extra>", line: { color, width: 1 },
        marker: { color, size: 11, line: { width: 2, color }, symbol: members.map((i) => (variance.replicates[i] > 1 ? "circle" : "circle-open")) },
        error_y: Object.assign(bars(y, pick(variance.error[place])), { color }),
        error_x: Object.assign(bars(x, pick(variance.seconds_error)), { color }),
      });
    }
    Plotly.react("variance-chart", data, {
      height: 430, margin: { l: 70, r: 16, t: 12, b: 48 }, font, paper_bgcolor: "white", plot_bgcolor: "white", showlegend: true, shapes: equalEfficiency(data),
      legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, hovermode: "closest",
      xaxis: logAxis("seconds a frame", data.flatMap((trace) => trace.x)),
      yaxis: logAxis("variance of the mean / posterior variance", data.flatMap((trace) => reach(trace))),
    }, config);
  }

  // A logarithmic axis around some values.
  function logAxis(title, values) {
    const [low, high] = [Math.min(...values) / 2, Math.max(...values) * 2];
    const ticks = logTicks(low, high);
    return {
      type: "log", gridcolor: grid, zeroline: false, title: { text: title }, range: [Math.log10(low), Math.log10(high)],
      tickvals: ticks, ticktext: ticks.map(brief),
    };
  }

  const reach = (trace) => trace.y.flatMap((y, i) => [y - trace.error_y.arrayminus[i], y + trace.error_y.array[i]]);

  // Through each method's best point, the line along which variance times time is the same.
  function equalEfficiency(data) {
    const times = data.flatMap((trace) => trace.x);
    const [low, high] = [Math.min(...times) / 2, Math.max(...times) * 2];
    return data.map((trace) => {
      const cost = Math.min(...trace.x.map((x, i) => x * trace.y[i]));
      return { type: "line", x0: low, x1: high, y0: cost / low, y1: cost / high, layer: "below", line: { color: trace.line.color, width: 1, dash: "dot" }, opacity: 0.5 };
    });
  }

  for (const [name, chart] of Object.entries(charts)) Plotly.newPlot("chart-" + name, chart.data, chart.layout, config);
  if (heat.quantities.length) {
    element("quantity").addEventListener("change", drawHeat);
    drawHeat();
  }
  if (variance) {
    element("place").addEventListener("change", drawVariance);
    drawVariance();
  }
  document.documentElement.dataset.ready = "yes";
})();
