// Charts of signals: what has come is kept here, so that each sample is sent once.
(() => {
  const charts = {};
  // apart from each other, and from the ground, for those who see red and green alike too
  const ON_LIGHT = ["#1d4ed8", "#c2410c", "#0f766e", "#7e22ce", "#be185d", "#4d7c0f", "#0369a1", "#a16207", "#334155", "#b91c1c", "#4338ca", "#15803d"];
  const ON_DARK = ["#60a5fa", "#fb923c", "#2dd4bf", "#c084fc", "#f472b6", "#a3e635", "#38bdf8", "#fde047", "#cbd5e1", "#f87171", "#818cf8", "#4ade80"];
  window.mcChart = (id, { names, units, steps, span, rows, restart, zero, across = "s" }) => {
    const kept = restart ? (charts[id] = { rows: [] }) : (charts[id] ??= { rows: [] });
    kept.rows.push(...rows);
    const end = kept.rows.length ? kept.rows[kept.rows.length - 1][0] : 0;
    // times are shown from here: the newest one, or that of a trigger
    const origin = zero ?? end;
    const first = kept.rows.findIndex((row) => row[0] >= end - span);
    if (first > 0) kept.rows.splice(0, first);
    const chart = getElement(id)?.chart;
    if (!chart) return;
    const grids = [...new Set(units)];
    // below the last one stand the times
    const high = chart.getHeight(), height = (high - 14) / Math.max(grids.length, 1);
    const dark = document.body.classList.contains("body--dark");
    const text = { color: dark ? "#cbd5e1" : "#334155" };
    const splitLine = { lineStyle: { color: dark ? "#334155" : "#e2e8f0" } };
    chart.setOption({
      animation: false,
      color: dark ? ON_DARK : ON_LIGHT,
      tooltip: { trigger: "axis" },
      axisPointer: { link: [{ xAxisIndex: "all" }] },
      legend: { top: 0, right: 8, left: 80, type: "scroll", textStyle: text },
      grid: grids.map((_, row) => ({ left: 56, right: 12, top: row * height + 0.12 * high, height: height - 0.16 * high })),
      xAxis: grids.map((_, row) => ({ type: "value", splitLine, gridIndex: row, min: end - span - origin, max: end - origin, splitNumber: chart.getWidth() < 420 ? 3 : 6, axisLabel: { ...text, show: row === grids.length - 1, formatter: `{value} ${across}`, hideOverlap: true } })),
      yAxis: grids.map((unit, row) => ({ type: "value", splitLine, gridIndex: row, scale: true, axisLine: { onZero: false }, name: unit, nameTextStyle: { ...text, align: "right" }, axisLabel: text })),
      series: names.map((name, column) => ({
        type: "line", name, showSymbol: false, step: steps[column] ? "end" : false,
        xAxisIndex: grids.indexOf(units[column]), yAxisIndex: grids.indexOf(units[column]),
        data: kept.rows.map((row) => [row[0] - origin, row[column + 1]]),
      })),
    }, { replaceMerge: ["series", "grid", "xAxis", "yAxis"] });
  };

  // a chart that stands still is looked at: wheel and pinch go into it, and do not scroll the page
  window.mcChartFrozen = (id, frozen) => getElement(id)?.chart?.setOption(
    { dataZoom: frozen ? [{ type: "inside", xAxisIndex: "all", filterMode: "none" }] : [] },
    { replaceMerge: ["dataZoom"] },
  );
})();
